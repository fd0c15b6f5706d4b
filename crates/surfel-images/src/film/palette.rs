//! Reduction of frames to palettes of 256 colours, with ordered dithering.
//!
//! The colours of a frame are divided into groups: the group with the largest squared error is divided repeatedly. The
//! groups' means are then refined by one step of Lloyd's algorithm. A colour of a large area, such as the background,
//! is in the palette exactly. A palette is used for later frames, too, as long as a new one would hardly be better. So
//! static parts of a film don't flicker.
//!
//! A colour between two palette colours becomes a mixture of both in a fixed pattern (ordered dithering). Unlike error
//! diffusion, the pattern doesn't move from frame to frame. Colours of the palette aren't mixed.

use std::collections::HashMap;

/// Maximum number of colours of a GIF frame.
const COLORS: usize = 256;
/// Number of leading bits per channel that distinguish colours in [`samples`]. Colours with equal leading bits are
/// merged.
const BITS: u32 = 6;
/// Factor f and summand s of the limit up to which the last palette is used for the next frame. Its mean squared error
/// may be f times that of a new palette plus s, in squared 8-bit levels.
const REUSE_LIMITS: (f32, f32) = (1.25, 0.5);
/// Divisor of a frame's number of pixels. A colour that more pixels than the quotient have (1/50 of the frame) is in
/// the palette exactly.
const LARGE: usize = 50;
/// Weight of a mixture's noise relative to its error. The noise is the mean squared difference of single pixels from
/// their mean; the error is the squared difference of that mean from the wanted colour.
const ROUGHNESS: f32 = 0.15;
/// Number of mixtures in the cache of a [`Quantiser`] above which the cache is emptied before the next frame, to bound
/// its memory.
const KNOWN: usize = 1 << 20;

/// Width and height of the dither pattern in pixels.
const SIDE: usize = 8;
/// Thresholds of the dither pattern in 64ths, by row and column: the ordered pattern of Bayer (1973). A pixel gets a
/// mixture's second colour if its threshold is less than the second colour's share.
const PATTERN: [[u8; SIDE]; SIDE] = [
    [0, 32, 8, 40, 2, 34, 10, 42],
    [48, 16, 56, 24, 50, 18, 58, 26],
    [12, 44, 4, 36, 14, 46, 6, 38],
    [60, 28, 52, 20, 62, 30, 54, 22],
    [3, 35, 11, 43, 1, 33, 9, 41],
    [51, 19, 59, 27, 49, 17, 57, 25],
    [15, 47, 7, 39, 13, 45, 5, 37],
    [63, 31, 55, 23, 61, 29, 53, 21],
];

type Rgb = [f32; 3];

/// Mean of the colours of a frame that have equal leading bits ([`BITS`]), and the number of their pixels.
#[derive(Clone, Copy, Debug)]
struct Sample {
    color: Rgb,
    count: f32,
}

/// Mixture of two palette colours that dithering shows for a colour between them.
#[derive(Clone, Copy, Debug)]
struct Mixture {
    colors: [u8; 2],
    /// Fraction of pixels with the second colour, in 64ths, from 0 to 32.
    share: u8,
}

/// Quantiser that maps frames to a palette, which successive frames share if possible.
#[derive(Debug, Default)]
pub(super) struct Quantiser {
    palette: Vec<[u8; 3]>,
    /// Cache of the mixtures by frame colour, valid for the current palette.
    known: HashMap<[u8; 3], Mixture>,
}

impl Quantiser {
    /// Returns the palette of the last frame that was quantised.
    pub(super) fn palette(&self) -> &[[u8; 3]] {
        &self.palette
    }

    /// Returns the palette index of each pixel, and replaces the palette if a new one is clearly better. `width` is the
    /// length of a row. Alpha is ignored.
    pub(super) fn indices(&mut self, pixels: &[[u8; 4]], width: usize) -> Vec<u8> {
        let samples = samples(pixels);
        let fresh = palette(&samples, &counted(pixels), pixels.len());
        let limit = REUSE_LIMITS.0 * mean_error(&samples, &fresh) + REUSE_LIMITS.1;
        if self.palette.is_empty() || mean_error(&samples, &self.palette) > limit {
            self.palette = fresh;
            self.known.clear();
        }
        if self.known.len() > KNOWN {
            self.known.clear();
        }
        let Self { palette, known } = self;
        let colors: Vec<Rgb> = palette.iter().map(|color| color.map(f32::from)).collect();
        let mut indices = Vec::with_capacity(pixels.len());
        // Neighbouring pixels often have the same colour.
        let mut last: Option<([u8; 3], Mixture)> = None;
        for (i, [r, g, b, _]) in pixels.iter().enumerate() {
            let color = [*r, *g, *b];
            let mixture = match last {
                Some((of, mixture)) if of == color => mixture,
                _ => *known.entry(color).or_insert_with(|| mixture(color.map(f32::from), &colors)),
            };
            last = Some((color, mixture));
            let threshold = PATTERN[i / width % SIDE][i % width % SIDE];
            indices.push(mixture.colors[usize::from(threshold < mixture.share)]);
        }
        indices
    }
}

