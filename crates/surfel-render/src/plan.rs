//! Planning of a frame: decides once which passes, attributes and planes a scene needs, and no others.

use crate::needs::ShaderNeeds;
use crate::{
    BallPixel, Capabilities, Feature, GaussianColors, Planes, RenderError, SceneOctree, SceneSummary, Selection,
    ShadowMap, View, select,
};
use surfel_math::depth::Tolerance;
use surfel_math::eye_dome;
use surfel_model::{
    Accumulate, ClipPolicy, DepthTolerance, EdgeAa, Filter, Mapping, ModelError, Settings, Shader, Sort, Transparency,
};

/// Number of samples along a pixel's side if edges are antialiased by samples (rendering model §5): four by four.
pub const SAMPLES_SIDE: u32 = 4;

/// Parameters by which splats are drawn: screen-space filter, mapping, kernel and depth tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatFilter {
    /// Screen-space filter, which widens splats smaller than a pixel; [`Filter::None`] also if the filter radius is 0.
    pub filter: Filter,
    /// Smallest half-width h of a filtered splat, in pixels; 0 without a filter.
    pub radius_px: f64,
    /// Cutoff c of the kernel exp(−c·ρ²).
    pub cutoff: f64,
    /// True if footprints are projective, as by the exact mapping in a perspective projection; false if they are
    /// affine.
    pub projective: bool,
    /// True if splats with a centre nearer than z_near are dropped, as under the affine mapping.
    pub drop_before_near: bool,
    /// Depth tolerance: how far behind the nearest surface fragments are blended with it.
    pub tolerance: Tolerance,
}

impl SplatFilter {
    /// Returns the largest distance, in pixels, from a splat to a pixel that its filtered footprint touches, measured
    /// to the pixel's near side. The footprint must contain the pixel's centre, which is half a pixel farther. A margin
    /// for rounding in f32 is included.
    ///
    /// `clamp` and `ewa` extend a splat by at most h. `principal` lengthens an axis to h at the splat's centre, and a
    /// slope of up to 1/4 makes it appear longer by up to 1/√(1 − 1/16). `adjust` lengthens two axes independently. If
    /// they appear nearly parallel, the ellipse extends √2 times as far.
    pub fn reach_px(&self) -> f64 {
        let lengthened = match self.filter {
            Filter::None | Filter::Clamp | Filter::Ewa => 1.0,
            Filter::Principal => 1.04,
            // The largest value is safe for any other filter.
            _ => 1.5,
        };
        // A quarter of a pixel is many times the rounding of pixel coordinates in the widest image.
        (lengthened * self.radius_px - 0.5 + 0.25).max(0.0)
    }
}

/// Attributes of splats that are accumulated per pixel, weighted by the kernel's value w, in addition to the sum of
/// weights Σw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    /// True to accumulate the albedo.
    pub color: bool,
    /// True to accumulate the shading normal.
    pub normal: bool,
    /// True to accumulate the depth.
    pub depth: bool,
    /// True to accumulate the material factors: ambient, diffuse, specular, shininess.
    pub material: bool,
    /// True to accumulate the coverage q: the fraction of the pixel that the splats cover.
    pub coverage: bool,
    /// True to accumulate the opacity, alpha, of transparent splats.
    pub alpha: bool,
}

impl Attributes {
    /// Returns the number of sums that are accumulated per pixel, including Σw.
    pub fn sums(&self) -> usize {
        let Self { color, normal, depth, material, coverage, alpha } = *self;
        let wide = [(color, 3), (normal, 3), (depth, 1), (material, 4), (coverage, 1), (alpha, 1)];
        1 + wide.iter().filter(|(is_summed, _)| *is_summed).map(|(_, numbers)| numbers).sum::<usize>()
    }
}

