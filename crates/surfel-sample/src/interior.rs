//! Estimation of the interior weight: the sum of splat weights (Σw) inside a cloud's own surface. A *probe* is a line
//! along a splat's normal, along which the weights of all splats are summed. A *cell* is a cube of the grid that finds
//! the splats close to probes.

use crate::parallel::map_tasks;
use crate::tree::KdTree;
use glam::DVec3;
use std::collections::HashMap;
use surfel_math::basis::orthonormal;
use surfel_model::{Shape, SplatCloud};

/// Maximum number of probes: lines, each along the normal of one splat, along which Σw is measured.
const PROBES: usize = 4096;
/// Number of splats per parallel task. The number is fixed, so that the order of summation doesn't depend on the number
/// of threads.
const CHUNK: usize = 1 << 14;

/// Largest mean number of probes that a splat may meet. If more disks overlap, as with slivers around one corner, fewer
/// splats are probed. Otherwise the work would grow with the product of splats and probes.
const MAX_MEAN_PROBES: usize = 256;
/// Number of splats for which the probes they meet are counted, to check [`MAX_MEAN_PROBES`].
const EXAMINED: usize = 256;

/// Smallest number of splats of a cloud for which a grid first excludes splats far from all probes.
const MIN_GRID_SPLATS: usize = 16 * PROBES;

/// Line along a splat's unit normal, along which the weights of all splats are summed. The line passes through `at`,
/// the splat's centre plus half of both half-axes. Only splats whose planes it meets within `reach` of `at` count;
/// `reach` is the splat's larger half-axis.
struct Probe {
    at: DVec3,
    normal: DVec3,
    reach: f64,
}

/// Computes the interior weight: Σw inside the cloud's own surface at cutoff 2, as defined in rendering model §5
/// (coverage).
///
/// The weight is the lower median of m = min(n, 4096) sums, one for each splat k = ⌊i·n/m⌋, i < m, of the n splats. The
/// sum for splat k adds the weights of all splats j (also k) at the point p_k + ½s_k + ½t_k. The point is projected
/// onto splat j along the normal of splat k. Here p is a splat's centre, and s and t are its half-axes.
/// Splat j counts if both normals agree within 60°, and if the projection moves the point by at most the larger
/// half-axis of splat k. Clips are ignored. The weight is dimensionless. Returns `None` for an empty cloud, for balls,
/// and if the median isn't positive and finite.
///
/// If the lines of more than 256 probes on average may meet a splat, m is reduced in proportion, as the rendering model
/// defines.
///
/// A tree stores only the probes, not the splats, which limits memory; all splats are tested against the tree.
pub fn interior_weight(cloud: &SplatCloud) -> Option<f64> {
    let count = cloud.len();
    if cloud.is_balls() {
        return None;
    }
    let probes = Probes::few_enough(cloud);
    let nearby = if count < MIN_GRID_SPLATS { None } else { ProbeGrid::of(&probes.places(), &probes.reach()) };

    let partial = map_tasks(count.div_ceil(CHUNK), |chunk| {
        let mut sums = vec![0.0; probes.all.len()];
        for j in chunk * CHUNK..count.min((chunk + 1) * CHUNK) {
            // Relative to the origin: adding the origin would cost digits.
            let center = cloud.data().centers.get(j);
            // An upper bound of the radius that is cheap to compute.
            let bound = match &cloud.data().shape {
                Shape::Disks { .. } | Shape::Balls { .. } => cloud.radius_max(j),
                Shape::Ellipses { s, t } => (s.get(j).length_squared() + t.get(j).length_squared()).sqrt(),
            };
            if nearby.as_ref().is_some_and(|nearby| !nearby.may_meet(center, bound)) {
                continue;
            }
            let splat = Splat::of(cloud, j, center, cloud.radius_max(j));
            probes.visit(&splat, &mut |i| sums[i] += splat.weight(&probes.all[i]));
        }
        sums
    });
    let mut sums = vec![0.0; probes.all.len()];
    for chunk in partial {
        sums.iter_mut().zip(chunk).for_each(|(sum, part)| *sum += part);
    }
    let mut sums: Vec<f64> = probes.of.iter().map(|probe| sums[*probe]).collect();
    crate::radii::median(&mut sums).filter(|w| w.is_finite() && *w > 0.0)
}

