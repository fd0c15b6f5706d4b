//! Resident balls and dots (rendering model §11): in Morton order, in chunks of up to 256, in f32 relative to an f64
//! origin.
//!
//! A *slot* is the index of a ball in the columns of its object ([`StoredBalls`]).

use crate::scene::cloud::CHUNK;
use crate::simd::lanes::LANES;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_model::{BallLight, Material, Shape, SplatCloud};
use surfel_render::ball_scale;

/// A chunk of up to 256 neighbouring balls, the unit of culling.
pub(crate) struct BallChunk {
    /// Object-space origin, relative to which the chunk's centres are stored.
    pub origin: DVec3,
    /// Radius, in object units, of a sphere around the chunk's origin that contains the balls' centres.
    pub centers: f64,
    /// Largest radius of the chunk's balls: in pixels of the image if [`StoredBalls::in_pixels`], else in world units.
    pub largest: f64,
    /// Slot of the chunk's first ball, an index into [`StoredBalls`]'s columns.
    pub first: usize,
    /// Number of balls in the chunk.
    pub count: usize,
}

/// The balls of one object, as this backend stores them: columns with one entry per ball. A ball's *slot* is its index
/// in these columns.
pub(crate) struct StoredBalls {
    pub world_from_object: DAffine3,
    pub material: Material,
    /// Index of the object in the scene.
    pub source: usize,
    /// True if radii are in pixels of the image; else they are in world units.
    pub in_pixels: bool,
    /// True if the splats are dots, which are parallel to the image.
    pub flat: bool,
    pub chunks: Vec<BallChunk>,
    /// Centres relative to the origins of their chunks: columns of x, of y and of z. Each chunk is padded to whole
    /// lanes.
    pub centers: [Vec<f32>; 3],
    /// Radii: in pixels of the image if `in_pixels`, else in world units.
    pub radii: Vec<f32>,
    /// Colours, one per slot; `None` if the cloud has none.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Opacities, one per slot; `None` if every ball is opaque.
    pub alphas: Option<Vec<f32>>,
    /// Stored light of a sky (rendering model §12), one per slot; `None` if the cloud has none.
    pub light: Option<Vec<BallLight>>,
    /// Row in the input file, one per slot; `None` if the cloud has no rows.
    pub rows: Option<Arc<[u32]>>,
    /// Label, one per slot; `None` if the cloud has no labels.
    pub labels: Option<Vec<u32>>,
}

impl StoredBalls {
    /// Converts a cloud of balls or dots to chunks in Morton order; `None` if its splats have another shape.
    pub(crate) fn new(
        cloud: &SplatCloud,
        world_from_object: DAffine3,
        material: Material,
        source: usize,
    ) -> Option<Self> {
        let data = cloud.data();
        let Shape::Balls { radii, in_pixels, flat } = &data.shape else { return None };
        let scale = if *in_pixels { 1.0 } else { ball_scale(&world_from_object) };
        let order = cloud.morton_order();
        // The last ball of a chunk is repeated to fill the lanes; setup ignores balls past `count`.
        let slots: Vec<usize> = order
            .chunks(CHUNK)
            .flat_map(|members| {
                let last = members.len() - 1;
                (0..members.len().next_multiple_of(LANES)).map(move |slot| members[slot.min(last)] as usize)
            })
            .collect();
        let of_slots = |column: &Vec<u32>| slots.iter().map(|&i| column[i]).collect::<Vec<u32>>();
        let mut stored = Self {
            world_from_object,
            material,
            source,
            in_pixels: *in_pixels,
            flat: *flat,
            chunks: Vec::with_capacity(order.len().div_ceil(CHUNK)),
            centers: [const { Vec::new() }; 3].map(|_: Vec<f32>| Vec::with_capacity(slots.len())),
            radii: slots.iter().map(|&i| (f64::from(radii[i]) * scale) as f32).collect(),
            colors: data.colors.as_ref().map(|colors| slots.iter().map(|&i| colors[i]).collect()),
            alphas: cloud.is_transparent().then(|| slots.iter().map(|&i| cloud.alpha(i)).collect()),
            light: data.ball_light.as_ref().map(|light| slots.iter().map(|&i| light[i]).collect()),
            rows: data.rows.as_ref().map(|rows| of_slots(rows).into()),
            labels: data.labels.as_ref().map(of_slots),
        };
        let mut first = 0;
        for members in order.chunks(CHUNK) {
            let padded = members.len().next_multiple_of(LANES);
            let centers = || members.iter().map(|&i| cloud.center(i as usize));
            let (min, max) = centers().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
            let origin = 0.5 * (min + max);
            for &i in &slots[first..first + padded] {
                let local = (cloud.center(i) - origin).as_vec3().to_array();
                stored.centers.iter_mut().zip(local).for_each(|(column, c)| column.push(c));
            }
            stored.chunks.push(BallChunk {
                origin,
                // Enlarged by the rounding of f32.
                centers: centers().map(|p| (p - origin).length()).fold(0.0, f64::max) * (1.0 + 1e-6),
                largest: stored.radii[first..first + padded].iter().copied().fold(0.0, f32::max).into(),
                first,
                count: members.len(),
            });
            first += padded;
        }
        Some(stored)
    }

    /// Replaces the object's matrix and material. Stores the balls anew if the matrix changes radii in world units.
    pub(crate) fn place(&mut self, cloud: &SplatCloud, world_from_object: DAffine3, material: Material) {
        let has_same_sizes = self.in_pixels || ball_scale(&world_from_object) == ball_scale(&self.world_from_object);
        (self.world_from_object, self.material) = (world_from_object, material);
        if !has_same_sizes && let Some(stored) = Self::new(cloud, world_from_object, material, self.source) {
            *self = stored;
        }
    }

    /// Returns the heap memory that the balls use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let floats = self.centers.iter().chain([&self.radii]).chain(&self.alphas);
        floats.map(|column| size_of_val(column.as_slice())).sum::<usize>()
            + self.colors.as_ref().map_or(0, |colors| size_of_val(colors.as_slice()))
            + self.light.as_ref().map_or(0, |light| size_of_val(light.as_slice()))
            + self.rows.as_ref().map_or(0, |rows| size_of_val(&**rows))
            + self.labels.as_ref().map_or(0, |labels| size_of_val(labels.as_slice()))
            + size_of_val(self.chunks.as_slice())
    }
}
