//! The shader `matcap` (rendering model §5): an image of a lit sphere, sampled at the normals of a block.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *lane* is one of the 16 numbers that SIMD
//! instructions compute at once.

use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use std::sync::Arc;
use surfel_math::{Real, V2, V3, matcap};
use surfel_model::Matcap;

/// The lit sphere of the shader `matcap`: its image, in the form in which a frame samples it.
#[derive(Clone)]
pub(crate) struct MatcapSphere {
    image: Arc<Matcap>,
    /// Width and height of the image in texels, from centre to centre of the outermost texels.
    span: [f32; 2],
    width: usize,
}

impl MatcapSphere {
    pub(crate) fn new(image: Arc<Matcap>) -> Self {
        let size = image.size();
        Self { span: size.map(|side| (side - 1) as f32), width: size[0] as usize, image }
    }

    /// Returns the sphere's colours at the normals of surfaces; black in lanes that aren't covered. The normal, the
    /// direction to the eye and the view's down direction must be given in the same axes.
    #[inline(always)]
    pub(crate) fn color<S: Simd>(
        &self,
        simd: S,
        covered: mask32x16<S>,
        [normal, to_eye, down]: [V3<Lanes<S>>; 3],
    ) -> V3<Lanes<S>> {
        let at = matcap::coordinates(normal, to_eye, down);
        let half = |c: Lanes<S>| c.mul_add(c.constant(0.5), c.constant(0.5)).max(c.zero()).min(c.one());
        let [width, height] = self.span.map(|span| Lanes::splat(simd, span));
        let at = V2::new(half(at.x) * width, half(at.y) * height);
        self.sample(simd, covered, at)
    }

    /// Samples the sphere's image bilinearly at positions `at`, in texels from the centre of the first texel. Works
    /// lane by lane, since not every machine has a gather instruction.
    #[inline(always)]
    fn sample<S: Simd>(&self, simd: S, covered: mask32x16<S>, at: V2<Lanes<S>>) -> V3<Lanes<S>> {
        let (x, y) = (at.x.to_array(), at.y.to_array());
        let mut found = [[0.0f32; LANES]; 3];
        for lane in ones(covered.to_bitmask()) {
            let (column, row) = (x[lane] as usize, y[lane] as usize);
            let (fx, fy) = (x[lane] - column as f32, y[lane] - row as f32);
            // The last column and row have no neighbours, but there the weight of the neighbour is zero.
            let (right, below) = (usize::from(fx > 0.0), if fy > 0.0 { self.width } else { 0 });
            let first = row * self.width + column;
            let texels = [first, first + right, first + below, first + below + right].map(|i| self.texel(i));
            for (channel, lanes) in found.iter_mut().enumerate() {
                let [a, b, c, d] = texels.map(|texel| texel[channel]);
                let (upper, lower) = (fx.mul_add(b - a, a), fx.mul_add(d - c, c));
                lanes[lane] = fy.mul_add(lower - upper, upper);
            }
        }
        let [r, g, b] = found.map(|channel| Lanes::load(simd, &channel));
        V3::new(r, g, b)
    }

    #[inline(always)]
    fn texel(&self, i: usize) -> [f32; 3] {
        self.image.texels().get(i).copied().unwrap_or_default()
    }
}
