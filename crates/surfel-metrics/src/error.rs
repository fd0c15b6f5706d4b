//! Errors of comparisons.

/// Reason why two images can't be compared. Differences, however large, are results and never errors.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MetricsError {
    /// A slice, such as an image's pixels or a mask, has the wrong number of values.
    #[error("{what} has {found} values, expected {expected}: {rule}")]
    Length {
        /// Name of the slice in messages, such as "the mask".
        what: &'static str,
        /// Number of values that the slice has.
        found: usize,
        /// Number of values that the slice must have.
        expected: usize,
        /// Rule from which the expected number follows, such as "one for each pixel".
        rule: &'static str,
    },
    /// The two images to compare have different sizes.
    #[error(
        "the images are {}x{} and {}x{} pixels, expected equal sizes: render or crop both alike",
        a.0, a.1, b.0, b.1
    )]
    Size {
        /// Width and height of the first image, in pixels.
        a: (u32, u32),
        /// Width and height of the second image, in pixels.
        b: (u32, u32),
    },
    /// An image has too many values to address on this machine.
    #[error("an image of {width}x{height} pixels is too large to address here, expected fewer pixels: compare crops")]
    TooLarge {
        /// Width of the image in pixels.
        width: u32,
        /// Height of the image in pixels.
        height: u32,
    },
    /// An option of a comparison is out of its range.
    #[error("{field} is {found}, expected {expected}")]
    OutOfRange {
        /// Name of the option, as its field is called.
        field: &'static str,
        /// Value that the option has.
        found: f64,
        /// Range that the option must be in, in words.
        expected: &'static str,
    },
}

/// Returns the number of pixels of a `width`×`height` image. Returns an error if its values, `channels` per pixel, are
/// too many to address.
pub(crate) fn pixel_count(width: u32, height: u32, channels: usize) -> Result<usize, MetricsError> {
    let count = usize::try_from(width).ok().zip(usize::try_from(height).ok()).and_then(|(w, h)| w.checked_mul(h));
    match count {
        Some(n) if n.checked_mul(channels).is_some() => Ok(n),
        _ => Err(MetricsError::TooLarge { width, height }),
    }
}

/// Returns [`MetricsError::Length`] if the length `found` of a slice isn't `expected`.
pub(crate) fn check_length(
    what: &'static str,
    found: usize,
    expected: usize,
    rule: &'static str,
) -> Result<(), MetricsError> {
    if found == expected { Ok(()) } else { Err(MetricsError::Length { what, found, expected, rule }) }
}
