//! What a file can hold, and how it is to be loaded.

use std::path::PathBuf;
use std::sync::Arc;
use surfel_model::{GaussianCloud, Mesh, Octree, PointCloud, Shape, SplatCloud, TableColumns, Up};

/// How to load.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Drops invalid splats, takes the whole chunks of a LAZ file that is cut off and what comes before the damage of
    /// an E57 file's scans, and says how many, instead of refusing the file.
    pub repair: bool,
    /// A texture (PNG, JPEG or WebP) for a mesh that has texture coordinates and names no texture itself.
    pub texture: Option<PathBuf>,
    /// Gaussians are kept as they were trained ([`Content::Gaussians`]), and not made a surface.
    pub gaussians: bool,
    /// Reads what the file refers to (buffers, materials, textures) wherever it is, not only in the file's folder and
    /// below.
    pub allow_outside: bool,
    /// Longest side of a texture in texels, 1 to 32,768; larger ones are reduced. `None`: 8192.
    pub max_texture: Option<u32>,
    /// Names of the columns of text and of NumPy's arrays; with types, those of a binary file without a header.
    pub columns: Option<TableColumns>,
    /// Reads points of LAS files that are flagged as withheld, too, with a column `withheld`, instead of leaving them
    /// out.
    pub withheld: bool,
}

/// What a file held.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Splats, valid and ready to be drawn.
    Splats(SplatCloud),
    /// Points without extent; all positions are finite.
    Points(PointCloud),
    /// Triangles; indices are in range and positions finite.
    Mesh(Mesh),
    /// Splats and polygons in an octree.
    Octree(Box<Octree>),
    /// Trained Gaussians, where [`LoadOptions::gaussians`] asks for them.
    Gaussians(Arc<GaussianCloud>),
}

impl Content {
    /// The axis that the file itself says is up.
    pub fn own_up(&self) -> Option<Up> {
        match self {
            Self::Splats(splats) => splats.data().up,
            Self::Points(points) => points.up,
            Self::Mesh(mesh) => mesh.up,
            Self::Octree(octree) => octree.mesh().up,
            Self::Gaussians(gaussians) => gaussians.data().up,
        }
    }

    /// The attributes in words: "position", "normal", "colour", … and the names of those that Surfel doesn't
    /// interpret.
    pub fn attributes(&self) -> Vec<String> {
        let mut found = vec!["position".to_owned()];
        let mut add = |there: bool, name: &str| {
            if there {
                found.push(name.to_owned());
            }
        };
        let extras = match self {
            Self::Splats(splats) => {
                let d = splats.data();
                let clips = d.clips.as_ref();
                let disks = matches!(d.shape, Shape::Disks { .. });
                add(disks, "normal");
                add(disks, "radius");
                add(!disks, "half-axes");
                add(d.shading_normals.is_some(), "shading normal");
                add(d.colors.is_some(), "colour");
                add(d.alphas.is_some(), "alpha");
                add(clips.is_some_and(|c| c.curves.is_some()), "clip curve");
                add(clips.is_some_and(|c| c.lines.is_some()), "clip lines");
                add(d.interior_weight.is_some(), "interior weight");
                d.extras.as_slice()
            }
            Self::Points(p) => {
                add(p.normals.is_some(), "normal");
                add(p.colors.is_some(), "colour");
                add(p.alphas.is_some(), "alpha");
                p.extras.as_slice()
            }
            Self::Mesh(mesh) => {
                of_mesh(mesh, &mut add);
                let extras = mesh.vertex_extras.iter().chain(&mesh.triangle_extras);
                extras.for_each(|extra| add(true, &extra.name.escape_debug().to_string()));
                &[]
            }
            Self::Gaussians(_) => {
                ["standard deviations", "rotation", "opacity", "colour"].into_iter().for_each(|name| add(true, name));
                &[]
            }
            Self::Octree(octree) => {
                of_mesh(octree.mesh(), &mut add);
                &[]
            }
        };
        found.extend(extras.iter().map(|e| e.name.escape_debug().to_string()));
        found
    }
}

fn of_mesh(m: &Mesh, add: &mut impl FnMut(bool, &str)) {
    add(m.normals.is_some(), "normal");
    add(m.colors.is_some(), "colour");
    add(m.alphas.is_some(), "alpha");
    add(m.uvs.is_some(), "texture coordinates");
    add(m.textures().next().is_some(), "texture");
}
