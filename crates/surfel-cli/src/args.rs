//! The command line's grammar.

use crate::pieces::{self, FrameRange};
use crate::values::{self, Threshold, UpChoice};
use clap::builder::TypedValueParser;
use clap::{Args, CommandFactory, Parser, Subcommand};
use clap_complete::Shell;
use std::path::PathBuf;
use std::sync::Arc;
use surfel::coloring::Coloring;
use surfel::framing::ViewChoice;
use surfel::model::{
    Accumulate, Classes, ClipPolicy, Colormap, Composite, Cull, DepthTolerance, EdgeAa, Filter, Mapping, Outliers,
    PointColors, Returns, Shader, Sort, SplatCount, TableColumns, Transparency,
};
use surfel::values::RangeChoice;
use surfel::{Preset, Region};

/// Renders splats, scans, point clouds and meshes by surface splatting.
///
/// `surfel INPUT -o OUT` is short for `surfel render INPUT -o OUT`.
#[derive(Debug, Parser)]
#[command(name = "surfel", version, arg_required_else_help = true, subcommand_required = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Print errors only.
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Print additional information on stderr.
    #[arg(short, long, global = true)]
    pub(crate) verbose: bool,
    /// Number of threads; by default one per CPU.
    #[arg(long, global = true, value_name = "N",
        value_parser = clap::value_parser!(u16).range(1..=1024).map(usize::from))]
    pub(crate) threads: Option<usize>,
    /// TOML file with flags; its keys are long flag names. Flags on the command line take precedence.
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render an image.
    Render(Box<RenderArgs>),
    /// Draw an image again from the scene stored in its metadata.
    Again(AgainArgs),
    /// Convert points or a mesh to splats.
    Convert(Box<ConvertArgs>),
    /// Draw an orthoimage and a surface model as GeoTIFF.
    Ortho(Box<OrthoArgs>),
    /// Describe the content of a file.
    Info(InfoArgs),
    /// Merge the tiles of an image.
    Stitch(StitchArgs),
    /// Draw images of one scene, kept in memory, as requested on stdin.
    Serve(Box<ServeArgs>),
    /// Print a job for a cluster or render farm that draws a scene, or converts points, in shards.
    Jobs(JobsArgs),
    /// Measure the difference between two images.
    Compare(CompareArgs),
    /// List the backends available on this machine.
    Backends(BackendsArgs),
    /// Show in a window (not in this version).
    View(ViewArgs),
    /// Print a completion script for a shell.
    Completions(CompletionsArgs),
    /// Print the manual page.
    Man,
}

