//! Scenes of one property each. What a scene is for is the fault that it catches.

mod clipping;
mod facings;
mod gaussians;
mod geometry;
mod meshes;
mod numeric;
mod octrees;
mod samples;
mod shading;
mod shadows;
mod styles;
mod transparency;

pub use clipping::*;
pub use facings::*;
pub use gaussians::*;
pub use geometry::*;
pub use meshes::*;
pub use numeric::*;
pub use octrees::*;
pub use shading::*;
pub use shadows::*;
pub use styles::*;
pub use transparency::*;

use surfel_model::{Camera, Scene, Settings};
use surfel_render::{Capabilities, Planes, Region, SceneSummary, View, unsupported};

/// A scene, and how it is drawn: an image to be made.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name, for messages.
    pub name: String,
    /// What is drawn.
    pub scene: Scene,
    /// From where.
    pub camera: Camera,
    /// How.
    pub settings: Settings,
    /// The part of the image that is drawn; all of it without one.
    pub region: Option<Region>,
}

impl Case {
    /// A case with default settings.
    pub fn new(name: &str, scene: Scene, camera: Camera) -> Self {
        Self { name: name.into(), scene, camera, settings: Settings::default(), region: None }
    }

    /// The same with other settings, under the name `name/variant`.
    #[must_use]
    pub fn with(&self, variant: &str, change: impl FnOnce(&mut Settings)) -> Self {
        let mut case = self.clone();
        case.name = format!("{}/{variant}", self.name);
        change(&mut case.settings);
        case
    }

    /// True if a backend says that it draws this.
    pub fn is_drawn_by(&self, capabilities: &Capabilities) -> bool {
        unsupported(&SceneSummary::of(&self.scene), &self.settings, Planes::ALL, capabilities).is_none()
    }

    /// The view of what is drawn.
    ///
    /// # Panics
    /// If the camera or the region is invalid: cases are written here, not read.
    pub fn view(&self) -> View {
        View::of_region(&self.camera, self.region).expect("cases have valid cameras")
    }
}

/// Every scene, with every filter where filters matter: what a backend is held to.
pub fn all() -> Vec<Case> {
    let mut cases = geometry_cases();
    cases.extend(numeric_cases());
    cases.extend(shading_cases());
    cases.extend(transparency_cases());
    cases.extend(mesh_cases());
    cases.extend(octree_cases());
    cases.extend(shadow_cases());
    cases.extend(clipping_cases());
    cases.extend(style_cases());
    cases.extend(facing_cases());
    cases.extend(samples::sample_cases());
    cases.extend(gaussian_cases());
    cases
}
