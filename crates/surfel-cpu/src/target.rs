//! Where tiles write: planes cut into tiles that threads own, in safe Rust.

use crate::bins::{BLOCK, Grid};
use crate::lanes::{LANES, Lanes};
use crate::shade::Pixels;
use crate::tile::block_px;
use fearless_simd::prelude::*;
use fearless_simd::{Simd, i32x16, mask32x16};
use surfel_math::Real;
use surfel_render::{Frame, Region};

/// Pixels of an image: first column and row, end column and row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rect {
    pub x: i32,
    pub y: i32,
    pub end_x: i32,
    pub end_y: i32,
}

impl Rect {
    pub(crate) fn of(region: Region) -> Self {
        let [x, y, w, h] = [region.x, region.y, region.width, region.height].map(|v| v as i32);
        Self { x, y, end_x: x + w, end_y: y + h }
    }

    /// The part of a tile inside `region`; may be empty.
    pub(crate) fn of_tile(grid: &Grid, tile: usize, region: Region) -> Self {
        let size = grid.tile_px();
        let column = tile as u32 % grid.columns;
        let row = tile as u32 / grid.columns;
        let [x, y] = [grid.origin[0] + column * size, grid.origin[1] + row * size].map(|v| v as i32);
        let whole = Self { x, y, end_x: x + size as i32, end_y: y + size as i32 };
        let r = Self::of(region);
        Self {
            x: whole.x.max(r.x),
            y: whole.y.max(r.y),
            end_x: whole.end_x.min(r.end_x),
            end_y: whole.end_y.min(r.end_y),
        }
    }

    /// The smallest rectangle that holds both.
    pub(crate) fn with(&self, o: &Self) -> Self {
        Self { x: self.x.min(o.x), y: self.y.min(o.y), end_x: self.end_x.max(o.end_x), end_y: self.end_y.max(o.end_y) }
    }

    /// True for a pixel inside.
    pub(crate) fn has(&self, x: i32, y: i32) -> bool {
        (self.x..self.end_x).contains(&x) && (self.y..self.end_y).contains(&y)
    }

    /// Which pixels lie inside.
    #[inline(always)]
    pub(crate) fn holds<S: Simd>(&self, (x, y): (Lanes<S>, Lanes<S>)) -> mask32x16<S> {
        let k = |v: i32| f64::from(v);
        let column = x.constant(k(self.x)).le(x) & x.lt(x.constant(k(self.end_x)));
        column & y.constant(k(self.y)).le(y) & y.lt(y.constant(k(self.end_y)))
    }

    /// 1 for a block's pixels inside the rectangle, else 0.
    #[inline(always)]
    pub(crate) fn lanes_inside<S: Simd>(&self, simd: S, (x, y): (i32, i32)) -> i32x16<S> {
        if self.x <= x && x + 4 <= self.end_x && self.y <= y && y + 4 <= self.end_y {
            return i32x16::splat(simd, 1);
        }
        let bits = self.lanes_of_block((x, y));
        let mut inside = [0; LANES];
        for (i, lane) in inside.iter_mut().enumerate() {
            *lane = (bits >> i & 1) as i32;
        }
        i32x16::load_array(simd, inside)
    }

    /// Bits of a block's pixels inside the rectangle.
    pub(crate) fn lanes_of_block(&self, (x, y): (i32, i32)) -> u64 {
        let row = (0..4).filter(|i| (self.x..self.end_x).contains(&(x + i))).fold(0u64, |bits, i| bits | 1 << i);
        let inside = |j: &i32| (self.y..self.end_y).contains(&(y + j));
        (0..4).filter(inside).fold(0, |bits, j| bits | row << (4 * j))
    }
}

/// The rows of a plane inside a tile.
pub(crate) struct Rows<'a, T> {
    rect: Rect,
    rows: Vec<&'a mut [T]>,
}

