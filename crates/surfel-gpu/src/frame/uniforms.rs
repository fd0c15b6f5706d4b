//! Uniforms of a view: the shaders' `Frame`, `Object`s, `Light`s and `ShadowMap`s.

use crate::frame::object_transform::ObjectTransform;
use crate::frame::planes::PlaneLayout;
use crate::passes::pass_list::{has_layers, is_of_shadow_map};
use crate::scene::segment::{UploadedObject, UploadedScene};
use crate::struct_writer::StructWriter;
use glam::{DVec2, DVec3};
use surfel_math::basis::unit;
use surfel_math::depth::Tolerance;
use surfel_math::gaussian;
use surfel_math::kernel::FULL_COVERAGE;
use surfel_math::srgb::limit_light;
use surfel_model::{ClipPolicy, Cull, Filter, Light, Matcap, Shader};
use surfel_render::{FramePlan, GaussianColors, Pass, Region, SHADOW_MAP_SIDE, View};
use surfel_shaders::layout;

/// Number of texels of a shadow map.
pub(crate) const MAP_TEXELS: u32 = SHADOW_MAP_SIDE * SHADOW_MAP_SIDE;

/// Location of a shadow map in the buffer of all maps.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ShadowMapSlot {
    /// Index of the map's first texel.
    pub at: u32,
}

/// Uniform data that all tiles of a frame share.
#[derive(Clone, Debug)]
pub struct FrameScene {
    /// Words of the shaders' `objects`; an object of zeros if there is none.
    pub objects: Vec<u32>,
    /// Words of the shaders' `lights`; a light of zeros if there is none.
    pub lights: Vec<u32>,
    /// Words of the shaders' `shadow_maps`; a map of zeros if there is none.
    pub shadow_maps: Vec<u32>,
    /// Words of the shaders' `matcap`, at least one.
    pub matcap: Vec<u32>,
    /// True if the embedding application supplies a shader function that replaces the shader `phong`.
    has_host_shader: bool,
    /// Number of lights, including the light along the view that a scene without given lights has.
    pub(crate) light_count: u32,
    /// Location of the shadow map that this frame draws; the default value unless the frame is a light's view.
    shadow: ShadowMapSlot,
    /// Transform of each object of splats into the view.
    pub(crate) transforms: Vec<ObjectTransform>,
}

impl FrameScene {
    /// Computes the uniform data of a scene in a view.
    pub fn new(scene: &UploadedScene, view: &View, plan: &FramePlan) -> Self {
        let transforms: Vec<ObjectTransform> =
            scene.objects.iter().map(|o| ObjectTransform::new(&o.world_from_object, view)).collect();
        let mut objects: Vec<u32> =
            scene.objects.iter().zip(&transforms).flat_map(|(o, p)| object_words(o, p, plan)).collect();
        if objects.is_empty() {
            objects = vec![0; layout::object::SIZE / 4];
        }
        let headlight = [Light::Directional { direction: view.forward().to_array(), color: [1.0; 3], shadow: false }];
        let given = scene.lights.as_deref().unwrap_or(&headlight);
        let mut lights: Vec<u32> =
            given.iter().enumerate().flat_map(|(i, light)| light_words(light, (i, given.len()), view, plan)).collect();
        if lights.is_empty() {
            lights = vec![0; layout::light::SIZE / 4];
        }
        let shadow_maps = shadow_map_words(plan, view);
        let (light_count, shadow) = (given.len() as u32, ShadowMapSlot::default());
        let matcap = matcap_words(scene, plan);
        let has_host_shader = false;
        Self { objects, lights, shadow_maps, matcap, has_host_shader, light_count, shadow, transforms }
    }

    /// Returns the data with the shader `phong` replaced by the application's shader function, if `has_host_shader` is
    /// true.
    #[must_use]
    pub fn with_host_shader(self, has_host_shader: bool) -> Self {
        Self { has_host_shader, ..self }
    }

