//! Visibility and attribute passes (rendering model §5). They draw one splat after another, over bands of rows in
//! parallel.

use crate::splat::{Facing, ScreenSplat};
use crate::threshold::{PossibleThresholds, SideThresholds, Threshold};
use crate::{margin, pixels};
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::{V2, kernel};
use surfel_render::{Attributes, FramePlan, Region, View};

/// Number of pixel rows in a band, the unit of parallel work. No pixel's value depends on it.
const BAND_ROWS: u32 = 8;

/// Sums of the attributes of a pixel's fragments, each multiplied by its weight; `weight` is the sum of the weights.
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
    /// True if rounding could change which fragments are summed in this pixel.
    pub marginal: bool,
}

impl Sums {
    /// Returns the planar depth Z of the pixel: Σwz/Σw, or +∞ if Σw = 0.
    pub(crate) fn resolved_depth(&self) -> f64 {
        if self.weight > 0.0 { self.depth / self.weight } else { f64::INFINITY }
    }

    /// Adds a fragment of weight `w` at depth `z`, with those attributes of its splat that `wants` names.
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

/// Results of the visibility and attribute passes over a rectangle of pixels.
pub(crate) struct Passes {
    pub thresholds: Vec<Threshold>,
    pub sums: Vec<Sums>,
    /// Thresholds that each pixel could have within rounding; empty unless the plane `margin` is requested.
    pub possible: Vec<PossibleThresholds>,
    /// Number of fragments whose attributes were summed, over all pixels.
    pub fragments: u64,
}

/// Bands of pixel rows, the units of parallel work, each with the splats that may touch it in index order.
pub(crate) struct Bands {
    pub rect: Region,
    lists: Vec<Vec<u32>>,
}

impl Bands {
    /// Finds the bands of `rect` that each splat may touch.
    pub(crate) fn new(splats: &[ScreenSplat], rect: Region) -> Self {
        let count = rect.height.div_ceil(BAND_ROWS) as usize;
        let mut lists = vec![Vec::new(); count];
        for (i, splat) in splats.iter().enumerate() {
            let hull = splat.visible_box.union(splat.filtered_box);
            let (columns, rows) = pixels::touched(&hull, rect);
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

/// Depth limits of a [`Run`], per pixel. Fragments outside of the limits are skipped; without a limit, none is.
#[derive(Clone, Copy, Default)]
pub(crate) struct DepthLimits<'a> {
    /// Depth up to which a pixel's fragments are skipped, because they belong to transparent layers or surfaces in
    /// front.
    pub beyond: Option<&'a [f64]>,
    /// Depth beyond which a pixel's fragments are skipped, because an opaque surface occludes them.
    pub up_to: Option<&'a [f64]>,
    /// Depth of the polygon over which a pixel's splats are blended (rendering model §6). Fragments up to a splat's own
    /// ε behind the polygon are summed.
    pub polygon: Option<&'a [f64]>,
}

impl<'a> DepthLimits<'a> {
    fn of_pixels(&self, pixels: std::ops::Range<usize>) -> Self {
        let part = |limit: Option<&'a [f64]>| limit.map(|l| &l[pixels.clone()]);
        Self { beyond: part(self.beyond), up_to: part(self.up_to), polygon: part(self.polygon) }
    }

    fn admit(&self, at: usize, z: f64) -> bool {
        self.beyond.is_none_or(|b| z > b[at]) && self.up_to.is_none_or(|u| z <= u[at])
    }

    /// True if the pixel's polygon doesn't hide a fragment at depth `z`: the fragment is at most ε behind it, or there
    /// is no polygon. `at` is the pixel's index.
    pub(crate) fn reach_polygon(&self, at: usize, z: f64, epsilon: f64) -> bool {
        self.polygon.is_none_or(|p| z - epsilon <= p[at])
    }

    /// True if rounding could change whether `beyond` or `up_to` skips a fragment at depth `z`.
    fn are_near(&self, at: usize, z: f64) -> bool {
        [self.beyond, self.up_to].into_iter().flatten().any(|limit| margin::on_depth(z, limit[at]))
    }
}

/// Splat's contribution to a pixel, as the A-buffer stores it before grouping.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Index of the splat in [`Run::splats`].
    pub splat: u32,
    pub z: f64,
    /// Weight w of the filtered footprint at the pixel; 0 outside of the footprint.
    pub weight: f64,
    /// True if the pixel is inside the filtered footprint.
    pub inside: bool,
    /// True if the pixel is inside the unfiltered footprint.
    pub visible: bool,
    /// True if rounding could change `inside`, or remove the fragment at z_near or by its splat's facing. False if
    /// margins aren't needed.
    pub marginal: bool,
    /// True if the pixel is on the rim of the unfiltered footprint, ignoring the clip, so that rounding could change
    /// `visible`. False if margins aren't needed.
    pub on_visible_rim: bool,
}

/// Visibility and attribute pass over some splats, with their settings.
pub(crate) struct Run<'a> {
    pub splats: &'a [ScreenSplat],
    pub bands: &'a Bands,
    pub view: &'a View,
    pub plan: &'a FramePlan,
    /// Attributes that the attribute pass sums.
    pub attributes: Attributes,
    /// True if only fragments up to a pixel's depth threshold are summed. If false, all fragments within `limits` are.
    pub visibility: bool,
    /// True if the front and the back sides of oriented surfaces have separate thresholds, so that a pixel shows one
    /// side only.
    pub keeps_facings: bool,
    pub limits: DepthLimits<'a>,
}

impl<'a> Run<'a> {
    /// Creates a run of the visibility and the attribute pass, with the plan's attributes and without depth limits.
    /// Both sides of oriented surfaces share one threshold.
    pub(crate) fn new(splats: &'a [ScreenSplat], bands: &'a Bands, view: &'a View, plan: &'a FramePlan) -> Self {
        let (limits, keeps_facings) = (DepthLimits::default(), false);
        Self { splats, bands, view, plan, attributes: plan.attributes, visibility: true, keeps_facings, limits }
    }

