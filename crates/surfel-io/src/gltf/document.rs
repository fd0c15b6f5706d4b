//! The document: JSON parsed to the types of the crate `gltf`, and checked so that traversal can't panic.
//!
//! The crate gets only the parts of the JSON that are read. Errors in animations, cameras, samplers or most of a
//! material therefore don't prevent loading. Extensions and attributes that the crate has no types for are read from
//! the JSON itself.

use crate::error::{Problem, quote};
use crate::scene_file::json_problem;
use gltf::Primitive;
use gltf::json::Root;
use gltf::json::validation::Error;
use serde_json::{Map, Value};
use std::collections::BTreeSet;

/// Extensions that every build of Surfel supports, and that a file may list as required. Draco and meshopt depend on
/// Cargo features.
const READ: [&str; 4] = ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_gaussian_splatting", INSTANCES];
/// Extensions that Surfel doesn't support, but that a file may list as required. Shape and base colour don't depend on
/// them.
const HARMLESS: [&str; 6] = [
    "KHR_animation_pointer",
    "KHR_xmp_json_ld",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_structural_metadata",
    "KHR_techniques_webgl",
];
/// Parts of the names of further extensions that Surfel doesn't support, but that a file may list as required. Material
/// extensions leave the base colour valid, and lights aren't needed. A texture in an unsupported format has a fallback,
/// or a note reports it as missing.
const HARMLESS_PARTS: [&str; 3] = [MATERIAL, "_lights_", "_texture_"];
/// Part of the name of every material extension.
const MATERIAL: &str = "_materials_";
/// Extension with the legacy material model, whose diffuse colour is used as the base colour.
const SPECULAR_GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";
/// Extension with the factor by which a material's emissive colour is multiplied.
pub(super) const EMISSIVE_STRENGTH: &str = "KHR_materials_emissive_strength";
pub(super) const UNLIT: &str = "KHR_materials_unlit";
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";
pub(super) const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
pub(super) const GAUSSIANS: &str = "KHR_gaussian_splatting";
pub(super) const WEBP: &str = "EXT_texture_webp";
pub(super) const INSTANCES: &str = "EXT_mesh_gpu_instancing";

/// A document whose indices are all in range and whose enumerations are all known.
pub(super) struct CheckedDocument {
    pub(super) gltf: gltf::Document,
    /// The unmodified, unchecked JSON. Extensions are read from it, and numbers that the crate `gltf` rounds.
    pub(super) raw: Value,
    pub(super) notes: Vec<String>,
}

impl CheckedDocument {
    /// Returns the extension `name` of a primitive of the mesh with index `mesh`.
    pub(super) fn primitive_extension(&self, primitive: &Primitive<'_>, mesh: usize, name: &str) -> Option<&Value> {
        self.primitive(primitive, mesh)?.get("extensions")?.get(name)
    }

    /// Returns the accessor index of an attribute that the crate `gltf` has no name for; the accessor may not exist.
    pub(super) fn attribute(&self, primitive: &Primitive<'_>, mesh: usize, name: &str) -> Option<usize> {
        let index = self.primitive(primitive, mesh)?.get("attributes")?.get(name)?.as_u64()?;
        Some(usize::try_from(index).unwrap_or(usize::MAX))
    }

    /// Returns the names of a primitive's application-specific attributes, which begin with an underscore.
    pub(super) fn custom_attributes(&self, primitive: &Primitive<'_>, mesh: usize) -> impl Iterator<Item = &str> {
        let attributes = self.primitive(primitive, mesh).and_then(|primitive| primitive.get("attributes")?.as_object());
        attributes.into_iter().flat_map(Map::keys).map(String::as_str).filter(|name| name.starts_with('_'))
    }

    fn primitive(&self, primitive: &Primitive<'_>, mesh: usize) -> Option<&Value> {
        self.raw.get("meshes")?.get(mesh)?.get("primitives")?.get(primitive.index())
    }

    /// Returns the meshopt extension of the element `index` of the array `array`, which contains the buffer views or
    /// the buffers.
    pub(super) fn meshopt(&self, array: &str, index: usize) -> Option<&Value> {
        let extensions = self.raw.get(array)?.get(index)?.get("extensions")?;
        MESHOPT.iter().find_map(|name| extensions.get(name))
    }

