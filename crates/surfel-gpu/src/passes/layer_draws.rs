//! Indirect draws of transparent layers (§8), which end before the first layer without fragments.
//!
//! The GPU itself decides: between two layers a shader sets the instances of all further draws to 0 if no pixel has a
//! depth threshold in the layer. No count is read back in between. A layer that isn't drawn still costs the clears of
//! its targets and a pixel pass.

use crate::passes::draw::Draw;
use crate::passes::memory::raise_counter;
use crate::struct_writer::StructWriter;
use surfel_render::Stats;
use surfel_shaders::layout::{draw_arguments, layer_draws as at};

/// Name of the counter of [`count_layers`].
const LAYERS_DRAWN: &str = "layers_drawn";

/// Bytes at the start of the shaders' `LayerDraws` that [`count_layers`] takes.
pub const LAYER_HEADER_BYTES: u64 = at::ARGUMENTS as u64;

/// The shaders' `LayerDraws` before the first layer: a draw of so many records for each number of them.
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

/// Byte offset of the arguments of a draw, by its place among the numbers of records.
pub fn layer_draw_offset(index: usize) -> u64 {
    (at::ARGUMENTS + index * draw_arguments::SIZE) as u64
}

/// True if more layers may lie behind those that were drawn: `header` are the words of the first
/// [`LAYER_HEADER_BYTES`].
pub fn layers_remain(header: &[u32]) -> bool {
    header.get(at::ANY_REMAINING / 4).is_some_and(|&any| any != 0)
}

/// Counts the layers of the tile that has the most: `header` are the words of the first [`LAYER_HEADER_BYTES`].
pub fn count_layers(header: &[u32], stats: &mut Stats) {
    let drawn = f64::from(header.get(at::DRAWN / 4).copied().unwrap_or(0));
    raise_counter(LAYERS_DRAWN, drawn, stats);
}