impl<T: Copy> Rows<'_, T> {
    /// Writes the part of a block's row that lies inside.
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

    /// Writes one value to the pixels that lie inside of a tile's blocks whose bits are set.
    fn put_all(&mut self, origin: (i32, i32), blocks: u64, value: T) {
        let mut left = if self.rows.is_empty() { 0 } else { blocks };
        while left != 0 {
            let (x, y) = block_px(origin, left.trailing_zeros());
            left &= left - 1;
            (0..BLOCK as i32).for_each(|j| self.put((x, y + j), [value; 4]));
        }
    }

    /// The part of a row that lies inside: of its pixels from a given one on, at most `length`, those from the first inside on, and
    /// how many are left out before.
    fn run(&mut self, (x, y): (i32, i32), length: usize) -> (usize, &mut [T]) {
        let before = (self.rect.x - x).max(0) as usize;
        let row = usize::try_from(y - self.rect.y).ok().and_then(|row| self.rows.get_mut(row));
        let Some(row) = row.filter(|_| before < length) else { return (0, &mut []) };
        let start = (x - self.rect.x).max(0) as usize;
        let end = (start + length - before).min(row.len());
        (before, row.get_mut(start..end).unwrap_or_default())
    }

    /// Value of a pixel inside.
    fn get(&self, x: i32, y: i32) -> Option<T> {
        let (column, row) = (usize::try_from(x - self.rect.x).ok()?, usize::try_from(y - self.rect.y).ok()?);
        self.rows.get(row)?.get(column).copied()
    }

    /// Values of a block's pixels; `outside` where there are none.
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

    fn fill(&mut self, value: T) {
        self.rows.iter_mut().for_each(|row| row.fill(value));
    }
}

/// Cuts a plane of `region`'s pixels, `stride` numbers a row from `first` on, into the grid's tiles. An empty plane gives
/// tiles without rows.
pub(crate) fn cut<'a, T>(
    plane: &'a mut [T],
    grid: &Grid,
    region: Region,
    first: usize,
    stride: usize,
) -> Vec<Rows<'a, T>> {
    let capacity = if plane.is_empty() { 0 } else { grid.tile_px() as usize };
    let tile = |i| Rows { rect: Rect::of_tile(grid, i, region), rows: Vec::with_capacity(capacity) };
    let mut tiles: Vec<Rows<'a, T>> = (0..grid.tiles()).map(tile).collect();
    if plane.is_empty() || region.width == 0 {
        return tiles;
    }
    let width = region.width as usize;
    let rows = plane.get_mut(first..).unwrap_or_default().chunks_mut(stride).take(region.height as usize);
    for (row, mut numbers) in rows.enumerate() {
        numbers = numbers.get_mut(..width).unwrap_or_default();
        let tile_row = (region.y as usize + row) / grid.tile_px() as usize - (grid.origin[1] / grid.tile_px()) as usize;
        for column in 0..grid.columns as usize {
            let tile = &mut tiles[tile_row * grid.columns as usize + column];
            let length = (tile.rect.end_x - tile.rect.x).max(0) as usize;
            let (own, rest) = numbers.split_at_mut(length.min(numbers.len()));
            tile.rows.push(own);
            numbers = rest;
        }
    }
    // Rows of tiles above the region's first are not pushed: the rectangle of a tile starts where its rows start.
    tiles
}

/// The frame's planes inside a tile.
pub(crate) struct TileTarget<'a> {
    pub tile: usize,
    pub rect: Rect,
    pub color: Rows<'a, [f32; 4]>,
    depth: Rows<'a, f32>,
    normal: Rows<'a, [f32; 3]>,
    weight: Rows<'a, f32>,
    fragments: Rows<'a, u32>,
}

impl<'a> TileTarget<'a> {
    /// A tile without pixels.
    pub(crate) fn nowhere(tile: usize) -> Self {
        fn none<'a, T>() -> Rows<'a, T> {
            Rows { rect: Rect { x: 0, y: 0, end_x: 0, end_y: 0 }, rows: Vec::new() }
        }
        let color = none();
        Self { tile, rect: color.rect, color, depth: none(), normal: none(), weight: none(), fragments: none() }
    }

    /// Cuts the planes of `frame`, which holds `frame_region`, into tiles; `region` is the part that the grid draws, whole
    /// rows of the frame.
    pub(crate) fn cut(frame: &'a mut Frame, grid: &Grid, region: Region, frame_region: Region) -> Vec<Self> {
        let stride = frame_region.width as usize;
        let first = (region.y - frame_region.y) as usize * stride;
        let color = cut(&mut frame.color, grid, region, first, stride);
        let depth = cut(&mut frame.depth, grid, region, first, stride);
        let normal = cut(&mut frame.normal, grid, region, first, stride);
        let weight = cut(&mut frame.weight, grid, region, first, stride);
        let fragments = cut(&mut frame.fragments, grid, region, first, stride);
        let geometry = depth.into_iter().zip(normal).zip(weight).zip(fragments);
        let tiles = color.into_iter().zip(geometry).enumerate();
        let tiles = tiles.map(|(tile, (color, (((depth, normal), weight), fragments)))| Self {
            tile,
            rect: color.rect,
            color,
            depth,
            normal,
            weight,
            fragments,
        });
        tiles.collect()
    }

    /// True if fragments are counted pixel by pixel.
    pub(crate) fn has_fragments(&self) -> bool {
        !self.fragments.rows.is_empty()
    }

