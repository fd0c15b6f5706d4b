//! Ordinary and adversarial inputs of kernels, the formulas that the tests compare. Lengths are in arbitrary units
//! unless a comment states them.

/// Pseudorandom numbers (splitmix64), seeded by a name so that kernels don't depend on each other.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(name: &str) -> Self {
        // FNV-1a.
        Self(name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, b| (hash ^ u64::from(b)).wrapping_mul(0x100_0000_01b3)))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number in [low, high).
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a number in [-1, 1).
    pub(crate) fn signed(&mut self) -> f64 {
        self.range(-1.0, 1.0)
    }

    /// Returns a number with a magnitude of 10^-e to 10^e and either sign.
    pub(crate) fn wild(&mut self, e: f64) -> f64 {
        let magnitude = 10f64.powf(self.range(-e, e));
        if self.next().is_multiple_of(2) { magnitude } else { -magnitude }
    }

    /// Returns the six coordinates of two half-axes s and t in any directions. s has a length of 1e-6 to 1e6, and t one
    /// of 1e-4 to 1 times that.
    pub(crate) fn axes(&mut self) -> Vec<f32> {
        let (a, b) = (self.wild(6.0), 10f64.powf(self.range(-4.0, 0.0)));
        let (s, t) = (self.direction().map(|c| c * a), self.direction().map(|c| c * a * b));
        f32s(&[s[0], s[1], s[2], t[0], t[1], t[2]])
    }

    /// Returns a unit vector.
    pub(crate) fn direction(&mut self) -> [f64; 3] {
        let z = self.signed();
        let (sin, cos) = self.range(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    }
}

pub(crate) fn f32s(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&v| v as f32).collect()
}

/// Returns `N` numbers in [-1, 1).
pub(crate) fn numbers<const N: usize>(random: &mut Random) -> Vec<f32> {
    (0..N).map(|_| random.signed() as f32).collect()
}

/// Returns `N` numbers of magnitudes 1e-8 to 1e8, some of them zero.
pub(crate) fn wild<const N: usize>(random: &mut Random) -> Vec<f32> {
    (0..N).map(|_| if random.range(0.0, 1.0) < 0.05 { 0.0 } else { random.wild(8.0) as f32 }).collect()
}

/// Returns a, b, c, d with a·b ≈ ±c·d, up to a relative difference of 1e-9, which is less than f32 can represent, to 1.
pub(crate) fn cancelling(random: &mut Random) -> Vec<f32> {
    let [a, b, c] = [random.wild(4.0), random.wild(4.0), random.wild(4.0)].map(|v| f64::from(v as f32));
    let off = 1.0 + random.wild(1.0) * 10f64.powf(random.range(-8.0, -1.0));
    let d = a * b / c * off;
    f32s(&[a, b, c, if random.signed() < 0.0 { d } else { -d }])
}

/// Returns a.x, a.y, b.x, b.y with a.x·b.x ≈ ±a.y·b.y, so that sums of these products may nearly cancel.
pub(crate) fn cancelling_pair(random: &mut Random) -> Vec<f32> {
    let x = cancelling(random);
    vec![x[0], x[2], x[1], x[3]]
}

/// Returns the columns of a 2×2 matrix with these singular values, and its determinant.
fn matrix(random: &mut Random, major: f64, minor: f64) -> Vec<f32> {
    let ((sa, ca), (sb, cb)) = (random.range(0.0, 6.3).sin_cos(), random.range(0.0, 6.3).sin_cos());
    let s = [ca * major * cb - sa * minor * sb, sa * major * cb + ca * minor * sb];
    let t = [-ca * major * sb - sa * minor * cb, -sa * major * sb + ca * minor * cb];
    f32s(&[s[0], s[1], t[0], t[1], major * minor])
}

/// Returns an ellipse with a larger half-axis of 0.1 to 100 px, as the columns of its 2×2 matrix and the determinant.
pub(crate) fn ellipse(random: &mut Random) -> Vec<f32> {
    let major = 10f64.powf(random.range(-1.0, 2.0));
    let minor = major * random.range(0.1, 0.9);
    matrix(random, major, minor)
}

/// Returns an ellipse like [`ellipse`], with a larger half-axis of 1e-6 to 1e6 px, including needles of aspect 1e6.
/// Circles are excluded: their axes are arbitrary.
pub(crate) fn wild_ellipse(random: &mut Random) -> Vec<f32> {
    let major = random.wild(6.0).abs();
    let aspect = 10f64.powf(random.range(-6.0, -0.05));
    matrix(random, major, major * aspect)
}