    /// Runs the visibility pass, and returns the depth threshold of each pixel of the rectangle. All are
    /// [`Threshold::NONE`] if visibility is off.
    pub(crate) fn thresholds(&self) -> Vec<Threshold> {
        let rect = self.bands.rect;
        let mut thresholds = vec![Threshold::NONE; rect.width as usize * rect.height as usize];
        if !self.visibility {
            return thresholds;
        }
        thresholds
            .par_chunks_mut(rect.width as usize * BAND_ROWS as usize)
            .zip(self.bands.lists.par_iter())
            .enumerate()
            .for_each(|(band, (thresholds, list))| self.band(band, list).visibility(thresholds));
        thresholds
    }

    /// Runs the attribute pass up to the thresholds. [`Threshold::NONE`] admits all fragments of a pixel.
    pub(crate) fn accumulate(&self, thresholds: Vec<Threshold>) -> Passes {
        let mut sums = vec![Sums::default(); thresholds.len()];
        let unknown = PossibleThresholds { nearest: Threshold::NONE, farthest: Threshold::NONE, tie: Threshold::NONE };
        let mut possible = vec![unknown; if self.plan.planes.margin { thresholds.len() } else { 0 }];
        let band_pixels = self.bands.rect.width as usize * BAND_ROWS as usize;
        let mut possible_bands: Vec<&mut [PossibleThresholds]> = possible.chunks_mut(band_pixels).collect();
        possible_bands.resize_with(self.bands.lists.len(), Default::default);
        let fragments = thresholds
            .par_chunks(band_pixels)
            .zip(sums.par_chunks_mut(band_pixels))
            .zip(possible_bands)
            .zip(self.bands.lists.par_iter())
            .enumerate()
            .map(|(band, (((thresholds, sums), possible), list))| {
                let pass = self.band(band, list);
                let fragments = pass.attributes(thresholds, sums);
                if self.plan.planes.margin && self.visibility {
                    pass.visibility_margin(thresholds, sums, possible);
                }
                fragments
            })
            .sum();
        Passes { thresholds, sums, possible, fragments }
    }