#[derive(Args, Clone, Debug)]
pub(crate) struct RenderArgs {
    /// A scene file (.json), or splats, points or meshes that form one scene; - is stdin. With {input} in OUT, each
    /// INPUT gets its own image.
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
    /// Image to write: .png, .exr, .npz or .jpg (quality 92, blended onto the background), or - for PNG on stdout. The
    /// name may contain {backend} {frame} {input} {name} {tile}. `surfel INPUT` alone writes INPUT's name with .png to
    /// the current folder.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Overwrite existing files.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// True for `surfel INPUT` without the word `render`; the image then gets a default name if -o is missing.
    #[arg(skip)]
    pub(crate) bare: bool,
    /// Options for converting files to splats.
    #[command(flatten)]
    pub(crate) splats: SplatArgs,
    /// Write the resolved scene file to stdout, with paths relative to the current folder; without -o, render nothing.
    #[arg(long)]
    pub(crate) print_scene: bool,
    /// Rendering backend.
    #[arg(long, default_value = "auto", value_parser = ["auto", "cpu", "wgpu", "ash", "reference"])]
    pub(crate) backend: String,
    /// Part of the adapter's name, in any case.
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// Bits per stored number: 16 takes about half the memory, with a small error.
    #[arg(long, default_value = "32", value_parser = ["32", "16"])]
    pub(crate) storage: String,
    /// Image size in pixels (default 1024x1024).
    #[arg(long, value_name = "WxH", value_parser = values::size, help_heading = "Camera")]
    pub(crate) size: Option<[u32; 2]>,
    /// JSON file with the camera object of a scene file.
    #[arg(long, value_name = "FILE", help_heading = "Camera")]
    pub(crate) camera: Option<PathBuf>,
    /// Draw from all cameras of another program: a COLMAP folder, transforms.json, cameras.json of 3DGS, Open3D's JSON,
    /// K, R and t as JSON, or KITTI's calibration. OUT must contain {name}, the name of a camera's image; --size scales
    /// the images. Files without a scene are lit along the view.
    #[arg(long, value_name = "FILE|DIR", help_heading = "Camera", conflicts_with_all = ["camera", "view", "eye",
        "target", "camera_up", "fov_y", "ortho", "frames", "verify", "print_scene"])]
    pub(crate) cameras: Option<PathBuf>,
    /// View the scene from this side; auto, the default, selects the side that shows most. Also AZIMUTH,ELEVATION in
    /// degrees: 0,0 is front, 90,0 right, 30,20 iso.
    #[arg(long, value_name = "VIEW", value_parser = values::View, conflicts_with_all = ["camera", "eye", "target"],
        allow_hyphen_values = true, help_heading = "Camera")]
    pub(crate) view: Option<ViewChoice>,
    /// Position of the eye.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true,
        help_heading = "Camera")]
    pub(crate) eye: Option<[f64; 3]>,
    /// Point that the camera is aimed at.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true,
        help_heading = "Camera")]
    pub(crate) target: Option<[f64; 3]>,
    /// Direction that appears upward.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::direction, allow_hyphen_values = true,
        help_heading = "Camera")]
    pub(crate) camera_up: Option<[f64; 3]>,
    /// Up axis of the scene: +x, -x, +y, -y, +z or -z, or auto: as the file or its format states, else from its shape.
    #[arg(long, value_name = "AXIS", value_parser = values::up, allow_hyphen_values = true, help_heading = "Camera")]
    pub(crate) up: Option<UpChoice>,
    /// Render only this rectangle of the image, in pixels.
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::region, help_heading = "Camera")]
    pub(crate) region: Option<Region>,
    /// Vertical field of view in degrees.
    #[arg(long, value_name = "DEG", value_parser = values::fov, conflicts_with = "ortho", help_heading = "Camera")]
    pub(crate) fov_y: Option<f64>,
    /// Use a parallel projection.
    #[arg(long, help_heading = "Camera")]
    pub(crate) ortho: bool,
    /// Named trade-off between speed and accuracy.
    #[arg(long, value_parser = values::preset(), help_heading = "Settings")]
    pub(crate) preset: Option<Preset>,
    /// Screen-space filter; for Gaussians drawn over one another, clamp (as they were trained) or principal.
    #[arg(long, value_parser = values::filter(), help_heading = "Settings")]
    pub(crate) filter: Option<Filter>,
    /// Projection of splats to the screen.
    #[arg(long, value_parser = values::mapping(), help_heading = "Settings")]
    pub(crate) mapping: Option<Mapping>,
    /// Kernel cutoff.
    #[arg(long, value_name = "C", value_parser = values::cutoff, help_heading = "Settings")]
    pub(crate) cutoff: Option<f64>,
    /// Least half-width of a filtered splat in pixels.
    #[arg(long, value_name = "PX", value_parser = values::prefilter, help_heading = "Settings")]
    pub(crate) prefilter: Option<f64>,
    /// Depth tolerance: fragments up to K splat radii, or abs:D world units, behind the nearest surface blend with it.
    #[arg(long, value_name = "K|abs:D", value_parser = values::depth_tolerance, help_heading = "Settings")]
    pub(crate) depth_tolerance: Option<DepthTolerance>,
    /// Least precision of sums; on CPUs f16 changes nothing.
    #[arg(long, value_parser = values::accumulate(), help_heading = "Settings")]
    pub(crate) accumulate: Option<Accumulate>,
    /// Method for drawing transparent splats: off, peel:N, peel:N:drop or abuffer:L.
    #[arg(long, value_name = "MODE", value_parser = values::transparency, help_heading = "Settings")]
    pub(crate) transparency: Option<Transparency>,
    /// Compositing of trained Gaussians (2DGS and 3DGS PLY, SPLAT, SPZ, SOG): over one another, as they were trained,
    /// or as opaque surfaces. The default is over if all files are Gaussians and no other flag applies only to
    /// surfaces.
    #[arg(long, value_parser = values::composite(), help_heading = "Settings")]
    pub(crate) composite: Option<Composite>,
    /// Order in which trained Gaussians are drawn over one another: by their centres, as they were trained, or exactly
    /// in each pixel, without popping.
    #[arg(long, value_parser = values::sort(), help_heading = "Settings")]
    pub(crate) sort: Option<Sort>,
    /// Evaluation of clip curves.
    #[arg(long, value_parser = values::clip(), help_heading = "Settings")]
    pub(crate) clip: Option<ClipPolicy>,
    /// Shading of pixels.
    #[arg(long, value_parser = values::shader(), help_heading = "Settings")]
    pub(crate) shader: Option<Shader>,
    /// Image of a lit sphere, which selects the shader matcap: a PNG, JPEG or WebP, or builtin.
    #[arg(long, value_name = "FILE|builtin", help_heading = "Settings")]
    pub(crate) matcap: Option<PathBuf>,
    /// Largest projected splat size in pixels (default 1). Octrees (.surfel) draw polygons where even the finest splats
    /// are larger; from COPC files the levels of detail needed for this size are read.
    #[arg(long, value_name = "PX", value_parser = values::positive, help_heading = "Settings")]
    pub(crate) lod_error: Option<f64>,
    /// Draw all points of COPC files, not only as many as the view needs.
    #[arg(long, help_heading = "Splats")]
    pub(crate) all_levels: bool,
    /// Let lights cast shadows.
    #[arg(long, help_heading = "Settings")]
    pub(crate) shadows: bool,
    /// Antialias edges: by coverage (on), or by several samples per edge pixel (samples).
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "on", value_parser = values::edge_aa(),
          value_name = "on|off|samples", help_heading = "Settings")]
    pub(crate) edge_aa: Option<EdgeAa>,
    /// Background colour: linear R,G,B[,A] with straight alpha, or transparent.
    #[arg(long, value_name = "R,G,B[,A]", value_parser = values::background, allow_hyphen_values = true,
          help_heading = "Settings")]
    pub(crate) background: Option<[f64; 4]>,
    /// Average NxN unfiltered samples per pixel (backend reference only).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64), help_heading = "Settings")]
    pub(crate) samples: Option<u32>,
    /// Number of images; OUT must contain {frame}.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), requires = "turntable",
          help_heading = "Output")]
    pub(crate) frames: Option<u32>,
    /// Turn the scene about its up axis, once over all frames.
    #[arg(long, requires = "frames", help_heading = "Output")]
    pub(crate) turntable: bool,
    /// Draw only these frames or cameras, counted from 0: A-B, or every STEPth with A-B:STEP.
    #[arg(long, value_name = "A-B[:STEP]", value_parser = pieces::frame_range, help_heading = "Pieces of a job")]
    pub(crate) frame_range: Option<FrameRange>,
    /// Draw only shard I of N of the list of images: all frames or cameras of each input. I counts from 0, or from 1:
    /// N/N is 0/N. For more than one image, the default is taken from SLURM_ARRAY_TASK_ID and _COUNT,
    /// JOB_COMPLETION_INDEX and JOB_COMPLETIONS (not set by Kubernetes itself), or AWS_BATCH_JOB_ARRAY_INDEX and _SIZE,
    /// if set.
    #[arg(long, value_name = "I/N", value_parser = values::part, help_heading = "Pieces of a job")]
    pub(crate) shard: Option<surfel::values::Part>,
    /// Draw only band I of N bands of rows, for images too large for one run; `surfel stitch` merges the bands.
    #[arg(long, value_name = "I/N", value_parser = values::part, conflicts_with = "region",
        help_heading = "Pieces of a job")]
    pub(crate) tile: Option<surfel::values::Part>,
    /// Skip images whose files exist, whatever their content. Existing files are complete, because they appear at once.
    #[arg(long, conflicts_with_all = ["force", "verify"], help_heading = "Pieces of a job")]
    pub(crate) skip_existing: bool,
    /// Write a coarse image of some of the points to OUT first, then replace it by finer ones up to the full image.
    /// Each file is complete when it appears.
    #[arg(long, conflicts_with = "skip_existing", help_heading = "Output")]
    pub(crate) progressive: bool,
    /// Print times and counts as JSON on stdout.
    #[arg(long, conflicts_with = "print_scene", help_heading = "Output")]
    pub(crate) stats: bool,
    /// Draw the image with the reference backend too and print both errors; exit with 5 if the preset's promise is
    /// broken.
    #[arg(long, conflicts_with_all = ["frames", "samples", "print_scene"], help_heading = "Output")]
    pub(crate) verify: bool,
    /// Render N times after a warm-up; the statistics are medians.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), help_heading = "Output")]
    pub(crate) repeat: Option<u32>,
    /// Additional planes for EXR or NPZ files, besides colour, Z, normal and weight: index (the nearest splat's row in
    /// its file, and its object), label (see --label), position (world); for trained Gaussians alpha, median_depth,
    /// distortion. Depth (Z) and normal are always included.
    #[arg(long, value_name = "PLANE,...", value_delimiter = ',', help_heading = "Output",
        value_parser = surfel::request::RenderOptions::MORE_PLANES)]
    pub(crate) planes: Vec<String>,
    /// Attribute for the plane label: integers such as classes (default classification).
    #[arg(long, value_name = "ATTRIBUTE", help_heading = "Output")]
    pub(crate) label: Option<String>,
    /// Store colours in EXR files as 32-bit floats.
    #[arg(long, help_heading = "Output")]
    pub(crate) exr_f32: bool,
    /// Write PNG files with 16 bits per sample.
    #[arg(long, help_heading = "Output")]
    pub(crate) png16: bool,
    /// Omit version, scene and inputs from PNG and EXR files; `surfel again` then can't repeat the image.
    #[arg(long, help_heading = "Output")]
    pub(crate) no_metadata: bool,
}