    /// Computes the uniform data of a scene in the view of a light, to draw the shadow map with the location `shadow`.
    pub(crate) fn of_shadow_map(scene: &UploadedScene, view: &View, plan: &FramePlan, shadow: ShadowMapSlot) -> Self {
        Self { shadow, ..Self::new(scene, view, plan) }
    }
}

/// Returns the words of the shaders' `ShadowMap`s of a plan; a map of zeros if there is none.
fn shadow_map_words(plan: &FramePlan, view: &View) -> Vec<u32> {
    use layout::shadow_map as at;
    let mut all = Vec::new();
    for (i, map) in plan.shadow_maps.iter().enumerate() {
        let mut words = StructWriter::new(at::SIZE);
        words.mat3(at::VIEW_FROM_WORLD, map.view.view_from_world).vec3(at::EYE, view.eye - map.view.eye);
        words.u32(at::TEXELS_AT, i as u32 * MAP_TEXELS).projection(at::PROJECTION, &map.view.projection);
        all.extend(words.into_words());
    }
    all.resize(all.len().max(at::SIZE / 4), 0);
    all
}

/// Returns the words of the shaders' `Object`.
fn object_words(object: &UploadedObject, transform: &ObjectTransform, plan: &FramePlan) -> Vec<u32> {
    use layout::object as at;
    let material = &object.material;
    let mut words = StructWriter::new(at::SIZE);
    words
        .mat3(at::LINEAR, transform.linear)
        .mat3(at::NORMALS, transform.normals)
        .f64s(at::MATERIAL, material.factors());
    words.u32(at::CULL_BACK, u32::from(material.cull == Cull::Back && !is_of_shadow_map(plan)));
    words.u32(at::TWO_SIDED, u32::from(material.two_sided)).f64(at::COVERAGE, object.coverage(plan));
    let oriented = object.is_oriented();
    words.u32(at::ORIENTED, u32::from(oriented)).u32(at::KEEPS_FACINGS, u32::from(oriented && plan.keeps_facings));
    words.into_words()
}

/// Returns the words of the shaders' `Light` for the light number `index` of `lights` lights.
fn light_words(light: &Light, (index, lights): (usize, usize), view: &View, plan: &FramePlan) -> Vec<u32> {
    use layout::light as at;
    let mut words = StructWriter::new(at::SIZE);
    let direction = |words: &mut StructWriter, d: &[f64; 3]| {
        words.vec3(at::DIRECTION, unit(DVec3::from(*d)));
    };
    // Positions are relative to the eye, so that they stay precise far from the world's origin.
    let position = |words: &mut StructWriter, p: &[f64; 3]| {
        words.vec3(at::POSITION, DVec3::from(*p) - view.eye);
    };
    let (kind, color) = match light {
        Light::Directional { direction: d, color, .. } => {
            direction(&mut words, d);
            (layout::LIGHT_DIRECTIONAL, color)
        }
        Light::Point { position: p, color } => {
            position(&mut words, p);
            (layout::LIGHT_POINT, color)
        }
        Light::Spot { position: p, direction: d, color, inner_deg, outer_deg, .. } => {
            direction(&mut words, d);
            position(&mut words, p);
            words.f64(at::INNER, inner_deg.to_radians()).f64(at::OUTER, outer_deg.to_radians());
            (layout::LIGHT_SPOT, color)
        }
        // Kinds of lights that are added to the model later give no light here.
        _ => (layout::LIGHT_DIRECTIONAL, &[0.0; 3]),
    };
    let first = plan.shadow_maps.iter().position(|map| map.light == index).unwrap_or(0);
    let count = plan.shadow_maps.iter().filter(|map| map.light == index).count();
    words.u32(at::FIRST_MAP, first as u32).u32(at::MAP_COUNT, count as u32);
    words.u32(at::KIND, kind).vec3(at::COLOR, DVec3::from(limit_light(*color, lights)));
    words.into_words()
}

