//! Textures and their mipmaps.

use crate::Mesh;
use std::collections::HashMap;
use std::sync::{Arc, LazyLock};

/// Cache of mipmaps that were already computed, by the address of their texture. The mipmaps own the texture, so the
/// address stays valid.
pub type MipmapCache = HashMap<*const Texture, Arc<Mipmaps>>;

/// Texture image of 8-bit RGBA: a base colour with straight alpha, or other numbers such as normals
/// ([`crate::NormalMap`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Texels as in the file, row by row from the top; `width`·`height` entries. Colours are sRGB-encoded RGBA with
    /// straight alpha; other numbers are the levels themselves.
    pub srgba8: Vec<[u8; 4]>,
}

impl Texture {
    /// Returns a bilinear sample at `uv` with repeat addressing: linear RGB and alpha. (0, 0) is the texture's top left
    /// corner, (1, 1) its bottom right one. A texture without texels, or with fewer than its size requires, is white.
    pub fn sample(&self, uv: [f32; 2]) -> [f32; 4] {
        if self.width == 0 || self.height == 0 || self.srgba8.len() < self.width as usize * self.height as usize {
            return [1.0; 4];
        }
        let decoded = &*DECODED;
        bilinear(uv, self.width as usize, self.height as usize, |i| linear_by(decoded, self.srgba8[i]))
    }

    /// Returns a bilinear sample like [`Self::sample`], for images of numbers from 0 to 1: levels are not decoded from
    /// sRGB.
    pub fn sample_numbers(&self, uv: [f32; 2]) -> [f32; 4] {
        if self.width == 0 || self.height == 0 || self.srgba8.len() < self.width as usize * self.height as usize {
            return [1.0; 4];
        }
        bilinear(uv, self.width as usize, self.height as usize, |i| {
            self.srgba8[i].map(|level| f32::from(level) / 255.0)
        })
    }

    /// Returns a bilinear sample like [`Self::sample`], with each texel's colour weighted by its alpha. Transparent
    /// texels thus don't change the colour of visible neighbours. Where all texels are transparent, the colour is that
    /// of [`Self::sample`].
    pub fn sample_by_alpha(&self, uv: [f32; 2]) -> [f32; 4] {
        if self.width == 0 || self.height == 0 || self.srgba8.len() < self.width as usize * self.height as usize {
            return [1.0; 4];
        }
        let decoded = &*DECODED;
        let [r, g, b, a] = bilinear(uv, self.width as usize, self.height as usize, |i| {
            let [r, g, b, a] = linear_by(decoded, self.srgba8[i]);
            [r * a, g * a, b * a, a]
        });
        if a > 0.0 { [r / a, g / a, b / a, a] } else { self.sample(uv) }
    }
}

/// Cache that answers which textures have an alpha below 1. Each texture is examined only once, even if materials share
/// it.
#[derive(Debug, Default)]
pub struct SeeThroughTextures {
    /// Answer for each texture examined, by the texture's address: true if some texel's alpha is below 1.
    known: HashMap<*const Texture, bool>,
    /// Number of textures whose texels were read.
    examined: usize,
}

impl SeeThroughTextures {
    /// True if some texel's alpha is below 1.
    pub fn contains(&mut self, texture: &Arc<Texture>) -> bool {
        *self.known.entry(Arc::as_ptr(texture)).or_insert_with(|| {
            self.examined += 1;
            texture.srgba8.iter().any(|t| t[3] < 255)
        })
    }

    /// Returns the number of textures whose texels were read.
    pub fn examined(&self) -> usize {
        self.examined
    }
}

fn wrap(t: f32) -> f32 {
    if t.is_finite() { t - t.floor() } else { 0.0 }
}

/// Linear value of every 8-bit sRGB level, indexed by the level. Without the table, decoding each channel of each texel
/// would dominate the time of a textured image.
static DECODED: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|level| surfel_math::srgb::decode(level as f64 / 255.0) as f32));

/// Returns the linear RGB and alpha of a texel.
pub(crate) fn linear(t: [u8; 4]) -> [f32; 4] {
    linear_by(&DECODED, t)
}

fn linear_by(decoded: &[f32; 256], [r, g, b, a]: [u8; 4]) -> [f32; 4] {
    [decoded[usize::from(r)], decoded[usize::from(g)], decoded[usize::from(b)], f32::from(a) / 255.0]
}

/// Mipmaps of a texture: its image at 1/2, 1/4, … of its size, for surfaces that appear smaller (rendering model §6).
#[derive(Clone, Debug, PartialEq)]
pub struct Mipmaps {
    texture: Arc<Texture>,
    /// Reduced images, from level 1 on; level 0 is the texture itself.
    levels: Vec<Level>,
}

