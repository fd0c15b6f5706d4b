//! Surfaces to sample, and a count of the splats that cover a point of a surface, which shares no code with the crate.
#![allow(dead_code, reason = "the conformance tests read it, too, and use a part")]

use glam::DVec3;
use std::collections::HashMap;
use surfel_model::{Column3, PointCloud, SplatCloud};

/// Linear congruential generator of random numbers, so that the tests don't rely on the crate's own.
pub(crate) struct Lcg(pub(crate) u64);

impl Lcg {
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn sphere(&mut self) -> DVec3 {
        let (z, a) = (2.0 * self.unit() - 1.0, std::f64::consts::TAU * self.unit());
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * a.cos(), r * a.sin(), z)
    }
}

pub(crate) fn points(positions: &[DVec3], normals: Option<&[DVec3]>) -> PointCloud {
    let (origin, positions) = Column3::with_origin(positions);
    PointCloud { origin, positions, normals: normals.map(Column3::from_f64), ..PointCloud::default() }
}

/// Splats of a cloud, sorted into cubes by their centres. The cubes are as wide as the largest splat's radius.
pub(crate) struct Index<'a> {
    cloud: &'a SplatCloud,
    side: f64,
    buckets: HashMap<[i64; 3], Vec<usize>>,
}

impl<'a> Index<'a> {
    pub(crate) fn new(cloud: &'a SplatCloud) -> Self {
        let side = (0..cloud.len()).map(|i| cloud.radius_max(i)).fold(0.0, f64::max);
        let mut buckets: HashMap<_, Vec<usize>> = HashMap::new();
        for i in 0..cloud.len() {
            buckets.entry(Self::key(cloud.center(i), side)).or_default().push(i);
        }
        Self { cloud, side, buckets }
    }

    fn key(p: DVec3, side: f64) -> [i64; 3] {
        (p / side).to_array().map(|x| x.floor() as i64)
    }

    /// Returns the number of splats that the line through `x` along `n` meets, and the sum of their weights there. Only
    /// splats count whose normals are within about 73° of `n`, and whose planes the line meets within their radius of
    /// `x`.
    pub(crate) fn over(&self, x: DVec3, n: DVec3) -> (usize, f64) {
        let [a, b, c] = Self::key(x, self.side);
        let (mut count, mut sum) = (0, 0.0);
        for i in a - 1..=a + 1 {
            for j in b - 1..=b + 1 {
                for k in c - 1..=c + 1 {
                    for &s in self.buckets.get(&[i, j, k]).map_or(&[][..], Vec::as_slice) {
                        if let Some(w) = self.weight(s, x, n) {
                            (count, sum) = (count + 1, sum + w);
                        }
                    }
                }
            }
        }
        (count, sum)
    }

    /// Returns the weight of splat `i` where the line along `n` through `x` meets it; `None` if the line misses its
    /// visible part, or if the splat doesn't count by [`Self::over`]. Cramer's rule solves x + λn = p + us + vt.
    fn weight(&self, i: usize, x: DVec3, n: DVec3) -> Option<f64> {
        let (s, t) = self.cloud.axes(i);
        let facing = s.cross(t).normalize().dot(n);
        if facing < 0.3 {
            return None;
        }
        let d = x - self.cloud.center(i);
        let det = s.cross(t).dot(-n);
        let u = d.cross(t).dot(-n) / det;
        let v = s.cross(d).dot(-n) / det;
        let lambda = s.cross(t).dot(d) / det;
        let rho2 = u * u + v * v;
        (rho2 <= 1.0 && keeps(self.cloud, i, u, v) && lambda.abs() <= self.cloud.radius_max(i))
            .then(|| (-2.0 * rho2).exp())
    }
}

/// True if all clip lines of splat `i` leave the point (u, v) visible, which is given in units of the half-axes.
pub(crate) fn keeps(cloud: &SplatCloud, i: usize, u: f64, v: f64) -> bool {
    let lines = cloud.data().clips.iter().flat_map(|clips| &clips.lines).flat_map(|lines| lines[i]);
    let mut lines = lines.filter(|line| !line.a.is_nan());
    lines.all(|line| f64::from(line.a) * u + f64::from(line.b) * v + f64::from(line.c) >= 0.0)
}

/// Number of places that no splat covers, fraction of places that at least two splats cover, and the median and the
/// smallest sum of weights at a place.
#[derive(Debug)]
pub(crate) struct Coverage {
    pub(crate) holes: usize,
    pub(crate) twice: f64,
    pub(crate) median_weight: f64,
    pub(crate) least_weight: f64,
}

pub(crate) fn coverage(cloud: &SplatCloud, places: &[(DVec3, DVec3)]) -> Coverage {
    let index = Index::new(cloud);
    let over: Vec<(usize, f64)> = places.iter().map(|(x, n)| index.over(*x, *n)).collect();
    let mut weights: Vec<f64> = over.iter().map(|o| o.1).collect();
    weights.sort_by(f64::total_cmp);
    for (place, _) in places.iter().zip(&over).filter(|p| p.1.0 == 0).take(5) {
        println!("bare: {place:?}");
    }
    Coverage {
        holes: over.iter().filter(|o| o.0 == 0).count(),
        twice: over.iter().filter(|o| o.0 >= 2).count() as f64 / over.len() as f64,
        median_weight: weights[weights.len() / 2],
        least_weight: weights[0],
    }
}
