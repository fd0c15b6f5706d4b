//! Where the edge between two surfaces is, by the points around it.
//!
//! Weights of splats tell an edge only as well as the points' density is even. Points tell it better: each lies on the
//! upper or on the lower surface, +1 or −1, and the linear function of x and y that fits those around a pixel best has
//! its zero where the edge is. It is fitted by moving least squares (Lancaster and Šalkauskas 1981) with Gaussian
//! weights. The wider they reach, the better a straight edge is known, and the more of what is small is lost: so the
//! widest is taken whose function has the points on their own sides.

use rayon::prelude::*;
use surfel_model::SplatCloud;

/// Standard deviations of the weights over the radius of the splats around, which is about 1.6 spacings; beyond `REACH`
/// of them a point counts as nothing.
const SCALES: [f64; 4] = [1.3, 0.8, 0.5, 0.3];
const REACH: f64 = 2.5;
/// Largest part of the squared weights that points on the wrong side of the function may have.
const WRONG: f64 = 0.05;
/// How steeply the function becomes a share, over the scale: a step between points that lie on both sides of it alike
/// is fitted by a function that rises slower than the step does, the slower the wider.
const STEEPNESS: f64 = 4.4;
/// Weight of a level function, over that of the points at their standard deviations: few points, or those on a line,
/// tell no slope.
const LEVEL: f64 = 2e-3;
/// Most points that a cell has on average.
const CELL_POINTS: f64 = 2.0;
/// Most points that one pixel is told by, but for a row of cells more.
const MOST_POINTS: usize = 1024;
/// Most cells of a side.
const MOST_CELLS: f64 = 4096.0;

struct Point {
    at: [f64; 2],
    z: f32,
    radius: f32,
}

/// The centres of a block's splats, sorted into square cells.
pub(crate) struct Sides {
    points: Vec<Point>,
    /// Index of each cell's first point, and the number of points.
    starts: Vec<u32>,
    least: [f64; 2],
    cell: f64,
    cells: [usize; 2],
    /// The largest distance at which any splat counts.
    reach: f64,
}

