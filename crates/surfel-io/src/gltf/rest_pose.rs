//! The rest pose: morph targets at their default weights, and skins with their joints at the nodes' default transforms.

use super::buffers::Asset;
use super::nodes::Nodes;
use crate::error::Problem;
use crate::gathered_points::largest_scale;
use glam::{DAffine3, DMat3, DMat4, DVec3};
use gltf::Skin;
use std::rc::Rc;

/// World transforms of a primitive's vertices in rest pose.
pub(super) enum Pose {
    /// One transform for all vertices: that of their node.
    Rigid(DAffine3),
    /// A blend of joint transforms for each vertex.
    Skinned(SkinnedPose),
}

/// Joint transforms of a skin, and the joint indices and weights of a primitive's vertices.
pub(super) struct SkinnedPose {
    /// World-from-bind-pose transform of each joint of the skin.
    pub(super) joints: Rc<Vec<DAffine3>>,
    /// Joint indices and weights of the vertices. Each set has four per vertex.
    pub(super) sets: Vec<JointSet>,
    /// World transform of vertices that no joint moves.
    pub(super) world: DAffine3,
}

/// Up to four joints for each vertex, and their weights: the attributes `JOINTS_n` and `WEIGHTS_n`.
pub(super) struct JointSet {
    pub(super) indices: Vec<[f32; 4]>,
    pub(super) weights: Vec<[f32; 4]>,
}

impl Pose {
    /// Returns the largest factor by which the pose scales lengths. For skins, returns 1 whatever their joints do.
    pub(super) fn scale(&self) -> f64 {
        match self {
            Self::Rigid(world) => largest_scale(*world),
            Self::Skinned(_) => 1.0,
        }
    }

    /// Returns the world transform of a vertex.
    pub(super) fn of_vertex(&self, vertex: usize) -> DAffine3 {
        match self {
            Self::Rigid(world) => *world,
            Self::Skinned(skinned) => skinned.of_vertex(vertex),
        }
    }
}

impl SkinnedPose {
    fn of_vertex(&self, vertex: usize) -> DAffine3 {
        let (mut linear, mut translation, mut total) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for set in &self.sets {
            let (Some(indices), Some(weights)) = (set.indices.get(vertex), set.weights.get(vertex)) else { continue };
            for (&index, &weight) in indices.iter().zip(weights) {
                // Joint indices are integers, which these floats represent exactly.
                let Some(joint) = self.joints.get(index as usize).filter(|_| weight != 0.0) else { continue };
                let weight = f64::from(weight);
                linear += joint.matrix3 * weight;
                translation += joint.translation * weight;
                total += weight;
            }
        }
        // 8-bit weights don't always sum to one.
        if total > 0.0 {
            return DAffine3 { matrix3: linear * (1.0 / total), translation: translation / total };
        }
        self.world
    }
}

/// Returns the world-from-bind-pose transform of each joint of a skin.
pub(super) fn joints(asset: &Asset<'_>, skin: &Skin<'_>, nodes: &Nodes) -> Result<Vec<DAffine3>, Problem> {
    let joints: Vec<usize> =
        asset.document.gltf.as_json().skins[skin.index()].joints.iter().map(gltf::json::Index::value).collect();
    let inverse = skin.inverse_bind_matrices().map(|accessor| asset.floats::<16>(&accessor)).transpose()?;
    if let Some(matrices) = inverse.as_ref().filter(|m| m.len() < joints.len()) {
        let what = format!("a skin of {} joints has {} inverse bind matrices", joints.len(), matrices.len());
        return Err(Problem::new(what).expected("one for each joint"));
    }
    let bound = |i: usize| match inverse.as_ref().and_then(|m| m.get(i)) {
        Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from))),
        None => DAffine3::IDENTITY,
    };
    Ok(joints.iter().enumerate().map(|(i, &node)| nodes.world[node] * bound(i)).collect())
}

/// Adds the displacements of a morph target, multiplied by `weight`, to `values`, vertex by vertex. Values beyond the
/// last displacement stay unchanged.
pub(super) fn add_displacements(values: &mut [[f32; 3]], displacements: &[[f32; 3]], weight: f32) {
    for (value, by) in values.iter_mut().zip(displacements) {
        for (v, d) in value.iter_mut().zip(by) {
            *v += weight * d;
        }
    }
}
