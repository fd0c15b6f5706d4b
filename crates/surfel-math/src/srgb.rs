//! The sRGB transfer function (IEC 61966-2-1).

/// Linear value of an sRGB-encoded one, both in [0, 1].
pub fn decode(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// sRGB-encoded value of a linear one, both in [0, 1].
pub fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    #[test]
    fn decode_inverts_encode_at_every_8_bit_level() {
        for i in 0..=255 {
            let e = f64::from(i) / 255.0;
            assert!((super::encode(super::decode(e)) - e).abs() < 1e-7, "{i}");
        }
    }
}
