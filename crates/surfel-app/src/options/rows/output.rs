//! Options for the files that commands write, for several images and for jobs.

use crate::options::row::{Commands, Group, Row, put, put_path};
use crate::render_options::RenderOptions;
use crate::values;

const fn output(row: Row) -> Row {
    row.of(Group::Output, Commands::RENDER)
}

const fn output_of(value: &'static str, commands: Commands) -> Row {
    Row::path("output", value, |o, path| put_path(&mut o.output, path))
        .letter('o')
        .of(Group::Output, commands)
        .everyday()
        .example("out.png")
        .synonyms(&["out", "to", "save", "write"])
}

const fn series(row: Row) -> Row {
    row.of(Group::Series, Commands::RENDER)
}

const fn job(row: Row) -> Row {
    row.of(Group::Jobs, Commands::RENDER)
}

pub(super) const ROWS: &[Row] = &[
    output_of("OUT", Commands::RENDER).help(
        "Image to write: .png, .exr, .npz or .jpg (quality 92, blended onto the background), or - for PNG on stdout; \
         or a film: .mp4 (encoded by the installed ffmpeg), .gif or .apng.",
        "The name may contain {backend} {frame} {input} {name} {tile}. `surfel INPUT` alone writes INPUT's name with \
         .png to the current folder.",
    ),
    output_of("OUT", Commands::AGAIN)
        .help("Image to write, in the format of IMAGE; by default IMAGE's name with -again in the current folder.", ""),
    output_of("OUT", Commands::CONVERT)
        .help(
            "Splat file to write: .ply, or - for stdout.",
            "Also .copc.laz for points with levels of detail, normals and radii, or .shard for a shard of that, where \
             {shard} is replaced by its number.",
        )
        .required(&[]),
    output_of("RGB.tif", Commands::ORTHO)
        .help("Colour GeoTIFF to write; alpha is 0 at empty pixels.", "")
        .required(&["dsm", "normals"]),
    output_of("FIG", Commands::FIGURE)
        .help("Figure to write: .pdf or .svg, with words as text, or .png; - is PNG on stdout.", "")
        .required(&[]),
    output(Row::switch("force", |o, on| {
        o.force = on;
        o.render.splats.force = on;
    }))
    .letter('f')
    .of(Group::Output, Commands::SPLATS.without(Commands::VIEW).and(Commands::AGAIN))
    .keyword(Commands::RENDER)
    .help("Overwrite existing files.", "")
    .everyday()
    .synonyms(&["overwrite", "yes", "replace", "y"]),
    output(Row::switch("print-scene", |o, on| o.print_scene = on)).help(
        "Write the resolved scene file to stdout, with paths relative to the current folder; without -o, render \
         nothing.",
        "",
    ),
    output(Row::switch("png16", |o, on| o.png16 = on))
        .of(Group::Output, Commands::IMAGE_FILES)
        .help("Write PNG files with 16 bits per sample.", "")
        .drawn()
        .synonyms(&["16-bit", "bit-depth", "depth"]),
    output(Row::switch("exr-f32", |o, on| o.exr_f32 = on))
        .of(Group::Output, Commands::IMAGE_FILES)
        .help("Store colours in EXR files as 32-bit floats.", "")
        .drawn(),
    output(Row::text("planes", "PLANE,...", |o, text| {
        let planes: Vec<String> = text.split(',').map(|plane| plane.trim().to_owned()).collect();
        let more = RenderOptions::MORE_PLANES;
        if planes.iter().any(|plane| !more.contains(&plane.as_str())) {
            return Err(format!("expected some of {}", more.join(", ")));
        }
        o.render.planes = planes;
        Ok(())
    }))
    .of(Group::Output, Commands::IMAGE_FILES)
    .image()
    .keyword(Commands::NONE)
    .names(|| RenderOptions::MORE_PLANES.to_vec())
    .list()
    .drawn()
    .help(
        "Additional planes for EXR or NPZ files, besides colour, Z, normal and weight: index (the nearest splat's row \
         in its file, and its object), label (see --label), position (world); for trained Gaussians alpha, \
         median_depth, distortion.",
        "Depth (Z) and normal are always included.",
    )
    .synonyms(&["channels", "aov", "layers", "passes"]),
    output(Row::text("label", "ATTRIBUTE", |o, text| put(&mut o.render.label, Ok(text.to_owned()))))
        .of(Group::Output, Commands::IMAGE_FILES)
        .image()
        .drawn()
        .help("Attribute for the plane label: integers such as classes (default classification).", "")
        .python("str")
        .example("classification")
        .synonyms(&["segmentation", "instance"]),
    output(Row::switch("progressive", |o, on| o.progressive = on))
        .help(
            "Write a coarse image of some of the points to OUT first, then replace it by finer ones up to the full \
             image.",
            "Each file is complete when it appears.",
        )
        .conflicts(&["skip-existing"]),
    output(Row::switch("no-metadata", |o, on| o.no_metadata = on))
        .of(Group::Output, Commands::IMAGES)
        .help("Omit version, scene and inputs from PNG and EXR files; `surfel again` then can't repeat the image.", "")
        .synonyms(&["strip"]),
    output(Row::switch("json", |o, on| o.json = on))
        .of(Group::Output, Commands::INFO)
        .help("Print JSON.", "")
        .everyday(),
    output(Row::switch("hybrid", |o, on| o.hybrid = on))
        .of(Group::Output, Commands::CONVERT)
        .help("Write an octree of splats of every size with the mesh's own polygons, to -o OUT.surfel.", "")
        .everyday()
        .conflicts(&[
            "per-vertex",
            "per-face",
            "splats",
            "radius-scale",
            "max-points",
            "cull",
            "ascii",
            "repair",
            "colors",
            "color-by",
            "crop",
            "classes",
            "returns",
            "where",
            "every",
            "all-points",
            "outliers",
            "colorbar",
            "columns",
        ])
        .synonyms(&["octree", "lod"]),
    output(Row::switch("ascii", |o, on| o.ascii = on))
        .of(Group::Output, Commands::CONVERT)
        .help("Write text instead of binary PLY.", "")
        .synonyms(&["text"]),
    output(Row::switch("stats", |o, on| o.stats = on))
        .of(Group::Output, Commands::RENDER.and(Commands::ORTHO))
        .help("Print times and counts as JSON on stdout.", "")
        .expert()
        .conflicts(&["print-scene"])
        .synonyms(&["time", "timing", "benchmark", "profile"]),
    output(Row::text("repeat", "N", |o, text| put(&mut o.repeat, values::whole(text, 1..=100_000))))
        .help("Render N times after a warm-up; the statistics are medians.", "")
        .expert()
        .example("7")
        .synonyms(&["iterations", "runs"]),
    output(Row::switch("verify", |o, on| o.render.verify = on))
        .help(
            "Draw the image with the reference backend too and print both errors; exit with 5 if the preset's promise \
             is broken.",
            "",
        )
        .expert()
        .conflicts(&["frames", "samples", "print-scene", "turntable", "path", "sequence"])
        .built(cfg!(feature = "reference"))
        .synonyms(&["check", "validate"]),
    series(Row::text("frames", "N", |o, text| put(&mut o.frames, values::whole(text, 1..=1_000_000))))
        .help(
            "Number of images of --turntable or --path; OUT names a film, or contains {frame}.",
            "By default a film of a turn lasts 4 seconds, and one along a path as long as its times state, or 2 \
             seconds from key to key.",
        )
        .everyday()
        .example("7")
        .synonyms(&["frame-count", "n-frames", "images"]),
    series(Row::switch("turntable", |o, on| o.render.turntable = on))
        .help("Turn the scene about its up axis, once over all frames.", "")
        .everyday()
        .synonyms(&["orbit", "spin", "turn", "animate", "animation", "movie"]),
    series(Row::path("path", "KEYS.json", |o, path| put_path(&mut o.path, path)))
        .help(
            "Move the camera smoothly through the keys of a JSON file, cameras as in scene files with optional times.",
            "`surfel view` copies such a file of the views that it keeps.",
        )
        .example("keys.json")
        .conflicts(&["camera", "view", "eye", "target", "camera-up", "fov-y", "ortho", "turntable"])
        .synonyms(&["keys", "keyframes", "camera-path", "fly", "flythrough", "spline"]),
    series(Row::switch("sequence", |o, on| o.sequence = on))
        .help(
            "Each INPUT is a frame, in this order, not an object of one scene.",
            "Camera, light, up axis, colours and the size of balls are chosen once, from up to 12 of the files.",
        )
        .conflicts(&["frames", "progressive", "tile"])
        .synonyms(&["time-series", "timeseries", "temporal", "4d", "animate-files"]),
    series(Row::text("fps", "N", |o, text| put(&mut o.fps, values::frame_rate(text))))
        .help("Frames a second of a film (default 25); a GIF has at most 50.", "")
        .example("7")
        .synonyms(&["framerate", "frame-rate", "rate"]),
    series(Row::path("cameras", "FILE|DIR", |o, path| {
        o.render.cameras = true;
        put_path(&mut o.cameras, path)
    }))
    .help(
        "Draw from all cameras of another program: a COLMAP folder, transforms.json, cameras.json of 3DGS, Open3D's \
         JSON, K, R and t as JSON, or KITTI's calibration.",
        "OUT must contain {name}, the name of a camera's image; --size scales the images. Files without a scene are \
         lit along the view.",
    )
    .example("cameras.json")
    .conflicts(&[
        "camera",
        "view",
        "eye",
        "target",
        "camera-up",
        "fov-y",
        "ortho",
        "frames",
        "turntable",
        "path",
        "sequence",
        "verify",
        "print-scene",
    ])
    .synonyms(&["poses", "colmap", "transforms", "trajectory"]),
    series(Row::text("frame-range", "A-B[:STEP]", |o, text| put(&mut o.frame_range, values::frame_range(text))))
        .help("Draw only these frames or cameras, counted from 0: A-B, or every STEPth with A-B:STEP.", "")
        .example("2-7")
        .synonyms(&["start", "end", "from-frame"]),
    job(Row::text("shard", "I/N", |o, text| put(&mut o.shard, values::part(text))))
        .help(
            "Draw only shard I of N of the list of images: all frames or cameras of each input.",
            "I counts from 0, or from 1: N/N is 0/N. For more than one image, the default is taken from \
             SLURM_ARRAY_TASK_ID and _COUNT, JOB_COMPLETION_INDEX and JOB_COMPLETIONS (not set by Kubernetes itself), \
             or AWS_BATCH_JOB_ARRAY_INDEX and _SIZE, if set.",
        )
        .example("1/3")
        .synonyms(&["share", "chunk", "part"]),
    job(Row::text("shard", "I/N", |o, text| put(&mut o.shard, values::part(text))))
        .of(Group::Jobs, Commands::CONVERT)
        .keyword(Commands::CONVERT)
        .help(
            "Convert only shard I of N of the points, to -o NAME.shard; I counts from 0, or from 1: N/N is 0/N.",
            "For such a name the default is taken from the cluster variables that `surfel render --help` lists, if \
             set.",
        )
        .python("str | tuple[int, int]")
        .separator("/")
        .example("1/3")
        .synonyms(&["share", "chunk", "part"]),
    job(Row::text("tile", "I/N", |o, text| put(&mut o.render.tile, values::part(text))))
        .image()
        .help(
            "Draw only band I of N bands of rows, for images too large for one run; `surfel stitch` merges the bands.",
            "",
        )
        .python("tuple[int, int] | str")
        .separator("/")
        .example("1/3")
        .conflicts(&["region"])
        .synonyms(&["band", "strip", "bucket"]),
    job(Row::switch("skip-existing", |o, on| o.skip_existing = on))
        .help(
            "Skip images whose files exist, whatever their content.",
            "Existing files are complete, because they appear at once.",
        )
        .conflicts(&["force", "verify"])
        .synonyms(&["resume", "no-overwrite", "continue"]),
    job(Row::switch("resume", |o, on| o.resume = on))
        .of(Group::Jobs, Commands::CONVERT)
        .keyword(Commands::CONVERT)
        .help(
            "With -o OUT.copc.laz: save progress in the folder OUT.copc.laz.resume until OUT is complete, and continue \
             an interrupted run of the same command.",
            "Deleting the folder discards the progress. An existing shard of the same inputs is kept.",
        )
        .synonyms(&["continue", "skip-existing"]),
];
