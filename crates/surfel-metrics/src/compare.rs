//! Comparison of two images.

use crate::error::{MetricsError, check_length};
use crate::flip::{self, FlipMap, FlipOptions};
use crate::image::Image;
use crate::plane::{abs_difference, check_tolerance, psnr_of_rmse, root_mean};

/// Linear value of the sRGB level ½, a medium grey.
pub const MID_GREY: f32 = 0.214_041_14;

/// Options of [`compare`].
#[derive(Clone, Debug, PartialEq)]
pub struct CompareOptions<'a> {
    /// Flag per pixel, row by row from the top, true if the pixel is compared. `None` compares all pixels.
    pub mask: Option<&'a [bool]>,
    /// Largest difference of a channel, in linear light, at which pixels count as equal; [`Comparison::differing`]
    /// counts the others. Default 0.
    pub tolerance: f64,
    /// Largest value of a channel in linear light, the peak from which the PSNR is computed: finite and above 0.
    /// Default 1.
    pub peak: f64,
    /// Viewing conditions of FLIP, or `None` to skip FLIP. The images are always linear; [`FlipOptions::encoding`] is
    /// ignored. Default: the default of [`FlipOptions`].
    pub flip: Option<FlipOptions>,
    /// Linear RGB behind transparent pixels for FLIP, which has no alpha. Default [`MID_GREY`]: over black (or white) a
    /// missing black (or white) shape would be invisible. Opaque images don't depend on the background.
    pub background: [f32; 3],
}

impl Default for CompareOptions<'_> {
    fn default() -> Self {
        Self { mask: None, tolerance: 0.0, peak: 1.0, flip: Some(FlipOptions::default()), background: [MID_GREY; 3] }
    }
}

/// Differences between two images. All fields except FLIP's refer to the four linear premultiplied channels.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Comparison {
    /// Width of both images in pixels.
    pub width: u32,
    /// Height of both images in pixels.
    pub height: u32,
    /// Number of pixels that were compared, which the mask selects.
    pub compared: usize,
    /// Largest absolute difference of a channel; it may be infinite by the rule of [`abs_difference`].
    pub max_abs: f64,
    /// Column and row of the first compared pixel with the difference `max_abs`; `None` if no compared pixel differs.
    pub max_abs_at: Option<(u32, u32)>,
    /// Root mean squared difference (RMSE) over all channels of the compared pixels.
    pub rmse: f64,
    /// Peak signal-to-noise ratio (PSNR) in dB, of all channels of the compared pixels; +∞ for equal images.
    pub psnr: f64,
    /// Number of compared pixels with a channel that differs by more than [`CompareOptions::tolerance`].
    pub differing: usize,
    /// Number of compared pixels with an infinite difference in some channel, because of NaN or of an infinity in one
    /// image only.
    pub non_finite: usize,
    /// Mean FLIP error of the compared pixels, in [0, 1]; `None` if FLIP was skipped.
    pub flip_mean: Option<f64>,
    /// FLIP error of every pixel; `None` if FLIP was skipped. Pixels that the mask excludes may have errors too,
    /// because FLIP's filters spread the differences of compared pixels into them.
    pub flip: Option<FlipMap>,
}

/// Compares `test` with `reference`, both linear premultiplied RGBA.
///
/// Pixels outside the mask count in no metric. For FLIP they are copied from the reference to both sides, so that an
/// excluded pixel doesn't spread to its neighbours through the filters.
///
/// # Errors
/// [`MetricsError::Size`] for images of different sizes, [`MetricsError::Length`] for a mask of another length,
/// [`MetricsError::OutOfRange`] for options out of their range.
pub fn compare(reference: &Image, test: &Image, options: &CompareOptions) -> Result<Comparison, MetricsError> {
    let (width, height) = (reference.width(), reference.height());
    if (width, height) != (test.width(), test.height()) {
        return Err(MetricsError::Size { a: (width, height), b: (test.width(), test.height()) });
    }
    let (a, _) = reference.rgba().as_chunks::<4>();
    let (b, _) = test.rgba().as_chunks::<4>();
    if let Some(mask) = options.mask {
        check_length("the mask", mask.len(), a.len(), "one for each pixel")?;
    }
    check_tolerance(options.tolerance)?;

    let counts = |i: usize| options.mask.is_none_or(|mask| mask[i]);
    let mut result = Comparison {
        width,
        height,
        compared: 0,
        max_abs: 0.0,
        max_abs_at: None,
        rmse: 0.0,
        psnr: f64::INFINITY,
        differing: 0,
        non_finite: 0,
        flip_mean: None,
        flip: None,
    };
    let mut squares = 0.0;
    let mut worst = None;
    for i in (0..a.len()).filter(|&i| counts(i)) {
        let mut largest = 0.0f64;
        for (&a, &b) in a[i].iter().zip(&b[i]) {
            let difference = abs_difference(a, b);
            squares += difference * difference;
            largest = largest.max(difference);
        }
        result.compared += 1;
        result.differing += usize::from(largest > options.tolerance);
        result.non_finite += usize::from(largest.is_infinite());
        if largest > result.max_abs {
            result.max_abs = largest;
            worst = Some(i);
        }
    }
    result.max_abs_at = worst.map(|i| {
        let width = width as usize;
        ((i % width) as u32, (i / width) as u32)
    });
    result.rmse = root_mean(squares, result.compared * 4);
    result.psnr = psnr_of_rmse(result.rmse, options.peak)?;

    if let Some(flip_options) = &options.flip {
        let flip_options = FlipOptions { encoding: flip::Encoding::Linear, ..*flip_options };
        let behind = reference.over(options.background);
        let mut front = test.over(options.background);
        for i in (0..front.len()).filter(|&i| !counts(i)) {
            front[i] = behind[i];
        }
        let map = flip::ldr(width, height, &behind, &front, &flip_options)?;
        let sum: f64 = (0..map.error.len()).filter(|&i| counts(i)).map(|i| f64::from(map.error[i])).sum();
        result.flip_mean = Some(if result.compared == 0 { 0.0 } else { sum / result.compared as f64 });
        result.flip = Some(map);
    }
    Ok(result)
}
