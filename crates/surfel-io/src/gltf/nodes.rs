//! Nodes of the default scene, and their placements.

use super::document::{CheckedDocument, out_of_range};
use crate::error::Problem;
use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf::json::Index;
use serde_json::Value;

/// The nodes of a document, with their placements in world space.
pub(super) struct Nodes {
    /// Indices of the nodes of the default scene, depth first. Without a default, this is the first scene; without
    /// scenes, it has all nodes.
    pub(super) drawn: Vec<usize>,
    /// World-from-node transforms of all nodes. Nodes outside the default scene may be joints of skins.
    pub(super) world: Vec<DAffine3>,
}

impl Nodes {
    /// Computes the placement of every node from those of its ancestors.
    ///
    /// # Errors
    /// [`Problem`] if the scene doesn't exist, or contains a node twice.
    pub(super) fn place(document: &CheckedDocument) -> Result<Self, Problem> {
        let root = document.gltf.as_json();
        let children: Vec<Vec<usize>> =
            root.nodes.iter().map(|n| n.children.iter().flatten().map(Index::value).collect()).collect();
        let mut is_child = vec![false; children.len()];
        for &child in children.iter().flatten() {
            is_child[child] = true;
        }
        let top: Vec<usize> = (0..children.len()).filter(|&i| !is_child[i]).collect();
        let scene = root.scene.map(|s| s.value()).or((!root.scenes.is_empty()).then_some(0));
        let roots: Vec<usize> = match scene {
            Some(scene) => {
                let found = root.scenes.get(scene).ok_or_else(|| out_of_range("scene", scene, root.scenes.len()))?;
                found.nodes.iter().map(Index::value).collect()
            }
            None => top.clone(),
        };
        let mut nodes = Self { drawn: Vec::new(), world: vec![DAffine3::IDENTITY; children.len()] };
        let mut seen = vec![false; children.len()];
        let mut visit = |roots: Vec<usize>, in_scene: bool| {
            let mut stack: Vec<(usize, DAffine3)> = roots.into_iter().rev().map(|i| (i, DAffine3::IDENTITY)).collect();
            while let Some((index, parent)) = stack.pop() {
                if std::mem::replace(&mut seen[index], true) {
                    if in_scene {
                        let what = format!("node {index} appears twice in the scene");
                        return Err(Problem::new(what).expected("a tree of nodes"));
                    }
                    continue;
                }
                nodes.world[index] = parent * parent_from_node(document, index);
                if in_scene {
                    nodes.drawn.push(index);
                }
                stack.extend(children[index].iter().rev().map(|&child| (child, nodes.world[index])));
            }
            Ok(())
        };
        visit(roots, true)?;
        visit(top, false)?;
        Ok(nodes)
    }
}

/// Returns a node's local transform in f64. The crate `gltf` stores f32, which would round Earth-sized coordinates by
/// centimetres.
fn parent_from_node(document: &CheckedDocument, index: usize) -> DAffine3 {
    let node = document.raw.get("nodes").and_then(|nodes| nodes.get(index)).unwrap_or(&Value::Null);
    if let Some(m) = numbers::<16>(node, "matrix") {
        return DAffine3::from_mat4(DMat4::from_cols_array(&m));
    }
    let q = numbers(node, "rotation").map_or(DQuat::IDENTITY, DQuat::from_array);
    let q = if q.length() > 0.0 { q * (1.0 / q.length()) } else { DQuat::IDENTITY };
    let scale = numbers(node, "scale").map_or(DVec3::ONE, DVec3::from);
    DAffine3::from_scale_rotation_translation(scale, q, numbers(node, "translation").map_or(DVec3::ZERO, DVec3::from))
}

fn numbers<const N: usize>(of: &Value, key: &str) -> Option<[f64; N]> {
    let found: Option<Vec<f64>> = of.get(key)?.as_array()?.iter().map(Value::as_f64).collect();
    found?.try_into().ok()
}
