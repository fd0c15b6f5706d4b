//! Estimates of the work of a frame's passes, to compare their times with the device's peak rates.
//!
//! Bytes are those that have to be read from or written to memory at least once. Operations are counted by hand in the
//! WGSL of the pass and are accurate to a factor of two; a fused multiply-add counts as two. Passes whose work is hard
//! to estimate (layers, polygons, Gaussians, samples of edges) have no estimate.

use serde::{Deserialize, Serialize};
use surfel_gpu::{Draw, PixelPass, Precision, RecordBytes, Target, Variant};
use surfel_model::Shader;
use surfel_render::{FramePlan, Pass};

/// Number of floating-point operations to set up a splat: transform, footprint, filter, box, depth (`setup.wgsl`).
const SETUP_FLOPS: f64 = 450.0;
/// Bytes that sorting moves per drawn splat, if it touches a single bin: its box is read, its cells and index are
/// written and read to count and to write lists, and so is a share of the counts (`cell_lists.wgsl`).
const SORT_SPLAT_BYTES: f64 = 16.0 + 8.0 + 12.0 + 20.0;
/// Bytes that sorting moves per pair of a splat and a cell, which is a square of pixels that the compute path draws at
/// once: the splat's index is read and written.
const SORT_PAIR_BYTES: f64 = 8.0;
/// Bytes that the two loops over a cell's splats read per pair of a splat and a cell: the record of the projected
/// splat, once per loop (`cell_raster.wgsl`).
const RASTER_RECORD_BYTES: f64 = 112.0 + 128.0;
/// Number of floating-point operations per fragment of the visibility pass (`visibility.wgsl`).
const VISIBILITY_FLOPS: f64 = 35.0;
/// Number of floating-point operations per fragment of the attribute pass (`attributes.wgsl`).
const ATTRIBUTE_FLOPS: f64 = 55.0;
/// Bytes per pixel of the data by which edges are detected. The pass over cells writes them, and the pass over edges
/// reads them (`cell_neighbours.wgsl`).
const EDGE_DATA_BYTES: f64 = 16.0;
/// Number of floating-point operations of edge detection per pixel, over its eight neighbours (`edges.wgsl`).
const EDGE_FLOPS: f64 = 60.0;
/// Number of floating-point operations to divide a pixel's sums by the weight and encode it, without lighting
/// (`shade.wgsl`).
const RESOLVE_FLOPS: f64 = 30.0;
/// Number of floating-point operations to light a pixel with the default lights (`lighting.wgsl`).
const LIGHT_FLOPS: f64 = 150.0;

/// Measured counts of a frame, from which work is estimated.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counts {
    /// Number of splats of the scene.
    pub splats: f64,
    /// Number of splats that were drawn.
    pub drawn: f64,
    /// Total number of fragments of the frame that contribute to any pixel.
    pub fragments: f64,
    /// Number of pixels of the image.
    pub pixels: f64,
    /// Memory of the uploaded scene in the backend, in bytes per splat.
    pub bytes_per_splat: f64,
    /// Number of pairs of a splat and a cell; 0 unless the compute path drew the frame.
    pub pairs: f64,
}

/// Estimated work of one pass of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Work {
    /// Name of the pass in the statistics.
    pub pass: String,
    /// Bytes read from and written to memory.
    pub bytes: f64,
    /// Floating-point operations in compute shaders.
    pub compute_flops: f64,
    /// Floating-point operations in fragment shaders.
    pub fragment_flops: f64,
    /// Number of quads that are rasterised.
    pub quads: f64,
    /// Number of fragments per set of targets, each with the name of the fill-rate probe that writes the same targets.
    pub fill: Vec<(String, f64)>,
}

impl Work {
    /// Estimates the work of the passes of a plan. Passes without an estimate are omitted.
    pub(crate) fn of(plan: &FramePlan, counts: Counts) -> Vec<Self> {
        if counts.pairs > 0.0 {
            return Self::of_cells(plan, counts);
        }
        let mut all: Vec<Self> = Vec::new();
        let draws = Draw::of(plan);
        if draws.iter().any(|draw| draw.draws_records()) {
            all.push(Self::of_setup(counts));
        }
        for work in draws.into_iter().filter_map(|draw| Self::of_draw(draw, plan, counts)) {
            match all.iter_mut().find(|other| other.pass == work.pass) {
                Some(other) => other.add(work),
                None => all.push(work),
            }
        }
        all.extend(PixelPass::of(plan).into_iter().filter(|pass| pass.is_shade()).map(|pass| {
            let light = if plan.shader == Shader::Unlit { 0.0 } else { LIGHT_FLOPS };
            let read: f64 = sums(plan).iter().map(|&target| bytes(target, plan)).sum();
            // Each pixel's planes are written: the colour and the other requested planes.
            let written = 4.0 * plane_floats(plan);
            Self {
                pass: pass.name().to_owned(),
                bytes: counts.pixels * (read + written),
                compute_flops: counts.pixels * (RESOLVE_FLOPS + light),
                ..Self::default()
            }
        }));
        all
    }

