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
    /// Say nothing but errors.
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Say more on stderr.
    #[arg(short, long, global = true)]
    pub(crate) verbose: bool,
    /// Threads to use; all by default.
    #[arg(long, global = true, value_name = "N",
        value_parser = clap::value_parser!(u16).range(1..=1024).map(usize::from))]
    pub(crate) threads: Option<usize>,
    /// TOML file of flags: keys are the long flag names; flags on the command line win.
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Render an image.
    Render(Box<RenderArgs>),
    /// Draw an image again, from the scene that it carries.
    Again(AgainArgs),
    /// Make splats of points or a mesh.
    Convert(Box<ConvertArgs>),
    /// Draw an orthoimage, and a surface model, as GeoTIFF.
    Ortho(Box<OrthoArgs>),
    /// Say what a file holds.
    Info(InfoArgs),
    /// Put tiles of an image together.
    Stitch(StitchArgs),
    /// Draw pictures as they are asked for on stdin, of a scene that stays in memory.
    Serve(Box<ServeArgs>),
    /// Print a job for a cluster or a farm that draws a scene, or converts points, in pieces.
    Jobs(JobsArgs),
    /// Measure how far two images are apart.
    Compare(CompareArgs),
    /// List what this machine can run.
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
    /// A scene file (.json), or splats, points or meshes that make one scene; - is stdin. With {input} in OUT each
    /// INPUT gets an image of its own.
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
    /// Image to write: .png, .exr, .npz or .jpg (quality 92, blended onto the background), - for PNG on stdout; may
    /// hold {backend} {frame} {input} {name} {tile}. `surfel INPUT` alone writes INPUT's name with .png to the current
    /// folder.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Overwrite existing files.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// True for `surfel INPUT` without the word `render`, which has a name for the image where -o gives none.
    #[arg(skip)]
    pub(crate) bare: bool,
    /// How files become splats.
    #[command(flatten)]
    pub(crate) splats: SplatArgs,
    /// Write the resolved scene file to stdout, paths relative to the current folder; without -o, render nothing.
    #[arg(long)]
    pub(crate) print_scene: bool,
    /// Who draws.
    #[arg(long, default_value = "auto", value_parser = ["auto", "cpu", "wgpu", "ash", "reference"])]
    pub(crate) backend: String,
    /// A part of the adapter's name.
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// Bits of a stored number: 16 takes about half the memory, with a small error.
    #[arg(long, default_value = "32", value_parser = ["32", "16"])]
    pub(crate) storage: String,
    /// Image size in pixels; 1024x1024 where nothing says it.
    #[arg(long, value_name = "WxH", value_parser = values::size, help_heading = "Camera")]
    pub(crate) size: Option<[u32; 2]>,
    /// A scene file's camera object, alone in a file.
    #[arg(long, value_name = "FILE", help_heading = "Camera")]
    pub(crate) camera: Option<PathBuf>,
    /// Draw from all cameras of another program: a COLMAP folder, transforms.json, cameras.json of 3DGS, Open3D's JSON,
    /// K, R and t as JSON, or KITTI's calibration. OUT must hold {name}, the name of a camera's image; --size scales
    /// the images. Files without a scene are lit along the view.
    #[arg(long, value_name = "FILE|DIR", help_heading = "Camera", conflicts_with_all = ["camera", "view", "eye",
        "target", "camera_up", "fov_y", "ortho", "frames", "verify", "print_scene"])]
    pub(crate) cameras: Option<PathBuf>,
    /// Frame the scene from this side; auto, where nothing is said, finds the one that shows most. Also
    /// AZIMUTH,ELEVATION in degrees: 0,0 is front, 90,0 right, 30,20 iso.
    #[arg(long, value_name = "VIEW", value_parser = values::View, conflicts_with_all = ["camera", "eye", "target"],
        allow_hyphen_values = true, help_heading = "Camera")]
    pub(crate) view: Option<ViewChoice>,
    /// Position of the eye.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true,
        help_heading = "Camera")]
    pub(crate) eye: Option<[f64; 3]>,
    /// Point to look at.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true,
        help_heading = "Camera")]
    pub(crate) target: Option<[f64; 3]>,
    /// Direction that appears upward.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::direction, allow_hyphen_values = true,
        help_heading = "Camera")]
    pub(crate) camera_up: Option<[f64; 3]>,
    /// The scene's up axis: +x, -x, +y, -y, +z or -z, or auto: as the file or its format says, else by the shape.
    #[arg(long, value_name = "AXIS", value_parser = values::up, allow_hyphen_values = true, help_heading = "Camera")]
    pub(crate) up: Option<UpChoice>,
    /// Render only this crop of the image, in pixels.
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::region, help_heading = "Camera")]
    pub(crate) region: Option<Region>,
    /// Vertical field of view in degrees.
    #[arg(long, value_name = "DEG", value_parser = values::fov, conflicts_with = "ortho", help_heading = "Camera")]
    pub(crate) fov_y: Option<f64>,
    /// Parallel projection.
    #[arg(long, help_heading = "Camera")]
    pub(crate) ortho: bool,
    /// Named trade of speed for accuracy.
    #[arg(long, value_parser = values::preset(), help_heading = "Settings")]
    pub(crate) preset: Option<Preset>,
    /// Screen-space filter; of trained Gaussians drawn over one another clamp, as they were trained, or principal.
    #[arg(long, value_parser = values::filter(), help_heading = "Settings")]
    pub(crate) filter: Option<Filter>,
    /// How splats are mapped to the screen.
    #[arg(long, value_parser = values::mapping(), help_heading = "Settings")]
    pub(crate) mapping: Option<Mapping>,
    /// Kernel cutoff.
    #[arg(long, value_name = "C", value_parser = values::cutoff, help_heading = "Settings")]
    pub(crate) cutoff: Option<f64>,
    /// Least half-width of a filtered splat, in pixels.
    #[arg(long, value_name = "PX", value_parser = values::prefilter, help_heading = "Settings")]
    pub(crate) prefilter: Option<f64>,
    /// How far behind the nearest surface splats still blend: K radii, or abs:D world units.
    #[arg(long, value_name = "K|abs:D", value_parser = values::depth_tolerance, help_heading = "Settings")]
    pub(crate) depth_tolerance: Option<DepthTolerance>,
    /// Precision of sums, at least: on CPUs f16 changes nothing.
    #[arg(long, value_parser = values::accumulate(), help_heading = "Settings")]
    pub(crate) accumulate: Option<Accumulate>,
    /// How transparent splats are drawn: off, peel:N, peel:N:drop or abuffer:L.
    #[arg(long, value_name = "MODE", value_parser = values::transparency, help_heading = "Settings")]
    pub(crate) transparency: Option<Transparency>,
    /// Trained Gaussians (2DGS and 3DGS PLY, SPLAT, SPZ, SOG): each over the next, as they were trained, or as opaque
    /// surfaces; over where they are alone and no other flag is for surfaces.
    #[arg(long, value_parser = values::composite(), help_heading = "Settings")]
    pub(crate) composite: Option<Composite>,
    /// Order in which trained Gaussians are drawn over one another: by their centres, as trained, or exact in each
    /// pixel, where nothing pops.
    #[arg(long, value_parser = values::sort(), help_heading = "Settings")]
    pub(crate) sort: Option<Sort>,
    /// How clip curves are evaluated.
    #[arg(long, value_parser = values::clip(), help_heading = "Settings")]
    pub(crate) clip: Option<ClipPolicy>,
    /// How pixels are shaded.
    #[arg(long, value_parser = values::shader(), help_heading = "Settings")]
    pub(crate) shader: Option<Shader>,
    /// Image of a lit sphere for the shader matcap, which this chooses: a PNG, JPEG or WebP, or builtin.
    #[arg(long, value_name = "FILE|builtin", help_heading = "Settings")]
    pub(crate) matcap: Option<PathBuf>,
    /// Octrees (.surfel): draw splats of at most this many pixels, and polygons where even the finest are larger; COPC
    /// files: the levels that this takes. 1 where nothing says it.
    #[arg(long, value_name = "PX", value_parser = values::positive, help_heading = "Settings")]
    pub(crate) lod_error: Option<f64>,
    /// COPC: draw all points, not only as many as the view needs.
    #[arg(long, help_heading = "Splats")]
    pub(crate) all_levels: bool,
    /// Lights cast shadows.
    #[arg(long, help_heading = "Settings")]
    pub(crate) shadows: bool,
    /// Antialias edges: by coverage (on), or by samples of the pixels there.
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "on", value_parser = values::edge_aa(),
          value_name = "on|off|samples", help_heading = "Settings")]
    pub(crate) edge_aa: Option<EdgeAa>,
    /// Background: linear R,G,B[,A] with straight alpha, or transparent.
    #[arg(long, value_name = "R,G,B[,A]", value_parser = values::background, allow_hyphen_values = true,
          help_heading = "Settings")]
    pub(crate) background: Option<[f64; 4]>,
    /// Average NxN unfiltered samples a pixel (backend reference only).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64), help_heading = "Settings")]
    pub(crate) samples: Option<u32>,
    /// Number of images; OUT must hold {frame}.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), requires = "turntable",
          help_heading = "Output")]
    pub(crate) frames: Option<u32>,
    /// Turn the scene about its up axis, once over all frames.
    #[arg(long, requires = "frames", help_heading = "Output")]
    pub(crate) turntable: bool,
    /// Only these frames or cameras, which count from 0: A-B, or every STEPth with A-B:STEP.
    #[arg(long, value_name = "A-B[:STEP]", value_parser = pieces::frame_range, help_heading = "Pieces of a job")]
    pub(crate) frame_range: Option<FrameRange>,
    /// Only part I of N of the list of pictures: of each input all frames or cameras. I counts from 0, or from 1: N/N
    /// is 0/N. Of more than one picture, it is taken from SLURM_ARRAY_TASK_ID and _COUNT, JOB_COMPLETION_INDEX and
    /// JOB_COMPLETIONS (set it: Kubernetes doesn't), or AWS_BATCH_JOB_ARRAY_INDEX and _SIZE, where they are set.
    #[arg(long, value_name = "I/N", value_parser = values::part, help_heading = "Pieces of a job")]
    pub(crate) shard: Option<surfel::values::Part>,
    /// Only band I of N bands of rows, which `surfel stitch` puts together: for images too large for one run.
    #[arg(long, value_name = "I/N", value_parser = values::part, conflicts_with = "region",
        help_heading = "Pieces of a job")]
    pub(crate) tile: Option<surfel::values::Part>,
    /// Leave out pictures whose files exist, whatever they show; those are whole, because files appear at once.
    #[arg(long, conflicts_with_all = ["force", "verify"], help_heading = "Pieces of a job")]
    pub(crate) skip_existing: bool,
    /// First a picture of a part of the points, which is soon in OUT; then OUT again, whole each time, until it is what
    /// it is without this flag.
    #[arg(long, conflicts_with = "skip_existing", help_heading = "Output")]
    pub(crate) progressive: bool,
    /// Print times and counts as JSON on stdout.
    #[arg(long, conflicts_with = "print_scene", help_heading = "Output")]
    pub(crate) stats: bool,
    /// Draw it by the reference too and print both errors; exit with 5 if the preset's promise is broken.
    #[arg(long, conflicts_with_all = ["frames", "samples", "print_scene"], help_heading = "Output")]
    pub(crate) verify: bool,
    /// Render N times after a warm-up; the statistics are medians.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), help_heading = "Output")]
    pub(crate) repeat: Option<u32>,
    /// Planes that an EXR or NPZ file gets besides colour, Z, normal and weight: index (the row of the nearest splat in
    /// its file, and its object), label (see --label), position (world); of trained Gaussians alpha, median_depth,
    /// distortion. Depth (Z) and normal are there anyway.
    #[arg(long, value_name = "PLANE,...", value_delimiter = ',', help_heading = "Output",
        value_parser = surfel::request::RenderOptions::MORE_PLANES)]
    pub(crate) planes: Vec<String>,
    /// The attribute that the plane label shows, whole numbers such as classes; classification where nothing says it.
    #[arg(long, value_name = "ATTRIBUTE", help_heading = "Output")]
    pub(crate) label: Option<String>,
    /// Colour in EXR files as 32-bit floats.
    #[arg(long, help_heading = "Output")]
    pub(crate) exr_f32: bool,
    /// 16 bits a sample in PNG files.
    #[arg(long, help_heading = "Output")]
    pub(crate) png16: bool,
    /// Leave version, scene and inputs out of PNG and EXR files; `surfel again` then can't repeat the image.
    #[arg(long, help_heading = "Output")]
    pub(crate) no_metadata: bool,
}

