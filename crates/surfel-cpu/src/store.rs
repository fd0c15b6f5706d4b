//! Splats as they stay resident: Morton order, chunks of 256, f32 about an f64 origin.

use crate::clip::StoredClips;
use crate::column::{Column, Column3, Storage, Units};
use crate::lanes::LANES;
use glam::{DAffine3, DVec3, Vec3};
use surfel_math::kernel::interior_weight_at_cutoff;
use surfel_model::{Material, Shape, SplatCloud};

/// Most splats of a chunk. A multiple of the lane count.
pub(crate) const CHUNK: usize = 256;

/// Largest extent of a chunk in radii of its smallest splat. An offset within it is rounded to 512·2⁻²⁴ = 3e-5 of a radius,
/// which moves a weight by 7e-5 (2.4 times as much at cutoff 2). Neighbours on a surface are far below it; splats of very
/// different size, and strays, get chunks of their own.
const MAX_EXTENT_RADII: f64 = 512.0;

/// Largest radius of a quantised chunk in its smallest.
const MAX_RADII: f64 = 16.0;

/// Extent and orientation of the splats.
pub(crate) enum StoredShape {
    /// Unit normals and radii.
    Disks { normals: Units, radii: Column },
    /// Half-axes.
    Ellipses { s: Column3, t: Column3 },
}

/// Up to 256 splats that lie close together.
pub(crate) struct Chunk {
    /// Object-space origin of the centres.
    pub origin: DVec3,
    /// Radius about `origin` of a ball that holds the splats (not only their centres), object units.
    pub ball: f64,
    /// First splat in the columns.
    pub first: usize,
    /// Number of splats.
    pub count: usize,
    /// Largest coordinate of a centre about `origin`, largest colour, largest radius: what 16 bits are relative to.
    pub scales: Scales,
    /// A cone about all normals, if it is narrower than a half space.
    pub cone: Option<Cone>,
}

/// What a chunk's 16-bit numbers are relative to.
#[derive(Clone, Copy, Default)]
pub(crate) struct Scales {
    pub center: f32,
    pub color: f32,
    pub radius: f32,
}

/// Directions within an angle of an axis.
pub(crate) struct Cone {
    pub axis: DVec3,
    pub sine: f64,
    pub cosine: f64,
}

impl Cone {
    /// The cone about the mean of some unit vectors.
    fn about(normals: impl Iterator<Item = DVec3> + Clone) -> Option<Self> {
        let axis = normals.clone().sum::<DVec3>().try_normalize()?;
        // Rounding of the stored f32 normals, and some more.
        let cosine = normals.map(|n| axis.dot(n)).fold(1.0, f64::min) - 1e-6;
        (cosine > 0.0).then(|| Self { axis, sine: (1.0 - cosine * cosine).sqrt(), cosine })
    }
}

/// One object's splats.
pub(crate) struct StoredObject {
    pub world_from_object: DAffine3,
    pub material: Material,
    pub chunks: Vec<Chunk>,
    /// Centres about their chunks' origins.
    pub centers: Column3,
    pub shape: StoredShape,
    pub colors: Option<Column3>,
    pub shading_normals: Option<Units>,
    pub clips: Option<StoredClips>,
    /// Of every slot, where some splat is transparent. Not rounded: 1 must stay 1.
    pub alphas: Option<Vec<f32>>,
    /// W0 of the material, or of the cloud; 0 if neither says.
    interior_weight: f64,
}

impl StoredObject {
    /// Orders and stores a cloud.
    pub(crate) fn new(cloud: &SplatCloud, world_from_object: DAffine3, material: Material, storage: Storage) -> Self {
        let order = cloud.morton_order();
        let padded = cloud.len() + cloud.len() / LANES;
        let data = cloud.data();
        let mut stored = Self {
            world_from_object,
            material,
            chunks: Vec::with_capacity(padded / CHUNK),
            centers: Column3::new(storage, padded),
            shape: match data.shape {
                Shape::Disks { .. } => {
                    StoredShape::Disks { normals: Units::new(storage, padded), radii: Column::new(storage, padded) }
                }
                Shape::Ellipses { .. } => StoredShape::Ellipses {
                    s: Column3::new(Storage::F32, padded),
                    t: Column3::new(Storage::F32, padded),
                },
            },
            colors: data.colors.as_ref().map(|_| Column3::new(storage, padded)),
            shading_normals: data.shading_normals.as_ref().map(|_| Units::new(storage, padded)),
            clips: data.clips.as_ref().map(|_| StoredClips::default()),
            alphas: cloud.is_transparent().then(|| Vec::with_capacity(padded)),
            interior_weight: material.interior_weight.or(data.interior_weight).unwrap_or(0.0),
        };
        let mut rest = order.as_slice();
        while !rest.is_empty() {
            let (members, after) = rest.split_at(chunk_length(cloud, rest, storage));
            stored.push_chunk(cloud, members);
            rest = after;
        }
        stored
    }