/// Pass of a frame: a step by which a backend draws it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// Draws visibility from a light into one of the plan's shadow maps (rendering model §5).
    ShadowMap,
    /// Draws the nearest polygon of every pixel that no splat hides, into a target of its own (rendering model §6).
    Polygons,
    /// Computes the depth threshold of every pixel: the smallest z + ε of its splats, where ε is the depth tolerance.
    Visibility,
    /// Accumulates weighted sums of the attributes of splats in front of the depth threshold.
    Attributes,
    /// Divides the sums by Σw and lights the result, once per pixel.
    Shade,
    /// Draws the surface behind each edge pixel, and blends the edge pixel over it by coverage.
    EdgeAntialiasing,
    /// Finds the nearest splat of every pixel, for the planes `index` and `label`.
    Nearest,
    /// Draws pixels at depth steps again, each as the mean of 4×4 samples (rendering model §5).
    EdgeSamples,
    /// Draws the lines of the shader `toon` (rendering model §5) in pixels whose neighbour is much deeper.
    Outlines,
    /// Darkens pixels that are deeper than their neighbours, for the shader `edl` (rendering model §5).
    EyeDome,
    /// Composites balls and dots with the other surfaces of a pixel, by depth (rendering model §11).
    Balls,
    /// Draws one layer of transparent splats: visibility behind the previous layer, attributes, shading (rendering
    /// model §8).
    PeelLayer,
    /// Blends all transparent fragments behind the previous layers, lit per splat, into one layer (rendering model §8).
    RemainingLayer,
    /// Gathers transparent fragments into surfaces, pixel by pixel (rendering model §8).
    ABuffer,
    /// Draws trained Gaussians one over another: the whole image (docs/gaussians.md).
    Gaussians,
}

/// Selected parts of an octree, and the object that draws it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SelectedParts {
    /// Index in the scene of the object that draws the octree.
    pub object: usize,
    /// Selected splats and triangles.
    pub selection: Selection,
}

impl SelectedParts {
    /// Returns the selection for the object with this index, if the object is one of the octrees.
    pub fn of(octrees: &[Self], object: usize) -> Option<&Selection> {
        octrees.iter().find(|parts| parts.object == object).map(|parts| &parts.selection)
    }
}

/// Instructions for a backend to draw one frame. Plain data, without GPU types.
#[derive(Clone, Debug, PartialEq)]
pub struct FramePlan {
    /// Passes of the frame, in order.
    pub passes: Vec<Pass>,
    /// Filter, mapping, kernel and depth tolerance of splats.
    pub splat_filter: SplatFilter,
    /// Method by which clips are evaluated; [`ClipPolicy::Off`] also if the scene has no clips.
    pub clip: ClipPolicy,
    /// Attributes that are accumulated per pixel.
    pub attributes: Attributes,
    /// Precision of the sums of attributes.
    pub accumulate: Accumulate,
    /// True if splats with an alpha below 1 are excluded from the opaque passes. Passes for transparent layers draw
    /// them instead, if the plan has any.
    pub separates_transparent: bool,
    /// True if front- and back-facing splats of oriented clouds are blended separately (rendering model §5).
    pub keeps_facings: bool,
    /// Shadow maps to draw, in the order of their lights.
    pub shadow_maps: Vec<ShadowMap>,
    /// Selected parts of each octree, in the order of the scene's objects.
    pub octrees: Vec<SelectedParts>,
    /// Number of splats in the scene's clouds, including balls, and of splats selected from octrees.
    pub splats: u64,
    /// True if balls are blended by their alphas; false if there are none, or if transparency is off and balls are
    /// drawn as opaque.
    pub ball_alphas: bool,
    /// Side of an image pixel in world units, by which balls whose radii are in pixels are drawn; `None` if the scene
    /// has none.
    pub ball_pixel: Option<BallPixel>,
    /// Maximum number of surfaces that [`Pass::ABuffer`] stores per pixel; 0 without that pass.
    pub abuffer_surfaces: u32,
    /// Shader that computes the colours of pixels.
    pub shader: Shader,
    /// Order in which [`Pass::Gaussians`] blends Gaussians.
    pub sort: Sort,
    /// Planes that the drawn frame has.
    pub planes: Planes,
}

impl FramePlan {
    /// True if the plan has this pass.
    pub fn has(&self, pass: Pass) -> bool {
        self.passes.contains(&pass)
    }

    /// Returns the largest distance, in pixels along each axis, at which a pass reads a pixel's neighbours.
    pub fn reach_px(&self) -> u32 {
        let reach = |pass: &Pass| match pass {
            Pass::EdgeAntialiasing | Pass::EdgeSamples | Pass::Outlines => 1,
            Pass::EyeDome => eye_dome::REACH_PX.unsigned_abs(),
            _ => 0,
        };
        self.passes.iter().map(reach).max().unwrap_or(0)
    }

    /// Returns the plan for drawing the samples of this plan's edge pixels. The samples are the pixels of
    /// [`View::of_samples`].
    #[must_use]
    pub fn of_samples(&self) -> Self {
        let mut plan = self.clone();
        plan.passes.retain(|pass| !matches!(pass, Pass::EdgeSamples | Pass::Outlines | Pass::EyeDome | Pass::Nearest));
        plan.planes = Planes::COLOR.with_margin(self.planes.margin);
        plan
    }

