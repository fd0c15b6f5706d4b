//! Edge localisation from the points of the upper surface alone: estimates the probability that a position is beneath
//! the surface.
//!
//! The lower of two surfaces may continue beneath the upper one, such as a road under a bridge or ground under a tree.
//! Its points then give no evidence of the position of the upper surface's edge, and the upper points have random gaps.
//!
//! The module considers all edges that the surface may have in a window around the position: parabolas with 32
//! directions, 5 curvatures and any offset. An edge is possible if all upper points are inside of it. The points are
//! modelled as a Poisson process. The likelihood of an edge is then exp(−density × area inside), which is proportional
//! to exp(density × rest of the window). The result is the weighted fraction of edges that have the position inside. As
//! the mean over all possible edges, it has the smallest mean squared error. A hole that fits into a window is tested
//! with a smaller window.

use super::edge::Edge;
use std::sync::LazyLock;

/// Radius of the window around a position in which edges are considered, in radii of the splats there. Half a window is
/// almost never empty by chance. Few holes of a canopy fit into a whole window.
pub(crate) const WINDOW: f64 = 1.8;
/// Radii of the two windows that are tried, relative to the whole window. The second one is used if points enclose the
/// position in the first: it decides whether they enclose a hole.
const SIZES: [f64; 2] = [1.0, 0.8];
/// Logarithm of the odds by which coverage is assumed more likely than a hole that only the smaller window shows.
/// Chance also produces holes of this size.
const LOG_PRIOR_ODDS: f64 = 2.0;
/// Expected number of points in a window that is entirely inside of the surface, divided by π. It is the density per
/// squared window radius; a splat's radius is 1.65 point spacings (`surfel-sample`).
const DENSITY: f64 = (1.65 * WINDOW) * (1.65 * WINDOW);
/// Number of directions of the edges that are considered.
const DIRECTIONS: usize = 32;
/// Curvatures of the edges that are considered, in units of 1/window (at most 1 over the splats' radius), with prior
/// weights. Straight edges have a higher weight because of bridge decks. A much higher weight would reduce accuracy at
/// canopies.
const CURVATURES: [(f32, f64); 5] = [(0.0, 2.0), (-1.8, 1.0), (-0.9, 1.0), (0.9, 1.0), (1.8, 1.0)];
/// Largest offset of an edge from the window's centre in the table of likelihoods, in window radii. At this offset, an
/// edge is outside of the window.
const MAX_OFFSET: f64 = 2.0;
/// Number of offsets in the table of likelihoods per window radius.
const STEPS: f64 = 64.0;
/// Number of strips by which the part of the window inside of an edge is integrated.
const STRIPS: usize = 256;

/// Table by curvature (index in [`CURVATURES`]) and offset from the window's centre ([`STEPS`] per radius, from
/// −[`MAX_OFFSET`] on). Each entry has the likelihood of an edge with this curvature and offset, times the curvature's
/// prior weight, and the integral of this product over all larger offsets.
struct Likelihoods([Vec<[f64; 2]>; CURVATURES.len()]);

/// Tables of likelihoods for the two windows of [`SIZES`].
static LIKELIHOODS: LazyLock<[Likelihoods; 2]> = LazyLock::new(|| SIZES.map(likelihoods));

/// Computes the table of likelihoods for a window of this size relative to the whole window.
fn likelihoods(size: f64) -> Likelihoods {
    Likelihoods(CURVATURES.map(|(curvature, frequency)| {
        let area = |offset: f64| {
            let strip = |i: usize| {
                let across = (2.0 * (i as f64 + 0.5) / STRIPS as f64) - 1.0;
                let half = (1.0 - across * across).sqrt();
                (offset + 0.5 * f64::from(curvature) * across * across + half).clamp(0.0, 2.0 * half)
            };
            (0..STRIPS).map(strip).sum::<f64>() * 2.0 / STRIPS as f64
        };
        let last = (2.0 * MAX_OFFSET * STEPS) as usize;
        let own = |i: usize| frequency * (-DENSITY * size * size * area(i as f64 / STEPS - MAX_OFFSET)).exp();
        let mut all = vec![[own(last), 0.0]; last + 1];
        for i in (0..last).rev() {
            let own = own(i);
            all[i] = [own, all[i + 1][1] + 0.5 * (own + all[i + 1][0]) / STEPS];
        }
        all
    }))
}

