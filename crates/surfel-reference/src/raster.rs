//! The visibility and attribute passes (§5), one splat after another over bands of rows.

use crate::margin;
use crate::splat::ScreenSplat;
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::bounds::Extent;
use surfel_math::{V2, kernel};
use surfel_render::{FramePlan, Region, View};

/// Rows of a band. Only the amount of work a task; changes no pixel.
const BAND_ROWS: u32 = 8;

/// What visibility keeps of a pixel: the minimum of z + ε, and whose it is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kept {
    /// z + ε of the writer; +∞ where nothing is kept.
    pub value: f64,
    /// ε of the writer.
    pub epsilon: f64,
}

impl Kept {
    pub(crate) const NOTHING: Self = Self { value: f64::INFINITY, epsilon: 0.0 };
}

/// What visibility could keep of a pixel, however its marginal tests come out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Possible {
    /// If every fragment on a rim is inside.
    pub nearest: Kept,
    /// If none is.
    pub farthest: Kept,
}

/// Weighted sums of a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    pub weight: f64,
    pub color: [f64; 3],
    pub normal: DVec3,
    pub depth: f64,
    pub material: [f64; 4],
    pub coverage: f64,
    pub fragments: u32,
    /// A decision of this pixel is within its margin.
    pub marginal: bool,
}

/// Both passes over a rectangle of pixels.
pub(crate) struct Passes {
    pub kept: Vec<Kept>,
    pub sums: Vec<Sums>,
    /// For the margin plane alone, else empty.
    pub possible: Vec<Possible>,
    /// Fragments that contributed.
    pub fragments: u64,
}

/// Splats that may touch each band, in index order.
pub(crate) struct Bands {
    rect: Region,
    lists: Vec<Vec<u32>>,
}

impl Bands {
    /// Sorts splats into bands of `rect`.
    pub(crate) fn new(splats: &[ScreenSplat], rect: Region) -> Self {
        let count = rect.height.div_ceil(BAND_ROWS) as usize;
        let mut lists = vec![Vec::new(); count];
        for (i, splat) in splats.iter().enumerate() {
            let hull = splat.visible_box.union(splat.filtered_box);
            let (columns, rows) = pixels(&hull, rect);
            if columns.is_empty() || rows.is_empty() {
                continue;
            }
            let (first, last) = ((rows.start - rect.y) / BAND_ROWS, (rows.end - 1 - rect.y) / BAND_ROWS);
            for list in &mut lists[first as usize..=last as usize] {
                list.push(i as u32);
            }
        }
        Self { rect, lists }
    }
}

/// Columns and rows of `rect` whose pixel centres lie in `extent`, grown by a hair so that neither rounding
/// nor the margin loses one.
fn pixels(extent: &Extent<f64>, rect: Region) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
    let range = |min: f64, max: f64, start: u32, length: u32| {
        let (lo, hi) = (f64::from(start), f64::from(start + length));
        // Saturating float-to-int casts: an infinite box is clipped to the rectangle.
        let slack = 2.0 * margin::RIM_PX;
        let first = (min - 0.5 - slack).ceil().clamp(lo, hi) as u32;
        let end = ((max - 0.5 + slack).floor() + 1.0).clamp(lo, hi) as u32;
        first..end.max(first)
    };
    (range(extent.min.x, extent.max.x, rect.x, rect.width), range(extent.min.y, extent.max.y, rect.y, rect.height))
}