/// One mipmap level: a reduced image in linear RGB and alpha.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: usize,
    height: usize,
    texels: Vec<[f32; 4]>,
}

impl Mipmaps {
    /// Computes every level down to one texel. Each is half the size of the one before (rounded down, at least 1). A
    /// texel is the mean of the area that it covers, in linear light. A texture with fewer texels than its size
    /// requires gets no levels.
    pub fn new(texture: Arc<Texture>) -> Self {
        let mut levels: Vec<Level> = Vec::new();
        let (mut width, mut height) = (texture.width as usize, texture.height as usize);
        if texture.srgba8.len() < width * height {
            return Self { texture, levels };
        }
        while width > 1 || height > 1 {
            let next = match levels.last() {
                Some(level) => halved(width, height, |i| level.texels[i]),
                None => halved(width, height, |i| linear(texture.srgba8[i])),
            };
            (width, height) = (next.width, next.height);
            levels.push(next);
        }
        Self { texture, levels }
    }

    /// Returns the mipmaps of a mesh's texture; `None` if the mesh isn't textured. `known` has the mipmaps computed so
    /// far, so that meshes that share a texture share its mipmaps.
    pub fn of_mesh(mesh: &Mesh, known: &mut MipmapCache) -> Option<Arc<Self>> {
        let texture = mesh.texture.as_ref().filter(|_| mesh.uvs.is_some())?;
        let made = known.entry(Arc::as_ptr(texture)).or_insert_with(|| Arc::new(Self::new(texture.clone())));
        Some(made.clone())
    }

    /// Returns the texels of level 1 and up, row by row from the top: linear RGB and alpha.
    pub fn levels(&self) -> impl Iterator<Item = &[[f32; 4]]> {
        self.levels.iter().map(|level| level.texels.as_slice())
    }

    /// Returns the texture itself.
    pub fn texture(&self) -> &Texture {
        &self.texture
    }

    /// Returns the heap memory of the reduced levels, in bytes.
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(|l| size_of_val(l.texels.as_slice())).sum()
    }

    /// Returns a trilinear sample at `uv` with repeat addressing: linear RGB and alpha. `footprint_texels` is the
    /// number of full-size texels that a pixel spans; levels are blended by its binary logarithm.
    pub fn sample(&self, uv: [f32; 2], footprint_texels: f64) -> [f32; 4] {
        let level = footprint_texels.log2().clamp(0.0, self.levels.len() as f64);
        // The level is NaN if the footprint isn't a number: use the full size.
        let level = if level.is_nan() { 0.0 } else { level };
        let (lower, share) = (level.floor(), (level - level.floor()) as f32);
        let fine = self.sample_level(uv, lower as usize);
        if share == 0.0 {
            return fine;
        }
        let coarse = self.sample_level(uv, lower as usize + 1);
        std::array::from_fn(|c| fine[c] + (coarse[c] - fine[c]) * share)
    }

    fn sample_level(&self, uv: [f32; 2], level: usize) -> [f32; 4] {
        match level.checked_sub(1).and_then(|i| self.levels.get(i)) {
            Some(l) => bilinear(uv, l.width, l.height, |i| l.texels[i]),
            None => self.texture.sample(uv),
        }
    }
}

/// Returns a bilinear sample of a `width`×`height` image with repeat addressing. `texel` returns the texel with an
/// index, row by row.
fn bilinear(uv: [f32; 2], width: usize, height: usize, texel: impl Fn(usize) -> [f32; 4]) -> [f32; 4] {
    let (x, y) = (wrap(uv[0]) * width as f32 - 0.5, wrap(uv[1]) * height as f32 - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let (columns, rows) = (wrapped(x0, width), wrapped(y0, height));
    let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| texel(rows[dy] * width + columns[dx]));
    let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
    std::array::from_fn(|c| corners.iter().zip(weights).map(|(t, w)| t[c] * w).sum())
}

/// Returns two indices along an axis of `size` texels, with repeat addressing and without a division: that of `texel`,
/// and of the next one. `texel` is −1 to `size` − 1.
fn wrapped(texel: f32, size: usize) -> [usize; 2] {
    let next = (texel + 1.0) as usize;
    [if next == 0 { size - 1 } else { (next - 1).min(size - 1) }, if next >= size { 0 } else { next }]
}

