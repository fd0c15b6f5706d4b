//! Evaluation of a splat's record at a pixel, in lanes, to depth and weight. Tiny splats are evaluated during setup,
//! others block by block.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *record* is a splat projected to the screen
//! ([`Record`](crate::setup::record::Record)). A *cheap* splat is one of
//! [`Class::Cheap`](crate::setup::record::Class::Cheap). A *lane* is one of the 16 numbers that SIMD instructions
//! compute at once.

use crate::setup::kernel::Kernel;
use crate::setup::record::RecordLanes;
use crate::simd::lanes::Lanes;
use fearless_simd::{Simd, mask32x16};
use surfel_math::Real;
use surfel_model::Filter;
use surfel_render::{FramePlan, View};

/// Constants of a frame by which splats are evaluated at pixels.
#[derive(Clone, Copy)]
pub(crate) struct FrameConstants {
    /// True if depth is a linear function of pixels, as in orthographic projections and under the affine mapping.
    pub linear_depth: bool,
    /// 1/h² of the screen-parallel disk of radius h pixels that the filter `clamp` draws; `None` for other filters.
    pub clamp: Option<f32>,
    pub kernel: Kernel,
    pub near: f32,
    pub far: f32,
}

impl FrameConstants {
    pub(crate) fn new(plan: &FramePlan, view: &View) -> Self {
        let settings = &plan.splat_filter;
        let clamp = settings.filter == Filter::Clamp;
        Self {
            linear_depth: !settings.projective,
            clamp: clamp.then(|| (1.0 / (settings.radius_px * settings.radius_px)) as f32),
            kernel: Kernel::new(settings.cutoff),
            near: view.projection.near as f32,
            far: view.projection.far().min(f64::from(f32::MAX)) as f32,
        }
    }

    /// Returns the nearest and the farthest depth that is drawn, in world units.
    pub(crate) fn depth_range(&self) -> [f32; 2] {
        [self.near, self.far]
    }
}

/// Largest depth difference between the centre and the edge of the disk of a splat that counts as cheap
/// ([`Class::Cheap`](crate::setup::record::Class::Cheap)), relative to the centre's depth. The terms that
/// [`inverse_near_one`] omits are then below 7e-8 of the depth.
pub(crate) const CHEAP_DEPTH: f64 = 1.0 / 64.0;
/// Largest depth difference between the centre and the edge of the filtered footprint of a splat that counts as cheap,
/// relative to the centre's depth. The terms that [`inverse_near_one`] omits are then below 5e-7 of the depth.
pub(crate) const CHEAP_FILTERED_DEPTH: f64 = 1.0 / 39.0;

/// Largest change of depth per pixel, relative to the centre's depth, of a splat that counts as cheap. The splat's
/// blocks extend at most 12 pixels beyond its disks. Over these blocks the argument e of [`inverse_near_one`] is below
/// 0.4, so that pixels outside a disk are still found to be outside.
pub(crate) const CHEAP_STEEPNESS: f64 = 1.0 / 32.0;

/// Largest filter radius, in pixels, with which splats may count as cheap.
pub(crate) const CHEAP_RADIUS_PX: f64 = 2.0;

/// Fragments in lanes: of one splat at sixteen pixels, or of a group of splats at one pixel each.
pub(crate) struct Fragment<S: Simd> {
    /// Mask of the pixels inside the unfiltered footprint.
    pub visible: mask32x16<S>,
    /// Mask of the pixels inside the filtered footprint.
    pub inside: mask32x16<S>,
    pub z: Lanes<S>,
    /// Weight of the fragment, w; undefined outside the filtered footprint.
    pub weight: Lanes<S>,
}

/// Returns the value x·d_x + y·d_y of a linear form at pixel offset d.
#[inline(always)]
pub(crate) fn form<S: Simd>((d_x, d_y): (Lanes<S>, Lanes<S>), x: Lanes<S>, y: Lanes<S>) -> Lanes<S> {
    x.mul_add(d_x, y * d_y)
}

/// Returns the value x·d_x + y·d_y + c of a linear form at pixel offset d.
#[inline(always)]
fn form_at<S: Simd>((d_x, d_y): (Lanes<S>, Lanes<S>), x: Lanes<S>, y: Lanes<S>, c: Lanes<S>) -> Lanes<S> {
    x.mul_add(d_x, y.mul_add(d_y, c))
}

/// Returns (u·w')² + (v·w')² of the filtered footprint at pixel offset `d`. (u, v) is the place on the splat, and w'
/// the homogeneous coordinate, scaled to 1 at the projected centre.
#[inline(always)]
fn square_of<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>)) -> Lanes<S> {
    let (u, v) = (form(d, r.u_x, r.u_y), form(d, r.v_x, r.v_y));
    u.mul_add(u, v * v)
}

/// Returns (u·w')² + (v·w')² of the unfiltered footprint at pixel offset `d`. (u, v) is the place on the splat, and w'
/// the homogeneous coordinate, scaled to 1 at the projected centre.
#[inline(always)]
fn visible_square_of<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>)) -> Lanes<S> {
    let (u, v) = (form(d, r.visible_u_x, r.visible_u_y), form(d, r.visible_v_x, r.visible_v_y));
    u.mul_add(u, v * v)
}