    /// Returns the fragments of every pixel of the rectangle, in splat order. A splat has a fragment where the pixel is
    /// inside its unfiltered or filtered footprint, or on the rim of one of them.
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

/// Selection of a splat's footprints whose bounding boxes a pass visits.
#[derive(Clone, Copy)]
enum Footprints {
    Visible,
    Filtered,
    Both,
}

/// Passes of a [`Run`] over one band of pixel rows.
struct BandPass<'a> {
    run: &'a Run<'a>,
    list: &'a [u32],
    rect: Region,
    limits: DepthLimits<'a>,
}

impl BandPass<'_> {
    /// Calls `each` for every pixel of the selected bounding boxes in which the splat has a depth. The arguments are
    /// the splat's index, the splat, the pixel's index in the band, the pixel's centre, and the depth.
    fn for_fragments(&self, which: Footprints, mut each: impl FnMut(u32, &ScreenSplat, usize, V2<f64>, f64)) {
        self.for_pixels(which, |i, splat, at, pixel| {
            if let Some(z) = splat.depth_at(pixel, self.run.view) {
                each(i, splat, at, pixel, z);
            }
        });
    }

    /// Calls `each` for every pixel of the selected bounding boxes, even if the splat has no depth there. The arguments
    /// are those of [`Self::for_fragments`] without the depth.
    fn for_pixels(&self, which: Footprints, mut each: impl FnMut(u32, &ScreenSplat, usize, V2<f64>)) {
        for &i in self.list {
            let splat = &self.run.splats[i as usize];
            let extent = match which {
                Footprints::Visible => splat.visible_box,
                Footprints::Filtered => splat.filtered_box,
                Footprints::Both => splat.visible_box.union(splat.filtered_box),
            };
            let (columns, rows) = pixels::touched(&extent, self.rect);
            for y in rows {
                for x in columns.clone() {
                    let at = ((y - self.rect.y) * self.rect.width + x - self.rect.x) as usize;
                    each(i, splat, at, pixels::center(x, y));
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
                marginal: margins && margin::is_marginal(splat, pixel, z, &Threshold::NONE, self.run.view),
                on_visible_rim: margins && margin::on_rim(&splat.visible, pixel - splat.anchor, splat.rim_px),
            };
            if fragment.inside || fragment.visible || fragment.marginal || fragment.on_visible_rim {
                pixels[at].push(fragment);
            }
        });
    }

    fn visibility(&self, thresholds: &mut [Threshold]) {
        if self.run.keeps_facings {
            return self.visibility_by_facing(thresholds);
        }
        self.for_fragments(Footprints::Visible, |_, splat, at, pixel, z| {
            if z + splat.epsilon < thresholds[at].depth && self.limits.admit(at, z) && splat.is_visible_at(pixel) {
                thresholds[at].lower(Threshold::of(splat, z));
            }
        });
    }

    fn visibility_by_facing(&self, thresholds: &mut [Threshold]) {
        let mut sides = vec![SideThresholds::NONE; thresholds.len()];
        self.for_fragments(Footprints::Visible, |_, splat, at, pixel, z| {
            if self.limits.admit(at, z) && splat.is_visible_at(pixel) {
                sides[at].add(splat, splat.facing, z);
            }
        });
        thresholds.iter_mut().zip(&sides).for_each(|(threshold, sides)| *threshold = sides.shown());
    }

