//! Variants of settings: each changes one setting (*knob*) to one value.

use surfel_model::Settings;
use surfel_model::{Accumulate, ClipPolicy, DepthTolerance, EdgeAa, Filter, Mapping, Shader, Transparency};
use surfel_render::Preset;

/// Name of the setting and of the value of the variant that changes nothing.
pub(crate) const DEFAULT: &str = "default";

/// Variant with one changed setting. All other settings are the subject's.
#[derive(Clone)]
pub(crate) struct Variant {
    pub knob: &'static str,
    pub value: String,
    /// True if splats are stored in 16 bits.
    pub quantised: bool,
    /// Property that a subject or backend needs for the variant to be measured.
    pub only: Only,
    change: Change,
}

/// Property that a subject or a backend needs for a setting to have an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Only {
    /// No property: the setting is measured on every subject and backend.
    Everything,
    /// Only subjects whose splats have clips.
    Clips,
    /// Only subjects with transparent splats.
    Transparent,
    /// Only subjects with the shader `phong`.
    Lit,
    /// Only backends that use a GPU API.
    Graphics,
}

/// Change of the subject's settings by a variant.
#[derive(Clone, Copy)]
enum Change {
    Nothing,
    Filter(Filter),
    Mapping(Mapping),
    Cutoff(f64),
    Prefilter(f64),
    Tolerance(f64),
    Accumulate(Accumulate),
    EdgeAa(EdgeAa),
    Clip(ClipPolicy),
    Transparency(Transparency),
    Shader(Shader),
    Preset(Preset),
    /// Filter of a paper, with the cutoff and the filter radius h of the papers: c = 1, h = √2 pixels.
    Paper(Filter),
    /// Edge antialiasing by samples, with this cutoff and this filter radius h in pixels.
    Edges(f64, f64),
    /// Simplest drawing: no filter, and the affine mapping.
    Plainest,
}

impl Variant {
    /// Creates a variant that has another scene and the subject's settings.
    pub(crate) fn of_scene(knob: &'static str, value: String) -> Self {
        Self::new(knob, value, Change::Nothing)
    }

    fn new(knob: &'static str, value: String, change: Change) -> Self {
        Self { knob, value, quantised: false, only: Only::Everything, change }
    }

    fn only(self, only: Only) -> Self {
        Self { only, ..self }
    }

    /// Returns the preset of the variant; `None` if the variant isn't a preset.
    pub(crate) fn preset(&self) -> Option<Preset> {
        match self.change {
            Change::Preset(preset) => Some(preset),
            _ => None,
        }
    }

    /// Returns the subject's settings with the variant's change.
    pub(crate) fn settings(&self, settings: &Settings) -> Settings {
        let mut s = *settings;
        match self.change {
            Change::Nothing => {}
            Change::Filter(filter) => s.filter = filter,
            Change::Mapping(mapping) => s.mapping = mapping,
            Change::Cutoff(cutoff) => s.cutoff = cutoff,
            Change::Prefilter(h) => s.prefilter_radius_px = h,
            Change::Tolerance(k) => s.depth_tolerance = DepthTolerance::Relative(k),
            Change::Accumulate(accumulate) => s.accumulate = accumulate,
            Change::EdgeAa(edge_aa) => s.edge_aa = edge_aa,
            Change::Clip(clip) => s.clip = clip,
            Change::Transparency(transparency) => s.transparency = transparency,
            Change::Shader(shader) => s.shader = shader,
            Change::Preset(preset) => s = preset.apply(s),
            Change::Edges(cutoff, h) => {
                (s.edge_aa, s.cutoff, s.prefilter_radius_px) = (EdgeAa::Samples, cutoff, h);
            }
            Change::Plainest => (s.filter, s.mapping) = (Filter::None, Mapping::Affine),
            Change::Paper(filter) => {
                (s.filter, s.cutoff, s.prefilter_radius_px) = (filter, 1.0, std::f64::consts::SQRT_2);
            }
        }
        s
    }
}

