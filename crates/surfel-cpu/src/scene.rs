//! The resident scene, from upload to the last frame: clouds in chunks with bounds, their clips, and meshes.

pub(crate) mod balls;
pub(crate) mod clips;
pub(crate) mod cloud;
pub(crate) mod column;
pub(crate) mod groups;
pub(crate) mod mesh;
pub(crate) mod numbers;
pub(crate) mod resident;