/// How files become splats: for `render` and `convert` alike.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct SplatArgs {
    /// Drop invalid splats, and take what is whole of a LAZ or E57 file that is damaged, instead of refusing the file.
    #[arg(long, help_heading = "Splats")]
    pub(crate) repair: bool,
    /// How splats take a mesh's colours: each by itself (point), by its kernel (ewa), or all together, so that their
    /// blend is the mesh's (fit). Anything else is a texture's file, for meshes that have texture coordinates and name
    /// none themselves; both may be given.
    #[arg(long, help_heading = "Splats", value_name = "point|ewa|fit|FILE")]
    pub(crate) texture: Vec<PathBuf>,
    /// Colours of a scan's splats: the points' own, or such that the blended surface passes through these (fit).
    #[arg(long, help_heading = "Splats", value_parser = values::point_colors())]
    pub(crate) colors: Option<PointColors>,
    /// One splat for each vertex of a mesh.
    #[arg(long, help_heading = "Splats", conflicts_with_all = ["per_face", "splats"])]
    pub(crate) per_vertex: bool,
    /// One splat for each triangle of a mesh.
    #[arg(long, help_heading = "Splats", conflicts_with = "splats")]
    pub(crate) per_face: bool,
    /// This many splats spread evenly over a mesh, or auto: as many as its shape and texture ask for; with --sharp, at
    /// most this many, where they are needed.
    #[arg(long, value_name = "N|auto", value_parser = values::splat_count, help_heading = "Splats")]
    pub(crate) splats: Option<SplatCount>,
    /// Multiplies every radius.
    #[arg(long, help_heading = "Splats", value_name = "K", value_parser = values::positive)]
    pub(crate) radius_scale: Option<f64>,
    /// At most this many points of a point cloud, evenly chosen; of a COPC file the coarsest (default 10 million).
    #[arg(long, help_heading = "Splats", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_points: Option<u32>,
    /// Memory that points may take, such as 4G or 512M (default 60 % of the machine's): more than fit are refused, and
    /// COPC is written in pieces that do.
    #[arg(long, help_heading = "Splats", value_name = "SIZE", value_parser = values::memory)]
    pub(crate) memory: Option<u64>,
    /// Leave out splats that face away, or none; by default those of closed meshes and clouds. `convert` notes it
    /// in the file.
    #[arg(long, help_heading = "Splats", value_parser = values::cull())]
    pub(crate) cull: Option<Cull>,
    /// Clip splats along creases: few ones with sharp edges for a mesh, one a point where points show edges.
    #[arg(long, help_heading = "Splats", conflicts_with_all = ["per_vertex", "per_face"])]
    pub(crate) sharp: bool,
    /// Angle from which an edge is a crease, with --sharp (default 40).
    #[arg(long, help_heading = "Splats", value_name = "DEG", value_parser = values::angle, requires = "sharp")]
    pub(crate) crease_angle: Option<f64>,
    /// Largest distance from the mesh that simplification may cause, with --sharp.
    #[arg(long, help_heading = "Splats", value_name = "E", value_parser = values::positive, requires = "sharp")]
    pub(crate) error: Option<f64>,
    /// Colour by this: rgb, height, normal, intensity, classification, or any other attribute of the file.
    #[arg(long, value_name = "ATTRIBUTE", help_heading = "Splats")]
    pub(crate) color_by: Option<String>,
    /// Colours of values, with --color-by; by default classes have their own, few whole numbers tab20, intensity grey,
    /// other values viridis.
    #[arg(long, help_heading = "Splats", value_parser = values::colormap())]
    pub(crate) colormap: Option<Colormap>,
    /// Values at the ends of the colour map, with --color-by; where nothing says it the 2nd and the 98th percentile of
    /// all that an image shows. With shared, images of one INPUT each ({input} in OUT) have the range of all.
    #[arg(long, value_name = "LO,HI|shared", value_parser = values::range_choice, allow_hyphen_values = true,
        help_heading = "Splats")]
    pub(crate) range: Option<RangeChoice>,
    /// Write the colours of --color-by with their values as an image of its own: OUT-colorbar.png without a name.
    #[arg(long, num_args = 0..=1, require_equals = true, value_name = "FILE.png", help_heading = "Splats")]
    pub(crate) colorbar: Option<Option<PathBuf>>,
    /// Colouring that the image shows, if it is known before the inputs are loaded.
    #[arg(skip)]
    pub(crate) legend: Option<Arc<Coloring>>,
    /// Only points and splats within this box, in the file's coordinates.
    #[arg(long, value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = values::crop, allow_hyphen_values = true,
        help_heading = "Splats")]
    pub(crate) crop: Option<[f64; 6]>,
    /// Only points of these classes, such as 2,6; or of all but these: '!7,18'.
    #[arg(long, value_name = "N,...|!N,...", value_parser = values::classes, help_heading = "Splats")]
    pub(crate) classes: Option<Classes>,
    /// Only these of a pulse's returns.
    #[arg(long, help_heading = "Splats", value_parser = values::returns())]
    pub(crate) returns: Option<Returns>,
    /// Only points for which this holds: comparisons such as 'intensity>100 and not (z<=5 or classification=7)', with
    /// and, or, not, && || ! and parentheses. Of several --where, all must hold.
    #[arg(long = "where", value_name = "CONDITION", value_parser = values::condition, help_heading = "Splats")]
    pub(crate) condition: Vec<String>,
    /// Only every Nth point of those that are left.
    #[arg(long, help_heading = "Splats", value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) every: Option<u32>,
    /// Keep more than 16 points in one place, and those at exactly 0,0,0, where sensors write that nothing came back.
    #[arg(long, help_heading = "Splats")]
    pub(crate) all_points: bool,
    /// Keep points that stand alone, or drop those that are more than 8 times as far from their 8 nearest as is usual.
    #[arg(long, help_heading = "Splats", value_parser = values::outliers())]
    pub(crate) outliers: Option<Outliers>,
    /// Read what a file refers to (buffers, materials, textures) outside of its own folder, too.
    #[arg(long, help_heading = "Splats")]
    pub(crate) allow_outside: bool,
    /// Reduce textures to this many texels a side (default 8192).
    #[arg(long, help_heading = "Splats", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32_768))]
    pub(crate) max_texture: Option<u32>,
    /// Names of the columns of tables: text, NPY and NPZ (x,y,z,_,r,g,b; _ leaves a column out). With types, which hold
    /// until the next, also of binary files without a header (f4:x,y,z,intensity; little-endian): f4 f8 u1 i1 u2 i2
    /// u4 i4 u8 i8.
    #[arg(long, help_heading = "Splats", value_name = "NAME,...", value_parser = values::columns)]
    pub(crate) columns: Option<TableColumns>,
}

