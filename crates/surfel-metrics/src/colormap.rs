//! Colour map magma, in which FLIP's error maps are shown.

/// sRGB colours 0xRRGGBB of the map magma, from no error (black) to the largest error (pale yellow).
///
/// "magma" of matplotlib by Nathaniel J. Smith and Stéfan van der Walt, CC0, rounded to 8 bits.
#[rustfmt::skip]
const MAGMA: [u32; 256] = [
    0x00_0004, 0x01_0005, 0x01_0106, 0x01_0108, 0x02_0109, 0x02_020b, 0x02_020d, 0x03_030f,
    0x03_0312, 0x04_0414, 0x05_0416, 0x06_0518, 0x06_051a, 0x07_061c, 0x08_071e, 0x09_0720,
    0x0a_0822, 0x0b_0924, 0x0c_0926, 0x0d_0a29, 0x0e_0b2b, 0x10_0b2d, 0x11_0c2f, 0x12_0d31,
    0x13_0d34, 0x14_0e36, 0x15_0e38, 0x16_0f3b, 0x18_0f3d, 0x19_103f, 0x1a_1042, 0x1c_1044,
    0x1d_1147, 0x1e_1149, 0x20_114b, 0x21_114e, 0x22_1150, 0x24_1253, 0x25_1255, 0x27_1258,
    0x29_115a, 0x2a_115c, 0x2c_115f, 0x2d_1161, 0x2f_1163, 0x31_1165, 0x33_1067, 0x34_1069,
    0x36_106b, 0x38_106c, 0x39_0f6e, 0x3b_0f70, 0x3d_0f71, 0x3f_0f72, 0x40_0f74, 0x42_0f75,
    0x44_0f76, 0x45_1077, 0x47_1078, 0x49_1078, 0x4a_1079, 0x4c_117a, 0x4e_117b, 0x4f_127b,
    0x51_127c, 0x52_137c, 0x54_137d, 0x56_147d, 0x57_157e, 0x59_157e, 0x5a_167e, 0x5c_167f,
    0x5d_177f, 0x5f_187f, 0x60_1880, 0x62_1980, 0x64_1a80, 0x65_1a80, 0x67_1b80, 0x68_1c81,
    0x6a_1c81, 0x6b_1d81, 0x6d_1d81, 0x6e_1e81, 0x70_1f81, 0x72_1f81, 0x73_2081, 0x75_2181,
    0x76_2181, 0x78_2281, 0x79_2282, 0x7b_2382, 0x7c_2382, 0x7e_2482, 0x80_2582, 0x81_2581,
    0x83_2681, 0x84_2681, 0x86_2781, 0x88_2781, 0x89_2881, 0x8b_2981, 0x8c_2981, 0x8e_2a81,
    0x90_2a81, 0x91_2b81, 0x93_2b80, 0x94_2c80, 0x96_2c80, 0x98_2d80, 0x99_2d80, 0x9b_2e7f,
    0x9c_2e7f, 0x9e_2f7f, 0xa0_2f7f, 0xa1_307e, 0xa3_307e, 0xa5_317e, 0xa6_317d, 0xa8_327d,
    0xaa_337d, 0xab_337c, 0xad_347c, 0xae_347b, 0xb0_357b, 0xb2_357b, 0xb3_367a, 0xb5_367a,
    0xb7_3779, 0xb8_3779, 0xba_3878, 0xbc_3978, 0xbd_3977, 0xbf_3a77, 0xc0_3a76, 0xc2_3b75,
    0xc4_3c75, 0xc5_3c74, 0xc7_3d73, 0xc8_3e73, 0xca_3e72, 0xcc_3f71, 0xcd_4071, 0xcf_4070,
    0xd0_416f, 0xd2_426f, 0xd3_436e, 0xd5_446d, 0xd6_456c, 0xd8_456c, 0xd9_466b, 0xdb_476a,
    0xdc_4869, 0xde_4968, 0xdf_4a68, 0xe0_4c67, 0xe2_4d66, 0xe3_4e65, 0xe4_4f64, 0xe5_5064,
    0xe7_5263, 0xe8_5362, 0xe9_5462, 0xea_5661, 0xeb_5760, 0xec_5860, 0xed_5a5f, 0xee_5b5e,
    0xef_5d5e, 0xf0_5f5e, 0xf1_605d, 0xf2_625d, 0xf2_645c, 0xf3_655c, 0xf4_675c, 0xf4_695c,
    0xf5_6b5c, 0xf6_6c5c, 0xf6_6e5c, 0xf7_705c, 0xf7_725c, 0xf8_745c, 0xf8_765c, 0xf9_785d,
    0xf9_795d, 0xf9_7b5d, 0xfa_7d5e, 0xfa_7f5e, 0xfa_815f, 0xfb_835f, 0xfb_8560, 0xfb_8761,
    0xfc_8961, 0xfc_8a62, 0xfc_8c63, 0xfc_8e64, 0xfc_9065, 0xfd_9266, 0xfd_9467, 0xfd_9668,
    0xfd_9869, 0xfd_9a6a, 0xfd_9b6b, 0xfe_9d6c, 0xfe_9f6d, 0xfe_a16e, 0xfe_a36f, 0xfe_a571,
    0xfe_a772, 0xfe_a973, 0xfe_aa74, 0xfe_ac76, 0xfe_ae77, 0xfe_b078, 0xfe_b27a, 0xfe_b47b,
    0xfe_b67c, 0xfe_b77e, 0xfe_b97f, 0xfe_bb81, 0xfe_bd82, 0xfe_bf84, 0xfe_c185, 0xfe_c287,
    0xfe_c488, 0xfe_c68a, 0xfe_c88c, 0xfe_ca8d, 0xfe_cc8f, 0xfe_cd90, 0xfe_cf92, 0xfe_d194,
    0xfe_d395, 0xfe_d597, 0xfe_d799, 0xfe_d89a, 0xfd_da9c, 0xfd_dc9e, 0xfd_dea0, 0xfd_e0a1,
    0xfd_e2a3, 0xfd_e3a5, 0xfd_e5a7, 0xfd_e7a9, 0xfd_e9aa, 0xfd_ebac, 0xfc_ecae, 0xfc_eeb0,
    0xfc_f0b2, 0xfc_f2b4, 0xfc_f4b6, 0xfc_f6b8, 0xfc_f7b9, 0xfc_f9bb, 0xfc_fbbd, 0xfc_fdbf,
];