/// Options for converting files to splats, shared by `render` and `convert`.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct SplatArgs {
    /// Read damaged files as far as possible: skip invalid splats and unreadable parts of LAZ and E57 files.
    #[arg(long, help_heading = "Splats")]
    pub(crate) repair: bool,
    /// Sampling of a mesh's colours: per splat as the mean over the square that it represents (point) or under its
    /// kernel (ewa), or for all splats together so that their blend reproduces the mesh (fit). Any other value is a
    /// texture file, for meshes with texture coordinates that name no texture themselves. Both may be given.
    #[arg(long, help_heading = "Splats", value_name = "point|ewa|fit|FILE")]
    pub(crate) texture: Vec<PathBuf>,
    /// Colours of a scan's splats: those of the points, or fitted so that the blended surface has the points' colours
    /// (fit).
    #[arg(long, help_heading = "Splats", value_parser = values::point_colors())]
    pub(crate) colors: Option<PointColors>,
    /// Create one splat per vertex of a mesh.
    #[arg(long, help_heading = "Splats", conflicts_with_all = ["per_face", "splats"])]
    pub(crate) per_vertex: bool,
    /// Create one splat per triangle of a mesh.
    #[arg(long, help_heading = "Splats", conflicts_with = "splats")]
    pub(crate) per_face: bool,
    /// Spread this many splats evenly over a mesh, or auto: as many as its shape and texture need. With --sharp, the
    /// largest number of splats.
    #[arg(long, value_name = "N|auto", value_parser = values::splat_count, help_heading = "Splats")]
    pub(crate) splats: Option<SplatCount>,
    /// Multiply every radius by this factor.
    #[arg(long, help_heading = "Splats", value_name = "K", value_parser = values::positive)]
    pub(crate) radius_scale: Option<f64>,
    /// Use at most this many points of a point cloud, evenly selected; of a COPC file the coarsest (default 10
    /// million).
    #[arg(long, help_heading = "Splats", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_points: Option<u32>,
    /// Memory budget for points, such as 4G or 512M (default 60 % of the machine's memory). Larger point clouds are
    /// refused, and COPC is written in pieces that fit.
    #[arg(long, help_heading = "Splats", value_name = "SIZE", value_parser = values::memory)]
    pub(crate) memory: Option<u64>,
    /// Cull splats that face away, or none; by default those of watertight meshes and clouds. `convert` records the
    /// choice in the file.
    #[arg(long, help_heading = "Splats", value_parser = values::cull())]
    pub(crate) cull: Option<Cull>,
    /// Clip splats along creases: few splats with sharp edges for a mesh, one per point along edges detected in points.
    #[arg(long, help_heading = "Splats", conflicts_with_all = ["per_vertex", "per_face"])]
    pub(crate) sharp: bool,
    /// Angle from which an edge is a crease, with --sharp (default 40).
    #[arg(long, help_heading = "Splats", value_name = "DEG", value_parser = values::angle, requires = "sharp")]
    pub(crate) crease_angle: Option<f64>,
    /// Largest deviation from the mesh that simplification may cause, with --sharp.
    #[arg(long, help_heading = "Splats", value_name = "E", value_parser = values::positive, requires = "sharp")]
    pub(crate) error: Option<f64>,
    /// Colour by an attribute: rgb, height, normal, intensity, classification, or any other attribute of the file.
    #[arg(long, value_name = "ATTRIBUTE", help_heading = "Splats")]
    pub(crate) color_by: Option<String>,
    /// Colour map for --color-by. By default, classes have their own colours; integers with few distinct values get
    /// tab20, intensity grey, and other values viridis.
    #[arg(long, help_heading = "Splats", value_parser = values::colormap())]
    pub(crate) colormap: Option<Colormap>,
    /// Values at the ends of the colour map, with --color-by; by default the 2nd and the 98th percentile of all that an
    /// image shows. With shared, all images of one INPUT each ({input} in OUT) use the range over all inputs.
    #[arg(long, value_name = "LO,HI|shared", value_parser = values::range_choice, allow_hyphen_values = true,
        help_heading = "Splats")]
    pub(crate) range: Option<RangeChoice>,
    /// Write the colour bar of --color-by to an image file; the default name is OUT-colorbar.png.
    #[arg(long, num_args = 0..=1, require_equals = true, value_name = "FILE.png", help_heading = "Splats")]
    pub(crate) colorbar: Option<Option<PathBuf>>,
    /// Colouring of the image, if it is determined before the inputs are loaded.
    #[arg(skip)]
    pub(crate) legend: Option<Arc<Coloring>>,
    /// Use only points and splats within this box, in the file's coordinates.
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = values::crop, allow_hyphen_values = true,
        help_heading = "Splats")]
    pub(crate) crop: Option<[f64; 6]>,
    /// Use only points of these classes, such as 2,6; or all except these: '!7,18'.
    #[arg(long, value_name = "N,...|!N,...", value_parser = values::classes, help_heading = "Splats")]
    pub(crate) classes: Option<Classes>,
    /// Use only these returns of each pulse.
    #[arg(long, help_heading = "Splats", value_parser = values::returns())]
    pub(crate) returns: Option<Returns>,
    /// Use only points that meet a condition such as 'intensity>100 and not (z<=5 or classification=7)', with and, or,
    /// not, && || ! and parentheses. If --where is given several times, all conditions must hold.
    #[arg(long = "where", value_name = "CONDITION", value_parser = values::condition, help_heading = "Splats")]
    pub(crate) condition: Vec<String>,
    /// Use only every Nth of the selected points.
    #[arg(long, help_heading = "Splats", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) every: Option<u32>,
    /// Keep more than 16 points at one place, and points at exactly 0,0,0, which sensors write for "no return".
    #[arg(long, help_heading = "Splats")]
    pub(crate) all_points: bool,
    /// Keep or drop isolated points: those more than 8 times as far from their 8 nearest neighbours as is usual.
    #[arg(long, help_heading = "Splats", value_parser = values::outliers())]
    pub(crate) outliers: Option<Outliers>,
    /// Also read files outside a file's own folder that it refers to (buffers, materials, textures).
    #[arg(long, help_heading = "Splats")]
    pub(crate) allow_outside: bool,
    /// Reduce textures to at most this many texels a side (default 8192).
    #[arg(long, help_heading = "Splats", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32_768))]
    pub(crate) max_texture: Option<u32>,
    /// Column names of tables: text, NPY and NPZ (x,y,z,_,r,g,b; _ skips a column). With types, each of which applies
    /// until the next one, also of binary files without a header (f4:x,y,z,intensity; little-endian): f4 f8 u1 i1 u2 i2
    /// u4 i4 u8 i8.
    #[arg(long, help_heading = "Splats", value_name = "NAME,...", value_parser = values::columns)]
    pub(crate) columns: Option<TableColumns>,
}

