//! Localisation of the edge between two surfaces, from the points around it.
//!
//! The weights of splats locate an edge well only if the density of points is even. The points themselves locate it
//! better. Each point is on the upper or the lower surface, and gets the value +1 or −1. The linear function of x and y
//! that best fits these values around a pixel is zero at the edge. It is fitted by moving least squares (Lancaster and
//! Šalkauskas 1981) with Gaussian weights. Wide weights locate a straight edge more precisely but lose small details.
//! The fit uses the widest scale at which the function has the right sign at nearly all points.
//!
//! Points beneath a surface, such as a road under a bridge, give no evidence of its edges. There, the edge is located
//! by the upper points alone (`outline.rs`).

use super::edge::Edge;
use super::outline::{self, WINDOW};
use rayon::prelude::*;
use surfel_model::SplatCloud;

/// Standard deviations of the Gaussian weights in the fit, in radii of nearby splats; the widest one that fits is used,
/// or the narrowest if none fits. A radius is about 1.6 point spacings.
const SCALES: [f64; 4] = [1.3, 0.8, 0.5, 0.3];
/// Distance from a pixel, in standard deviations, beyond which a point has no weight in the fit.
const REACH: f64 = 2.5;
/// Largest fraction of the points' total squared weight that points with a wrong sign of the fitted function may have.
/// With more, the next narrower scale is tried.
const WRONG: f64 = 0.05;
/// Factor of the fitted function's value in the coverage, which is ½ + `STEEPNESS`·scale·value, with the scale from
/// [`SCALES`]. A step between evenly distributed points is fitted by a function that rises more slowly than the step.
/// Its slope decreases with the width of the weights.
const STEEPNESS: f64 = 4.4;
/// Weight that pulls the fitted function's slopes to 0, as a fraction of the points' total weight, placed at a distance
/// of one standard deviation. Without this weight, the slopes would be undetermined for few points and for points on a
/// line.
const LEVEL: f64 = 2e-3;
/// Maximum side, in splat radii, of a square of pixels for which the edge between two surfaces is located only once, to
/// save time. Compared with locating it at every pixel, the RMSE of surface models changes by 1 %.
const SQUARE: f64 = 0.8;
/// Maximum side, in splat radii, of a square of pixels for which an edge is located only once, if it is located by the
/// upper points alone. It is smaller than [`SQUARE`], because this coverage isn't linear.
const OUTLINE_SQUARE: f64 = 0.4;
/// Average number of points per cell for which the cell size of the search grid is chosen. Cells aren't larger than the
/// mean radius of the splats, unless [`MAX_CELLS`] requires it.
const CELL_POINTS: f64 = 2.0;
/// Number of points near a pixel above which only every k-th one is used to locate the edge. Because each row of grid
/// cells is thinned by itself, at most one more point per row remains.
const MAX_POINTS: usize = 1024;
/// Maximum number of cells of the search grid along each axis.
const MAX_CELLS: f64 = 4096.0;
/// Smallest probability with which a point counts as lying beneath another surface. A point of the same surface that
/// exceeds [`WELL_BENEATH`] must also be near.
const BENEATH: f32 = 0.5;
/// Smallest probability of lying beneath another surface with which a point shows that the lower surface continues
/// there. Upper points must also enclose the point; they don't enclose points in a pit that is two points wide.
const WELL_BENEATH: f32 = 0.97;
/// Largest gap in height within a layer of foliage, in splat radii. If the heights of leaves vary by two spacings, gaps
/// of one radius are common, and gaps of two are rare.
const LINKED: f64 = 3.0;

#[derive(Clone, Copy)]
struct Point {
    at: [f64; 2],
    z: f32,
    radius: f32,
    /// Index of the point's cloud among the block's clouds.
    cloud: u32,
    /// Index of the point's splat in its cloud.
    splat: u32,
    /// True if the splat was made from a foliage point.
    is_foliage: bool,
}