/// Probes of a cloud, in a tree by which the probes that a splat meets are found.
struct Probes {
    /// Different probes. Splats in the same place have equal probes, which are stored once.
    all: Vec<Probe>,
    /// Index in `all` of each requested probe, including repeated ones.
    of: Vec<usize>,
    tree: KdTree,
    /// Bounds of the probes below each node of the tree.
    bounds: Vec<ProbeBounds>,
}

impl Probes {
    /// Creates the probes of `m` splats, spread evenly over the cloud.
    fn new(cloud: &SplatCloud, m: usize) -> Self {
        let (all, of) = distinct((0..m).map(|i| probe(cloud, nth(i, m, cloud.len()))).collect());
        let tree = KdTree::new(&all.iter().map(|p| p.at).collect::<Vec<_>>());
        let reach: Vec<f64> = all.iter().map(|p| p.reach).collect();
        let bounds = tree.bounds_below().into_iter().zip(tree.largest_below(&reach));
        Self { bounds: bounds.map(|(ends, reach)| ProbeBounds::new(ends, reach)).collect(), tree, all, of }
    }

    /// Creates as many probes as the interior weight needs, or fewer if splats meet too many of them.
    fn few_enough(cloud: &SplatCloud) -> Self {
        let m = cloud.len().min(PROBES);
        let probes = Self::new(cloud, m);
        let examined = cloud.len().min(EXAMINED);
        let met = map_tasks(examined, |i| {
            let j = nth(i, examined, cloud.len());
            let splat = Splat::of(cloud, j, cloud.data().centers.get(j), cloud.radius_max(j));
            let mut met = 0;
            probes.visit(&splat, &mut |i| {
                let Probe { at, reach, .. } = probes.all[i];
                met += usize::from(splat.may_meet(&ProbeBounds::new((at, at), reach)));
            });
            met
        });
        let (met, most) = (met.iter().sum::<usize>(), MAX_MEAN_PROBES * examined);
        if met <= most { probes } else { Self::new(cloud, (m * most).div_ceil(met)) }
    }

    /// Calls `visit` with the index in `all` of every probe whose line may meet a splat. Some other probes are visited
    /// too.
    fn visit(&self, splat: &Splat, visit: &mut impl FnMut(usize)) {
        let enters = |node: usize| splat.may_meet(&self.bounds[node]);
        self.tree.visit_below(&enters, &mut |slot| visit(self.tree.index(slot)));
    }

    fn places(&self) -> Vec<DVec3> {
        self.all.iter().map(|p| p.at).collect()
    }

    fn reach(&self) -> Vec<f64> {
        self.all.iter().map(|p| p.reach).collect()
    }
}

/// Axis-aligned box around the places of some probes, and the largest of their reaches.
struct ProbeBounds {
    /// Centre of the box.
    middle: DVec3,
    /// Half of the box's size along each axis.
    half: DVec3,
    /// Largest [`Probe::reach`] of the probes.
    reach: f64,
    /// Length, in object units, by which tests are widened for rounding, also of the coordinates themselves.
    /// [`Splat::tolerance`] is added to it.
    tolerance: f64,
}

impl ProbeBounds {
    /// Creates the bounds of probes between the corners `low` and `high` whose reaches are at most `reach`.
    fn new((low, high): (DVec3, DVec3), reach: f64) -> Self {
        let tolerance = 1e-9 * reach + 1e-14 * low.abs().max(high.abs()).max_element();
        Self { middle: 0.5 * (low + high), half: 0.5 * (high - low), reach, tolerance }
    }
}

/// Returns the index of the i-th of `m` splats that are spread evenly over `count` splats.
fn nth(i: usize, m: usize, count: usize) -> usize {
    (i as u128 * count as u128 / m as u128) as usize
}