/// Returns all variants. The default comes first; then every other value of each setting, combinations, the filters of
/// papers, and presets follow. With `quick`, combinations are omitted.
pub(crate) fn all(quick: bool) -> Vec<Variant> {
    let new = |knob, value: &dyn ToString, change| Variant::new(knob, value.to_string(), change);
    let mut variants = vec![new(DEFAULT, &DEFAULT, Change::Nothing)];
    let others = Filter::ALL.into_iter().filter(|f| *f != Settings::default().filter);
    variants.extend(others.map(|f| new("filter", &f.name(), Change::Filter(f))));
    variants.push(new("mapping", &"affine", Change::Mapping(Mapping::Affine)));
    for cutoff in [1.0, 1.5, 3.0, 4.5] {
        variants.push(new("cutoff", &cutoff, Change::Cutoff(cutoff)));
    }
    for h in [0.5, 1.0, std::f64::consts::SQRT_2] {
        variants.push(new("prefilter", &format!("{h:.2} px"), Change::Prefilter(h)));
    }
    for k in [0.25, 0.5, 2.0, 4.0] {
        variants.push(new("depth tolerance", &format!("{k} radii"), Change::Tolerance(k)));
    }
    variants.push(Variant { quantised: true, ..new("storage", &"16 bits", Change::Nothing) });
    variants.push(new("accumulate", &"f16", Change::Accumulate(Accumulate::F16)).only(Only::Graphics));
    variants.push(new("edge antialiasing", &"on", Change::EdgeAa(EdgeAa::Coverage)));
    variants.push(new("edge antialiasing", &"samples", Change::EdgeAa(EdgeAa::Samples)));
    for (name, clip) in [("paper", ClipPolicy::Paper), ("line", ClipPolicy::Line), ("off", ClipPolicy::Off)] {
        variants.push(new("clip", &name, Change::Clip(clip)).only(Only::Clips));
    }
    for layers in [1, 2, 3, 4, 8, 12] {
        let kinds = [
            Transparency::Peel { layers, drop_last: false },
            Transparency::Peel { layers, drop_last: true },
            Transparency::ABuffer { layers },
        ];
        // The image of an A-buffer doesn't depend on its number of layers (rendering model §8).
        let of_interest = kinds.into_iter().filter(|t| match t {
            Transparency::ABuffer { .. } => layers == 8,
            Transparency::Peel { drop_last, .. } => !drop_last || layers == 4,
            Transparency::Off => true,
        });
        let variant = |t: Transparency| new("transparency", &t, Change::Transparency(t));
        variants.extend(of_interest.map(|t| variant(t).only(Only::Transparent)));
    }
    let off = new("transparency", &"off", Change::Transparency(Transparency::Off));
    variants.push(off.only(Only::Transparent));
    for (name, shader) in [
        ("unlit", Shader::Unlit),
        ("normal", Shader::Normal),
        ("depth", Shader::Depth),
        ("toon", Shader::Toon),
        ("matcap", Shader::Matcap),
        ("edl", Shader::Edl),
    ] {
        variants.push(new("shader", &name, Change::Shader(shader)).only(Only::Lit));
    }
    let h = Settings::default().prefilter_radius_px;
    let edges = |value: &dyn ToString, cutoff, h| new("combinations", value, Change::Edges(cutoff, h));
    if !quick {
        variants.push(edges(&"edges, cutoff 1.5", 1.5, h));
        variants.push(edges(&"edges, cutoff 3", 3.0, h));
        variants.push(edges(&"edges, h 0.5 px", 2.0, 0.5));
        variants.push(edges(&"edges, cutoff 3, h 1 px", 3.0, 1.0));
        variants.push(new("combinations", &"none, affine", Change::Plainest));
    }
    variants.push(new("papers", &"clamp, c 1, h 1.41 px (B05)", Change::Paper(Filter::Clamp)));
    variants.push(new("papers", &"adjust, c 1, h 1.41 px (G06)", Change::Paper(Filter::Adjust)));
    variants.push(new("papers", &"ewa, c 1, h 1.41 px (Z01)", Change::Paper(Filter::Ewa)));
    variants.extend(Preset::ALL.map(|preset| new("preset", &preset.name(), Change::Preset(preset))));
    variants
}

/// Returns the name of a setting's default value, for lists of all its values.
pub(crate) fn default_value(knob: &str) -> &'static str {
    match knob {
        "filter" => "principal",
        "mapping" => "exact",
        "cutoff" => "2",
        "prefilter" => "0.71 px",
        "depth tolerance" => "1 radii",
        "storage" => "32 bits",
        "accumulate" => "f32",
        "edge antialiasing" => "off",
        "clip" => "exact",
        "shader" => "phong",
        "sort" => "center",
        "Gaussian filter" => "clamp",
        "composite" => "over",
        "sheets" => "both sides drawn",
        "level of detail" | "levels of points" => "1 px",
        _ => "the defaults",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_differ_from_the_default_and_from_each_other() {
        let base = Settings::default().with_shader(Shader::Phong);
        let all = all(false);
        assert!(self::all(true).len() < all.len());
        for (i, a) in all.iter().enumerate().skip(1) {
            // Two presets may have equal settings, and disabled clips may equal the default.
            if a.preset().is_none() && a.value != "off" {
                assert!(a.quantised || a.settings(&base) != base, "{} {}", a.knob, a.value);
            }
            assert!(all[..i].iter().all(|b| (b.knob, &b.value) != (a.knob, &a.value)), "{} {}", a.knob, a.value);
        }
    }
}
