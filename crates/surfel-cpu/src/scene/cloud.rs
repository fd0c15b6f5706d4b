//! Resident splats of a cloud: in Morton order, in chunks of up to 256, in f32 (or 16 bits) relative to a chunk's f64
//! origin.

use crate::scene::clips::StoredClips;
use crate::scene::column::{Column, Column3, Units};
use crate::scene::groups::{BoundedSplat, Groups};
use crate::simd::lanes::LANES;
use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::Arc;
use surfel_math::cone::NormalCone;
use surfel_math::kernel::interior_weight_at_cutoff;
use surfel_model::{CHUNK_SPLATS, ChunkSpace, Storage, chunks, stored_axes};
use surfel_model::{Material, Object, Octree, Shape, SplatCloud};

/// Largest number of splats in a chunk.
pub(crate) const CHUNK: usize = CHUNK_SPLATS;

/// Number of chunks that one task stores. It is small, so that splats which were read to form the chunks are still in a
/// cache when they are stored.
const TASK: usize = 8;
/// Number of tasks per thread between two merges of their results. Splats that are stored but not yet merged are in
/// memory twice.
const WAVE: usize = 2;

/// Smallest number of indices that are freed at once from the list that gives the splats' order, while the splats are
/// stored.
const MIN_PART: usize = 1 << 20;

const _: () = assert!(CHUNK.is_multiple_of(LANES), "a chunk fills whole lanes");

/// Columns of the splats' extents and orientations.
pub(crate) enum StoredShape {
    /// Disks, by their unit normals and radii.
    Disks { normals: Units, radii: Column },
    /// Ellipses, by their half-axes s and t.
    Ellipses { s: Column3, t: Column3 },
}

/// A chunk of up to 256 neighbouring splats, the unit of culling, with bounds of its splats.
pub(crate) struct Chunk {
    /// Object-space origin, relative to which the centres are stored, and the scales of 16-bit numbers.
    pub space: ChunkSpace,
    /// Radius, in object units, of a sphere around the chunk's origin that contains the splats, not only their centres.
    pub radius: f64,
    /// Half extents, in object units, of a box around the chunk's origin that contains the splats. The box is aligned
    /// with the object's axes.
    pub half: DVec3,
    /// Total area of the splats, in square object units.
    pub area: f64,
    /// Index in the cloud of one of the chunk's splats, for testing whether an octree's selection contains the chunk.
    /// It represents all of them, since an octree's splats of one chunk are drawn together or not at all.
    pub member: u32,
    /// Slot of the chunk's first splat, an index into the object's columns.
    pub first: usize,
    /// Number of splats in the chunk.
    pub count: usize,
    /// A cone that contains all normals of the chunk; `None` if it would not be narrower than a half space.
    pub cone: Option<NormalCone>,
}

/// The splats of one object, as this backend stores them: columns of numbers with one entry per splat. A splat's *slot*
/// is its index in these columns; splats are in Morton order, chunk by chunk.
pub(crate) struct StoredObject {
    pub world_from_object: DAffine3,
    pub material: Material,
    /// Index of the object in the scene if it is an octree; `None` for a cloud.
    pub octree: Option<usize>,
    pub chunks: Vec<Chunk>,
    /// Bounds of the groups of 16 splats in each chunk, in the order of `chunks`.
    pub groups: Vec<Groups>,
    /// Centres, relative to the origins of their chunks, one per slot.
    pub centers: Column3,
    pub shape: StoredShape,
    pub colors: Option<Column3>,
    pub shading_normals: Option<Units>,
    pub clips: Option<StoredClips>,
    /// Index of the object in the scene.
    pub source: usize,
    /// Row in the input file, one per slot; `None` if the cloud has no rows.
    pub rows: Option<Arc<[u32]>>,
    /// Label, one per slot; `None` if the cloud has no labels.
    pub labels: Option<Vec<u32>>,
    /// Opacity, one per slot; `None` if every splat is opaque. Opacities are never quantised, so that 1 remains exactly
    /// 1.
    pub alphas: Option<Vec<f32>>,
    /// Interior weight W0, the sum of weights inside the cloud's own surface, as the material or the cloud states it; 0
    /// if neither does.
    interior_weight: f64,
    /// True if all outward normals of the cloud point out of the same surface.
    pub oriented: bool,
}

impl StoredObject {
    /// Stores a cloud's splats in Morton order, so that neighbours are in the same chunk.
    pub(crate) fn new(cloud: &SplatCloud, world_from_object: DAffine3, material: Material, storage: Storage) -> Self {
        Self::ordered(cloud, (world_from_object, material), storage, std::iter::once(cloud.morton_order()))
    }

    /// Stores an octree's cloud, in chunks that each belong to one node or transition.
    pub(crate) fn of_octree(index: usize, octree: &Octree, object: &Object, storage: Storage) -> Self {
        let place = (object.world_from_object, object.material);
        let stored = Self::ordered(octree.cloud(), place, storage, octree.parts().map(Iterator::collect));
        Self { octree: Some(index), ..stored }
    }

