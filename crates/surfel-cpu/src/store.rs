//! Splats as they stay resident: Morton order, chunks of 256, f32 about an f64 origin.

use crate::lanes::LANES;
use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;
use surfel_math::kernel::interior_weight_at_cutoff;
use surfel_model::{Material, Shape, SplatCloud};

/// Most splats of a chunk. A multiple of the lane count.
pub(crate) const CHUNK: usize = 256;

/// Largest extent of a chunk in radii of its smallest splat. An offset within it is rounded to 512·2⁻²⁴ = 3e-5 of a radius,
/// which moves a weight by 7e-5 (2.4 times as much at cutoff 2). Neighbours on a surface are far below it; splats of very
/// different size, and strays, get chunks of their own.
const MAX_EXTENT_RADII: f64 = 512.0;

/// A column of vectors in structure-of-arrays form. Every chunk is padded to whole lanes.
#[derive(Default)]
pub(crate) struct Soa3 {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub z: Vec<f32>,
}

impl Soa3 {
    fn with_capacity(n: usize) -> Self {
        Self { x: Vec::with_capacity(n), y: Vec::with_capacity(n), z: Vec::with_capacity(n) }
    }

    fn push(&mut self, v: Vec3) {
        self.x.push(v.x);
        self.y.push(v.y);
        self.z.push(v.z);
    }

    fn bytes(&self) -> usize {
        3 * size_of_val(self.x.as_slice())
    }
}

/// Extent and orientation of the splats.
pub(crate) enum StoredShape {
    /// Unit normals and radii.
    Disks { normals: Soa3, radii: Vec<f32> },
    /// Half-axes.
    Ellipses { s: Soa3, t: Soa3 },
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
    /// A cone about all normals, if it is narrower than a half space.
    pub cone: Option<Cone>,
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
    pub centers: Soa3,
    pub shape: StoredShape,
    pub colors: Option<Soa3>,
    pub shading_normals: Option<Soa3>,
    /// W0 of the material, or of the cloud; 0 if neither says.
    interior_weight: f64,
}

impl StoredObject {
    /// Orders and stores a cloud.
    pub(crate) fn new(cloud: &SplatCloud, world_from_object: DAffine3, material: Material) -> Self {
        let order = morton_order(cloud);
        let padded = cloud.len() + cloud.len() / LANES;
        let data = cloud.data();
        let mut stored = Self {
            world_from_object,
            material,
            chunks: Vec::with_capacity(padded / CHUNK),
            centers: Soa3::with_capacity(padded),
            shape: match data.shape {
                Shape::Disks { .. } => {
                    StoredShape::Disks { normals: Soa3::with_capacity(padded), radii: Vec::with_capacity(padded) }
                }
                Shape::Ellipses { .. } => {
                    StoredShape::Ellipses { s: Soa3::with_capacity(padded), t: Soa3::with_capacity(padded) }
                }
            },
            colors: data.colors.as_ref().map(|_| Soa3::with_capacity(padded)),
            shading_normals: data.shading_normals.as_ref().map(|_| Soa3::with_capacity(padded)),
            interior_weight: material.interior_weight.or(data.interior_weight).unwrap_or(0.0),
        };
        let mut rest = order.as_slice();
        while !rest.is_empty() {
            let (members, after) = rest.split_at(chunk_length(cloud, rest));
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
        let mut ball = 0.0f64;
        let cone = Cone::about(members.iter().map(|&i| cloud.normal(i as usize)));
        self.chunks.push(Chunk { origin, ball: 0.0, first: self.centers.x.len(), count: members.len(), cone });
        // The last splat fills the lanes up; setup ignores what lies past `count`.
        for slot in 0..members.len().next_multiple_of(LANES) {
            let k = slot.min(members.len() - 1);
            let i = members[k] as usize;
            self.centers.push((centers[k] - origin).as_vec3());
            ball = ball.max((centers[k] - origin).length() + cloud.radius_max(i));
            match &mut self.shape {
                StoredShape::Disks { normals, radii } => {
                    normals.push(cloud.normal(i).as_vec3());
                    radii.push(cloud.radius_max(i) as f32);
                }
                StoredShape::Ellipses { s, t } => {
                    let (a, b) = cloud.axes(i);
                    s.push(a.as_vec3());
                    t.push(b.as_vec3());
                }
            }
            if let Some(colors) = &mut self.colors {
                colors.push(Vec3::from(cloud.color(i)));
            }
            if let Some(normals) = &mut self.shading_normals {
                normals.push(cloud.shading_normal(i).as_vec3());
            }
        }
        if let Some(chunk) = self.chunks.last_mut() {
            chunk.ball = ball;
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
            StoredShape::Disks { normals, radii } => normals.bytes() + size_of_val(radii.as_slice()),
            StoredShape::Ellipses { s, t } => s.bytes() + t.bytes(),
        };
        shape
            + self.centers.bytes()
            + self.colors.as_ref().map_or(0, Soa3::bytes)
            + self.shading_normals.as_ref().map_or(0, Soa3::bytes)
            + size_of_val(self.chunks.as_slice())
    }
}

/// How many of the splats, in order, make the next chunk.
fn chunk_length(cloud: &SplatCloud, order: &[u32]) -> usize {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut smallest = f64::INFINITY;
    for (count, &i) in order.iter().take(CHUNK).enumerate() {
        let p = cloud.center(i as usize);
        (min, max) = (min.min(p), max.max(p));
        smallest = smallest.min(cloud.radius_max(i as usize));
        if count > 0 && (max - min).max_element() > MAX_EXTENT_RADII * smallest {
            return count;
        }
    }
    order.len().min(CHUNK)
}

/// Indices of the splats in Morton order of their centres; equal codes stay in index order.
fn morton_order(cloud: &SplatCloud) -> Vec<u32> {
    let n = cloud.len();
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for i in 0..n {
        let p = cloud.center(i);
        (min, max) = (min.min(p), max.max(p));
    }
    let extent = (max - min).max_element();
    let scale = if extent > 0.0 { 1_048_575.0 / extent } else { 0.0 };
    let mut keyed: Vec<(u64, u32)> = (0..n)
        .into_par_iter()
        .map(|i| {
            let q = (cloud.center(i) - min) * scale;
            (spread(q.x as u64) | spread(q.y as u64) << 1 | spread(q.z as u64) << 2, i as u32)
        })
        .collect();
    keyed.par_sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// Spreads the low 21 bits of `x` to every third bit.
fn spread(x: u64) -> u64 {
    let x = x & 0x1f_ffff;
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}
