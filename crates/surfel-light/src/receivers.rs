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
    /// True if the surface may be seen from both sides.
    pub has_two_sides: bool,
}

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
    for rays in rays.chunks(rayon::current_num_threads().clamp(1, 16)) {
        maps.resize_with(rays.len().max(maps.len()), || DepthMap::new(side));
        maps.par_iter_mut().zip(rays).for_each(|(map, ray)| map.draw(casters, ray.toward));
        let add = |(light, receiver): (&mut Light, &Receiver)| {
            for (map, ray) in maps.iter().zip(rays) {
                light.add(receiver, ray, map, side);
            }
        };
        for (light, receivers) in light.iter_mut().zip(receivers) {
            light.par_iter_mut().zip(receivers).with_min_len(1024).for_each(add);
        }
    }
    light
}

impl Light {
    #[inline]
    fn add(&mut self, receiver: &Receiver, ray: &Ray, map: &DepthMap, side: usize) {
        let cosine = receiver.normal.dot(ray.toward);
        if cosine <= 0.0 && !receiver.has_two_sides {
            return;
        }
        let offset = OFFSET_TEXELS * DepthMap::texel(side) + receiver.noise;
        let from = receiver.position + receiver.normal * offset.copysign(cosine);
        let light = ray.weight * cosine.abs() * map.share(from, receiver.normal);
        let sums = if cosine > 0.0 { &mut self.front } else { &mut self.back };
        sums[usize::from(!ray.is_sky)] += light;
    }
}
