//! A tile of 16×16 pixels, which blends its Gaussians front to back. SIMD lanes are the pixels of a block of 4×4 pixels
//! rather than a row of the tile, because a small Gaussian touches fewer blocks than rows.
//!
//! A *record* is a projected Gaussian ([`Record`]).

use crate::gaussians::grid::{TILE_PX, TileGrid};
use crate::gaussians::pending::{Pending, key};
use crate::gaussians::records::Record;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::Bits;
use fearless_simd::Simd;
use std::ops::Range;
use surfel_math::gaussian::{
    self, GaussianForms, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, MIN_WEIGHT, distortion_depth,
};
use surfel_math::{Real, V2};
use surfel_render::{Frame, Planes, Region};

/// Side of a block in pixels, and of a tile in blocks.
const SIDE: usize = 4;
/// Number of blocks of 4×4 pixels in a tile.
pub(super) const BLOCKS: usize = SIDE * SIDE;
const _: () = assert!(TILE_PX as usize == SIDE * SIDE);

/// Inputs for drawing the tiles of a frame, shared by all tiles.
pub(super) struct TileInputs<'a> {
    pub grid: &'a TileGrid,
    pub near: f32,
    /// The background behind the Gaussians, in the form that [`gaussian::background`] returns.
    pub background: [f64; 4],
    pub linear: bool,
    pub planes: Planes,
}

/// Number of records that a tile fetches from memory together. The records are scattered in memory, so that fetching
/// them one by one would wait each time.
const TOGETHER: usize = 32;

/// One number for each pixel of a block of 4×4 pixels.
pub(super) type Block = [f32; LANES];
/// One number for each pixel of a tile, block by block.
type Blocks = [Block; BLOCKS];

/// Weighted sums per pixel for the planes besides the colour.
#[derive(Default)]
struct Sums {
    /// Sum of weights, Σw: more precise than 1 − transmittance where the sum is small.
    weight: Blocks,
    normal: [Blocks; 3],
    depth: Blocks,
    median_depth: Blocks,
    distortion: Blocks,
    /// Sums Σw·m and Σw·m², where m is the depth that the plane `distortion` compares ([`distortion_depth`]).
    moments: [Blocks; 2],
    fragments: Blocks,
}

/// One fragment for each pixel of a block, to be blended.
struct Fragments<S: Simd> {
    alpha: Lanes<S>,
    z: Lanes<S>,
    color: [Lanes<S>; 3],
    normal: [Lanes<S>; 3],
}

/// The pixels of a tile, into which its Gaussians are blended.
pub(super) struct Tile {
    /// Fraction of the light from behind that each pixel still lets through.
    transmittance: Blocks,
    /// Weighted sums of the Gaussians' colours, in their own colour space.
    color: [Blocks; 3],
    /// 1 for each pixel that isn't opaque yet, so that further Gaussians are blended into it; else 0.
    open: Blocks,
    /// Number of blocks that have a pixel in which `open` is 1. Blending ends when it is 0.
    open_blocks: u32,
    sums: Option<Box<Sums>>,
    /// Number of pairs of a pixel and a Gaussian that were tested, for statistics.
    pub tested: u64,
    resolved: Vec<[f32; 4]>,
}

