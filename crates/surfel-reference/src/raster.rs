//! The visibility and attribute passes (§5), one splat after another over bands of rows.

use crate::margin;
use crate::splat::ScreenSplat;
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::bounds::Extent;
use surfel_math::{V2, kernel};
use surfel_render::{Attributes, FramePlan, Region, View};

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
    pub alpha: f64,
    pub fragments: u32,
    /// A decision of this pixel is within its margin.
    pub marginal: bool,
}

impl Sums {
    /// Z of the pixel: Σwz/Σw, or +∞ where Σw = 0.
    pub(crate) fn resolved_depth(&self) -> f64 {
        if self.weight > 0.0 { self.depth / self.weight } else { f64::INFINITY }
    }

    /// Adds a fragment of weight `w` at depth `z`.
    pub(crate) fn add(&mut self, splat: &ScreenSplat, w: f64, z: f64, wants: Attributes) {
        self.weight += w;
        self.fragments += 1;
        if wants.color {
            for (s, c) in self.color.iter_mut().zip(splat.color) {
                *s += w * c;
            }
        }
        if wants.normal {
            self.normal += splat.normal * w;
        }
        self.depth += w * z;
        if wants.material {
            for (s, m) in self.material.iter_mut().zip(splat.material) {
                *s += w * m;
            }
        }
        self.coverage += w * splat.coverage_per_weight;
        self.alpha += w * splat.alpha;
    }
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
pub(crate) fn pixels(extent: &Extent<f64>, rect: Region) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
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

/// Which fragments exist for a run, pixel by pixel; without a limit, all do.
#[derive(Clone, Copy, Default)]
pub(crate) struct Limits<'a> {
    /// Fragments at or before this depth don't: they belong to what lies in front.
    pub beyond: Option<&'a [f64]>,
    /// Nor do fragments after this depth: something opaque hides them.
    pub up_to: Option<&'a [f64]>,
    /// Depth of the polygon before which splats are blended (§6): their attributes count up to their own ε behind it.
    pub polygon: Option<&'a [f64]>,
}

impl<'a> Limits<'a> {
    fn of_pixels(&self, pixels: std::ops::Range<usize>) -> Self {
        let part = |limit: Option<&'a [f64]>| limit.map(|l| &l[pixels.clone()]);
        Self { beyond: part(self.beyond), up_to: part(self.up_to), polygon: part(self.polygon) }
    }

    fn hold(&self, at: usize, z: f64) -> bool {
        self.beyond.is_none_or(|b| z > b[at]) && self.up_to.is_none_or(|u| z <= u[at])
    }

    /// True if the polygon leaves a fragment's attributes in.
    fn reach(&self, at: usize, z: f64, epsilon: f64) -> bool {
        self.polygon.is_none_or(|p| z - epsilon <= p[at])
    }

    /// True if rounding could flip whether they hold.
    fn are_near(&self, at: usize, z: f64) -> bool {
        [self.beyond, self.up_to].into_iter().flatten().any(|limit| margin::on_depth(z, limit[at]))
    }
}

/// A fragment as the A-buffer keeps it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Index into the run's splats.
    pub splat: u32,
    pub z: f64,
    /// w of the filtered footprint; 0 outside.
    pub weight: f64,
    /// Inside the filtered footprint.
    pub inside: bool,
    /// Inside the unfiltered footprint.
    pub visible: bool,
    /// Rounding could flip `inside`, or that the fragment exists.
    pub marginal: bool,
    /// Rounding could flip `visible`.
    pub on_visible_rim: bool,
}

/// What a run does.
pub(crate) struct Run<'a> {
    pub splats: &'a [ScreenSplat],
    pub bands: &'a Bands,
    pub view: &'a View,
    pub plan: &'a FramePlan,
    /// What is accumulated.
    pub attributes: Attributes,
    /// Fragments compete for what is kept; without, every one that exists is accumulated.
    pub visibility: bool,
    pub limits: Limits<'a>,
}