    /// Returns the selected parts of an object, by its index, if it is an octree; other objects are drawn completely.
    pub fn selection_of(&self, object: usize) -> Option<&Selection> {
        SelectedParts::of(&self.octrees, object)
    }

    /// Returns the number of peeled layers of transparent splats, without the remaining layer.
    pub fn peeled_layers(&self) -> usize {
        self.passes.iter().filter(|pass| **pass == Pass::PeelLayer).count()
    }
}

/// Plans a frame.
///
/// # Errors
/// - [`RenderError::Model`] for settings out of range, for Gaussians of different colour spaces or together with
///   surfaces, and for planes that the kind of scene doesn't have;
/// - [`RenderError::Unsupported`] for features that the backend doesn't support: they are rejected rather than drawn
///   incorrectly;
/// - [`RenderError::NoInteriorWeight`] and [`RenderError::NoRows`] for objects without the data that the settings or
///   planes need.
pub fn plan(
    summary: &SceneSummary,
    view: &View,
    settings: &Settings,
    planes: Planes,
    capabilities: &Capabilities,
) -> Result<FramePlan, RenderError> {
    settings.validate()?;
    let planes = planes.complete();
    let parts = |o: &SceneOctree| SelectedParts {
        object: o.object,
        selection: select(&o.octree, &o.world_from_object, o.cull, view, settings.lod_error_px),
    };
    let octrees: Vec<SelectedParts> = summary.octrees.iter().map(parts).collect();
    // Unselected parts need nothing: an octree drawn as splats only has no pass for polygons.
    let chosen = (!octrees.is_empty()).then(|| summary.of_selected(octrees.iter().map(|parts| &parts.selection)));
    let summary = chosen.as_ref().unwrap_or(summary);
    if let Some(error) = unsupported(summary, settings, planes, capabilities) {
        return Err(error);
    }
    if let Some(of_gaussians) = plan_of_gaussians(summary, settings, planes)? {
        return Ok(of_gaussians);
    }
    check_data(summary, settings, planes)?;
    let needs = if planes.color { ShaderNeeds::of(settings.shader) } else { ShaderNeeds::default() };
    let shadows = summary.shadows.as_ref().filter(|_| needs.lights);
    let shadow_maps = shadows.map_or_else(Vec::new, |s| s.maps(settings.cutoff));
    let passes = SurfacePasses::of(summary, settings, planes, &needs, shadow_maps.len());
    Ok(FramePlan {
        splat_filter: splat_filter(view, settings),
        clip: if summary.clips { settings.clip } else { ClipPolicy::Off },
        attributes: attributes(summary, planes, &needs, &passes, !shadow_maps.is_empty()),
        separates_transparent: passes.separates_transparent,
        keeps_facings: summary.both_facings && passes.draw_splats,
        shadow_maps,
        octrees,
        splats: summary.splats + summary.balls,
        ball_alphas: summary.balls > 0 && settings.transparency != Transparency::Off,
        ball_pixel: summary.has_balls_in_pixels.then(|| BallPixel::of(view)),
        abuffer_surfaces: passes.abuffer_surfaces,
        passes: passes.list,
        accumulate: settings.accumulate,
        shader: settings.shader,
        sort: Sort::Center,
        planes,
    })
}

/// Returns an error if an object lacks the interior weight
/// ([`CloudData::interior_weight`](surfel_model::CloudData::interior_weight)) or rows that the settings or planes need.
fn check_data(summary: &SceneSummary, settings: &Settings, planes: Planes) -> Result<(), RenderError> {
    if needs_interior_weight(summary, settings)
        && let Some(object) = summary.without_interior_weight
    {
        return Err(RenderError::NoInteriorWeight { object });
    }
    match summary.without_rows.filter(|_| planes.index) {
        Some(object) => Err(RenderError::NoRows { object }),
        None => Ok(()),
    }
}

/// Passes of a frame of surfaces (not Gaussians), and the decisions from which the passes follow.
struct SurfacePasses {
    /// Passes of the frame, in order.
    list: Vec<Pass>,
    /// True if splats are drawn, also if the scene is empty; false if it has only polygons and balls.
    draw_splats: bool,
    /// Method of edge antialiasing; off without a colour plane, and if only balls are drawn.
    edges: EdgeAa,
    /// True if transparent splats are drawn apart from opaque ones.
    separates_transparent: bool,
    /// Maximum number of surfaces that the A-buffer stores per pixel; 0 without an A-buffer.
    abuffer_surfaces: u32,
}

