//! Grid of an orthoimage: the edges of pixels are whole multiples of the ground sampling distance from the origin.

use surfel_load::Error;
use surfel_model::ModelError;

/// Maximum number of columns, and of rows, of an image.
const MAX_SIDE: f64 = 16_777_216.0;
/// Maximum number of pixels of an image.
const MAX_PIXELS: f64 = 1e11;
/// Fraction of a pixel by which bounds may extend beyond a pixel's edge without including the next pixel. It absorbs
/// the binary rounding errors of decimal numbers such as 0.1.
const SLACK_PX: f64 = 1e-6;

/// Grid of an image's pixels, whose edges are whole multiples of the pixel's side from an origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Grid {
    /// Ground sampling distance: side of a pixel, in the units of x and y.
    pub(crate) gsd: f64,
    /// Position (x, y) of a corner of the grid, from which columns and rows are counted.
    pub(crate) origin: [f64; 2],
    /// Column and row of the image's lower left pixel, counted from the origin to the east and to the north.
    pub(crate) first: [i64; 2],
    /// Number of columns and number of rows.
    pub(crate) size: [u32; 2],
}

/// Reason why no grid can be created, before it becomes an error that names an option or a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum GridFault {
    /// The ground sampling distance (GSD), which is given, isn't a finite number greater than 0.
    Gsd(f64),
    /// The image's bounds have no area or aren't finite.
    Empty,
    /// The grid would have too many columns, rows or pixels. `size` has the numbers of columns and rows.
    Large { gsd: f64, size: [f64; 2] },
    /// The grid's origin isn't finite, or is so far from the image that f64 can't distinguish pixels there.
    Origin([f64; 2]),
}

fn out_of_range(field: &'static str, found: String, expected: &'static str) -> ModelError {
    ModelError::OutOfRange { field: field.into(), found, expected }
}

fn words(v: [f64; 4]) -> String {
    format!("{},{},{},{}", v[0], v[1], v[2], v[3])
}

impl GridFault {
    /// Returns the error of this fault for bounds or a size that the user gave.
    pub(crate) fn of_bounds(self, bounds: [f64; 4], size: Option<[u32; 2]>) -> Error {
        let field = if size.is_some() { "size" } else { "bounds" };
        let given = size.map_or_else(|| words(bounds), |[width, height]| format!("{width}x{height}"));
        let expected = match self {
            Self::Gsd(gsd) => return gsd_error(gsd),
            Self::Origin(origin) => return origin_error(origin),
            Self::Empty if size.is_some() => "at least 1x1 pixels",
            Self::Empty => "X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1",
            Self::Large { .. } if size.is_some() => "at most 16777216 pixels a side and 1e11 in all",
            Self::Large { .. } => "at most 16777216 pixels a side and 1e11 in all: give a larger gsd or smaller bounds",
        };
        let found = match self {
            Self::Large { gsd, size: [width, height] } => {
                format!("{given} with a gsd of {gsd}, {width:.3e} x {height:.3e} pixels")
            }
            _ => given,
        };
        out_of_range(field, found, expected).into()
    }

    /// Returns the error of this fault for bounds computed from the points.
    pub(crate) fn of_points(self, bounds: [f64; 4]) -> Error {
        match self {
            Self::Gsd(gsd) => gsd_error(gsd),
            Self::Origin(origin) => origin_error(origin),
            Self::Empty => {
                Error::Input(format!("the bounds of all points are {}, expected finite ones", words(bounds)))
            }
            Self::Large { gsd, size: [width, height] } => {
                let found = format!("{gsd} for points within {}, {width:.3e} x {height:.3e} pixels", words(bounds));
                let expected = "at most 16777216 pixels a side and 1e11 in all: give a larger gsd or bounds of a part";
                out_of_range("gsd", found, expected).into()
            }
        }
    }
}

fn gsd_error(gsd: f64) -> Error {
    out_of_range("gsd", gsd.to_string(), "a finite number greater than 0, in the units of x and y").into()
}

fn origin_error([x, y]: [f64; 2]) -> Error {
    out_of_range("origin", format!("{x},{y}"), "finite numbers, within 2^40 pixels of the image").into()
}

