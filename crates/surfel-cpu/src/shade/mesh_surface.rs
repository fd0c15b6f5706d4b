//! Evaluation of triangles' surfaces at pixels, before lighting (rendering model §6).

use crate::raster::triangles::{Nearest, center, pixel_of};
use crate::scene::mesh::StoredMesh;
use crate::setup::triangles::ScreenTriangle;
use crate::shade::surface::Surface;
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use glam::DVec3;
use surfel_math::basis::unit;
use surfel_math::triangle::interpolate;
use surfel_math::{Real, V2, V3};

impl<S: Simd> Nearest<S> {
    /// Returns the surfaces of the nearest polygons in the lanes of `mask`; other lanes have no surface.
    #[inline(never)]
    pub(crate) fn surface(
        &self,
        simd: S,
        list: &[&ScreenTriangle],
        meshes: &[StoredMesh],
        at: (i32, i32),
        mask: mask32x16<S>,
    ) -> Surface<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let (mut albedo, mut normal, mut factors) = ([[1.0; LANES]; 3], [[0.0; LANES]; 3], [[0.0; LANES]; 4]);
                let which = self.indices();
                for lane in ones(mask.to_bitmask()) {
                    let Some(&t) = list.get(which[lane]) else { continue };
                    let Some(mesh) = meshes.get(t.mesh as usize) else { continue };
                    let (color, direction) = look(t, mesh, center(pixel_of(at, lane)));
                    for axis in 0..3 {
                        (albedo[axis][lane], normal[axis][lane]) = (color[axis] as f32, direction[axis] as f32);
                    }
                    factors.iter_mut().zip(mesh.material.factors()).for_each(|(f, value)| f[lane] = value as f32);
                }
                let load = |v: &[f32; LANES]| Lanes::load(simd, v);
                let vector = |[x, y, z]: &[[f32; LANES]; 3]| V3::new(load(x), load(y), load(z));
                let zero = Lanes::splat(simd, 0.0);
                Surface {
                    covered: mask,
                    albedo: vector(&albedo),
                    normal: vector(&normal),
                    z: Lanes::select(mask, self.z, zero),
                    material: [load(&factors[0]), load(&factors[1]), load(&factors[2]), load(&factors[3])],
                    weight: zero,
                }
            },
        )
    }
}

/// Returns the albedo and the unit world normal of a triangle at a pixel position, in f64.
#[inline(always)]
fn look(t: &ScreenTriangle, resident: &StoredMesh, pixel: V2<f64>) -> (DVec3, DVec3) {
    let mesh = &*resident.mesh;
    let corners = mesh.triangles[t.index as usize].map(|i| i as usize);
    let b = t.triangle.barycentric(pixel);
    let blend = |values: [DVec3; 3]| values[0] * b[0] + values[1] * b[1] + values[2] * b[2];
    let color = |column: &[[f32; 3]]| blend(corners.map(|i| DVec3::from(column[i].map(f64::from))));
    let mut albedo = mesh.colors.as_deref().map_or(DVec3::ONE, color);
    if let (Some(uvs), Some(mipmaps)) = (&mesh.uvs, &resident.mipmaps) {
        let texture = mipmaps.texture();
        let axis = |k: usize| {
            let values = corners.map(|i| f64::from(uvs[i][k]));
            let value = interpolate(b, values);
            (value, t.triangle.gradient(values, value, pixel))
        };
        let ((u, du), (v, dv)) = (axis(0), axis(1));
        let (w, h) = (f64::from(texture.width), f64::from(texture.height));
        let length = |x: f64, y: f64| x.mul_add(x, y * y).sqrt();
        let footprint = length(du.x * w, dv.x * h).max(length(du.y * w, dv.y * h));
        let texel = mipmaps.sample([u as f32, v as f32], footprint);
        albedo *= DVec3::new(texel[0].into(), texel[1].into(), texel[2].into());
    }
    let smooth =
        |column: &[[f32; 3]]| blend(corners.map(|i| unit(resident.normals * DVec3::from(column[i].map(f64::from)))));
    let mut normal = unit(mesh.normals.as_deref().map_or(DVec3::ZERO, smooth));
    if normal == DVec3::ZERO || !normal.is_finite() {
        normal = resident.flat_normal(t.index as usize);
    }
    let turned = resident.material.two_sided && t.back_facing;
    (albedo, if turned { -normal } else { normal })
}