impl SplatArgs {
    /// Takes the colouring of all images, as [`surfel::request::SplatOptions::set_coloring`] has it.
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
    /// A PNG or EXR that surfel drew, with its metadata.
    #[arg(value_name = "IMAGE")]
    pub(crate) image: PathBuf,
    /// Image to write, in the image's format; IMAGE's name with -again in the current folder where nothing says
    /// it.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Overwrite an existing file.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// Who draws, instead of the backend that drew the image.
    #[arg(long, value_parser = ["auto", "cpu", "wgpu", "ash", "reference"])]
    pub(crate) backend: Option<String>,
}

#[derive(Args, Debug)]
pub(crate) struct ConvertArgs {
    /// Points, a mesh or splats; - is stdin. With -o OUT.copc.laz: any number of files of points (LAS, LAZ, COPC, PLY,
    /// PCD, NPY, XYZ), or all that --shard wrote of them.
    #[arg(value_name = "INPUT")]
    pub(crate) input: PathBuf,
    /// More files, for -o OUT.copc.laz.
    #[arg(value_name = "MORE")]
    pub(crate) more: Vec<PathBuf>,
    /// Splat file to write: .ply, - for stdout; or .copc.laz: the points, by levels, with their splats' normals and
    /// radii; or .shard: a share of that, where {shard} is its number.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Overwrite an existing file.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// How the file becomes splats.
    #[command(flatten)]
    pub(crate) splats: SplatArgs,
    /// Splats of every size and the mesh's own polygons, in an octree: -o OUT.surfel.
    #[arg(long, conflicts_with_all = ["per_vertex", "per_face", "splats", "radius_scale", "max_points", "cull", "ascii",
        "repair", "colors", "color_by", "crop", "classes", "returns", "condition", "every", "all_points", "outliers",
        "colorbar", "columns"])]
    pub(crate) hybrid: bool,
    /// Write text instead of binary PLY.
    #[arg(long)]
    pub(crate) ascii: bool,
    /// Of -o OUT.copc.laz: keep what is done in the folder OUT.copc.laz.resume until OUT is there, and go on with what
    /// an interrupted run of the same command left. Deleting the folder gives that up. A share that is there, of the
    /// same inputs, stays as it is.
    #[arg(long)]
    pub(crate) resume: bool,
    /// Only share I of N of the points, as -o NAME.shard; I counts from 0, or from 1: N/N is 0/N. With such a name it
    /// is taken from the variables of clusters that `surfel render --help` lists, where they are set.
    #[arg(long, value_name = "I/N", value_parser = values::part)]
    pub(crate) shard: Option<surfel::values::Part>,
}

