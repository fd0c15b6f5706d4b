//! Vertex attributes: colours, opacity, precision and application-specific attributes.

use super::*;

/// Returns a document of one triangle with texture coordinates, a material, and perhaps vertex colours. `more` are
/// further keys of the document.
fn triangle(material: Value, colors: Option<[[f32; 4]; 3]>, more: Value) -> Value {
    let mut document = Document::default();
    let positions = document.floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.], "VEC3", 3);
    let uvs = document.floats(&[0.25, 0.25, 0.75, 0.25, 0.25, 0.75], "VEC2", 3);
    let mut attributes = json!({"POSITION": positions, "TEXCOORD_0": uvs});
    if let Some(colors) = colors {
        attributes["COLOR_0"] = json!(document.floats(colors.as_flattened(), "VEC4", 3));
    }
    let mut rest = json!({
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0}]}],
        "materials": [material],
    });
    rest.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    document.with(rest)
}

fn data_uri(texels: &[[u8; 4]; 1]) -> String {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(texels.as_flattened()).unwrap();
    format!("data:image/png,{}", bytes.iter().map(|b| format!("%{b:02x}")).collect::<String>())
}

#[test]
fn emissive_colors_are_added_to_base_colors() {
    let read = |material: Value, more: Value| {
        let loaded = load(&triangle(material, None, more));
        let is_noted = loaded.notes.iter().any(|n| n.contains("added the emissive colours of 1 material"));
        let found = mesh(loaded);
        (found.colors.map(|all| all[0]), found.texture.map(|t| t.srgba8[0]), is_noted)
    };
    let black = |more: Value| {
        let mut material = json!({"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}});
        material.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        material
    };
    let none = || json!({});
    assert_eq!(read(black(json!({"emissiveFactor": [1, 0.5, 0]})), none()), (Some([1.0, 0.5, 0.0]), None, true));
    assert_eq!(read(black(json!({"emissiveFactor": [0, 0, 0]})), none()), (Some([0.0; 3]), None, false));
    let grey =
        json!({"pbrMetallicRoughness": {"baseColorFactor": [0.25, 0.25, 0.25, 1]}, "emissiveFactor": [0.5, 0, 1]});
    assert_eq!(read(grey, none()), (Some([0.75, 0.25, 1.0]), None, true));
    let strong = json!({"emissiveFactor": [0.25, 0, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 2}}});
    assert_eq!(read(black(strong), none()), (Some([0.5, 0.0, 0.0]), None, true));
    let unlit = json!({"emissiveFactor": [1, 0, 0], "extensions": {"KHR_materials_unlit": {}}});
    assert_eq!(read(black(unlit), none()), (Some([0.0; 3]), None, false));
    let images = json!({
        "images": [{"uri": data_uri(&[[0, 255, 0, 255]])}, {"uri": data_uri(&[[255, 0, 0, 255]])}],
        "textures": [{"source": 0}, {"source": 1}],
    });
    let glow = json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}});
    assert_eq!(read(black(glow.clone()), images.clone()), (None, Some([0, 255, 0, 255]), true));
    let mut both = glow.clone();
    both["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": 1}});
    assert_eq!(read(both.clone(), images.clone()), (None, Some([255, 255, 0, 255]), true));
    // Half of red, and a factor alone.
    both["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.215_860_5, 1, 1, 1]);
    assert_eq!(read(both.clone(), images.clone()).1, Some([128, 255, 0, 255]));
    let factor = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}, "emissiveFactor": [0, 0, 1]});
    assert_eq!(read(factor, images.clone()).1, Some([255, 0, 255, 255]));
    // Emission with other texture coordinates is dropped, with a note.
    both["emissiveTexture"]["texCoord"] = json!(1);
    let loaded = load(&triangle(both, None, images));
    assert!(loaded.notes.iter().any(|n| n.starts_with("left out an emissive texture")), "{:?}", loaded.notes);
}

