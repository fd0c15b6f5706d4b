//! Tests that every shader function has a twin in surfel-math, and that constants that both have are equal.

use std::collections::BTreeSet;

use surfel_shaders::{FUNCTIONS, HELPERS, TWINS, WGSL};

/// Expands to an array of the paths, as text, of functions of surfel-math. The compiler checks that they exist: each is
/// used as a value.
macro_rules! paths {
    ($($module:ident $(:: $name:ident)+ $(, as $value:expr)?);+ $(;)?) => {
        [$({
            let _ = paths!(@value $module $(:: $name)+ $(, $value)?);
            concat!(stringify!($module) $(, "::", stringify!($name))+)
        }),+]
    };
    (@value $module:ident $(:: $name:ident)+) => { surfel_math::$module$(::$name)+::<f32> };
    (@value $module:ident $(:: $name:ident)+, $value:expr) => { $value };
}

fn rust_paths() -> BTreeSet<&'static str> {
    use surfel_math::{
        ball, basis, clip, depth, filter, gaussian, kernel, mapping, project, real, shadow, srgb, svd, triangle, vector,
    };
    BTreeSet::from(paths! {
        real::Real::difference_of_products, as <f32 as real::Real>::difference_of_products;
        real::Real::sum_of_products, as <f32 as real::Real>::sum_of_products;
        vector::V2::dot, as vector::V2::<f32>::dot;
        vector::V2::cross, as vector::V2::<f32>::cross;
        vector::V2::length, as vector::V2::<f32>::length;
        vector::V3::dot, as vector::V3::<f32>::dot;
        vector::V3::cross, as vector::V3::<f32>::cross;
        vector::V3::length, as vector::V3::<f32>::length;
        vector::V3::max_abs, as vector::V3::<f32>::max_abs;
        basis::unit, as basis::unit;
        basis::orthonormal, as basis::orthonormal;
        quantise::unfolded;
        svd::Svd2::of_columns, as svd::Svd2::<f32>::of_columns;
        svd::Svd2::minor_axis, as svd::Svd2::<f32>::minor_axis;
        project::Projected::new, as project::Projected::<f32>::new;
        project::Projected::is_edge_on, as project::Projected::<f32>::is_edge_on;
        project::radius_max;
        projection::Projection::offset_from;
        mapping::Linear::new, as mapping::Linear::<f32>::new;
        mapping::Linear::at, as mapping::Linear::<f32>::at;
        mapping::Footprint::at, as mapping::Footprint::<f32>::at;
        mapping::Footprint::contains, as mapping::Footprint::<f32>::contains;
        mapping::Footprint::about_center, as mapping::Footprint::<f32>::about_center;
        mapping::Footprint::unfiltered, as mapping::Footprint::<f32>::unfiltered;
        clip::Turn::none, as clip::Turn::<f32>::none;
        clip::Turn::apply, as clip::Turn::<f32>::apply;
        clip::Turn::after, as clip::Turn::<f32>::after;
        clip::Clip::through, as clip::Clip::<f32>::through;
        clip::Clip::curve_keeps, as clip::Clip::<f32>::curve_keeps;
        clip::Clip::lines_keep, as clip::Clip::<f32>::lines_keep;
        clip::Clip::keeps, as clip::Clip::<f32>::keeps;
        filter::Filtered::unfiltered, as filter::Filtered::<f32>::unfiltered;
        filter::principal;
        filter::ewa;
        filter::area_ratio;
        filter::adjust;
        filter::adjust_axes_turned, as filter::adjust_axes_turned;
        bounds::ellipse;
        bounds::unfiltered;
        bounds::footprint;
        depth::DepthPlane::at, as depth::DepthPlane::<f32>::at;
        depth::tolerance;
        depth::plane_gradient;
        facing::nearness;
        facing::sheet_limit;
        facing::back_normal;
        depth::slope_allowance, as depth::slope_allowance;
        depth::step_allowance, as depth::step_allowance;
        shadow::lookup_bias;
        shadow::tap_weights;
        shadow::taps, as shadow::taps;
        triangle::Triangle::contains, as triangle::Triangle::<f32>::contains;
        triangle::Triangle::barycentric, as triangle::Triangle::<f32>::barycentric;
        triangle::Triangle::depth, as triangle::Triangle::<f32>::depth;
        triangle::Triangle::gradient, as triangle::Triangle::<f32>::gradient;
        triangle::interpolate;
        toon::smoothstep;
        toon::ramp;
        toon::highlight;
        toon::line;
        toon::step_back_limit;
        matcap::coordinates;
        eye_dome::rise_weight;
        eye_dome::brightness;
        kernel::weight, as kernel::weight;
        gaussian::GaussianForms::at, as gaussian::GaussianForms::<f32>::at;
        gaussian::depth_step_f32, as gaussian::depth_step_f32;
        gaussian::distortion_depth;
        srgb::limit_color;
        srgb::decode, as srgb::decode;
        ball::segment;
        ball::Outline::contains, as ball::Outline::<f32>::contains;
        ball::Outline::coverage, as ball::Outline::<f32>::coverage::<ball::Rounded>;
        ball::Outline::coverage_of_large, as ball::Outline::<f32>::coverage_of_large;
        ball::Outline::rounding, as ball::Outline::<f32>::rounding;
        ball::BallHit::new, as ball::BallHit::<f32>::new;
    })
}

