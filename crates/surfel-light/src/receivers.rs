//! Summation of the light that reaches points of surfaces (receivers).

use crate::casters::Casters;
use crate::depth_map::DepthMap;
use crate::directions::Ray;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Offset along the normal, in texels of the depth maps, from a surface point to the position at which its light is
/// looked up. It prevents curved surfaces from casting shadows on themselves; flat surfaces need none.
const OFFSET_TEXELS: f32 = 0.35;

/// Point of a surface at which the light of all directions is summed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    /// Position of the point in the coordinates of the depth maps.
    pub position: Vec3,
    /// Unit normal of the surface's front, in world space.
    pub normal: Vec3,
    /// Additional offset along the normal at which light is looked up, so that noisy splats don't shadow each other; in
    /// units of the depth maps.
    pub noise: f32,
    /// Sides of the surface on which light is summed.
    pub sides: Sides,
}

/// Sides of a surface on which light is summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sides {
    /// Front only: light from behind the surface is ignored.
    Front,
    /// Front from all directions, back from every [`SPARSE`]th direction, which suffices to find out which side is lit.
    FrontAndSparseBack,
    /// Both sides, each from all directions.
    Both,
}

/// Step between the directions that are summed for the back in [`Sides::FrontAndSparseBack`]: every fourth direction is
/// summed, with four times its weight.
const SPARSE: usize = 4;

/// Smallest number of depth maps that are drawn together, before one pass over the receivers looks up all of these
/// maps.
const MIN_MAPS: usize = 4;
/// Largest number of depth maps that are drawn together, before one pass over the receivers. It limits memory.
const MAX_MAPS: usize = 16;

/// Light that reaches both sides of a receiver, as brightness of a white surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Light {
    /// Light on the front: from the sky, and from the sky's bright areas.
    pub front: [f32; 2],
    /// Light on the back: from the sky, and from the sky's bright areas.
    pub back: [f32; 2],
}

/// Number of successive receivers that share one bounding sphere, which is tested against each depth map.
const GROUP: usize = 64;

/// Bounding sphere of the positions at which the light of a group of receivers is looked up.
struct Near {
    center: Vec3,
    radius: f32,
    /// Normal that all receivers of the group share; `None` if their normals differ.
    normal: Option<Vec3>,
}

impl Near {
    /// Computes the bounding sphere of a group of receivers, for depth maps of side×side texels.
    fn of(receivers: &[Receiver], side: usize) -> Self {
        let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for Receiver { position, .. } in receivers {
            (lo, hi) = (lo.min(*position), hi.max(*position));
        }
        let center = 0.5 * (lo + hi);
        let reach = |receiver: &Receiver| receiver.position.distance(center) + offset(receiver, side);
        // The factor is a margin for rounding.
        let radius = receivers.iter().map(reach).fold(0.0, f32::max) * 1.001;
        let normal = receivers.first().map(|first| first.normal);
        let normal = normal.filter(|normal| receivers.iter().all(|receiver| receiver.normal == *normal));
        Self { center, radius, normal }
    }
}

/// Returns the offset along the normal, in units of the depth maps, at which a receiver's light is looked up.
fn offset(receiver: &Receiver, side: usize) -> f32 {
    OFFSET_TEXELS * DepthMap::texel(side) + receiver.noise
}

/// Draws one depth map of side×side texels per ray, and sums the light of all rays at each receiver. Returns the light
/// in the order of `receivers`.
///
/// Each receiver sums in the order of the rays, so that the result doesn't depend on the number of threads.
pub(crate) fn gather<const N: usize>(
    casters: &Casters,
    rays: &[Ray],
    receivers: [&[Receiver]; N],
    side: usize,
) -> [Vec<Light>; N] {
    let mut light = receivers.map(|group| vec![Light::default(); group.len()]);
    let near = receivers.map(|all| all.chunks(GROUP).map(|group| Near::of(group, side)).collect::<Vec<_>>());
    let mut maps: Vec<DepthMap> = Vec::new();
    let at_once = rayon::current_num_threads().clamp(MIN_MAPS, MAX_MAPS);
    for (chunk, rays) in rays.chunks(at_once).enumerate() {
        let first = chunk * at_once;
        maps.resize_with(rays.len().max(maps.len()), || DepthMap::new(side));
        maps.par_iter_mut().zip(rays).for_each(|(map, ray)| map.draw(casters, ray.toward));
        let add = |((light, receivers), near): ((&mut [Light], &[Receiver]), &Near)| {
            for (i, (map, ray)) in maps.iter().zip(rays).enumerate() {
                // Nothing hides the light of a receiver outside of the map.
                let share = |from: Vec3, slope: Vec2| map.share(from, slope);
                let (light, number) = (light.iter_mut().zip(receivers), (side, first + i));
                if map.misses(near.center, near.radius) {
                    light.for_each(|(light, receiver)| light.add(receiver, ray, number, |_| 1.0));
                } else if let Some(slope) = near.normal.map(|normal| map.fall(normal)) {
                    light.for_each(|(light, receiver)| light.add(receiver, ray, number, |from| share(from, slope)));
                } else {
                    let share = |receiver: &Receiver, from| share(from, map.fall(receiver.normal));
                    light.for_each(|(light, receiver)| light.add(receiver, ray, number, |from| share(receiver, from)));
                }
            }
        };
        for ((light, receivers), near) in light.iter_mut().zip(receivers).zip(&near) {
            let groups = light.par_chunks_mut(GROUP).zip(receivers.par_chunks(GROUP)).zip(near);
            groups.with_min_len(16).for_each(add);
        }
    }
    light
}

/// Smallest ratio of the light on the back to the light on the front at which the back of an oriented surface counts.
/// The surface's normals then probably point inward.
const BACK_OF_FRONT: f32 = 10.0;

impl Light {
    /// Returns the light on the brighter side, as the sum of the light from the sky and from its bright areas.
    pub(crate) fn total(&self) -> f32 {
        let total = |[sky, areas]: [f32; 2]| sky + areas;
        total(self.front).max(total(self.back))
    }

    /// Sets the light on the back to zero, unless it is at least [`BACK_OF_FRONT`] times the light on the front. A
    /// front as dark as this shows that the normal of a scan points inward.
    pub(crate) fn prefer_front(&mut self) {
        let total = |[sky, areas]: [f32; 2]| sky + areas;
        if total(self.back) < BACK_OF_FRONT * total(self.front) {
            self.back = [0.0; 2];
        }
    }

    /// Adds the light of the ray with index `number` to the receiver's front or back. `side` is the width of the depth
    /// maps in texels. `share` returns the fraction of the ray's light that reaches a position.
    #[inline]
    fn add(&mut self, receiver: &Receiver, ray: &Ray, (side, number): (usize, usize), share: impl Fn(Vec3) -> f32) {
        let cosine = receiver.normal.dot(ray.toward);
        let factor = match receiver.sides {
            _ if cosine > 0.0 => 1.0,
            Sides::Front => return,
            Sides::FrontAndSparseBack if number.is_multiple_of(SPARSE) => SPARSE as f32,
            Sides::FrontAndSparseBack => return,
            Sides::Both => 1.0,
        };
        let from = receiver.position + receiver.normal * offset(receiver, side).copysign(cosine);
        let light = factor * ray.weight * cosine.abs() * share(from);
        let sums = if cosine > 0.0 { &mut self.front } else { &mut self.back };
        sums[usize::from(!ray.is_sky)] += light;
    }
}