#[test]
fn vertex_colors_that_are_all_transparent_are_opaque() {
    let read = |mode: &str, alphas: [f32; 3]| {
        let colors = alphas.map(|a| [1.0, 0.5, 0.0, a]);
        let loaded = load(&triangle(json!({"alphaMode": mode}), Some(colors), json!({})));
        let is_noted = loaded.notes.iter().any(|n| n.contains("its alphas are all 0"));
        (mesh(loaded).alphas, is_noted)
    };
    assert_eq!(read("BLEND", [0.0; 3]), (None, true));
    assert_eq!(read("MASK", [0.0; 3]), (None, true));
    assert_eq!(read("BLEND", [0.0, 0.5, 1.0]), (Some(vec![0.0, 0.5, 1.0]), false));
    assert_eq!(read("OPAQUE", [0.0; 3]), (None, false));
}

#[test]
fn rounded_coordinates_are_told_unless_a_node_moves_them() {
    let read = |x: f32, translation: f64| {
        let mut document = Document::default();
        let positions = document.floats(&[x, 0., 0., x + 4., 0., 0., x, 4., 0.], "VEC3", 3);
        let rest = json!({
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "translation": [translation, 0, 0]}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": positions}}]}],
        });
        load(&document.with(rest)).notes
    };
    assert!(read(0.0, 4e6).is_empty());
    let notes = read(4e6, 0.0);
    assert!(notes[0].contains("rounded to steps of 0.25 there"), "{notes:?}");
}

#[test]
fn own_attributes_are_columns_of_the_vertices() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let heat = d.floats(&[1.0, -2.5, f32::NAN], "SCALAR", 3);
    let part = d.column(&[7, 0, 9, 0, 255, 255], U16, "SCALAR", 3);
    let vector = d.floats(&TRIANGLE, "VEC3", 3);
    let document = d.with(json!({
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": position, "_HEAT": heat, "_VECTOR": vector}},
            {"attributes": {"POSITION": position, "_HEAT": heat, "_PART": part}},
            {"attributes": {"POSITION": position}},
        ]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
    }));
    let loaded = load(&document);
    assert_eq!(loaded.attributes, ["position", "_HEAT", "_PART"]);
    assert_eq!(loaded.notes, ["ignored the attributes _VECTOR: they aren't one number a vertex, or are more than 64"]);
    let m = mesh(loaded);
    let values = |name: &str| {
        let column = m.vertex_extras.iter().find(|extra| extra.name == name).unwrap();
        (0..9).map(|i| column.values.get(i)).map(|v| if v.is_nan() { 999.0 } else { v }).collect::<Vec<_>>()
    };
    assert_eq!(values("_HEAT"), [1.0, -2.5, 999.0, 1.0, -2.5, 999.0, 999.0, 999.0, 999.0]);
    assert_eq!(values("_PART"), [999.0, 999.0, 999.0, 7.0, 9.0, 65_535.0, 999.0, 999.0, 999.0]);
    // Points have these attributes, too.
    let primitive = json!({"mode": 0, "attributes": {"POSITION": position, "_PART": part}});
    let p = points(load(&d.with(scene(primitive))));
    assert_eq!((p.extras[0].name.as_str(), p.extras[0].values.get(2)), ("_PART", 65_535.0));
    // An attribute of another length than the vertices.
    let short = d.floats(&[1.0], "SCALAR", 1);
    let primitive = json!({"attributes": {"POSITION": position, "_PART": short}});
    assert!(try_load(&d.with(scene(primitive))).unwrap_err().contains("_PART has 1 values"));
}

#[test]
fn own_attributes_of_many_names_are_bounded() {
    let mut d = Document::default();
    let position = d.floats(&TRIANGLE, "VEC3", 3);
    let heat = d.floats(&[1.0, 2.0, 3.0], "SCALAR", 3);
    let primitive = |p: usize| {
        let mut attributes = json!({"POSITION": position});
        (0..50).for_each(|i| attributes[format!("_A{}", 50 * p + i)] = json!(heat));
        json!({"attributes": attributes})
    };
    let primitives: Vec<Value> = (0..4).map(primitive).collect();
    let document = d.with(json!({"meshes": [{"primitives": primitives}], "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}]}));
    let loaded = load(&document);
    assert!(loaded.notes[0].contains("or are more than 64"), "{:?}", loaded.notes);
    assert_eq!(mesh(loaded).vertex_extras.len(), 64);
}
