//! Pipeline of LDR-FLIP, which computes the error map row by row.
//!
//! Every filter is separable, so a row of the result needs only as many horizontally filtered rows as the widest kernel
//! is tall. A ring buffer stores these rows, so that memory is proportional to the width and fits the cache.

use std::f64::consts::FRAC_1_SQRT_2;

use super::color::{ColorError, luminance_from_y, ycxcz_from_linear};
use super::filter::{Kernels, Parity, convolve};

/// Kind of a horizontally filtered row: a colour channel, one of the two terms of the blue-yellow channel, or a feature
/// of the luminance.
#[derive(Clone, Copy)]
enum Plane {
    Luma,
    RedGreen,
    BlueYellowWide,
    BlueYellowNarrow,
    Slope,
    Curvature,
    Smooth,
}
/// Number of variants of [`Plane`].
const PLANES: usize = 7;

/// Filter state of one of the two images: a ring buffer with its last horizontally filtered rows.
struct Side<P> {
    pixel: P,
    width: usize,
    radius: usize,
    /// Current row of Y, Cx, Cz and luminance before filtering, extended by `radius` copies of the end pixels on either
    /// side.
    padded: [Vec<f64>; 4],
    /// Ring buffer of horizontally filtered rows. Row y of plane p starts at (p·(2·radius + 1) + y mod (2·radius +
    /// 1))·width.
    ring: Vec<f64>,
}

/// Row of one image after filtering in both directions: its colours, and its strengths of edges and points.
struct Filtered {
    color: [Vec<f64>; 3],
    edge: Vec<f64>,
    point: Vec<f64>,
    scratch: Vec<f64>,
}

impl Filtered {
    fn new(width: usize) -> Self {
        let row = || vec![0.0; width];
        Self { color: [row(), row(), row()], edge: row(), point: row(), scratch: row() }
    }
}

impl<P: Fn(usize) -> [f64; 3]> Side<P> {
    fn new(width: usize, radius: usize, pixel: P) -> Self {
        let padded = || vec![0.0; width + 2 * radius];
        Self {
            pixel,
            width,
            radius,
            padded: [padded(), padded(), padded(), padded()],
            ring: vec![0.0; PLANES * (2 * radius + 1) * width],
        }
    }

    fn start(&self, plane: Plane, y: usize) -> usize {
        let rows = 2 * self.radius + 1;
        (plane as usize * rows + y % rows) * self.width
    }

    fn row(&self, plane: Plane, y: usize) -> &[f64] {
        let start = self.start(plane, y);
        &self.ring[start..start + self.width]
    }

    /// Reads row `y` of the image, filters it horizontally, and stores the result in the ring buffer.
    fn push(&mut self, y: usize, kernels: &Kernels) {
        let (width, radius) = (self.width, self.radius);
        for i in 0..width {
            let ycxcz = ycxcz_from_linear((self.pixel)(y * width + i));
            for (row, value) in self.padded.iter_mut().zip(ycxcz) {
                row[radius + i] = value;
            }
            self.padded[3][radius + i] = luminance_from_y(ycxcz[0]);
        }
        for row in &mut self.padded {
            let (first, last) = (row[radius], row[radius + width - 1]);
            row[..radius].fill(first);
            row[radius + width..].fill(last);
        }
        let jobs = [
            (Plane::Luma, 0, &kernels.achromatic, Parity::Even),
            (Plane::RedGreen, 1, &kernels.red_green, Parity::Even),
            (Plane::BlueYellowWide, 2, &kernels.blue_yellow[0], Parity::Even),
            (Plane::BlueYellowNarrow, 2, &kernels.blue_yellow[1], Parity::Even),
            (Plane::Slope, 3, &kernels.first_derivative, Parity::Odd),
            (Plane::Curvature, 3, &kernels.second_derivative, Parity::Even),
            (Plane::Smooth, 3, &kernels.smooth, Parity::Even),
        ];
        for (plane, source, half, parity) in jobs {
            let start = self.start(plane, y);
            let source = &self.padded[source];
            convolve(&mut self.ring[start..start + width], half, parity, |k| {
                let from = radius.wrapping_add_signed(k);
                &source[from..from + width]
            });
        }
    }

    /// Filters row `y` vertically from the rows in the ring buffer, into `out`. Rows outside of the image repeat the
    /// first or the last row.
    fn filter_row(&self, y: usize, height: usize, kernels: &Kernels, out: &mut Filtered) {
        let vertical = |out: &mut [f64], plane: Plane, half: &[f64], parity: Parity| {
            convolve(out, half, parity, |k| self.row(plane, y.saturating_add_signed(k).min(height - 1)));
        };
        let [luma, red_green, blue_yellow] = &mut out.color;
        vertical(luma, Plane::Luma, &kernels.achromatic, Parity::Even);
        vertical(red_green, Plane::RedGreen, &kernels.red_green, Parity::Even);
        vertical(blue_yellow, Plane::BlueYellowWide, &kernels.blue_yellow[0], Parity::Even);
        vertical(&mut out.scratch, Plane::BlueYellowNarrow, &kernels.blue_yellow[1], Parity::Even);
        blue_yellow.iter_mut().zip(&out.scratch).for_each(|(sum, narrow)| *sum += narrow);

        let length = |out: &mut [f64], other: &[f64]| {
            out.iter_mut().zip(other).for_each(|(x, y)| *x = (*x * *x + y * y).sqrt());
        };
        vertical(&mut out.edge, Plane::Slope, &kernels.smooth, Parity::Even);
        vertical(&mut out.scratch, Plane::Smooth, &kernels.first_derivative, Parity::Odd);
        length(&mut out.edge, &out.scratch);
        vertical(&mut out.point, Plane::Curvature, &kernels.smooth, Parity::Even);
        vertical(&mut out.scratch, Plane::Smooth, &kernels.second_derivative, Parity::Even);
        length(&mut out.point, &out.scratch);
    }
}

/// Returns the error in [0, 1] of every pixel between two images. `reference` and `test` return the linear RGB in [0,
/// 1] of a pixel index.
pub(super) fn error_map(
    width: usize,
    height: usize,
    kernels: &Kernels,
    reference: impl Fn(usize) -> [f64; 3],
    test: impl Fn(usize) -> [f64; 3],
) -> Vec<f32> {
    if width == 0 || height == 0 {
        return Vec::new();
    }
    let radius = kernels.radius();
    let color_error = ColorError::new();
    let (mut a, mut b) = (Side::new(width, radius, reference), Side::new(width, radius, test));
    let (mut fa, mut fb) = (Filtered::new(width), Filtered::new(width));
    let mut error = Vec::with_capacity(width * height);
    let mut ready = 0;
    for y in 0..height {
        while ready < height.min(y + radius + 1) {
            a.push(ready, kernels);
            b.push(ready, kernels);
            ready += 1;
        }
        a.filter_row(y, height, kernels, &mut fa);
        b.filter_row(y, height, kernels, &mut fb);
        for i in 0..width {
            let color = color_error
                .between([0, 1, 2].map(|channel| fa.color[channel][i]), [0, 1, 2].map(|channel| fb.color[channel][i]));
            let feature = (fa.edge[i] - fb.edge[i]).abs().max((fa.point[i] - fb.point[i]).abs());
            // The square root is the paper's exponent q_f = ½. A feature is at most √2, the combined maxima of the two
            // directions.
            let feature = (feature * FRAC_1_SQRT_2).min(1.0).sqrt();
            error.push(color.powf(1.0 - feature) as f32);
        }
    }
    error
}