impl Sides {
    /// Of the splats within `bounds`: least x and y, then largest.
    pub(crate) fn new<'a>(clouds: impl Iterator<Item = &'a SplatCloud>, bounds: [f64; 4]) -> Self {
        let [x0, y0, x1, y1] = bounds;
        let within = |p: &Point| p.at[0] >= x0 && p.at[0] <= x1 && p.at[1] >= y0 && p.at[1] <= y1;
        let mut points: Vec<Point> = Vec::new();
        for cloud in clouds {
            let point = |i: usize| {
                let center = cloud.center(i);
                let radius = cloud.radius_max(i) as f32;
                Point { at: [center.x, center.y], z: center.z as f32, radius }
            };
            points.par_extend((0..cloud.len()).into_par_iter().with_min_len(4096).map(point).filter(within));
        }
        let [width, height] = [x1 - x0, y1 - y0];
        let even = (width * height * CELL_POINTS / points.len().max(1) as f64).sqrt();
        let cell = even.max(width.max(height) / MOST_CELLS);
        let cells = [width, height].map(|side| (side / cell).floor() as usize + 1);
        let mut all = Self { points, starts: Vec::new(), least: [x0, y0], cell, cells, reach: 0.0 };
        all.reach = all.points.iter().fold(0.0, |most, p| f64::max(most, REACH * f64::from(p.radius)));
        let of_point = |p: &Point| all.cell_of(1, p.at[1]) * cells[0] + all.cell_of(0, p.at[0]);
        let keys: Vec<usize> = all.points.iter().map(of_point).collect();
        let mut starts = vec![0_u32; cells[0] * cells[1] + 1];
        keys.iter().for_each(|&key| starts[key + 1] += 1);
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        // In the splats' order within each cell, so that sums are.
        let (mut next, mut order) = (starts.clone(), vec![0_u32; keys.len()]);
        for (&key, i) in keys.iter().zip(0..) {
            order[next[key] as usize] = i;
            next[key] += 1;
        }
        let sorted = order.iter().map(|&i| Point { ..all.points[i as usize] }).collect();
        (all.points, all.starts) = (sorted, starts);
        all
    }

    fn cell_of(&self, axis: usize, value: f64) -> usize {
        let index = ((value - self.least[axis]) / self.cell).floor();
        (index.max(0.0) as usize).min(self.cells[axis] - 1)
    }

    /// The points of the cells that a square around (x, y) meets; of very many, as on a wall seen from above, some.
    fn around(&self, x: f64, y: f64, half: f64) -> impl Iterator<Item = &Point> {
        let [left, right] = [x - half, x + half].map(|x| self.cell_of(0, x));
        let rows = self.cell_of(1, y - half)..=self.cell_of(1, y + half);
        let of_row = move |row: usize| {
            let first = self.starts[row * self.cells[0] + left] as usize;
            &self.points[first..self.starts[row * self.cells[0] + right + 1] as usize]
        };
        let count: usize = rows.clone().map(|row| of_row(row).len()).sum();
        let step = count.div_ceil(MOST_POINTS).max(1);
        rows.flat_map(move |row| of_row(row).iter().step_by(step))
    }

    /// Radius of the splats around (x, y), by their mean density: of those no farther than the nearest one's radius.
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

    /// Share of the surface of height `upper` at (x, y), where the other one is at `lower`; `None` if no point is near.
    pub(crate) fn share(&self, x: f64, y: f64, upper: f64, lower: f64) -> Option<f64> {
        let middle = 0.5 * (upper + lower);
        let radius = self.radius_at(x, y)?;
        let reach = SCALES[0] * REACH * radius;
        let side = |p: &Point| if f64::from(p.z) > middle { 1.0 } else { -1.0 };
        let from_here = self.around(x, y, reach).map(|p| [p.at[0] - x, p.at[1] - y, side(p)]);
        let near: Vec<[f64; 3]> = from_here.filter(|[dx, dy, _]| dx * dx + dy * dy < reach * reach).collect();
        if near.iter().all(|p| p[2] > 0.0) || near.iter().all(|p| p[2] < 0.0) {
            return near.first().map(|p| 0.5 + 0.5 * p[2]);
        }
        let mut found = None;
        for scale in SCALES {
            let variance = (scale * radius).powi(2);
            let Some([value, along_x, along_y]) = fit(&near, variance) else { continue };
            found = Some((0.5 + STEEPNESS * scale * value).clamp(0.0, 1.0));
            let (mut wrong, mut all) = (0.0, 0.0);
            for [dx, dy, side] in &near {
                let w = weight(*dx, *dy, variance).powi(2);
                all += w;
                if (value + along_x * dx + along_y * dy) * side < 0.0 {
                    wrong += w;
                }
            }
            if wrong <= WRONG * all {
                break;
            }
        }
        found
    }
}

fn weight(dx: f64, dy: f64, variance: f64) -> f64 {
    let squared = dx * dx + dy * dy;
    if squared < REACH * REACH * variance { (-0.5 * squared / variance).exp() } else { 0.0 }
}

