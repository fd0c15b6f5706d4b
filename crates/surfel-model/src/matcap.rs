//! Images of a lit sphere for the shader `matcap`.

use crate::{ModelError, Texture};
use std::sync::{Arc, LazyLock};

/// Largest accepted side of a matcap, in texels: an image of this size takes 50 MB in the GPU backends.
const MAX_SIDE: u32 = 2048;
/// Side of the built-in matcap image, in texels.
const BUILTIN_SIDE: u32 = 256;

/// Image of a lit sphere that touches its borders: the colour of a surface for each direction of its normal (rendering
/// model §5).
#[derive(Clone, Debug, PartialEq)]
pub struct Matcap {
    width: u32,
    height: u32,
    texels: Vec<[f32; 3]>,
}

impl Matcap {
    /// Creates a matcap from an image; its alpha is ignored.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] for an image without texels, with a side above 2048, or with fewer texels than its
    /// size requires.
    pub fn new(image: &Texture) -> Result<Self, ModelError> {
        let [width, height] = [image.width, image.height];
        let count = width as usize * height as usize;
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) || image.srgba8.len() < count {
            let found = format!("{width}x{height} texels");
            return Err(ModelError::range("matcap", found, "an image of 1 to 2048 texels a side"));
        }
        let texels = image.srgba8.iter().take(count).map(|&t| crate::texture::linear(t)).map(|[r, g, b, _]| [r, g, b]);
        Ok(Self { width, height, texels: texels.collect() })
    }

    /// Returns the default matcap: grey clay under a warm light from the upper left and a cool one from the lower
    /// right.
    pub fn builtin() -> Arc<Self> {
        static BUILTIN: LazyLock<Arc<Matcap>> = LazyLock::new(|| Arc::new(Matcap::clay(BUILTIN_SIDE)));
        BUILTIN.clone()
    }

    /// Returns the width and height in texels; at least 1 each.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Returns the texels in linear RGB, row by row from the top.
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.texels
    }

    /// Renders the built-in matcap of `side` × `side` texels. It uses only functions whose results are the same on
    /// every machine.
    fn clay(side: u32) -> Self {
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        // Directions toward the lights, and halfway between the first and the eye: x to the right, y down, z toward the
        // eye.
        let (key, fill, half) = ([-0.48, -0.6, 0.64], [0.64, 0.6, 0.48], [-0.265, -0.331, 0.906]);
        let color = |x: f64, y: f64| {
            let outside = (x * x + y * y).sqrt().max(1.0);
            let (x, y) = (x / outside, y / outside);
            let n = [x, y, (1.0 - x * x - y * y).max(0.0).sqrt()];
            // Extended a little past the terminator, as in a soft light.
            let lit = ((dot(n, key) + 0.25) / 1.25).max(0.0);
            let filled = dot(n, fill).max(0.0);
            let shine = dot(n, half).max(0.0).powi(48);
            let mix = |base: f64, warm: f64, cool: f64| (base + warm * lit + cool * filled + 0.16 * shine) as f32;
            [mix(0.05, 0.74, 0.10), mix(0.05, 0.69, 0.13), mix(0.06, 0.61, 0.19)]
        };
        let at = |i: u32| 2.0 * f64::from(i) / f64::from(side.max(2) - 1) - 1.0;
        let texels = (0..side).flat_map(|row| (0..side).map(move |column| color(at(column), at(row)))).collect();
        Self { width: side, height: side, texels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matcap_refuses_images_that_are_none() {
        let image = |width, height, texels| Texture { width, height, srgba8: vec![[255, 0, 128, 9]; texels] };
        let red = Matcap::new(&image(3, 2, 6)).unwrap();
        assert_eq!((red.size(), red.texels().len(), red.texels()[5][..2].to_vec()), ([3, 2], 6, vec![1.0, 0.0]));
        for bad in [image(0, 2, 0), image(3, 2, 5), image(2049, 1, 2049)] {
            assert!(Matcap::new(&bad).is_err());
        }
    }

    #[test]
    fn matcap_built_in_is_bright_where_light_falls_and_within_what_an_image_shows() {
        let ball = Matcap::builtin();
        let [side, _] = ball.size();
        let at = |x: f64, y: f64| {
            let texel = |v: f64| ((v + 1.0) / 2.0 * f64::from(side - 1)) as usize;
            ball.texels()[texel(y) * side as usize + texel(x)][1]
        };
        assert!(at(-0.4, -0.5) > 0.7 && at(0.0, 0.0) > 0.4 && at(0.7, 0.7) < 0.3);
        assert!(ball.texels().iter().flatten().all(|c| (0.0..=1.0).contains(c)));
    }
}
