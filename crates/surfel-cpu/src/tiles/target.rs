//! Targets of drawing: the frame's planes, divided into parts that threads own, in safe Rust.
//!
//! A *block* is 4×4 pixels ([`BLOCK`]). A *tile* is a square of blocks ([`Grid`](crate::tiles::grid::Grid)).

use crate::scene::numbers::SplatNumbers;
use crate::simd::compress::ones;
use crate::simd::lanes::{LANES, Lanes};
use crate::tiles::encode;
use crate::tiles::grid::{BLOCK, Grid, Rect, block_px};
use fearless_simd::Simd;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use surfel_math::Real;
use surfel_math::srgb::encode_rgba8;
use surfel_render::{PlanesMut, Region};

/// The values of a block's pixels in all planes, one lane per pixel.
pub(crate) struct Pixels<S: Simd> {
    /// Colour, linear and premultiplied.
    pub color: [Lanes<S>; 4],
    pub depth: Lanes<S>,
    pub normal: [Lanes<S>; 3],
    pub weight: Lanes<S>,
    pub fragments: Lanes<S>,
}

/// The part of a plane inside a rectangle, as one slice per row, which one thread owns.
pub(crate) struct Rows<'a, T> {
    pub rect: Rect,
    rows: Vec<&'a mut [T]>,
}

impl<T: Copy> Rows<'_, T> {
    /// Writes four pixels of a row, from (x, y) on, as far as they are inside the rectangle.
    #[inline(always)]
    pub(crate) fn put(&mut self, (x, y): (i32, i32), values: [T; 4]) {
        let row = y - self.rect.y;
        if row < 0 {
            return;
        }
        let Some(row) = self.rows.get_mut(row as usize) else { return };
        let at = x - self.rect.x;
        if at >= 0
            && let Some(four) = row.get_mut(at as usize..at as usize + 4)
        {
            four.copy_from_slice(&values);
            return;
        }
        for (i, value) in values.into_iter().enumerate() {
            let at = at + i as i32;
            if at >= 0
                && let Some(pixel) = row.get_mut(at as usize)
            {
                *pixel = value;
            }
        }
    }

    /// Writes those pixels of a block that are inside the rectangle. (x, y) is the block's first pixel.
    #[inline(always)]
    fn put_block(&mut self, (x, y): (i32, i32), values: [T; LANES]) {
        for (y, four) in (y..).zip(values.as_chunks().0) {
            self.put((x, y), *four);
        }
    }

    /// Writes one value to the pixels of a tile's blocks whose bits are set, as far as they are inside the rectangle.
    /// The tile begins at pixel `origin`.
    fn put_all(&mut self, origin: (i32, i32), blocks: u64, value: T) {
        for block in ones(if self.rows.is_empty() { 0 } else { blocks }) {
            let (x, y) = block_px(origin, block as u32);
            (0..BLOCK as i32).for_each(|j| self.put((x, y + j), [value; 4]));
        }
    }

    /// Returns the pixels inside the rectangle `tile` among the `length` pixels of a row from (x, y) on. The returned
    /// number counts the pixels of the row to the left of `tile`. Returns 0 and no pixels if none is inside.
    fn run(&mut self, tile: &Rect, (x, y): (i32, i32), length: usize) -> (usize, &mut [T]) {
        let (start, end) = (x.max(tile.x), (x + length as i32).min(tile.end_x));
        let row = usize::try_from(y - self.rect.y).ok().and_then(|row| self.rows.get_mut(row));
        let Some(row) = row.filter(|_| start < end && (tile.y..tile.end_y).contains(&y)) else { return (0, &mut []) };
        let [first, last] = [start, end].map(|x| (x - self.rect.x) as usize);
        ((start - x) as usize, row.get_mut(first..last).unwrap_or_default())
    }

    /// Returns the value of a pixel; `None` if it is outside the rectangle.
    fn get(&self, x: i32, y: i32) -> Option<T> {
        let (column, row) = (usize::try_from(x - self.rect.x).ok()?, usize::try_from(y - self.rect.y).ok()?);
        self.rows.get(row)?.get(column).copied()
    }

    /// Returns the values of a block's pixels; `outside` for pixels outside the rectangle.
    fn block(&self, (x, y): (i32, i32), outside: T) -> [T; LANES] {
        let mut values = [outside; LANES];
        for (j, four) in (0..).zip(values.chunks_exact_mut(4)) {
            let row = usize::try_from(y + j - self.rect.y).ok().and_then(|row| self.rows.get(row));
            let column = usize::try_from(x - self.rect.x).ok();
            if let Some(pixels) = row.zip(column).and_then(|(row, at)| row.get(at..at + 4)) {
                four.copy_from_slice(pixels);
                continue;
            }
            for (i, value) in (0..).zip(four) {
                *value = self.get(x + i, y + j).unwrap_or(outside);
            }
        }
        values
    }

    /// Writes one value to all pixels of `rect`, which must be inside this part's rectangle.
    fn fill(&mut self, rect: &Rect, value: T) {
        let range = |from: i32, to: i32, first: i32| (from - first) as usize..(to - first) as usize;
        for row in self.rows.get_mut(range(rect.y, rect.end_y, self.rect.y)).unwrap_or_default() {
            row[range(rect.x, rect.end_x, self.rect.x)].fill(value);
        }
    }
}