impl Tile {
    /// Blends a tile's records front to back. If `pending` is given, each pixel's fragments are sorted by depth first.
    #[inline(always)]
    pub(super) fn draw<'a, S: Simd>(
        simd: S,
        inputs: &TileInputs<'_>,
        records: impl Iterator<Item = &'a Record>,
        tile: usize,
        mut pending: Option<&mut Pending<'a>>,
    ) -> Self {
        let pixels = inputs.grid.pixels(tile);
        let mut drawn = Self::empty(pixels, inputs.planes);
        if let Some(pending) = &mut pending {
            pending.clear();
        }
        match drawn.sums.take() {
            None => drawn.blend::<S, false>(simd, inputs, records, pixels, &mut Sums::default(), pending),
            Some(mut sums) => {
                drawn.blend::<S, true>(simd, inputs, records, pixels, &mut sums, pending);
                drawn.sums = Some(sums);
            }
        }
        if inputs.planes.color {
            drawn.resolve(inputs);
        }
        drawn
    }

    fn empty(pixels: Region, planes: Planes) -> Self {
        let mut open = [[0.0; LANES]; BLOCKS];
        for (x, y) in (0..pixels.height as usize).flat_map(|y| (0..pixels.width as usize).map(move |x| (x, y))) {
            let (block, lane) = place(x, y);
            open[block][lane] = 1.0;
        }
        let Planes { depth, normal, median_depth, distortion, fragments, .. } = planes;
        Self {
            transmittance: [[1.0; LANES]; BLOCKS],
            color: [[[0.0; LANES]; BLOCKS]; 3],
            open,
            open_blocks: open.iter().filter(|block| block.contains(&1.0)).count() as u32,
            sums: (depth || normal || median_depth || distortion || fragments).then(Box::default),
            tested: 0,
            resolved: Vec::new(),
        }
    }

    #[inline(always)]
    fn blend<'a, S: Simd, const SUMS: bool>(
        &mut self,
        simd: S,
        inputs: &TileInputs<'_>,
        records: impl Iterator<Item = &'a Record>,
        pixels: Region,
        sums: &mut Sums,
        mut pending: Option<&mut Pending<'a>>,
    ) {
        let (columns, lines) = Lanes::block_pixels(simd, (0, 0));
        let (mut records, mut batch) = (records, Vec::with_capacity(TOGETHER));
        loop {
            batch.clear();
            batch.extend(records.by_ref().take(TOGETHER).map(|record| (record, record.clone())));
            if batch.is_empty() {
                break;
            }
            for (stored, record) in &batch {
                let forms = forms(simd, record);
                let [rows, blocks] = [
                    blocks(&record.rows, [pixels.y, pixels.height]),
                    blocks(&record.columns, [pixels.x, pixels.width]),
                ];
                self.tested += (rows.len() * blocks.len() * LANES) as u64;
                for (by, bx) in rows.flat_map(|by| blocks.clone().map(move |bx| (by, bx))) {
                    let block = by * SIDE + bx;
                    let open = Lanes::load(simd, &self.open[block]);
                    // Exact in whole numbers: only the fraction rounds.
                    let offset = |pixels: Lanes<S>, start: u32, at: usize, axis: usize| {
                        let first = (start as i32 + (at * SIDE) as i32 - record.base[axis]) as f32;
                        (pixels + Lanes::splat(simd, first)) - Lanes::splat(simd, record.fraction[axis] - 0.5)
                    };
                    let d = V2::new(offset(columns, pixels.x, bx, 0), offset(lines, pixels.y, by, 1));
                    let (rho, z) = forms.at(d);
                    // `exp2` is defined for x ≥ −126; below, a Gaussian is invisible anyway.
                    let power = (rho * rho.constant(-0.5 * std::f64::consts::LOG2_E)).max(rho.constant(-126.0));
                    let alpha = (Lanes::splat(simd, record.opacity) * power.exp2()).min(rho.constant(MAX_ALPHA));
                    let shows = alpha.constant(MIN_ALPHA).le(alpha)
                        & Lanes::splat(simd, inputs.near).le(z)
                        & z.lt(z.constant(1e30))
                        & open.zero().lt(open);
                    let bits = shows.bits();
                    if bits == 0 {
                        continue;
                    }
                    let alpha = alpha * Lanes::splat(simd, record.weight);
                    match &mut pending {
                        None => {
                            let [color, normal] =
                                [record.color, record.normal].map(|v| v.map(|c| Lanes::splat(simd, c)));
                            self.blend_block::<S, SUMS>(block, &Fragments { alpha, z, color, normal }, shows, sums);
                        }
                        Some(pending) => {
                            if pending.add(block, bits, &alpha.to_array(), &z.to_array(), stored) {
                                self.blend_pending::<S, SUMS>(simd, block, key(record.nearest, 0), pending, sums);
                            }
                        }
                    }
                    if self.open_blocks == 0 {
                        return;
                    }
                }
            }
        }
        if let Some(pending) = pending {
            for block in 0..BLOCKS {
                self.blend_pending::<S, SUMS>(simd, block, u64::MAX, pending, sums);
            }
        }
    }

    /// Blends one fragment in each pixel of a block behind those blended before. Only the lanes of `shows` have a
    /// fragment.
    #[inline(always)]
    fn blend_block<S: Simd, const SUMS: bool>(
        &mut self,
        block: usize,
        fragments: &Fragments<S>,
        shows: <Lanes<S> as Real>::Mask,
        sums: &mut Sums,
    ) {
        let Fragments { alpha, color, .. } = *fragments;
        let simd = alpha.0.simd;
        let before = Lanes::load(simd, &self.transmittance[block]);
        let left = before * (alpha.one() - alpha);
        let ends = shows & left.lt(left.constant(MIN_TRANSMITTANCE));
        let drawn = shows & !ends;
        let weight = Lanes::select(drawn, alpha * before, alpha.zero());
        for (sum, c) in self.color.iter_mut().zip(color) {
            add(simd, &mut sum[block], weight, c);
        }
        if SUMS {
            sums.add(block, fragments, (weight, before), drawn);
        }
        Lanes::select(drawn, left, before).store(&mut self.transmittance[block]);
        if ends.bits() != 0 {
            let still = Lanes::select(ends, alpha.zero(), Lanes::load(simd, &self.open[block]));
            still.store(&mut self.open[block]);
            self.open_blocks -= u32::from(still.zero().lt(still).bits() == 0);
        }
    }

    /// Blends the waiting fragments of a block whose sort keys are less than `limit`.
    #[inline(always)]
    fn blend_pending<S: Simd, const SUMS: bool>(
        &mut self,
        simd: S,
        block: usize,
        limit: u64,
        pending: &mut Pending<'_>,
        sums: &mut Sums,
    ) {
        let ready = pending.sort(block, limit, &self.transmittance[block]);
        let of_block = &mut pending.fragments[block * LANES..(block + 1) * LANES];
        for k in 0..ready.into_iter().max().unwrap_or(0) {
            // A filter may reduce the α of a visible fragment to 0, so lanes without a fragment get −1.
            let (mut alpha, mut z) = ([-1.0; LANES], [1.0; LANES]);
            let (mut color, mut normal) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
            for (lane, fragments) in of_block.iter().enumerate() {
                if let Some(fragment) = fragments[..ready[lane]].get(k) {
                    (alpha[lane], z[lane]) = (fragment.alpha, fragment.z);
                    for c in 0..3 {
                        color[c][lane] = fragment.record.color[c];
                        if SUMS {
                            normal[c][lane] = fragment.record.normal[c];
                        }
                    }
                }
            }
            let lanes = |v: Block| Lanes::load(simd, &v);
            let open = lanes(self.open[block]);
            let alpha = lanes(alpha);
            let shows = alpha.zero().le(alpha) & open.zero().lt(open);
            let fragments = Fragments { alpha, z: lanes(z), color: color.map(lanes), normal: normal.map(lanes) };
            self.blend_block::<S, SUMS>(block, &fragments, shows, sums);
        }
        of_block.iter_mut().zip(ready).for_each(|(fragments, ready)| drop(fragments.drain(..ready)));
    }

    /// Converts the tile's sums of colours to the image's colours, over the background.
    fn resolve(&mut self, inputs: &TileInputs<'_>) {
        self.resolved = (0..BLOCKS * LANES)
            .map(|at| {
                let (block, lane) = (at / LANES, at % LANES);
                let color = self.color.each_ref().map(|blocks| f64::from(blocks[block][lane]));
                let left = f64::from(self.transmittance[block][lane]);
                gaussian::resolve(color, left, inputs.background, inputs.linear).map(|c| c as f32)
            })
            .collect();
    }

    /// Returns the number of fragments blended in the tile's pixels; 0 if fragments aren't counted.
    pub(super) fn fragments(&self) -> u64 {
        let counted = self.sums.iter().flat_map(|sums| sums.fragments.as_flattened());
        counted.map(|n| *n as u64).sum()
    }

    /// Writes the blended pixels of the tile to the frame's planes.
    pub(super) fn write(&self, grid: &TileGrid, tile: usize, frame: &mut Frame) {
        let pixels = grid.pixels(tile);
        let planes = frame.planes_mut();
        let width = grid.region.width as usize;
        for y in 0..pixels.height as usize {
            let first = (pixels.y - grid.region.y) as usize * width + y * width + (pixels.x - grid.region.x) as usize;
            let row = first..first + pixels.width as usize;
            let of = |blocks: &Blocks, x: usize| {
                let (block, lane) = place(x, y);
                blocks[block][lane]
            };
            fill(planes.color, &row, |x| {
                let (block, lane) = place(x, y);
                self.resolved[block * LANES + lane]
            });
            for plane in [&mut *planes.weight, &mut *planes.alpha] {
                fill(plane, &row, |x| 1.0 - of(&self.transmittance, x));
            }
            let Some(sums) = &self.sums else { continue };
            let is_there = |x: usize| of(&sums.weight, x) > MIN_WEIGHT as f32;
            let there = |x: usize, value: f32| if is_there(x) { value } else { f32::INFINITY };
            fill(planes.depth, &row, |x| there(x, of(&sums.depth, x) / of(&sums.weight, x)));
            fill(planes.median_depth, &row, |x| there(x, of(&sums.median_depth, x)));
            fill(planes.distortion, &row, |x| of(&sums.distortion, x));
            fill(planes.normal, &row, |x| sums.normal.each_ref().map(|blocks| of(blocks, x)));
            fill(planes.fragments, &row, |x| of(&sums.fragments, x) as u32);
        }
    }
}

