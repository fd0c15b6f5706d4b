//! Simulation of colour blindness, to find categories whose colours can't be distinguished.
//!
//! The matrices, which apply to linear RGB, are those of Machado, Oliveira, Fernandes, "A physiologically-based model
//! for simulation of color vision deficiency", IEEE TVCG 15(6), 2009, for severity 1.0. Distances are ΔE of CIE 1976
//! L*a*b* for the white point D65.

use super::{Category, linear};

/// Distance ΔE below which two colours are easily confused. Patches in a legend and shaded points in an image aren't
/// adjacent, so that even a distance of 10 is hard to see.
const CONFUSED: f64 = 10.0;
/// Largest number of pairs of categories that a note names. Further pairs are only counted.
const NAMED: usize = 4;

/// Kinds of colour blindness, each with its name and its matrix for linear RGB, row by row.
const KINDS: [(&str, [[f64; 3]; 3]); 3] = [
    (
        "deuteranopia",
        [[0.367_322, 0.860_646, -0.227_968], [0.280_085, 0.672_501, 0.047_413], [-0.011_820, 0.042_940, 0.968_881]],
    ),
    (
        "protanopia",
        [[0.152_286, 1.052_583, -0.204_868], [0.114_503, 0.786_281, 0.099_216], [-0.003_882, -0.048_116, 1.051_998]],
    ),
    (
        "tritanopia",
        [[1.255_528, -0.076_749, -0.178_779], [-0.078_411, 0.930_809, 0.147_602], [0.004_733, 0.691_367, 0.303_900]],
    ),
];

fn linear_rgb(levels: [u8; 3]) -> [f64; 3] {
    levels.map(|level| f64::from(linear(f64::from(level) / 255.0)))
}

fn times(matrix: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|r| (0..3).map(|c| matrix[r][c] * v[c]).sum::<f64>().clamp(0.0, 1.0))
}

/// Converts linear sRGB to CIE L*a*b* (D65).
pub(crate) fn lab(rgb: [f64; 3]) -> [f64; 3] {
    const XYZ: [[f64; 3]; 3] = [
        [0.412_456_4, 0.357_576_1, 0.180_437_5],
        [0.212_672_9, 0.715_152_2, 0.072_175_0],
        [0.019_333_9, 0.119_192_0, 0.950_304_1],
    ];
    const WHITE: [f64; 3] = [0.950_47, 1.0, 1.088_83];
    let f = |t: f64| if t > 216.0 / 24_389.0 { t.cbrt() } else { (24_389.0 / 27.0 * t + 16.0) / 116.0 };
    let [x, y, z] = [0, 1, 2].map(|r| f((0..3).map(|c| XYZ[r][c] * rgb[c]).sum::<f64>() / WHITE[r]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

/// Returns a note on categories with splats whose colours look alike, to people with normal vision or with a kind of
/// colour blindness. Returns `None` if there are none.
pub fn confusions(categories: &[Category]) -> Option<String> {
    let present: Vec<&Category> = categories.iter().filter(|category| category.count > 0).collect();
    let normal = ("normal vision", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let mut known = std::collections::BTreeSet::new();
    let mut parts = Vec::new();
    for (kind, matrix) in std::iter::once(&normal).chain(&KINDS) {
        let seen: Vec<[f64; 3]> = present.iter().map(|c| lab(times(matrix, linear_rgb(c.color)))).collect();
        let mut pairs = Vec::new();
        for i in 0..seen.len() {
            for j in i + 1..seen.len() {
                // A pair is named once, for the first kind of vision that confuses it.
                if distance(seen[i], seen[j]) < CONFUSED && known.insert((i, j)) {
                    pairs.push(format!("{} and {}", present[i].label(), present[j].label()));
                }
            }
        }
        if !pairs.is_empty() {
            let more = pairs.len().saturating_sub(NAMED);
            pairs.truncate(NAMED);
            let more = if more > 0 { format!(" and {more} more pairs") } else { String::new() };
            parts.push(format!("{kind}: {}{more}", pairs.join(", ")));
        }
    }
    (!parts.is_empty()).then(|| {
        let parts = parts.join("; ");
        format!("colours of categories look alike for {parts}: `labels=FILE` gives other colours")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn category(value: f64, color: [u8; 3]) -> Category {
        Category { value, name: None, color, count: 1 }
    }

    #[test]
    fn pairs_that_look_alike_are_named() {
        // Blue and violet of equal lightness differ for normal vision alone; ochre and green look alike without green
        // cones.
        let note = confusions(&[category(1.0, [190, 140, 60]), category(2.0, [120, 165, 60])]).unwrap();
        assert!(note.contains("deuteranopia: 1 and 2") && !note.contains("normal"), "{note}");
        let same = confusions(&[category(1.0, [90, 90, 90]), category(2.0, [93, 90, 90])]).unwrap();
        assert!(same.contains("normal vision: 1 and 2") && !same.contains("protanopia"), "{same}");
        // The colours of Okabe and Ito (2008) are made to be distinguished by all.
        let ito = [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [213, 94, 0], [0; 3]];
        let all: Vec<Category> = ito.iter().enumerate().map(|(i, color)| category(i as f64, *color)).collect();
        assert_eq!(confusions(&all), None);
        let mut absent = category(2.0, [90; 3]);
        absent.count = 0;
        assert_eq!(confusions(&[category(1.0, [90; 3]), absent]), None);
    }

    #[test]
    fn matrices_keep_white_and_lab_is_that_of_the_standard() {
        for (kind, matrix) in &KINDS {
            assert!(times(matrix, [1.0; 3]).iter().all(|c| (c - 1.0).abs() < 1e-3), "{kind}");
        }
        let red = lab([1.0, 0.0, 0.0]);
        assert!(distance(red, [53.24, 80.09, 67.20]) < 0.05, "{red:?}");
    }
}
