//! Fragment entry points, one for each layer, set of sums and variant: what varies is a few names, so they are written here
//! once and not thirty times. They are called `VARIANT_LAYER_WHAT_fragment`; whole splats have no variant in the name.

use std::fmt::Write as _;

/// Layers of which something is kept.
const KEPT: [&str; 3] = ["front", "behind", "peeled"];

/// Layers, and what they sum up.
const LAYERS: [(&str, &[&str]); 5] = [
    ("front", &["color", "surface", "further"]),
    ("among", &["color", "surface", "further"]),
    ("behind", &["color", "surface", "material"]),
    ("peeled", &["surface", "further"]),
    ("remaining", &["surface", "further"]),
];

/// Prefix of the names, and what a fragment knows besides.
const VARIANTS: [(&str, &str); 2] = [("", ""), ("clipped_", ", @location(9) @interpolate(flat, either) record: u32")];

/// The type of a set of sums.
fn result(sums: &str) -> &'static str {
    match sums {
        "surface" => "SurfaceSums",
        "further" => "FurtherSums",
        _ => "@location(0) vec4f",
    }
}

/// All entry points, as WGSL.
pub(crate) fn entry_points() -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    for (variant, parameter) in VARIANTS {
        let kept = |what| if variant.is_empty() { String::new() } else { format!(" && {what}_is_kept(in, record)") };
        let (visible, filtered) = (kept("visible"), kept("filtered"));
        let mut visibility = |layer: &str, name: &str, result: &str, value: &str| {
            write!(
                text,
                "@fragment\nfn {variant}{layer}_{name}_fragment(in: VisibilityVertex{parameter}) -> {result} {{\n    \
                 let z = visible_depth(in);\n    if !({layer}_shows(in, z){visible}) {{\n        discard;\n    }}\n    \
                 return {value};\n}}\n\n"
            )
        };
        visibility("front", "writer", "Written", "written(in, z)")?;
        for layer in KEPT {
            visibility(layer, "visibility", "@builtin(frag_depth) f32", "comparable(z + in.anchor.w)")?;
        }
        for (layer, sums) in LAYERS.iter().flat_map(|(layer, sums)| sums.iter().map(move |sums| (layer, *sums))) {
            let result = result(sums);
            write!(
                text,
                "@fragment\nfn {variant}{layer}_{sums}_fragment(in: AttributeVertex{parameter}) -> {result} {{\n    \
                 let c = contribution(in);\n    if !(c.is_there && {layer}_adds(in, c.z){filtered}) {{\n        \
                 discard;\n    }}\n    return {sums}_sums_of(in, c);\n}}\n\n"
            )?;
        }
    }
    Ok(text)
}
