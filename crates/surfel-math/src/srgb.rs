//! The sRGB transfer function (IEC 61966-2-1), and the range of colours.

use crate::Real;
use std::sync::OnceLock;

/// Largest magnitude of a linear colour channel; larger ones are limited to it (rendering model §10). It is slightly
/// below the maximum of f32, so that blending colours never overflows.
pub const MAX_COLOR: f64 = 3.4028e38;

/// Limits a channel of a colour to ±[`MAX_COLOR`].
#[inline(always)]
pub fn limit_color<R: Real>(channel: R) -> R {
    let largest = channel.constant(MAX_COLOR);
    channel.min(largest).max(-largest)
}

/// Limits the channels of a light's colour, so that the sum of `lights` lights and the ambient light stays within
/// ±[`MAX_COLOR`].
pub fn limit_light(color: [f64; 3], lights: usize) -> [f64; 3] {
    let most = MAX_COLOR / (lights as f64 + 1.0);
    color.map(|channel| channel.clamp(-most, most))
}

/// Converts an sRGB-encoded value to a linear one, both in [0, 1].
pub fn decode(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Converts a linear value to an sRGB-encoded one, both in [0, 1].
pub fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Returns the sRGB-encoded 8-bit level nearest to a linear value (ties upwards), clamped to 0–255; 0 for NaN.
pub fn nearest_8_bit(linear: f32) -> u8 {
    // Tables avoid a power per pixel: the minimum value of each level, and a first guess of the level. Near black,
    // where the curve is steepest, 1/4096 spans less than one level.
    static TABLES: OnceLock<([f32; 256], [u8; 4097])> = OnceLock::new();
    let (least, guess) = TABLES.get_or_init(|| {
        let least: [f32; 256] = std::array::from_fn(|i| decode((i as f64 - 0.5).max(0.0) / 255.0) as f32);
        let level = |v: f32| least.iter().rposition(|&t| v >= t).unwrap_or(0) as u8;
        (least, std::array::from_fn(|i| level(i as f32 / 4096.0)))
    });
    // NaN fails both comparisons and so becomes 0.
    let v = if linear >= 1.0 {
        1.0
    } else if linear > 0.0 {
        linear
    } else {
        0.0
    };
    let mut level = guess[(v * 4096.0) as usize];
    while level < 255 && v >= least[usize::from(level) + 1] {
        level += 1;
    }
    level
}

/// Converts a linear premultiplied colour to straight RGBA with alpha at most 1. A colour becomes 0 if its alpha is 0,
/// negative or NaN.
pub fn straight([r, g, b, a]: [f32; 4]) -> [f32; 4] {
    // NaN fails the comparison, too, and can't be a divisor.
    if a > 0.0 { [r / a, g / a, b / a, a.min(1.0)] } else { [0.0; 4] }
}

/// Encodes linear premultiplied RGBA for an 8-bit PNG: sRGB, straight alpha. NaN becomes 0.
pub fn encode_rgba8(color: [f32; 4]) -> [u8; 4] {
    let [r, g, b, a] = straight(color);
    [nearest_8_bit(r), nearest_8_bit(g), nearest_8_bit(b), (a * 255.0 + 0.5) as u8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_8_bit_agrees_with_the_formula_everywhere() {
        for i in 0..=200_000 {
            let v = i as f32 / 200_000.0;
            let formula = encode(f64::from(v)) * 255.0;
            let level = f64::from(nearest_8_bit(v));
            // Half a code, and the rounding of a decision level to f32.
            assert!((level - formula).abs() <= 0.5 + 1e-4, "{v}: {level} {formula}");
        }
        assert_eq!([f32::NAN, -1.0, 2.0, f32::INFINITY].map(nearest_8_bit), [0, 0, 255, 255]);
    }

    #[test]
    fn colors_beyond_the_range_of_f32_become_its_ends() {
        let limited = [f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 3.4e38, -0.5].map(limit_color);
        assert_eq!(limited, [3.4028e38, -3.4028e38, 3.4028e38, 3.4e38, -0.5]);
        assert_eq!([1e91, -1e300, 0.25].map(limit_color), [3.4028e38, -3.4028e38, 0.25]);
        // Room for roundings of a blend.
        assert!((MAX_COLOR as f32 * (1.0 + 2e-6)).is_finite());
    }

    #[test]
    fn decode_inverts_encode_at_every_8_bit_level() {
        for i in 0..=255 {
            let e = f64::from(i) / 255.0;
            assert!((encode(decode(e)) - e).abs() < 1e-7, "{i}");
        }
    }
}
