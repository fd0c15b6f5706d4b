//! Options for reading files, for selecting points, and for colours.

use crate::options::row::{Commands, Group, Row, names_of, put, put_path};
use crate::values;

const fn color(row: Row) -> Row {
    row.of(Group::Colors, Commands::SPLATS).image()
}

const fn point(row: Row) -> Row {
    row.of(Group::Points, Commands::SPLATS).image()
}

const fn file(row: Row) -> Row {
    row.of(Group::Files, Commands::SPLATS.and(Commands::INFO)).image()
}

pub(super) const ROWS: &[Row] = &[
    color(Row::text("color-by", "ATTRIBUTE", |o, text| {
        put(&mut o.render.splats.convert.color_by, Ok(text.to_owned()))
    }))
    .help("Colour by an attribute: rgb, height, normal, intensity, classification, or any other of the file.", "")
    .everyday()
    .python("str")
    .scene("convert.color_by")
    .example("height")
    .synonyms(&["colour-by", "attribute", "scalar", "field", "scalars"]),
    color(Row::path("colormap", "COLORMAP|FILE", |o, path| o.render.splats.set_colormap(path)))
        .names_or_other(|| names_of(values::COLORMAPS))
        .help(
            "Colour map for --color-by, or a file with a colour in each line: #rrggbb, or r g b.",
            "By default, classes have their own colours; integers with few distinct values get tab20, intensity grey, \
             and other values viridis. tab10, tab20 and set1 are for categories.",
        )
        .everyday()
        .python("_Path")
        .example("turbo")
        .scene("convert.colormap")
        .synonyms(&["cmap", "colourmap", "palette", "lut", "ramp", "gradient"]),
    color(Row::text("range", "LO,HI|shared", |o, text| {
        o.render.splats.set_range(values::range_choice(text)?);
        Ok(())
    }))
    .signed()
    .help(
        "Values at the ends of the colour map, with --color-by; by default the 2nd and the 98th percentile of all \
         that an image shows.",
        "With shared, all images of one INPUT each ({input} in OUT) use the range over all inputs.",
    )
    .python("_Numbers")
    .scene("convert.range")
    .example("-1.5,2")
    .synonyms(&["clim", "limits", "vmin", "vmax", "min", "max"]),
    color(Row::path("labels", "FILE", |o, path| put_path(&mut o.render.splats.convert.labels, path)))
        .help(
            "Names of the categories of --color-by, a line for each: VALUE NAME, or VALUE NAME #rrggbb with a colour.",
            "Names appear in legends. Integers without a line are named by their value.",
        )
        .python("_Path")
        .scene("convert.labels")
        .example("classes.txt")
        .synonyms(&["class-names", "names", "legend-labels"]),
    color(Row::text("color", "COLOR", |o, text| put(&mut o.render.color, values::color(text))))
        .of(Group::Colors, Commands::DRAWN)
        .image()
        .help("Colour all objects alike: #rrggbb, or a name of CSS such as steelblue.", "")
        .everyday()
        .python("str")
        .scene("material.color")
        .example("#4682b4")
        .conflicts(&["color-by"])
        .synonyms(&["solid-color", "colour", "albedo", "tint"]),
    color(Row::path("colorbar", "FILE.png", |o, path| {
        if path.as_os_str().is_empty() {
            o.names_colorbar = true;
            return Ok(());
        }
        put_path(&mut o.render.splats.colorbar, path)
    }))
    .of(Group::Colors, Commands::SPLATS.without(Commands::VIEW).without(Commands::FIGURE))
    .image()
    .missing("")
    .help("Write the colour bar of --color-by to an image file; the default name is OUT-colorbar.png.", "")
    .python("_Path")
    .example("bar.png")
    .synonyms(&["legend", "scalar-bar", "colourbar"]),
    color(Row::text("colors", "COLORS", |o, text| {
        put(&mut o.render.splats.convert.colors, values::point_colors(text))
    }))
    .names(|| names_of(values::POINT_COLORS))
    .help(
        "Colours of a scan's splats: those of the points (as-is), or fitted so that the blended surface has the \
         points' colours (fit).",
        "",
    )
    .scene("convert.colors"),
    color(Row::path("texture", "point|ewa|fit|FILE", |o, path| o.render.splats.add_texture(path)))
        .names_or_other(|| vec!["point", "ewa", "fit"])
        .repeated()
        .help(
            "Sampling of a mesh's colours: per splat as the mean over the square that it represents (point) or under \
             its kernel (ewa), or for all splats together so that their blend reproduces the mesh (fit).",
            "Any other value is a texture file, for meshes with texture coordinates that name no texture themselves. \
             Both may be given.",
        )
        .python(r#"_Path | Literal["point", "ewa", "fit"]"#)
        .scene("convert.texture")
        .example("bark.png"),
    point(Row::text("crop", "X0,Y0,Z0,X1,Y1,Z1", |o, text| put(&mut o.render.splats.convert.crop, values::crop(text))))
        .signed()
        .help("Use only points and splats within this box, in the file's coordinates.", "")
        .everyday()
        .python("_Numbers")
        .scene("convert.crop")
        .example("0,1,2,3,4,5")
        .synonyms(&["box", "bbox", "bounding-box", "extent"]),
    point(Row::text("classes", "N,...|!N,...", |o, text| {
        put(&mut o.render.splats.convert.classes, values::classes(text))
    }))
    .help("Use only points of these classes, such as 2,6; or all except these: '!7,18'.", "")
    .everyday()
    .python("Sequence[int] | str")
    .scene("convert.classes")
    .example("2,6")
    .synonyms(&["class", "classification", "keep-class"]),
    point(Row::text("returns", "RETURNS", |o, text| put(&mut o.render.splats.convert.returns, values::returns(text))))
        .names(|| names_of(values::RETURNS))
        .help("Use only these returns of each pulse.", "")
        .scene("convert.returns")
        .synonyms(&["return", "return-number"]),
    point(Row::text("where", "CONDITION", |o, text| {
        o.render.splats.add_condition(values::condition(text)?);
        Ok(())
    }))
    .repeated()
    .help(
        "Use only points that meet a condition such as 'intensity>100 and not (z<=5 or classification=7)', with and, \
         or, not, && || ! and parentheses.",
        "If --where is given several times, all conditions must hold.",
    )
    .python("str | Sequence[str]")
    .scene("convert.where")
    .example("intensity>3")
    .synonyms(&["condition", "expression", "select", "query"]),
    point(Row::text("every", "N", |o, text| {
        put(&mut o.render.splats.convert.every, values::whole(text, 1..=u32::MAX))
    }))
    .help("Use only every Nth of the selected points.", "")
    .python("int")
    .scene("convert.every")
    .example("7")
    .synonyms(&["step", "stride", "decimate", "decimation"]),
    point(Row::text("max-points", "N", |o, text| {
        put(&mut o.render.splats.convert.max_points, values::whole(text, 1..=u32::MAX))
    }))
    .help(
        "Use at most this many points of a point cloud, evenly selected; of a COPC file the coarsest (default 10 \
         million).",
        "",
    )
    .everyday()
    .python("int")
    .scene("convert.max_points")
    .example("7")
    .synonyms(&["limit", "points", "point-budget", "budget", "downsample", "subsample"]),
    point(Row::switch("all-points", |o, on| o.render.splats.convert.all_points = on))
        .help(
            "Keep more than 16 points at one place, and points at exactly 0,0,0, which sensors write for \"no \
             return\".",
            "",
        )
        .scene("convert.all_points")
        .synonyms(&["keep-duplicates"]),
    point(Row::text("outliers", "OUTLIERS", |o, text| {
        put(&mut o.render.splats.convert.outliers, values::outliers(text))
    }))
    .names(|| names_of(values::OUTLIERS))
    .help(
        "Keep or drop isolated points: those more than 8 times as far from their 8 nearest neighbours as is usual.",
        "",
    )
    .scene("convert.outliers")
    .synonyms(&["denoise", "noise", "remove-outliers", "sor"]),
    point(Row::text("points-as", "surface|balls|disks|dots[:R]", |o, text| {
        put(&mut o.render.splats.convert.points_as, values::points_as(text))
    }))
    .of(Group::Points, Commands::DRAWN)
    .keyword(Commands::RENDER.and(Commands::FIGURE))
    .help(
        "Draw each point as part of a surface, or as a ball, a disk across its estimated normal or a dot, with radius \
         R in the file's units or in pixels (balls:0.02, dots:2px).",
        "By default the radius of balls and disks is half the spacing of the points, and that of dots 1.5px.",
    )
    .everyday()
    .python("str")
    .scene("convert.points_as")
    .example("balls:0.02")
    .synonyms(&["point-style", "spheres", "balls"]),
    point(Row::text("lod-error", "PX", |o, text| put(&mut o.render.lod_error, values::positive(text))))
        .of(Group::Points, Commands::DRAWN)
        .help(
            "Largest projected splat size in pixels (default 1).",
            "Octrees (.surfel) draw polygons where even the finest splats are larger; from COPC files the levels of \
             detail needed for this size are read.",
        )
        .keyword(Commands::RENDER.and(Commands::FIGURE))
        .python("float")
        .scene("settings.lod_error_px")
        .example("7")
        .synonyms(&["lod", "level", "detail", "screen-space-error"]),
    point(Row::switch("all-levels", |o, on| o.render.all_levels = on))
        .of(Group::Points, Commands::DRAWN)
        .help("Draw all points of COPC files, not only as many as the view needs.", "")
        .keyword(Commands::RENDER.and(Commands::FIGURE))
        .scene("convert.all_levels"),
    file(Row::text("columns", "NAME,...", |o, text| put(&mut o.render.splats.convert.columns, values::columns(text))))
        .help(
            "Column names of tables: text, NPY and NPZ (x,y,z,_,r,g,b; _ skips a column).",
            "With types, each of which applies until the next one, also of binary files without a header \
         (f4:x,y,z,intensity): f2 f4 f8 u1 i1 u2 i2 u4 i4 u8 i8, little-endian, or big-endian after >.",
        )
        .everyday()
        .python("str | Sequence[str | None]")
        .scene("convert.columns")
        .example("x,y,z,_")
        .synonyms(&["fields", "header", "dtype", "format"]),
    file(Row::switch("repair", |o, on| o.render.splats.convert.repair = on))
        .help(
            "Read damaged files as far as possible: skip invalid splats and unreadable parts of LAZ and E57 files.",
            "",
        )
        .scene("convert.repair")
        .synonyms(&["skip-invalid", "ignore-errors"]),
    file(Row::switch("allow-outside", |o, on| o.render.splats.convert.allow_outside = on))
        .help("Also read files outside a file's own folder that it refers to (buffers, materials, textures).", "")
        .scene("convert.allow_outside"),
    file(Row::text("max-texture", "N", |o, text| {
        put(&mut o.render.splats.convert.max_texture, values::whole(text, 1..=32_768))
    }))
    .help("Reduce textures to at most this many texels a side (default 8192).", "")
    .python("int")
    .scene("convert.max_texture")
    .example("7")
    .synonyms(&["texture-size", "texture-limit"]),
    file(Row::text("memory", "SIZE", |o, text| put(&mut o.render.splats.memory, values::memory(text))))
        .of(Group::Files, Commands::SPLATS)
        .help(
            "Memory budget for points, such as 4G or 512M (default 60 % of the machine's memory).",
            "Larger point clouds are drawn by level of detail, or refused, and COPC is written in pieces that fit.",
        )
        .python("int | str")
        .example("1.5G")
        .synonyms(&["ram", "max-memory", "memory-limit"]),
];
