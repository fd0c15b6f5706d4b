//! Reads arbitrary bytes as a meshopt-compressed buffer within a GLB file. The first four bytes select mode, filter,
//! stride and count.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use surfel_io::{Format, LoadOptions, load_bytes};

const MODES: [&str; 3] = ["ATTRIBUTES", "TRIANGLES", "INDICES"];
const FILTERS: [&str; 5] = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"];

// A decoder's panic that the reader catches isn't a finding: without libFuzzer's hook it unwinds as in the program.
fuzz_target!(init: std::panic::set_hook(Box::new(|_| ())), |bytes: &[u8]| {
    let [mode, filter, stride, count, stream @ ..] = bytes else { return };
    let (mode, filter) = (MODES[usize::from(*mode) % 3], FILTERS[usize::from(*filter) % 5]);
    let (stride, count) = (usize::from(*stride), usize::from(*count) * 3);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{0}}}],"bufferViews":[{{"buffer":0,"byteLength":{1},
"extensions":{{"EXT_meshopt_compression":{{"buffer":0,"byteLength":{0},"byteStride":{stride},"count":{count},
"mode":"{mode}","filter":"{filter}"}}}}}}],"accessors":[{{"bufferView":0,"componentType":5121,"type":"VEC3",
"count":1}}],
"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"mode":0,"attributes":{{"POSITION":0}}}}]}}]}}"#,
        stream.len(),
        stride * count
    );
    let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", stream)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    if let Err(error) = load_bytes(&glb, Some(Format::Glb), Path::new("t"), &LoadOptions::default()) {
        assert!(error.to_string().lines().count() <= 4);
    }
});