/// Set of the grid cells that are close to probes, by which most splats are excluded. In a large cloud, most splats are
/// far from all probes and need no exact test.
struct ProbeGrid {
    /// Side of a grid cell, which is also the largest radius of splats that the grid can exclude.
    side: f64,
    /// Hash table with one bit per cell, set if the cell is close to a probe.
    cells: Vec<u64>,
}

impl ProbeGrid {
    /// Number of bits of a cell's hash. The table has 512 KiB, and about 500,000 cells are usually close to probes.
    const BITS: u32 = 22;
    /// Maximum number of cells along a probe's reach; about five are usual.
    const MAX_ALONG: i64 = 16;

    /// Marks the cells close to probes at `places` with these reaches. `None` without probes, and if the reaches vary
    /// too much for one grid.
    fn of(places: &[DVec3], reach: &[f64]) -> Option<Self> {
        let side = 1.5 * crate::radii::median(&mut reach.to_vec())?;
        let mut nearby = Self { side, cells: vec![0; 1 << (Self::BITS - 6)] };
        for (place, reach) in places.iter().zip(reach) {
            // A margin that covers rounding.
            let apart = (reach + side) * (1.0 + 1e-6) + place.abs().max_element() * 1e-15;
            let [lo, hi] = [nearby.cell(*place - apart), nearby.cell(*place + apart)];
            if (0..3).any(|k| hi[k].saturating_sub(lo[k]) > Self::MAX_ALONG) {
                return None;
            }
            for z in lo[2]..=hi[2] {
                for y in lo[1]..=hi[1] {
                    for x in lo[0]..=hi[0] {
                        let bit = Self::bit([x, y, z]);
                        nearby.cells[bit >> 6] |= 1 << (bit & 63);
                    }
                }
            }
        }
        Some(nearby)
    }

    fn cell(&self, p: DVec3) -> [i64; 3] {
        (p / self.side).floor().to_array().map(|c| c as i64)
    }

    fn bit(cell: [i64; 3]) -> usize {
        // Odd factors with well-mixed bits, as in multiplicative hashing (Knuth, TAOCP 3, §6.4).
        const FACTORS: [u64; 3] = [0x9e37_79b9_7f4a_7c15, 0xc2b2_ae3d_27d4_eb4f, 0x1656_67b1_9e37_79f9];
        let mixed = cell.iter().zip(FACTORS).fold(0_u64, |h, (c, f)| (h ^ *c as u64).wrapping_mul(f).rotate_left(29));
        (mixed.wrapping_mul(FACTORS[0]) >> (64 - Self::BITS)) as usize
    }

    /// True if a probe's line may meet a splat with this centre and radius; false only if none can.
    #[inline]
    fn may_meet(&self, center: DVec3, radius: f64) -> bool {
        let bit = Self::bit(self.cell(center));
        radius > self.side || self.cells[bit >> 6] >> (bit & 63) & 1 == 1
    }
}

/// Merges equal probes. Returns the different probes, and the index of each given probe's equal among them. Equal
/// probes have equal sums.
fn distinct(probes: Vec<Probe>) -> (Vec<Probe>, Vec<usize>) {
    let mut known = HashMap::with_capacity(probes.len());
    let mut different = Vec::with_capacity(probes.len());
    let mut of = Vec::with_capacity(probes.len());
    for probe in probes {
        let (p, n) = (probe.at.to_array().map(f64::to_bits), probe.normal.to_array().map(f64::to_bits));
        of.push(*known.entry((p, n, probe.reach.to_bits())).or_insert_with(|| {
            different.push(probe);
            different.len() - 1
        }));
    }
    (different, of)
}

fn probe(cloud: &SplatCloud, k: usize) -> Probe {
    let (s, t) = cloud.axes(k);
    Probe { at: cloud.data().centers.get(k) + 0.5 * (s + t), normal: cloud.normal(k), reach: cloud.radius_max(k) }
}

/// Splat prepared for intersection with the probes' lines.
struct Splat {
    center: DVec3,
    radius: f64,
    normal: DVec3,
    axes: Axes,
    /// Unit directions of both half-axes, and the splat's extent along each: the largest distance from its centre.
    sides: [(DVec3, f64); 2],
    /// Length, in object units, by which tests are widened for rounding, also of the coordinates themselves.
    /// [`ProbeBounds::tolerance`] is added to it.
    tolerance: f64,
}

