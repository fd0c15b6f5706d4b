//! Layout of a tile's planes in the buffer that the shading pass writes: one array of f32.

use crate::passes::cells::CellCounts;
use crate::passes::pass_list::has_layers;
use rayon::prelude::*;
use surfel_math::srgb::encode_rgba8;
use surfel_render::{Frame, FramePlan, Identity, Pass, Planes, Region};
use surfel_shaders::layout;

/// Offsets of a tile's planes in one array, in floats; `layout::ABSENT` for planes that weren't requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneLayout {
    /// Offset of RGBA colours, four floats per pixel. The next offsets are those of the planes with their names; the
    /// plane of nearest splats has two floats per pixel, draw and record.
    pub(crate) color_at: u32,
    pub(crate) depth_at: u32,
    pub(crate) normal_at: u32,
    pub(crate) weight_at: u32,
    pub(crate) fragments_at: u32,
    pub(crate) nearest_at: u32,
    pub(crate) alpha_at: u32,
    pub(crate) median_depth_at: u32,
    pub(crate) distortion_at: u32,
    /// Offset of the surfaces, which are the normal and depth of every pixel of the targets. Passes of the compute path
    /// that read neighbouring pixels or draw transparent layers use them. They are stored after the planes.
    pub(crate) surfaces_at: u32,
    /// Offset of the edge data of every pixel of the targets (`shaders/passes/cell_neighbours.wgsl`). Passes of the
    /// compute path that read neighbouring pixels use them. They are stored after the surfaces.
    pub(crate) edges_at: u32,
    /// Offset of the transparent layers of every pixel of the targets and of every cell
    /// (`shaders/passes/cell_layers.wgsl`). They are stored after the edge data.
    pub(crate) layers_at: u32,
    /// Number of floats that the CPU reads back: the planes and, for trained Gaussians, the float before them.
    pub floats: u32,
    /// Number of floats in the whole buffer, including surfaces, edge data and layers.
    pub buffer_floats: u32,
}

/// Smallest number of pixel rows that one parallel task copies.
const MIN_ROWS_PER_TASK: usize = 16;

/// Number of floats per pixel of the surfaces: a normal and a depth.
const SURFACE_FLOATS: u32 = 4;

/// Returns the numbers of floats per pixel of the surfaces and of the edge data. Each is 0 if no pass of the compute
/// path reads the data, given the plan.
pub(crate) fn neighbour_floats(plan: &FramePlan) -> [u32; 2] {
    let has_surfaces = plan.has(Pass::Outlines) || plan.has(Pass::EyeDome) || has_layers(plan);
    let has_edges = plan.has(Pass::EdgeAntialiasing) || plan.has(Pass::EdgeSamples);
    let has_layered_samples = plan.has(Pass::EdgeSamples) && has_layers(plan);
    let edge_floats = if has_layered_samples { layout::LAYERED_EDGE_WORDS } else { layout::EDGE_WORDS };
    [if has_surfaces { SURFACE_FLOATS } else { 0 }, if has_edges { edge_floats } else { 0 }]
}

/// Returns the number of floats of a pixel in all planes together.
pub(crate) fn floats_per_pixel(planes: Planes) -> u32 {
    PlaneLayout::new(planes, 1).floats
}

impl PlaneLayout {
    /// Creates the layout for a tile of `pixels` pixels. The total number of floats must fit 32 bits.
    pub(crate) fn new(planes: Planes, pixels: u32) -> Self {
        Self::after(0, planes, pixels)
    }

    /// Creates the layout for trained Gaussians. The first float, before the planes, is the number of the last dispatch
    /// that left a pixel unfinished.
    pub(crate) fn of_gaussians(planes: Planes, pixels: u32) -> Self {
        Self::after(layout::GAUSSIANS_UNFINISHED_AT + 1, planes, pixels)
    }

