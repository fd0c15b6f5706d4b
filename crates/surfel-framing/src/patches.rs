//! Sample of a scene's surface, limited in size, so that estimates of the up axis and the view take limited time.

use crate::strays::{Kind, without_strays_of};
use glam::DVec3;
use surfel_math::{gaussian, srgb};
use surfel_model::{GaussianCloud, Geometry, Object};

/// Largest number of patches in a sample.
pub const MOST: usize = 20_000;
/// Minimum number of patches from which a shape can be estimated.
const FEWEST: usize = 24;
/// Sampled piece of surface, an ellipse. Lengths are in units of [`Patches::scale`].
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// Centre, relative to [`Patches::middle`]. Its length is at most 1.
    pub position: DVec3,
    /// Unit outward normal.
    pub normal: DVec3,
    /// Half-axes of the ellipse, enlarged so that the sampled patches still cover the surface.
    pub axes: [DVec3; 2],
    /// Area of the ellipse before it was enlarged, divided by π.
    pub area: f64,
    /// Colour in linear RGB.
    pub color: [f32; 3],
    /// True if the normal distinguishes outside from inside. False for a Gaussian, whose normal has an arbitrary sign.
    pub has_sides: bool,
    /// True if the normal is stored in the file and fits the positions of the points. False if it is estimated from
    /// neighbours or doesn't fit, and for geometry other than clouds of splats.
    pub is_given: bool,
}

/// Smallest cosine (of an angle of 20°) at which a splat's stored normal counts as fitting ([`Patch::is_given`]). The
/// angle is between the shading normal, which the file stores, and the disk's normal, which fits the neighbouring
/// points.
const FITS: f64 = 0.94;

/// A sample of a scene's surface, without stray points.
#[derive(Clone, Debug)]
pub struct Patches {
    /// Patches of the sample.
    pub all: Vec<Patch>,
    /// World-space origin of the patches' positions: the centre of the bounds of the patches.
    pub middle: DVec3,
    /// World units per unit of the patches' lengths: half of the diagonal of the bounds of their centres.
    pub scale: f64,
    /// Sum of the patches' areas, each as in [`Patch::area`].
    pub area: f64,
    /// Mean position of the patches, weighted by area.
    pub centroid: DVec3,
}