    /// Returns the extension `name` of the texture with index `index`.
    pub(super) fn texture_extension(&self, index: usize, name: &str) -> Option<&Value> {
        self.raw.get("textures")?.get(index)?.get("extensions")?.get(name)
    }

    /// Returns the reference to a material's normal texture, as JSON.
    pub(super) fn normal_texture(&self, material: usize) -> Option<&Value> {
        self.material(material)?.get("normalTexture")
    }

    /// Returns a material's JSON as the document states it, unchecked.
    pub(super) fn material(&self, material: usize) -> Option<&Value> {
        self.raw.get("materials")?.get(material)
    }

    /// Returns the names of all extensions of the texture with index `index`.
    pub(super) fn texture_extensions(&self, index: usize) -> impl Iterator<Item = &str> {
        let extensions = self.raw.get("textures").and_then(|all| all.get(index)?.get("extensions")?.as_object());
        extensions.into_iter().flat_map(Map::keys).map(String::as_str)
    }

    /// Returns the accessor indices of a node's instances (`EXT_mesh_gpu_instancing`), by attribute name.
    pub(super) fn instancing(&self, node: usize) -> Option<&Map<String, Value>> {
        self.raw.get("nodes")?.get(node)?.get("extensions")?.get(INSTANCES)?.get("attributes")?.as_object()
    }
}

/// Parses the JSON of a document, and checks it.
pub(super) fn parse(json: &[u8]) -> Result<CheckedDocument, Problem> {
    let raw: Value = serde_json::from_slice(json).map_err(|e| not_valid(&e))?;
    let version = raw.pointer("/asset/version").and_then(Value::as_str).unwrap_or_default();
    if !version.starts_with("2.") {
        let what = format!("the glTF version is {}", quote(version));
        return Err(Problem::new(what).expected("\"asset\": {\"version\": \"2.0\"}"));
    }
    check_required(&raw)?;
    let mut read = raw.clone();
    let mut notes = strip(&mut read);
    notes.extend(relative_center(&raw));
    // The detour through text uses the crate's own parsing function, which is already compiled; another instantiation
    // would add seconds to each build.
    let text = serde_json::to_vec(&read).map_err(|e| not_valid(&e))?;
    let root = Root::from_slice(&text).map_err(|error| {
        // The original document gives the right location of the error.
        Root::from_slice(json).err().map_or_else(|| Problem { location: None, ..not_valid(&error) }, |e| not_valid(&e))
    })?;
    Ok(CheckedDocument { gltf: validate(root, &read)?, raw, notes })
}

fn not_valid(error: &serde_json::Error) -> Problem {
    let problem = json_problem(error);
    Problem { what: format!("is not a valid glTF document: {}", problem.what), ..problem }
}

/// Checks that the file requires no unsupported extension on which shape or base colour depends.
fn check_required(raw: &Value) -> Result<(), Problem> {
    for name in items(raw, "extensionsRequired").filter_map(Value::as_str) {
        let feature = match name {
            DRACO if cfg!(feature = "draco") => continue,
            name if MESHOPT.contains(&name) && cfg!(feature = "meshopt") => continue,
            name if READ.contains(&name) || HARMLESS.contains(&name) => continue,
            name if HARMLESS_PARTS.iter().any(|part| name.contains(part)) => continue,
            DRACO => Some("draco"),
            name if MESHOPT.contains(&name) => Some("meshopt"),
            _ => None,
        };
        let problem = Problem::new(format!("requires the glTF extension {}, which is not read", quote(name)));
        return Err(match feature {
            Some(feature) => problem.help(format!("build with the Cargo feature \"{feature}\" of surfel-io")),
            None => problem.help("export it again without that extension"),
        });
    }
    Ok(())
}

/// Returns a note if the document states that its coordinates are relative to a centre, which isn't added.
fn relative_center(raw: &Value) -> Option<String> {
    let center = raw.pointer("/extensions/CESIUM_RTC/center")?.as_array()?;
    let center: Vec<String> =
        center.iter().take(3).filter_map(Value::as_f64).map(|number| number.to_string()).collect();
    Some(format!("its coordinates are relative to the centre ({}) of CESIUM_RTC, which isn't added", center.join(", ")))
}

fn items<'a>(of: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> + use<'a> {
    of.get(key).and_then(Value::as_array).into_iter().flatten()
}