impl<'a> Run<'a> {
    /// Both passes over all fragments, as the plan says.
    pub(crate) fn new(splats: &'a [ScreenSplat], bands: &'a Bands, view: &'a View, plan: &'a FramePlan) -> Self {
        let limits = Limits::default();
        Self { splats, bands, view, plan, attributes: plan.attributes, visibility: true, limits }
    }

    /// Visibility: what each pixel of the bands' rectangle keeps; nothing without it.
    pub(crate) fn kept(&self) -> Vec<Kept> {
        let rect = self.bands.rect;
        let mut kept = vec![Kept::NOTHING; rect.width as usize * rect.height as usize];
        if !self.visibility {
            return kept;
        }
        kept.par_chunks_mut(rect.width as usize * BAND_ROWS as usize)
            .zip(self.bands.lists.par_iter())
            .enumerate()
            .for_each(|(band, (kept, list))| self.band(band, list).visibility(kept));
        kept
    }

    /// Attributes up to what is kept; [`Kept::NOTHING`] in a pixel lets all of its fragments pass.
    pub(crate) fn passes(&self, kept: Vec<Kept>) -> Passes {
        let mut sums = vec![Sums::default(); kept.len()];
        let unknown = Possible { nearest: Kept::NOTHING, farthest: Kept::NOTHING };
        let mut possible = vec![unknown; if self.plan.planes.margin { kept.len() } else { 0 }];
        let band_pixels = self.bands.rect.width as usize * BAND_ROWS as usize;
        let mut possible_bands: Vec<&mut [Possible]> = possible.chunks_mut(band_pixels).collect();
        possible_bands.resize_with(self.bands.lists.len(), Default::default);
        let fragments = kept
            .par_chunks(band_pixels)
            .zip(sums.par_chunks_mut(band_pixels))
            .zip(possible_bands)
            .zip(self.bands.lists.par_iter())
            .enumerate()
            .map(|(band, (((kept, sums), possible), list))| {
                let pass = self.band(band, list);
                let fragments = pass.attributes(kept, sums);
                if self.plan.planes.margin && self.visibility {
                    pass.visibility_margin(kept, sums, possible);
                }
                fragments
            })
            .sum();
        Passes { kept, sums, possible, fragments }
    }

    /// Fragments of every pixel of the bands' rectangle, in splat order: all that have a depth and lie inside a footprint or
    /// on its rim.
    pub(crate) fn fragments(&self) -> Vec<Vec<Fragment>> {
        let of_band = |(band, list): (usize, &'a Vec<u32>)| {
            let pass = self.band(band, list);
            let mut pixels = vec![Vec::new(); (pass.rect.width * pass.rect.height) as usize];
            pass.gather(&mut pixels);
            pixels
        };
        self.bands.lists.par_iter().enumerate().flat_map_iter(of_band).collect()
    }

    fn band(&self, band: usize, list: &'a [u32]) -> BandPass<'_> {
        let rect = self.bands.rect;
        let y = rect.y + band as u32 * BAND_ROWS;
        let rows = BAND_ROWS.min(rect.y + rect.height - y);
        let start = band * (rect.width * BAND_ROWS) as usize;
        let limits = self.limits.of_pixels(start..start + (rect.width * rows) as usize);
        BandPass { run: self, list, rect: Region { y, height: rows, ..rect }, limits }
    }
}

/// Whose pixels are looked at.
#[derive(Clone, Copy)]
enum Footprints {
    Visible,
    Filtered,
    Both,
}

/// A run over one band.
struct BandPass<'a> {
    run: &'a Run<'a>,
    list: &'a [u32],
    rect: Region,
    limits: Limits<'a>,
}