    /// Creates the layout of planes that begin at offset `first`.
    fn after(first: u32, planes: Planes, pixels: u32) -> Self {
        let mut floats = first;
        let mut plane = |wanted: bool, channels: u32| {
            let at = if wanted { floats } else { layout::ABSENT };
            floats += if wanted { channels * pixels } else { 0 };
            at
        };
        let (color_at, depth_at) = (plane(planes.color, 4), plane(planes.depth, 1));
        let (normal_at, weight_at) = (plane(planes.normal, 3), plane(planes.weight, 1));
        let (fragments_at, nearest_at) = (plane(planes.fragments, 1), plane(planes.index, 2));
        let (alpha_at, median_depth_at) = (plane(planes.alpha, 1), plane(planes.median_depth, 1));
        let distortion_at = plane(planes.distortion, 1);
        Self {
            color_at,
            depth_at,
            normal_at,
            weight_at,
            fragments_at,
            nearest_at,
            alpha_at,
            median_depth_at,
            distortion_at,
            surfaces_at: layout::ABSENT,
            edges_at: layout::ABSENT,
            layers_at: layout::ABSENT,
            floats,
            buffer_floats: floats,
        }
    }

    /// Appends what passes of the compute path read besides the planes, for targets of `size` pixels: surfaces, edge
    /// data and layers.
    pub(crate) fn with_cell_data(self, plan: &FramePlan, size: [u32; 2]) -> Self {
        let pixels: u32 = size.iter().product();
        let [surfaces, edges] = neighbour_floats(plan);
        let cells: u32 = CellCounts::size_of(size).iter().product();
        let layers = layout::LAYER_WORDS * pixels + layout::CELL_LAYER_WORDS * cells;
        let layers = if has_layers(plan) { layers } else { 0 };
        let place = |at: u32, floats: u32| if floats > 0 { at } else { layout::ABSENT };
        let edges_at = self.floats + surfaces * pixels;
        let layers_at = edges_at + edges * pixels;
        Self {
            surfaces_at: place(self.floats, surfaces),
            edges_at: place(edges_at, edges),
            layers_at: place(layers_at, layers),
            buffer_floats: layers_at + layers,
            ..self
        }
    }