impl Rows<'_, f32> {
    /// Writes those pixels of a block that are inside the rectangle, if the frame has the plane.
    #[inline(always)]
    pub(crate) fn put_lanes<S: Simd>(&mut self, at: (i32, i32), values: Lanes<S>) {
        if !self.rows.is_empty() {
            self.put_block(at, values.to_array());
        }
    }
}

/// Divides a plane of `region` into `parts`, which partition the region. An empty plane yields parts without rows.
pub(crate) fn cut<'a, T>(plane: &'a mut [T], region: Region, parts: &[Region]) -> Vec<Rows<'a, T>> {
    let height = |part: &Region| if plane.is_empty() { 0 } else { part.height as usize };
    let mut cut: Vec<Rows<'a, T>> =
        parts.iter().map(|part| Rows { rect: Rect::of(*part), rows: Vec::with_capacity(height(part)) }).collect();
    let changes: BTreeSet<u32> = parts.iter().flat_map(|part| [part.y, part.y + part.height]).collect();
    let mut left_to_right: Vec<usize> = (0..parts.len()).collect();
    left_to_right.sort_by_key(|&i| parts[i].x);
    let mut here = Vec::new();
    for (y, mut row) in (region.y..).zip(plane.chunks_mut(region.width.max(1) as usize)) {
        if changes.contains(&y) {
            let has_row = |i: &usize| (parts[*i].y..parts[*i].y + parts[*i].height).contains(&y);
            here = left_to_right.iter().copied().filter(has_row).collect();
        }
        for &i in &here {
            let (own, rest) = row.split_at_mut(row.len().min(parts[i].width as usize));
            cut[i].rows.push(own);
            row = rest;
        }
    }
    cut
}

/// Flags of an image's tiles, true where the frame contains only the background already.
#[derive(Clone, Copy)]
pub(crate) struct TileBackground<'a> {
    pub grid: &'a Grid,
    pub tiles: &'a [AtomicBool],
}

impl TileBackground<'_> {
    /// Returns the flag of the tile that contains these pixels; `None` for an empty rectangle.
    fn tile(&self, rect: &Rect) -> Option<&AtomicBool> {
        if rect.is_empty() { None } else { self.tiles.get(self.grid.tile_of(rect.x, rect.y)) }
    }
}

/// The part of a frame's planes that one thread draws, and the tile that it is drawing.
pub(crate) struct Target<'a> {
    /// Index of the current tile in its grid.
    pub tile: usize,
    /// Pixels of the current tile that are inside this part of the frame.
    pub rect: Rect,
    background: TileBackground<'a>,
    /// True if colours are encoded to 8 bits when they are written. Otherwise [`Self::encode`] encodes them after the
    /// last change.
    encodes: bool,
    /// True if the frame contains only the background in the current tile.
    is_background: bool,
    color: Rows<'a, [f32; 4]>,
    rgba8: Rows<'a, [u8; 4]>,
    depth: Rows<'a, f32>,
    normal: Rows<'a, [f32; 3]>,
    weight: Rows<'a, f32>,
    fragments: Rows<'a, u32>,
    index: Rows<'a, u32>,
}