fn objects<'a>(
    of: &'a mut Map<String, Value>,
    key: &str,
) -> impl Iterator<Item = &'a mut Map<String, Value>> + use<'a> {
    of.get_mut(key).and_then(Value::as_array_mut).into_iter().flatten().filter_map(Value::as_object_mut)
}

fn keep(object: &mut Map<String, Value>, keys: &[&str]) {
    object.retain(|key, _| keys.contains(&key.as_str()));
}

/// Removes the parts of a document that aren't read, or not by the crate `gltf`. Returns notes about removed parts that
/// change the image.
fn strip(raw: &mut Value) -> Vec<String> {
    let Some(root) = raw.as_object_mut() else { return Vec::new() };
    keep(
        root,
        &[
            "asset",
            "scene",
            "scenes",
            "nodes",
            "meshes",
            "skins",
            "accessors",
            "bufferViews",
            "buffers",
            "materials",
            "textures",
            "images",
        ],
    );
    for node in objects(root, "nodes") {
        keep(node, &["children", "mesh", "skin", "matrix", "translation", "rotation", "scale", "weights"]);
    }
    for scene in objects(root, "scenes") {
        keep(scene, &["nodes"]);
        scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
    }
    objects(root, "skins").for_each(|skin| keep(skin, &["inverseBindMatrices", "joints"]));
    objects(root, "textures").for_each(|texture| keep(texture, &["source"]));
    objects(root, "images").for_each(|image| keep(image, &["uri", "bufferView"]));
    let view = ["buffer", "byteOffset", "byteLength", "byteStride"];
    objects(root, "buffers").for_each(|buffer| keep(buffer, &["uri", "byteLength"]));
    objects(root, "bufferViews").for_each(|v| keep(v, &view));
    let accessor = ["bufferView", "byteOffset", "count", "componentType", "type", "normalized", "sparse"];
    objects(root, "accessors").for_each(|a| keep(a, &accessor));
    let mut ignored = BTreeSet::new();
    objects(root, "materials").for_each(|material| strip_material(material, &mut ignored));
    let materials = root.get("materials").and_then(Value::as_array).map_or(0, Vec::len) as u64;
    for mesh in objects(root, "meshes") {
        keep(mesh, &["primitives", "weights"]);
        objects(mesh, "primitives").for_each(|primitive| strip_primitive(primitive, materials, &mut ignored));
    }
    let mut notes = Vec::new();
    if !ignored.is_empty() {
        let names: Vec<String> =
            ignored.iter().take(12).map(|name| quote(name).trim_matches('\'').to_owned()).collect();
        notes.push(format!("ignored the material extensions {}: only the base colour is used", names.join(", ")));
    }
    notes
}

fn strip_material(material: &mut Map<String, Value>, ignored: &mut BTreeSet<String>) {
    keep(material, &["pbrMetallicRoughness", "alphaMode", "alphaCutoff", "extensions"]);
    let known = ["OPAQUE", "MASK", "BLEND"];
    if material.get("alphaMode").is_some_and(|mode| !mode.as_str().is_some_and(|mode| known.contains(&mode))) {
        material.remove("alphaMode");
    }
    if material.get("alphaCutoff").is_some_and(|cutoff| !cutoff.is_number()) {
        material.remove("alphaCutoff");
    }
    if let Some(pbr) = material.get_mut("pbrMetallicRoughness").and_then(Value::as_object_mut) {
        keep(pbr, &["baseColorFactor", "baseColorTexture"]);
    }
    if let Some(extensions) = material.get_mut("extensions").and_then(Value::as_object_mut) {
        note_ignored(extensions, ignored);
        keep(extensions, &[SPECULAR_GLOSSINESS]);
        if let Some(pbr) = extensions.get_mut(SPECULAR_GLOSSINESS).and_then(Value::as_object_mut) {
            keep(pbr, &["diffuseFactor", "diffuseTexture"]);
        }
    }
}

fn note_ignored(extensions: &Map<String, Value>, ignored: &mut BTreeSet<String>) {
    let is_read = |name: &str| [SPECULAR_GLOSSINESS, EMISSIVE_STRENGTH].contains(&name);
    let names = extensions.keys().filter(|name| name.contains(MATERIAL) && !is_read(name));
    ignored.extend(names.cloned());
}