fn squared(a: Rgb, b: Rgb) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

/// Returns the index of the nearest colour, and the squared distance to it.
fn nearest(color: Rgb, colors: &[Rgb]) -> (usize, f32) {
    let mut best = (0, f32::INFINITY);
    for (i, other) in colors.iter().enumerate() {
        let error = squared(color, *other);
        if error < best.1 {
            best = (i, error);
        }
    }
    best
}

/// Returns the mixture of two palette colours that approximates a colour with the smallest sum of error and weighted
/// noise ([`ROUGHNESS`]).
fn mixture(color: Rgb, colors: &[Rgb]) -> Mixture {
    let (first, mut least) = nearest(color, colors);
    let mut best = Mixture { colors: [first as u8; 2], share: 0 };
    if least == 0.0 {
        return best;
    }
    let base = colors[first];
    let toward: Rgb = std::array::from_fn(|k| color[k] - base[k]);
    for (second, other) in colors.iter().enumerate() {
        let step: Rgb = std::array::from_fn(|k| other[k] - base[k]);
        let length = squared(*other, base);
        let along = step[0] * toward[0] + step[1] * toward[1] + step[2] * toward[2];
        if along <= 0.0 || length == 0.0 {
            continue;
        }
        let share = (along / length).min(0.5);
        let mean: Rgb = std::array::from_fn(|k| base[k] + share * step[k]);
        let error = squared(color, mean) + ROUGHNESS * share * (1.0 - share) * length;
        if error < least {
            least = error;
            best = Mixture { colors: [first as u8, second as u8], share: (64.0 * share).round() as u8 };
        }
    }
    best
}

/// Returns the number of pixels for each colour of a frame.
fn counted(pixels: &[[u8; 4]]) -> HashMap<[u8; 3], usize> {
    let mut counts = HashMap::new();
    for run in pixels.chunk_by(|a, b| a[..3] == b[..3]) {
        if let Some([r, g, b, _]) = run.first() {
            *counts.entry([*r, *g, *b]).or_default() += run.len();
        }
    }
    counts
}

/// Returns the colours of a frame with their numbers of pixels. Colours with equal leading bits ([`BITS`]) are merged
/// into their mean.
fn samples(pixels: &[[u8; 4]]) -> Vec<Sample> {
    let mut sums = vec![[0_u64; 4]; 1 << (3 * BITS)];
    let lead = |level: u8| usize::from(level >> (8 - BITS));
    for [r, g, b, _] in pixels {
        let sum = &mut sums[lead(*r) << (2 * BITS) | lead(*g) << BITS | lead(*b)];
        sum[0] += u64::from(*r);
        sum[1] += u64::from(*g);
        sum[2] += u64::from(*b);
        sum[3] += 1;
    }
    let used = sums.iter().filter(|sum| sum[3] > 0);
    let sample = |[r, g, b, count]: &[u64; 4]| {
        let mean = |sum: u64| (sum as f64 / *count as f64) as f32;
        Sample { color: [mean(*r), mean(*g), mean(*b)], count: *count as f32 }
    };
    used.map(sample).collect()
}

/// Returns the mean squared error of a frame's pixels in the nearest colours of a palette, in squared 8-bit levels.
fn mean_error(samples: &[Sample], palette: &[[u8; 3]]) -> f32 {
    let colors: Vec<Rgb> = palette.iter().map(|color| color.map(f32::from)).collect();
    let (mut error, mut count) = (0.0_f64, 0.0_f64);
    for sample in samples {
        error += f64::from(sample.count * nearest(sample.color, &colors).1);
        count += f64::from(sample.count);
    }
    (error / count.max(1.0)) as f32
}

/// Group of a frame's colours that one colour of the palette represents.
struct Group {
    samples: Vec<Sample>,
    mean: Rgb,
    /// Channel with the largest squared error from the mean, along which the group is divided.
    axis: usize,
    error: f32,
}

impl Group {
    fn new(samples: Vec<Sample>) -> Self {
        let count: f64 = samples.iter().map(|sample| f64::from(sample.count)).sum();
        let sum = |k: usize| samples.iter().map(|s| f64::from(s.color[k]) * f64::from(s.count)).sum::<f64>();
        let mean: Rgb = std::array::from_fn(|k| (sum(k) / count.max(1.0)) as f32);
        let spread = |k: usize| samples.iter().map(|s| s.count * (s.color[k] - mean[k]).powi(2)).sum::<f32>();
        let errors: Rgb = std::array::from_fn(spread);
        let axis = (0..3).max_by(|a, b| errors[*a].total_cmp(&errors[*b])).unwrap_or(0);
        Self { samples, mean, axis, error: errors.iter().sum() }
    }

    /// Divides the group at its mean along one channel; `None` if all of its colours are equal.
    fn divided(&self) -> Option<[Self; 2]> {
        let at = self.mean[self.axis];
        let (low, high): (Vec<Sample>, Vec<Sample>) = self.samples.iter().partition(|s| s.color[self.axis] <= at);
        (!low.is_empty() && !high.is_empty()).then(|| [Self::new(low), Self::new(high)])
    }
}