/// Axes of a splat, by which a point in its plane is converted to (u, v), its coordinates in units of the half-axes.
enum Axes {
    /// Axes of a disk: unit vectors and the radius.
    Disk { s: DVec3, t: DVec3, r: f64 },
    /// Half-axes of an ellipse, each divided by its largest absolute coordinate, and these two coordinates as `scales`.
    Ellipse { s: DVec3, t: DVec3, scales: [f64; 2] },
}

impl Splat {
    #[inline(always)]
    fn of(cloud: &SplatCloud, j: usize, center: DVec3, radius: f64) -> Self {
        let normal = cloud.normal(j);
        let axes = match &cloud.data().shape {
            Shape::Disks { .. } | Shape::Balls { .. } => {
                let (s, t) = orthonormal(normal);
                Axes::Disk { s, t, r: radius }
            }
            Shape::Ellipses { s, t } => {
                let (s, t) = (s.get(j), t.get(j));
                let (a, b) = (s.abs().max_element(), t.abs().max_element());
                Axes::Ellipse { s: s / a, t: t / b, scales: [a, b] }
            }
        };
        let (s, t) = cloud.axes(j);
        let sides = [s, t].map(|axis| {
            let side = surfel_math::basis::unit(axis);
            (side, s.dot(side).hypot(t.dot(side)))
        });
        let tolerance = 1e-9 * radius + 1e-14 * center.abs().max_element();
        Self { center, radius, normal, axes, sides, tolerance }
    }

    /// True if the line of a probe within these bounds may meet the splat; false only if none can.
    ///
    /// A line that meets the splat starts at a height of at most the probe's reach over the splat's plane, and at most
    /// 60° off its normal. The start is therefore within √3 heights of the ellipse. The test excludes most probes for a
    /// sliver; a test by the splat's bounding ball would accept all probes of a fan.
    #[inline(always)]
    fn may_meet(&self, bounds: &ProbeBounds) -> bool {
        let tolerance = self.tolerance + bounds.tolerance;
        let middle = bounds.middle - self.center;
        let beyond = (middle.abs() - bounds.half).max(DVec3::ZERO);
        if beyond.length_squared() > (self.radius + bounds.reach + tolerance).powi(2) {
            return false;
        }
        // Distance of the bounds' middle from the centre along a direction, and the bounds' half-extent.
        let ends = |n: DVec3| (middle.dot(n).abs(), bounds.half.dot(n.abs()));
        let (height, thickness) = ends(self.normal);
        let aside = 3f64.sqrt() * (height + thickness).min(bounds.reach) + tolerance;
        let is_near = |(side, length): &(DVec3, f64)| {
            let (along, reach) = ends(*side);
            along - reach <= length + aside
        };
        height - thickness <= bounds.reach + tolerance && self.sides.iter().all(is_near)
    }

