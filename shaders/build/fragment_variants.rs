//! Generates the fragment entry points that draw splats: one for each layer, result and clip variant. A layer is a set
//! of fragments that are drawn together, such as those of the nearest surface (`front`). The entry points differ only
//! in a few names, so they are generated from one template. Their names are `VARIANT_LAYER_RESULT_fragment`, and
//! `LAYER_RESULT_fragment` for splats without clips.

use std::fmt::Write as _;

/// Layers that have a depth threshold, and therefore a visibility pass.
const THRESHOLD_LAYERS: [&str; 4] = ["front", "shown", "edge_background", "peeled"];

/// Layer with the sets of sums that attribute passes over it accumulate, such as `color` for sums of colour and weight.
/// The functions `SUMS_sums_of` of the WGSL modules compute the sums.
struct LayerSums {
    layer: &'static str,
    sums: &'static [&'static str],
}

/// All layers with an attribute pass.
const LAYERS: [LayerSums; 8] = [
    LayerSums { layer: "front", sums: &["color", "surface", "material_counts"] },
    LayerSums { layer: "mesh_blend", sums: &["color", "surface", "material_counts"] },
    LayerSums { layer: "shown", sums: &["color", "surface", "material_counts"] },
    LayerSums { layer: "shown_mesh_blend", sums: &["color", "surface", "material_counts"] },
    LayerSums { layer: "edge_background", sums: &["color", "surface", "material"] },
    LayerSums { layer: "peeled", sums: &["surface", "material_counts"] },
    LayerSums { layer: "gathered", sums: &["surface", "material_coverage"] },
    LayerSums { layer: "remaining", sums: &["surface", "material_counts"] },
];

/// Layers whose fragments are drawn to find the nearest splat of each pixel. The flag is true if polygons may hide
/// fragments of the layer.
const NEAREST_LAYERS: [(&str, bool); 5] =
    [("front", false), ("mesh_blend", true), ("shown", false), ("shown_mesh_blend", true), ("remaining", false)];

/// Variants for splats without and with clips: prefix of the entry points' names, and an additional parameter of the
/// entry points.
const VARIANTS: [(&str, &str); 2] = [("", ""), ("clipped_", ", @location(9) @interpolate(flat, either) record: u32")];

/// Returns the WGSL type that an entry point returns for a set of sums.
fn sums_type(sums: &str) -> &'static str {
    match sums {
        "surface" => "SurfaceSums",
        "material_counts" => "MaterialCountsSums",
        "material_coverage" => "MaterialCoverageSums",
        _ => "@location(0) vec4f",
    }
}

/// Returns the WGSL text of all entry points.
pub(crate) fn entry_points() -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    for (variant, parameter) in VARIANTS {
        let clip = |what| if variant.is_empty() { String::new() } else { format!(" && clip_keeps_{what}(in, record)") };
        let (visible, filtered) = (clip("visible"), clip("filtered"));
        let mut visibility = |layer: &str, name: &str, result: &str, value: &str| {
            writeln!(text, "@fragment")?;
            writeln!(text, "fn {variant}{layer}_{name}_fragment(in: VisibilityVertex{parameter}) -> {result} {{")?;
            writeln!(text, "    let z = visible_depth(in);")?;
            writeln!(text, "    if !({layer}_is_visible(in, z){visible}) {{\n        discard;\n    }}")?;
            writeln!(text, "    return {value};\n}}\n")
        };
        // Depth to which a fragment limits blending in its pixel. In the layer `shown`, fragments of the front and back
        // side of oriented splats have different limits.
        let limit = |layer: &str| if layer == "shown" { "shown_limit(in, z)" } else { "z + in.anchor.w" };
        for layer in ["front", "shown", "peeled"] {
            let value = format!("threshold_output(in, z, {})", limit(layer));
            visibility(layer, "threshold", "ThresholdOutput", &value)?;
        }
        visibility("facing", "visibility", "FacingOutput", "facing_output(in, z)")?;
        for layer in THRESHOLD_LAYERS {
            let value = format!("reversed_depth({})", limit(layer));
            visibility(layer, "visibility", "@builtin(frag_depth) f32", &value)?;
        }
        for LayerSums { layer, sums } in LAYERS {
            for &sums in sums {
                let result = sums_type(sums);
                writeln!(text, "@fragment")?;
                writeln!(text, "fn {variant}{layer}_{sums}_fragment(in: AttributeVertex{parameter}) -> {result} {{")?;
                let contribution = if layer == "gathered" { "gathered_contribution" } else { "contribution" };
                writeln!(text, "    let c = {contribution}(in);")?;
                writeln!(text, "    if !(c.is_there && {layer}_accumulates(in, c.z){filtered}) {{")?;
                writeln!(text, "        discard;\n    }}")?;
                writeln!(text, "    return {sums}_sums_of(in, c);\n}}\n")?;
            }
        }
        for (layer, before_polygon) in NEAREST_LAYERS {
            let [_, (_, record)] = VARIANTS;
            let before = if before_polygon { " && is_before_polygon(in.position, c.z)" } else { "" };
            writeln!(text, "@fragment")?;
            writeln!(text, "fn {variant}{layer}_nearest_fragment(in: AttributeVertex{record},")?;
            writeln!(text, "    @location(10) @interpolate(flat, either) source: u32) -> NearestOutput {{")?;
            writeln!(text, "    let c = contribution(in);")?;
            writeln!(text, "    if !(c.is_there && {layer}_accumulates(in, c.z){before}{filtered}) {{")?;
            writeln!(text, "        discard;\n    }}")?;
            writeln!(text, "    return nearest_output(c.z, source, record);\n}}\n")?;
        }
    }
    Ok(text)
}
