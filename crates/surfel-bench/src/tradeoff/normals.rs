//! Comparison of ways to store a normal. It shows why the storage of splats is the only setting that concerns normals.

use std::f64::consts::PI;

use crate::page::Table;
use glam::DVec3;
use surfel_math::{V3, quantise};

/// Number of evenly distributed directions over which the largest error of each way is determined.
const DIRECTIONS: u32 = 40_000;

/// Way to store a normal: its size, the rounding of a normal by it, and the reason for or against using it.
struct Way {
    name: &'static str,
    bytes: u32,
    keep: fn(DVec3) -> DVec3,
    verdict: &'static str,
}

/// All ways to store a normal that are compared.
const WAYS: [Way; 5] = [
    Way { name: "three f32", bytes: 12, keep: |n| n.as_vec3().as_dvec3(), verdict: "used: storage of 32 bits" },
    Way {
        name: "octahedron, 16 bits each",
        bytes: 4,
        keep: |n| octahedron(n, 32767.0),
        verdict: "used: storage of 16 bits; a sixtieth of a step of 8-bit colour",
    },
    Way {
        name: "three half floats (B05)",
        bytes: 6,
        keep: |n| DVec3::from(n.to_array().map(half)),
        verdict: "dominated by the octahedron of 16 bits",
    },
    Way {
        name: "octahedron, 8 bits each",
        bytes: 2,
        keep: |n| octahedron(n, 127.0),
        verdict: "steps of light would show, and disks tilt",
    },
    Way {
        name: "three bytes",
        bytes: 3,
        keep: |n| (n * 127.0).round() / 127.0,
        verdict: "steps of light would show, and disks tilt",
    },
];

/// Rounds the two octahedral coordinates of a direction to `steps` steps on each side of zero.
fn octahedron(n: DVec3, steps: f64) -> DVec3 {
    let folded = quantise::folded(V3::new(n.x as f32, n.y as f32, n.z as f32));
    let [x, y] = folded.map(|c| (f64::from(c) * steps).round() / steps);
    let v = quantise::unfolded(x, y);
    DVec3::new(v.x, v.y, v.z)
}

/// Returns the nearest half float, which has eleven significant bits and a least normal exponent of −14.
fn half(value: f64) -> f64 {
    let unit = (value.abs().log2().floor().max(-14.0) - 10.0).exp2();
    (value / unit).round_ties_even() * unit
}

/// Returns a table of every way to store a normal, with its memory and its error.
pub(crate) fn table() -> Table {
    let mut table = Table::new(&["normals as", "bytes a splat", "largest error", "of a lit colour", "verdict"]);
    for Way { name, bytes, keep, verdict } in &WAYS {
        let radians = largest_error(*keep);
        table.rows.push(vec![
            (*name).to_owned(),
            bytes.to_string(),
            format!("{:.1e}°", radians.to_degrees()),
            // n·l changes by at most the angle between the normals, in radians.
            format!("{radians:.1e}"),
            (*verdict).to_owned(),
        ]);
    }
    table
}

/// Returns the largest angle between a direction and its stored form, in radians.
fn largest_error(keep: fn(DVec3) -> DVec3) -> f64 {
    let golden = PI * (3.0 - 5f64.sqrt());
    let direction = |i: u32| {
        let y = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(DIRECTIONS);
        let (across, angle) = ((1.0 - y * y).sqrt(), golden * f64::from(i));
        DVec3::new(across * angle.cos(), y, across * angle.sin())
    };
    let error = |n: DVec3| {
        let kept = keep(n);
        kept.cross(n).length().atan2(kept.dot(n))
    };
    (0..DIRECTIONS).map(direction).map(error).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_err_by_about_half_a_step_of_what_keeps_them() {
        let errors = WAYS.map(|way| largest_error(way.keep));
        // Each octahedral coordinate errs by at most half a step, and z by the sum of both errors: an offset of √6/2
        // steps. On the octahedron's faces, at the distance 1/√3 from the origin, that is an angle of √6/2·√3 = 2.12
        // steps.
        for (error, step) in
            errors.into_iter().zip([2f64.powi(-24), 1.0 / 32767.0, 2f64.powi(-11), 1.0 / 127.0, 1.0 / 127.0])
        {
            assert!((0.3 * step..2.13 * step).contains(&error), "{error:e} of steps of {step:e}");
        }
        assert_eq!(half(1.0 / 3.0), 0.333_251_953_125);
    }
}
