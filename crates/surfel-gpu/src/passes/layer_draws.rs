//! Indirect draws of transparent layers (rendering model §8). They end after the first layer without fragments.
//!
//! The GPU decides when to end. Between two layers, a shader checks if any pixel has a depth threshold in the layer
//! just drawn. If there is none, the shader sets the instance counts of all further draws to 0; no count is read back.
//! A layer without instances still costs the clears of its targets and one pixel pass.

use crate::passes::draw::Draw;
use crate::passes::memory::raise_counter;
use crate::struct_writer::StructWriter;
use surfel_render::Stats;
use surfel_shaders::layout::{draw_arguments, layer_draws as at};

/// Name of the counter of drawn layers in the statistics, which [`count_layers`] raises.
pub(crate) const LAYERS_DRAWN: &str = "layers_drawn";

/// Size of the header of the shaders' `LayerDraws`, in bytes: the words that [`count_layers`] and [`layers_remain`]
/// read.
pub const LAYER_HEADER_BYTES: u64 = at::ARGUMENTS as u64;

/// Returns the words of the shaders' `LayerDraws` before the first layer. `records` are the numbers of records of all
/// segments of the scene, in order, then of each element of [`TileData::near`](crate::TileData::near).
pub fn layer_draw_words(records: impl IntoIterator<Item = u32>) -> Vec<u32> {
    let mut words = StructWriter::new(at::ARGUMENTS);
    words.u32(at::DRAWN, 1);
    let mut words = words.into_words();
    for (index, count) in records.into_iter().enumerate() {
        let mut draw = StructWriter::new(draw_arguments::SIZE);
        draw.u32(draw_arguments::VERTICES, 4).u32(draw_arguments::INSTANCES, count);
        draw.u32(draw_arguments::FIRST_VERTEX, Draw::quad(index).start);
        words.extend(draw.into_words());
    }
    // An empty array can't be bound.
    words.resize(words.len().max((at::ARGUMENTS + draw_arguments::SIZE) / 4), 0);
    words
}

/// Returns the byte offset, in the shaders' `LayerDraws`, of the arguments of the draw with this index.
pub fn layer_draw_offset(index: usize) -> u64 {
    (at::ARGUMENTS + index * draw_arguments::SIZE) as u64
}

/// True if more layers may lie behind those drawn so far. `header` is the first [`LAYER_HEADER_BYTES`] of the shaders'
/// `LayerDraws`, as words.
pub fn layers_remain(header: &[u32]) -> bool {
    header.get(at::ANY_REMAINING / 4).is_some_and(|&any| any != 0)
}

/// Raises the counter of drawn layers to the number of layers drawn in this tile, if that is larger. `header` is the
/// first [`LAYER_HEADER_BYTES`] of the shaders' `LayerDraws`, as words.
pub fn count_layers(header: &[u32], stats: &mut Stats) {
    let drawn = f64::from(header.get(at::DRAWN / 4).copied().unwrap_or(0));
    raise_counter(LAYERS_DRAWN, drawn, stats);
}
