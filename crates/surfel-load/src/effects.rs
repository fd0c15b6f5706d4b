//! Effects of loading options: the kinds of files that each option affects.

use crate::LoadOptions;
use std::borrow::Cow;
use surfel_io::Content;
use surfel_model::{Outliers, PointColors};
use surfel_sample::MeshMethod;

/// Set of kinds of input files, as bits. Each kind is a constant of this type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Inputs(u8);

impl Inputs {
    /// Point clouds.
    pub const POINTS: Self = Self(1);
    /// Meshes.
    pub const MESHES: Self = Self(2);
    /// Files of splats.
    pub const SPLATS: Self = Self(4);
    /// Octrees of splats and polygons (`.surfel`).
    pub const OCTREES: Self = Self(8);
    /// Trained Gaussians.
    pub const GAUSSIANS: Self = Self(16);
    /// Set of all kinds.
    pub const ALL: Self = Self(31);
    /// Each kind as a set, with its name in messages.
    const NAMED: [(&'static str, Self); 5] = [
        ("points", Self::POINTS),
        ("splats", Self::SPLATS),
        ("a mesh", Self::MESHES),
        ("an octree", Self::OCTREES),
        ("Gaussians", Self::GAUSSIANS),
    ];

    /// Returns the union of both sets.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// True if both sets have a kind in common.
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Returns the kinds as text, such as "points or a mesh".
    pub fn words(self) -> String {
        let names: Vec<&str> = Self::NAMED.into_iter().filter(|(_, kind)| self.has(*kind)).map(|(n, _)| n).collect();
        match names.split_last() {
            Some((last, others)) if !others.is_empty() => format!("{} or {last}", others.join(", ")),
            _ => names.concat(),
        }
    }
}

/// Loading option, and the kinds of files that it affects. The list of options without effect is derived from it.
#[derive(Clone, Copy, Debug)]
pub struct Effect {
    /// Key of the option in a scene file's `convert` object.
    pub option: &'static str,
    /// Kinds of files that the option affects.
    pub inputs: Inputs,
    /// Function that returns true if the user has set the option to a value with an effect.
    pub given: fn(&LoadOptions) -> bool,
}

/// Kinds of files with rows (points or splats) that can be selected.
const ROWS: Inputs = Inputs::POINTS.and(Inputs::SPLATS);
/// Kinds of files whose attributes can determine colours.
const VALUES: Inputs = ROWS.and(Inputs::MESHES);

/// Kinds of files that each loading option affects. Options that aren't listed affect all files.
pub const EFFECTS: [Effect; 20] = [
    effect("color_by", VALUES, |o| o.convert.color_by.is_some()),
    effect("labels", VALUES, |o| o.convert.labels.is_some()),
    effect("colors", Inputs::POINTS, |o| o.convert.colors == Some(PointColors::Fit)),
    effect("texture", Inputs::MESHES.and(Inputs::OCTREES), |o| o.convert.texture.sampling.is_some()),
    effect("crop", ROWS, |o| o.convert.crop.is_some()),
    effect("classes", ROWS, |o| o.convert.classes.is_some()),
    effect("returns", ROWS, |o| o.convert.returns.is_some()),
    effect("where", ROWS, |o| o.convert.condition.is_some()),
    effect("every", ROWS, |o| o.convert.every.is_some()),
    effect("max_points", Inputs::POINTS, |o| o.convert.max_points.is_some()),
    effect("all_points", Inputs::POINTS, |o| o.convert.all_points),
    effect("outliers", Inputs::POINTS, |o| o.convert.outliers == Some(Outliers::Drop)),
    effect("points_as", Inputs::POINTS, |o| o.convert.points_as.is_some()),
    effect("columns", Inputs::ALL, |o| o.convert.columns.is_some()),
    effect("splats", Inputs::MESHES, |o| matches!(o.method(), Some(MeshMethod::Count(_) | MeshMethod::Detail))),
    effect("per_vertex", Inputs::MESHES.and(Inputs::POINTS), |o| o.method() == Some(MeshMethod::PerVertex)),
    effect("per_face", Inputs::MESHES, |o| o.method() == Some(MeshMethod::PerFace)),
    effect("radius_scale", VALUES, |o| o.radius_scale() != 1.0),
    effect("sharp", Inputs::POINTS.and(Inputs::MESHES), |o| o.convert.sharp),
    effect("error", Inputs::MESHES, |o| o.convert.error.is_some()),
];

const fn effect(option: &'static str, inputs: Inputs, given: fn(&LoadOptions) -> bool) -> Effect {
    Effect { option, inputs, given }
}

/// Returns the effect of the option with this key; `None` if the option isn't among [`EFFECTS`].
pub fn of(option: &str) -> Option<Effect> {
    EFFECTS.into_iter().find(|effect| effect.option == option)
}

/// Report that an option has no effect on a file's content.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnusedOption {
    /// Key of the option in a scene file's `convert` object, such as "splats" or "max_points".
    pub option: &'static str,
    /// Content of the file, such as "splats", "points", "a mesh" or "an octree", or a list of its attributes.
    pub holds: Cow<'static, str>,
    /// Content that the option would affect, such as "a mesh".
    pub expected: Cow<'static, str>,
}

/// Returns the options that have no effect on a file's content.
pub fn unused(content: &Content, options: &LoadOptions) -> Vec<UnusedOption> {
    let (holds, kind) = match content {
        Content::Splats(_) => ("splats", Inputs::SPLATS),
        Content::Points(_) => ("points", Inputs::POINTS),
        Content::Mesh(_) => ("a mesh", Inputs::MESHES),
        Content::Octree(_) => ("an octree", Inputs::OCTREES),
        Content::Gaussians(_) => ("Gaussians", Inputs::GAUSSIANS),
    };
    let unused = EFFECTS.into_iter().filter(|effect| !effect.inputs.has(kind) && (effect.given)(options));
    let described = |Effect { option, inputs, .. }: Effect| UnusedOption {
        option,
        holds: holds.into(),
        expected: inputs.words().into(),
    };
    unused.map(described).collect()
}
