//! A tile of 16×16 pixels: its Gaussians front to back, a row of pixels at a time.

use crate::gaussians::grid::{TILE_PX, TileGrid};
use crate::gaussians::pending::{Pending, key};
use crate::gaussians::records::Record;
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::Bits;
use fearless_simd::Simd;
use surfel_math::gaussian::{
    self, GaussianForms, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, MIN_WEIGHT, distortion_depth,
};
use surfel_math::{Real, V2};
use surfel_render::{Frame, Planes, Region};

pub(super) const SIDE: usize = TILE_PX as usize;

/// What all tiles share.
pub(super) struct TileInputs<'a> {
    pub grid: &'a TileGrid,
    pub near: f32,
    /// As [`gaussian::background`].
    pub background: [f64; 4],
    pub linear: bool,
    pub planes: Planes,
}

pub(super) type Row = [f32; LANES];
type Rows = [Row; SIDE];

/// Sums of planes besides the colour.
#[derive(Default)]
struct Sums {
    /// Σw: more precise than 1 − T where little is there.
    weight: Rows,
    normal: [Rows; 3],
    depth: Rows,
    median_depth: Rows,
    distortion: Rows,
    /// Σw·m and Σw·m², m the depth that the distortion compares.
    moments: [Rows; 2],
    fragments: Rows,
}

/// A Gaussian at each pixel of a row.
struct Fragments<S: Simd> {
    alpha: Lanes<S>,
    z: Lanes<S>,
    color: [Lanes<S>; 3],
    normal: [Lanes<S>; 3],
}

/// A tile's pixels.
pub(super) struct Tile {
    transmittance: Rows,
    /// In the Gaussians' colour space.
    color: [Rows; 3],
    /// 1 where light may be left, else 0.
    open: Rows,
    /// Rows with such pixels.
    open_rows: u32,
    sums: Option<Box<Sums>>,
    /// Pixels that were compared with a Gaussian.
    pub tested: u64,
    resolved: Vec<[f32; 4]>,
}