impl SplatArgs {
    /// Adopts the colouring shared by all images, like [`surfel::request::SplatOptions::set_coloring`].
    pub(crate) fn take(&mut self, coloring: Coloring) {
        let mut options = surfel::request::SplatOptions::default();
        options.convert.colormap = self.colormap;
        options.set_coloring(coloring);
        self.range = options.convert.range.map(RangeChoice::Values);
        (self.colormap, self.legend) = (options.convert.colormap, options.legend);
    }
}

#[derive(Args, Debug)]
pub(crate) struct AgainArgs {
    /// A PNG or EXR drawn by surfel, with its metadata.
    #[arg(value_name = "IMAGE")]
    pub(crate) image: PathBuf,
    /// Image to write, in the format of IMAGE; by default IMAGE's name with -again in the current folder.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Overwrite an existing file.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// Rendering backend, instead of the one that drew IMAGE.
    #[arg(long, value_parser = ["auto", "cpu", "wgpu", "ash", "reference"])]
    pub(crate) backend: Option<String>,
}

#[derive(Args, Debug)]
pub(crate) struct ConvertArgs {
    /// Points, a mesh or splats; - is stdin. With -o OUT.copc.laz: any number of point files (LAS, LAZ, COPC, PLY, PCD,
    /// NPY, XYZ), or all shards that --shard wrote.
    #[arg(value_name = "INPUT")]
    pub(crate) input: PathBuf,
    /// Additional files for -o OUT.copc.laz.
    #[arg(value_name = "MORE")]
    pub(crate) more: Vec<PathBuf>,
    /// Splat file to write: .ply, or - for stdout. Also .copc.laz for points with levels of detail, normals and radii,
    /// or .shard for a shard of that, where {shard} is replaced by its number.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Overwrite an existing file.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// Options for converting the file to splats.
    #[command(flatten)]
    pub(crate) splats: SplatArgs,
    /// Write an octree of splats of every size with the mesh's own polygons, to -o OUT.surfel.
    #[arg(long, conflicts_with_all = ["per_vertex", "per_face", "splats", "radius_scale", "max_points", "cull", "ascii",
        "repair", "colors", "color_by", "crop", "classes", "returns", "condition", "every", "all_points", "outliers",
        "colorbar", "columns"])]
    pub(crate) hybrid: bool,
    /// Write text instead of binary PLY.
    #[arg(long)]
    pub(crate) ascii: bool,
    /// With -o OUT.copc.laz: save progress in the folder OUT.copc.laz.resume until OUT is complete, and continue an
    /// interrupted run of the same command. Deleting the folder discards the progress. An existing shard of the same
    /// inputs is kept.
    #[arg(long)]
    pub(crate) resume: bool,
    /// Convert only shard I of N of the points, to -o NAME.shard; I counts from 0, or from 1: N/N is 0/N. For such a
    /// name the default is taken from the cluster variables that `surfel render --help` lists, if set.
    #[arg(long, value_name = "I/N", value_parser = values::part)]
    pub(crate) shard: Option<surfel::values::Part>,
}

