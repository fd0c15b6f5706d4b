//! Every per-frame decision, made once: which passes, planes and variants a scene needs, and no others.

use crate::{Capabilities, Feature, Planes, RenderError, View};
use surfel_math::depth::Tolerance;
use surfel_model::{
    Accumulate, ClipPolicy, DepthTolerance, Filter, Geometry, Light, Mapping, Scene, Settings, Shader, Transparency,
};

/// What planning needs to know of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneSummary {
    /// Number of splats.
    pub splats: u64,
    /// Some cloud has colours.
    pub colors: bool,
    /// Some splat has an alpha below 1.
    pub transparent: bool,
    /// Some cloud has clip curves or lines.
    pub clips: bool,
    /// Some object is drawn as polygons.
    pub meshes: bool,
    /// Objects differ in ambient, diffuse, specular or shininess.
    pub materials_differ: bool,
    /// Some light casts a shadow.
    pub shadows: bool,
    /// First object of splats whose interior weight is unknown.
    pub without_interior_weight: Option<usize>,
}

impl SceneSummary {
    /// Summarises a scene.
    pub fn of(scene: &Scene) -> Self {
        let mut summary = Self { shadows: scene.lights.iter().flatten().any(Light::casts_shadow), ..Self::default() };
        let mut first_factors = None;
        for (i, object) in scene.objects.iter().enumerate() {
            match &object.geometry {
                Geometry::Splats(cloud) => {
                    let data = cloud.data();
                    summary.splats += cloud.len() as u64;
                    summary.colors |= data.colors.is_some();
                    summary.transparent |= cloud.is_transparent();
                    summary.clips |= data.clips.is_some();
                    if object.material.interior_weight.or(data.interior_weight).is_none() {
                        summary.without_interior_weight.get_or_insert(i);
                    }
                }
                Geometry::Mesh(_) => summary.meshes = true,
            }
            let factors = object.material.factors();
            summary.materials_differ |= *first_factors.get_or_insert(factors) != factors;
        }
        summary
    }
}

/// How splats are filtered and mapped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatFilter {
    /// The filter; [`Filter::None`] also when the radius is 0.
    pub filter: Filter,
    /// h, pixels; 0 for no filter.
    pub radius_px: f64,
    /// Kernel cutoff c.
    pub cutoff: f64,
    /// Footprints are projective: exact mapping in a perspective projection. Else they are affine.
    pub projective: bool,
    /// Splats whose centre is nearer than z_near are left out (affine mapping).
    pub drop_before_near: bool,
    /// Visibility tolerance.
    pub tolerance: Tolerance,
}

/// What is accumulated for each pixel besides Σw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attributes {
    /// Albedo.
    pub color: bool,
    /// Shading normal.
    pub normal: bool,
    /// Depth.
    pub depth: bool,
    /// Ambient, diffuse, specular, shininess.
    pub material: bool,
    /// Coverage q.
    pub coverage: bool,
}

/// A step of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// Nearest depth plus tolerance of every pixel.
    Visibility,
    /// Weighted sums of attributes.
    Attributes,
    /// Once a pixel: divide and light.
    Shade,
    /// What lies behind edge pixels, and its blend by coverage.
    EdgeAntialiasing,
}

/// What a backend does for one frame. Plain data, no GPU types.
#[derive(Clone, Debug, PartialEq)]
pub struct FramePlan {
    /// Steps in order.
    pub passes: Vec<Pass>,
    /// Filter and mapping.
    pub splat_filter: SplatFilter,
    /// How clips are evaluated; [`ClipPolicy::Off`] also where the scene has none.
    pub clip: ClipPolicy,
    /// What is accumulated.
    pub attributes: Attributes,
    /// How pixels are shaded.
    pub shader: Shader,
    /// Planes of the frame.
    pub planes: Planes,
}

impl FramePlan {
    /// True if the plan has this pass.
    pub fn has(&self, pass: Pass) -> bool {
        self.passes.contains(&pass)
    }
}

