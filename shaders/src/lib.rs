//! Surfel's shaders, in WGSL and SPIR-V: the only shader source of images.
//!
//! Main items, in reading order:
//!
//! 1. [`WGSL`]: the formulas, from the folder `wgsl/`. Each function is the twin of one in `surfel-math`: the same
//!    formula in the same order of operations, so that a difference between a GPU and the CPU is rounding and not
//!    algebra. [`TWINS`] lists the pairs;
//! 2. [`PASSES`]: the formulas with the data, entry points and bindings that draw with them, from the folder `passes/`;
//!    [`SPIRV`] is each entry point compiled for Vulkan;
//! 3. [`ENTRIES`]: the entry points with their stages, workgroups and bindings;
//! 4. [`layout`]: byte offsets of the structs in buffers.
//!
//! ```
//! use surfel_shaders::{ENTRIES, FUNCTIONS, SPIRV, TWINS};
//!
//! // Every formula with a twin in Rust exists, and so does the SPIR-V of every entry point.
//! assert!(TWINS.iter().all(|twin| FUNCTIONS.contains(&twin.wgsl)));
//! assert!(ENTRIES.iter().all(|entry| SPIRV.iter().any(|(name, _)| *name == entry.name)));
//! ```
//!
//! # Layer
//! The crate lies below `surfel-gpu`, which fills buffers by [`layout`], and below the backends `surfel-wgpu` and
//! `surfel-ash`. It depends on no other crate at run time and has no Cargo features.
//!
//! The build script concatenates the modules by their manifests, and naga parses and validates them, so a program that
//! builds has valid shaders. Buffer layouts and the bindings of entry points are reflected, never written twice.

/// Formulas as one WGSL text without entry points, valid on its own.
pub const WGSL: &str = include_str!(concat!(env!("OUT_DIR"), "/formulas.wgsl"));

/// Formulas and passes, with all entry points, as one WGSL text.
pub const PASSES: &str = include_str!(concat!(env!("OUT_DIR"), "/passes.wgsl"));

/// WGSL text of the passes in which text of the embedding application replaces the function `host_color`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostShader {
    /// The whole text: the passes with the application's text in place of `host_color`.
    pub text: String,
    /// Number of lines before the application's text.
    pub lines_before: u32,
    /// Number of lines of the application's text.
    pub lines: u32,
}

impl HostShader {
    /// Replaces the function `host_color` of [`PASSES`] by the application's WGSL text.
    pub fn new(host: &str) -> Self {
        let module = "// ==== passes/host_color.wgsl\n";
        let (before, rest) = PASSES.split_once(module).unwrap_or((PASSES, ""));
        let after = rest.split_once("// ==== ").map_or("", |(_, after)| after);
        let before = format!("{before}{module}");
        Self {
            text: format!("{before}{host}\n// ==== {after}"),
            lines_before: before.lines().count() as u32,
            lines: host.lines().count() as u32,
        }
    }

    /// Returns the line of the application's text that is line `line` of the whole text. Both are counted from 1.
    /// `None` if the line isn't the application's.
    pub fn line(&self, line: u32) -> Option<u32> {
        let own = line.checked_sub(self.lines_before)?;
        (1..=self.lines).contains(&own).then_some(own)
    }
}

/// SPIR-V 1.3 for Vulkan 1.1 of each entry point of [`PASSES`]: the entry point's name, and the words of its module. A
/// module contains the entry point and the code that it uses. Clip space has y up as in WebGPU.
pub const SPIRV: &[(&str, &[u32])] = include!(concat!(env!("OUT_DIR"), "/spirv.rs"));

/// Names of the functions in [`WGSL`], sorted, as reported by naga.
pub const FUNCTIONS: &[&str] = include!(concat!(env!("OUT_DIR"), "/functions.rs"));

/// Sizes of the shaders' structs and offsets of their fields, in bytes, and the shaders' constants.
pub mod layout {
    include!(concat!(env!("OUT_DIR"), "/layout.rs"));
}

/// Shader stage of an entry point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Vertex shader.
    Vertex,
    /// Fragment shader.
    Fragment,
    /// Compute shader.
    Compute,
}

/// Kind of resource of a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// A uniform buffer.
    Uniform,
    /// A storage buffer that is declared as read-only.
    StorageRead,
    /// A storage buffer that is declared as writable. Shaders may read it, too.
    StorageWrite,
    /// A two-dimensional texture of floats, read by texel.
    Texture,
    /// A two-dimensional depth texture, read by texel.
    DepthTexture,
}

/// Resource that an entry point reads or writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Bind group, or descriptor set.
    pub group: u32,
    /// Binding number within the group.
    pub binding: u32,
    /// Kind of the resource.
    pub kind: BindingKind,
}

/// Entry point of [`PASSES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Function name of the entry point.
    pub name: &'static str,
    /// Shader stage that it runs in.
    pub stage: Stage,
    /// Number of invocations of a workgroup along x, y and z; zeros unless the stage is [`Stage::Compute`].
    pub workgroup: [u32; 3],
    /// Bindings that it uses, sorted by group and number.
    pub bindings: &'static [Binding],
}

/// All entry points of [`PASSES`], in the order of its text.
pub const ENTRIES: &[Entry] = include!(concat!(env!("OUT_DIR"), "/entries.rs"));

/// Function that exists both in WGSL and in Rust.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Twin {
    /// Name of the function in [`WGSL`].
    pub wgsl: &'static str,
    /// Path of the function in `surfel-math`.
    pub rust: &'static str,
}