    /// Estimates the work of the compute path's passes.
    fn of_cells(plan: &FramePlan, counts: Counts) -> Vec<Self> {
        let light = if plan.shader == Shader::Unlit { 0.0 } else { LIGHT_FLOPS };
        // The second loop evaluates each fragment again, and sums it.
        let of_fragment = VISIBILITY_FLOPS + 2.0 * ATTRIBUTE_FLOPS;
        let sorted = counts.drawn * SORT_SPLAT_BYTES + counts.pairs * SORT_PAIR_BYTES;
        let sort = Self { pass: "sort".to_owned(), bytes: sorted, ..Self::default() };
        let has_edges = plan.has(Pass::EdgeAntialiasing) || plan.has(Pass::EdgeSamples);
        let edge_data = if has_edges { counts.pixels * EDGE_DATA_BYTES } else { 0.0 };
        let raster = Self {
            pass: "raster".to_owned(),
            bytes: counts.pairs * RASTER_RECORD_BYTES + counts.pixels * 4.0 * plane_floats(plan) + edge_data,
            compute_flops: counts.fragments * of_fragment + counts.pixels * (RESOLVE_FLOPS + light),
            ..Self::default()
        };
        // The work of drawing edge pixels again isn't estimated, because most images have few.
        let edges = has_edges.then(|| Self {
            pass: "edges".to_owned(),
            bytes: edge_data,
            compute_flops: counts.pixels * EDGE_FLOPS,
            ..Self::default()
        });
        [Self::of_setup(counts), sort, raster].into_iter().chain(edges).collect()
    }

    fn of_setup(counts: Counts) -> Self {
        let written = counts.drawn * record_bytes();
        Self {
            pass: "setup".to_owned(),
            bytes: counts.splats * counts.bytes_per_splat + written,
            compute_flops: counts.splats * SETUP_FLOPS,
            ..Self::default()
        }
    }

    /// Estimates the work of a draw; `None` if there is no estimate.
    fn of_draw(draw: Draw, plan: &FramePlan, counts: Counts) -> Option<Self> {
        let (flops, of) = match draw.name() {
            "visibility" => (VISIBILITY_FLOPS, counts.fragments),
            "attributes" => (ATTRIBUTE_FLOPS, counts.fragments),
            "edges" => (EDGE_FLOPS, counts.pixels),
            _ => return None,
        };
        let is_of_splats = draw.draws_records();
        let targets: Vec<Target> = draw.colors().iter().copied().chain(draw.depth()).collect();
        let read = draw.reads().iter().map(|&(_, target)| bytes(target, plan)).sum::<f64>();
        let per_pixel = targets.iter().map(|&target| bytes(target, plan)).sum::<f64>() + read;
        let records = if is_of_splats { counts.drawn * record_bytes() } else { 0.0 };
        let probe = match (draw.is_additive(), draw.colors().len()) {
            (true, 1) => "blend",
            (true, _) => "blend two",
            (false, 0) => "depth",
            (false, _) => "fill",
        };
        Some(Self {
            pass: draw.name().to_owned(),
            bytes: records + counts.pixels * per_pixel,
            fragment_flops: of * flops,
            quads: if is_of_splats { counts.drawn } else { 0.0 },
            fill: vec![(probe.to_owned(), of)],
            ..Self::default()
        })
    }

    fn add(&mut self, other: Self) {
        self.bytes += other.bytes;
        self.compute_flops += other.compute_flops;
        self.fragment_flops += other.fragment_flops;
        self.quads += other.quads;
        self.fill.extend(other.fill);
    }
}

fn record_bytes() -> f64 {
    RecordBytes::of(1, Variant::Whole).records as f64
}

fn bytes(target: Target, plan: &FramePlan) -> f64 {
    target.format().bytes(Precision::of(plan, true)) as f64
}

