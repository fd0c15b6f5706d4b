//! Instances of a node: the extension `EXT_mesh_gpu_instancing`.

use super::buffers::Asset;
use super::document::{INSTANCES, out_of_range};
use crate::error::Problem;
use glam::{DAffine3, DQuat, DVec3};

/// Returns the world-from-instance transform of each instance of a node: the instance's scale, rotation and
/// translation, followed by the node's transform `world`. Returns `None` for a node without instancing, or whose
/// instances have no attributes.
pub(super) fn of_node(asset: &Asset<'_>, node: usize, world: DAffine3) -> Result<Option<Vec<DAffine3>>, Problem> {
    let Some(attributes) = asset.document.instancing(node) else { return Ok(None) };
    let accessors = asset.document.gltf.accessors().len();
    let accessor = |name: &str| {
        let Some(index) = attributes.get(name) else { return Ok(None) };
        let index = index.as_u64().and_then(|i| usize::try_from(i).ok()).unwrap_or(usize::MAX);
        let found = asset.document.gltf.accessors().nth(index);
        found.ok_or_else(|| out_of_range("accessor", index, accessors)).map(Some)
    };
    let translations = accessor("TRANSLATION")?.map(|a| asset.floats::<3>(&a)).transpose()?;
    let rotations = accessor("ROTATION")?.map(|a| asset.floats::<4>(&a)).transpose()?;
    let scales = accessor("SCALE")?.map(|a| asset.floats::<3>(&a)).transpose()?;
    let counts = [translations.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    // Instances without attributes are all in the same place, and look like one.
    let Some(count) = counts.into_iter().flatten().next() else { return Ok(None) };
    if let Some(other) = counts.into_iter().flatten().find(|&c| c != count) {
        let what = format!("the instances ({INSTANCES}) of node {node} have {count} and {other} values");
        return Err(Problem::new(what).expected("as many translations as rotations and scales"));
    }
    let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let place = |i: usize| {
        let q = rotations.as_ref().map_or(DQuat::IDENTITY, |all| DQuat::from_array(all[i].map(f64::from)));
        let q = if q.length() > 0.0 { q * (1.0 / q.length()) } else { DQuat::IDENTITY };
        let scale = scales.as_ref().map_or(DVec3::ONE, |all| wide(all[i]));
        let translation = translations.as_ref().map_or(DVec3::ZERO, |all| wide(all[i]));
        world * DAffine3::from_scale_rotation_translation(scale, q, translation)
    };
    Ok(Some((0..count).map(place).collect()))
}