impl Tile {
    /// Blends a tile's records; with room for pending fragments in the order of each pixel.
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
        let open = |y: usize| {
            std::array::from_fn(|x| f32::from(u8::from((x as u32) < pixels.width && (y as u32) < pixels.height)))
        };
        let Planes { depth, normal, median_depth, distortion, fragments, .. } = planes;
        Self {
            transmittance: [[1.0; LANES]; SIDE],
            color: [[[0.0; LANES]; SIDE]; 3],
            open: std::array::from_fn(open),
            open_rows: pixels.height,
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
        let columns = Lanes::load(simd, &std::array::from_fn::<f32, LANES, _>(|x| x as f32));
        for record in records {
            let rows = record.rows.start.max(pixels.y)..record.rows.end.min(pixels.y + pixels.height);
            // Whole numbers, exact: only the fraction rounds.
            let left = (pixels.x as i32 - record.base[0]) as f32;
            let dx = (columns + Lanes::splat(simd, left)) - Lanes::splat(simd, record.fraction[0] - 0.5);
            let forms = forms(simd, record);
            self.tested += rows.len() as u64 * LANES as u64;
            for y in rows {
                let row = (y - pixels.y) as usize;
                let open = Lanes::load(simd, &self.open[row]);
                let dy = (y as i32 - record.base[1]) as f32 - (record.fraction[1] - 0.5);
                let (rho, z) = forms.at(V2::new(dx, Lanes::splat(simd, dy)));
                // 2^x is for x ≥ −126, where nothing shows any more.
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
                        let [color, normal] = [record.color, record.normal].map(|v| v.map(|c| Lanes::splat(simd, c)));
                        self.blend_row::<S, SUMS>(row, &Fragments { alpha, z, color, normal }, shows, sums);
                    }
                    Some(pending) => {
                        if pending.add(row, bits, &alpha.to_array(), &z.to_array(), record) {
                            self.blend_pending::<S, SUMS>(simd, row, key(record.nearest, 0), pending, sums);
                        }
                    }
                }
                if self.open_rows == 0 {
                    return;
                }
            }
        }
        if let Some(pending) = pending {
            for row in 0..pixels.height as usize {
                self.blend_pending::<S, SUMS>(simd, row, u64::MAX, pending, sums);
            }
        }
    }

    /// Blends a row's fragments behind what is there.
    #[inline(always)]
    fn blend_row<S: Simd, const SUMS: bool>(
        &mut self,
        row: usize,
        fragments: &Fragments<S>,
        shows: <Lanes<S> as Real>::Mask,
        sums: &mut Sums,
    ) {
        let Fragments { alpha, color, .. } = *fragments;
        let simd = alpha.0.simd;
        let before = Lanes::load(simd, &self.transmittance[row]);
        let left = before * (alpha.one() - alpha);
        let ends = shows & left.lt(left.constant(MIN_TRANSMITTANCE));
        let drawn = shows & !ends;
        let weight = Lanes::select(drawn, alpha * before, alpha.zero());
        for (sum, c) in self.color.iter_mut().zip(color) {
            add(simd, &mut sum[row], weight, c);
        }
        if SUMS {
            sums.add(row, fragments, (weight, before), drawn);
        }
        Lanes::select(drawn, left, before).store(&mut self.transmittance[row]);
        if ends.bits() != 0 {
            let still = Lanes::select(ends, alpha.zero(), Lanes::load(simd, &self.open[row]));
            still.store(&mut self.open[row]);
            self.open_rows -= u32::from(still.zero().lt(still).bits() == 0);
        }
    }

    /// Blends the pending fragments of a row whose keys are less than a limit.
    #[inline(always)]
    fn blend_pending<S: Simd, const SUMS: bool>(
        &mut self,
        simd: S,
        row: usize,
        limit: u64,
        pending: &mut Pending<'_>,
        sums: &mut Sums,
    ) {
        let ready = pending.sort(row, limit, &self.transmittance[row]);
        let of_row = &mut pending.fragments[row * LANES..(row + 1) * LANES];
        for k in 0..ready.into_iter().max().unwrap_or(0) {
            let (mut alpha, mut z) = ([0.0; LANES], [1.0; LANES]);
            let (mut color, mut normal) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
            for (lane, fragments) in of_row.iter().enumerate() {
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
            let lanes = |v: Row| Lanes::load(simd, &v);
            let open = lanes(self.open[row]);
            let alpha = lanes(alpha);
            let shows = alpha.zero().lt(alpha) & open.zero().lt(open);
            let fragments = Fragments { alpha, z: lanes(z), color: color.map(lanes), normal: normal.map(lanes) };
            self.blend_row::<S, SUMS>(row, &fragments, shows, sums);
        }
        of_row.iter_mut().zip(ready).for_each(|(fragments, ready)| drop(fragments.drain(..ready)));
    }

    /// Colours as an image has them.
    fn resolve(&mut self, inputs: &TileInputs<'_>) {
        self.resolved = (0..SIDE * LANES)
            .map(|at| {
                let (y, x) = (at / LANES, at % LANES);
                let color = self.color.each_ref().map(|rows| f64::from(rows[y][x]));
                let left = f64::from(self.transmittance[y][x]);
                gaussian::resolve(color, left, inputs.background, inputs.linear).map(|c| c as f32)
            })
            .collect();
    }

    /// Gaussians that were blended, all pixels together; 0 where they aren't counted.
    pub(super) fn fragments(&self) -> u64 {
        let counted = self.sums.iter().flat_map(|sums| sums.fragments.as_flattened());
        counted.map(|n| *n as u64).sum()
    }

    /// Writes the planes that a frame has.
    pub(super) fn write(&self, grid: &TileGrid, tile: usize, frame: &mut Frame) {
        let pixels = grid.pixels(tile);
        let planes = frame.planes_mut();
        let width = grid.region.width as usize;
        for y in 0..pixels.height as usize {
            let first = (pixels.y - grid.region.y) as usize * width + y * width + (pixels.x - grid.region.x) as usize;
            let row = first..first + pixels.width as usize;
            if let Some(color) = planes.color.get_mut(row.clone()) {
                color.copy_from_slice(&self.resolved[y * LANES..y * LANES + color.len()]);
            }
            let transmittance = &self.transmittance[y];
            for plane in [&mut *planes.weight, &mut *planes.alpha] {
                fill(plane, &row, |x| 1.0 - transmittance[x]);
            }
            let Some(sums) = &self.sums else { continue };
            let weight = &sums.weight[y];
            let there = |x: usize, value: f32| if weight[x] > MIN_WEIGHT as f32 { value } else { f32::INFINITY };
            fill(planes.depth, &row, |x| there(x, sums.depth[y][x] / weight[x]));
            fill(planes.median_depth, &row, |x| there(x, sums.median_depth[y][x]));
            fill(planes.distortion, &row, |x| sums.distortion[y][x]);
            fill(planes.normal, &row, |x| sums.normal.each_ref().map(|rows| rows[y][x]));
            fill(planes.fragments, &row, |x| sums.fragments[y][x] as u32);
        }
    }
}