impl BandPass<'_> {
    /// Calls `each(splat's index, splat, pixel's index in the band, pixel's centre, z)` for every pixel of the footprints'
    /// boxes where splats have a depth.
    fn for_fragments(&self, which: Footprints, mut each: impl FnMut(u32, &ScreenSplat, usize, V2<f64>, f64)) {
        for &i in self.list {
            let splat = &self.run.splats[i as usize];
            let extent = match which {
                Footprints::Visible => splat.visible_box,
                Footprints::Filtered => splat.filtered_box,
                Footprints::Both => splat.visible_box.union(splat.filtered_box),
            };
            let (columns, rows) = pixels(&extent, self.rect);
            for y in rows {
                for x in columns.clone() {
                    let at = ((y - self.rect.y) * self.rect.width + x - self.rect.x) as usize;
                    let pixel = center(x, y);
                    if let Some(z) = splat.depth_at(pixel, self.run.view) {
                        each(i, splat, at, pixel, z);
                    }
                }
            }
        }
    }

    fn gather(&self, pixels: &mut [Vec<Fragment>]) {
        let cutoff = self.run.plan.splat_filter.cutoff;
        let margins = self.run.plan.planes.margin;
        self.for_fragments(Footprints::Both, |i, splat, at, pixel, z| {
            let rho_squared = splat.rho_squared_at(pixel);
            let fragment = Fragment {
                splat: i,
                z,
                weight: rho_squared.map_or(0.0, |r| splat.weight_scale * kernel::weight(r, cutoff)),
                inside: rho_squared.is_some(),
                visible: splat.is_visible_at(pixel),
                marginal: margins && margin::is_marginal(splat, pixel, z, &Kept::NOTHING, self.run.view),
                on_visible_rim: margins && margin::on_rim(&splat.visible, pixel - splat.anchor),
            };
            if fragment.inside || fragment.visible || fragment.marginal || fragment.on_visible_rim {
                pixels[at].push(fragment);
            }
        });
    }

    fn visibility(&self, kept: &mut [Kept]) {
        self.for_fragments(Footprints::Visible, |_, splat, at, pixel, z| {
            // The splats come in index order, so the smallest (z + ε, index) wins by keeping the first of equals.
            if z + splat.epsilon < kept[at].value && self.limits.hold(at, z) && splat.is_visible_at(pixel) {
                kept[at] = Kept { value: z + splat.epsilon, epsilon: splat.epsilon };
            }
        });
    }

    fn attributes(&self, kept: &[Kept], sums: &mut [Sums]) -> u64 {
        let cutoff = self.run.plan.splat_filter.cutoff;
        let mut fragments = 0;
        self.for_fragments(Footprints::Filtered, |_, splat, at, pixel, z| {
            let hold = self.limits.hold(at, z) && self.limits.reach(at, z, splat.epsilon);
            if self.run.plan.planes.margin {
                let near_polygon = self.limits.polygon.is_some_and(|p| margin::on_depth(z - splat.epsilon, p[at]));
                let near_limit = (self.limits.are_near(at, z) || near_polygon) && z <= kept[at].value;
                sums[at].marginal |= (hold && margin::is_marginal(splat, pixel, z, &kept[at], self.run.view))
                    || (near_limit && splat.rho_squared_at(pixel).is_some());
            }
            if !hold || z > kept[at].value {
                return;
            }
            let Some(rho_squared) = splat.rho_squared_at(pixel) else { return };
            let w = splat.weight_scale * kernel::weight(rho_squared, cutoff);
            sums[at].add(splat, w, z, self.run.attributes);
            fragments += 1;
        });
        fragments
    }

    /// A visibility fragment on the rim of its splat, or at a limit, matters only where it would be, or is, the nearest.
    fn visibility_margin(&self, kept: &[Kept], sums: &mut [Sums], possible: &mut [Possible]) {
        let keep = |best: &mut Kept, own: Kept| {
            if own.value < best.value {
                *best = own;
            }
        };
        self.for_fragments(Footprints::Visible, |_, splat, at, pixel, z| {
            let (hold, near_limit) = (self.limits.hold(at, z), self.limits.are_near(at, z));
            if !hold && !near_limit {
                return;
            }
            let own = Kept { value: z + splat.epsilon, epsilon: splat.epsilon };
            let rim = margin::is_visibility_marginal(splat, pixel);
            let visible = splat.is_visible_at(pixel);
            let open = rim || (near_limit && visible);
            sums[at].marginal |= open && own.value <= kept[at].value;
            if open || visible {
                keep(&mut possible[at].nearest, own);
            }
            if !open && visible {
                keep(&mut possible[at].farthest, own);
            }
        });
    }
}