impl<'a> Target<'a> {
    /// Divides a frame's planes into targets, one for each of the `parts` that partition the region.
    pub(crate) fn cut(
        planes: PlanesMut<'a>,
        region: Region,
        parts: &[Region],
        background: TileBackground<'a>,
        encodes: bool,
    ) -> Vec<Self> {
        let mut color = cut(planes.color, region, parts).into_iter();
        let mut rgba8 = cut(planes.rgba8, region, parts).into_iter();
        let mut depth = cut(planes.depth, region, parts).into_iter();
        let mut normal = cut(planes.normal, region, parts).into_iter();
        let mut weight = cut(planes.weight, region, parts).into_iter();
        let mut fragments = cut(planes.fragments, region, parts).into_iter();
        let mut index = cut(planes.index, region, parts).into_iter();
        let target = |part: &Region| {
            Some(Self {
                tile: 0,
                rect: Rect::of(*part),
                background,
                encodes,
                is_background: false,
                color: color.next()?,
                rgba8: rgba8.next()?,
                depth: depth.next()?,
                normal: normal.next()?,
                weight: weight.next()?,
                fragments: fragments.next()?,
                index: index.next()?,
            })
        };
        parts.iter().filter_map(target).collect()
    }

    /// Makes a tile of a grid the current one.
    pub(crate) fn select_tile(&mut self, grid: &Grid, tile: usize) {
        (self.tile, self.rect) = (tile, Rect::of_tile(grid, tile, grid.region).common(&self.color.rect));
        self.is_background = self.background.tile(&self.rect).is_some_and(|tile| tile.load(Ordering::Relaxed));
    }

    /// Sets the flag whether the current tile contains only the background.
    #[inline(always)]
    fn set_background(&mut self, is_background: bool) {
        if self.is_background != is_background {
            self.is_background = is_background;
            if let Some(tile) = self.background.tile(&self.rect) {
                tile.store(is_background, Ordering::Relaxed);
            }
        }
    }

    /// True if the frame has the plane that counts fragments per pixel.
    pub(crate) fn has_fragments(&self) -> bool {
        !self.fragments.rows.is_empty()
    }

    /// Fills the current tile with the values of empty pixels, unless it has them already.
    pub(crate) fn fill_empty(&mut self, background: [f32; 4]) {
        if self.rect.is_empty() || self.is_background {
            return;
        }
        self.set_background(true);
        let rect = &self.rect;
        self.color.fill(rect, background);
        self.rgba8.fill(rect, encode_rgba8(background));
        self.depth.fill(rect, f32::INFINITY);
        self.normal.fill(rect, [0.0; 3]);
        self.weight.fill(rect, 0.0);
        self.fragments.fill(rect, 0);
        self.index.fill(rect, SplatNumbers::NOTHING);
    }

    /// Fills a tile's blocks whose bits are set with the values of empty pixels. The tile begins at pixel `origin`.
    pub(crate) fn put_empty(&mut self, origin: (i32, i32), blocks: u64, background: [f32; 4]) {
        self.set_background(false);
        self.color.put_all(origin, blocks, background);
        if !self.rgba8.rows.is_empty() {
            self.rgba8.put_all(origin, blocks, encode_rgba8(background));
        }
        self.depth.put_all(origin, blocks, f32::INFINITY);
        self.normal.put_all(origin, blocks, [0.0; 3]);
        self.weight.put_all(origin, blocks, 0.0);
        self.fragments.put_all(origin, blocks, 0);
        self.index.put_all(origin, blocks, SplatNumbers::NOTHING);
    }

    /// Returns a block's pixels as they were written; 0 for pixels outside this part of the frame.
    pub(crate) fn get<S: Simd>(&self, simd: S, at: (i32, i32)) -> Pixels<S> {
        let normal = self.normal.block(at, [0.0; 3]);
        let lanes = |value: &dyn Fn(usize) -> f32| Lanes::load(simd, &std::array::from_fn::<f32, LANES, _>(value));
        let fragments = self.fragments.block(at, 0);
        Pixels {
            color: self.color(simd, at),
            depth: Lanes::load(simd, &self.depth.block(at, 0.0)),
            normal: [0, 1, 2].map(|c| lanes(&|i| normal[i][c])),
            weight: Lanes::load(simd, &self.weight.block(at, 0.0)),
            fragments: lanes(&|i| fragments[i] as f32),
        }
    }

    /// Returns a block's colours as they were written; 0 for pixels outside this part of the frame.
    #[inline(always)]
    pub(crate) fn color<S: Simd>(&self, simd: S, at: (i32, i32)) -> [Lanes<S>; 4] {
        let pixels = self.color.block(at, [0.0; 4]);
        let mut rows = [Lanes::splat(simd, 0.0); 4];
        for (row, numbers) in rows.iter_mut().zip(pixels.as_flattened().chunks_exact(LANES)) {
            *row = Lanes::load(simd, numbers);
        }
        // Interleaving rotates six bits of an index by two, so interleaving three times in all restores the order.
        Lanes::interleave4(Lanes::interleave4(rows))
    }