/// Decides a frame.
///
/// # Errors
/// [`RenderError`] for settings out of range, and for what the scene or the settings need and this version doesn't
/// draw yet: it is refused rather than drawn wrong.
pub fn plan(
    summary: &SceneSummary,
    view: &View,
    settings: &Settings,
    planes: Planes,
    capabilities: &Capabilities,
) -> Result<FramePlan, RenderError> {
    settings.validate()?;
    if let Some(error) = unsupported(summary, settings, planes, capabilities) {
        return Err(error);
    }
    if settings.edge_aa
        && let Some(object) = summary.without_interior_weight
    {
        return Err(RenderError::NoInteriorWeight { object });
    }
    let radius_px = if settings.filter == Filter::None { 0.0 } else { settings.prefilter_radius_px };
    let exact = settings.mapping == Mapping::Exact;
    let lit = settings.shader == Shader::Phong;
    let needs_color = planes.color && matches!(settings.shader, Shader::Unlit | Shader::Phong);
    let depth_shader = planes.color && settings.shader == Shader::Depth;
    let normal_shader = planes.color && settings.shader == Shader::Normal;
    let mut passes = vec![Pass::Visibility, Pass::Attributes, Pass::Shade];
    if settings.edge_aa && planes.color {
        passes.push(Pass::EdgeAntialiasing);
    }
    Ok(FramePlan {
        splat_filter: SplatFilter {
            filter: if radius_px == 0.0 { Filter::None } else { settings.filter },
            radius_px,
            cutoff: settings.cutoff,
            projective: exact && view.projection.is_perspective(),
            drop_before_near: !exact,
            tolerance: match settings.depth_tolerance {
                DepthTolerance::Relative(k) => Tolerance::Relative(k),
                DepthTolerance::Absolute(d) => Tolerance::Absolute(d),
            },
        },
        clip: if summary.clips { settings.clip } else { ClipPolicy::Off },
        attributes: Attributes {
            color: needs_color && summary.colors,
            normal: planes.normal || normal_shader || (planes.color && lit),
            depth: planes.depth || depth_shader || (planes.color && lit),
            material: planes.color && lit && summary.materials_differ,
            coverage: settings.edge_aa && planes.color,
        },
        passes,
        shader: settings.shader,
        planes,
    })
}

/// What a scene and its settings need and a backend doesn't draw: the first of it, as an error that says where it is and
/// what to do; `None` if the backend draws everything.
pub fn unsupported(
    summary: &SceneSummary,
    settings: &Settings,
    planes: Planes,
    capabilities: &Capabilities,
) -> Option<RenderError> {
    let transparent = summary.transparent.then_some(settings.transparency);
    let needs = [
        (Feature::Meshes, summary.meshes),
        (Feature::Clips, summary.clips && settings.clip != ClipPolicy::Off),
        (Feature::Peel, matches!(transparent, Some(Transparency::Peel { .. }))),
        (Feature::ABuffer, matches!(transparent, Some(Transparency::ABuffer { .. }))),
        (Feature::Shadows, summary.shadows),
        (Feature::Toon, settings.shader == Shader::Toon),
        (Feature::F16, settings.accumulate == Accumulate::F16),
        (Feature::EdgeAntialiasing, settings.edge_aa),
        (Feature::Margin, planes.margin),
    ];
    let (missing, _) = needs.into_iter().find(|(feature, needed)| *needed && !capabilities.has(*feature))?;
    let (feature, found_where, advice) = describe(missing);
    let found_where = found_where.to_owned();
    Some(RenderError::Unsupported { backend: capabilities.backend, feature, found_where, advice })
}

