//! Surfel's shaders: the only shader source there is, in WGSL.
//!
//! Each function is the twin of one in `surfel-math`: the same formula in the same order of operations, so that a
//! difference between a GPU and the CPU is rounding and not algebra. [`TWINS`] says which belongs to which. The
//! modules lie in `wgsl/`, one idea each; the build script puts them together by `wgsl/manifest.txt` and has naga
//! parse and validate them, so a program that builds has valid shaders.
//!
//! The formulas are here; entry points and bindings come with the GPU backends.

/// All modules as one WGSL text without entry points, valid on its own.
pub const WGSL: &str = include_str!(concat!(env!("OUT_DIR"), "/surfel.wgsl"));

/// Names of the functions in [`WGSL`], sorted, as naga found them.
pub const FUNCTIONS: &[&str] = include!(concat!(env!("OUT_DIR"), "/functions.rs"));

/// A function that is written twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Twin {
    /// Its name in [`WGSL`].
    pub wgsl: &'static str,
    /// Its path in `surfel-math`.
    pub rust: &'static str,
}

const fn twin(wgsl: &'static str, rust: &'static str) -> Twin {
    Twin { wgsl, rust }
}

/// Every function of [`WGSL`] and its twin in `surfel-math`, by module.
pub const TWINS: &[Twin] = &[
    twin("difference_of_products", "real::Real::difference_of_products"),
    twin("sum_of_products", "real::Real::sum_of_products"),
    twin("v2_dot", "vector::V2::dot"),
    twin("v2_cross", "vector::V2::cross"),
    twin("v2_length", "vector::V2::length"),
    twin("v3_dot", "vector::V3::dot"),
    twin("v3_cross", "vector::V3::cross"),
    twin("v3_length", "vector::V3::length"),
    twin("svd2_of_columns", "svd::Svd2::of_columns"),
    twin("svd2_minor_axis", "svd::Svd2::minor_axis"),
    twin("projected_new", "project::Projected::new"),
    twin("projected_is_edge_on", "project::Projected::is_edge_on"),
    twin("projection_offset_from", "projection::Projection::offset_from"),
    twin("linear_new", "mapping::Linear::new"),
    twin("linear_at", "mapping::Linear::at"),
    twin("footprint_at", "mapping::Footprint::at"),
    twin("footprint_contains", "mapping::Footprint::contains"),
    twin("footprint_about_center", "mapping::Footprint::about_center"),
    twin("footprint_unfiltered", "mapping::Footprint::unfiltered"),
    twin("filtered_plain", "filter::Filtered::plain"),
    twin("principal", "filter::principal"),
    twin("ewa", "filter::ewa"),
    twin("area_ratio", "filter::area_ratio"),
    twin("depth_plane_at", "depth::DepthPlane::at"),
    twin("tolerance", "depth::tolerance"),
    twin("weight", "kernel::weight"),
];