    /// Writes the colour of one pixel, if it is inside the current tile.
    pub(crate) fn put_one(&mut self, pixel: (i32, i32), color: [f32; 4]) {
        self.set_background(false);
        if let (_, [to]) = self.color.run(&self.rect, pixel, 1) {
            *to = color;
        }
    }

    /// Writes the colours of the block with this first pixel.
    #[inline(always)]
    pub(crate) fn put_color<S: Simd>(&mut self, (x, y): (i32, i32), color: [Lanes<S>; 4]) {
        self.set_background(false);
        if self.encodes && !self.rgba8.rows.is_empty() {
            self.rgba8.put_block((x, y), encode::rgba8(color));
        }
        if self.color.rows.is_empty() {
            return;
        }
        for (y, row) in (y..).zip(Lanes::interleave4(color)) {
            if let Some(four) = row.to_array().as_chunks().0.first_chunk() {
                self.color.put((x, y), *four);
            }
        }
    }

    /// Encodes the current tile's colours to 8 bits, unless they were encoded when they were written. This is for tiles
    /// that screen-space passes change.
    pub(crate) fn encode<S: Simd>(&mut self, simd: S) {
        let Rect { x, y, end_x, end_y } = self.rect;
        if self.encodes || self.is_background || self.rgba8.rows.is_empty() {
            return;
        }
        for at in (y..end_y).step_by(4).flat_map(|y| (x..end_x).step_by(4).map(move |x| (x, y))) {
            self.rgba8.put_block(at, encode::rgba8(self.color(simd, at)));
        }
    }

    /// Multiplies the colours, but not the alpha, of sixteen pixels of a row by `by`, as far as they are inside the
    /// current tile.
    #[inline(always)]
    pub(crate) fn dim<S: Simd>(&mut self, simd: S, at: (i32, i32), by: Lanes<S>) {
        self.set_background(false);
        let (before, pixels) = self.color.run(&self.rect, at, LANES);
        if before == 0 && pixels.len() == LANES {
            let factors = Lanes::interleave4([by, by, by, by.one()]);
            for (four, factor) in pixels.as_flattened_mut().chunks_exact_mut(LANES).zip(factors) {
                (Lanes::load(simd, four) * factor).store(four);
            }
            return;
        }
        for (pixel, factor) in pixels.iter_mut().zip(&by.to_array()[before.min(LANES)..]) {
            pixel[..3].iter_mut().for_each(|c| *c *= factor);
        }
    }

    /// Makes pixels of a block black without changing their alpha: those whose bits, row by row, are set in `bits`. (x,
    /// y) is the block's first pixel.
    pub(crate) fn blacken(&mut self, (x, y): (i32, i32), bits: u16) {
        self.set_background(false);
        for i in ones(bits.into()).map(|i| i as i32) {
            if let (_, [pixel]) = self.color.run(&self.rect, (x + i % 4, y + i / 4), 1) {
                pixel[..3].fill(0.0);
            }
        }
    }

    /// Writes the numbers of the nearest splats or polygons in a block's pixels.
    pub(crate) fn put_index(&mut self, at: (i32, i32), numbers: [u32; LANES]) {
        self.set_background(false);
        self.index.put_block(at, numbers);
    }

    /// Returns the numbers of the nearest splats or polygons in a block's pixels, as they were written;
    /// [`SplatNumbers::NOTHING`] for pixels outside this part of the frame.
    pub(crate) fn index(&self, at: (i32, i32)) -> [u32; LANES] {
        self.index.block(at, SplatNumbers::NOTHING)
    }

    /// Writes the pixels of the block with this first pixel to all planes.
    #[inline(always)]
    pub(crate) fn put<S: Simd>(&mut self, at: (i32, i32), pixels: &Pixels<S>) {
        self.set_background(false);
        self.put_color(at, pixels.color);
        self.depth.put_lanes(at, pixels.depth);
        self.weight.put_lanes(at, pixels.weight);
        if !self.normal.rows.is_empty() {
            let [x, y, z] = pixels.normal.map(Lanes::to_array);
            self.normal.put_block(at, std::array::from_fn(|i| [x[i], y[i], z[i]]));
        }
        if !self.fragments.rows.is_empty() {
            self.fragments.put_block(at, pixels.fragments.to_array().map(|count| count as u32));
        }
    }
}