/// Centres of a block's splats, sorted into square cells, for locating edges between surfaces.
pub(crate) struct EdgeLocator {
    points: Vec<Point>,
    /// Index in `points` of each cell's first point, row by row. The last entry is the number of points.
    starts: Vec<u32>,
    /// Flag per point, true if the point is probably beneath another surface ([`Self::all_beneath`]).
    beneath: Vec<bool>,
    least: [f64; 2],
    cell: f64,
    cells: [usize; 2],
    /// Half-width of a square around a position, in the units of x and y, above which the search for the position's
    /// nearest point ends: [`REACH`] times the largest radius of a splat.
    reach: f64,
}

impl EdgeLocator {
    /// Collects the splats within `bounds`: minimum x, minimum y, maximum x, maximum y. `is_foliage` returns true if a
    /// cloud's splat is foliage. `beneath` is called with the indices of cloud and splat, for each splat that is almost
    /// certainly beneath a surface.
    pub(crate) fn new<'a>(
        clouds: impl Iterator<Item = &'a SplatCloud>,
        is_foliage: impl Fn(usize, usize) -> bool + Sync,
        bounds: [f64; 4],
        mut beneath: impl FnMut(usize, usize),
    ) -> Self {
        let [x0, y0, x1, y1] = bounds;
        let within = |p: &Point| p.at[0] >= x0 && p.at[0] <= x1 && p.at[1] >= y0 && p.at[1] <= y1;
        let mut points: Vec<Point> = Vec::new();
        for (cloud, k) in clouds.zip(0..) {
            let point = |i: usize| {
                let center = cloud.center(i);
                let radius = cloud.radius_max(i) as f32;
                let is_foliage = is_foliage(k as usize, i);
                Point { at: [center.x, center.y], z: center.z as f32, radius, cloud: k, splat: i as u32, is_foliage }
            };
            points.par_extend((0..cloud.len()).into_par_iter().with_min_len(4096).map(point).filter(within));
        }
        let mut all = Self::sorted(points, bounds);
        let chances = all.all_beneath();
        let told = all.points.iter().zip(&chances).filter(|(_, chance)| **chance > WELL_BENEATH);
        told.for_each(|(p, _)| beneath(p.cloud as usize, p.splat as usize));
        all.beneath = chances.iter().map(|chance| *chance > 0.0).collect();
        all
    }

    fn sorted(points: Vec<Point>, [x0, y0, x1, y1]: [f64; 4]) -> Self {
        let [width, height] = [x1 - x0, y1 - y0];
        let even = (width * height * CELL_POINTS / points.len().max(1) as f64).sqrt();
        // If large parts of the bounds are empty, points are denser than this estimate, and the mean radius limits the
        // cells.
        let mean_radius = points.iter().map(|p| f64::from(p.radius)).sum::<f64>() / points.len().max(1) as f64;
        let cell = even.min(mean_radius).max(width.max(height) / MAX_CELLS);
        let cells = [width, height].map(|side| (side / cell).floor() as usize + 1);
        let (starts, beneath) = (Vec::new(), Vec::new());
        let mut all = Self { points, starts, beneath, least: [x0, y0], cell, cells, reach: 0.0 };
        all.reach = all.points.iter().fold(0.0, |most, p| f64::max(most, REACH * f64::from(p.radius)));
        let of_point = |p: &Point| all.cell_of(1, p.at[1]) * cells[0] + all.cell_of(0, p.at[0]);
        let keys: Vec<usize> = all.points.iter().map(of_point).collect();
        let mut starts = vec![0_u32; cells[0] * cells[1] + 1];
        keys.iter().for_each(|&key| starts[key + 1] += 1);
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        // Within a cell, points retain the order of the splats, so that sums are deterministic.
        let (mut next, mut order) = (starts.clone(), vec![0_u32; keys.len()]);
        for (&key, i) in keys.iter().zip(0..) {
            order[next[key] as usize] = i;
            next[key] += 1;
        }
        let sorted = order.iter().map(|&i| all.points[i as usize]).collect();
        (all.points, all.starts) = (sorted, starts);
        all
    }

    /// Returns, for each point, the probability that it is beneath another surface; 0 if that is at most [`BENEATH`].
    /// It is also 0 unless the point itself or one near it, at nearly the same height, exceeds [`WELL_BENEATH`] and is
    /// enclosed by the upper points.
    fn all_beneath(&self) -> Vec<f32> {
        let chance = |q: &Point| {
            let is_above = |p: &Point| p.z > q.z + p.radius;
            self.chance(q.at[0], q.at[1], q.radius.into(), is_above).map_or((0.0, false), |(edge, encloses)| {
                let chance = edge.share(0.0, 0.0) as f32;
                (chance, chance > WELL_BENEATH && encloses)
            })
        };
        let chances: Vec<(f32, bool)> = self.points.par_iter().with_min_len(1024).map(chance).collect();
        let goes_on = |i: usize| {
            let q = &self.points[i];
            let half = WINDOW * f64::from(q.radius);
            let is_near = |k: &usize| {
                let p = &self.points[*k];
                let squared = (p.at[0] - q.at[0]).powi(2) + (p.at[1] - q.at[1]).powi(2);
                squared < half * half && (p.z - q.z).abs() < q.radius
            };
            let mut near = self.indices_around(q.at[0], q.at[1], half).filter(is_near);
            near.any(|k| chances[k].1)
        };
        let beneath = |i: usize| if chances[i].0 > BENEATH && goes_on(i) { chances[i].0 } else { 0.0 };
        (0..self.points.len()).into_par_iter().with_min_len(1024).map(beneath).collect()
    }

    /// True if the height `z` is within a layer of foliage at a position. `radius` is the radius of splats there. In a
    /// layer, most points above `z` are foliage, and no gap in height is larger than `LINKED` radii.
    pub(crate) fn is_within_foliage(&self, [x, y]: [f64; 2], z: f32, radius: f64) -> bool {
        let half = WINDOW * radius;
        let is_near = |p: &&Point| (p.at[0] - x).powi(2) + (p.at[1] - y).powi(2) < half * half && p.z > z;
        let above = || self.around(x, y, half).filter(is_near);
        let leaves = above().filter(|p| p.is_foliage).count();
        if 2 * leaves <= above().count() {
            return false;
        }
        let mut heights: Vec<f32> = above().map(|p| p.z).collect();
        heights.push(z);
        heights.sort_by(f32::total_cmp);
        heights.windows(2).all(|pair| f64::from(pair[1] - pair[0]) <= LINKED * radius)
    }

    /// Returns, as the coverage of an [`Edge`], the probability that (x, y) is beneath the surface of the points for
    /// which `is_above` is true. The flag is true if nearby points of this surface enclose the position. `radius` is
    /// the radius of splats there. Returns `None` if no point of this surface is nearby.
    fn chance(&self, x: f64, y: f64, radius: f64, is_above: impl Fn(&Point) -> bool) -> Option<(Edge, bool)> {
        let within = |reach: f64| {
            let from_here = self.around(x, y, reach).map(move |p| (p, [p.at[0] - x, p.at[1] - y]));
            from_here.filter(move |(_, [dx, dy])| dx * dx + dy * dy < reach * reach)
        };
        if !within(WINDOW * radius).any(|(p, _)| is_above(p)) {
            return None;
        }
        let add = |(sum, n), (p, _): (&Point, _)| (sum + f64::from(p.radius).powi(-2), n + 1.0);
        let (sum, count): (f64, f64) = within(WINDOW * radius).fold((0.0, 0.0), add);
        let window = WINDOW * (count / sum).sqrt();
        let is_above = &is_above;
        let around = |reach: f64| within(reach).filter(move |(p, _)| is_above(p)).map(|(_, from_here)| from_here);
        Some(outline::chance(window, around))
    }

    fn cell_of(&self, axis: usize, value: f64) -> usize {
        let index = ((value - self.least[axis]) / self.cell).floor();
        (index.max(0.0) as usize).min(self.cells[axis] - 1)
    }

    /// Returns the points in the grid cells that overlap a square around (x, y) with half-width `half`. Of more than
    /// [`MAX_POINTS`], as on a wall seen from above, only a regular selection is returned.
    fn around(&self, x: f64, y: f64, half: f64) -> impl Iterator<Item = &Point> {
        self.indices_around(x, y, half).map(|i| &self.points[i])
    }

    fn indices_around(&self, x: f64, y: f64, half: f64) -> impl Iterator<Item = usize> {
        let [left, right] = [x - half, x + half].map(|x| self.cell_of(0, x));
        let rows = self.cell_of(1, y - half)..=self.cell_of(1, y + half);
        let of_row = move |row: usize| {
            let first = self.starts[row * self.cells[0] + left] as usize;
            first..self.starts[row * self.cells[0] + right + 1] as usize
        };
        let count: usize = rows.clone().map(|row| of_row(row).len()).sum();
        let step = count.div_ceil(MAX_POINTS).max(1);
        rows.flat_map(move |row| of_row(row).step_by(step))
    }

    /// Returns the typical radius of the splats around (x, y): the radius that corresponds to the mean density of the
    /// splats within the nearest splat's radius. If (x, y) is outside of the nearest splat, returns that splat's
    /// radius. Returns `None` if no splat is nearby.
    fn radius_at(&self, x: f64, y: f64) -> Option<f64> {
        let squared = |p: &Point| (p.at[0] - x).powi(2) + (p.at[1] - y).powi(2);
        let mut half = self.cell;
        let nearest = loop {
            let nearest = self.around(x, y, half).min_by(|a, b| squared(a).total_cmp(&squared(b)));
            match nearest.filter(|p| squared(p) <= half * half) {
                Some(nearest) => break nearest,
                None if half > self.reach => return None,
                None => half *= 2.0,
            }
        };
        let radius = f64::from(nearest.radius);
        if squared(nearest) > radius * radius {
            return Some(radius);
        }
        let near = self.around(x, y, radius).filter(|p| squared(p) <= radius * radius);
        let (sum, count) = near.fold((0.0, 0.0), |(sum, n), p| (sum + f64::from(p.radius).powi(-2), n + 1.0));
        Some((count / sum).sqrt())
    }

    /// Returns the side, in pixels (4, 2 or 1), of a square around (x, y) whose pixels can share one edge. `gsd` is the
    /// side of a pixel. `found` is the edge there, if it has been located.
    pub(crate) fn square_px(&self, x: f64, y: f64, gsd: f64, found: Option<Edge>) -> usize {
        let over_radius = if found.is_some_and(|edge| edge.is_logistic) { OUTLINE_SQUARE } else { SQUARE };
        let most = self.radius_at(x, y).unwrap_or(0.0) * over_radius;
        [4, 2].into_iter().find(|px| *px as f64 * gsd <= most).unwrap_or(1)
    }

    /// Locates the edge near (x, y) between an upper surface with the height `upper` and a lower one with the height
    /// `lower`. `near` is a buffer that is reused between calls. Returns `None` if there are no points nearby.
    pub(crate) fn edge(&self, x: f64, y: f64, upper: f64, lower: f64, near: &mut NearbyPoints) -> Option<Edge> {
        let middle = 0.5 * (upper + lower);
        let radius = self.radius_at(x, y)?;
        let reach = SCALES[0] * REACH * radius;
        near.clear();
        let (mut above, mut below) = (false, false);
        let window = WINDOW * radius;
        let mut goes_on = false;
        for i in self.indices_around(x, y, reach) {
            let p = &self.points[i];
            let [dx, dy] = [p.at[0] - x, p.at[1] - y];
            let squared = dx * dx + dy * dy;
            if squared < reach * reach {
                let is_above = f64::from(p.z) > middle;
                if self.beneath[i] && !is_above {
                    goes_on |= squared < window * window;
                    continue;
                }
                (above, below) = (above | is_above, below | !is_above);
                near.push(dx, dy, if is_above { 1.0 } else { -1.0 });
            }
        }
        if goes_on {
            let found = self.chance(x, y, radius, |p| f64::from(p.z) > middle);
            return Some(found.map_or(Edge::constant(0.0), |(edge, _)| edge));
        }
        if !(above && below) {
            return (above || below).then_some(Edge::constant(if above { 1.0 } else { 0.0 }));
        }
        let mut found = None;
        for scale in SCALES {
            let Some([value, along_x, along_y]) = near.fit((scale * radius).powi(2)) else { continue };
            found = Some(Edge::linear([value, along_x, along_y].map(|v| STEEPNESS * scale * v)));
            let [wrong, all] = near.wrong([value, along_x, along_y]);
            if wrong <= WRONG * all {
                break;
            }
        }
        found
    }
}