fn fill<T>(plane: &mut [T], row: &std::ops::Range<usize>, value: impl Fn(usize) -> T) {
    if let Some(pixels) = plane.get_mut(row.clone()) {
        pixels.iter_mut().enumerate().for_each(|(x, pixel)| *pixel = value(x));
    }
}

impl Sums {
    #[inline(always)]
    fn add<S: Simd>(
        &mut self,
        row: usize,
        fragments: &Fragments<S>,
        (weight, before): (Lanes<S>, Lanes<S>),
        drawn: <Lanes<S> as Real>::Mask,
    ) {
        let z = fragments.z;
        let simd = z.0.simd;
        for (sum, n) in self.normal.iter_mut().zip(fragments.normal) {
            add(simd, &mut sum[row], weight, n);
        }
        // Depths of what isn't drawn may be anything.
        let z = Lanes::select(drawn, z, z.one());
        add(simd, &mut self.weight[row], weight, weight.one());
        add(simd, &mut self.depth[row], weight, z);
        let median = Lanes::load(simd, &self.median_depth[row]);
        Lanes::select(drawn & z.constant(0.5).lt(before), z, median).store(&mut self.median_depth[row]);
        let m = distortion_depth(z);
        let [first, second] = self.moments.each_ref().map(|rows| Lanes::load(simd, &rows[row]));
        let spread = (m * m).mul_add(z.one() - before, second) - z.constant(2.0) * m * first;
        add(simd, &mut self.distortion[row], weight, spread);
        let [first, second] = &mut self.moments;
        add(simd, &mut first[row], weight, m);
        add(simd, &mut second[row], weight, m * m);
        let one = Lanes::select(drawn, z.one(), z.zero());
        add(simd, &mut self.fragments[row], one, one);
    }
}

/// Adds a product to a row of sums.
#[inline(always)]
fn add<S: Simd>(simd: S, sums: &mut Row, weight: Lanes<S>, value: Lanes<S>) {
    weight.mul_add(value, Lanes::load(simd, sums)).store(sums);
}

/// The record's forms in every lane.
#[inline(always)]
fn forms<S: Simd>(simd: S, record: &Record) -> GaussianForms<Lanes<S>> {
    let GaussianForms { u, v, w, z, low_pass } = record.forms;
    let [u0, u1, v0, v1] = [u[0], u[1], v[0], v[1]].map(|c| Lanes::splat(simd, c));
    let [w0, w1, w2] = w.map(|c| Lanes::splat(simd, c));
    let [z0, z1, z2] = z.map(|c| Lanes::splat(simd, c));
    GaussianForms { u: [u0, u1], v: [v0, v1], w: [w0, w1, w2], z: [z0, z1, z2], low_pass: Lanes::splat(simd, low_pass) }
}