/// The linear function that fits the sides of points best: its value here, and its slopes along x and y. `None` of no
/// point.
fn fit(near: &[[f64; 3]], variance: f64) -> Option<[f64; 3]> {
    // Σw, Σwx, Σwy, Σwx², Σwxy, Σwy²; Σwv, Σwvx, Σwvy.
    let ([mut m0, mut mx, mut my, mut mxx, mut mxy, mut myy], mut v) = ([0.0; 6], [0.0; 3]);
    for &[dx, dy, side] in near {
        let w = weight(dx, dy, variance);
        (m0, mx, my) = (m0 + w, mx + w * dx, my + w * dy);
        (mxx, mxy, myy) = (mxx + w * dx * dx, mxy + w * dx * dy, myy + w * dy * dy);
        v = [v[0] + w * side, v[1] + w * side * dx, v[2] + w * side * dy];
    }
    let level = LEVEL * variance * m0;
    let (mxx, myy) = (mxx + level, myy + level);
    // The inverse by cofactors.
    let [c00, c01, c02] = [mxx * myy - mxy * mxy, mxy * my - mx * myy, mx * mxy - mxx * my];
    let [c11, c12, c22] = [m0 * myy - my * my, mx * my - m0 * mxy, m0 * mxx - mx * mx];
    let determinant = m0 * c00 + mx * c01 + my * c02;
    let row = |[a, b, c]: [f64; 3]| (a * v[0] + b * v[1] + c * v[2]) / determinant;
    let found = [row([c00, c01, c02]), row([c01, c11, c12]), row([c02, c12, c22])];
    found.iter().all(|v| v.is_finite()).then_some(found)
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

    fn sides(points: &[DVec3], radius: f32) -> Sides {
        Sides::new([cloud(points, radius)].iter(), [-10.0, -10.0, 10.0, 10.0])
    }

    /// Points of a grid of 0.5, as high as `roof` left of an edge through the origin of this direction.
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
            let share = |d: f64, along: f64| sides.share(d * c - along * s, d * s + along * c, 3.0, 0.0).unwrap();
            // The edge of points is known to a third of their spacing; a spacing away there is no doubt.
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
                let share = sides.share(p.x, p.y, 3.0, 0.0).unwrap();
                assert_eq!(share > 0.5, p.z > 0.0, "{name}: {share} at {p}");
            }
        }
    }

    #[test]
    fn few_points_and_those_on_a_line_tell_a_side_too() {
        let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
        assert_eq!(sides(&[at(0.0, 3.0)], 1.0).share(0.3, 0.2, 3.0, 0.0), Some(1.0));
        assert_eq!(sides(&[at(0.0, 0.0)], 1.0).share(0.3, 0.2, 3.0, 0.0), Some(0.0));
        assert_eq!(sides(&[at(0.0, 0.0)], 1.0).share(9.0, 9.0, 3.0, 0.0), None);
        assert_eq!(sides(&[], 1.0).share(0.0, 0.0, 3.0, 0.0), None);
        let line = [at(-1.0, 3.0), at(-0.5, 3.0), at(0.5, 0.0), at(1.0, 0.0)];
        let share = |x: f64| sides(&line, 1.0).share(x, 0.1, 3.0, 0.0).unwrap();
        assert!((share(0.0) - 0.5).abs() < 1e-12 && share(-0.4) == 1.0 && share(0.4) == 0.0);
        // Many at one place, beside others: as few are looked at.
        let mut clump = step(0.0, 3.0);
        clump.extend(vec![DVec3::new(-0.01, 0.0, 3.0); 100_000]);
        let clump = sides(&clump, 0.8);
        assert!(clump.around(0.0, 0.0, 1.0).count() < 2 * MOST_POINTS);
        assert!((0.0..=1.0).contains(&clump.share(0.1, 0.0, 3.0, 0.0).unwrap()));
    }

    #[test]
    fn points_elsewhere_change_no_share() {
        let near = step(0.4, 3.0);
        let far: Vec<DVec3> = (0..500).map(|i| DVec3::new(9.0 + 1e-3 * f64::from(i), 9.5, 1.0)).collect();
        let all = Sides::new([cloud(&near, 0.8), cloud(&far, 0.1)].iter(), [-10.0, -10.0, 10.0, 10.0]);
        let alone = sides(&near, 0.8);
        for i in 0..200 {
            let (x, y) = (f64::from(i % 20) * 0.2 - 2.0, f64::from(i / 20) * 0.4 - 2.0);
            let [a, b] = [&all, &alone].map(|sides| sides.share(x, y, 3.0, 0.0).unwrap());
            assert!((a - b).abs() < 1e-12, "{x} {y}: {a} {b}");
        }
    }
}