/// Number of points whose terms are computed together, by SIMD instructions.
const LANES: usize = 4;

/// Points around a pixel as columns: offsets from the pixel, values (+1 on the upper surface, −1 on the lower one), and
/// weights. Points without weight pad their number to a multiple of [`LANES`].
#[derive(Default)]
pub(crate) struct NearbyPoints {
    columns: [Vec<f64>; 3],
    weights: Vec<f64>,
}

impl NearbyPoints {
    fn clear(&mut self) {
        self.columns.iter_mut().for_each(Vec::clear);
    }

    fn push(&mut self, dx: f64, dy: f64, side: f64) {
        self.columns.iter_mut().zip([dx, dy, side]).for_each(|(column, value)| column.push(value));
    }

    /// Returns x offsets, y offsets, values and weights of `LANES` points at a time.
    fn lanes(&self) -> impl Iterator<Item = [&[f64; LANES]; 4]> {
        let [dx, dy, side] = [0, 1, 2].map(|k| self.columns[k].as_chunks().0);
        let weights = self.weights.as_chunks().0;
        dx.iter().zip(dy).zip(side).zip(weights).map(|(((dx, dy), side), w)| [dx, dy, side, w])
    }

    /// Fits a linear function of the position to the points' values, with Gaussian weights of this variance. Returns
    /// its value and its slopes along x and y at the pixel; `None` without points.
    fn fit(&mut self, variance: f64) -> Option<[f64; 3]> {
        let whole = self.columns[0].len().next_multiple_of(LANES);
        // Padding points are so far away that they have no weight.
        self.columns.iter_mut().zip([f64::MAX.sqrt(), 0.0, 0.0]).for_each(|(column, far)| column.resize(whole, far));
        let [dx, dy, _] = &self.columns;
        self.weights.clear();
        self.weights.extend(dx.iter().zip(dy).map(|(dx, dy)| weight(dx * dx + dy * dy, variance)));
        // Σw, Σwx, Σwy, Σwx², Σwxy, Σwy²; Σwv, Σwvx, Σwvy, with the weight w, offset (x, y) and value v of each point.
        let mut sums = [[0.0; LANES]; 9];
        for [dx, dy, side, w] in self.lanes() {
            for k in 0..LANES {
                let (dx, dy, side, w) = (dx[k], dy[k], side[k], w[k]);
                // Squares of the padding points' offsets would overflow.
                let (dx, dy) = if w > 0.0 { (dx, dy) } else { (0.0, 0.0) };
                let terms = [1.0, dx, dy, dx * dx, dx * dy, dy * dy, side, side * dx, side * dy];
                (0..9).for_each(|i| sums[i][k] += w * terms[i]);
            }
        }
        let [m0, mx, my, mxx, mxy, myy, v @ ..] = sums.map(|lanes| lanes.iter().sum::<f64>());
        let v: [f64; 3] = v;
        let level = LEVEL * variance * m0;
        let (mxx, myy) = (mxx + level, myy + level);
        // Inverse by cofactors.
        let [c00, c01, c02] = [mxx * myy - mxy * mxy, mxy * my - mx * myy, mx * mxy - mxx * my];
        let [c11, c12, c22] = [m0 * myy - my * my, mx * my - m0 * mxy, m0 * mxx - mx * mx];
        let determinant = m0 * c00 + mx * c01 + my * c02;
        let row = |[a, b, c]: [f64; 3]| (a * v[0] + b * v[1] + c * v[2]) / determinant;
        let found = [row([c00, c01, c02]), row([c01, c11, c12]), row([c02, c12, c22])];
        found.iter().all(|v| v.is_finite()).then_some(found)
    }

