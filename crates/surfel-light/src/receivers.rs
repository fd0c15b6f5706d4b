//! Sums of the light that reaches points of surfaces.

use crate::casters::Casters;
use crate::depth_map::DepthMap;
use crate::directions::Ray;
use glam::Vec3;
use rayon::prelude::*;

/// Distance from a surface, in texels, at which its light is looked up, so that a curved surface casts no shadow on
/// itself. A plane wouldn't even without it.
const OFFSET_TEXELS: f32 = 0.35;

/// Point of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    /// Position in the coordinates of the maps.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Distance from the surface at which the light is looked up, besides that in texels: the noise of its splats.
    pub noise: f32,
    /// Sides on which light is summed.
    pub sides: Sides,
}

/// Sides of a surface on which light is summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sides {
    /// The front.
    Front,
    /// Both; the back from every [`SPARSE`]th direction only.
    FrontAndSparseBack,
    /// Both.
    Both,
}

/// Number of directions per direction that counts in a sparse sum.
const SPARSE: usize = 4;

/// Light that reaches a receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Light {
    /// Light of the sky and of its areas on the front.
    pub front: [f32; 2],
    /// The same on the back.
    pub back: [f32; 2],
}

/// Draws depth maps of side×side texels for all rays, each once, and sums their light over groups of receivers. Returns
/// the light of each group.
///
/// Each receiver's sums are in the order of the rays, so that they don't depend on the number of threads.
pub(crate) fn gather<const N: usize>(
    casters: &Casters,
    rays: &[Ray],
    receivers: [&[Receiver]; N],
    side: usize,
) -> [Vec<Light>; N] {
    let mut light = receivers.map(|group| vec![Light::default(); group.len()]);
    let mut maps: Vec<DepthMap> = Vec::new();
    let at_once = rayon::current_num_threads().clamp(1, 16);
    for (chunk, rays) in rays.chunks(at_once).enumerate() {
        let first = chunk * at_once;
        maps.resize_with(rays.len().max(maps.len()), || DepthMap::new(side));
        maps.par_iter_mut().zip(rays).for_each(|(map, ray)| map.draw(casters, ray.toward));
        let add = |(light, receiver): (&mut Light, &Receiver)| {
            for (i, (map, ray)) in maps.iter().zip(rays).enumerate() {
                light.add(receiver, ray, map, (side, first + i));
            }
        };
        for (light, receivers) in light.iter_mut().zip(receivers) {
            light.par_iter_mut().zip(receivers).with_min_len(1024).for_each(add);
        }
    }
    light
}

/// Least light of the back of a surface whose front is known, over that of its front, at which the back counts.
const BACK_OF_FRONT: f32 = 10.0;

impl Light {
    /// Returns the light of the side that has more.
    pub(crate) fn total(&self) -> f32 {
        let total = |[sky, areas]: [f32; 2]| sky + areas;
        total(self.front).max(total(self.back))
    }

    /// Leaves out the light of the back, unless the front is dark beside it: normals of scans that point inward.
    pub(crate) fn prefer_front(&mut self) {
        let total = |[sky, areas]: [f32; 2]| sky + areas;
        if total(self.back) < BACK_OF_FRONT * total(self.front) {
            self.back = [0.0; 2];
        }
    }

    /// Adds the light of a ray, whose number is given, by its map of side×side texels.
    #[inline]
    fn add(&mut self, receiver: &Receiver, ray: &Ray, map: &DepthMap, (side, number): (usize, usize)) {
        let cosine = receiver.normal.dot(ray.toward);
        let factor = match receiver.sides {
            _ if cosine > 0.0 => 1.0,
            Sides::Front => return,
            Sides::FrontAndSparseBack if number.is_multiple_of(SPARSE) => SPARSE as f32,
            Sides::FrontAndSparseBack => return,
            Sides::Both => 1.0,
        };
        let offset = OFFSET_TEXELS * DepthMap::texel(side) + receiver.noise;
        let from = receiver.position + receiver.normal * offset.copysign(cosine);
        let light = factor * ray.weight * cosine.abs() * map.share(from, receiver.normal);
        let sums = if cosine > 0.0 { &mut self.front } else { &mut self.back };
        sums[usize::from(!ray.is_sky)] += light;
    }
}
