//! Weight functions of a cloud's splats on their own surface, with which a close view blends the splats.
//!
//! A *slot* is a splat's place in the order of the k-d tree of the splats' centres ([`KdTree`]). A *cell* is a cubic
//! cell of the grid into which samples are sorted ([`Samples`](super::samples::Samples)).

use crate::parallel::map_each;
use crate::progress::NoProgress;
use crate::tree::KdTree;
use glam::DVec3;
use surfel_math::{V2, clip::Clip, kernel};
use surfel_model::{ClipPolicy, SplatCloud};

/// Largest distance from a splat's centre, in radii, at which the splat has weight: its own radius, and a quarter for a
/// surface that curves away.
pub(super) const REACH: f64 = 1.25;
/// Smallest cosine (60°) between the normals of a splat and of a surface point at which the splat has weight there.
/// Other splats belong to another part of the surface, as for the interior weight.
const SAME_SURFACE: f64 = 0.5;
/// Cutoff c of the weight exp(−c·ρ²): the renderer's default.
const CUTOFF: f64 = 2.0;

/// Weight function w of a splat, evaluated at points of the surface.
#[derive(Clone, Default)]
pub(super) struct Kernel {
    /// Position of the splat's centre, relative to the cloud's origin.
    center: DVec3,
    /// Unit normal of the splat; zero if the splat was removed.
    normal: DVec3,
    /// Dual basis of the half-axes. Its dot products with an offset in the splat's plane are the offset's (u, v),
    /// coordinates in units of the half-axes.
    dual: [DVec3; 2],
    /// Length of the larger half-axis, in object units.
    radius: f64,
    clip: Option<Box<Clip<f64>>>,
}

impl Kernel {
    fn new(cloud: &SplatCloud, i: usize) -> Self {
        let (s, t) = cloud.axes(i);
        let m = s.cross(t);
        let scale = 1.0 / m.length_squared();
        Self {
            center: cloud.data().centers.get(i),
            normal: cloud.normal(i),
            dual: [t.cross(m) * scale, m.cross(s) * scale],
            radius: cloud.radius_max(i),
            clip: cloud.data().clips.as_ref().and_then(|c| c.clip(i, ClipPolicy::Exact)).map(Box::new),
        }
    }

    fn sphere(&self) -> Sphere {
        let reach = REACH * self.radius;
        Sphere { center: self.center, radius_squared: reach * reach }
    }

    /// Returns w at the intersection of the splat's plane with the line through `point` along the unit `normal`. The
    /// weight is 0 outside of the disk, its clip or [`REACH`], and if the normals differ by more than 60°.
    pub(super) fn weight(&self, point: DVec3, normal: DVec3) -> f64 {
        let d = point - self.center;
        let facing = self.normal.dot(normal);
        if !self.sphere().contains(point) || facing < SAME_SURFACE {
            return 0.0;
        }
        let hit = d - self.normal.dot(d) / facing * normal;
        let at = V2::new(hit.dot(self.dual[0]), hit.dot(self.dual[1]));
        let rho_squared = at.x * at.x + at.y * at.y;
        // For a splat without extent, ρ² is NaN, and the comparison false.
        let within = rho_squared <= 1.0 && self.clip.as_ref().is_none_or(|clip| clip.keeps(at));
        if within { kernel::weight(rho_squared, CUTOFF) } else { 0.0 }
    }
}

/// Weight functions of all splats, in the order of a k-d tree over their centres, so that neighbours are close in
/// memory.
pub(super) struct Kernels {
    pub(super) tree: KdTree,
    reach_below: Vec<f64>,
    of_slot: Vec<Kernel>,
}

impl Kernels {
    pub(super) fn new(cloud: &SplatCloud) -> Self {
        let centers: Vec<DVec3> = (0..cloud.len()).map(|i| cloud.data().centers.get(i)).collect();
        let tree = KdTree::new(&centers);
        drop(centers);
        let of_slot = map_each(tree.len(), &NoProgress, || (), |(), slot| Kernel::new(cloud, tree.index(slot)));
        let reach: Vec<f64> = (0..cloud.len()).map(|i| REACH * cloud.radius_max(i)).collect();
        let reach_below = tree.largest_below(&reach);
        Self { tree, reach_below, of_slot }
    }

    /// Removes a splat from all queries: its weight becomes 0 everywhere.
    pub(super) fn remove(&mut self, slot: usize) {
        self.of_slot[slot].normal = DVec3::ZERO;
    }

    pub(super) fn len(&self) -> usize {
        self.of_slot.len()
    }

    pub(super) fn get(&self, slot: usize) -> &Kernel {
        &self.of_slot[slot]
    }

    /// Returns the median radius of the splats, in object units, from which the size of the samples' grid cells
    /// follows.
    pub(super) fn median_radius(&self) -> f64 {
        let mut radii: Vec<f64> = self.of_slot.iter().map(|k| k.radius).collect();
        crate::radii::median(&mut radii).unwrap_or(0.0)
    }

    /// Returns the slots, ascending, of the splats that may have weight inside a sphere.
    pub(super) fn near(&self, center: DVec3, radius: f64) -> Vec<u32> {
        let mut slots = Vec::new();
        self.tree.near(center, radius, &self.reach_below, &mut |slot| {
            let k = &self.of_slot[slot];
            let reach = radius + REACH * k.radius;
            if k.normal != DVec3::ZERO && center.distance_squared(k.center) <= reach * reach {
                slots.push(slot as u32);
            }
        });
        slots
    }

    /// Returns the sphere that contains all points where a slot's splat may have weight.
    pub(super) fn sphere(&self, slot: u32) -> Sphere {
        self.of_slot[slot as usize].sphere()
    }
}

/// Sphere that contains all points where a splat may have weight.
pub(super) struct Sphere {
    center: DVec3,
    radius_squared: f64,
}

impl Sphere {
    pub(super) fn contains(&self, point: DVec3) -> bool {
        point.distance_squared(self.center) <= self.radius_squared
    }
}