#[test]
fn every_formula_is_in_the_tables_once() {
    let listed: Vec<&str> = TWINS.iter().map(|twin| twin.wgsl).chain(HELPERS.iter().copied()).collect();
    let unique: BTreeSet<&str> = listed.iter().copied().collect();
    assert_eq!(listed.len(), unique.len(), "a function is listed twice");
    assert_eq!(unique, FUNCTIONS.iter().copied().collect::<BTreeSet<_>>());
}

#[test]
fn every_function_in_the_table_exists_in_rust_under_the_name_of_its_twin() {
    let paths = rust_paths();
    assert_eq!(TWINS.iter().map(|twin| twin.rust).collect::<BTreeSet<_>>(), paths);
    for twin in TWINS {
        // A method `Type::name` is called `type_name`, a free function by its own name.
        let name = twin.rust.rsplit("::").next().unwrap();
        assert!(twin.wgsl == name || twin.wgsl.ends_with(&format!("_{name}")), "{twin:?}");
    }
}

#[test]
fn functions_are_written_out_in_the_text() {
    assert!(!FUNCTIONS.is_empty());
    for name in FUNCTIONS {
        assert!(WGSL.contains(&format!("fn {name}(")), "{name}");
    }
}

#[test]
fn edge_on_is_the_same_number_in_both() {
    let line = WGSL.lines().find_map(|line| line.strip_prefix("const EDGE_ON: f32 = ")).unwrap();
    assert_eq!(line.trim_end_matches(';').parse::<f64>().unwrap(), surfel_math::project::EDGE_ON);
}

#[test]
fn facing_is_told_by_the_same_numbers_in_both() {
    use surfel_math::facing;
    use surfel_shaders::layout;
    assert_eq!(layout::BACK_FACING_LAG, facing::BACK_FACING_LAG as f32);
    assert_eq!(layout::RIM_SINE, facing::RIM_SINE as f32);
    assert_eq!(layout::RECORD_FACING, layout::RECORD_FRONT | layout::RECORD_BACK);
    let shape = layout::RECORD_RECIPROCAL | layout::RECORD_CLAMP | layout::RECORD_CENTERED;
    let flags = layout::RECORD_FACING | shape | layout::RECORD_CLIPPED | layout::RECORD_LAYERED;
    assert_eq!(1 << layout::RECORD_OBJECT, flags + 1);
}

#[test]
fn gaussians_end_at_the_same_numbers_in_both() {
    use surfel_math::gaussian;
    use surfel_shaders::layout;
    assert_eq!(layout::MAX_ALPHA, gaussian::MAX_ALPHA as f32);
    assert_eq!(layout::MIN_ALPHA, gaussian::MIN_ALPHA as f32);
    assert_eq!(layout::MIN_TRANSMITTANCE, gaussian::MIN_TRANSMITTANCE as f32);
    assert_eq!(layout::MIN_GAUSSIAN_WEIGHT, gaussian::MIN_WEIGHT as f32);
}

#[test]
fn eye_dome_reaches_as_far_in_both() {
    assert_eq!(surfel_shaders::layout::EYE_DOME_REACH, surfel_math::eye_dome::REACH_PX);
}
