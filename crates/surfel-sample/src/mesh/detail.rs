//! Number and density of splats for a mesh, from the curvature of its surface and the variation of its colours.

use super::count::stratified;
use super::density::Density;
use super::geometry::{Geometry, Smooth};
use crate::parallel::map_each;
use crate::progress::NoProgress;
use crate::radii;
use surfel_math::basis::orthonormal;

/// Largest mean distance of the splats' rims (the edges of their disks) from the curved surface, relative to the
/// extent: half a pixel in an image of 1024². [`Detail::shape`] is computed from this limit.
const RIM: f64 = 0.5 / 1024.0;
/// Largest distance of the rim (edge) of any splat's disk from the curved surface, relative to the extent, on thin
/// parts: a third of a pixel in an image of 1024². The rim may be farther away where splats are at the distance
/// [`FINEST`]. A disk that protrudes from a finger, for example, frays its outline.
const THIN_RIM: f64 = 1.0 / 3.0 / 1024.0;
/// Smallest distance between splats on thin parts, relative to the distance on flat parts of the surface.
const FINEST: f64 = 0.25;
/// Fraction of additional splats above which thin parts get a finer density. With fewer additional splats, an uneven
/// density isn't worth its cost.
const FEW_MORE: f64 = 0.002;
/// Largest variation of colours inside the square that a splat represents: root mean square over the surface, in linear
/// light.
const VARIATION: f64 = 0.03;
/// Smallest and largest number of splats that [`Detail`] requests for a mesh.
const SPLATS: (f64, f64) = (5_000.0, 2_000_000.0);
/// Number of places on the surface at which the variation of colours is measured.
const PLACES: usize = 2048;
/// Number of colour samples along each side of the square around a place, in which the variation of colours is
/// measured.
const ACROSS: i32 = 5;

/// Ratio of the number of splats with a density by colours to that with an even density, below which the uneven density
/// is used.
const MAX_UNEVEN_FRACTION: f64 = 0.9;
/// Number of splats with an uneven density from which an even density is used instead. Beyond a million, samples aren't
/// blue noise.
const MAX_UNEVEN: f64 = 1e6;

/// Numbers of splats that represent a mesh's shape and colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    /// Number of splats that the shape needs. With it, disks protrude from the curved surface by at most half a pixel
    /// in an image of 1024², on average. At most 2,000,000, even if that isn't enough.
    pub shape: usize,
    /// Number of splats that the colours need at an even density; 0 if 5,000 splats suffice. With it, colours vary by
    /// 0.03 (RMS, linear light) inside the square that a splat represents. At most 2,000,000, and no more than there
    /// are texels (but at least 5,000), even if that isn't enough.
    pub colors: usize,
    /// Number of splats made, 5,000 to 2,000,000: the larger of [`Self::shape`] and [`Self::colors`], or fewer if
    /// splats are closer only where colours vary.
    pub splats: usize,
}

impl Detail {
    /// Computes the number of splats that a mesh needs for its shape and colours, and their density.
    pub(crate) fn new(geometry: &Geometry, smooth: &Smooth) -> (Self, Density) {
        let area = geometry.total_area();
        let splats = |spacing: f64| (area / (spacing * spacing)).min(SPLATS.1);
        let squares = squared_curvatures(geometry, smooth);
        let sum: f64 = geometry.areas.iter().zip(&squares).map(|(a, of)| a * of.iter().sum::<f64>()).sum();
        let mean = sum / (3.0 * area);
        let shape = splats(asked(RIM * geometry.extent, mean)) as usize;
        let colors = if geometry.is_painted() { colors(geometry, area) } else { 0 };
        let least = (shape as f64).clamp(SPLATS.0, SPLATS.1);
        let even = least.max(colors as f64).min(SPLATS.1);
        if even > least {
            let density = Density::by_colors(geometry, (area / least).sqrt(), VARIATION);
            let splats = density.splats(geometry).iter().sum::<f64>().ceil();
            if splats < (MAX_UNEVEN_FRACTION * even).min(MAX_UNEVEN) {
                return (Self { shape, colors, splats: splats as usize }, density);
            }
        }
        (Self { shape, colors, splats: even as usize }, Density::even(geometry, (area / even.floor()).sqrt()))
    }
}

/// Returns the distance between splats at which the rims (edges) of their disks protrude by `rim` from a surface of
/// this squared curvature. The rim of a disk with radius r is r²κ/2 away from a surface of curvature κ.
fn asked(rim: f64, squared_curvature: f64) -> f64 {
    (2.0 * rim / squared_curvature.sqrt()).sqrt() / radii::DENSITY
}