/// Returns the block of a tile's pixel, and the pixel's lane in the block.
fn place(x: usize, y: usize) -> (usize, usize) {
    (y / SIDE * SIDE + x / SIDE, y % SIDE * SIDE + x % SIDE)
}

/// Returns the columns (or rows) of blocks that contain some of these pixels, in a tile whose `length` pixels begin at
/// `start`.
fn blocks(pixels: &Range<u32>, [start, length]: [u32; 2]) -> Range<usize> {
    let [first, end] = [pixels.start, pixels.end].map(|at| at.clamp(start, start + length) - start);
    first as usize / SIDE..if first < end { (end as usize).div_ceil(SIDE) } else { first as usize / SIDE }
}

fn fill<T>(plane: &mut [T], row: &Range<usize>, value: impl Fn(usize) -> T) {
    if let Some(pixels) = plane.get_mut(row.clone()) {
        pixels.iter_mut().enumerate().for_each(|(x, pixel)| *pixel = value(x));
    }
}

impl Sums {
    #[inline(always)]
    fn add<S: Simd>(
        &mut self,
        block: usize,
        fragments: &Fragments<S>,
        (weight, before): (Lanes<S>, Lanes<S>),
        drawn: <Lanes<S> as Real>::Mask,
    ) {
        let z = fragments.z;
        let simd = z.0.simd;
        for (sum, n) in self.normal.iter_mut().zip(fragments.normal) {
            add(simd, &mut sum[block], weight, n);
        }
        // The depth may be NaN or infinite where nothing is drawn.
        let z = Lanes::select(drawn, z, z.one());
        add(simd, &mut self.weight[block], weight, weight.one());
        add(simd, &mut self.depth[block], weight, z);
        let median = Lanes::load(simd, &self.median_depth[block]);
        Lanes::select(drawn & z.constant(0.5).lt(before), z, median).store(&mut self.median_depth[block]);
        let m = distortion_depth(z);
        let [first, second] = self.moments.each_ref().map(|blocks| Lanes::load(simd, &blocks[block]));
        let spread = (m * m).mul_add(z.one() - before, second) - z.constant(2.0) * m * first;
        add(simd, &mut self.distortion[block], weight, spread);
        let [first, second] = &mut self.moments;
        add(simd, &mut first[block], weight, m);
        add(simd, &mut second[block], weight, m * m);
        let one = Lanes::select(drawn, z.one(), z.zero());
        add(simd, &mut self.fragments[block], one, one);
    }
}

/// Adds `weight`·`value` to a block of sums, pixel by pixel.
#[inline(always)]
fn add<S: Simd>(simd: S, sums: &mut Block, weight: Lanes<S>, value: Lanes<S>) {
    weight.mul_add(value, Lanes::load(simd, sums)).store(sums);
}

/// Returns a record's linear forms, each number in every lane.
#[inline(always)]
fn forms<S: Simd>(simd: S, record: &Record) -> GaussianForms<Lanes<S>> {
    let GaussianForms { u, v, w, z, low_pass } = record.forms;
    let [u0, u1, v0, v1] = [u[0], u[1], v[0], v[1]].map(|c| Lanes::splat(simd, c));
    let [w0, w1, w2] = w.map(|c| Lanes::splat(simd, c));
    let [z0, z1, z2] = z.map(|c| Lanes::splat(simd, c));
    GaussianForms { u: [u0, u1], v: [v0, v1], w: [w0, w1, w2], z: [z0, z1, z2], low_pass: Lanes::splat(simd, low_pass) }
}