impl Likelihoods {
    /// Interpolates the likelihood of an edge, and the integral over all larger offsets, for a curvature's index and an
    /// offset.
    fn at(&self, curvature: usize, offset: f64) -> [f64; 2] {
        let all = &self.0[curvature];
        let step = ((offset + MAX_OFFSET) * STEPS).clamp(0.0, (all.len() - 1) as f64);
        let below = (step as usize).min(all.len() - 2);
        let share = step - below as f64;
        [0, 1].map(|k| all[below][k] + share * (all[below + 1][k] - all[below][k]))
    }
}

/// Cosines and sines of the considered edges' directions.
static UNITS: LazyLock<[[f32; DIRECTIONS]; 2]> = LazyLock::new(|| {
    let angle = |i: usize| i as f64 * std::f64::consts::TAU / DIRECTIONS as f64;
    [std::array::from_fn(|i| angle(i).cos() as f32), std::array::from_fn(|i| angle(i).sin() as f32)]
});

/// Radius within which points may enclose a position, in radii of the whole window. It is less than 2 point spacings,
/// so that points in a pit two points wide aren't enclosed.
const ENCLOSING: f64 = 1.2 / WINDOW;
/// Distance from a position, in window radii, along each direction. Near points enclose the position if, in every
/// direction, some of them are farther away than this.
const ENCLOSED: f32 = 0.01;

/// Returns the probability that a position is beneath a surface, as an [`Edge`]. The flag is true if nearby points
/// enclose the position. `around` returns the surface's points within a distance, relative to the position. `whole` is
/// the radius of the whole window.
pub(crate) fn chance<I: Iterator<Item = [f64; 2]>>(whole: f64, around: impl Fn(f64) -> I) -> (Edge, bool) {
    let outline = Outline::new(0, whole, &around);
    let edge = outline.chance().or_else(|| Outline::new(1, whole, &around).chance());
    (edge.unwrap_or(Edge::constant(1.0)), outline.encloses())
}

/// Extent of the upper surface's points in a window, for each edge direction.
struct Outline {
    /// Largest offset along each direction of the points that are near enough to enclose the position ([`ENCLOSING`]).
    near: [f32; DIRECTIONS],
    /// Smallest offset of an edge that has all points inside, for each curvature and direction.
    least: [[f32; DIRECTIONS]; CURVATURES.len()],
    is_empty: bool,
    /// Radius of this window, in the units of x and y.
    window: f64,
    /// Index of the window's relative size in [`SIZES`].
    size: usize,
}

impl Outline {
    /// Collects the upper surface's points in a window around a position. `around` returns the points within a
    /// distance, relative to the position. `whole` is the radius of the whole window.
    fn new<I: Iterator<Item = [f64; 2]>>(size: usize, whole: f64, around: impl Fn(f64) -> I) -> Self {
        let window = SIZES[size] * whole;
        let mut outline = Self {
            window,
            size,
            near: [f32::NEG_INFINITY; DIRECTIONS],
            least: [[f32::NEG_INFINITY; DIRECTIONS]; CURVATURES.len()],
            is_empty: true,
        };
        around(window).for_each(|at| outline.add(at.map(|d| d / window)));
        outline
    }

    /// Adds a point of the upper surface, given relative to the position and in window radii.
    fn add(&mut self, [x, y]: [f64; 2]) {
        let is_near = x * x + y * y < ENCLOSING * ENCLOSING;
        let (x, y) = (x as f32, y as f32);
        self.is_empty = false;
        let [cos, sin] = &*UNITS;
        let (mut along, mut half_squared) = ([0.0; DIRECTIONS], [0.0; DIRECTIONS]);
        for k in 0..DIRECTIONS {
            along[k] = x * cos[k] + y * sin[k];
            let across = y * cos[k] - x * sin[k];
            half_squared[k] = 0.5 * across * across;
        }
        if is_near {
            self.near.iter_mut().zip(along).for_each(|(near, along)| *near = near.max(along));
        }
        for (least, (curvature, _)) in self.least.iter_mut().zip(CURVATURES) {
            for k in 0..DIRECTIONS {
                let offset = along[k] - curvature * half_squared[k];
                least[k] = if offset > least[k] { offset } else { least[k] };
            }
        }
    }

