//! Conversion between the sRGB-encoded levels that files hold and the linear values that the model holds.

use std::sync::OnceLock;
use surfel_math::srgb;

/// Linear values of the 256 sRGB-encoded 8-bit levels.
pub(crate) fn linear_of_8_bit() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|i| srgb::decode(i as f64 / 255.0) as f32))
}

/// Linear values of the 65536 sRGB-encoded 16-bit levels.
pub(crate) fn linear_of_16_bit() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| (0..=65_535_u32).map(|i| srgb::decode(f64::from(i) / 65_535.0) as f32).collect())
}

/// Linear value of an sRGB-encoded one in [0, 1]; clamped, NaN stays.
pub(crate) fn linear_of_unit(encoded: f64) -> f32 {
    if encoded.is_nan() {
        return f32::NAN;
    }
    srgb::decode(encoded.clamp(0.0, 1.0)) as f32
}

/// The 8-bit level that decodes to exactly `linear`, if one does.
pub(crate) fn exact_8_bit(linear: f32) -> Option<u8> {
    let level = nearest_8_bit(linear);
    (linear_of_8_bit()[usize::from(level)] == linear).then_some(level)
}

/// The nearest sRGB-encoded 8-bit level (round half up), clamped; NaN is 0.
pub(crate) fn nearest_8_bit(linear: f32) -> u8 {
    // The tables hold the least value of each level, so that no power is taken a pixel, and a first guess at the level:
    // near black, where the curve is steepest, 1/4096 spans less than one level.
    static TABLES: OnceLock<([f32; 256], Vec<u8>)> = OnceLock::new();
    let (least, guess) = TABLES.get_or_init(|| {
        let least: [f32; 256] = std::array::from_fn(|i| srgb::decode((i as f64 - 0.5).max(0.0) / 255.0) as f32);
        let level = |v: f32| least.iter().rposition(|&t| v >= t).unwrap_or(0) as u8;
        (least, (0..=4096).map(|i| level(i as f32 / 4096.0)).collect())
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

/// The nearest sRGB-encoded 16-bit level, clamped; NaN is 0.
pub(crate) fn nearest_16_bit(linear: f32) -> u16 {
    if linear.is_nan() {
        return 0;
    }
    (srgb::encode(f64::from(linear).clamp(0.0, 1.0)) * 65_535.0 + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_8_bit_agrees_with_the_formula_everywhere() {
        for i in 0..=200_000 {
            let v = i as f32 / 200_000.0;
            let formula = srgb::encode(f64::from(v)) * 255.0;
            let level = f64::from(nearest_8_bit(v));
            // Half a code, and the rounding of a decision level to f32.
            assert!((level - formula).abs() <= 0.5 + 1e-4, "{v}: {level} {formula}");
        }
        assert_eq!([f32::NAN, -1.0, 2.0, f32::INFINITY].map(nearest_8_bit), [0, 0, 255, 255]);
    }

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
