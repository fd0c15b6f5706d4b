//! Contents of files, and options for loading them.

use std::path::PathBuf;
use std::sync::Arc;
use surfel_model::{GaussianCloud, Mesh, Octree, PointCloud, Shape, SplatCloud, TableColumns, Up};

/// Options for loading a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// True if damaged files are read as far as possible, with a note, instead of failing. Surfel then drops invalid
    /// splats, and reads the complete chunks of a truncated LAZ file and the undamaged start of each E57 scan.
    pub repair: bool,
    /// Texture (PNG, JPEG or WebP) for a mesh that has texture coordinates but states no texture.
    pub texture: Option<PathBuf>,
    /// True if Gaussians are returned as trained ([`Content::Gaussians`]) instead of as surface splats.
    pub gaussians: bool,
    /// True if files that the file refers to (buffers, materials, textures) may be anywhere. Otherwise they must be in
    /// the file's folder or below.
    pub allow_outside: bool,
    /// Maximum side of a texture in texels, 1 to 32,768; larger textures are reduced. `None` means 8192.
    pub max_texture: Option<u32>,
    /// Column names of text files and NumPy arrays. With types, they describe the columns of a binary file without a
    /// header.
    pub columns: Option<TableColumns>,
    /// True if LAS points flagged as withheld are read, with a column `withheld`, instead of dropped.
    pub withheld: bool,
}

/// Geometry that a file contains, by kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Validated splats, which can be drawn as they are.
    Splats(SplatCloud),
    /// Points, from which splats are estimated. They may have radii that the file states. All positions are finite.
    Points(PointCloud),
    /// A mesh of triangles. All indices are in range, and all positions are finite.
    Mesh(Mesh),
    /// Splats and polygons in an octree, from a `.surfel` file.
    Octree(Box<Octree>),
    /// Trained 2DGS or 3DGS Gaussians, if [`LoadOptions::gaussians`] is true.
    Gaussians(Arc<GaussianCloud>),
}

impl Content {
    /// Returns the up axis that the file itself states, or that its reader detects from its points; `None` if neither.
    pub fn own_up(&self) -> Option<Up> {
        match self {
            Self::Splats(splats) => splats.data().up,
            Self::Points(points) => points.up,
            Self::Mesh(mesh) => mesh.up,
            Self::Octree(octree) => octree.mesh().up,
            Self::Gaussians(gaussians) => gaussians.data().up,
        }
    }

    /// Returns the names of the attributes that the geometry has: "position", "normal", "colour", …, then the names of
    /// its other columns.
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
                add(disks || splats.is_balls(), "radius");
                add(matches!(d.shape, Shape::Ellipses { .. }), "half-axes");
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