    /// True if near points enclose the position: in every direction, one of them is beyond it.
    fn encloses(&self) -> bool {
        self.near.iter().all(|offset| *offset > ENCLOSED)
    }

    /// Returns the probability that the position is inside of the edge, as a function of the position. Returns `None`
    /// if the position is inside of all possible edges.
    fn chance(&self) -> Option<Edge> {
        if self.is_empty {
            return Some(Edge::constant(0.0));
        }
        let (table, [cos, sin]) = (&LIKELIHOODS[self.size], &*UNITS);
        // These are the likelihoods of edges with the position inside and outside, and their derivatives by x and y.
        let (mut inside, mut outside) = ([0.0; 3], [0.0; 3]);
        for (curvature, least) in self.least.iter().enumerate() {
            let at_place = table.at(curvature, 0.0)[1];
            for (k, &least) in least.iter().enumerate() {
                let [own, farther] = table.at(curvature, least.into());
                let (sums, gained) = if least > 0.0 {
                    (&mut inside, farther)
                } else {
                    inside[0] += at_place;
                    (&mut outside, farther - at_place)
                };
                sums[0] += gained;
                sums[1] += own * f64::from(cos[k]);
                sums[2] += own * f64::from(sin[k]);
            }
        }
        if outside[0] <= 0.0 {
            return None;
        }
        let slope = |k: usize| (inside[k] / inside[0] - outside[k] / outside[0]) / self.window;
        let rarer = if self.size > 0 { LOG_PRIOR_ODDS } else { 0.0 };
        Some(Edge::logistic((inside[0] / outside[0]).ln() + rarer, [slope(1), slope(2)]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the probability at (x, y) for points on a grid of spacing 1, of which `kept` selects some.
    fn chance(x: f64, y: f64, kept: impl Fn(f64, f64) -> bool) -> Edge {
        let grid = (0..1600).map(|i| [i % 40, i / 40].map(|i| f64::from(i) - 19.5));
        let kept: Vec<[f64; 2]> = grid.filter(|p| kept(p[0], p[1])).map(|p| [p[0] - x, p[1] - y]).collect();
        super::chance(1.65 * WINDOW, |reach| kept.iter().copied().filter(move |p| p[0].hypot(p[1]) < reach)).0
    }

    #[test]
    fn edges_lie_outside_of_the_outermost_points() {
        for angle in [0.0, 0.3, 0.7, 1.2] {
            let (sin, cos) = f64::sin_cos(angle);
            let of = |d: f64| chance(d * cos, d * sin, |x, y| x * cos + y * sin < 0.0).share(0.0, 0.0);
            // Mean over places: the position of a step with the same integral.
            let content: f64 = (-40..40).map(|i| 0.1 * of(0.1 * (f64::from(i) + 0.5))).sum();
            assert!((3.6..4.3).contains(&content), "{angle}: {content}");
            assert!(of(-1.5) > 0.95 && of(1.5) < 0.02, "{angle}: {} {}", of(-1.5), of(1.5));
        }
    }

    #[test]
    fn holes_are_open_and_chance_gaps_are_not() {
        let hole = |radius: f64| chance(0.1, 0.2, |x, y| x.hypot(y) > radius).share(0.0, 0.0);
        // 4, 16 and 32 points are missing. The second hole's rim meets the whole window on all sides.
        assert!(hole(1.0) > 0.5 && hole(2.2) < 0.02 && hole(3.2) < 0.02, "{:?}", [1.0, 2.2, 3.2].map(hole));
        assert!(chance(0.0, 0.0, |_, _| true).share(0.0, 0.0) > 0.999);
        assert!(chance(0.0, 0.0, |_, _| false).share(0.0, 0.0) == 0.0);
    }

    #[test]
    fn slopes_are_the_derivatives() {
        let of = |x: f64, y: f64| chance(x, y, |x, y| x + 0.3 * y < 0.0);
        let (here, d) = (of(0.1, 0.05), 0.02);
        for [dx, dy] in [[d, 0.0], [0.0, d], [-d, 0.0]] {
            let (told, found) = (here.share(dx, dy), of(0.1 + dx, 0.05 + dy).share(0.0, 0.0));
            // The window moves too, and with it the area that is counted.
            assert!((told - found).abs() < 0.02, "{told} {found}");
        }
    }
}