impl SurfacePasses {
    fn of(
        summary: &SceneSummary,
        settings: &Settings,
        planes: Planes,
        needs: &ShaderNeeds,
        shadow_maps: usize,
    ) -> Self {
        let draw_splats = summary.splats > 0 || !(summary.meshes || summary.balls > 0);
        let mut list = vec![Pass::ShadowMap; shadow_maps];
        list.extend(draw_splats.then_some(Pass::Visibility));
        list.extend(summary.meshes.then_some(Pass::Polygons));
        list.extend(draw_splats.then_some(Pass::Attributes));
        list.push(Pass::Shade);
        // Balls need neither the shader's pass over neighbouring pixels nor edge antialiasing: their shading and their
        // outlines are closed forms.
        let surfaces = draw_splats || summary.meshes;
        list.extend(needs.pass.filter(|_| surfaces));
        let edges = if planes.color && surfaces { settings.edge_aa } else { EdgeAa::Off };
        list.extend((edges == EdgeAa::Coverage).then_some(Pass::EdgeAntialiasing));
        list.extend((summary.balls > 0).then_some(Pass::Balls));
        let transparency = if summary.transparent { settings.transparency } else { Transparency::Off };
        let mut abuffer_surfaces = 0;
        match transparency {
            Transparency::Off => {}
            Transparency::Peel { layers, drop_last } => {
                list.extend((1..layers).map(|_| Pass::PeelLayer));
                list.extend((!drop_last).then_some(Pass::RemainingLayer));
            }
            Transparency::ABuffer { layers } => {
                list.push(Pass::ABuffer);
                abuffer_surfaces = layers;
            }
        }
        list.extend(planes.index.then_some(Pass::Nearest));
        // Edge samples need the whole image's colour, with transparent layers.
        list.extend((edges == EdgeAa::Samples).then_some(Pass::EdgeSamples));
        let separates_transparent = transparency != Transparency::Off;
        Self { list, draw_splats, edges, separates_transparent, abuffer_surfaces }
    }
}

/// Returns the parameters by which a view's splats are drawn under these settings.
fn splat_filter(view: &View, settings: &Settings) -> SplatFilter {
    let radius_px = if settings.filter == Filter::None { 0.0 } else { settings.prefilter_radius_px };
    let exact = settings.mapping == Mapping::Exact;
    SplatFilter {
        filter: if radius_px == 0.0 { Filter::None } else { settings.filter },
        radius_px,
        cutoff: settings.cutoff,
        projective: exact && view.projection.is_perspective(),
        drop_before_near: !exact,
        tolerance: match settings.depth_tolerance {
            DepthTolerance::Relative(k) => Tolerance::Relative(k),
            DepthTolerance::Absolute(d) => Tolerance::Absolute(d),
        },
    }
}

/// Returns the attributes to accumulate for the requested planes, the shader and the passes.
fn attributes(
    summary: &SceneSummary,
    planes: Planes,
    needs: &ShaderNeeds,
    passes: &SurfacePasses,
    has_shadow_maps: bool,
) -> Attributes {
    let &SurfacePasses { draw_splats, edges, separates_transparent, abuffer_surfaces, .. } = passes;
    // The direction of a local light and every shadow depend on the position. Behind an edge, depth decides between
    // splats and polygons.
    let light_needs_depth = needs.lights && (summary.has_local_lights || has_shadow_maps);
    let edges_need_depth = edges == EdgeAa::Coverage && summary.meshes && draw_splats;
    Attributes {
        color: needs.albedo && summary.colors,
        normal: planes.normal || needs.normal,
        depth: planes.depth
            || needs.depth
            || light_needs_depth
            || edges_need_depth
            || separates_transparent
            || summary.balls > 0,
        material: needs.lights && summary.materials_differ,
        coverage: edges == EdgeAa::Coverage || abuffer_surfaces > 0 || (summary.meshes && draw_splats),
        alpha: separates_transparent,
    }
}