    /// Returns an object without splats, with the empty columns that the cloud needs.
    fn empty(
        cloud: &SplatCloud,
        (world_from_object, material): (DAffine3, Material),
        storage: Storage,
        capacity: usize,
    ) -> Self {
        let data = cloud.data();
        Self {
            world_from_object,
            material,
            octree: None,
            chunks: Vec::with_capacity(capacity / CHUNK),
            groups: Vec::with_capacity(capacity / CHUNK),
            centers: Column3::new(storage, capacity),
            shape: match data.shape {
                // Balls are stored elsewhere; octrees have none.
                Shape::Disks { .. } | Shape::Balls { .. } => {
                    StoredShape::Disks { normals: Units::new(storage, capacity), radii: Column::new(storage, capacity) }
                }
                Shape::Ellipses { .. } => StoredShape::Ellipses {
                    s: Column3::new(Storage::F32, capacity),
                    t: Column3::new(Storage::F32, capacity),
                },
            },
            colors: data.colors.as_ref().map(|_| Column3::new(storage, capacity)),
            shading_normals: data.shading_normals.as_ref().map(|_| Units::new(storage, capacity)),
            clips: data.clips.as_ref().map(|_| StoredClips::default()),
            source: 0,
            rows: None,
            labels: data.labels.as_ref().map(|_| Vec::with_capacity(capacity)),
            alphas: cloud.is_transparent().then(|| Vec::with_capacity(capacity)),
            interior_weight: material.interior_weight.or(data.interior_weight).unwrap_or(0.0),
            oriented: material.is_oriented(cloud),
        }
    }

    /// Replaces the object's material, and updates the interior weight and the orientation, which depend on it.
    pub(crate) fn set_material(&mut self, material: Material, cloud: &SplatCloud) {
        self.material = material;
        self.interior_weight = material.interior_weight.or(cloud.data().interior_weight).unwrap_or(0.0);
        self.oriented = material.is_oriented(cloud);
    }

    /// Stores a cloud's splats in the order of the indices in `parts`. No chunk contains splats of two parts.
    fn ordered(
        cloud: &SplatCloud,
        place: (DAffine3, Material),
        storage: Storage,
        parts: impl Iterator<Item = Vec<u32>>,
    ) -> Self {
        let padded = cloud.len() + cloud.len() / LANES;
        let wave = TASK * WAVE * rayon::current_num_threads();
        let mut stored = Self::empty(cloud, place, storage, padded);
        let mut rows = cloud.data().rows.as_ref().map(|rows| (rows, Vec::with_capacity(padded)));
        for mut order in parts {
            while !order.is_empty() {
                // The processed part of an order is freed while the columns grow.
                let (mut used, part) = (0, (order.len() / 4).max(MIN_PART));
                let mut chunks = chunks(cloud, &order, storage);
                while used < part {
                    let wave: Vec<_> = chunks.by_ref().take(wave).collect();
                    if wave.is_empty() {
                        break;
                    }
                    used += wave.iter().map(|(_, members)| members.len()).sum::<usize>();
                    if let Some((rows, of_slots)) = &mut rows {
                        for (_, members) in &wave {
                            of_slots.extend(members.iter().map(|&i| rows[i as usize]));
                            of_slots.resize(of_slots.len().next_multiple_of(LANES), u32::MAX);
                        }
                    }
                    let part_of = |task: &[(ChunkSpace, &[u32])]| {
                        let mut part = Self::empty(cloud, place, storage, TASK * CHUNK);
                        task.iter().for_each(|(space, members)| part.push_chunk(cloud, *space, members));
                        part
                    };
                    let parts: Vec<Self> = wave.par_chunks(TASK).map(part_of).collect();
                    parts.into_iter().for_each(|part| stored.append(part));
                }
                drop(chunks);
                order.drain(..used);
                order.shrink_to_fit();
            }
        }
        stored.rows = rows.map(|(_, of_slots)| of_slots.into());
        // A file may have columns of clips without any clip.
        stored.clips.take_if(|clips| clips.is_empty());
        stored.trim();
        stored
    }

    /// Appends the chunks and columns of another part of the same cloud.
    fn append(&mut self, part: Self) {
        let base = self.centers.len();
        self.chunks.extend(part.chunks.into_iter().map(|chunk| Chunk { first: base + chunk.first, ..chunk }));
        self.groups.extend(part.groups);
        self.centers.append(part.centers);
        match (&mut self.shape, part.shape) {
            (StoredShape::Disks { normals, radii }, StoredShape::Disks { normals: n, radii: r }) => {
                normals.append(n);
                radii.append(r);
            }
            (StoredShape::Ellipses { s, t }, StoredShape::Ellipses { s: a, t: b }) => {
                s.append(a);
                t.append(b);
            }
            _ => unreachable!("parts of a cloud have its shape"),
        }
        self.clips.iter_mut().zip(part.clips).for_each(|(clips, more)| clips.append(more));
        self.colors.iter_mut().zip(part.colors).for_each(|(column, more)| column.append(more));
        self.shading_normals.iter_mut().zip(part.shading_normals).for_each(|(column, more)| column.append(more));
        self.labels.iter_mut().zip(part.labels).for_each(|(column, more)| column.extend(more));
        self.alphas.iter_mut().zip(part.alphas).for_each(|(column, more)| column.extend(more));
    }

