//! Options for shading, light and background, and the settings of the rendering model.

use crate::options::row::{Commands, Group, Row, names_of, put, put_path};
use crate::values;

const fn setting(row: Row) -> Row {
    row.of(Group::Appearance, Commands::DRAWN).image()
}

pub(super) const ROWS: &[Row] = &[
    setting(Row::text("preset", "PRESET", |o, text| put(&mut o.render.preset, values::preset(text))))
        .names(|| names_of(values::PRESETS))
        .help("Named trade-off between speed and accuracy.", "")
        .everyday()
        .synonyms(&["quality", "speed", "fast"]),
    setting(Row::text("shader", "SHADER", |o, text| put(&mut o.render.shader, values::shader(text))))
        .names(|| names_of(values::SHADERS))
        .help("Shading of pixels.", "")
        .everyday()
        .scene("settings.shader")
        .synonyms(&["shading", "lighting", "material"]),
    setting(Row::switch("shadows", |o, on| o.render.shadows = on))
        .help("Let lights cast shadows.", "")
        .everyday()
        .synonyms(&["shadow"]),
    setting(Row::text("light", "LIGHT", |o, text| put(&mut o.render.light, values::light(text))))
        .names(|| names_of(values::LIGHTS))
        .help(
            "Light: lights that follow the camera (headlight), or a sky with soft shadows: studio with a large soft \
             light, sky alone, or sun.",
            "Light of a sky stands still when the camera moves.",
        )
        .everyday()
        .example("studio")
        .synonyms(&["lights", "sky", "ambient-occlusion", "ao", "environment", "envmap", "hdri"]),
    setting(Row::text("ground", "GROUND", |o, text| put(&mut o.render.ground, values::ground(text))))
        .names(|| names_of(values::GROUNDS))
        .help(
            "Ground below the scene: only the shadow on it, a plane, or a grid.",
            "Without --light, the light is studio.",
        )
        .everyday()
        .example("shadow")
        .synonyms(&["floor", "shadow-catcher", "plane", "grid"]),
    setting(Row::text("bounce", "on|off", |o, text| put(&mut o.render.bounce, values::switch(text))))
        .missing("on")
        .help("Add light that surfaces reflect to each other, to the light of a sky.", "")
        .python("bool")
        .example("on")
        .synonyms(&["global-illumination", "gi", "indirect"]),
    setting(Row::text("edge-aa", "on|off|samples", |o, text| put(&mut o.render.edge_aa, values::edge_aa(text))))
        .names(|| names_of(values::EDGE_AA))
        .missing("on")
        .help("Antialias edges: by coverage (on), or by several samples per edge pixel (samples).", "")
        .everyday()
        .python(r#"bool | Literal["on", "off", "samples"]"#)
        .scene("settings.edge_aa")
        .synonyms(&["antialias", "antialiasing", "anti-aliasing", "aa", "msaa", "smooth"]),
    setting(Row::text("style", "STYLE", |o, text| put(&mut o.render.style, values::style(text))))
        .names(|| names_of(values::STYLES))
        .help(
            "Choices for an image that other options leave open: figure, for papers, has 2048x2048 pixels, a white \
             background, smooth edges, the light of a studio with one bounce, and a shadow on the ground.",
            "",
        )
        .everyday()
        .example("figure")
        .synonyms(&["theme", "look"]),
    setting(Row::text("background", "COLOR|R,G,B[,A]", |o, text| {
        put(&mut o.render.background, values::background(text))
    }))
    .signed()
    .help("Background: a colour such as white or #f0f0f0, linear R,G,B[,A] with straight alpha, or transparent.", "")
    .everyday()
    .python("_Numbers | str")
    .scene("background")
    .example("0.25,0.5,0.75")
    .synonyms(&["bg", "background-color", "backdrop", "clear-color"]),
    setting(Row::path("matcap", "FILE|builtin", |o, path| put_path(&mut o.render.matcap, path)))
        .help("Image of a lit sphere, which selects the shader matcap: a PNG, JPEG or WebP, or builtin.", "")
        .python("_Path")
        .scene("matcap")
        .example("sphere.png"),
    setting(Row::text("transparency", "MODE", |o, text| put(&mut o.render.transparency, values::transparency(text))))
        .help("Method for drawing transparent splats: off, peel:N, peel:N:drop or abuffer:L.", "")
        .python("str")
        .scene("settings.transparency")
        .example("peel:3:drop")
        .synonyms(&["alpha", "opacity", "oit"]),
    setting(Row::text("composite", "COMPOSITE", |o, text| put(&mut o.render.composite, values::composite(text))))
        .names(|| names_of(values::COMPOSITES))
        .help(
            "Compositing of trained Gaussians (2DGS and 3DGS PLY, SPLAT, SPZ, SOG): over one another, as they were \
             trained, or as opaque surfaces.",
            "The default is over if all files are Gaussians and no other flag applies only to surfaces.",
        )
        .scene("settings.composite")
        .synonyms(&["blend", "blending"]),
    setting(Row::text("filter", "FILTER", |o, text| put(&mut o.render.filter, values::filter(text))))
        .names(|| names_of(values::FILTERS))
        .help(
            "Screen-space filter; for Gaussians drawn over one another, clamp (as they were trained) or principal.",
            "",
        )
        .scene("settings.filter"),
    setting(Row::text("depth-tolerance", "K|abs:D", |o, text| {
        put(&mut o.render.depth_tolerance, values::depth_tolerance(text))
    }))
    .help(
        "Depth tolerance: fragments up to K splat radii, or abs:D world units, behind the nearest surface blend with \
         it.",
        "",
    )
    .python("float | str")
    .scene("settings.depth_tolerance")
    .example("abs:0.5")
    .synonyms(&["epsilon", "depth-bias"]),
    setting(Row::text("mapping", "MAPPING", |o, text| put(&mut o.render.mapping, values::mapping(text))))
        .names(|| names_of(values::MAPPINGS))
        .help("Projection of splats to the screen.", "")
        .expert()
        .scene("settings.mapping"),
    setting(Row::text("cutoff", "C", |o, text| put(&mut o.render.cutoff, values::cutoff(text))))
        .help("Kernel cutoff.", "")
        .expert()
        .python("float")
        .scene("settings.cutoff")
        .example("7"),
    setting(Row::text("prefilter", "PX", |o, text| put(&mut o.render.prefilter, values::prefilter(text))))
        .help("Least half-width of a filtered splat in pixels.", "")
        .expert()
        .python("float")
        .scene("settings.prefilter_radius_px")
        .example("7"),
    setting(Row::text("accumulate", "ACCUMULATE", |o, text| put(&mut o.render.accumulate, values::accumulate(text))))
        .names(|| names_of(values::ACCUMULATES))
        .help("Least precision of sums; on CPUs f16 changes nothing.", "")
        .expert()
        .scene("settings.accumulate"),
    setting(Row::text("clip", "CLIP", |o, text| put(&mut o.render.clip, values::clip(text))))
        .names(|| names_of(values::CLIPS))
        .help("Evaluation of clip curves.", "")
        .expert()
        .scene("settings.clip"),
    setting(Row::text("sort", "SORT", |o, text| put(&mut o.render.sort, values::sort(text))))
        .names(|| names_of(values::SORTS))
        .help(
            "Order in which trained Gaussians are drawn over one another: by their centres, as they were trained, or \
             exactly in each pixel, without popping.",
            "",
        )
        .expert()
        .scene("settings.sort"),
    setting(Row::text("light-directions", "N", |o, text| {
        put(&mut o.render.light_directions, values::whole(text, 1..=65_536))
    }))
    .help("Number of directions from which the light of a sky comes.", "The default is 128.")
    .expert()
    .python("int")
    .example("256"),
    setting(Row::text("samples", "N", |o, text| put(&mut o.render.samples, values::whole(text, 1..=64))))
        .of(Group::Appearance, Commands::RENDER)
        .help("Average NxN unfiltered samples per pixel (backend reference only).", "")
        .expert()
        .python("int")
        .drawn()
        .example("7")
        .built(cfg!(feature = "reference"))
        .synonyms(&["supersampling", "ssaa", "spp"]),
];
