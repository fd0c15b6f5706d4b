//! Lighting and compositing of balls among the other surfaces of a block (rendering model §11).
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)). A *slot* is the index of a ball in the columns of
//! its object ([`StoredBalls`](crate::scene::balls::StoredBalls)).

use crate::raster::balls::{BallFragments, BallList, hit_of};
use crate::shade::lighting::Lighting;
use crate::shade::resolve::shaded;
use crate::shade::surface::Surface;
use crate::shade::view_ray::Place;
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::transform;
use crate::tiles::target::{Pixels, Target};
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use surfel_math::{Real, V3};
use surfel_model::{BallLight, Shader};

/// Material factors and stored light of an object of balls, by which its balls are shaded.
#[derive(Clone, Copy)]
pub(crate) struct BallShading<'a> {
    /// Ambient, diffuse, specular and shininess factors of the object's material.
    pub factors: [f32; 4],
    /// Stored light of a sky (rendering model §12), one per slot; `None` if the balls have none or the shader doesn't
    /// show it.
    pub light: Option<&'a [BallLight]>,
}

/// The balls of a block and their sorted fragments, ready for lighting and compositing.
pub(crate) struct BallBlock<'a, S: Simd> {
    pub simd: S,
    pub list: BallList<'a>,
    pub lighting: &'a Lighting,
    /// Material factors and stored light of each object of balls.
    pub looks: &'a [BallShading<'a>],
    pub fragments: &'a mut BallFragments,
}

/// Colours of a block's pixels, composited front to back so far.
#[derive(Clone, Copy)]
pub(crate) struct Composited<S: Simd> {
    /// Composited colour, linear and premultiplied.
    pub color: V3<Lanes<S>>,
    /// Fraction of the light from behind that the composited colours let through.
    pub transmittance: Lanes<S>,
    /// Number of balls' fragments composited in each pixel, for the plane that counts fragments.
    pub fragments: Lanes<S>,
}

impl<S: Simd> Composited<S> {
    /// Returns an empty composite: a colour of 0, and a transmittance of 1.
    #[inline(always)]
    pub(crate) fn nothing(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self { color: V3::new(zero, zero, zero), transmittance: zero.one(), fragments: zero }
    }

    /// Composites a colour of opacity `alpha` behind all colours so far.
    #[inline(always)]
    pub(crate) fn add_behind(&mut self, color: V3<Lanes<S>>, alpha: Lanes<S>) {
        self.color = self.color + color * (alpha * self.transmittance);
        self.transmittance = self.transmittance * (alpha.one() - alpha);
    }

    /// Returns the composited colours over the premultiplied colours of what is behind them.
    #[inline(always)]
    pub(crate) fn over(&self, [r, g, b, a]: [Lanes<S>; 4]) -> [Lanes<S>; 4] {
        let (t, c) = (self.transmittance, &self.color);
        [r.mul_add(t, c.x), g.mul_add(t, c.y), b.mul_add(t, c.z), a.mul_add(t, t.one() - t)]
    }
}