fn strip_primitive(primitive: &mut Map<String, Value>, materials: u64, ignored: &mut BTreeSet<String>) {
    keep(primitive, &["attributes", "indices", "material", "mode", "targets", "extensions"]);
    if primitive.get("material").and_then(Value::as_u64).is_some_and(|material| material >= materials) {
        primitive.remove("material");
    }
    if let Some(extensions) = primitive.remove("extensions").as_ref().and_then(Value::as_object) {
        note_ignored(extensions, ignored);
    }
    if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
        attributes.retain(|name, _| is_known(name));
    }
    objects(primitive, "targets").for_each(|target| keep(target, &["POSITION", "NORMAL"]));
}

/// True for attributes that the crate `gltf` has a name for.
fn is_known(name: &str) -> bool {
    let numbered = ["COLOR_", "TEXCOORD_", "JOINTS_", "WEIGHTS_"];
    let number = numbered.iter().find_map(|start| name.strip_prefix(start));
    matches!(name, "POSITION" | "NORMAL" | "TANGENT") || number.is_some_and(|n| n.parse::<u32>().is_ok())
}

/// Validates a document by the crate `gltf`. Returns an error for anything that would make the crate panic.
fn validate(root: Root, read: &Value) -> Result<gltf::Document, Problem> {
    // The crate's own validation reads positions before it has checked their index.
    let accessors = root.accessors.len();
    for attributes in root.meshes.iter().flat_map(|m| &m.primitives).map(|p| &p.attributes) {
        if let Some(index) = attributes.values().find(|index| index.value() >= accessors) {
            return Err(out_of_range("accessor", index.value(), accessors));
        }
    }
    if let Err(gltf::Error::Validation(found)) = gltf::Document::from_json(root.clone())
        && let Some((path, error)) = found.iter().find(|(path, error)| !is_harmless(path.as_str(), *error))
    {
        return Err(describe(path.as_str(), *error, read));
    }
    Ok(gltf::Document::from_json_without_validation(root))
}

/// True for validation errors that don't prevent reading: odd strides, and missing values of any kind, such as bounds
/// of positions or buffer views of accessors.
fn is_harmless(path: &str, error: Error) -> bool {
    match error {
        Error::Missing => true,
        Error::Invalid => path.ends_with("byteStride"),
        _ => false,
    }
}

/// Converts a validation error of the crate `gltf` to a problem.
fn describe(path: &str, error: Error, raw: &Value) -> Problem {
    let keys: Vec<&str> = path.split(['.', '[', ']', '"']).filter(|key| !key.is_empty()).collect();
    let value = keys.iter().try_fold(raw, |value, key| match value {
        Value::Array(items) => items.get(key.parse::<usize>().ok()?),
        other => other.get(key),
    });
    let place = quote(path);
    if error == Error::IndexOutOfBounds {
        // The last key that isn't a number states what the index refers to.
        let key = keys.iter().rev().find(|key| key.parse::<usize>().is_err()).copied().unwrap_or_default();
        let (what, array) = match key {
            "mesh" => ("mesh", "meshes"),
            "skin" => ("skin", "skins"),
            "scene" => ("scene", "scenes"),
            "children" | "joints" | "nodes" => ("node", "nodes"),
            "bufferView" => ("bufferView", "bufferViews"),
            "buffer" => ("buffer", "buffers"),
            "material" => ("material", "materials"),
            "index" => ("texture", "textures"),
            "source" => ("image", "images"),
            _ => ("accessor", "accessors"),
        };
        let count = items(raw, array).count();
        if let Some(index) = value.and_then(Value::as_u64) {
            return out_of_range(what, index as usize, count);
        }
        return Problem::new(format!("{place} refers to a {what} that does not exist: there are {count}"));
    }
    let shown = value.map_or("missing".into(), |value| quote(value.to_string()));
    if keys.last() == Some(&"mode") {
        return Problem::new(format!("a primitive has mode {}", shown.trim_matches('\''))).expected("0 to 6");
    }
    Problem::new(format!("is not a valid glTF document: {place} is {shown}")).expected("a value that glTF 2.0 knows")
}

/// Returns the problem of a reference to something that doesn't exist: its index isn't less than the count.
pub(super) fn out_of_range(what: &str, index: usize, count: usize) -> Problem {
    Problem::new(format!("{what} {index} does not exist: there are {count}"))
        .help("export the file again: it is damaged")
}