/// Plans a scene of Gaussians, which ignores all settings of surfaces; `None` if the scene has no Gaussians. Returns an
/// error if a requested plane doesn't fit the kind of scene, or if Gaussians can't be blended with the scene's other
/// objects.
fn plan_of_gaussians(
    summary: &SceneSummary,
    settings: &Settings,
    planes: Planes,
) -> Result<Option<FramePlan>, RenderError> {
    let conflict = |what: &str| Err(RenderError::Model(ModelError::Conflict(what.to_owned())));
    if summary.gaussians.is_none() {
        return match planes.alpha || planes.median_depth || planes.distortion {
            true => conflict(
                "the planes alpha, median_depth and distortion are of Gaussians, and the scene shows surfaces: leave \
                 them out, or draw a file of Gaussians with `composite=over`",
            ),
            false => Ok(None),
        };
    }
    if summary.surfaces {
        return conflict(
            "the scene has Gaussians and surfaces, expected one or the other: `composite=surface` draws Gaussians as \
             surfaces, too",
        );
    }
    if summary.gaussians == Some(GaussianColors::Mixed) {
        return conflict(
            "the scene has Gaussians of linear colours and of displayed ones, expected one kind: they blend with each \
             other; `composite=surface` draws both",
        );
    }
    if planes.index {
        return conflict(
            "the planes index, object and label are of surfaces, and Gaussians are drawn over one another: leave them \
             out, or `composite=surface`",
        );
    }
    Ok(Some(FramePlan {
        passes: vec![Pass::Gaussians],
        splat_filter: SplatFilter {
            filter: settings.gaussian_filter,
            radius_px: if settings.gaussian_filter == Filter::Principal { settings.prefilter_radius_px } else { 0.0 },
            cutoff: settings.cutoff,
            projective: false,
            drop_before_near: false,
            tolerance: Tolerance::Absolute(0.0),
        },
        clip: ClipPolicy::Off,
        attributes: Attributes::default(),
        accumulate: Accumulate::F32,
        separates_transparent: false,
        keeps_facings: false,
        shadow_maps: Vec::new(),
        octrees: Vec::new(),
        splats: summary.splats,
        ball_alphas: false,
        ball_pixel: None,
        abuffer_surfaces: 0,
        shader: Shader::Unlit,
        sort: settings.sort,
        planes,
    }))
}

/// True if the image needs the clouds' interior weights
/// ([`CloudData::interior_weight`](surfel_model::CloudData::interior_weight); rendering model §5, coverage). Loaders
/// estimate the weights in that case.
pub fn needs_interior_weight(summary: &SceneSummary, settings: &Settings) -> bool {
    let abuffer = matches!(settings.transparency, Transparency::ABuffer { .. });
    let coverage = settings.edge_aa == EdgeAa::Coverage;
    coverage || (abuffer && summary.transparent) || (summary.may_have_polygons() && summary.splats > 0)
}

/// Returns an error for the first feature that a scene and its settings need and a backend doesn't support. The error
/// states the feature's origin and advice. `None` if the backend supports everything.
pub fn unsupported(
    summary: &SceneSummary,
    settings: &Settings,
    planes: Planes,
    capabilities: &Capabilities,
) -> Option<RenderError> {
    let transparent = summary.transparent.then_some(settings.transparency);
    let shader = ShaderNeeds::of(settings.shader);
    let lit = shader.lights && planes.color;
    // Settings of surfaces don't matter for Gaussians.
    let of_surfaces = summary.gaussians.is_none();
    let needs = [
        (Feature::Meshes, summary.may_have_polygons()),
        (Feature::Clips, summary.clips && settings.clip != ClipPolicy::Off),
        (Feature::Peel, matches!(transparent, Some(Transparency::Peel { .. }))),
        (Feature::ABuffer, matches!(transparent, Some(Transparency::ABuffer { .. }))),
        (Feature::Shadows, summary.shadows.is_some() && lit),
        (Feature::EdgeAntialiasing, settings.edge_aa == EdgeAa::Coverage && of_surfaces),
        (Feature::EdgeSamples, settings.edge_aa == EdgeAa::Samples && planes.color && of_surfaces),
        (Feature::Gaussians, !of_surfaces),
        (Feature::Balls, summary.balls > 0),
        (Feature::Sky, summary.has_sky),
        (Feature::Margin, planes.margin),
    ];
    let of_shader = shader.feature.filter(|_| of_surfaces).map(|feature| (feature, true));
    let mut needs = needs.into_iter().chain(of_shader);
    let (missing, _) = needs.find(|(feature, needed)| *needed && !capabilities.has(*feature))?;
    let (feature, found_where, advice) = describe(missing);
    let found_where = found_where.to_owned();
    Some(RenderError::Unsupported { backend: capabilities.backend, feature, found_where, advice })
}