    /// Returns the splat's weight where the probe's line meets its plane. It is 0 if the line misses the splat, if it
    /// meets the plane beyond [`Probe::reach`], and if the normals differ by more than 60°.
    fn weight(&self, probe: &Probe) -> f64 {
        let d = probe.at - self.center;
        if d.length_squared() > (self.radius + probe.reach).powi(2) {
            return 0.0;
        }
        let facing = self.normal.dot(probe.normal);
        if facing < 0.5 {
            return 0.0;
        }
        let along = -self.normal.dot(d) / facing;
        if along.abs() > probe.reach {
            return 0.0;
        }
        let hit = d + along * probe.normal;
        let rho2 = match &self.axes {
            Axes::Disk { s, t, r } => (hit.dot(*s) / r).powi(2) + (hit.dot(*t) / r).powi(2),
            Axes::Ellipse { s, t, scales: [a, b] } => {
                // Solves hit = u s + v t in the plane by ratios of areas, with lengths scaled out.
                let m = s.cross(*t);
                let scale = m.length_squared();
                (hit.cross(*t).dot(m) / scale / a).powi(2) + (s.cross(hit).dot(m) / scale / b).powi(2)
            }
        };
        if rho2 <= 1.0 { (-2.0 * rho2).exp() } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_that_are_sifted_out_meet_no_probe() {
        let mut random = crate::mesh::random::Random::new(11);
        for offset in [0.0, 1e7, -3e12] {
            let mut at = || DVec3::new(random.unit(), random.unit(), 0.1 * random.unit()) + offset;
            let places: Vec<DVec3> = (0..300).map(|_| at()).collect();
            let centers: Vec<DVec3> = (0..20_000).map(|_| at()).collect();
            let reach: Vec<f64> = (0..300).map(|_| 0.004 * (0.5 + 2.0 * random.unit())).collect();
            let nearby = ProbeGrid::of(&places, &reach).unwrap();
            let mut kept = 0;
            for center in centers {
                let radius = 0.004 * (0.5 + 2.0 * random.unit());
                kept += usize::from(nearby.may_meet(center, radius));
                let meets = places.iter().zip(&reach).any(|(p, r)| (*p - center).length() <= r + radius);
                assert!(!meets || nearby.may_meet(center, radius), "{center} {radius}");
            }
            // At 3e12, coordinates have steps of 5e-4; otherwise the results are the same.
            assert!(kept < 10_000, "{offset}: {kept}");
        }
        // Lengths that differ too much for a grid give none.
        assert!(ProbeGrid::of(&[DVec3::ZERO; 3], &[1.0, 1.0, 100.0]).is_none());
    }

    /// Computes the interior weight from all pairs of splats and probes.
    fn by_all_pairs(cloud: &SplatCloud) -> f64 {
        let probes: Vec<Probe> = (0..cloud.len()).map(|k| probe(cloud, k)).collect();
        let splats: Vec<Splat> =
            (0..cloud.len()).map(|j| Splat::of(cloud, j, cloud.data().centers.get(j), cloud.radius_max(j))).collect();
        let mut sums: Vec<f64> = probes.iter().map(|probe| splats.iter().map(|s| s.weight(probe)).sum()).collect();
        crate::radii::median(&mut sums).unwrap()
    }

    #[test]
    fn weight_is_that_of_all_pairs() {
        let mut random = crate::mesh::random::Random::new(23);
        // Rough surfaces of round splats and slivers, axis-aligned and slanted, also far from the origin.
        for (offset, thin, rough) in [(0.0, 1.0, 0.0), (0.0, 0.01, 0.05), (1e4, 0.02, 0.3), (0.0, 0.3, 1.0)] {
            let mut vector = |scale: f64| DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 * scale - scale;
            let mut columns: [Vec<glam::Vec3>; 3] = Default::default();
            for _ in 0..1500 {
                let place = vector(1.0) * DVec3::new(1.0, 1.0, rough) + offset;
                let s = DVec3::new(1.0, 0.7, 0.0) + vector(rough);
                let t = s.cross(DVec3::Z + vector(rough)) * thin + s * 0.1 * thin;
                let [centers, first, second] = &mut columns;
                centers.push(place.as_vec3());
                first.push((s * 0.3).as_vec3());
                second.push((t * 0.3).as_vec3());
            }
            let [centers, s, t] = columns;
            let cloud = SplatCloud::ellipses(&centers, &s, &t).unwrap();
            assert_eq!(interior_weight(&cloud), Some(by_all_pairs(&cloud)), "{offset} {thin} {rough}");
        }
    }

    #[test]
    fn splats_of_a_fan_meet_few_probes() {
        let work = |count: u32| {
            let direction = |i: f64| (6.2 * i / f64::from(count)).sin_cos();
            let spokes = (0..count).map(|i| direction(f64::from(i) + 0.5));
            let spokes: Vec<glam::Vec3> = spokes.map(|(y, x)| DVec3::new(x, y, 0.0).as_vec3()).collect();
            let centers: Vec<glam::Vec3> = spokes.iter().map(|s| *s * 0.66).collect();
            let s: Vec<glam::Vec3> = spokes.iter().map(|s| *s * 0.73).collect();
            let t: Vec<glam::Vec3> = spokes.iter().map(|s| glam::Vec3::Z.cross(*s) * (4.0 / count as f32)).collect();
            let cloud = SplatCloud::ellipses(&centers, &s, &t).unwrap();
            let probes = Probes::new(&cloud, cloud.len());
            let mut visited = 0;
            for j in 0..cloud.len() {
                let splat = Splat::of(&cloud, j, cloud.data().centers.get(j), cloud.radius_max(j));
                probes.visit(&splat, &mut |_| visited += 1);
            }
            visited
        };
        let work = [500, 1000, 2000, 4000].map(work);
        assert!(work.windows(2).all(|w| w[1] <= 23 * w[0] / 10) && work[3] < 100 * 4000, "{work:?}");
    }

    /// Returns disks that all contain the origin, turned in all directions or like the pages of a book.
    fn crowd(count: u32, is_book: bool) -> SplatCloud {
        let mut random = crate::mesh::random::Random::new(31);
        let mut vector = || DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        let mut columns: [Vec<glam::Vec3>; 3] = Default::default();
        for i in 0..count {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
            let (s, t) = if is_book {
                (DVec3::new(cos, sin, 0.0), DVec3::Z)
            } else {
                let s = vector();
                (s.normalize(), 0.3 * s.cross(vector()).normalize())
            };
            let [centers, first, second] = &mut columns;
            centers.push((s * 0.3).as_vec3());
            first.push(s.as_vec3());
            second.push(t.as_vec3());
        }
        let [centers, s, t] = columns;
        SplatCloud::ellipses(&centers, &s, &t).unwrap()
    }

    #[test]
    fn crowded_splats_are_compared_with_few_probes() {
        for is_book in [false, true] {
            let work = [500, 1000, 2000, 4000, 8000].map(|count| {
                let cloud = crowd(count, is_book);
                let probes = Probes::few_enough(&cloud);
                let mut visited = 0;
                for j in 0..cloud.len() {
                    let splat = Splat::of(&cloud, j, cloud.data().centers.get(j), cloud.radius_max(j));
                    probes.visit(&splat, &mut |_| visited += 1);
                }
                visited
            });
            assert!(work.windows(2).skip(1).all(|w| w[1] <= 23 * w[0] / 10), "{is_book}: {work:?}");
            assert!(work[4] < 2 * MAX_MEAN_PROBES * 8000, "{is_book}: {work:?}");
            // All splats are probed where they are few, and fewer give nearly the same median.
            let (few, many) = (crowd(250, is_book), crowd(4000, is_book));
            assert_eq!(interior_weight(&few), Some(by_all_pairs(&few)));
            let (weight, all) = (interior_weight(&many).unwrap(), by_all_pairs(&many));
            assert!((weight / all - 1.0).abs() < 0.1, "{is_book}: {weight} {all}");
        }
    }

    #[test]
    fn splats_in_one_place_are_probed_once() {
        let place = |i: usize| if i < 3000 { glam::Vec3::ZERO } else { glam::Vec3::X * i as f32 };
        let centers: Vec<glam::Vec3> = (0..3020).map(place).collect();
        let cloud = SplatCloud::disks(&centers, &vec![glam::Vec3::Z; 3020], &vec![0.25; 3020]).unwrap();
        let probes = || (0..3020).map(|k| probe(&cloud, k)).collect::<Vec<_>>();
        let (different, of) = distinct(probes());
        // One of 3000 and twenty others: 21 probes, and thus few pairs instead of nine million.
        assert_eq!((different.len(), of.len()), (21, 3020));
        assert!(of.iter().zip(probes()).all(|(d, p)| different[*d].at == p.at && different[*d].reach == p.reach));
        // exp(−2ρ²) at (½, ½) is exp(−1), for each of 3000 splats.
        let weight = interior_weight(&cloud).unwrap();
        assert!((weight - 3000.0 * (-1.0_f64).exp()).abs() < 1e-6 * weight, "{weight}");
    }
}