/// Returns an image at half its size; each texel is the mean of the area that it covers.
fn halved(width: usize, height: usize, texel: impl Fn(usize) -> [f32; 4]) -> Level {
    let (w, h) = ((width / 2).max(1), (height / 2).max(1));
    // Source texels of a target texel along one axis, with their overlap lengths: more than two for odd sizes.
    let spans = |target: usize, from: usize, to: usize| {
        let (start, end) = ((target * from) as f64 / to as f64, ((target + 1) * from) as f64 / to as f64);
        (start.floor() as usize..(end.ceil() as usize).min(from))
            .map(|i| (i, (end.min(i as f64 + 1.0) - start.max(i as f64)) * to as f64 / from as f64))
            .collect::<Vec<_>>()
    };
    let columns: Vec<_> = (0..w).map(|x| spans(x, width, w)).collect();
    let mut texels = Vec::with_capacity(w * h);
    for y in 0..h {
        let rows = spans(y, height, h);
        for column in &columns {
            let mut sum = [0.0f64; 4];
            for &(row, b) in &rows {
                for &(x, a) in column {
                    for (s, t) in sum.iter_mut().zip(texel(row * width + x)) {
                        *s += a * b * f64::from(t);
                    }
                }
            }
            texels.push(sum.map(|s| s as f32));
        }
    }
    Level { width: w, height: h, texels }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(width: u32, height: u32, texel: impl Fn(u32, u32) -> u8) -> Arc<Texture> {
        let each = |i: u32| {
            let v = texel(i % width, i / width);
            [v, v, v, 255]
        };
        Arc::new(Texture { width, height, srgba8: (0..width * height).map(each).collect() })
    }

    #[test]
    fn textures_are_examined_and_reduced_once() {
        let texture = texture(8, 8, |x, _| x as u8);
        let other = Arc::new(Texture { srgba8: vec![[0, 0, 0, 254]; 64], ..Texture::clone(&texture) });
        let mut see_through = SeeThroughTextures::default();
        for _ in 0..100 {
            assert!(!see_through.contains(&texture) && see_through.contains(&other.clone()));
        }
        assert_eq!(see_through.examined(), 2);
        let mesh = Mesh { texture: Some(texture), uvs: Some(Vec::new()), ..Mesh::default() };
        let mut known = MipmapCache::new();
        let [one, two] = [(), ()].map(|()| Mipmaps::of_mesh(&mesh.clone(), &mut known).unwrap());
        assert!(Arc::ptr_eq(&one, &two) && known.len() == 1);
    }

    #[test]
    fn texels_repeat_at_both_ends() {
        for size in [1_usize, 2, 3, 640] {
            for texel in -1..size as i64 {
                let expected = [texel, texel + 1].map(|t| t.rem_euclid(size as i64) as usize);
                assert_eq!(wrapped(texel as f32, size), expected, "{texel} of {size}");
            }
        }
    }

    #[test]
    fn mipmaps_average_light_not_levels_whatever_the_size() {
        for (w, h) in [(8, 8), (5, 3), (7, 1), (1, 6)] {
            // Columns (or rows) of black and white.
            let striped = texture(w, h, |x, y| if (x + y) % 2 == 0 { 255 } else { 0 });
            let mean = striped.srgba8.iter().filter(|t| t[0] == 255).count() as f64 / f64::from(w * h);
            let mipmaps = Mipmaps::new(striped);
            let got = mipmaps.sample([0.3, 0.7], 1e9);
            // f32 sums of a few levels.
            assert!((f64::from(got[0]) - mean).abs() < 1e-6 && (got[3] - 1.0).abs() < 1e-6, "{w}x{h}: {got:?} {mean}");
        }
    }

    #[test]
    fn mipmaps_blend_levels_by_footprint() {
        // Left half black, right half white: level 1 of 4×4 is 2×2, with pure texels.
        let mipmaps = Mipmaps::new(texture(4, 4, |x, _| if x < 2 { 0 } else { 255 }));
        let at = |u: f32, footprint| mipmaps.sample([u, 0.5], footprint)[0];
        assert_eq!(at(0.625, 0.5), 1.0);
        assert_eq!((at(0.75, 1.0), at(0.75, 2.0), at(0.25, 2.0), at(0.25, 4.0)), (1.0, 1.0, 0.0, 0.5));
        // Halfway between level 1 (1) and level 2 (½).
        assert!((at(0.75, 8f64.sqrt()) - 0.75).abs() < 1e-6);
        assert_eq!(at(0.75, f64::NAN), 1.0);
        assert_eq!(at(0.75, f64::INFINITY), 0.5);
    }

    #[test]
    fn mipmaps_of_a_damaged_texture_are_white() {
        let mipmaps = Mipmaps::new(Arc::new(Texture { width: 4, height: 4, srgba8: Vec::new() }));
        assert_eq!(mipmaps.sample([0.5, 0.5], 4.0), [1.0; 4]);
    }
}