#[derive(Args, Debug)]
pub(crate) struct OrthoArgs {
    /// Points, splats or meshes whose z is up, as of one ground; - is stdin.
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
    /// Ground sampling distance: side of a pixel, in the units of x and y.
    #[arg(long, value_name = "M", value_parser = values::positive)]
    pub(crate) gsd: f64,
    /// GeoTIFF to write: colours, and alpha 0 where nothing is.
    #[arg(short, long, value_name = "RGB.tif", required_unless_present_any = ["dsm", "normals"])]
    pub(crate) output: Option<PathBuf>,
    /// GeoTIFF of heights to write (digital surface model), -9999 where nothing is.
    #[arg(long, value_name = "F.tif")]
    pub(crate) dsm: Option<PathBuf>,
    /// GeoTIFF of unit normals to write, -9999 where nothing is.
    #[arg(long, value_name = "F.tif")]
    pub(crate) normals: Option<PathBuf>,
    /// What to draw, grown to whole pixels; all where nothing says it.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = values::bounds, allow_hyphen_values = true)]
    pub(crate) bounds: Option<[f64; 4]>,
    /// A corner of pixels: all edges of pixels are whole multiples of --gsd from there.
    #[arg(long, value_name = "X,Y", value_parser = values::place, allow_hyphen_values = true, default_value = "0,0")]
    pub(crate) origin: [f64; 2],
    /// Image size in pixels, with its lower left corner at --origin.
    #[arg(long, value_name = "WxH", value_parser = values::size, conflicts_with = "bounds", requires = "origin")]
    pub(crate) size: Option<[u32; 2]>,
    /// Close gaps that no circle of this radius (in the units of x and y) fits into, by interpolation. A last band of
    /// each image marks the pixels that are interpolated.
    #[arg(long, value_name = "DISTANCE", value_parser = values::positive)]
    pub(crate) fill: Option<f64>,
    /// Coordinate reference system of the image, in place of the files'.
    #[arg(long, value_name = "EPSG:N", value_parser = values::epsg)]
    pub(crate) crs: Option<u16>,
    /// Overwrite existing files.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// Who draws.
    #[arg(long, default_value = "auto", value_parser = ["auto", "cpu", "wgpu", "ash", "reference"])]
    pub(crate) backend: String,
    /// Print times and counts as JSON on stdout.
    #[arg(long)]
    pub(crate) stats: bool,
    /// How files become splats.
    #[command(flatten)]
    pub(crate) splats: SplatArgs,
}