/// Returns a pseudo-random number for the `i`-th entry of a sample, so that sampling never aligns with an order of the
/// data.
fn scattered(i: u64) -> u64 {
    // The finaliser of SplitMix64 (Steele, Lea, Flood 2014).
    let z = (i ^ (i >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Returns the number of splats or triangles of a geometry.
fn count(geometry: &Geometry) -> usize {
    match geometry {
        Geometry::Splats(cloud) => cloud.len(),
        Geometry::Mesh(mesh) => mesh.triangles.len(),
        Geometry::Gaussians(gaussians) => gaussians.len(),
        Geometry::Octree(octree) => octree.finest().map(|range| range.len()).sum(),
    }
}

/// Returns the factor by which the half-axes of sampled patches are enlarged so that the sample covers the surface.
/// `total` is the number of splats and triangles of the scene.
fn growth(total: usize) -> f64 {
    (total as f64 / total.clamp(1, MOST) as f64).sqrt()
}

impl Patches {
    /// Returns the factor by which the half-axes of an object's sampled patches are enlarged, so that the sample covers
    /// the surface. It is 1 if every splat or triangle is sampled.
    pub fn growth(object: &Object) -> f64 {
        growth(count(&object.geometry))
    }

    /// Samples patches of the objects' surfaces, at most [`MOST`], without stray points. `None` if there are too few
    /// patches, or if their extent is zero or not finite.
    pub fn of(objects: &[Object]) -> Option<Self> {
        let total: usize = objects.iter().map(|o| count(&o.geometry)).sum();
        let wanted = total.min(MOST);
        let growth = growth(total);
        let mut all = Vec::with_capacity(wanted);
        let mut first = 0;
        for object in objects {
            let len = count(&object.geometry);
            let last = first + len;
            let place = |k: usize| -> usize {
                let (lo, hi) = (k * total / wanted, (k + 1) * total / wanted);
                lo + (scattered(k as u64) % (hi - lo).max(1) as u64) as usize
            };
            let from = (first * wanted).checked_div(total).unwrap_or(0).saturating_sub(1);
            let numbers = (from..wanted).map(place).skip_while(|i| *i < first).take_while(|i| *i < last);
            take(object, numbers.map(|i| i - first), growth, &mut all);
            first = last;
        }
        Self::normalised(all, Kind::of(objects))
    }

    /// Returns a sample that consists of the patches with the given indices, without stray points, with its own centre
    /// and scale. Returns `None` if there are too few patches, or if their extent is zero.
    pub fn some(&self, numbers: &[usize]) -> Option<Self> {
        let in_world = |number: &usize| {
            let p = self.all[*number];
            Patch {
                position: p.position * self.scale + self.middle,
                axes: p.axes.map(|axis| axis * self.scale),
                area: p.area * self.scale * self.scale,
                ..p
            }
        };
        Self::normalised(numbers.iter().map(in_world).collect(), Kind::Other)
    }

    fn normalised(mut all: Vec<Patch>, kind: Kind) -> Option<Self> {
        all.retain(|p| p.position.is_finite() && p.area.is_finite() && p.normal.is_finite());
        if all.len() < FEWEST {
            return None;
        }
        let positions: Vec<DVec3> = all.iter().map(|p| p.position).collect();
        if let Some(sphere) = without_strays_of(&positions, kind) {
            all.retain(|p| sphere.contains(p.position));
        }
        let fold = |f: fn(DVec3, DVec3) -> DVec3| all.iter().map(|p| p.position).reduce(f);
        let (lo, hi) = (fold(DVec3::min)?, fold(DVec3::max)?);
        let (middle, scale) = ((lo + hi) * 0.5, 0.5 * (hi - lo).length());
        if !(scale > 0.0 && scale.is_finite()) {
            return None;
        }
        for patch in &mut all {
            patch.position = (patch.position - middle) / scale;
            patch.axes = patch.axes.map(|axis| axis / scale);
            patch.area /= scale * scale;
        }
        let area = all.iter().map(|p| p.area).sum();
        let patches = Self { all, middle, scale, area, centroid: DVec3::ZERO };
        Some(Self { centroid: patches.mean(|p| p.position), ..patches })
    }

    /// Returns the mean of a vector over the surface, weighted by area.
    pub fn mean(&self, of: impl Fn(&Patch) -> DVec3) -> DVec3 {
        self.all.iter().map(|p| of(p) * p.area).sum::<DVec3>() / self.area
    }

    /// Returns the size of the bounds of the patches' centres along x, y and z, in units of `scale`.
    pub fn extent(&self) -> DVec3 {
        let fold = |f: fn(DVec3, DVec3) -> DVec3| self.all.iter().map(|p| p.position).reduce(f).unwrap_or_default();
        fold(DVec3::max) - fold(DVec3::min)
    }
}

/// Adds splats or triangles of an object to `all`, as patches in world space. `numbers` are their indices, and `growth`
/// is the factor on their half-axes.
fn take(object: &Object, numbers: impl Iterator<Item = usize>, growth: f64, all: &mut Vec<Patch>) {
    let m = object.world_from_object;
    let flip = if m.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
    let has_sides = !matches!(object.geometry, Geometry::Gaussians(_));
    let is_given = |i: usize| match &object.geometry {
        Geometry::Splats(cloud) => {
            !cloud.data().oriented
                && (cloud.data().shading_normals.is_none()
                    || cloud.shading_normal(i).normalize_or_zero().dot(cloud.normal(i)) >= FITS)
        }
        _ => false,
    };
    let mut add = |(p, s, t): (DVec3, DVec3, DVec3), color: [f32; 3], is_given: bool| {
        let (s, t) = (m.transform_vector3(s), m.transform_vector3(t));
        let cross = s.cross(t);
        let area = cross.length();
        if area > 0.0 {
            let (position, normal) = (m.transform_point3(p), cross * (flip / area));
            all.push(Patch { position, normal, axes: [s * growth, t * growth], area, color, has_sides, is_given });
        }
    };
    match &object.geometry {
        Geometry::Splats(cloud) => {
            for i in numbers {
                let (s, t) = cloud.axes(i);
                add((cloud.center(i), s, t), cloud.color(i), is_given(i));
            }
        }
        Geometry::Gaussians(gaussians) => {
            for i in numbers {
                let (s, t) = gaussians.ellipse(i);
                add((gaussians.center(i), s, t), color_of(gaussians, i), false);
            }
        }
        Geometry::Octree(octree) => {
            let cloud = octree.cloud();
            let finest: Vec<u32> = octree.finest().flatten().collect();
            for i in numbers.map(|i| finest[i] as usize) {
                let (s, t) = cloud.axes(i);
                add((cloud.center(i), s, t), cloud.color(i), false);
            }
        }
        Geometry::Mesh(mesh) => {
            for i in numbers {
                let [a, b, c] = mesh.triangles[i].map(|v| mesh.positions.get(v as usize));
                let color = mesh.colors.as_ref().map_or([1.0; 3], |c| c[mesh.triangles[i][0] as usize]);
                // The ellipse has its centre at the triangle's centroid, and a third of two edges as half-axes.
                add((mesh.origin + (a + b + c) / 3.0, (b - a) / 3.0, (c - a) / 3.0), color, false);
            }
        }
    }
}

/// Returns a Gaussian's linear colour, averaged over all directions, from its constant harmonic.
fn color_of(gaussians: &GaussianCloud, i: usize) -> [f32; 3] {
    let constant = gaussians.coefficients(i).get(..1).unwrap_or_default();
    let color = gaussian::color(constant, [0.0; 3]);
    color.map(|c| if gaussians.data().linear_colors { c } else { srgb::decode(c) } as f32)
}