    /// Frees memory that was reserved for the padding of chunks but wasn't needed.
    fn trim(&mut self) {
        self.chunks.shrink_to_fit();
        self.groups.shrink_to_fit();
        self.centers.trim();
        match &mut self.shape {
            StoredShape::Disks { normals, radii } => {
                normals.trim();
                radii.trim();
            }
            StoredShape::Ellipses { s, t } => [s, t].into_iter().for_each(Column3::trim),
        }
        self.colors.iter_mut().for_each(Column3::trim);
        self.shading_normals.iter_mut().for_each(Units::trim);
        self.alphas.iter_mut().for_each(Vec::shrink_to_fit);
        self.labels.iter_mut().for_each(Vec::shrink_to_fit);
    }

    fn push_chunk(&mut self, cloud: &SplatCloud, space: ChunkSpace, members: &[u32]) {
        let splats = members.iter().map(|&i| i as usize).map(|i| BoundedSplat {
            center: cloud.center(i) - space.origin,
            radius: cloud.radius_max(i),
            normal: cloud.normal(i),
        });
        let mut splats: Vec<BoundedSplat> = splats.collect();
        let cone = NormalCone::about(splats.iter().map(|splat| splat.normal));
        let (mut radius, mut half, mut area) = (0.0f64, DVec3::ZERO, 0.0);
        let first = self.centers.len();
        let member = members.first().copied().unwrap_or_default();
        self.chunks.push(Chunk { space, radius: 0.0, half, area, member, first, count: members.len(), cone });
        // The last splat is repeated to fill the lanes; setup ignores splats past `count`.
        for slot in 0..members.len().next_multiple_of(LANES) {
            let k = slot.min(members.len() - 1);
            let (i, splat) = (members[k] as usize, &splats[k]);
            self.centers.push(splat.center.as_vec3(), space.center);
            if slot == k {
                let (s, t) = cloud.axes(i);
                radius = radius.max(splat.center.length() + splat.radius);
                half = half.max(splat.center.abs() + (s * s + t * t).map(f64::sqrt));
                area += PI * s.cross(t).length();
            }
            match &mut self.shape {
                StoredShape::Disks { normals, radii } => {
                    normals.push(splat.normal.as_vec3());
                    radii.push(splat.radius as f32, space.radius);
                }
                StoredShape::Ellipses { s, t } => {
                    let (a, b) = stored_axes(cloud, i);
                    s.push(a, 1.0);
                    t.push(b, 1.0);
                }
            }
            if let Some(colors) = &mut self.colors {
                colors.push(Vec3::from(cloud.color(i)), space.color);
            }
            if let Some(clips) = &mut self.clips {
                clips.push(cloud, i);
            }
            if let Some(alphas) = &mut self.alphas {
                alphas.push(cloud.alpha(i));
            }
            if let (Some(to), Some(labels)) = (&mut self.labels, &cloud.data().labels) {
                to.push(labels[i]);
            }
            if let Some(normals) = &mut self.shading_normals {
                normals.push(cloud.shading_normal(i).as_vec3());
            }
        }
        if let Some(chunk) = self.chunks.last_mut() {
            // Storage rounds centres and radii; 16-bit storage by up to 1e-4 of the bounding sphere's radius.
            chunk.radius = radius * (1.0 + 1e-4);
            chunk.half = half + DVec3::splat(radius * 1e-4);
            chunk.area = area;
            splats.iter_mut().for_each(|splat| splat.radius += radius * 1e-4);
            self.groups.push(Groups::of(chunk, &splats));
        }
    }

    /// Returns the factor from weight to coverage, 1/W0, with W0 the sum of weights inside the cloud's surface
    /// (rendering model §5). Returns 1 if W0 is unknown, because coverage isn't needed then.
    pub(crate) fn coverage_per_weight(&self, cutoff: f64) -> f32 {
        if self.interior_weight > 0.0 {
            (1.0 / interior_weight_at_cutoff(self.interior_weight, cutoff)) as f32
        } else {
            1.0
        }
    }

    /// Returns the heap memory that the splats use, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        let shape = match &self.shape {
            StoredShape::Disks { normals, radii } => normals.bytes() + radii.bytes(),
            StoredShape::Ellipses { s, t } => s.bytes() + t.bytes(),
        };
        shape
            + self.centers.bytes()
            + self.colors.as_ref().map_or(0, Column3::bytes)
            + self.shading_normals.as_ref().map_or(0, Units::bytes)
            + self.clips.as_ref().map_or(0, StoredClips::bytes)
            + self.alphas.as_ref().map_or(0, |a| size_of_val(a.as_slice()))
            + self.rows.as_ref().map_or(0, |rows| size_of_val(&**rows))
            + self.labels.as_ref().map_or(0, |labels| size_of_val(labels.as_slice()))
            + size_of_val(self.chunks.as_slice())
            + size_of_val(self.groups.as_slice())
    }
}
