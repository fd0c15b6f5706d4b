//! Clip variants of splats, their entry points for raster hardware, and the layout of clips in buffers of both paths. A
//! *record* is a splat as set up for a tile: its projected forms, pixel boxes and colour in a buffer.

use crate::struct_writer::StructWriter;
use surfel_math::clip::Clip;
use surfel_math::mapping::Linear;
use surfel_model::{ClipPolicy, SplatCloud};
use surfel_shaders::{ENTRIES, Entry, Stage, layout};

/// Index of the bind group of records and their clips.
const RECORDS_GROUP: u32 = 1;

/// Clip variant of splats. Clipped splats have their own pipelines, so that drawing other splats doesn't cost more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Variant {
    /// Splats without clips, or clipped splats drawn without their clips.
    Whole,
    /// Splats that each have a clip.
    Clipped,
}

impl Variant {
    /// Returns the prefix of the names of the variant's entry points.
    pub(crate) fn prefix(self) -> &'static str {
        match self {
            Self::Whole => "",
            Self::Clipped => "clipped_",
        }
    }

    /// Returns the name of the entry point that sets up the variant's records.
    pub fn setup(self) -> String {
        format!("{}setup", self.prefix())
    }

    /// Returns the names of the vertex and fragment entry points that read the variant's records or their clips.
    pub fn record_entry_points(self) -> Vec<&'static str> {
        let reads = |entry: &&Entry| {
            let own = entry.name.starts_with(Self::Clipped.prefix()) == (self == Self::Clipped);
            own && entry.stage != Stage::Compute && entry.bindings.iter().any(|b| b.group == RECORDS_GROUP)
        };
        let draws = |entry: &&Entry| entry.stage == Stage::Vertex || entry.name.starts_with(Self::Clipped.prefix());
        ENTRIES.iter().filter(reads).filter(draws).map(|entry| entry.name).collect()
    }
}

/// Size of a stored clip in words. A stored clip has the exact forms, as in the shaders' `Clip`, and the form of the
/// chord that replaces a curve under [`ClipPolicy::Line`].
pub(crate) const STORED_WORDS: u32 = (layout::clip::SIZE / 4) as u32 + 3;

/// True if splat `i` has a clip.
pub(crate) fn is_clipped(cloud: &SplatCloud, i: usize) -> bool {
    cloud.data().clips.as_ref().is_some_and(|clips| clips.clip(i, ClipPolicy::Exact).is_some())
}

/// Returns the clip of splat `i` as [`STORED_WORDS`] words, in the order of the shaders' `stored_clip`. A splat without
/// a clip gets one that removes nothing.
pub(crate) fn stored(cloud: &SplatCloud, i: usize) -> Vec<u32> {
    let clip =
        |policy| cloud.data().clips.as_ref().and_then(|clips| clips.clip(i, policy)).unwrap_or_else(Clip::nothing);
    let mut words = clip_words(&clip(ClipPolicy::Exact));
    words.extend(linear_words(&clip(ClipPolicy::Line).chord));
    words
}

/// Returns the words of the shaders' `Clip`.
pub(crate) fn clip_words(clip: &Clip<f64>) -> Vec<u32> {
    use layout::clip as at;
    let mut words = StructWriter::new(at::SIZE);
    for (offset, form) in [(at::CHORD, clip.chord), (at::SIDE1, clip.side1), (at::SIDE3, clip.side3)] {
        words.u32s(offset, &linear_words(&form));
    }
    for (i, line) in clip.lines.iter().enumerate() {
        words.u32s(at::LINES + i * layout::linear::SIZE, &linear_words(line));
    }
    words.f64(at::CURVE_SIGN, clip.curve_sign).f64(at::LINE_SIGN, clip.line_sign);
    words.into_words()
}

/// Size of a clip in a record of the compute path, in words.
pub(crate) const CELL_CLIP_WORDS: usize = 4 * layout::CLIP_PARTS as usize;

/// Returns the words of a clip in a record of the compute path, as the shaders' `write_clip` arranges them. `clip` has
/// the words of the shaders' `Clip`.
pub(crate) fn cell_clip_words(clip: &[u32]) -> [u32; CELL_CLIP_WORDS] {
    use layout::clip as at;
    let word = |offset: usize, k: usize| clip.get(offset / 4 + k).copied().unwrap_or(0);
    let form = |offset: usize, fourth: u32| [word(offset, 0), word(offset, 1), word(offset, 2), fourth];
    let line = |i: usize| at::LINES + i * layout::linear::SIZE;
    let last = |k: usize| word(line(3), k);
    let parts = [
        form(at::CHORD, word(at::CURVE_SIGN, 0)),
        form(at::SIDE1, word(at::LINE_SIGN, 0)),
        form(at::SIDE3, last(0)),
        form(line(0), last(1)),
        form(line(1), last(2)),
        form(line(2), 0),
    ];
    let mut words = [0; CELL_CLIP_WORDS];
    words.iter_mut().zip(parts.as_flattened()).for_each(|(word, value)| *word = *value);
    words
}