/// Evaluates splats of [`Class::Cheap`](crate::setup::record::Class::Cheap), or one such splat at many pixels. `d` are
/// the pixel offsets from the projected centres.
#[inline(always)]
pub(crate) fn cheap<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>), frame: &FrameConstants) -> Fragment<S> {
    let one = r.z.one();
    // Outside the disk, the depth is clamped to the disk's depth range.
    let inverse = inverse_near_one(form(d, r.depth_x, r.depth_y).max(r.range_min).min(r.range_max));
    let visible = visible_square_of(r, d) * (inverse * inverse);
    let filtered = inverse_near_one(form(d, r.w_x, r.w_y));
    let rho_squared = square_of(r, d) * (filtered * filtered);
    let weight = frame.kernel.at(rho_squared) * r.weight_scale;
    Fragment { visible: visible.le(one), inside: rho_squared.le(one), z: r.z * inverse, weight }
}

/// Returns the depth of a splat's plane at pixel offset `d`, clamped to the disk's range. Also returns p_z/z and z/p_z,
/// with p_z the centre's depth, unless `linear_depth` makes them superfluous. The clamped p_z/z is positive, so that
/// comparing |(u·w', v·w')| with it needs no test of the sign of w'.
#[inline(always)]
fn depth_of<S: Simd>(
    r: &RecordLanes<S>,
    d: (Lanes<S>, Lanes<S>),
    frame: &FrameConstants,
) -> (Lanes<S>, Option<[Lanes<S>; 2]>) {
    if frame.linear_depth {
        return (form_at(d, r.depth_x, r.depth_y, r.z).max(r.range_min).min(r.range_max), None);
    }
    let w = form_at(d, r.depth_x, r.depth_y, r.z.one()).max(r.range_min).min(r.range_max);
    let inverse = w.reciprocal_near_one();
    (r.z * inverse, Some([w, inverse]))
}

/// Evaluates splats of any class but tiny and near ones, or one such splat at many pixels. `d` are the pixel offsets
/// from the projected centres.
#[inline(always)]
pub(crate) fn general<S: Simd>(r: &RecordLanes<S>, d: (Lanes<S>, Lanes<S>), frame: &FrameConstants) -> Fragment<S> {
    let (zero, one) = (r.z.zero(), r.z.one());
    let k = |v: f32| Lanes::splat(r.z.0.simd, v);
    let (z, ratio) = depth_of(r, d, frame);
    let exists = k(frame.near).le(z) & z.le(k(frame.far));
    let limit = match ratio {
        Some([w, _]) => w,
        None => one,
    };
    let visible = visible_square_of(r, d).le(limit * limit) & exists;
    let square = square_of(r, d);
    let w = form_at(d, r.w_x, r.w_y, one);
    let mut inside = zero.lt(w) & square.le(w * w);
    // Inside the disk w is near one; other lanes aren't used.
    let inverse = w.reciprocal_near_one();
    let mut rho_squared = square * inverse * inverse;
    if let Some(clamp) = frame.clamp {
        let (d_x, d_y) = d;
        let disk = d_x.mul_add(d_x, d_y * d_y) * k(clamp);
        rho_squared = Lanes::select(inside, rho_squared, disk).min(disk);
        inside |= disk.le(one);
    }
    let weight = frame.kernel.at(rho_squared) * r.weight_scale;
    Fragment { visible, inside: inside & exists, z, weight }
}

/// Returns 1/(1 + e) ≈ (1 − e)(1 + e²), which is exact up to a factor 1 − e⁴. Here 1 + e is p_z/z of a cheap splat, its
/// centre's depth over a pixel's. |e| is at most about 1/63 within the splat's disk, 1/38 within its filtered
/// footprint, and 0.4 over all of its blocks.
#[inline(always)]
pub(crate) fn inverse_near_one<S: Simd>(e: Lanes<S>) -> Lanes<S> {
    let one = e.one();
    (one - e) * e.mul_add(e, one)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::level::{Instructions, SimdLevel, with_instructions};

    /// Returns `inverse_near_one` of e, relative to the exact value.
    fn share(e: f64) -> f64 {
        let instructions = Instructions::new(SimdLevel::Best).unwrap();
        let inverse =
            with_instructions!(instructions, simd => inverse_near_one(Lanes::splat(simd, e as f32)).to_array()[0]);
        f64::from(inverse) * (1.0 + f64::from(e as f32))
    }

    #[test]
    fn cheap_reciprocals_err_as_their_terms_say() {
        // Three roundings.
        const ROUNDING: f64 = 1.8e-7;
        let worst = |most: f64| {
            // p_z/z − 1 of the nearest point of a disk.
            let most = most / (1.0 - most);
            (-1000..=1000).map(|i| (share(most * f64::from(i) / 1000.0) - 1.0).abs()).fold(0.0, f64::max)
        };
        assert!(worst(CHEAP_DEPTH) < 6.4e-8 + ROUNDING, "{:e}", worst(CHEAP_DEPTH));
        let filtered = worst(CHEAP_FILTERED_DEPTH);
        assert!((2e-7..4.9e-7 + ROUNDING).contains(&filtered), "{filtered:e}");
    }

    #[test]
    fn what_lies_outside_of_cheap_disks_is_found_outside_over_all_of_their_blocks() {
        let reach = 12.0 * CHEAP_STEEPNESS + CHEAP_DEPTH / (1.0 - CHEAP_DEPTH);
        assert!(reach < 0.4, "{reach}");
        for depth in [CHEAP_DEPTH, 0.5 * CHEAP_DEPTH, 0.01 * CHEAP_DEPTH] {
            for i in (-4000..=4000).filter(|i| *i != 0) {
                // Along the steepest direction, where z = p_z·(1 + depth·ρ) and 1 + e = p_z/z.
                let e = 0.4 * f64::from(i) / 4000.0;
                let rho = (e / (depth * (1.0 + e))).abs();
                if rho > 1.0 + 1e-6 {
                    assert!(rho * share(e) > 1.0, "e {e}, depth {depth}, ρ {rho}");
                }
            }
        }
    }
}