const fn twin(wgsl: &'static str, rust: &'static str) -> Twin {
    Twin { wgsl, rust }
}

/// All functions of [`WGSL`] except [`HELPERS`], with their twins in `surfel-math`, by module.
pub const TWINS: &[Twin] = &[
    twin("difference_of_products", "real::Real::difference_of_products"),
    twin("sum_of_products", "real::Real::sum_of_products"),
    twin("v2_dot", "vector::V2::dot"),
    twin("v2_cross", "vector::V2::cross"),
    twin("v2_length", "vector::V2::length"),
    twin("v3_dot", "vector::V3::dot"),
    twin("v3_cross", "vector::V3::cross"),
    twin("v3_length", "vector::V3::length"),
    twin("v3_max_abs", "vector::V3::max_abs"),
    twin("unit", "basis::unit"),
    twin("orthonormal", "basis::orthonormal"),
    twin("unfolded", "quantise::unfolded"),
    twin("svd2_of_columns", "svd::Svd2::of_columns"),
    twin("svd2_minor_axis", "svd::Svd2::minor_axis"),
    twin("projected_new", "project::Projected::new"),
    twin("projected_is_edge_on", "project::Projected::is_edge_on"),
    twin("radius_max", "project::radius_max"),
    twin("projection_offset_from", "projection::Projection::offset_from"),
    twin("linear_new", "mapping::Linear::new"),
    twin("linear_at", "mapping::Linear::at"),
    twin("footprint_at", "mapping::Footprint::at"),
    twin("footprint_contains", "mapping::Footprint::contains"),
    twin("footprint_about_center", "mapping::Footprint::about_center"),
    twin("footprint_unfiltered", "mapping::Footprint::unfiltered"),
    twin("turn_none", "clip::Turn::none"),
    twin("turn_apply", "clip::Turn::apply"),
    twin("turn_after", "clip::Turn::after"),
    twin("clip_through", "clip::Clip::through"),
    twin("clip_curve_keeps", "clip::Clip::curve_keeps"),
    twin("clip_lines_keep", "clip::Clip::lines_keep"),
    twin("clip_keeps", "clip::Clip::keeps"),
    twin("filtered_unfiltered", "filter::Filtered::unfiltered"),
    twin("principal", "filter::principal"),
    twin("ewa", "filter::ewa"),
    twin("area_ratio", "filter::area_ratio"),
    twin("adjust", "filter::adjust"),
    twin("adjust_axes_turned", "filter::adjust_axes_turned"),
    twin("bounds_ellipse", "bounds::ellipse"),
    twin("bounds_unfiltered", "bounds::unfiltered"),
    twin("bounds_footprint", "bounds::footprint"),
    twin("depth_plane_at", "depth::DepthPlane::at"),
    twin("tolerance", "depth::tolerance"),
    twin("plane_gradient", "depth::plane_gradient"),
    twin("nearness", "facing::nearness"),
    twin("sheet_limit", "facing::sheet_limit"),
    twin("back_normal", "facing::back_normal"),
    twin("triangle_contains", "triangle::Triangle::contains"),
    twin("triangle_barycentric", "triangle::Triangle::barycentric"),
    twin("triangle_depth", "triangle::Triangle::depth"),
    twin("triangle_gradient", "triangle::Triangle::gradient"),
    twin("interpolate", "triangle::interpolate"),
    twin("lookup_bias", "shadow::lookup_bias"),
    twin("taps", "shadow::taps"),
    twin("tap_weights", "shadow::tap_weights"),
    twin("slope_allowance", "depth::slope_allowance"),
    twin("step_allowance", "depth::step_allowance"),
    twin("toon_smoothstep", "toon::smoothstep"),
    twin("toon_ramp", "toon::ramp"),
    twin("toon_highlight", "toon::highlight"),
    twin("toon_line", "toon::line"),
    twin("toon_step_back_limit", "toon::step_back_limit"),
    twin("matcap_coordinates", "matcap::coordinates"),
    twin("eye_dome_rise_weight", "eye_dome::rise_weight"),
    twin("eye_dome_brightness", "eye_dome::brightness"),
    twin("weight", "kernel::weight"),
    twin("gaussian_forms_at", "gaussian::GaussianForms::at"),
    twin("depth_step_f32", "gaussian::depth_step_f32"),
    twin("distortion_depth", "gaussian::distortion_depth"),
    twin("limit_color", "srgb::limit_color"),
    twin("srgb_decode", "srgb::decode"),
    twin("ball_segment", "ball::segment"),
    twin("outline_contains", "ball::Outline::contains"),
    twin("outline_coverage", "ball::Outline::coverage"),
    twin("outline_coverage_of_large", "ball::Outline::coverage_of_large"),
    twin("outline_rounding", "ball::Outline::rounding"),
    twin("ball_hit_new", "ball::BallHit::new"),
];

/// Functions of [`WGSL`] without a twin. They are parts of functions that have a twin, since WGSL has no closures and
/// no reliable fused multiply-add.
pub const HELPERS: &[&str] = &[
    "upper_half",
    "product_head",
    "product_rest",
    "adjust_lengthen",
    "turn_by",
    "turned",
    "turn_of",
    "principal_turn",
    "form_through",
    "ellipse_extremes",
    "away_from_zero",
    "edge_covers",
    "toon_step",
    "ball_limited",
    "outline_unit",
    "ball_left_of",
];
