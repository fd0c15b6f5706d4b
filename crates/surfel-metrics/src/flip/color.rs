//! FLIP's colour spaces (HPG 2020, §4.1) and colour distance.

/// Matrix from linear RGB to CIE XYZ divided by the XYZ of white, so that white maps to (1, 1, 1). Entries are the
/// numerators of the exact matrix for ITU-R BT.709 primaries and D65 at (0.3127, 0.3290); the denominators (24577794,
/// 12288897, 73733382) cancel.
const RELATIVE_XYZ_FROM_RGB: [[f64; 3]; 3] = [
    relative_to_white([10_135_552.0, 8_788_810.0, 4_435_075.0]),
    relative_to_white([2_613_072.0, 8_788_810.0, 887_015.0]),
    relative_to_white([1_425_312.0, 8_788_810.0, 70_074_185.0]),
];

/// Inverse of [`RELATIVE_XYZ_FROM_RGB`].
const RGB_FROM_RELATIVE_XYZ: [[f64; 3]; 3] = inverse(RELATIVE_XYZ_FROM_RGB);

/// Divides a row of the matrix by its sum, which is the row's value for white.
const fn relative_to_white([r, g, b]: [f64; 3]) -> [f64; 3] {
    let white = r + g + b;
    [r / white, g / white, b / white]
}

const fn inverse([a, b, c]: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let (x, y, z) = (cross(b, c), cross(c, a), cross(a, b));
    let det = a[0] * x[0] + a[1] * x[1] + a[2] * x[2];
    [[x[0] / det, y[0] / det, z[0] / det], [x[1] / det, y[1] / det, z[1] / det], [x[2] / det, y[2] / det, z[2] / det]]
}

const fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn transform(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Converts linear RGB to YCxCz, the space in which FLIP filters colours: luma Y in [−16, 100], and the opponent
/// channels Cx (red-green) and Cz (blue-yellow). All are linear in light.
pub(super) fn ycxcz_from_linear([r, g, b]: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = transform(&RELATIVE_XYZ_FROM_RGB, [r, g, b]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Converts the luma Y of YCxCz to the relative luminance in [0, 1] from which the feature filters detect edges and
/// points.
pub(super) fn luminance_from_y(y: f64) -> f64 {
    (y + 16.0) / 116.0
}

/// Converts YCxCz back to linear RGB, clamped to [0, 1].
fn clamped_linear_from_ycxcz([y, cx, cz]: [f64; 3]) -> [f64; 3] {
    let y = luminance_from_y(y);
    transform(&RGB_FROM_RELATIVE_XYZ, [y + cx / 500.0, y, y - cz / 200.0]).map(|v| v.clamp(0.0, 1.0))
}

/// Converts linear RGB to L*a*b* with a* and b* scaled by L*/100. Colours look less colourful in the dark (the Hunt
/// effect).
fn hunt_lab_from_linear(rgb: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let [x, y, z] = transform(&RELATIVE_XYZ_FROM_RGB, rgb)
        .map(|t| if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    let l = 116.0 * y - 16.0;
    let colorfulness = 0.01 * l;
    [l, colorfulness * 500.0 * (x - y), colorfulness * 200.0 * (y - z)]
}

/// Returns the HyAB distance of two L*a*b* colours: city-block in lightness, Euclidean in the chromatic plane.
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    let (da, db) = (a[1] - b[1], a[2] - b[2]);
    (a[0] - b[0]).abs() + (da * da + db * db).sqrt()
}

/// Colour part of the FLIP error, with the largest possible colour distance as a precomputed constant.
pub(super) struct ColorError {
    largest: f64,
}

/// Exponent q_c to which HyAB distances are raised.
const COLOR_EXPONENT: f64 = 0.7;
/// Fraction p_c of the largest colour distance. Smaller distances are mapped to errors from 0 to [`KNEE_VALUE`], larger
/// ones to errors from there to 1.
const KNEE: f64 = 0.4;
/// Error p_t of a colour distance at the [`KNEE`] of the map from distances to errors.
const KNEE_VALUE: f64 = 0.95;

impl ColorError {
    pub(super) fn new() -> Self {
        // Green against blue is the largest distance in the sRGB gamut (HPG 2020, §4.1.4).
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(hunt_lab_from_linear);
        Self { largest: hyab(green, blue).powf(COLOR_EXPONENT) }
    }

    /// Returns the error in [0, 1] between two filtered YCxCz colours.
    pub(super) fn between(&self, a: [f64; 3], b: [f64; 3]) -> f64 {
        let [a, b] = [a, b].map(|c| hunt_lab_from_linear(clamped_linear_from_ycxcz(c)));
        let distance = hyab(a, b).powf(COLOR_EXPONENT);
        let knee = KNEE * self.largest;
        if distance < knee {
            distance * (KNEE_VALUE / knee)
        } else {
            (KNEE_VALUE + (distance - knee) / (self.largest - knee) * (1.0 - KNEE_VALUE)).min(1.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn color_white_is_neutral_and_ycxcz_inverts() {
        // 1e-12: a few dozen f64 roundings at values of up to 100.
        let [l, a, b] = hunt_lab_from_linear([1.0; 3]);
        assert!((l - 100.0).abs() < 1e-12 && a.abs() < 1e-12 && b.abs() < 1e-12, "{l} {a} {b}");
        for rgb in [[0.0, 0.0, 0.0], [1.0, 0.25, 0.5], [0.125, 0.75, 1.0]] {
            let back = clamped_linear_from_ycxcz(ycxcz_from_linear(rgb));
            assert!(rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-12), "{rgb:?} {back:?}");
        }
    }

    #[test]
    fn color_error_is_zero_for_equal_and_one_for_green_against_blue() {
        let error = ColorError::new();
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(ycxcz_from_linear);
        assert_eq!(error.between(green, green), 0.0);
        // 1e-12: the round trip through YCxCz rounds at 1e-15; near 0 the cube root is replaced by a linear function.
        assert!((error.between(green, blue) - 1.0).abs() < 1e-12);
    }
}