impl Grid {
    /// Creates the grid of the pixels that overlap `bounds`: minimum x, minimum y, maximum x, maximum y.
    pub(crate) fn of_bounds(gsd: f64, origin: [f64; 2], bounds: [f64; 4]) -> Result<Self, GridFault> {
        if !(gsd > 0.0 && gsd.is_finite()) {
            return Err(GridFault::Gsd(gsd));
        }
        if !origin.iter().all(|v| v.is_finite()) {
            return Err(GridFault::Origin(origin));
        }
        let [x0, y0, x1, y1] = bounds;
        if !(x0 < x1 && y0 < y1 && bounds.iter().all(|v| v.is_finite())) {
            return Err(GridFault::Empty);
        }
        let low = |v: f64, k: usize| ((v - origin[k]) / gsd + SLACK_PX).floor();
        let high = |v: f64, k: usize| ((v - origin[k]) / gsd - SLACK_PX).ceil();
        let (first, end) = ([low(x0, 0), low(y0, 1)], [high(x1, 0), high(y1, 1)]);
        let size = [0, 1].map(|k| (end[k] - first[k]).max(1.0));
        let fits = size[0] <= MAX_SIDE && size[1] <= MAX_SIDE && size[0] * size[1] <= MAX_PIXELS;
        if !fits {
            return Err(GridFault::Large { gsd, size });
        }
        // Farther from the origin, neighbouring pixels would have the same coordinates in f64.
        if first.iter().chain(&end).any(|v| v.abs() > 2f64.powi(40)) {
            return Err(GridFault::Origin(origin));
        }
        Ok(Self { gsd, origin, first: first.map(|v| v as i64), size: size.map(|v| v as u32) })
    }

    /// Returns the grid enlarged by a margin of `by_px` pixels on each side.
    pub(crate) fn grown(&self, by_px: u32) -> Self {
        let size = self.size.map(|side| side.saturating_add(2 * by_px));
        Self { first: self.first.map(|v| v - i64::from(by_px)), size, ..*self }
    }

    /// Returns the coordinate of the lower edge of the pixel `index` along an axis (0: x, 1: y).
    pub(crate) fn edge(&self, axis: usize, index: i64) -> f64 {
        self.origin[axis] + index as f64 * self.gsd
    }

    /// Returns x of the image's left edge and y of its upper edge.
    pub(crate) fn left_top(&self) -> [f64; 2] {
        [self.edge(0, self.first[0]), self.edge(1, self.first[1] + i64::from(self.size[1]))]
    }

    /// Returns the bounds of the image: minimum x, minimum y, maximum x, maximum y.
    pub(crate) fn bounds(&self) -> [f64; 4] {
        let ([left, top], right) = (self.left_top(), self.edge(0, self.first[0] + i64::from(self.size[0])));
        [left, self.edge(1, self.first[1]), right, top]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_multiples_from_the_origin_and_decimal_bounds_take_in_no_further_pixel() {
        let grid = Grid::of_bounds(0.1, [0.0; 2], [637_000.3, 4_851_000.7, 637_001.3, 4_851_001.7]).unwrap();
        assert_eq!((grid.first, grid.size), ([6_370_003, 48_510_007], [10, 10]));
        let grid = Grid::of_bounds(0.25, [0.1, -0.1], [-3.0, -3.0, 3.0, 3.0]).unwrap();
        assert_eq!((grid.first, grid.size), ([-13, -12], [25, 25]));
        assert!((grid.left_top()[0] + 3.15).abs() < 1e-12 && (grid.left_top()[1] - 3.15).abs() < 1e-12);
        // A single point gets one pixel.
        assert_eq!(Grid::of_bounds(1.0, [0.0; 2], [2.0, 2.0, 2.0 + 1e-9, 2.5]).unwrap().size, [1, 1]);
    }

    #[test]
    fn wrong_grids_are_refused() {
        let refused = |gsd, bounds| Grid::of_bounds(gsd, [0.0; 2], bounds).is_err();
        let sound = [0.0, 0.0, 1.0, 1.0];
        for gsd in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300, 1e-9] {
            assert!(refused(gsd, sound), "{gsd}");
        }
        for bounds in [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 1.0, 1.0], [0.0, 0.0, f64::INFINITY, 1.0], [f64::NAN; 4]] {
            assert!(refused(1.0, bounds), "{bounds:?}");
        }
        let too_far = [([0.0; 2], [1e12, 0.0, 1e12 + 1.0, 1.0]), ([f64::INFINITY, 0.0], sound), ([-1e13, 0.0], sound)];
        for (origin, bounds) in too_far {
            assert_eq!(Grid::of_bounds(0.1, origin, bounds).err(), Some(GridFault::Origin(origin)));
        }
        assert!(!refused(0.1, sound));
    }
}