/// Returns a circle in the form of [`ellipse`], with a radius of 1e-6 to 1e6 px, up to rounding.
pub(crate) fn circle(random: &mut Random) -> Vec<f32> {
    let radius = random.wild(6.0).abs();
    matrix(random, radius, radius)
}

/// Returns the fields of a `Projected` whose half-axes project to an [`ellipse`], and the filter radius h.
pub(crate) fn projected(random: &mut Random) -> Vec<f32> {
    fields(random, ellipse, |r| [0.3 * r.signed(), 0.3 * r.signed(), 0.02 * r.signed(), 0.02 * r.signed()], [0.5, 2.0])
}

/// Returns inputs like [`projected`], with any size and slope that an ordinary splat may have.
pub(crate) fn wild_projected(random: &mut Random) -> Vec<f32> {
    let slopes = |r: &mut Random| {
        let steep = 10f64.powf(r.range(-6.0, 2.0));
        [0.35 * r.signed(), 0.35 * r.signed(), steep * r.signed(), steep * r.signed()]
    };
    fields(random, wild_ellipse, slopes, [0.1, 10.0])
}

/// Returns inputs like [`projected`], of any size but without needles: lengthening a needle's axes one by one makes
/// them parallel.
pub(crate) fn sized_projected(random: &mut Random) -> Vec<f32> {
    let sized = |r: &mut Random| {
        let size = r.wild(6.0) as f32;
        let x = ellipse(r);
        vec![x[0] * size, x[1] * size, x[2] * size, x[3] * size, x[4] * size * size]
    };
    fields(random, sized, |r| [0.35 * r.signed(), 0.35 * r.signed(), 0.0, 0.0], [0.1, 10.0])
}

/// Returns the fields of a `Projected`, and the filter radius h. h clearly differs from every length that a filter
/// compares with it, since near a tie rounding may decide either way.
fn fields(
    random: &mut Random,
    ellipse: fn(&mut Random) -> Vec<f32>,
    slopes: fn(&mut Random) -> [f64; 4],
    [least, most]: [f64; 2],
) -> Vec<f32> {
    loop {
        let mut x = ellipse(random);
        let slope = slopes(random);
        let h = random.range(least, most);
        let [sx, sy, tx, ty, det] = [x[0], x[1], x[2], x[3], x[4]].map(f64::from);
        let svd = surfel_math::svd::Svd2::of_columns(surfel_math::V2::new(sx, sy), surfel_math::V2::new(tx, ty), det);
        let limits = [slope[0], slope[1]].map(|a| h * (1.0 - a) * (1.0 + a));
        let lengths = [(svd.major, h), (svd.minor, h), (sx.hypot(sy), limits[0]), (tx.hypot(ty), limits[1])];
        if lengths.iter().all(|(length, limit)| (length - limit).abs() > 1e-3 * limit) {
            x.extend(f32s(&slope));
            x.extend(f32s(&[0.5, -0.5, 0.5, h]));
            return x;
        }
    }
}

/// Returns p, s, t, n (centre, half-axes, normal) of a splat in front of the eye, at depths of 1 to 10. The normal
/// makes an angle of 47° to 80° with the ray.
pub(crate) fn splat(random: &mut Random) -> Vec<f32> {
    splat_at(random, 1.0, 0.17)
}

/// Returns inputs like [`splat`], at depths of 1e-5 to 1e6. The cosine of the angle between normal and ray is 1e-4 to
/// 1.
pub(crate) fn wild_splat(random: &mut Random) -> Vec<f32> {
    let scale = random.wild(5.0).abs();
    let cosine = 10f64.powf(random.range(-4.0, 0.0));
    splat_at(random, scale, cosine)
}