/// Returns the size and texels of the image that the shader `matcap` samples; a single 0 if the plan has another shader
/// or draws no colours. Without an image of the scene, the built-in one is used.
fn matcap_words(scene: &UploadedScene, plan: &FramePlan) -> Vec<u32> {
    if plan.shader != Shader::Matcap || !plan.planes.color {
        return vec![0];
    }
    let matcap = scene.matcap.clone().unwrap_or_else(Matcap::builtin);
    let texels = matcap.texels().iter().flatten().map(|c| c.to_bits());
    matcap.size().into_iter().chain(texels).collect()
}

/// Image regions of a tile, in pixels.
pub(crate) struct TileRegions {
    /// Region of the pixels that are shaded.
    pub tile: Region,
    /// Region that the tile's textures (targets) cover; it may have a border around `tile`.
    pub targets: Region,
}

/// Returns the words of the shaders' `Frame` for a tile. Numbers that are found later stay 0, such as the unit of
/// depths and the numbers of the compute path.
pub(crate) fn frame_words(
    scene: &UploadedScene,
    frame: &FrameScene,
    view: &View,
    plan: &FramePlan,
    &TileRegions { tile, targets }: &TileRegions,
    planes: &PlaneLayout,
) -> Vec<u32> {
    use layout::{frame as at, tolerance as tol};
    let mut words = StructWriter::new(at::SIZE);
    let p = &view.projection;
    let (focal, principal) = (DVec2::from(p.focal_px), DVec2::from(p.principal_px));
    words.projection(at::PROJECTION, p);
    let filter = &plan.splat_filter;
    let (tolerance_kind, tolerance) = match filter.tolerance {
        Tolerance::Relative(k) => (layout::TOLERANCE_RELATIVE, k),
        Tolerance::Absolute(d) => (layout::TOLERANCE_ABSOLUTE, d),
    };
    words.u32(at::TOLERANCE + tol::KIND, tolerance_kind).f64(at::TOLERANCE + tol::VALUE, tolerance);
    words.f64(at::RADIUS_PX, filter.radius_px).f64(at::CUTOFF, filter.cutoff);
    words.u32(at::PROJECTIVE, u32::from(filter.projective)).u32(at::FILTER_KIND, filter_kind(filter.filter));
    words.mat3(at::VIEW_FROM_WORLD, view.view_from_world);
    words.mat3(at::WORLD_FROM_VIEW, view.view_from_world.transpose());
    words.i32x2(at::ORIGIN_PX, [targets.x.cast_signed(), targets.y.cast_signed()]);
    words.u32(at::SIZE_PX, targets.width).u32(at::SIZE_PX + 4, targets.height);
    words.u32(at::SHADE_ORIGIN_PX, tile.x - targets.x).u32(at::SHADE_ORIGIN_PX + 4, tile.y - targets.y);
    words.u32(at::SHADE_SIZE_PX, tile.width).u32(at::SHADE_SIZE_PX + 4, tile.height);
    words.u32(at::HAS_EDGES, u32::from(plan.has(Pass::EdgeAntialiasing)));
    words.u32(at::SHADOW_SIDE, SHADOW_MAP_SIDE).u32(at::SHADOW_AT, frame.shadow.at);
    words.u32(at::HAS_POLYGONS, u32::from(plan.has(Pass::Polygons))).f64(at::FULL_COVERAGE, FULL_COVERAGE);
    words.u32(at::HAS_OUTLINES, u32::from(plan.has(Pass::Outlines)));
    words.u32(at::HAS_EYE_DOME, u32::from(plan.has(Pass::EyeDome)));
    words.u32(at::HAS_BALLS, u32::from(plan.has(Pass::Balls)));
    words.u32(at::HAS_LAYERS, u32::from(has_layers(plan))).u32(at::HAS_ABUFFER, u32::from(plan.has(Pass::ABuffer)));
    let has_remaining = plan.has(Pass::RemainingLayer);
    words.u32(at::HAS_REMAINING_LAYER, u32::from(has_remaining));
    words.u32(at::CLIP_BY_CHORD, u32::from(plan.clip == ClipPolicy::Line));
    words.vec2(at::RAY_START, (DVec2::splat(0.5) - principal) / focal).vec2(at::RAY_STEP, DVec2::ONE / focal);
    let ambient = limit_light(scene.ambient, frame.light_count as usize);
    words.vec3(at::AMBIENT, DVec3::from(ambient)).f64s(at::BACKGROUND, scene.background);
    words.f64s(at::MATERIAL, scene.material.factors()).vec3(at::TO_EYE, -view.forward());
    let is_of_host = frame.has_host_shader && plan.shader == Shader::Phong;
    let shader = if is_of_host { layout::SHADER_HOST } else { shader_kind(plan.shader) };
    words.u32(at::SHADER_KIND, shader).f32(at::EMPTY_DEPTH, f32::INFINITY);
    words.u32(at::HAS_COLORS, u32::from(plan.attributes.color));
    words.u32(at::HAS_MATERIALS, u32::from(plan.attributes.material)).u32(at::LIGHT_COUNT, frame.light_count);
    words.u32(at::COLOR_AT, planes.color_at).u32(at::DEPTH_AT, planes.depth_at).u32(at::NORMAL_AT, planes.normal_at);
    words.u32(at::WEIGHT_AT, planes.weight_at).u32(at::FRAGMENTS_AT, planes.fragments_at);
    words.u32(at::SURFACES_AT, planes.surfaces_at).u32(at::EDGES_AT, planes.edges_at);
    words.u32(at::LAYERS_AT, planes.layers_at);
    words.u32(at::NEAREST_AT, planes.nearest_at).u32(at::ALPHA_AT, planes.alpha_at);
    words.u32(at::MEDIAN_DEPTH_AT, planes.median_depth_at).u32(at::DISTORTION_AT, planes.distortion_at);
    if plan.has(Pass::Gaussians) {
        let linear = scene.summary.gaussians == Some(GaussianColors::Linear);
        let [r, g, b, a] = scene.background;
        let straight = [r, g, b].map(|c| if a > 0.0 { c / a } else { 0.0 });
        let background = gaussian::background([straight[0], straight[1], straight[2], a], linear);
        words.u32(at::GAUSSIAN_COLUMNS, tile.width.div_ceil(layout::GAUSSIAN_CELL));
        words.u32(at::HAS_LINEAR_GAUSSIANS, u32::from(linear)).f64(at::GAUSSIAN_NEAR, gaussian::near(p));
        words.f64s(at::GAUSSIAN_BACKGROUND, background);
    }
    words.into_words()
}

/// Returns the shaders' number of a filter.
fn filter_kind(filter: Filter) -> u32 {
    match filter {
        Filter::None => layout::FILTER_NONE,
        Filter::Clamp => layout::FILTER_CLAMP,
        Filter::Adjust => layout::FILTER_ADJUST,
        Filter::Ewa => layout::FILTER_EWA,
        // Filters that are added to the model later are drawn as the default one.
        _ => layout::FILTER_PRINCIPAL,
    }
}

/// Returns the shaders' number of a shader.
fn shader_kind(shader: Shader) -> u32 {
    match shader {
        Shader::Toon => layout::SHADER_TOON,
        Shader::Phong => layout::SHADER_PHONG,
        Shader::Normal => layout::SHADER_NORMAL,
        Shader::Depth => layout::SHADER_DEPTH,
        Shader::Matcap => layout::SHADER_MATCAP,
        Shader::Edl => layout::SHADER_EDL,
        // Shaders that are added to the model later are drawn as the default one.
        _ => layout::SHADER_UNLIT,
    }
}