    /// Fills the whole tile with what is where nothing is.
    pub(crate) fn fill_empty(&mut self, background: [f32; 4]) {
        self.color.fill(background);
        self.depth.fill(f32::INFINITY);
        self.normal.fill([0.0; 3]);
        self.weight.fill(0.0);
        self.fragments.fill(0);
    }

    /// Fills a tile's blocks whose bits are set with what is where nothing is. The tile begins at pixel `origin`.
    pub(crate) fn put_empty(&mut self, origin: (i32, i32), blocks: u64, background: [f32; 4]) {
        self.color.put_all(origin, blocks, background);
        self.depth.put_all(origin, blocks, f32::INFINITY);
        self.normal.put_all(origin, blocks, [0.0; 3]);
        self.weight.put_all(origin, blocks, 0.0);
        self.fragments.put_all(origin, blocks, 0);
    }

    /// A block's pixels as they were written; 0 where there are none.
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

    /// A block's colours as they were written; 0 where there are none.
    #[inline(always)]
    pub(crate) fn color<S: Simd>(&self, simd: S, at: (i32, i32)) -> [Lanes<S>; 4] {
        let pixels = self.color.block(at, [0.0; 4]);
        let mut rows = [Lanes::splat(simd, 0.0); 4];
        for (row, numbers) in rows.iter_mut().zip(pixels.as_flattened().chunks_exact(LANES)) {
            *row = Lanes::load(simd, numbers);
        }
        // Interleaving turns six bits of an index by two: after a third time all is as it was.
        Lanes::interleave4(Lanes::interleave4(rows))
    }

    /// Writes a block's colours.
    #[inline(always)]
    pub(crate) fn put_color<S: Simd>(&mut self, (x, y): (i32, i32), color: [Lanes<S>; 4]) {
        if self.color.rows.is_empty() {
            return;
        }
        for (j, row) in Lanes::interleave4(color).iter().enumerate() {
            let row = row.to_array();
            let (four, _) = row.as_chunks::<4>();
            if let Some(four) = four.first_chunk::<4>() {
                self.color.put((x, y + j as i32), *four);
            }
        }
    }

    /// Multiplies the colours, not the alpha, of sixteen pixels of a row, as far as they lie inside.
    #[inline(always)]
    pub(crate) fn dim<S: Simd>(&mut self, simd: S, at: (i32, i32), by: Lanes<S>) {
        let (before, pixels) = self.color.run(at, LANES);
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

    /// Makes those of a block's pixels black whose bits are set.
    pub(crate) fn blacken(&mut self, (x, y): (i32, i32), bits: u16) {
        for i in (0..LANES as i32).filter(|i| bits >> i & 1 == 1) {
            if let (_, [pixel]) = self.color.run((x + i % 4, y + i / 4), 1) {
                pixel[..3].fill(0.0);
            }
        }
    }

    /// Writes a block's pixels.
    #[inline(always)]
    pub(crate) fn put<S: Simd>(&mut self, (x, y): (i32, i32), pixels: &Pixels<S>) {
        self.put_color((x, y), pixels.color);
        put_plane(&mut self.depth, (x, y), pixels.depth);
        put_plane(&mut self.weight, (x, y), pixels.weight);
        if !self.normal.rows.is_empty() {
            let [nx, ny, nz] = pixels.normal;
            let (nx, ny, nz) = (nx.to_array(), ny.to_array(), nz.to_array());
            for j in 0..4 {
                let mut values = [[0.0; 3]; 4];
                for (i, value) in values.iter_mut().enumerate() {
                    *value = [nx[4 * j + i], ny[4 * j + i], nz[4 * j + i]];
                }
                self.normal.put((x, y + j as i32), values);
            }
        }
        if !self.fragments.rows.is_empty() {
            let counts = pixels.fragments.to_array();
            for j in 0..4 {
                let four = [counts[4 * j], counts[4 * j + 1], counts[4 * j + 2], counts[4 * j + 3]];
                self.fragments.put((x, y + j as i32), four.map(|count| count as u32));
            }
        }
    }
}

/// Writes a block's numbers into a plane.
#[inline(always)]
pub(crate) fn put_plane<S: Simd>(plane: &mut Rows<'_, f32>, (x, y): (i32, i32), values: Lanes<S>) {
    if plane.rows.is_empty() {
        return;
    }
    let values: [f32; LANES] = values.to_array();
    for j in 0..4 {
        plane.put((x, y + j as i32), [values[4 * j], values[4 * j + 1], values[4 * j + 2], values[4 * j + 3]]);
    }
}