#[derive(Args, Debug)]
pub(crate) struct InfoArgs {
    /// Splats, points or a mesh; - is stdin.
    #[arg(value_name = "INPUT")]
    pub(crate) input: PathBuf,
    /// As JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Drop invalid splats, and take what is whole of a LAZ or E57 file that is damaged, instead of refusing the file.
    #[arg(long)]
    pub(crate) repair: bool,
    /// Read what a file refers to (buffers, materials, textures) outside of its own folder, too.
    #[arg(long)]
    pub(crate) allow_outside: bool,
    /// Reduce textures to this many texels a side (default 8192).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=32_768))]
    pub(crate) max_texture: Option<u32>,
    /// Names of the columns of a table, and types of those of a binary file without a header: x,y,z,_,r,g,b or
    /// f4:x,y,z,intensity, as for `surfel render`.
    #[arg(long, value_name = "NAME,...", value_parser = values::columns)]
    pub(crate) columns: Option<TableColumns>,
}

#[derive(Args, Debug)]
pub(crate) struct CompareArgs {
    /// The reference image, EXR or PNG.
    #[arg(value_name = "A")]
    pub(crate) a: PathBuf,
    /// The image to judge.
    #[arg(value_name = "B")]
    pub(crate) b: PathBuf,
    /// As JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write FLIP's error map.
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
    /// Exit with 5 if B is farther from A, an image by the preset reference, than this preset promises.
    #[arg(long, value_parser = values::preset())]
    pub(crate) verify_preset: Option<Preset>,
}