    fn push_chunk(&mut self, cloud: &SplatCloud, members: &[u32]) {
        let centers: Vec<DVec3> = members.iter().map(|&i| cloud.center(i as usize)).collect();
        let (min, max) =
            centers.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        let origin = 0.5 * (min + max);
        let cone = Cone::about(members.iter().map(|&i| cloud.normal(i as usize)));
        let color =
            |&i: &u32| cloud.data().colors.as_ref().map_or(0.0, |_| Vec3::from(cloud.color(i as usize)).max_element());
        let scales = Scales {
            center: centers.iter().fold(0.0, |a, p| a.max((*p - origin).as_vec3().abs().max_element())),
            color: members.iter().map(color).fold(0.0, f32::max),
            radius: members.iter().map(|&i| cloud.radius_max(i as usize) as f32).fold(0.0, f32::max),
        };
        let mut ball = 0.0f64;
        let first = self.centers.len();
        self.chunks.push(Chunk { origin, ball: 0.0, first, count: members.len(), scales, cone });
        // The last splat fills the lanes up; setup ignores what lies past `count`.
        for slot in 0..members.len().next_multiple_of(LANES) {
            let k = slot.min(members.len() - 1);
            let i = members[k] as usize;
            self.centers.push((centers[k] - origin).as_vec3(), scales.center);
            ball = ball.max((centers[k] - origin).length() + cloud.radius_max(i));
            match &mut self.shape {
                StoredShape::Disks { normals, radii } => {
                    normals.push(cloud.normal(i).as_vec3());
                    radii.push(cloud.radius_max(i) as f32, scales.radius);
                }
                StoredShape::Ellipses { s, t } => {
                    let (a, b) = cloud.axes(i);
                    s.push(a.as_vec3(), 1.0);
                    t.push(b.as_vec3(), 1.0);
                }
            }
            if let Some(colors) = &mut self.colors {
                colors.push(Vec3::from(cloud.color(i)), scales.color);
            }
            if let Some(clips) = &mut self.clips {
                clips.push(cloud, i);
            }
            if let Some(alphas) = &mut self.alphas {
                alphas.push(cloud.alpha(i));
            }
            if let Some(normals) = &mut self.shading_normals {
                normals.push(cloud.shading_normal(i).as_vec3());
            }
        }
        if let Some(chunk) = self.chunks.last_mut() {
            // Stored centres and radii are rounded, by 16 bits to 1e-4 of the ball at most.
            chunk.ball = ball * (1.0 + 1e-4);
        }
    }

    /// 1/W0: coverage of a unit of weight inside the cloud's surface (§5). 1 where W0 is not known, and then not needed.
    pub(crate) fn coverage_per_weight(&self, cutoff: f64) -> f32 {
        if self.interior_weight > 0.0 {
            (1.0 / interior_weight_at_cutoff(self.interior_weight, cutoff)) as f32
        } else {
            1.0
        }
    }

    /// Bytes of heap memory in use.
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
            + size_of_val(self.chunks.as_slice())
    }
}

/// How many of the splats, in order, make the next chunk.
fn chunk_length(cloud: &SplatCloud, order: &[u32], storage: Storage) -> usize {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (mut smallest, mut largest) = (f64::INFINITY, 0.0f64);
    for (count, &i) in order.iter().take(CHUNK).enumerate() {
        let p = cloud.center(i as usize);
        (min, max) = (min.min(p), max.max(p));
        let radius = cloud.radius_max(i as usize);
        (smallest, largest) = (smallest.min(radius), largest.max(radius));
        let uneven = storage == Storage::Quantised && largest > MAX_RADII * smallest;
        if count > 0 && (uneven || (max - min).max_element() > MAX_EXTENT_RADII * smallest) {
            return count;
        }
    }
    order.len().min(CHUNK)
}