/// Returns the targets that shading reads, which are the targets of additive draws.
fn sums(plan: &FramePlan) -> Vec<Target> {
    let additive = Draw::of(plan).into_iter().filter(|draw| draw.is_additive());
    additive.flat_map(|draw| draw.colors().iter().copied()).collect()
}

/// Returns the number of floats per pixel in the requested planes of colour, depth, normals and weights; other planes
/// don't count.
fn plane_floats(plan: &FramePlan) -> f64 {
    let planes = plan.planes;
    let counted = [(planes.color, 4), (planes.depth, 1), (planes.normal, 3), (planes.weight, 1)];
    counted.into_iter().filter(|plane| plane.0).map(|plane| f64::from(plane.1)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::EdgeAa;
    use surfel_model::{Camera, Settings};
    use surfel_render::{Capabilities, SceneSummary, plan};
    use surfel_render::{Planes, View};

    fn work(settings: Settings, pairs: f64) -> Vec<Work> {
        let camera = Camera::perspective([0.0, 0.0, 5.0], [0.0; 3], 45.0, [10, 10]);
        let view = View::new(&camera).unwrap();
        let capabilities = Capabilities::everything("test");
        let plan = plan(&SceneSummary::default(), &view, &settings, Planes::COLOR, &capabilities).unwrap();
        let counts =
            Counts { splats: 1000.0, drawn: 500.0, fragments: 4000.0, pixels: 100.0, bytes_per_splat: 40.0, pairs };
        Work::of(&plan, counts)
    }

    #[test]
    fn work_of_an_unlit_image_is_four_passes_with_the_bytes_of_their_targets() {
        let all = work(Settings::default().with_shader(Shader::Unlit), 0.0);
        let names: Vec<&str> = all.iter().map(|work| work.pass.as_str()).collect();
        assert_eq!(names, ["setup", "visibility", "attributes", "shade"]);
        assert_eq!(all[0].bytes, 1000.0 * 40.0 + 500.0 * record_bytes());
        // The target is a depth of four bytes.
        assert_eq!(all[1].bytes, 500.0 * record_bytes() + 100.0 * 4.0);
        assert_eq!(all[1].fill, [("depth".to_owned(), 4000.0)]);
        // The target has four sums of four bytes, and the pass reads the depth threshold.
        assert_eq!(all[2].bytes, 500.0 * record_bytes() + 100.0 * (16.0 + 4.0));
        assert_eq!((all[2].quads, all[2].fill.clone()), (500.0, vec![("blend".to_owned(), 4000.0)]));
        // The pass reads sums and writes colours.
        assert_eq!((all[3].bytes, all[3].compute_flops), (100.0 * 32.0, 100.0 * RESOLVE_FLOPS));
    }

    #[test]
    fn work_of_cells_is_of_pairs() {
        let all = work(Settings::default(), 700.0);
        let names: Vec<&str> = all.iter().map(|work| work.pass.as_str()).collect();
        assert_eq!(names, ["setup", "sort", "raster"]);
        // Each of 500 splats is moved once, and listed in each of its cells.
        assert_eq!(all[1].bytes, 500.0 * 56.0 + 700.0 * 8.0);
        // Each pair's record is read twice, and colours are written.
        assert_eq!(all[2].bytes, 700.0 * 240.0 + 100.0 * 16.0);
        assert!(all.iter().all(|work| work.fill.is_empty() && work.quads == 0.0));
        let edges = work(Settings::default().with_edge_aa(EdgeAa::Samples), 700.0);
        assert_eq!(
            edges.iter().map(|work| work.pass.as_str()).collect::<Vec<_>>(),
            ["setup", "sort", "raster", "edges"]
        );
        assert_eq!((edges[2].bytes, edges[3].bytes), (all[2].bytes + 100.0 * 16.0, 100.0 * 16.0));
    }

    #[test]
    fn work_grows_with_what_is_asked_for() {
        let plain = work(Settings::default().with_shader(Shader::Unlit), 0.0);
        let lit = work(Settings::default().with_shader(Shader::Normal), 0.0);
        assert_eq!(lit[2].fill, [("blend two".to_owned(), 4000.0)]);
        assert!(lit[2].bytes > plain[2].bytes && lit[3].compute_flops > plain[3].compute_flops);
        let edges = work(Settings::default().with_edge_aa(EdgeAa::Coverage), 0.0);
        assert!(edges.iter().any(|work| work.pass == "edges"), "{edges:?}");
        // Two draws over the splats share a name.
        let attributes = edges.iter().find(|work| work.pass == "attributes").unwrap();
        assert_eq!(attributes.quads, 1000.0);
    }
}