    fn attributes(&self, thresholds: &[Threshold], sums: &mut [Sums]) -> u64 {
        let cutoff = self.run.plan.splat_filter.cutoff;
        let mut fragments = 0;
        self.for_fragments(Footprints::Filtered, |_, splat, at, pixel, z| {
            // Pixels in which rounding could change the side are already marked.
            if !thresholds[at].shows(splat.facing) {
                return;
            }
            let admitted = self.limits.admit(at, z) && self.limits.reach_polygon(at, z, splat.epsilon);
            if self.run.plan.planes.margin {
                let near_polygon = self.limits.polygon.is_some_and(|p| margin::on_depth(z - splat.epsilon, p[at]));
                let near_limit = (self.limits.are_near(at, z) || near_polygon) && z <= thresholds[at].depth;
                sums[at].marginal |= (admitted && margin::is_marginal(splat, pixel, z, &thresholds[at], self.run.view))
                    || (near_limit && splat.rho_squared_at(pixel).is_some());
            }
            if !admitted || z > thresholds[at].depth {
                return;
            }
            let Some(rho_squared) = splat.rho_squared_at(pixel) else { return };
            let w = splat.weight_scale * kernel::weight(rho_squared, cutoff);
            sums[at].add(splat, w, z, self.run.attributes);
            fragments += 1;
        });
        fragments
    }

    /// Marks pixels whose threshold rounding could change, in `sums`, and collects the thresholds that each pixel could
    /// have, in `possible`. A fragment on its splat's rim, or at a depth limit, matters only if it is the nearest of
    /// the pixel, or could be.
    fn visibility_margin(&self, thresholds: &[Threshold], sums: &mut [Sums], possible: &mut [PossibleThresholds]) {
        let keeps_facings = self.run.keeps_facings;
        let mut sides = vec![[SideThresholds::NONE; 2]; if keeps_facings { thresholds.len() } else { 0 }];
        self.for_fragments(Footprints::Visible, |_, splat, at, pixel, z| {
            let (admitted, near_limit) = (self.limits.admit(at, z), self.limits.are_near(at, z));
            if !admitted && !near_limit {
                return;
            }
            let own = thresholds[at].by(splat, z);
            let rim = margin::is_visibility_marginal(splat, pixel);
            let visible = splat.is_visible_at(pixel);
            let turning = keeps_facings && splat.facing_margin <= margin::RELATIVE;
            let open = rim || ((near_limit || turning) && visible);
            let (best, tie) = (thresholds[at], &mut possible[at].tie);
            let differs = |other: Threshold| {
                (other.epsilon - best.epsilon).abs().max((other.writer_depth - best.writer_depth).abs())
            };
            let is_near = margin::on_depth(own.depth, best.depth) && differs(own) > 0.0;
            if is_near && (visible || open) && (tie.depth.is_infinite() || differs(own) > differs(*tie)) {
                *tie = own;
            }
            if let Some([nearest, farthest]) = sides.get_mut(at) {
                let facings = if turning { &[Facing::Front, Facing::Back][..] } else { &[splat.facing] };
                for &facing in facings.iter().filter(|_| open || visible) {
                    nearest.add(splat, facing, z);
                    if !open {
                        farthest.add(splat, facing, z);
                    }
                }
                sums[at].marginal |= open && own.depth <= thresholds[at].depth;
                return;
            }
            sums[at].marginal |= open && own.depth <= thresholds[at].depth;
            if open || visible {
                possible[at].nearest.lower(own);
            }
            if !open && visible {
                possible[at].farthest.lower(own);
            }
        });
        // Fragments that are missing only because their depth misses z_near or z_far by less than the margin. With
        // these fragments, the threshold or the sums would differ.
        self.for_pixels(Footprints::Both, |_, splat, at, pixel| {
            let z = splat.depth_nearly_at(pixel, self.run.view);
            if z.is_none_or(|z| !self.limits.admit(at, z) || z > thresholds[at].depth) {
                return;
            }
            sums[at].marginal |= splat.is_visible_at(pixel) || splat.rho_squared_at(pixel).is_some();
        });
        for (at, [nearest, farthest]) in sides.iter().enumerate() {
            let (thresholds, open) = margin::possible_of_sides(nearest, farthest);
            possible[at] = PossibleThresholds { tie: possible[at].tie, ..thresholds };
            let ends = [thresholds.nearest, thresholds.farthest];
            let open_end = ends.iter().any(Threshold::ends_sheet) && ends[0].depth != ends[1].depth;
            sums[at].marginal |= open || open_end;
        }
    }
}