/// Advice in [`RenderError::Unsupported`]: choose a shader that every backend draws.
const OTHER_SHADERS: &str = "choose unlit, phong, normal or depth";

/// Returns the parts of an error message about a feature: its name, its origin in scene or settings, and advice for
/// drawing without the feature.
fn describe(feature: Feature) -> (&'static str, &'static str, &'static str) {
    let setting = "is asked for by the settings";
    match feature {
        Feature::Meshes => (
            "a polygon mesh among splats",
            "is in the scene (an object with \"mesh\")",
            "give it as \"splats\" to have it converted",
        ),
        Feature::Clips => {
            ("clipping of splats", "is in the scene (clip properties)", "`clip=off` draws the whole splats")
        }
        Feature::Peel => ("depth-peeled transparency", setting, "`transparency=off` draws every splat opaque"),
        Feature::ABuffer => ("A-buffer transparency", setting, "choose `backend=cpu`, or `transparency=peel:4`"),
        Feature::Shadows => ("a shadow", "is in the scene (a light with \"shadow\": true)", "set \"shadow\": false"),
        Feature::Toon => ("shader 'toon'", setting, OTHER_SHADERS),
        Feature::Matcap => ("shader 'matcap'", setting, OTHER_SHADERS),
        Feature::EyeDome => ("shader 'edl'", setting, OTHER_SHADERS),
        Feature::EdgeAntialiasing => ("edge antialiasing", setting, "choose `backend=cpu`, or `edge_aa=off`"),
        Feature::EdgeSamples => {
            ("edges by samples", setting, "choose `backend=cpu`, or edges by coverage or none (`edge_aa=on`, off)")
        }
        Feature::Gaussians => (
            "Gaussians drawn one over another",
            "are in the scene (\"composite\": \"over\")",
            "choose `backend=cpu`, or `composite=surface`",
        ),
        Feature::Balls => (
            "a ball or dot",
            "is in the scene (\"points_as\")",
            "choose `backend=cpu`, or `points_as=surface` or disks",
        ),
        Feature::Sky => ("a sky", "is in the scene", "store its light first (surfel_light::light_scene)"),
        Feature::Margin => ("the decision margin plane", setting, "choose `backend=reference`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ShadowScene;
    use glam::DVec3;
    use surfel_model::{Camera, Light, Projection};

    const ALL: Capabilities = Capabilities::everything("test");

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
        assert_eq!((plan.attributes, plan.attributes.sums()), (Attributes::default(), 1));
        assert_eq!(plan.passes, [Pass::Visibility, Pass::Attributes, Pass::Shade]);
    }

    #[test]
    fn each_feature_adds_its_own_attribute_and_no_other() {
        let colored = SceneSummary { colors: true, ..SceneSummary::default() };
        assert!(planned(&colored, |_| (), Planes::COLOR).attributes.color);
        assert!(!planned(&colored, |s| s.shader = Shader::Normal, Planes::COLOR).attributes.color);
        let phong = planned(&colored, |s| s.shader = Shader::Phong, Planes::COLOR).attributes;
        assert!(phong.color && phong.normal && !phong.depth && !phong.material && !phong.coverage);
        let nearby = SceneSummary { has_local_lights: true, ..colored.clone() };
        assert!(planned(&nearby, |s| s.shader = Shader::Phong, Planes::COLOR).attributes.depth);
        assert!(!planned(&nearby, |_| (), Planes::COLOR).attributes.depth);
        let differ = SceneSummary { materials_differ: true, ..colored };
        assert!(planned(&differ, |s| s.shader = Shader::Phong, Planes::COLOR).attributes.material);
        assert!(!planned(&differ, |_| (), Planes::COLOR).attributes.material);
        let edges = planned(&differ, |s| s.edge_aa = EdgeAa::Coverage, Planes::COLOR);
        assert!(edges.has(Pass::EdgeAntialiasing) && edges.attributes.coverage);
        let samples = planned(&differ, |s| s.edge_aa = EdgeAa::Samples, Planes::COLOR);
        assert_eq!(samples.attributes, planned(&differ, |_| (), Planes::COLOR).attributes);
        assert_eq!((samples.passes[3..].to_vec(), samples.reach_px()), (vec![Pass::EdgeSamples], 1));
        let colorless = planned(&differ, |s| s.edge_aa = EdgeAa::Samples, Planes::ALL.with_color(false));
        assert!(!colorless.has(Pass::EdgeSamples));
        assert!(planned(&SceneSummary::default(), |_| (), Planes::ALL).attributes.normal);
    }

    #[test]
    fn transparent_splats_get_the_layers_that_are_asked_for_and_opaque_scenes_none() {
        let planned = |transparent, transparency: &str| {
            let summary = SceneSummary { transparent, ..SceneSummary::default() };
            let settings = Settings::default().with_transparency(transparency.parse().unwrap());
            plan(&summary, &view(), &settings, Planes::COLOR, &ALL).unwrap()
        };
        let opaque = planned(false, "off");
        for setting in ["peel:4", "peel:4:drop", "abuffer:3"] {
            assert_eq!(planned(false, setting), opaque, "{setting}");
        }
        assert_eq!(planned(true, "off"), opaque);
        let peeled = planned(true, "peel:3");
        assert_eq!(peeled.passes[3..], [Pass::PeelLayer, Pass::PeelLayer, Pass::RemainingLayer]);
        assert!(peeled.separates_transparent && peeled.attributes.alpha && !peeled.attributes.coverage);
        assert_eq!(planned(true, "peel:3:drop").passes[3..], [Pass::PeelLayer, Pass::PeelLayer]);
        let alone = planned(true, "peel:1:drop");
        assert!(alone.separates_transparent && alone.passes.len() == 3);
        let gathered = planned(true, "abuffer:5");
        assert_eq!((gathered.passes[3..].to_vec(), gathered.abuffer_surfaces), (vec![Pass::ABuffer], 5));
        assert!(gathered.attributes.alpha && gathered.attributes.coverage && gathered.peeled_layers() == 0);
    }

    #[test]
    fn polygons_add_a_pass_and_coverage_only_where_there_are_splats_to_blend() {
        let planned = |splats, without_interior_weight| {
            let summary = SceneSummary { meshes: true, splats, without_interior_weight, ..SceneSummary::default() };
            plan(&summary, &view(), &Settings::default(), Planes::COLOR, &ALL)
        };
        let alone = planned(0, None).unwrap();
        assert_eq!(alone.passes, [Pass::Polygons, Pass::Shade]);
        assert!(!alone.attributes.coverage);
        let among = planned(5, None).unwrap();
        assert_eq!(among.passes, [Pass::Visibility, Pass::Polygons, Pass::Attributes, Pass::Shade]);
        assert!(among.attributes.coverage && !among.attributes.depth);
        assert!(matches!(planned(5, Some(1)), Err(RenderError::NoInteriorWeight { object: 1 })));
    }

    fn spot(outer_deg: f64) -> Light {
        let (position, direction) = ([0.0, 3.0, 0.0], [0.0, -1.0, 0.0]);
        Light::Spot { position, direction, color: [1.0; 3], inner_deg: 5.0, outer_deg, shadow: true }
    }

    #[test]
    fn shadows_add_maps_for_lights_that_cast_where_light_matters_and_none_else() {
        let sun = Light::Directional { direction: [1.0, -1.0, 0.0], color: [1.0; 3], shadow: true };
        let lights = vec![(1, sun), (3, spot(20.0)), (4, spot(90.0))];
        let shadows = Some(ShadowScene { lights, center: DVec3::ZERO, radius: 1.0 });
        let summary = SceneSummary { shadows, ..SceneSummary::default() };
        let planned = |shader, planes| {
            let settings = Settings::default().with_shader(shader);
            plan(&summary, &view(), &settings, planes, &ALL).unwrap()
        };
        let lit = planned(Shader::Phong, Planes::COLOR);
        // One map for the sun, one for a spot light, and six for a spot light that is too wide.
        assert_eq!(lit.shadow_maps.iter().map(|m| m.light).collect::<Vec<_>>(), [1, 3, 4, 4, 4, 4, 4, 4]);
        assert_eq!(lit.passes[..8], [Pass::ShadowMap; 8]);
        assert!(lit.attributes.depth);
        assert!(planned(Shader::Toon, Planes::COLOR).has(Pass::ShadowMap));
        assert!(planned(Shader::Unlit, Planes::COLOR).shadow_maps.is_empty());
        assert!(planned(Shader::Phong, Planes::ALL.with_color(false)).shadow_maps.is_empty());
    }

    #[test]
    fn toon_alone_has_outlines() {
        let planned = |shader, planes| {
            let settings = Settings::default().with_shader(shader);
            plan(&SceneSummary::default(), &view(), &settings, planes, &ALL).unwrap()
        };
        let toon = planned(Shader::Toon, Planes::COLOR);
        assert!(toon.has(Pass::Outlines) && toon.attributes.normal && toon.attributes.depth);
        assert!(!planned(Shader::Phong, Planes::COLOR).has(Pass::Outlines));
        assert!(!planned(Shader::Toon, Planes::ALL.with_color(false)).has(Pass::Outlines));
    }

    #[test]
    fn shaders_of_their_own_have_what_they_read_and_no_more() {
        let summary = SceneSummary { colors: true, materials_differ: true, ..SceneSummary::default() };
        let planned = |shader, planes| {
            let settings = Settings::default().with_shader(shader);
            plan(&summary, &view(), &settings, planes, &ALL).unwrap()
        };
        let none = Attributes { color: true, ..Attributes::default() };
        let matcap = planned(Shader::Matcap, Planes::COLOR);
        assert_eq!(matcap.attributes, Attributes { normal: true, ..none });
        assert_eq!((matcap.passes.len(), matcap.reach_px()), (3, 0));
        let edl = planned(Shader::Edl, Planes::COLOR);
        assert_eq!(edl.attributes, Attributes { depth: true, ..none });
        assert_eq!((edl.passes[3..].to_vec(), edl.reach_px()), (vec![Pass::EyeDome], 2));
        assert_eq!(planned(Shader::Edl, Planes::ALL.with_color(false)).passes.len(), 3);
        for shader in Shader::ALL {
            let settings = Settings::default().with_shader(shader);
            let none = Capabilities { lacks: Feature::ALL, ..ALL };
            let refused = plan(&summary, &view(), &settings, Planes::COLOR, &none).is_err();
            assert_eq!(refused, ShaderNeeds::of(shader).feature.is_some(), "{shader:?}");
        }
    }

    #[test]
    fn a_scene_without_clips_never_clips() {
        let clip_of = |clips, clip| {
            let summary = SceneSummary { clips, ..SceneSummary::default() };
            plan(&summary, &view(), &Settings::default().with_clip(clip), Planes::COLOR, &ALL).unwrap().clip
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
            let none = Capabilities { lacks: Feature::ALL, ..ALL };
            matches!(plan(&summary, &view(), &settings, Planes::COLOR, &none), Err(RenderError::Unsupported { .. }))
        };
        let s = SceneSummary::default;
        assert!(refused(SceneSummary { meshes: true, ..s() }, |_| ()));
        assert!(refused(SceneSummary { clips: true, ..s() }, |_| ()));
        assert!(!refused(SceneSummary { clips: true, ..s() }, |s| s.clip = ClipPolicy::Off));
        let peel = |s: &mut Settings| s.transparency = Transparency::Peel { layers: 2, drop_last: false };
        assert!(refused(SceneSummary { transparent: true, ..s() }, peel));
        assert!(!refused(SceneSummary { transparent: true, ..s() }, |_| ()));
        assert!(!refused(s(), peel));
        let shadows = Some(ShadowScene { lights: vec![(0, spot(20.0))], center: DVec3::ZERO, radius: 1.0 });
        assert!(refused(SceneSummary { shadows, ..s() }, |s| s.shader = Shader::Phong));
        assert!(refused(s(), |s| s.shader = Shader::Toon));
        assert!(refused(s(), |s| s.edge_aa = EdgeAa::Coverage));
        assert!(refused(s(), |s| s.edge_aa = EdgeAa::Samples));
        assert!(!refused(s(), |s| s.accumulate = Accumulate::F16));
    }

    #[test]
    fn edge_antialiasing_without_an_interior_weight_says_which_object() {
        let summary = SceneSummary { without_interior_weight: Some(3), ..SceneSummary::default() };
        let settings = Settings::default().with_edge_aa(EdgeAa::Coverage);
        let error = plan(&summary, &view(), &settings, Planes::COLOR, &ALL).unwrap_err();
        assert!(matches!(error, RenderError::NoInteriorWeight { object: 3 }));
        let samples = settings.with_edge_aa(EdgeAa::Samples);
        assert!(plan(&summary, &view(), &samples, Planes::COLOR, &ALL).is_ok(), "samples don't count by coverage");
    }

    #[test]
    fn a_prefilter_radius_of_zero_is_no_filter() {
        let plan = planned(&SceneSummary::default(), |s| s.prefilter_radius_px = 0.0, Planes::COLOR);
        assert_eq!(plan.splat_filter.filter, Filter::None);
    }
}
