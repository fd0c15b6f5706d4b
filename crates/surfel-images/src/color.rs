//! Conversion between sRGB-encoded levels in files and linear values.

use std::sync::OnceLock;
use surfel_math::srgb::{self, nearest_8_bit};

/// Returns the linear values of the 256 sRGB-encoded 8-bit levels, as a table.
pub fn linear_of_8_bit() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|i| srgb::decode(i as f64 / 255.0) as f32))
}

/// Returns the linear values of the 65536 sRGB-encoded 16-bit levels, as a table.
pub fn linear_of_16_bit() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| (0..=65_535_u32).map(|i| srgb::decode(f64::from(i) / 65_535.0) as f32).collect())
}

/// Converts an sRGB-encoded value to a linear one. Values are clamped to [0, 1]; NaN remains NaN.
pub fn linear_of_unit(encoded: f64) -> f32 {
    if encoded.is_nan() {
        return f32::NAN;
    }
    srgb::decode(encoded.clamp(0.0, 1.0)) as f32
}

/// Converts an sRGB-encoded level in the range from 0 to `scale` to a linear value. If `scale` is 255, whole levels get
/// exactly the values of [`linear_of_8_bit`].
pub fn linear_of_level(level: f64, scale: f64) -> f32 {
    let is_whole = scale == 255.0 && level.fract() == 0.0 && (0.0..=255.0).contains(&level);
    if is_whole { linear_of_8_bit()[level as usize] } else { linear_of_unit(level / scale) }
}

/// Returns the sRGB-encoded 8-bit level whose linear value is exactly `linear`; `None` if no level has this value.
pub fn exact_8_bit(linear: f32) -> Option<u8> {
    let level = nearest_8_bit(linear);
    (linear_of_8_bit()[usize::from(level)] == linear).then_some(level)
}

/// Returns the nearest sRGB-encoded 16-bit level of a linear value, clamped to the range of levels; 0 for NaN.
pub fn nearest_16_bit(linear: f32) -> u16 {
    if linear.is_nan() {
        return 0;
    }
    (srgb::encode(f64::from(linear).clamp(0.0, 1.0)) * 65_535.0 + 0.5) as u16
}

/// Converts a texel of 8-bit levels with straight alpha to a linear premultiplied colour.
pub(crate) fn linear_8_bit([r, g, b, a]: [u8; 4]) -> [f32; 4] {
    let table = linear_of_8_bit();
    premultiply([r, g, b].map(|c| table[usize::from(c)]), f32::from(a) / 255.0)
}

/// Converts a texel of 16-bit levels with straight alpha to a linear premultiplied colour.
pub(crate) fn linear_16_bit([r, g, b, a]: [u16; 4]) -> [f32; 4] {
    let table = linear_of_16_bit();
    premultiply([r, g, b].map(|c| table[usize::from(c)]), f32::from(a) / 65_535.0)
}

fn premultiply([r, g, b]: [f32; 3], a: f32) -> [f32; 4] {
    [r * a, g * a, b * a, a]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_survives_a_round_trip() {
        for (i, &v) in linear_of_8_bit().iter().enumerate() {
            assert_eq!(exact_8_bit(v), Some(i as u8));
        }
        assert_eq!(exact_8_bit(0.5), None);
        for (i, &v) in linear_of_16_bit().iter().enumerate() {
            assert_eq!(usize::from(nearest_16_bit(v)), i);
        }
    }
}