/// Returns the magma colour, sRGB-encoded with 8 bits per channel, of `value` in [0, 1]. Values outside are clamped;
/// NaN is shown as 1.
pub fn magma(value: f32) -> [u8; 3] {
    let level = if value.is_nan() { 255.0 } else { (value.clamp(0.0, 1.0) * 255.0).round() };
    let [_, r, g, b] = MAGMA[level as usize].to_be_bytes();
    [r, g, b]
}

/// Converts values to colours by [`magma`], after division by `full_scale`, the value of the brightest colour. If
/// `full_scale` isn't above 0, every value above 0 gets the brightest colour.
pub fn magma_image(values: &[f32], full_scale: f32) -> Vec<[u8; 3]> {
    let shade = |&v: &f32| if full_scale > 0.0 { magma(v / full_scale) } else { magma(if v > 0.0 { 1.0 } else { v }) };
    values.iter().map(shade).collect()
}

#[cfg(test)]
mod tests {
    use super::{magma, magma_image};

    #[test]
    fn magma_ends_middle_and_bad_values() {
        // The first and last rows of matplotlib's table, and row 128: (0.716387, 0.214982, 0.475290).
        assert_eq!(magma(0.0), [0, 0, 4]);
        assert_eq!(magma(1.0), [252, 253, 191]);
        assert_eq!(magma(128.0 / 255.0), [183, 55, 121]);
        assert_eq!(magma(-1.0), magma(0.0));
        assert_eq!(magma(f32::INFINITY), magma(1.0));
        assert_eq!(magma(f32::NAN), magma(1.0));
    }

    #[test]
    fn magma_luminance_rises_with_every_step() {
        // Rising luminance is the map's purpose; 2.0 of 255 allows for its rounding to 8 bits.
        let luminance = |i: u16| {
            let [r, g, b] = magma(f32::from(i) / 255.0);
            0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
        };
        for i in 0..255 {
            assert!(luminance(i + 1) > luminance(i) - 2.0, "{i}");
        }
        assert!(luminance(255) > 240.0);
    }

    #[test]
    fn magma_image_scales_by_full_scale() {
        assert_eq!(magma_image(&[0.0, 1.0, 2.0, 4.0], 2.0), [magma(0.0), magma(0.5), magma(1.0), magma(1.0)]);
        assert_eq!(magma_image(&[0.0, 1e-9], 0.0), [magma(0.0), magma(1.0)]);
    }
}
