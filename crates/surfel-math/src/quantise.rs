//! Quantisation to 16 bits: numbers in steps of a scale, and unit vectors as two coordinates on an octahedron.
//!
//! Source: B05 §7 uses half floats. Here a few neighbouring values share a scale, and 16 bits divide its range evenly.
//! Octahedron: Meyer et al. 2010, "On Floating-Point Normal Vectors".

use crate::{Real, V3};

/// Number of quantisation steps between zero and the scale, the largest number that is stored.
pub const STEPS: f32 = 32767.0;
/// 16-bit code that stands for the number zero.
pub const ZERO: u16 = 32768;

/// Returns the 16-bit code of the quantisation step nearest to a number between −1 and 1. Numbers outside the range are
/// clamped to it, and NaN becomes zero.
pub fn to_step(unit: f32) -> u16 {
    let step = (unit * STEPS).round().clamp(-STEPS, STEPS) as i32;
    (step + i32::from(ZERO)) as u16
}

/// Returns the number of quantisation steps from zero that a 16-bit code stands for, with its sign.
pub fn steps(step: u16) -> f32 {
    (i32::from(step) - i32::from(ZERO)) as f32
}

/// Rounds a number between −scale and scale to the nearest 16-bit step. The error is at most scale/65534, plus
/// rounding.
pub fn quantised(value: f32, scale: f32) -> f32 {
    steps(to_step(value / scale)) * (scale / STEPS)
}

/// Encodes a direction of any non-zero length as two octahedral coordinates, each between −1 and 1.
pub fn folded(v: V3<f32>) -> [f32; 2] {
    let length = v.x.abs() + v.y.abs() + v.z.abs();
    let (x, y) = (v.x / length, v.y / length);
    let fold = |a: f32, b: f32| if v.z < 0.0 { (1.0 - b.abs()) * 1f32.copysign(a) } else { a };
    [fold(x, y), fold(y, x)]
}

/// Decodes a direction from two octahedral coordinates. The length of the result is between 1/√3 and 1.
#[inline(always)]
pub fn unfolded<R: Real>(x: R, y: R) -> V3<R> {
    let zero = x.zero();
    let z = x.one() - x.abs() - y.abs();
    let below = (-z).max(zero);
    V3::new(x + R::select(x.lt(zero), below, -below), y + R::select(y.lt(zero), below, -below), z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantised_numbers_are_within_half_a_step() {
        for i in 0..1000 {
            let value = i as f32 * 0.006 - 3.0;
            // Half of 3/32767, and rounding.
            assert!((quantised(value, 3.0) - value).abs() <= 4.6e-5, "{value}");
        }
        assert_eq!((to_step(f32::NAN), to_step(9.0), to_step(-9.0)), (ZERO, u16::MAX, 1));
        assert_eq!(steps(to_step(0.0)), 0.0);
    }

    #[test]
    fn folded_directions_turn_by_less_than_their_bound() {
        let check = |v: [f64; 3]| {
            let [x, y] = folded(V3::new(v[0] as f32, v[1] as f32, v[2] as f32)).map(|c| f64::from(quantised(c, 1.0)));
            let w = unfolded(x, y);
            let length = w.length();
            assert!((0.57..=1.001).contains(&length), "{v:?} {length}");
            let square: f64 = [w.x, w.y, w.z].iter().zip(v).map(|(a, b)| (a / length - b).powi(2)).sum();
            assert!(square.sqrt() < 1e-4, "{v:?} {w:?}");
        };
        for i in 0..1024 {
            let (z, angle) = (1.0 - (f64::from(i) + 0.5) / 512.0, f64::from(i) * 2.399_963);
            let r = (1.0 - z * z).sqrt();
            check([r * angle.cos(), r * angle.sin(), z]);
        }
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut v = [0.0; 3];
                v[axis] = sign;
                check(v);
            }
        }
    }
}