/// Returns the words of the shaders' `Linear`.
fn linear_words(form: &Linear<f64>) -> Vec<u32> {
    use layout::linear as at;
    let mut words = StructWriter::new(at::SIZE);
    words.f64(at::C, form.c).f64(at::X, form.x).f64(at::Y, form.y);
    words.into_words()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FrameScene, Limits, TileData, Upload, UploadedScene};
    use glam::{DVec3, Vec3};
    use surfel_model::Storage;
    use surfel_model::{
        Camera, ClipColumns, ClipLine, CloudData, Column3, NO_LINE, OnInvalid, Projection, Scene, Shape,
    };
    use surfel_render::{Capabilities, Planes, Settings, View, plan};

    /// Returns a scene of three ellipses, of which the first `clipped` have a line each, and the words of each segment.
    fn uploaded(clipped: Option<usize>) -> (UploadedScene, Vec<Vec<u32>>) {
        let column = |v: [f32; 3]| Column3::from_f32(vec![Vec3::from(v); 3]);
        let shape = Shape::Ellipses { s: column([0.1, 0.0, 0.0]), t: column([0.0, 0.1, 0.0]) };
        let half = [ClipLine { a: 1.0, b: 0.0, c: 0.0 }, NO_LINE, NO_LINE, NO_LINE];
        let lines = |n| (0..3).map(|i| if i < n { half } else { [NO_LINE; 4] }).collect();
        let clips = clipped.map(|n| ClipColumns { lines: Some(lines(n)), ..ClipColumns::default() });
        let data = CloudData { clips, ..CloudData::new(DVec3::ZERO, column([0.0; 3]), shape) };
        let scene = Scene::from(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0);
        let mut upload = Upload::new(&scene, Storage::F32, Limits::default(), "test").unwrap();
        let total = upload.splat_bytes();
        let words: Vec<Vec<u32>> = std::iter::from_fn(|| upload.next_segment()).collect();
        assert_eq!(total, 4 * words.iter().map(|w| w.len() as u64).sum::<u64>());
        (upload.finish(), words)
    }

    fn variants(scene: &UploadedScene, clip: ClipPolicy) -> Vec<Variant> {
        let projection = Projection::Perspective { fov_y_deg: 45.0 };
        let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
        let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
        let capabilities = Capabilities::everything("test");
        let settings = Settings::default().with_clip(clip);
        let plan = plan(&scene.summary, &view, &settings, Planes::COLOR, &capabilities).unwrap();
        TileData::new(scene, &FrameScene::new(scene, &view, &plan), &view, &plan, view.region).variants()
    }

    #[test]
    fn only_splats_with_a_clip_pay_for_it() {
        let (plain, words) = uploaded(None);
        let (unclipped, same_words) = uploaded(Some(0));
        // Each splat has ten words: a chunk, a centre and two axes.
        assert_eq!((words[0].len(), &words), (3 * 10, &same_words));
        for scene in [&plain, &unclipped] {
            assert_eq!(scene.records(Limits::default()).0.iter().map(|b| b.clips).sum::<u64>(), 0);
            assert_eq!(variants(scene, ClipPolicy::Exact), [Variant::Whole]);
        }
        let (mixed, words) = uploaded(Some(1));
        assert_eq!(words.iter().map(Vec::len).collect::<Vec<_>>(), [2 * 10, 10 + STORED_WORDS as usize]);
        assert_eq!(mixed.segments.iter().map(|s| s.variant).collect::<Vec<_>>(), [Variant::Whole, Variant::Clipped]);
        let bytes = mixed.records(Limits::default()).0;
        assert_eq!(bytes.iter().map(|b| b.clips).collect::<Vec<_>>(), [0, layout::record_clip::SIZE as u64]);
        assert_eq!(variants(&mixed, ClipPolicy::Exact), [Variant::Whole, Variant::Clipped]);
        assert_eq!(variants(&mixed, ClipPolicy::Off), [Variant::Whole]);
    }

    #[test]
    fn every_draw_has_its_entry_points_in_both_variants() {
        use crate::{Draw, Layer, Sums};
        let fronts = [Layer::Front, Layer::MeshBlend, Layer::Shown, Layer::ShownMeshBlend];
        let sums = fronts
            .into_iter()
            .chain([Layer::EdgeBackground, Layer::Peeled, Layer::Gathered, Layer::Remaining])
            .map(|l| [Sums::Color, Sums::Surface, Sums::MaterialCounts].map(|s| Draw::Sums(l, s)));
        let visibility = [
            Draw::Visibility,
            Draw::VisibilityWithTolerance,
            Draw::Facing,
            Draw::ShownVisibility,
            Draw::ShownVisibilityWithTolerance,
            Draw::EdgeBackgroundVisibility,
        ];
        let others = visibility.into_iter().chain([Draw::PeeledVisibility, Draw::Polygons, Draw::Edges]);
        let probes = crate::FillRateProbe::ALL.map(Draw::Probe);
        for draw in sums.into_iter().flatten().chain(others).chain(probes) {
            for variant in [Variant::Whole, Variant::Clipped] {
                for name in draw.entries(variant).into_iter().chain([variant.setup()]) {
                    assert!(ENTRIES.iter().any(|e| e.name == name), "{name}");
                }
            }
        }
    }

    /// Checks the offsets that the shader function `stored_clip` assumes.
    #[test]
    fn a_clip_is_stored_in_the_order_in_which_shaders_read_it() {
        use layout::clip as at;
        let words =
            [at::CHORD, at::SIDE1, at::SIDE3, at::CURVE_SIGN, at::LINES, at::LINE_SIGN, at::SIZE].map(|b| b / 4);
        assert_eq!(words, [0, 3, 6, 9, 10, 22, 23]);
        assert_eq!([layout::linear::C, layout::linear::X, layout::linear::Y, layout::linear::SIZE], [0, 4, 8, 12]);
    }
}