/// Returns at most 256 colours that represent the samples: the colours themselves, if there are no more. `counts` has
/// the number of pixels of each colour, and `all` is the number of all pixels.
fn palette(samples: &[Sample], counts: &HashMap<[u8; 3], usize>, all: usize) -> Vec<[u8; 3]> {
    if counts.len() <= COLORS {
        return sorted(counts.keys().copied());
    }
    let mut groups = vec![Group::new(samples.to_vec())];
    while groups.len() < COLORS {
        let worst = (0..groups.len()).max_by(|a, b| groups[*a].error.total_cmp(&groups[*b].error)).unwrap_or(0);
        let Some([low, high]) = groups[worst].divided() else { break };
        groups[worst] = low;
        groups.push(high);
    }
    let colors: Vec<Rgb> = groups.iter().map(|group| group.mean).collect();
    // One step of Lloyd's algorithm: each colour is replaced by the mean of the samples nearest to it.
    let mut sums = vec![[0.0_f64; 4]; colors.len()];
    for sample in samples {
        let sum = &mut sums[nearest(sample.color, &colors).0];
        (0..3).for_each(|k| sum[k] += f64::from(sample.color[k]) * f64::from(sample.count));
        sum[3] += f64::from(sample.count);
    }
    let mean = |(sum, color): (&[f64; 4], &Rgb)| {
        if sum[3] > 0.0 { std::array::from_fn(|k| (sum[k] / sum[3]) as f32) } else { *color }
    };
    let mut means: Vec<Rgb> = sums.iter().zip(&colors).map(mean).collect();
    for (color, _) in counts.iter().filter(|(_, count)| *count * LARGE > all) {
        let color = color.map(f32::from);
        let (place, _) = nearest(color, &means);
        means[place] = color;
    }
    sorted(means.into_iter().map(|color| color.map(|level| level.round() as u8)))
}

fn sorted(colors: impl Iterator<Item = [u8; 3]>) -> Vec<[u8; 3]> {
    let mut palette: Vec<[u8; 3]> = colors.collect();
    palette.sort_unstable();
    palette.dedup();
    palette
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a square of smoothly shaded colours on white.
    fn shaded(side: usize, tint: Rgb) -> Vec<[u8; 4]> {
        let pixel = |i: usize| {
            let (x, y) = ((i % side) as f32 / side as f32 - 0.5, (i / side) as f32 / side as f32 - 0.5);
            let square = 1.0 - 5.0 * (x * x + y * y);
            if square < 0.0 {
                return [255; 4];
            }
            let light = 40.0 + 200.0 * (0.5 * x + 0.3 * y + 0.7 * square.sqrt()).clamp(0.0, 1.0);
            let [r, g, b] = tint.map(|c| (c * light).round() as u8);
            [r, g, b, 255]
        };
        (0..side * side).map(pixel).collect()
    }

    fn decoded(quantiser: &Quantiser, indices: &[u8]) -> Vec<[u8; 3]> {
        indices.iter().map(|index| quantiser.palette()[usize::from(*index)]).collect()
    }

    #[test]
    fn shades_are_near_and_flat_colours_exact() {
        let pixels = shaded(128, [1.0, 0.7, 0.4]);
        let mut quantiser = Quantiser::default();
        let indices = quantiser.indices(&pixels, 128);
        let found = decoded(&quantiser, &indices);
        assert!(quantiser.palette().len() <= COLORS);
        let mut square = 0.0;
        for ([r, g, b, _], color) in pixels.iter().zip(&found) {
            let error = squared([*r, *g, *b].map(f32::from), color.map(f32::from));
            square += f64::from(error) / 3.0;
            assert!([*r, *g, *b] != [255; 3] || *color == [255; 3]);
        }
        let rmse = (square / pixels.len() as f64).sqrt();
        assert!(rmse < 2.0, "{rmse}");
    }

    #[test]
    fn palettes_stay_until_they_fit_no_longer() {
        let mut quantiser = Quantiser::default();
        let red = shaded(64, [1.0, 0.3, 0.2]);
        let first = quantiser.indices(&red, 64);
        let palette = quantiser.palette().to_vec();
        let mut moved = red.clone();
        moved.rotate_right(5);
        quantiser.indices(&moved, 64);
        assert_eq!(quantiser.palette(), palette, "the same colours elsewhere");
        assert_eq!(quantiser.indices(&red, 64), first);
        quantiser.indices(&shaded(64, [0.2, 0.3, 1.0]), 64);
        assert_ne!(quantiser.palette(), palette, "other colours");
    }

    #[test]
    fn colours_between_two_are_mixed_in_their_shares() {
        let colors = [[0.0; 3], [100.0; 3], [0.0, 255.0, 0.0]];
        let found = mixture([25.0; 3], &colors);
        assert_eq!((found.colors, found.share), ([0, 1], 16));
        let of_pattern = PATTERN.as_flattened().iter().filter(|threshold| **threshold < 16).count();
        assert_eq!(of_pattern, 16, "a quarter of the pixels");
        assert_eq!(mixture([100.0; 3], &colors).share, 0);
    }
}