/// Returns the number and the density of splats for [`super::MeshMethod::Adaptive`]. Where disks would protrude from
/// the surface by more than a third of a pixel in an image of 1024², splats are denser. If that would add only few
/// splats ([`FEW_MORE`]) or need too many ([`MAX_UNEVEN`]), the result is instead `count` splats of uniform density.
pub(crate) fn adaptive(geometry: &Geometry, smooth: &Smooth, count: usize) -> (usize, Density) {
    let spacing = (geometry.total_area() / count as f64).sqrt();
    // The surface may bend in one direction only.
    let squares: Vec<f64> = squared_curvatures(geometry, smooth).iter().map(|of| of[0].max(of[1]).max(of[2])).collect();
    let asked = |squared: f64| asked(THIN_RIM * geometry.extent, squared).max(FINEST * spacing);
    let more = |face: usize| geometry.areas[face] * (asked(squares[face]).powi(-2) - spacing.powi(-2)).max(0.0);
    let more: f64 = (0..squares.len()).map(more).sum();
    if more > FEW_MORE * count as f64 {
        let density = Density::by_curvature(geometry, spacing, &squares, &asked);
        let splats = density.splats(geometry).iter().sum::<f64>().ceil();
        if splats < MAX_UNEVEN {
            return (splats as usize, density);
        }
    }
    (count, Density::even(geometry, spacing))
}

/// Returns the squared curvature along each edge of each face: the rate at which the smooth normal turns, in radians
/// per unit of length. Creases are ignored. 0 for faces without area.
fn squared_curvatures(geometry: &Geometry, smooth: &Smooth) -> Vec<[f64; 3]> {
    let squared = |face: usize| {
        let (p, n) = (geometry.corners(face), &smooth.corner_normals[face]);
        [(0, 1), (1, 2), (2, 0)].map(|(i, j)| {
            let square = n[i].distance_squared(n[j]) / p[i].distance_squared(p[j]);
            if geometry.areas[face] > 0.0 { square } else { 0.0 }
        })
    };
    (0..geometry.areas.len()).map(squared).collect()
}

/// Returns the number of evenly spread splats at which colours vary by [`VARIATION`] inside a splat's square; 0 if they
/// vary less at the smallest number of splats. The result is at most the number of texels or the largest number of
/// splats ([`SPLATS`]), even if colours then vary more.
fn colors(geometry: &Geometry, area: f64) -> usize {
    let places = stratified(&geometry.areas, PLACES, area, &NoProgress);
    let is_too_coarse = |splats: f64| {
        let side = (area / splats).sqrt();
        let each = map_each(places.len(), &NoProgress, || (), |(), i| variance(geometry, places[i], side));
        each.iter().sum::<f64>() / each.len() as f64 > VARIATION * VARIATION
    };
    let most = texels(geometry).clamp(SPLATS.0, SPLATS.1);
    if !is_too_coarse(SPLATS.0) {
        return 0;
    }
    let mut range = [SPLATS.0.ln(), most.ln()];
    for _ in 0..7 {
        let middle = 0.5 * (range[0] + range[1]);
        range[usize::from(!is_too_coarse(middle.exp()))] = middle;
    }
    range[1].exp() as usize
}

/// Returns the number of texels on the surface, or the largest number of splats if there are no textures.
fn texels(geometry: &Geometry) -> f64 {
    let mesh = geometry.mesh;
    if !mesh.is_textured() {
        return SPLATS.1;
    }
    (0..mesh.triangles.len()).map(|face| geometry.texels(face)).sum()
}