#[derive(Args, Debug)]
pub(crate) struct OrthoArgs {
    /// Points, splats or meshes with z up, all of one area; - is stdin.
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
    /// Ground sampling distance: side of a pixel, in the units of x and y.
    #[arg(long, value_name = "M", value_parser = values::positive)]
    pub(crate) gsd: f64,
    /// Colour GeoTIFF to write; alpha is 0 at empty pixels.
    #[arg(short, long, value_name = "RGB.tif", required_unless_present_any = ["dsm", "normals"])]
    pub(crate) output: Option<PathBuf>,
    /// GeoTIFF of heights to write (digital surface model); -9999 at empty pixels.
    #[arg(long, value_name = "F.tif")]
    pub(crate) dsm: Option<PathBuf>,
    /// GeoTIFF of unit normals to write; -9999 at empty pixels.
    #[arg(long, value_name = "F.tif")]
    pub(crate) normals: Option<PathBuf>,
    /// Bounds of the image, enlarged to whole pixels; by default those of the data.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = values::bounds, allow_hyphen_values = true)]
    pub(crate) bounds: Option<[f64; 4]>,
    /// Point at which a corner of pixels lies; all pixel edges are whole multiples of --gsd from it.
    #[arg(long, value_name = "X,Y", value_parser = values::place, allow_hyphen_values = true, default_value = "0,0")]
    pub(crate) origin: [f64; 2],
    /// Image size in pixels, with its lower left corner at --origin.
    #[arg(long, value_name = "WxH", value_parser = values::size, conflicts_with = "bounds", requires = "origin")]
    pub(crate) size: Option<[u32; 2]>,
    /// Fill gaps that no circle of this radius (in the units of x and y) fits into, by interpolation. An additional
    /// last band of each image marks the interpolated pixels.
    #[arg(long, value_name = "DISTANCE", value_parser = values::positive)]
    pub(crate) fill: Option<f64>,
    /// Coordinate reference system of the image, instead of the files'.
    #[arg(long, value_name = "EPSG:N", value_parser = values::epsg)]
    pub(crate) crs: Option<u16>,
    /// Overwrite existing files.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// Rendering backend.
    #[arg(long, default_value = "auto", value_parser = ["auto", "cpu", "wgpu", "ash", "reference"])]
    pub(crate) backend: String,
    /// Print times and counts as JSON on stdout.
    #[arg(long)]
    pub(crate) stats: bool,
    /// Options for converting files to splats.
    #[command(flatten)]
    pub(crate) splats: SplatArgs,
}

