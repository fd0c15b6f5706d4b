//! The steps of a tile, in order, whatever API executes them.

use surfel_render::FramePlan;

/// A set of sums that one pass over the splats adds up. No set is wider than 32 bytes a sample, which every adapter has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sums {
    /// Colour and weight: one target of four.
    Color,
    /// Colour and weight, normal and depth: two targets of four.
    Surface,
    /// Material factors and the number of fragments: a target of four and one of one.
    Further,
}

impl Sums {
    /// The passes over the splats that a plan needs.
    pub fn of(plan: &FramePlan) -> Vec<Self> {
        let surface = plan.attributes.normal || plan.attributes.depth;
        let mut sums = vec![if surface { Self::Surface } else { Self::Color }];
        if plan.attributes.material || plan.planes.fragments {
            sums.push(Self::Further);
        }
        sums
    }

    /// The fragment entry point.
    pub fn entry(self) -> &'static str {
        match self {
            Self::Color => "color_fragment",
            Self::Surface => "surface_fragment",
            Self::Further => "further_fragment",
        }
    }
}

/// A step of a tile. Numbers are indices of the scene's segments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Set up records.
    Setup {
        /// Of these segments.
        segments: Vec<usize>,
        /// Their splats have not been set up in this tile before, and count as drawn.
        first: bool,
    },
    /// Keep the least z + ε.
    Visibility {
        /// Of these segments' records.
        segments: Vec<usize>,
        /// The pass is the tile's first: it clears, and draws the near splats, too.
        first: bool,
    },
    /// Add up attributes.
    Sums {
        /// Which.
        sums: Sums,
        /// Of these segments' records.
        segments: Vec<usize>,
        /// As for visibility.
        first: bool,
    },
    /// Once a pixel.
    Shade,
}

impl Step {
    /// Its name in the statistics.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Setup { .. } => "setup",
            Self::Visibility { .. } => "visibility",
            Self::Sums { .. } => "attributes",
            Self::Shade => "shade",
        }
    }
}

/// The steps of a tile that these segments may touch. Records that fit into memory together are set up once; where one
/// buffer serves all segments in turn (`shared_records`) they are set up again for the attributes.
pub fn schedule(plan: &FramePlan, visible: &[usize], shared_records: bool) -> Vec<Step> {
    let sums = Sums::of(plan);
    let groups: Vec<Vec<usize>> = if shared_records && visible.len() > 1 {
        visible.iter().map(|&segment| vec![segment]).collect()
    } else {
        vec![visible.to_vec()]
    };
    let again = groups.len() > 1;
    let mut steps = Vec::new();
    for (i, segments) in groups.iter().enumerate() {
        if !segments.is_empty() {
            steps.push(Step::Setup { segments: segments.clone(), first: true });
        }
        steps.push(Step::Visibility { segments: segments.clone(), first: i == 0 });
    }
    for (i, segments) in groups.iter().enumerate() {
        if again {
            steps.push(Step::Setup { segments: segments.clone(), first: false });
        }
        steps.extend(sums.iter().map(|&sums| Step::Sums { sums, segments: segments.clone(), first: i == 0 }));
    }
    steps.push(Step::Shade);
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Camera, Projection, Settings};
    use surfel_render::{Capabilities, Planes, SceneSummary, View, plan};

    fn planned(planes: Planes) -> FramePlan {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let capabilities = Capabilities { backend: "test", features: &[] };
        plan(&SceneSummary::default(), &view, &Settings::default(), planes, &capabilities).unwrap()
    }

    #[test]
    fn an_unlit_picture_needs_one_pass_of_one_target() {
        assert_eq!(Sums::of(&planned(Planes::COLOR)), [Sums::Color]);
        assert_eq!(Sums::of(&planned(Planes::ALL)), [Sums::Surface]);
        let counted = Planes { fragments: true, ..Planes::COLOR };
        assert_eq!(Sums::of(&planned(counted)), [Sums::Color, Sums::Further]);
    }

    #[test]
    fn records_of_their_own_are_set_up_once_and_shared_ones_twice() {
        let setups = |steps: &[Step]| steps.iter().filter(|s| matches!(s, Step::Setup { .. })).count();
        let plan = planned(Planes::COLOR);
        let own = schedule(&plan, &[0, 2, 5], false);
        assert_eq!((own.len(), setups(&own)), (4, 1));
        let shared = schedule(&plan, &[0, 2, 5], true);
        assert_eq!(setups(&shared), 6);
        // Visibility of all comes before the first sum.
        let first_sum = shared.iter().position(|s| matches!(s, Step::Sums { .. })).unwrap();
        assert!(!shared[first_sum..].iter().any(|s| matches!(s, Step::Visibility { .. })));
        assert_eq!(setups(&schedule(&plan, &[3], true)), 1);
        // A tile that nothing touches is cleared and shaded all the same.
        let empty = schedule(&plan, &[], false);
        assert_eq!(empty.iter().map(Step::name).collect::<Vec<_>>(), ["visibility", "attributes", "shade"]);
    }
}