/// A feature's name in a message, where it comes from, and what to do without it.
fn describe(feature: Feature) -> (&'static str, &'static str, &'static str) {
    let setting = "is asked for by the settings";
    match feature {
        Feature::Meshes => (
            "a polygon mesh among splats",
            "is in the scene (an object with \"mesh\")",
            "give it as \"splats\" to have it converted",
        ),
        Feature::Clips => {
            ("clipping of splats", "is in the scene (clip properties)", "--clip off draws the whole splats")
        }
        Feature::Peel => ("depth-peeled transparency", setting, "--transparency off draws every splat opaque"),
        Feature::ABuffer => ("A-buffer transparency", setting, "--transparency off draws every splat opaque"),
        Feature::Shadows => ("a shadow", "is in the scene (a light with \"shadow\": true)", "set \"shadow\": false"),
        Feature::Toon => ("shader 'toon'", setting, "choose unlit, phong, normal or depth"),
        Feature::F16 => ("f16 accumulation", setting, "choose --accumulate f32"),
        Feature::EdgeAntialiasing => ("edge antialiasing", setting, "choose --backend reference or --edge-aa=off"),
        Feature::Margin => ("the decision margin plane", setting, "choose --backend reference"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{Camera, Projection};

    const ALL: Capabilities = Capabilities { backend: "test", features: &[Feature::EdgeAntialiasing] };

    fn view() -> View {
        View::new(&Camera {
            eye: [0.0, 0.0, 5.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            projection: Projection::Perspective { fov_y_deg: 45.0 },
            near: 0.1,
            far: None,
            size: [8, 8],
        })
        .unwrap()
    }

    fn planned(summary: &SceneSummary, change: impl FnOnce(&mut Settings), planes: Planes) -> FramePlan {
        let mut settings = Settings::default();
        change(&mut settings);
        plan(summary, &view(), &settings, planes, &ALL).unwrap()
    }

    #[test]
    fn an_unlit_white_cloud_accumulates_nothing_but_weight() {
        let plan = planned(&SceneSummary::default(), |_| (), Planes::COLOR);
        let none = Attributes { color: false, normal: false, depth: false, material: false, coverage: false };
        assert_eq!(plan.attributes, none);
        assert_eq!(plan.passes, [Pass::Visibility, Pass::Attributes, Pass::Shade]);
    }

    #[test]
    fn each_feature_adds_its_own_attribute_and_no_other() {
        let colored = SceneSummary { colors: true, ..SceneSummary::default() };
        assert!(planned(&colored, |_| (), Planes::COLOR).attributes.color);
        assert!(!planned(&colored, |s| s.shader = Shader::Normal, Planes::COLOR).attributes.color);
        let phong = planned(&colored, |s| s.shader = Shader::Phong, Planes::COLOR).attributes;
        assert!(phong.color && phong.normal && phong.depth && !phong.material && !phong.coverage);
        let differ = SceneSummary { materials_differ: true, ..colored };
        assert!(planned(&differ, |s| s.shader = Shader::Phong, Planes::COLOR).attributes.material);
        assert!(!planned(&differ, |_| (), Planes::COLOR).attributes.material);
        let edges = planned(&differ, |s| s.edge_aa = true, Planes::COLOR);
        assert!(edges.has(Pass::EdgeAntialiasing) && edges.attributes.coverage);
        assert!(planned(&SceneSummary::default(), |_| (), Planes::ALL).attributes.normal);
    }

    #[test]
    fn a_scene_without_clips_never_clips() {
        let all = Capabilities { backend: "test", features: &[Feature::Clips] };
        let clip_of = |clips, clip| {
            let summary = SceneSummary { clips, ..SceneSummary::default() };
            plan(&summary, &view(), &Settings { clip, ..Settings::default() }, Planes::COLOR, &all).unwrap().clip
        };
        assert_eq!(clip_of(false, ClipPolicy::Exact), ClipPolicy::Off);
        assert_eq!(clip_of(true, ClipPolicy::Line), ClipPolicy::Line);
        assert_eq!(clip_of(true, ClipPolicy::Off), ClipPolicy::Off);
    }

    #[test]
    fn what_is_not_drawn_is_refused() {
        let refused = |summary: SceneSummary, change: fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            matches!(plan(&summary, &view(), &settings, Planes::COLOR, &ALL), Err(RenderError::Unsupported { .. }))
        };
        let s = SceneSummary::default;
        assert!(refused(SceneSummary { meshes: true, ..s() }, |_| ()));
        assert!(refused(SceneSummary { clips: true, ..s() }, |_| ()));
        assert!(!refused(SceneSummary { clips: true, ..s() }, |s| s.clip = ClipPolicy::Off));
        let peel = |s: &mut Settings| s.transparency = Transparency::Peel { layers: 2, drop_last: false };
        assert!(refused(SceneSummary { transparent: true, ..s() }, peel));
        assert!(!refused(SceneSummary { transparent: true, ..s() }, |_| ()));
        assert!(!refused(s(), peel));
        assert!(refused(SceneSummary { shadows: true, ..s() }, |_| ()));
        assert!(refused(s(), |s| s.shader = Shader::Toon));
        assert!(refused(s(), |s| s.accumulate = Accumulate::F16));
    }

    #[test]
    fn edge_antialiasing_without_an_interior_weight_says_which_object() {
        let summary = SceneSummary { without_interior_weight: Some(3), ..SceneSummary::default() };
        let settings = Settings { edge_aa: true, ..Settings::default() };
        let error = plan(&summary, &view(), &settings, Planes::COLOR, &ALL).unwrap_err();
        assert!(matches!(error, RenderError::NoInteriorWeight { object: 3 }));
    }

    #[test]
    fn a_prefilter_radius_of_zero_is_no_filter() {
        let plan = planned(&SceneSummary::default(), |s| s.prefilter_radius_px = 0.0, Planes::COLOR);
        assert_eq!(plan.splat_filter.filter, Filter::None);
    }
}