    /// Returns the sum of squared weights of the points at which a linear function has the wrong sign, and the sum over
    /// all points. The weights are those of the last fit.
    fn wrong(&self, [value, along_x, along_y]: [f64; 3]) -> [f64; 2] {
        let mut sums = [[0.0; LANES]; 2];
        for [dx, dy, side, w] in self.lanes() {
            for k in 0..LANES {
                let squared = w[k] * w[k];
                let is_wrong = (value + along_x * dx[k] + along_y * dy[k]) * side[k] < 0.0;
                sums[0][k] += if is_wrong { squared } else { 0.0 };
                sums[1][k] += squared;
            }
        }
        sums.map(|lanes| lanes.iter().sum())
    }
}

/// Returns the Gaussian weight for a squared distance; 0 beyond [`REACH`] standard deviations.
fn weight(squared: f64, variance: f64) -> f64 {
    // The Gaussian is computed as the eighth power of a series for an eighth of the exponent, which is at most 0.4. It
    // is within 6e-5 of the Gaussian where this is smallest, and takes a tenth of the time of `exp`.
    let y = squared / (-16.0 * variance);
    let series = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y / 120.0))));
    let fourth = (series * series) * (series * series);
    if squared < REACH * REACH * variance { fourth * fourth } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use surfel_model::{CloudData, Column3, OnInvalid, Shape};

    fn cloud(points: &[DVec3], radius: f32) -> SplatCloud {
        let normals = Column3::from_f32(vec![glam::Vec3::Z; points.len()]);
        let shape = Shape::Disks { normals, radii: vec![radius; points.len()] };
        let data = CloudData::new(DVec3::ZERO, Column3::from_f64(points), shape);
        SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
    }

    fn share_of(sides: &EdgeLocator, x: f64, y: f64, upper: f64, lower: f64) -> Option<f64> {
        Some(sides.edge(x, y, upper, lower, &mut NearbyPoints::default())?.share(0.0, 0.0))
    }

    fn sides(points: &[DVec3], radius: f32) -> EdgeLocator {
        EdgeLocator::new([cloud(points, radius)].iter(), |_, _| false, [-10.0, -10.0, 10.0, 10.0], |_, _| ())
    }

    /// Returns points on a grid of 0.5, at height `roof` on the left of an edge through the origin with this direction.
    fn step(angle: f64, roof: f64) -> Vec<DVec3> {
        let normal = DVec3::new(angle.cos(), angle.sin(), 0.0);
        let at = |i: i32| DVec3::new(f64::from(i % 40) * 0.5 - 9.75, f64::from(i / 40) * 0.5 - 9.75, 0.0);
        (0..1600).map(at).map(|p| if p.dot(normal) < 0.0 { p + roof * DVec3::Z } else { p }).collect()
    }

    #[test]
    fn edge_is_where_the_points_on_both_sides_say() {
        for angle in [0.0, 0.4, 0.8, 2.0, 4.0] {
            let (s, c) = f64::sin_cos(angle);
            let sides = sides(&step(angle, 3.0), 0.8);
            let share = |d: f64, along: f64| share_of(&sides, d * c - along * s, d * s + along * c, 3.0, 0.0).unwrap();
            // The edge is located to a third of the point spacing; a spacing away the result is certain.
            for along in [-3.0, -1.1, 0.0, 0.7, 2.5] {
                assert_eq!((share(-0.5, along), share(0.5, along)), (1.0, 0.0), "{angle} {along}");
                assert!(share(-0.17, along) > 0.5 && share(0.17, along) < 0.5, "{angle} {along}");
            }
        }
    }

    #[test]
    fn poles_walls_and_chimneys_are_not_lost() {
        let on_grid = |at: DVec3, high: bool| if high { at + 3.0 * DVec3::Z } else { at };
        let within = |p: DVec3, x: f64, y: f64| p.x.abs() < x && p.y.abs() < y;
        let ground: Vec<DVec3> = step(0.0, 0.0).iter().map(|p| *p + DVec3::new(0.25, 0.25, 0.0)).collect();
        for (name, x, y) in [("pole", 0.1, 0.1), ("wall", 0.1, 5.1), ("thick wall", 0.6, 5.1), ("chimney", 0.6, 0.6)] {
            let points: Vec<DVec3> = ground.iter().map(|p| on_grid(*p, within(*p, x, y))).collect();
            let sides = sides(&points, 0.8);
            for p in points.iter().filter(|p| within(**p, 3.0, 3.0)) {
                let share = share_of(&sides, p.x, p.y, 3.0, 0.0).unwrap();
                assert_eq!(share > 0.5, p.z > 0.0, "{name}: {share} at {p}");
            }
        }
    }

    #[test]
    fn few_points_and_those_on_a_line_tell_a_side_too() {
        let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
        assert_eq!(share_of(&sides(&[at(0.0, 3.0)], 1.0), 0.3, 0.2, 3.0, 0.0), Some(1.0));
        assert_eq!(share_of(&sides(&[at(0.0, 0.0)], 1.0), 0.3, 0.2, 3.0, 0.0), Some(0.0));
        assert_eq!(share_of(&sides(&[at(0.0, 0.0)], 1.0), 9.0, 9.0, 3.0, 0.0), None);
        assert_eq!(share_of(&sides(&[], 1.0), 0.0, 0.0, 3.0, 0.0), None);
        let line = [at(-1.0, 3.0), at(-0.5, 3.0), at(0.5, 0.0), at(1.0, 0.0)];
        let share = |x: f64| share_of(&sides(&line, 1.0), x, 0.1, 3.0, 0.0).unwrap();
        assert!((share(0.0) - 0.5).abs() < 1e-12 && share(-0.4) == 1.0 && share(0.4) == 0.0);
        // Of many points at one place, beside others, only few are used.
        let mut clump = step(0.0, 3.0);
        clump.extend(vec![DVec3::new(-0.01, 0.0, 3.0); 100_000]);
        let clump = sides(&clump, 0.8);
        assert!(clump.around(0.0, 0.0, 1.0).count() < 2 * MAX_POINTS);
        assert!((0.0..=1.0).contains(&share_of(&clump, 0.1, 0.0, 3.0, 0.0).unwrap()));
    }

    #[test]
    fn points_under_a_complete_surface_are_beneath_it_and_those_in_pits_are_not() {
        let covered_of = |points: &[DVec3]| {
            let (mut covered, bounds) = (vec![false; points.len()], [-10.0, -10.0, 10.0, 10.0]);
            EdgeLocator::new([cloud(points, 0.8)].iter(), |_, _| false, bounds, |_, i| covered[i] = true);
            covered
        };
        let ground = step(0.0, 0.0);
        let shifted = |p: &DVec3| *p + DVec3::new(0.2, 0.1, 0.0);
        let deck = ground.iter().map(shifted).filter(|p| p.x.abs() < 4.0).map(|p| p + 6.0 * DVec3::Z);
        let both: Vec<DVec3> = ground.iter().copied().chain(deck).collect();
        for (p, covered) in both.iter().zip(covered_of(&both)) {
            assert!(!covered || (p.z == 0.0 && p.x.abs() < 4.0), "{p}");
            // Two spacings from the deck's edges the result is certain.
            assert!(covered || p.z > 0.0 || p.x.abs() > 3.0 || p.y.abs() > 8.0, "{p}");
        }
        // A shaft two points wide, and a slope as steep as stairs.
        let pit: Vec<DVec3> =
            ground.iter().map(|p| if p.x.abs() < 0.5 && p.y.abs() < 0.5 { *p - 6.0 * DVec3::Z } else { *p }).collect();
        assert!(!covered_of(&pit).contains(&true));
        let slope: Vec<DVec3> = ground.iter().map(|p| *p + 5.0 * p.x * DVec3::Z).collect();
        assert!(!covered_of(&slope).contains(&true));
    }

    #[test]
    fn lower_leaves_of_a_crown_are_among_leaves_and_what_is_under_roofs_is_not() {
        // Points whose heights vary over 2 m from 5 m upward, and the ground; classified as foliage, and as surfaces in
        // layers.
        let crown =
            step(0.0, 0.0).into_iter().zip(0..).map(|(p, i)| p + (5.0 + 0.1 * f64::from(i * 7 % 21)) * DVec3::Z);
        let points: Vec<DVec3> = step(0.0, 0.0).into_iter().chain(crown).collect();
        let of = |z: f32, is_foliage: bool| {
            let sides = EdgeLocator::new(
                [cloud(&points, 0.8)].iter(),
                |_, i| is_foliage && i >= 1600,
                [-10.0, -10.0, 10.0, 10.0],
                |_, _| (),
            );
            sides.is_within_foliage([0.1, 0.2], z, 0.8)
        };
        assert!(of(5.0, true) && of(3.0, true) && !of(0.0, true) && !of(5.0, false));
    }

    #[test]
    fn every_point_counts_where_most_of_the_bounds_is_empty() {
        let points = step(0.0, 3.0);
        let sides =
            EdgeLocator::new([cloud(&points, 0.8)].iter(), |_, _| false, [-2000.0, -2000.0, 2000.0, 2000.0], |_, _| ());
        let near = sides.around(0.0, 0.0, 2.0).filter(|p| p.at.iter().all(|v| v.abs() < 2.0)).count();
        assert_eq!(near, 64);
    }

    #[test]
    fn weights_are_those_of_a_gaussian() {
        for i in 0..1000 {
            let squared = f64::from(i) * 0.03;
            let exact = if squared < REACH * REACH * 4.0 { (-squared / 8.0).exp() } else { 0.0 };
            assert!((weight(squared, 4.0) - exact).abs() <= 6e-5 * exact, "{squared}");
        }
    }

    #[test]
    fn points_elsewhere_change_no_share() {
        let near = step(0.4, 3.0);
        let far: Vec<DVec3> = (0..500).map(|i| DVec3::new(9.0 + 1e-3 * f64::from(i), 9.5, 1.0)).collect();
        let all = EdgeLocator::new(
            [cloud(&near, 0.8), cloud(&far, 0.1)].iter(),
            |_, _| false,
            [-10.0, -10.0, 10.0, 10.0],
            |_, _| (),
        );
        let alone = sides(&near, 0.8);
        for i in 0..200 {
            let (x, y) = (f64::from(i % 20) * 0.2 - 2.0, f64::from(i / 20) * 0.4 - 2.0);
            let [a, b] = [&all, &alone].map(|sides| share_of(sides, x, y, 3.0, 0.0).unwrap());
            assert!((a - b).abs() < 1e-12, "{x} {y}: {a} {b}");
        }
    }
}