fn center(x: u32, y: u32) -> V2<f64> {
    V2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// Runs both passes over the bands' rectangle. Fragments at or before `behind` (one value a pixel) don't exist: with it,
/// this is the "behind" of edge antialiasing.
pub(crate) fn run(
    splats: &[ScreenSplat],
    bands: &Bands,
    view: &View,
    plan: &FramePlan,
    behind: Option<&[f64]>,
) -> Passes {
    let rect = bands.rect;
    let width = rect.width as usize;
    let count = width * rect.height as usize;
    let mut kept = vec![Kept::NOTHING; count];
    let mut sums = vec![Sums::default(); count];
    let unknown = Possible { nearest: Kept::NOTHING, farthest: Kept::NOTHING };
    let mut possible = vec![unknown; if plan.planes.margin { count } else { 0 }];
    let band_pixels = width * BAND_ROWS as usize;
    let mut possible_bands: Vec<&mut [Possible]> = possible.chunks_mut(band_pixels).collect();
    possible_bands.resize_with(bands.lists.len(), Default::default);
    let fragments = kept
        .par_chunks_mut(band_pixels)
        .zip(sums.par_chunks_mut(band_pixels))
        .zip(possible_bands)
        .zip(bands.lists.par_iter())
        .enumerate()
        .map(|(band, (((kept, sums), possible), list))| {
            let y = rect.y + band as u32 * BAND_ROWS;
            let band_rect = Region { y, height: (kept.len() / width) as u32, ..rect };
            let behind = behind.map(|b| &b[band * band_pixels..band * band_pixels + kept.len()]);
            let pass = BandPass { splats, list, rect: band_rect, view, plan, behind };
            pass.visibility(kept);
            let fragments = pass.attributes(kept, sums);
            if plan.planes.margin {
                pass.visibility_margin(kept, sums, possible);
            }
            fragments
        })
        .sum();
    Passes { kept, sums, possible, fragments }
}

struct BandPass<'a> {
    splats: &'a [ScreenSplat],
    list: &'a [u32],
    rect: Region,
    view: &'a View,
    plan: &'a FramePlan,
    behind: Option<&'a [f64]>,
}

impl BandPass<'_> {
    /// Calls `each(splat, pixel's index in the band, pixel's centre, z)` for every pixel of the splats' boxes where they
    /// have a depth.
    fn for_fragments(&self, filtered: bool, mut each: impl FnMut(&ScreenSplat, usize, V2<f64>, f64)) {
        for &i in self.list {
            let splat = &self.splats[i as usize];
            let extent = if filtered { splat.filtered_box } else { splat.visible_box };
            let (columns, rows) = pixels(&extent, self.rect);
            for y in rows {
                for x in columns.clone() {
                    let at = ((y - self.rect.y) * self.rect.width + x - self.rect.x) as usize;
                    let pixel = center(x, y);
                    if let Some(z) = splat.depth_at(pixel, self.view)
                        && self.behind.is_none_or(|b| z > b[at])
                    {
                        each(splat, at, pixel, z);
                    }
                }
            }
        }
    }

    fn visibility(&self, kept: &mut [Kept]) {
        self.for_fragments(false, |splat, at, pixel, z| {
            // The splats come in index order, so the smallest (z + ε, index) wins by keeping the first of equals.
            if z + splat.epsilon < kept[at].value && splat.is_visible_at(pixel) {
                kept[at] = Kept { value: z + splat.epsilon, epsilon: splat.epsilon };
            }
        });
    }

    fn attributes(&self, kept: &[Kept], sums: &mut [Sums]) -> u64 {
        let cutoff = self.plan.splat_filter.cutoff;
        let wants = self.plan.attributes;
        let mut fragments = 0;
        self.for_fragments(true, |splat, at, pixel, z| {
            if self.plan.planes.margin {
                sums[at].marginal |= margin::is_marginal(splat, pixel, z, &kept[at], self.view);
            }
            if z > kept[at].value {
                return;
            }
            let Some(rho_squared) = splat.rho_squared_at(pixel) else { return };
            let w = splat.weight_scale * kernel::weight(rho_squared, cutoff);
            let sum = &mut sums[at];
            sum.weight += w;
            sum.fragments += 1;
            if wants.color {
                for (s, c) in sum.color.iter_mut().zip(splat.color) {
                    *s += w * c;
                }
            }
            if wants.normal {
                sum.normal += splat.normal * w;
            }
            sum.depth += w * z;
            if wants.material {
                for (s, m) in sum.material.iter_mut().zip(splat.material) {
                    *s += w * m;
                }
            }
            sum.coverage += w * splat.coverage_per_weight;
            fragments += 1;
        });
        fragments
    }

    /// A visibility fragment on the rim of its splat matters only where it would be, or is, the nearest.
    fn visibility_margin(&self, kept: &[Kept], sums: &mut [Sums], possible: &mut [Possible]) {
        let keep = |best: &mut Kept, own: Kept| {
            if own.value < best.value {
                *best = own;
            }
        };
        self.for_fragments(false, |splat, at, pixel, z| {
            let own = Kept { value: z + splat.epsilon, epsilon: splat.epsilon };
            let rim = margin::is_visibility_marginal(splat, pixel);
            sums[at].marginal |= rim && own.value <= kept[at].value;
            if rim || splat.is_visible_at(pixel) {
                keep(&mut possible[at].nearest, own);
            }
            if !rim && splat.is_visible_at(pixel) {
                keep(&mut possible[at].farthest, own);
            }
        });
    }
}