#[derive(Args, Debug)]
pub(crate) struct InfoArgs {
    /// Splats, points or a mesh; - is stdin.
    #[arg(value_name = "INPUT")]
    pub(crate) input: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Read damaged files as far as possible: skip invalid splats and unreadable parts of LAZ and E57 files.
    #[arg(long)]
    pub(crate) repair: bool,
    /// Also read files outside a file's own folder that it refers to (buffers, materials, textures).
    #[arg(long)]
    pub(crate) allow_outside: bool,
    /// Reduce textures to at most this many texels a side (default 8192).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32_768))]
    pub(crate) max_texture: Option<u32>,
    /// Column names of a table, and types for a binary file without a header: x,y,z,_,r,g,b or f4:x,y,z,intensity, as
    /// for `surfel render`.
    #[arg(long, value_name = "NAME,...", value_parser = values::columns)]
    pub(crate) columns: Option<TableColumns>,
}

#[derive(Args, Debug)]
pub(crate) struct CompareArgs {
    /// Reference image, EXR or PNG.
    #[arg(value_name = "A")]
    pub(crate) a: PathBuf,
    /// Image to compare with A.
    #[arg(value_name = "B")]
    pub(crate) b: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write FLIP's error map to this file.
    #[arg(long, value_name = "D.png")]
    pub(crate) diff: Option<PathBuf>,
    /// Overwrite an existing error map.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// Exit with 5 if a metric (max_abs, rmse, psnr, flip) is above a value; may be given several times.
    #[arg(long, value_name = "METRIC=V", value_parser = values::threshold)]
    pub(crate) fail_above: Vec<Threshold>,
    /// Exit with 5 if a metric is below a value; may be given several times.
    #[arg(long, value_name = "METRIC=V", value_parser = values::threshold)]
    pub(crate) fail_below: Vec<Threshold>,
    /// Exit with 5 if B differs from A, an image with the preset reference, by more than this preset promises.
    #[arg(long, value_parser = values::preset())]
    pub(crate) verify_preset: Option<Preset>,
}