#[derive(Args, Debug)]
pub(crate) struct StitchArgs {
    /// All tiles of one image, PNG or EXR, that surfel drew by --tile or --region, in any order.
    #[arg(required = true, value_name = "TILE")]
    pub(crate) tiles: Vec<PathBuf>,
    /// Image to write, in the tiles' format; of PNGs also a .tif.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Overwrite an existing file.
    #[arg(short, long)]
    pub(crate) force: bool,
}

#[derive(Args, Debug)]
pub(crate) struct ServeArgs {
    /// Read a request from each line of stdin and answer it by a line on stdout, both JSON; ends where stdin does.
    #[arg(long, required = true)]
    pub(crate) stdio: bool,
    /// The scene and how it is drawn.
    #[command(flatten)]
    pub(crate) render: RenderArgs,
}

/// What runs a job.
#[derive(Args, Clone, Copy, Debug)]
#[group(required = true, multiple = false)]
pub(crate) struct Engine {
    /// A job template of OpenJD (Deadline Cloud, openjd-cli), as JSON.
    #[arg(long)]
    pub(crate) openjd: bool,
    /// A script for Slurm's sbatch: an array of tasks; or for bash, where it submits a second job that needs them all.
    #[arg(long)]
    pub(crate) slurm: bool,
    /// A Kubernetes Job with indexed completions, as JSON; for tiles and shares with one that waits for their files.
    #[arg(long)]
    pub(crate) k8s: bool,
    /// Shell commands, one a line, as OpenCue's cuecmd and GNU parallel take them.
    #[arg(long)]
    pub(crate) cuecmd: bool,
    /// A Snakefile.
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
    /// The images; {frame}.png, {name}.png or whole.png in the current folder where nothing says it. OUT.copc.laz is a
    /// conversion of all inputs, by shares OUT.NUMBER.shard.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Draw a turntable of N images.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) frames: Option<u32>,
    /// Only these frames or cameras.
    #[arg(long, value_name = "A-B[:STEP]", value_parser = pieces::frame_range)]
    pub(crate) frame_range: Option<FrameRange>,
    /// Draw from all cameras of another program.
    #[arg(long, value_name = "FILE|DIR", conflicts_with = "frames")]
    pub(crate) cameras: Option<PathBuf>,
    /// Draw one image by N tiles, and put them together.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000),
        conflicts_with_all = ["frames", "cameras", "frame_range"])]
    pub(crate) tiles: Option<u32>,
    /// Tasks that the pictures or points are shared out to; 64 where nothing says it, and at most one a picture.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), conflicts_with = "tiles")]
    pub(crate) tasks: Option<u32>,
    /// The container image of --k8s, which has surfel on its PATH.
    #[arg(long, value_name = "NAME", default_value = "surfel")]
    pub(crate) image: String,
    /// Flags of `surfel render`, or of `surfel convert`, for all tasks.
    #[arg(last = true, value_name = "FLAG", allow_hyphen_values = true)]
    pub(crate) flags: Vec<String>,
}

#[derive(Args, Debug)]
pub(crate) struct BackendsArgs {
    /// As JSON.
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
    /// The shell.
    pub(crate) shell: Shell,
}

/// The grammar, for completions and the manual page.
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