fn splat_at(random: &mut Random, scale: f64, least_cosine: f64) -> Vec<f32> {
    let z = random.range(1.0, 10.0) * scale;
    let p = [0.5 * random.signed() * z, 0.5 * random.signed() * z, z];
    let length = p.iter().map(|v| v * v).sum::<f64>().sqrt();
    let ray = p.map(|v| v / length);
    // The normal has a given angle to the ray, and the two axes are in its plane.
    let cosine = random.range(least_cosine, (least_cosine * 4.0).min(1.0));
    let other = random.direction();
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let unit = |a: [f64; 3]| {
        let l = a.iter().map(|v| v * v).sum::<f64>().sqrt();
        a.map(|v| v / l)
    };
    let across = unit(cross(ray, other));
    let sine = (1.0 - cosine * cosine).sqrt();
    let n: [f64; 3] = std::array::from_fn(|i| -ray[i] * cosine + across[i] * sine);
    let e = unit(cross(n, random.direction()));
    let f = cross(n, e);
    let (long, aspect) = (z * random.range(0.001, 0.2), 10f64.powf(random.range(-2.0, 0.0)));
    let mut x = Vec::with_capacity(12);
    x.extend(p);
    x.extend(e.map(|v| v * long));
    x.extend(f.map(|v| v * long * aspect));
    x.extend(n);
    f32s(&x)
}

/// Returns the nine coefficients of a footprint's three forms, and a pixel offset.
pub(crate) fn footprint(random: &mut Random) -> Vec<f32> {
    let mut x = Vec::with_capacity(11);
    for constant in [0.0, 0.0, 1.0] {
        x.extend([constant, 0.3 * random.signed(), 0.3 * random.signed()]);
    }
    (x[7], x[8]) = (x[7] * 0.05, x[8] * 0.05);
    x.extend([8.0 * random.signed(), 8.0 * random.signed()]);
    f32s(&x)
}

/// Returns inputs like [`footprint`], with gradients of magnitude 1e-3 to 1e3, and offsets of 0.01 to 100 px.
pub(crate) fn wild_footprint(random: &mut Random) -> Vec<f32> {
    let mut x = Vec::with_capacity(11);
    for constant in [0.0, 0.0, 1.0] {
        x.extend([constant, random.wild(3.0), random.wild(3.0)]);
    }
    x.extend([random.wild(2.0), random.wild(2.0)]);
    f32s(&x)
}

/// Returns the forms of an ellipse about its centre: gradients of u, v and w.
pub(crate) fn forms(random: &mut Random) -> Vec<f32> {
    forms_of(&projected(random))
}

/// Returns inputs like [`forms`], of any size.
pub(crate) fn wild_forms(random: &mut Random) -> Vec<f32> {
    forms_of(&wild_projected(random))
}

fn forms_of(x: &[f32]) -> Vec<f32> {
    let x: Vec<f64> = x.iter().map(|&v| v.into()).collect();
    let (s, t, det, a) = ([x[0], x[1]], [x[2], x[3]], x[4], [x[5], x[6]]);
    let (u, v) = ([t[1] / det, -t[0] / det], [-s[1] / det, s[0] / det]);
    f32s(&[u[0], u[1], v[0], v[1], -(u[0] * a[0] + v[0] * a[1]), -(u[1] * a[0] + v[1] * a[1])])
}

/// Returns a footprint and an offset clearly inside or outside of it.
pub(crate) fn clear_of_the_rim(random: &mut Random) -> Vec<f32> {
    loop {
        let x = footprint(random);
        let form = |i: usize| -> f64 {
            let [c, gx, gy, dx, dy] = [x[i], x[i + 1], x[i + 2], x[9], x[10]].map(f64::from);
            c + gx * dx + gy * dy
        };
        let (u, v, w) = (form(0), form(3), form(6));
        if w.abs() > 1e-3 && (u * u + v * v - w * w).abs() > 1e-3 * (u * u + v * v + w * w) {
            return x;
        }
    }
}

/// Returns p, s, t, n of a disk seen at an angle.
pub(crate) fn tilted_disk(random: &mut Random) -> Vec<f32> {
    let mut x = splat_at(random, 1.0, 0.17);
    let length = |v: &[f32]| v.iter().map(|c| c * c).sum::<f32>().sqrt();
    let (s, t) = (length(&x[3..6]), length(&x[6..9]));
    x[6..9].iter_mut().for_each(|c| *c *= s / t);
    x
}

/// Returns p, s, t, n of an ellipse whose axes clearly differ.
pub(crate) fn clear_ellipse(random: &mut Random) -> Vec<f32> {
    loop {
        let x = splat_at(random, 1.0, 0.17);
        let length = |v: &[f32]| v.iter().map(|c| c * c).sum::<f32>().sqrt();
        if length(&x[6..9]) < 0.8 * length(&x[3..6]) {
            return x;
        }
    }
}