#[derive(Args, Debug)]
pub(crate) struct StitchArgs {
    /// All tiles of one image, PNG or EXR, drawn by surfel with --tile or --region, in any order.
    #[arg(required = true, value_name = "TILE")]
    pub(crate) tiles: Vec<PathBuf>,
    /// Image to write, in the tiles' format; for PNG tiles also .tif.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Overwrite an existing file.
    #[arg(short, long)]
    pub(crate) force: bool,
}

#[derive(Args, Debug)]
pub(crate) struct ServeArgs {
    /// Read a request from each line of stdin and answer with a line on stdout, both JSON; stop at the end of stdin.
    #[arg(long, required = true)]
    pub(crate) stdio: bool,
    /// Scene and drawing options.
    #[command(flatten)]
    pub(crate) render: RenderArgs,
}

/// Job system that runs a job.
#[derive(Args, Clone, Copy, Debug)]
#[group(required = true, multiple = false)]
pub(crate) struct Engine {
    /// Print a job template for OpenJD (Deadline Cloud, openjd-cli), as JSON.
    #[arg(long)]
    pub(crate) openjd: bool,
    /// Print a script for Slurm's sbatch with an array of tasks; run by bash, it also submits a second job that merges
    /// results.
    #[arg(long)]
    pub(crate) slurm: bool,
    /// Print a Kubernetes Job with indexed completions, as JSON; for tiles and shards, also a job that merges their
    /// files.
    #[arg(long)]
    pub(crate) k8s: bool,
    /// Print shell commands, one per line, for OpenCue's cuecmd or GNU parallel.
    #[arg(long)]
    pub(crate) cuecmd: bool,
    /// Print a Snakefile.
    #[arg(long)]
    pub(crate) snakemake: bool,
}

