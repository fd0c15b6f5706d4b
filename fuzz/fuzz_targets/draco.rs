//! Reads arbitrary bytes as a Draco-compressed mesh within a GLB file.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::{Format, LoadOptions, load_bytes};

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{0}}}],"bufferViews":[{{"buffer":0,
        "byteLength":{0}}}],
"accessors":[{{"componentType":5126,"type":"VEC3","count":4}}],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":
{{"POSITION":0,"NORMAL":0,"COLOR_0":0,"TEXCOORD_0":0}},"extensions":{{"KHR_draco_mesh_compression":{{"bufferView":0,
"attributes":{{"POSITION":0,"NORMAL":1,"COLOR_0":2,"TEXCOORD_0":3}}}}}}}}]}}]}}"#,
        bytes.len()
    );
    let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", bytes)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    if let Err(error) = load_bytes(&glb, Some(Format::Glb), Path::new("t"), &LoadOptions::default()) {
        assert!(error.to_string().lines().count() <= 4);
    }
});