    /// Copies a tile's planes, `values`, into the frame of the image region `region`. Colours are encoded if the frame
    /// stores them in 8 bits.
    ///
    /// `identity` returns the splat, ball or polygon for a pixel's draw and record number, as
    /// [`crate::TileData::identity`] does. Returns the number of fragments of the tile, or 0 if their plane wasn't
    /// requested.
    pub fn store(
        &self,
        values: &[f32],
        tile: Region,
        region: Region,
        frame: &mut Frame,
        identity: impl Fn(i32, usize) -> Identity,
    ) -> u64 {
        let (columns, pixels) = (tile.width as usize, tile.width as usize * tile.height as usize);
        let (width, left) = (region.width as usize, (tile.x - region.x) as usize);
        let part = |at: u32, channels: usize| {
            let start = at as usize;
            if at == layout::ABSENT { None } else { values.get(start..start + channels * pixels) }
        };
        let rows = |row: usize| ((tile.y - region.y) as usize + row) * width + left;
        let first_row = (tile.y - region.y) as usize;
        let copy = |from: Option<&[f32]>, channels: usize, to: &mut [f32]| {
            let to = to.par_chunks_exact_mut((width * channels).max(1)).skip(first_row);
            let from = from.unwrap_or_default().par_chunks_exact((columns * channels).max(1));
            to.zip(from).with_min_len(MIN_ROWS_PER_TASK).for_each(|(line, values)| {
                let start = left * channels;
                if let Some(place) = line.get_mut(start..start + values.len()) {
                    place.copy_from_slice(values);
                }
            });
        };
        copy(part(self.color_at, 4), 4, frame.color_mut().as_flattened_mut());
        let encoded = frame.rgba8_mut().par_chunks_exact_mut(width.max(1)).skip(first_row);
        let colors = part(self.color_at, 4).unwrap_or_default().par_chunks_exact((4 * columns).max(1));
        encoded.zip(colors).with_min_len(MIN_ROWS_PER_TASK).for_each(|(line, colors)| {
            for (place, color) in line.iter_mut().skip(left).zip(colors.as_chunks().0) {
                *place = encode_rgba8(*color);
            }
        });
        copy(part(self.depth_at, 1), 1, frame.depth_mut());
        copy(part(self.normal_at, 3), 3, frame.normal_mut().as_flattened_mut());
        copy(part(self.weight_at, 1), 1, frame.weight_mut());
        copy(part(self.alpha_at, 1), 1, frame.alpha_mut());
        copy(part(self.median_depth_at, 1), 1, frame.median_depth_mut());
        copy(part(self.distortion_at, 1), 1, frame.distortion_mut());
        let nearest = part(self.nearest_at, 2).into_iter().flat_map(|f| f.chunks_exact(2 * columns));
        for (row, line) in nearest.enumerate() {
            for (at, found) in (rows(row)..).zip(line.chunks_exact(2)) {
                let &[source, record] = found else { continue };
                let there = (source != 0.0).then(|| identity(source as i32 - 1, record as usize));
                frame.put_identity(at, there.unwrap_or(Identity::NOTHING));
            }
        }
        let mut fragments = 0;
        let counts = part(self.fragments_at, 1).into_iter().flat_map(|f| f.chunks_exact(columns));
        for (row, line) in counts.enumerate() {
            for (place, &count) in frame.fragments_mut().iter_mut().skip(rows(row)).zip(line) {
                *place = count as u32;
                fragments += count as u64;
            }
        }
        fragments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_land_in_their_place_and_absent_planes_take_no_room() {
        let planes = Planes::ALL.with_color(false).with_fragments(true);
        let region = Region { x: 10, y: 20, width: 3, height: 2 };
        let mut frame = Frame::default();
        frame.reset(3, 2, planes);
        for (tile, base) in [(Region { width: 2, ..region }, 0.0), (Region { x: 12, width: 1, ..region }, 100.0)] {
            let pixels = tile.width * tile.height;
            let layout = PlaneLayout::new(planes, pixels);
            assert_eq!(layout.floats, pixels * 6);
            let values: Vec<f32> = (0..layout.floats).map(|i| base + i as f32).collect();
            layout.store(&values, tile, region, &mut frame, |_, _| Identity::NOTHING);
        }
        assert_eq!(frame.depth(), [0.0, 1.0, 100.0, 2.0, 3.0, 101.0]);
        assert_eq!(frame.normal()[3], [10.0, 11.0, 12.0]);
        assert_eq!(frame.normal()[5], [105.0, 106.0, 107.0]);
        assert_eq!(frame.fragments(), [20, 21, 110, 22, 23, 111]);
        assert!(frame.color().is_empty());
    }

    #[test]
    fn planes_of_gaussians_have_room_where_they_are_asked_for() {
        let none = PlaneLayout::new(Planes::ALL, 6);
        assert_eq!([none.alpha_at, none.median_depth_at, none.distortion_at], [layout::ABSENT; 3]);
        let one = Planes::COLOR.with_alpha(true);
        for (planes, floats) in [(one, 5), (one.with_median_depth(true), 6), (one.with_distortion(true), 6)] {
            assert_eq!(floats_per_pixel(planes), floats);
        }
        let planes = Planes::COLOR.with_color(false).with_median_depth(true).with_distortion(true);
        let region = Region { x: 0, y: 0, width: 3, height: 1 };
        let mut frame = Frame::default();
        frame.reset(3, 1, planes);
        let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        PlaneLayout::new(planes, 3).store(&values, region, region, &mut frame, |_, _| Identity::NOTHING);
        assert_eq!((frame.median_depth(), frame.distortion()), (&values[..3], &values[3..]));
    }
}
