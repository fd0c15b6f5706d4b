//! What can't be seen: chunks outside of the view, back-facing, or occluded; and cells, the parts that a frame is drawn
//! by.

pub(crate) mod cells;
pub(crate) mod chunks;
pub(crate) mod groups;
pub(crate) mod object;
pub(crate) mod occlusion;