#[derive(Args, Debug)]
pub(crate) struct JobsArgs {
    /// A scene file, splats, points or meshes.
    #[arg(required = true, value_name = "SCENE")]
    pub(crate) inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) engine: Engine,
    /// Images to write; by default {frame}.png, {name}.png or whole.png in the current folder. OUT.copc.laz converts
    /// all inputs, by shards OUT.NUMBER.shard.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Draw a turntable of N images.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) frames: Option<u32>,
    /// Draw only these frames or cameras.
    #[arg(long, value_name = "A-B[:STEP]", value_parser = pieces::frame_range)]
    pub(crate) frame_range: Option<FrameRange>,
    /// Draw from all cameras of another program.
    #[arg(long, value_name = "FILE|DIR", conflicts_with = "frames")]
    pub(crate) cameras: Option<PathBuf>,
    /// Draw one image as N tiles, and merge them.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000),
        conflicts_with_all = ["frames", "cameras", "frame_range"])]
    pub(crate) tiles: Option<u32>,
    /// Number of tasks that the images or points are divided into; by default 64, and at most one per image.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), conflicts_with = "tiles")]
    pub(crate) tasks: Option<u32>,
    /// Container image for --k8s, with surfel on its PATH.
    #[arg(long, value_name = "NAME", default_value = "surfel")]
    pub(crate) image: String,
    /// Flags of `surfel render`, or of `surfel convert`, for all tasks.
    #[arg(last = true, value_name = "FLAG", allow_hyphen_values = true)]
    pub(crate) flags: Vec<String>,
}

#[derive(Args, Debug)]
pub(crate) struct BackendsArgs {
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
pub(crate) struct ViewArgs {
    /// A scene file, splats, points or meshes.
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
}

#[derive(Args, Debug)]
pub(crate) struct CompletionsArgs {
    /// Shell that the script is for.
    pub(crate) shell: Shell,
}

/// Returns the command-line grammar, for completions and the manual page.
pub(crate) fn command() -> clap::Command {
    Cli::command()
}

#[cfg(test)]
mod tests {
    #[test]
    fn grammar_is_consistent() {
        super::command().debug_assert();
    }
}
