//! Conformance scenes, each for one property. The purpose of a scene is the fault that it catches.

mod balls;
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

pub use balls::*;
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

/// Image to be drawn: a scene with its camera, settings and region.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the case, for messages.
    pub name: String,
    /// Scene to draw.
    pub scene: Scene,
    /// Camera of the image.
    pub camera: Camera,
    /// Settings of the image.
    pub settings: Settings,
    /// Region of the image that is drawn; `None` for the whole image.
    pub region: Option<Region>,
}

impl Case {
    /// Creates a case with default settings.
    pub fn new(name: &str, scene: Scene, camera: Camera) -> Self {
        Self { name: name.into(), scene, camera, settings: Settings::default(), region: None }
    }

    /// Returns a copy of the case with changed settings, under the name `name/variant`.
    #[must_use]
    pub fn with(&self, variant: &str, change: impl FnOnce(&mut Settings)) -> Self {
        let mut case = self.clone();
        case.name = format!("{}/{variant}", self.name);
        change(&mut case.settings);
        case
    }

    /// True if a backend with these capabilities supports this case.
    pub fn is_drawn_by(&self, capabilities: &Capabilities) -> bool {
        unsupported(&SceneSummary::of(&self.scene), &self.settings, Planes::ALL, capabilities).is_none()
    }

    /// Returns the view of the drawn region.
    ///
    /// # Panics
    /// If the camera or the region is invalid: cases are written in code, not read.
    pub fn view(&self) -> View {
        View::of_region(&self.camera, self.region).expect("cases have valid cameras")
    }
}

/// Returns every scene that backends are tested with, in all filters that matter.
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
    cases.extend(ball_cases());
    cases
}