/// Returns the variance of the colours in a square of side `side` around a place on a face, averaged over the channels.
/// The part of the square beyond the face is ignored.
fn variance(geometry: &Geometry, (face, b): (u32, [f64; 3]), side: f64) -> f64 {
    let face = face as usize;
    let (s, t) = orthonormal(geometry.normals[face]);
    let (Some(u), Some(v)) = (geometry.barycentric_change(face, s), geometry.barycentric_change(face, t)) else {
        return 0.0;
    };
    let (mut sum, mut squares, mut count) = ([0.0; 3], [0.0; 3], 0.0);
    for (i, j) in (0..ACROSS).flat_map(|j| (0..ACROSS).map(move |i| (i, j))) {
        let offset = |i: i32| (f64::from(i) + 0.5) / f64::from(ACROSS) - 0.5;
        let at: [f64; 3] = std::array::from_fn(|k| b[k] + (offset(i) * u[k] + offset(j) * v[k]) * side);
        // Beyond an edge, another triangle has the surface, and perhaps another part of the texture.
        if at.iter().all(|b| *b >= 0.0) {
            let color = geometry.color(face, at);
            count += 1.0;
            for c in 0..3 {
                let value = f64::from(color[c]);
                sum[c] += value;
                squares[c] += value * value;
            }
        }
    }
    let of = |c: usize| (squares[c] / count - (sum[c] / count).powi(2)).max(0.0);
    if count > 1.0 { (of(0) + of(1) + of(2)) / 3.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::parts::Sample;
    use crate::mesh::{MeshMethod, MeshOptions, splats_from_mesh};
    use crate::tree::KdTree;
    use crate::tree::Nearest;
    use glam::DVec3;
    use std::sync::Arc;
    use surfel_model::{Column3, Mesh, SplatCloud, Texture};

    const SIDE: usize = 1024;

    /// Returns the unit square with a grey texture whose values in [0, 1] depend on x and y.
    fn square(value: impl Fn(f64, f64) -> f64) -> Mesh {
        let at = |k: usize| (k as f64 + 0.5) / SIDE as f64;
        let texel = |i: usize| {
            let v = surfel_math::srgb::nearest_8_bit(value(at(i % SIDE), at(i / SIDE)) as f32);
            [v, v, v, 255]
        };
        let srgba8 = (0..SIDE * SIDE).map(texel).collect();
        Mesh {
            positions: Column3::from_f64(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            uvs: Some(vec![[0., 0.], [1., 0.], [1., 1.], [0., 1.]]),
            texture: Some(Arc::new(Texture { width: SIDE as u32, height: SIDE as u32, srgba8 })),
            ..Mesh::default()
        }
    }

    /// Returns the grey value of a texture with stripes in a fifth of the square.
    fn stripes(x: f64, _: f64) -> f64 {
        if x < 0.2 { ((x * 50.0).floor() % 2.0) * 0.9 + 0.05 } else { 0.5 }
    }

    /// Returns the smallest sum of splat weights, Σw, of a cloud over the square.
    fn least_weight(cloud: &SplatCloud) -> f64 {
        let tree = KdTree::new(&(0..cloud.len()).map(|i| cloud.center(i)).collect::<Vec<_>>());
        let mut found = Nearest::within(64, f64::INFINITY);
        let places = (0..250_000).map(|i| DVec3::new(f64::from(i % 500) + 0.5, f64::from(i / 500) + 0.5, 0.0) / 500.0);
        let mut sum = |place: DVec3| -> f64 {
            tree.nearest(place, &mut found);
            let rho_squared =
                |(square, slot): &(f64, u32)| square / cloud.radius_max(tree.index(*slot as usize)).powi(2);
            let within = found.items().iter().map(rho_squared).filter(|r| *r <= 1.0);
            within.map(|r| surfel_math::kernel::weight(r, 2.0)).sum()
        };
        places.map(&mut sum).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn splats_are_closer_where_colours_vary_and_leave_no_gap() {
        let mesh = square(stripes);
        let geometry = Geometry::new(&mesh);
        let (detail, density) = Detail::new(&geometry, &geometry.smooth());
        assert!(detail.shape == 0 && 2 * detail.splats < detail.colors, "{detail:?}");
        let (cloud, report) = splats_from_mesh(&mesh, &MeshOptions::new(MeshMethod::Detail), &NoProgress).unwrap();
        assert_eq!((cloud.len(), report.detail), (detail.splats, Some(detail)));
        let centers: Vec<DVec3> = (0..cloud.len()).map(|i| cloud.center(i)).collect();
        let even = MeshOptions::new(MeshMethod::Count(detail.splats));
        let (even, _) = splats_from_mesh(&mesh, &even, &NoProgress).unwrap();
        let [least, of_even] = [&cloud, &even].map(least_weight);
        println!("least Σw {least}, of even splats {of_even}; {detail:?}");
        assert!(least > 0.8 * of_even, "{least} {of_even}");
        // The density's number of splats, both where the texture is striped and elsewhere.
        let (parts, expected) = (density.parts(), density.splats(&geometry));
        let spacing = [(0.02, 0.18), (0.6, 1.0)].map(|(low, high)| {
            let made = centers.iter().filter(|p| (low..high).contains(&p.x)).count() as f64;
            let is_within = |part: &usize| (low..high).contains(&parts.place(*part, [1.0 / 3.0; 3]).place(&geometry).x);
            let expected: f64 = (0..parts.len()).filter(is_within).map(|part| expected[part]).sum();
            assert!((made / expected - 1.0).abs() < 0.05, "{low} to {high}: {made} of {expected}");
            ((high - low) / made).sqrt()
        });
        assert!(spacing[0] < 0.4 * spacing[1], "{spacing:?}");
        // The distance grows no faster than the grade allows, plus one part's step.
        let near = |x: f64| density.at(&Sample::at(&geometry, 0, DVec3::new(x, 0.1 * x, 0.0)));
        let step = density.coarsest;
        for x in (0..300).map(|i| 0.05 + 0.003 * f64::from(i)) {
            let grown = (near(x + step) - near(x)).abs();
            assert!(grown < 0.45 * step, "{x}: {} to {}", near(x), near(x + step));
        }
    }

    #[test]
    fn splats_are_as_far_apart_everywhere_where_colours_vary_alike() {
        let all = square(|x, y| 0.5 + 0.4 * (60.0 * x).sin() * (60.0 * y).sin());
        let none = square(|_, _| 0.5);
        for (mesh, painted) in [(all, true), (none, false)] {
            let geometry = Geometry::new(&mesh);
            let (detail, density) = Detail::new(&geometry, &geometry.smooth());
            assert!(density.is_even(), "{detail:?}");
            assert_eq!(detail.splats, detail.colors.max(5000));
            assert_eq!(detail.colors > 5000, painted, "{detail:?}");
        }
    }
}