impl<S: Simd> BallBlock<'_, S> {
    /// Composites the balls' fragments that are nearer than `until`, and not composited yet, behind all colours so far.
    #[inline(never)]
    pub(crate) fn composite(&mut self, until: Lanes<S>, composited: &mut Composited<S>) {
        let until = until.to_array();
        let simd = self.simd;
        simd.vectorize(
            #[inline(always)]
            || loop {
                let (found, bits) = self.fragments.next(&until);
                if bits == 0 {
                    return;
                }
                let (surface, alpha) = self.surface(&found, bits);
                let color = self.color(&surface);
                composited.add_behind(color, alpha);
                composited.fragments = composited.fragments + Lanes::select(surface.covered, alpha.one(), alpha.zero());
            },
        );
    }

    /// Returns one fragment per pixel as a surface, and the fragments' opacities. `found` has the fragments' indices,
    /// `bits` the pixels that have one.
    #[inline(always)]
    fn surface(&self, found: &[usize; LANES], bits: u64) -> (Surface<S>, Lanes<S>) {
        let simd = self.simd;
        let mut fields = [[0.0f32; LANES]; 11];
        let mut factors = [[0.0; LANES]; 4];
        // Lanes without a fragment have a dummy ball, so that nothing is divided by zero.
        (fields[4], fields[5]) = ([1.0; LANES], [1.0; LANES]);
        let (mut flat, mut coverage) = (0u64, [0.0; LANES]);
        let (x, y) = self.list.at;
        let differ = self.lighting.attributes.material;
        for lane in ones(bits) {
            let of = &self.fragments.fragments[found[lane]];
            let ball = self.list.balls[of.ball as usize];
            let pixel = [(x + (lane % 4) as i32) as f32, (y + (lane / 4) as i32) as f32];
            let from = |axis: usize| (pixel[axis] - ball.base[axis]) - ball.anchor[axis];
            let [r, g, b] = ball.color;
            let own = [
                from(0),
                from(1),
                ball.slope[0],
                ball.slope[1],
                ball.size,
                ball.z,
                r,
                g,
                b,
                of.z[lane],
                of.coverage[lane] * ball.alpha,
            ];
            fields.iter_mut().zip(own).for_each(|(field, value)| field[lane] = value);
            flat |= u64::from(ball.flat) << lane;
            coverage[lane] = of.coverage[lane];
            if differ {
                let own = self.looks.get(ball.object as usize).map(|look| look.factors).unwrap_or_default();
                factors.iter_mut().zip(own).for_each(|(field, value)| field[lane] = value);
            }
        }
        let lane = |i: usize| Lanes::load(simd, &fields[i]);
        let projection = self.list.projection;
        let (_, normal) = hit_of([lane(0), lane(1), lane(2), lane(3), lane(4), lane(5)], projection);
        let flat = mask32x16::from_bitmask(simd, flat);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let to_eye = match projection.is_perspective() {
            true => V3::new(-lane(2), -lane(3), -one),
            false => V3::new(zero, zero, -one),
        };
        let to_eye = to_eye * to_eye.dot(to_eye).inverse_sqrt();
        let normal = V3::select(flat, to_eye, normal);
        let material = match differ {
            true => factors.map(|field| Lanes::load(simd, &field)),
            false => self.lighting.material.map(|m| Lanes::splat(simd, m)),
        };
        let normal = transform(&self.lighting.rays.world_from_view, normal);
        let mut albedo = V3::new(lane(6), lane(7), lane(8));
        if self.looks.iter().any(|look| look.light.is_some()) {
            albedo = albedo * self.stored_light(found, bits, normal);
        }
        let surface = Surface {
            covered: mask32x16::from_bitmask(simd, bits),
            albedo,
            normal,
            z: lane(9),
            material,
            weight: Lanes::load(simd, &coverage),
        };
        (surface, lane(10))
    }

    /// Returns the stored light of one fragment per pixel, at unit world normals `n`; 1 for balls without stored light.
    #[inline(always)]
    fn stored_light(&self, found: &[usize; LANES], bits: u64, n: V3<Lanes<S>>) -> Lanes<S> {
        let mut stored = [[0.0f32; LANES]; 9];
        let mut without = 0u64;
        for lane in ones(bits) {
            let ball = &self.list.balls[self.fragments.fragments[found[lane]].ball as usize];
            let light = self.looks.get(ball.object as usize).and_then(|look| look.light);
            match light.and_then(|light| light.get(ball.slot as usize)) {
                Some(light) => stored.iter_mut().zip(light.to_array()).for_each(|(field, value)| field[lane] = value),
                None => without |= 1 << lane,
            }
        }
        let [x, y, z, xx, yy, zz, xy, xz, yz] = stored.map(|field| Lanes::load(self.simd, &field));
        let linear = n.x.mul_add(x, n.y.mul_add(y, n.z * z));
        let squares = (n.x * n.x).mul_add(xx, (n.y * n.y).mul_add(yy, n.z * n.z * zz));
        let products = (n.x * n.y).mul_add(xy, (n.x * n.z).mul_add(xz, n.y * n.z * yz));
        let light = (linear + squares + products + products).max(n.x.zero());
        Lanes::select(mask32x16::from_bitmask(self.simd, without), n.x.one(), light)
    }

    /// Returns the colours of surfaces of balls by the plan's shader; 0 if the frame needs no colour.
    #[inline(always)]
    fn color(&self, surface: &Surface<S>) -> V3<Lanes<S>> {
        let simd = self.simd;
        if !self.lighting.planes.shows_color() {
            let zero = Lanes::splat(simd, 0.0);
            return V3::new(zero, zero, zero);
        }
        let color = shaded(simd, self.lighting, surface, Place::Block(self.list.at));
        if self.lighting.shader == Shader::Edl {
            // Eye-dome lighting darkens a tilted plane by about its cosine.
            let to_eye = self.lighting.rays.view_ray(simd, Place::Block(self.list.at)).to_eye();
            return color * surface.normal.dot(to_eye).abs();
        }
        color
    }

    /// Writes depth, normal, weight and number of each pixel's nearest solid fragment, if the fragment is nearer than
    /// the pixel's depth and than `until`.
    #[inline(never)]
    pub(crate) fn show(&self, until: Lanes<S>, pixels: &mut Pixels<S>, target: &mut Target<'_>) {
        let planes = &self.lighting.planes;
        if !(planes.depth || planes.normal || planes.weight || planes.index) {
            return;
        }
        let until = until.min(pixels.depth).to_array();
        let (found, bits) = self.fragments.shown(self.list.balls, self.list.at, &until);
        if bits == 0 {
            return;
        }
        let (surface, _) = self.surface(&found, bits);
        let [x, y, z] = pixels.normal;
        let normal = V3::select(surface.covered, surface.normal, V3::new(x, y, z));
        pixels.normal = [normal.x, normal.y, normal.z];
        pixels.depth = Lanes::select(surface.covered, surface.z, pixels.depth);
        pixels.weight = Lanes::select(surface.covered, surface.weight, pixels.weight);
        if planes.index {
            let mut numbers = target.index(self.list.at);
            for lane in ones(bits) {
                numbers[lane] = self.list.balls[self.fragments.fragments[found[lane]].ball as usize].number;
            }
            target.put_index(self.list.at, numbers);
        }
    }
}
