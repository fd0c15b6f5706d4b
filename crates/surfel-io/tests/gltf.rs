//! glTF of every kind, written to its specification: rest poses, sparse, quantised and compressed data, materials,
//! containers and primitives.

#![cfg(feature = "gltf")]

mod attributes;

use glam::DVec3;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use surfel_io::{Content, Format, LoadOptions, Loaded, load_bytes};
use surfel_model::{AlphaMode, ExtraValues, Mesh, PointCloud};

const F32: u32 = 5126;
const U8: u32 = 5121;
const I8: u32 = 5120;
const I16: u32 = 5122;
const U16: u32 = 5123;

/// Builder of a document: one buffer, and a view for each accessor.
#[derive(Default)]
struct Document {
    data: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Document {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        self.views.push(json!({"buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len()}));
        self.data.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn column(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.accessor(json!({"bufferView": view, "componentType": component, "type": kind, "count": count}))
    }

    fn floats(&mut self, values: &[f32], kind: &str, count: usize) -> usize {
        self.column(&floats(values), F32, kind, count)
    }

    /// Returns the document's JSON, with its buffer embedded.
    fn with(&self, rest: Value) -> Value {
        let hex: String = self.data.iter().map(|b| format!("%{b:02x}")).collect();
        let mut all = json!({
            "asset": {"version": "2.0"},
            "buffers": [{"uri": format!("data:application/octet-stream,{hex}"), "byteLength": self.data.len()}],
            "bufferViews": self.views,
            "accessors": self.accessors,
        });
        all.as_object_mut().unwrap().extend(rest.as_object().unwrap().clone());
        all
    }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn try_load(document: &Value) -> Result<Loaded, String> {
    let bytes = serde_json::to_vec(document).unwrap();
    load_bytes(&bytes, Some(Format::Gltf), Path::new("t"), &LoadOptions::default()).map_err(|e| e.to_string())
}

fn load(document: &Value) -> Loaded {
    try_load(document).unwrap_or_else(|e| panic!("{e}"))
}

fn mesh(loaded: Loaded) -> Mesh {
    match loaded.content {
        Content::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

fn points(loaded: Loaded) -> PointCloud {
    match loaded.content {
        Content::Points(points) => points,
        other => panic!("{other:?}"),
    }
}

fn positions(mesh: &Mesh) -> Vec<DVec3> {
    (0..mesh.positions.len()).map(|i| mesh.origin + mesh.positions.get(i)).collect()
}

/// Compares positions, which are stored in f32, to seven digits.
fn assert_positions(mesh: &Mesh, expected: &[[f64; 3]]) {
    let found = positions(mesh);
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((*a - DVec3::from(*b)).length() < 1e-5, "{found:?}");
    }
}

const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
const QUAD: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];

/// Returns a scene of one node with one mesh of one primitive.
fn scene(primitive: Value) -> Value {
    json!({"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0})
}

#[test]
fn gltf_skins_are_where_their_joints_are() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let normal = d.floats(&[0.0, 0.0, 1.0].repeat(3), "VEC3", 3);
    // The second vertex follows the second joint, the third both joints equally, in 8-bit weights.
    let joints = d.column(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], U8, "VEC4", 3);
    let weights = d.view(&[255, 0, 0, 0, 255, 0, 0, 0, 100, 100, 0, 0]);
    let weights =
        d.accessor(json!({"bufferView": weights, "componentType": U8, "normalized": true, "type": "VEC4", "count": 3}));
    let mut inverse = [[1.0_f32, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]; 2];
    inverse[1][12] = -1.0;
    let inverse = d.floats(inverse.as_flattened(), "MAT4", 2);
    let document = d.with(json!({
        "meshes": [{"primitives": [{"attributes": {"POSITION": position, "NORMAL": normal, "JOINTS_0": joints,
        "WEIGHTS_0": weights}}]}],
        // The transform of the mesh's own node doesn't matter; those of the joints do. The second joint is rotated by a
        // quarter turn about x.
        "nodes": [
            {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
            {"translation": [0, 5, 0], "children": [2]},
            {"translation": [1, 0, 0], "rotation": [0.5_f64.sqrt(), 0, 0, 0.5_f64.sqrt()]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": inverse}],
        "scenes": [{"nodes": [0, 1]}],
    }));
    let loaded = load(&document);
    assert_eq!(loaded.notes, ["drew skinned meshes in their rest pose"]);
    let m = mesh(loaded);
    // First joint: 5 up. Second: back from its bind position, a quarter turn from y to z, and to its position.
    assert_positions(&m, &[[0.0, 5.0, 0.0], [1.0, 5.0, 0.0], [0.0, 5.5, 0.5]]);
    let normals = m.normals.unwrap();
    assert!((DVec3::from(normals[1].map(f64::from)) - DVec3::NEG_Y).length() < 1e-6, "{normals:?}");
    // Without weights the mesh follows its node.
    let mut rigid = document;
    rigid["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("WEIGHTS_0");
    assert_positions(&mesh(load(&rigid)), &[[100.0, 0.0, 0.0], [101.0, 0.0, 0.0], [100.0, 1.0, 0.0]]);
    // A joint that doesn't exist.
    rigid["skins"][0]["joints"] = json!([1, 9]);
    assert!(try_load(&rigid).unwrap_err().contains("node 9 does not exist: there are 3"));
}

#[test]
fn gltf_morph_targets_have_their_default_weights() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let up = d.floats(&[0.0, 0.0, 1.0].repeat(3), "VEC3", 3);
    let side = d.floats(&[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0], "VEC3", 3);
    let mut document = d.with(json!({
        "meshes": [{"weights": [0.5, 0.0], "primitives": [{
            "attributes": {"POSITION": position, "NORMAL": up},
            "targets": [{"POSITION": up, "TANGENT": 77}, {"POSITION": side, "NORMAL": side}]}]}],
        "nodes": [{"mesh": 0}],
    }));
    assert_positions(&mesh(load(&document)), &[[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]);
    // A node's weights have priority over its mesh's.
    document["nodes"][0]["weights"] = json!([0.0, 1.0]);
    let m = mesh(load(&document));
    assert_positions(&m, &[[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(m.normals.unwrap()[1], [2.0, 0.0, 1.0]);
}

#[test]
fn gltf_sparse_accessors_replace_elements() {
    let mut d = Document::default();
    let base = d.view(&floats(&TRIANGLE));
    let places = d.view(&[1, 0, 2, 0]);
    let values = d.view(&floats(&[5.0, 0.0, 0.0, 0.0, 6.0, 0.0]));
    let sparse =
        json!({"count": 2, "indices": {"bufferView": places, "componentType": U16}, "values": {"bufferView": values}});
    let with_base =
        d.accessor(json!({"bufferView": base, "componentType": F32, "type": "VEC3", "count": 3, "sparse": sparse}));
    let on_zeros = d.accessor(json!({"componentType": F32, "type": "VEC3", "count": 3, "sparse": sparse}));
    for accessor in [with_base, on_zeros] {
        let m = mesh(load(&d.with(scene(json!({"attributes": {"POSITION": accessor}})))));
        assert_positions(&m, &[[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 6.0, 0.0]]);
    }
    let mut beyond = d.with(scene(json!({"attributes": {"POSITION": with_base}})));
    beyond["accessors"][0]["count"] = json!(2);
    assert!(try_load(&beyond).unwrap_err().contains("sparse element 2 does not exist: there are 2"));
}

#[test]
fn gltf_quantised_attributes_are_scaled_by_their_node() {
    let mut d = Document::default();
    // 16-bit positions and 8-bit normals, both padded to four bytes per vertex, in one view.
    let mut vertices = Vec::new();
    for p in [[0_i16, 0, 0], [32_767, 0, 0], [0, -32_767, 0]] {
        p.iter().for_each(|x| vertices.extend(x.to_le_bytes()));
        vertices.extend([0, 0, 0, 0, 127, 0]);
    }
    let view = d.view(&vertices);
    d.views[view]["byteStride"] = json!(12);
    let normalized = json!({"bufferView": view, "componentType": I16, "normalized": true, "type": "VEC3", "count": 3});
    let position = d.accessor(normalized);
    let normal = d
        .accessor(json!({"bufferView": view, "byteOffset": 8, "componentType": I8, "normalized": true, "type": "VEC3",
        "count": 3}));
    let whole = d.accessor(json!({"bufferView": view, "componentType": I16, "type": "VEC3", "count": 3}));
    let mut document = d.with(scene(json!({"attributes": {"POSITION": position, "NORMAL": normal}})));
    document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    document["nodes"][0]["scale"] = json!([2, 2, 2]);
    let m = mesh(load(&document));
    assert_positions(&m, &[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, -2.0, 0.0]]);
    assert_eq!(m.normals.unwrap()[2], [0.0, 0.0, 1.0]);
    document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(whole);
    assert_eq!(positions(&mesh(load(&document)))[1].x, 65_534.0);
}

#[test]
fn gltf_matrix_and_parts_place_alike_and_far_places_keep_their_digits() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let mut document = d.with(scene(json!({"attributes": {"POSITION": position}})));
    // A quarter turn about z, a mirror in x, and an Earth-sized position in metres.
    let s = 0.5_f64.sqrt();
    document["nodes"][0] =
        json!({"mesh": 0, "rotation": [0, 0, s, s], "scale": [-2, 3, 4], "translation": [4500000.125, 0, 0.25]});
    let parts = mesh(load(&document));
    document["nodes"][0] =
        json!({"mesh": 0, "matrix": [0, -2, 0, 0, -3, 0, 0, 0, 0, 0, 4, 0, 4500000.125, 0, 0.25, 1]});
    let matrix = mesh(load(&document));
    for (a, b) in positions(&parts).iter().zip(positions(&matrix)) {
        assert!((*a - b).length() < 1e-8, "{a} {b}");
    }
    assert!((positions(&matrix)[0] - DVec3::new(4_500_000.125, 0.0, 0.25)).length() < 1e-8);
    // The mirror reverses the winding order, so that the outside stays outside.
    assert_eq!((&parts.triangles[..], &matrix.triangles[..]), (&[[0, 2, 1]][..], &[[0, 2, 1]][..]));
}

#[test]
fn gltf_material_extensions_are_one_note_and_the_older_model_has_a_color() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let mut document = d.with(json!({
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": position}, "material": 0,
            "extensions": {"KHR_materials_variants": {"mappings": []}}},
            {"attributes": {"POSITION": position}, "material": 1}]}],
        "materials": [
            {"extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": "much"}, "KHR_materials_sheen": {}}},
            {"alphaMode": "BLEND", "extensions": {"KHR_materials_sheen": {},
            "KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.25, 0.5, 1, 0.5]}}}],
        "nodes": [{"mesh": 0}],
        "extensionsRequired": ["KHR_materials_clearcoat", "KHR_materials_sheen"],
    }));
    let loaded = load(&document);
    let names = "KHR_materials_clearcoat, KHR_materials_sheen, KHR_materials_variants";
    assert_eq!(loaded.notes, [format!("ignored the material extensions {names}: only the base colour is used")]);
    let m = mesh(loaded);
    let (colors, alphas) = (m.colors.unwrap(), m.alphas.unwrap());
    assert_eq!((colors[0], colors[3], alphas[3]), ([1.0; 3], [0.25, 0.5, 1.0], 0.5));
    document["extensionsRequired"] = json!(["KHR_materials_sheen", "EXT_unheard_of"]);
    let error = try_load(&document).unwrap_err();
    assert!(error.contains("requires the glTF extension 'EXT_unheard_of', which is not read"), "{error}");
}

#[test]
fn gltf_triangles_have_the_side_of_their_material_if_materials_that_are_used_differ() {
    let column = |of_primitives: [Value; 3]| {
        let mut d = Document::default();
        let position = d.floats(&TRIANGLE, "VEC3", 3);
        let primitives = of_primitives.map(|material| match material {
            Value::Null => json!({"attributes": {"POSITION": position}}),
            material => json!({"attributes": {"POSITION": position}, "material": material}),
        });
        let document = d.with(json!({
            "meshes": [{"primitives": primitives}],
            "materials": [{}, {"doubleSided": true}, {"doubleSided": false}],
            "nodes": [{"mesh": 0}],
        }));
        let mut extras = mesh(load(&document)).triangle_extras;
        assert!(extras.len() < 2 && extras.iter().all(|extra| extra.name == "single_sided"));
        extras.pop().map(|extra| extra.values)
    };
    assert_eq!(column([json!(0), json!(1), json!(2)]), Some(ExtraValues::U8(vec![1, 0, 1])));
    // Triangles without a material have no flag, and count as visible from both sides.
    assert_eq!(column([json!(2), Value::Null, json!(1)]), Some(ExtraValues::U8(vec![1, 0, 0])));
    // A file whose exporter never states the flag, and one of a single kind.
    assert_eq!(column([json!(0), Value::Null, json!(2)]), None);
    assert_eq!(column([json!(1), json!(1), Value::Null]), None);
}

/// Returns a document of one textured triangle.
fn textured(texture: Value, images: Value) -> Value {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let uv = d.floats(&[0.25, 0.25, 0.75, 0.25, 0.25, 0.75], "VEC2", 3);
    d.with(json!({
        "meshes": [{"primitives": [{"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [texture],
        "images": images,
        "nodes": [{"mesh": 0}],
    }))
}

/// Returns a data URI of bytes, as for an image.
fn uri(bytes: &[u8]) -> String {
    format!("data:image/any,{}", bytes.iter().map(|b| format!("%{b:02x}")).collect::<String>())
}

/// Encodes a PNG of one row of texels.
fn png(texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, texels.len() as u32, 1);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(texels.as_flattened()).unwrap();
    bytes
}

#[test]
fn gltf_textures_end_or_are_mirrored_as_their_samplers_say() {
    let texels = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 9, 9, 255]];
    let mut document = textured(json!({"source": 0, "sampler": 1}), json!([{"uri": uri(&png(&texels))}]));
    let mut d = Document::default();
    let uvs = [0.0, 0.0, 1.25, 0.0, 0.0, 1.0];
    let (position, uv) = (d.floats(&TRIANGLE, "VEC3", 3), d.floats(&uvs, "VEC2", 3));
    let primitive = json!({"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "material": 0});
    let of_triangle = d.with(scene(primitive));
    for key in ["accessors", "bufferViews", "buffers", "meshes"] {
        document[key] = of_triangle[key].clone();
    }
    let shown = |wrap: u32, document: &mut Value| {
        document["samplers"] = json!([{}, {"wrapS": wrap}]);
        let loaded = load(document);
        assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
        let mesh = mesh(loaded);
        let (texture, uvs) = (mesh.texture.unwrap(), mesh.uvs.unwrap());
        (texture.width, [0, 1].map(|i| texture.sample_numbers(uvs[i])))
    };
    // At the left edge, and an eighth of the texture beyond the right one.
    let [red, green, grey] = [texels[0], texels[1], texels[3]].map(|t| t.map(|v| f32::from(v) / 255.0));
    let half = |a: [f32; 4], b: [f32; 4]| std::array::from_fn::<_, 4, _>(|c| 0.5 * (a[c] + b[c]));
    let close = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    for (wrap, width, expected) in [
        (10_497, 4, [half(grey, red), half(red, green)]),
        (33_071, 7, [red, grey]),
        (33_648, 8, [red, half(grey, texels[2].map(|v| f32::from(v) / 255.0))]),
    ] {
        let (found, colors) = shown(wrap, &mut document);
        assert_eq!(found, width, "{wrap}");
        assert!((0..2).all(|i| close(colors[i], expected[i])), "{wrap}: {colors:?}, expected {expected:?}");
    }
}

#[test]
fn gltf_textures_of_other_formats_are_left_out() {
    let mut document =
        textured(json!({"extensions": {"KHR_texture_basisu": {"source": 0}}}), json!([{"uri": "a.ktx2"}]));
    document["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    let needs = "PNG, JPEG and WebP are read, and it needs the extension 'KHR_texture_basisu'";
    assert_eq!(load(&document).notes, [format!("left out the texture 'texture 0': {needs}")]);
    // With a fallback image there is no note.
    document["textures"][0]["source"] = json!(1);
    document["images"] = json!([{"uri": "a.ktx2"}, {"uri": uri(&png(&[[255, 0, 0, 255]]))}]);
    let loaded = load(&document);
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    assert_eq!(mesh(loaded).texture.unwrap().srgba8, [[255, 0, 0, 255]]);
}

/// Lossless WebP file in hexadecimal, with 2×2 texels: red, green; blue with alpha 128, white with alpha 0.
#[cfg(feature = "webp")]
const WEBP: &str =
    "524946462a000000574542505650384c1d0000002f014000101fb0ff028222ff479b7f8100c1b973918d2a611722fa1f0200";

#[cfg(feature = "webp")]
#[test]
fn gltf_webp_textures_are_read_and_fall_back_where_they_are_damaged() {
    let bytes: Vec<u8> = (0..WEBP.len()).step_by(2).map(|i| u8::from_str_radix(&WEBP[i..i + 2], 16).unwrap()).collect();
    let other = uri(&png(&[[9, 9, 9, 255]]));
    let texture = json!({"source": 1, "extensions": {"EXT_texture_webp": {"source": 0}}});
    let mut document = textured(texture, json!([{"uri": uri(&bytes)}, {"uri": other}]));
    document["extensionsRequired"] = json!(["EXT_texture_webp"]);
    let loaded = load(&document);
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    let texels = mesh(loaded).texture.unwrap().srgba8.clone();
    assert_eq!(texels, [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 128], [255, 255, 255, 0]]);
    document["images"][0]["uri"] = json!(uri(&bytes[..bytes.len() - 9]));
    let loaded = load(&document);
    assert!(loaded.notes[0].starts_with("left out the texture 'image 0'"), "{:?}", loaded.notes);
    assert_eq!(mesh(loaded).texture.unwrap().srgba8, [[9, 9, 9, 255]]);
    // An image index out of range means no image.
    document["textures"][0]["extensions"]["EXT_texture_webp"]["source"] = json!(7);
    assert_eq!(mesh(load(&document)).texture.unwrap().srgba8, [[9, 9, 9, 255]]);
}

#[test]
fn gltf_required_extensions_of_materials_lights_and_textures_do_not_refuse() {
    let mut document = textured(json!({"source": 0}), json!([{"uri": uri(&png(&[[255; 4]]))}]));
    document["materials"] = json!([{"extensions": {"ADOBE_materials_thin_transparency": {},
        "KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 1, 1, 1], "diffuseTexture": {"index": 0}}}}]);
    document["extensionsRequired"] = json!([
        "KHR_materials_pbrSpecularGlossiness",
        "ADOBE_materials_thin_transparency",
        "EXT_lights_image_based",
        "MSFT_texture_dds",
        "EXT_structural_metadata"
    ]);
    let loaded = load(&document);
    let expected = "ignored the material extensions ADOBE_materials_thin_transparency: only the base colour is used";
    assert_eq!(loaded.notes, [expected]);
    assert!(mesh(loaded).is_textured());
}

#[test]
fn gltf_a_relative_center_is_noted() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let mut document = d.with(json!({
        "meshes": [{"primitives": [{"attributes": {"POSITION": position}}]}],
        "nodes": [{"mesh": 0}],
    }));
    assert_eq!(load(&document).notes, [""; 0]);
    document["extensionsUsed"] = json!(["CESIUM_RTC"]);
    document["extensions"] = json!({"CESIUM_RTC": {"center": [-123.5, 234.5, 345_678]}});
    let note = "its coordinates are relative to the centre (-123.5, 234.5, 345678) of CESIUM_RTC, which isn't added";
    assert_eq!(load(&document).notes, [note]);
}

#[test]
fn gltf_every_triangle_keeps_its_own_texture_and_alpha_mode() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let uv = d.floats(&[0.25, 0.5, 0.75, 0.5, 0.25, 0.5], "VEC2", 3);
    let colors = d.floats(&[1.0, 1.0, 1.0, 0.5].repeat(3), "VEC4", 3);
    let attributes = json!({"POSITION": position, "TEXCOORD_0": uv, "COLOR_0": colors});
    let part = |material: Value| json!({"attributes": attributes, "material": material});
    let (red, blue) = (uri(&png(&[[255, 0, 0, 100]])), uri(&png(&[[0, 0, 255, 255]])));
    let of = |texture: usize| json!({"baseColorTexture": {"index": texture}});
    let document = d.with(json!({
        "meshes": [{"primitives": [part(json!(0)), part(json!(1)), part(json!(2)), part(json!(3)), part(json!(9))]}],
        "materials": [
            {"pbrMetallicRoughness": of(0), "alphaMode": "OPAQUE", "alphaCutoff": 0.3},
            {"pbrMetallicRoughness": of(0), "alphaMode": "MASK"},
            {"pbrMetallicRoughness": of(1), "alphaMode": "MASK", "alphaCutoff": 0.125},
            {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 0.5]}, "alphaMode": "BLEND", "alphaCutoff": "x"}],
        // The same image twice is one texture.
        "textures": [{"source": 0}, {"source": 2}],
        "images": [{"uri": red.clone()}, {"uri": red}, {"uri": blue}],
        "nodes": [{"mesh": 0}],
    }));
    let m = mesh(load(&document));
    assert_eq!(m.textures().count(), 3);
    let texel = |triangle: usize| m.material(triangle).texture.map(|t| t.srgba8[0]);
    let (red, blue) = (Some([255, 0, 0, 100]), Some([0, 0, 255, 255]));
    assert_eq!((0..5).map(texel).collect::<Vec<_>>(), [red, red, blue, None, None]);
    let mask = |cutoff| AlphaMode::Mask { cutoff };
    let modes = [AlphaMode::Opaque, mask(0.5), mask(0.125), AlphaMode::Blend, AlphaMode::Opaque];
    assert_eq!((0..5).map(|i| m.material(i).alpha).collect::<Vec<_>>(), modes);
    // Opaque materials ignore alpha; else factors multiply.
    let alphas = m.alphas.as_ref().unwrap();
    assert_eq!([0, 3, 6, 9, 12].map(|i| alphas[i]), [1.0, 0.5, 0.5, 0.25, 1.0]);
    assert_eq!(m.colors.as_ref().unwrap()[9], [0.5, 1.0, 1.0]);
    assert!(m.is_see_through());
    let parts = Arc::new(m).by_texture();
    assert_eq!(parts.iter().map(|m| m.triangles.len()).collect::<Vec<_>>(), [2, 1, 2]);
}

#[test]
fn gltf_normal_maps_are_read_where_they_lie_as_the_colours_do() {
    let image = uri(&png(&[[204, 128, 230, 255]]));
    let base = |moved: Value| {
        let mut document = textured(json!({"source": 0}), json!([{"uri": image}]));
        document["materials"][0]["normalTexture"] = moved;
        document
    };
    let loaded = load(&base(json!({"index": 0, "scale": 0.5})));
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    let map = mesh(loaded).material(0).normal_map.cloned().unwrap();
    assert_eq!((map.scale, &map.image.srgba8[..]), (0.5, &[[204, 128, 230, 255]][..]));
    // A normal map with another transform than the colours is dropped, with a note; one with the same transform is
    // read.
    let transform = json!({"KHR_texture_transform": {"offset": [0.5, 0]}});
    let mut document = base(json!({"index": 0, "extensions": transform}));
    let loaded = load(&document);
    assert_eq!(loaded.notes, ["left out a normal map whose texture coordinates aren't the colours'"]);
    assert!(mesh(loaded).material(0).normal_map.is_none());
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = transform;
    assert!(mesh(load(&document)).material(0).normal_map.is_some());
    // Without a colour texture, the texture coordinates are those of the map.
    document["materials"][0]["pbrMetallicRoughness"] = json!({});
    let m = mesh(load(&document));
    assert!(m.material(0).normal_map.is_some() && m.material(0).texture.is_none());
    assert!(m.uvs.unwrap()[0][0] >= 0.5);
    // A missing or invalid reference is ignored.
    for odd in [json!({"index": 7}), json!({"index": "x"}), json!({"index": 0, "texCoord": 3}), json!(4)] {
        assert!(mesh(load(&base(odd.clone()))).material(0).normal_map.is_none(), "{odd}");
    }
}

#[test]
fn gltf_instances_are_placed_one_by_one() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let normal = d.floats(&[0.0, 0.0, 1.0].repeat(3), "VEC3", 3);
    let translation = d.floats(&[0.0, 0.0, 0.0, 5.0, 0.0, 0.0], "VEC3", 2);
    // A quarter turn about x, in normalised 16-bit integers.
    let turn: Vec<u8> = [0_i16, 0, 0, 32767, 23170, 0, 0, 23170].iter().flat_map(|v| v.to_le_bytes()).collect();
    let turn = d.view(&turn);
    let rotation =
        d.accessor(json!({"bufferView": turn, "componentType": I16, "normalized": true, "type": "VEC4", "count": 2}));
    let scale = d.floats(&[1.0, 1.0, 1.0, 2.0, 2.0, -2.0], "VEC3", 2);
    let mut document = d.with(scene(json!({"attributes": {"POSITION": position, "NORMAL": normal}})));
    document["nodes"][0]["translation"] = json!([0, 1, 0]);
    let attributes = json!({"TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale, "_ID": 0});
    document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let loaded = load(&document);
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    let m = mesh(loaded);
    let expected =
        [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 2.0, 0.0], [5.0, 1.0, 0.0], [7.0, 1.0, 0.0], [5.0, 1.0, 2.0]];
    assert_positions(&m, &expected);
    // The second instance's scale mirrors it, which reverses the winding order.
    assert_eq!(m.triangles, [[0, 1, 2], [3, 5, 4]]);
    let first = document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"].clone();
    let with = |name: &str, accessor: Value| {
        let mut document = document.clone();
        document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"][name] = accessor;
        try_load(&document)
    };
    assert!(with("SCALE", json!(position)).unwrap_err().contains("of node 0 have 2 and 3 values"));
    assert!(with("SCALE", json!(99)).unwrap_err().contains("accessor 99 does not exist: there are 5"));
    assert!(with("SCALE", json!("all")).is_err() && with("TRANSLATION", rotation.into()).is_err());
    // Attributes without placement draw the mesh once.
    let mut once = document;
    once["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = json!({"_ID": first["SCALE"]});
    assert_eq!(mesh(load(&once)).triangles.len(), 1);
}

#[test]
fn gltf_instances_by_the_thousand_are_refused_before_they_are_made() {
    let mut d = Document::default();
    let many = d.floats(&[0.0; 30_000], "VEC3", 10_000);
    let mut document = d.with(scene(json!({"attributes": {"POSITION": many}})));
    document["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": many}}});
    let error = try_load(&document).unwrap_err();
    assert!(error.contains("the scene has more than 67108864 vertices, instances counted"), "{error}");
}

#[test]
fn gltf_what_is_not_read_does_not_keep_a_file_from_opening() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let mut document =
        d.with(scene(json!({"attributes": {"POSITION": position, "MOOD": 0, "_TEMPERATURE": 0, "TEXCOORD_x": 0}})));
    document["animations"] = json!("none of your business");
    document["cameras"] = json!([{"type": "pinhole"}]);
    document["nodes"][0]["camera"] = json!(5);
    document["samplers"] = json!([{"wrapS": 1}]);
    document["materials"] = json!([{"normalTexture": {"index": 8}, "emissiveFactor": [9, 9, 9]}]);
    document["meshes"][0]["primitives"][0]["material"] = json!(4);
    document["accessors"][0]["min"] = json!("low");
    document["bufferViews"][0]["target"] = json!(1);
    let loaded = load(&document);
    let note = "ignored the attributes _TEMPERATURE: they aren't one number a vertex, or are more than 64";
    assert_eq!(loaded.notes, [note]);
    assert_eq!(mesh(loaded).triangles.len(), 1);
}

#[test]
fn gltf_the_default_scene_is_drawn_and_nothing_else() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let mut document = d.with(json!({
        "meshes": [{"primitives": [{"attributes": {"POSITION": position}}]}],
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [1, 0, 0]}, {"mesh": 0, "translation": [2, 0, 0]}],
        "scenes": [{"nodes": [0]}, {"nodes": [1, 2]}, {}],
    }));
    for (scene, expected) in [(json!(0), 1), (json!(1), 2), (Value::Null, 1)] {
        document["scene"] = scene;
        assert_eq!(mesh(load(&document)).triangles.len(), expected);
    }
    document["scene"] = json!(2);
    assert!(try_load(&document).unwrap_err().contains("nothing to draw"));
    document["scene"] = json!(3);
    assert!(try_load(&document).unwrap_err().contains("scene 3 does not exist"));
}

#[test]
fn gltf_points_lines_and_triangles_keep_their_rule() {
    let mut d = Document::default();
    let position = d.floats(&QUAD, "VEC3", 4);
    let primitive = |mode: u32| json!({"attributes": {"POSITION": position}, "mode": mode});
    let document = |modes: &[u32]| {
        let primitives: Vec<Value> = modes.iter().map(|&mode| primitive(mode)).collect();
        d.with(json!({"meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0}]}))
    };
    for (mode, triangles) in [(4, [[0, 1, 2], [0, 0, 0]]), (5, [[0, 1, 2], [2, 1, 3]]), (6, [[0, 1, 2], [0, 2, 3]])] {
        let m = mesh(load(&document(&[mode])));
        // Four vertices make one triangle as a list, and two as a strip or a fan.
        assert_eq!(m.triangles[..], triangles[..m.triangles.len()], "{mode}");
        assert_eq!(m.triangles.len(), if mode == 4 { 1 } else { 2 });
    }
    let loaded = load(&document(&[0, 1, 2, 3]));
    assert_eq!(loaded.notes, ["ignored 3 primitives that are lines"]);
    assert_eq!(points(loaded).len(), 4);
    let loaded = load(&document(&[0, 5]));
    assert_eq!(loaded.notes, ["ignored 4 points and 0 Gaussian splats beside the mesh"]);
    let error = try_load(&document(&[1, 3])).unwrap_err();
    assert!(error.contains("the scene has nothing to draw but 2 primitives that are lines"), "{error}");
}

#[test]
fn gltf_glb_opens_however_its_json_chunk_is_padded() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let mut document = d.with(scene(json!({"attributes": {"POSITION": position}})));
    document["buffers"] = json!([{"byteLength": 36}]);
    let mut json = serde_json::to_vec(&document).unwrap();
    while json.len() % 4 != 1 {
        json.push(b' ');
    }
    // Padding counted and written; written but not counted; neither; and with zeros.
    for (counted, written, filler) in [(3, 3, b' '), (0, 3, b' '), (0, 0, b' '), (3, 3, 0)] {
        let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
        glb.extend((json.len() as u32 + counted).to_le_bytes());
        glb.extend(b"JSON");
        glb.extend(&json);
        glb.extend(vec![filler; written]);
        glb.extend(36_u32.to_le_bytes());
        glb.extend(b"BIN\0");
        glb.extend(floats(&TRIANGLE));
        let loaded = load_bytes(&glb, None, Path::new("t"), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(mesh(loaded).triangles.len(), 1, "{counted} {written}");
    }
}

#[test]
fn gltf_instances_are_limited_whatever_multiplies_them() {
    let mut d = Document::default();
    let position = d.accessor(json!({"componentType": F32, "type": "VEC3", "count": 4000}));
    d.view(&[0; 4000]);
    let targets: Vec<Value> = (0..20_000).map(|_| json!({"POSITION": position})).collect();
    let document = d.with(json!({
        "meshes": [{"weights": vec![1.0; targets.len()], "primitives": [{"attributes": {"POSITION": position},
        "targets": targets}]}],
        "nodes": [{"mesh": 0}],
    }));
    assert!(try_load(&document).unwrap_err().contains("more than 67108864 vertices"));
}

/// Two triangles of a unit square with a colour per vertex, encoded by draco-core 2.3 at its default speed.
#[cfg(feature = "draco")]
const DRACO_SQUARE: &[u8] = include_bytes!("data/square.drc");

#[cfg(feature = "draco")]
#[test]
fn gltf_draco_meshes_are_decompressed() {
    let bytes = DRACO_SQUARE;
    let document = |bytes: &[u8]| {
        let mut d = Document::default();
        let view = d.view(bytes);
        let position = d.accessor(json!({"componentType": F32, "type": "VEC3", "count": 4}));
        let color = d.accessor(json!({"componentType": U8, "normalized": true, "type": "VEC3", "count": 4}));
        let indices = d.accessor(json!({"componentType": U8, "type": "SCALAR", "count": 6}));
        let extension = json!({"bufferView": view, "attributes": {"POSITION": 0, "COLOR_0": 1}});
        let mut document = d.with(scene(json!({
            "attributes": {"POSITION": position, "COLOR_0": color}, "indices": indices,
            "extensions": {"KHR_draco_mesh_compression": extension}})));
        document["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
        // A mesh that is used twice is decompressed once.
        document["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}]);
        document["scenes"] = json!([{"nodes": [0, 1]}]);
        document
    };
    let m = mesh(load(&document(bytes)));
    assert_eq!((m.positions.len(), m.triangles.len()), (8, 4));
    let colors = m.colors.as_ref().unwrap();
    for (p, color) in positions(&m).into_iter().zip(colors) {
        // Only the far corner has blue.
        let corner = p.round();
        assert!((p - corner).length() < 1e-3, "{p}");
        assert_eq!(*color, [1.0, 0.0, if corner.x + corner.y == 2.0 { 1.0 } else { 0.0 }]);
    }
    let area: f64 = m
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| m.positions.get(i as usize));
            (b - a).cross(c - a).z / 2.0
        })
        .sum();
    assert!((area - 2.0).abs() < 1e-2, "{area}");
    for end in 0..bytes.len() {
        let error = try_load(&document(&bytes[..end])).unwrap_err();
        assert!(error.contains("a mesh compressed by Draco can't be read"), "{end}: {error}");
    }
}

/// Encoders of `EXT_meshopt_compression`'s streams in their simplest form.
#[cfg(feature = "meshopt")]
mod meshopt {
    /// Encodes a vertex stream, version 0, of at most 16 vertices: every byte is a literal difference.
    pub(crate) fn attributes(data: &[u8], stride: usize) -> Vec<u8> {
        let mut stream = vec![0xa0];
        let count = data.len() / stride;
        assert!(count <= 16);
        for byte in 0..stride {
            // One group of 16, whose two mode bits mean literal differences.
            stream.push(3);
            let mut last = data[byte];
            for i in 0..16 {
                let value = data.get(i * stride + byte).copied().unwrap_or(last);
                let difference = value.wrapping_sub(last) as i8;
                stream.push(((difference << 1) ^ (difference >> 7)) as u8);
                last = value;
            }
        }
        // The tail: the first vertex, at the end of at least 32 bytes.
        stream.resize(stream.len() + 32_usize.saturating_sub(stride), 0);
        stream.extend(&data[..stride]);
        stream
    }

    fn index(value: u32, last: &mut u32, stream: &mut Vec<u8>) {
        let difference = value.wrapping_sub(*last) as i32;
        let coded = ((difference << 1) ^ (difference >> 31)) as u32;
        assert!(coded < 128, "one byte is enough here");
        stream.push(coded as u8);
        *last = value;
    }

    /// Encodes an index stream, version 1: the first triangle is 0 1 2, the others are explicit.
    pub(crate) fn triangles(indices: &[u32]) -> Vec<u8> {
        assert_eq!(indices[..3], [0, 1, 2]);
        let rest = indices.len() / 3 - 1;
        let mut stream = vec![0xe1, 0xfe];
        stream.extend(vec![0xff; rest]);
        stream.push(0);
        let mut last = 0;
        for triangle in indices[3..].chunks(3) {
            stream.push(0xff);
            triangle.iter().for_each(|&i| index(i, &mut last, &mut stream));
        }
        stream.extend([0; 16]);
        stream
    }

    /// Encodes an index sequence, version 1, against one of its two baselines.
    pub(crate) fn sequence(indices: &[u32]) -> Vec<u8> {
        let mut stream = vec![0xd1];
        let mut last = 0_u32;
        for &i in indices {
            let difference = i.wrapping_sub(last) as i32;
            let coded = ((difference << 1) ^ (difference >> 31)) as u32;
            // The lowest bit selects the baseline.
            stream.push((coded << 1) as u8);
            last = i;
        }
        stream.extend([0; 4]);
        stream
    }
}

#[cfg(feature = "meshopt")]
#[test]
fn gltf_meshopt_buffers_are_decompressed() {
    // 8-bit octahedral normals: +z, then +x, then −z, whose corner is folded out.
    let normals = [[0_i8, 0, 127, 0], [127, 0, 127, 0], [127, 127, 127, 0], [0, 0, 127, 0]];
    let normals: Vec<u8> = normals.as_flattened().iter().map(|&n| n as u8).collect();
    let indices = [0, 1, 2, 2, 1, 3];
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        for mode in ["TRIANGLES", "INDICES"] {
            let index_stream =
                if mode == "TRIANGLES" { meshopt::triangles(&indices) } else { meshopt::sequence(&indices) };
            let streams = [
                (meshopt::attributes(&floats(&QUAD), 12), 12, 4, "ATTRIBUTES", "NONE"),
                (meshopt::attributes(&normals, 4), 4, 4, "ATTRIBUTES", "OCTAHEDRAL"),
                (index_stream, 2, 6, mode, "NONE"),
            ];
            let mut d = Document::default();
            for (stream, stride, count, mode, filter) in streams {
                let view = d.view(&stream);
                let mut packed = d.views[view].take();
                for (key, value) in [
                    ("byteStride", json!(stride)),
                    ("count", json!(count)),
                    ("mode", json!(mode)),
                    ("filter", json!(filter)),
                ] {
                    packed[key] = value;
                }
                // The view itself is in a fallback buffer without data.
                d.views[view] = json!({"buffer": 1, "byteLength": stride * count, "extensions": {name: packed}});
            }
            let position = d.accessor(json!({"bufferView": 0, "componentType": F32, "type": "VEC3", "count": 4}));
            d.views[1]["byteStride"] = json!(4);
            let normal = d.accessor(
                json!({"bufferView": 1, "componentType": I8, "normalized": true, "type": "VEC3", "count": 4}),
            );
            let corners = d.accessor(json!({"bufferView": 2, "componentType": U16, "type": "SCALAR", "count": 6}));
            let primitive = json!({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": corners});
            let mut document = d.with(scene(primitive));
            document["extensionsRequired"] = json!([name]);
            document["buffers"]
                .as_array_mut()
                .unwrap()
                .push(json!({"byteLength": 1000, "extensions": {name: {"fallback": true}}}));
            let m = mesh(load(&document));
            assert_positions(&m, &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
            assert_eq!(m.triangles[..], [[0, 1, 2], [2, 1, 3]]);
            assert_eq!(m.normals.unwrap()[..3], [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
            // A stream that states more than its bytes can contain is refused before any allocation.
            document["bufferViews"][0]["extensions"][name]["count"] = json!(1_u64 << 40);
            let error = try_load(&document).unwrap_err();
            assert!(error.contains("more elements than its bytes can hold"), "{error}");
            document["bufferViews"][0]["extensions"][name]["count"] = json!(4);
            document["bufferViews"][0]["extensions"][name]["byteLength"] = json!(20);
            let error = try_load(&document).unwrap_err();
            assert!(error.contains("bufferView 0 is not well compressed"), "{error}");
        }
    }
}
