//! Conversion of a mesh to an octree of splats and polygons (rendering model §6, after G06 §5.2).

use super::closed::is_oriented;
use super::count::splats_and_faces;
use super::face_tree::{FaceTree, Node};
use super::geometry::Geometry;
use super::options::{MeshMethod, MeshReport};
use super::placed::MAX_GROWN;
use super::transitions::{EdgeSplat, distance_to_segment, shared_edges};
use crate::boxes::Boxes;
use crate::{Progress, SampleError, assemble, interior, radii};
use glam::DVec3;
use std::collections::BTreeMap;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{
    ClipColumns, ClipLine, CloudData, Mesh, NO_LINE, Octree, OctreeNode, OnInvalid, SplatCloud, TextureSampling,
    Transition,
};

/// Maximum number of splats in one level of the octree; a level that needs more gets larger splats.
const MAX_IN_LEVEL: f64 = 4e6;

/// Largest mean number of splats per node in one level. This limit and the next two matter if triangles reach far
/// beyond their node's cube, as in a fan; a watertight surface has 200 to 800 splats per node.
const MAX_IN_NODE: usize = 1024;
/// Mean number of splats per triangle that a level may have, regardless of [`MAX_IN_NODE`].
const MAX_ON_TRIANGLE: usize = 8;
/// Number of splats that a level may have, regardless of [`MAX_IN_NODE`].
const SMALL_LEVEL: usize = 16_384;

/// Options of the conversion of a mesh to an octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OctreeOptions {
    /// Maximum number of triangles in a leaf; at least 1.
    pub leaf_triangles: usize,
    /// Number of splats along the side of a node's cube, on a surface parallel to it; at least 1.
    pub splats_per_side: u32,
    /// Method by which the splats of each level sample the mesh's colours ([`crate::fit_to_mesh`]).
    pub texture: TextureSampling,
}

impl Default for OctreeOptions {
    /// Returns the default options: 64 triangles, for which a leaf has 256 splats or more, and point-sampled colours.
    fn default() -> Self {
        Self { leaf_triangles: 64, splats_per_side: 16, texture: TextureSampling::Point }
    }
}

/// Converts a mesh to an octree. Every node has splats for its part of the surface, at half the distance of its
/// parent's; a leaf also has polygons. Edges shared by leaves get splats of their own, centred on the edge and as large
/// as the finer leaf's splats. The finer leaf's splats (both leaves', if equally fine) within half a spacing of the
/// edge are dropped. Creases above 40° get no edge splats.
///
/// The polygons of a mesh without normals get the shading normals of its splats: smooth except at creases above 40°.
/// Colours come from textures and vertices as in [`super::splats_from_mesh`], or are fitted level by level, so that a
/// far view equals the filtered near view (Z01 §8). The interior weight is measured on the splats of leaves. Polygons
/// have a single texture: a mesh with several shows them by its vertices' colours ([`Mesh::with_one_material`]). The
/// result is deterministic.
///
/// Source: rendering model §6, after G06 §5.2.
///
/// # Errors
/// Same as [`super::splats_from_mesh`] with [`MeshMethod::Count`]; [`SampleError::Option`] for an option of 0.
pub fn octree_from_mesh(mesh: &Mesh, options: &OctreeOptions, progress: &dyn Progress) -> Result<Octree, SampleError> {
    if options.leaf_triangles == 0 || options.splats_per_side == 0 {
        return Err(SampleError::option("leaf_triangles or splats_per_side", 0, "at least 1"));
    }
    mesh.validate()?;
    SampleError::check_count("triangles", mesh.triangles.len())?;
    if mesh.triangles.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "triangles" });
    }
    let smooth = if mesh.normals.is_none() { Some(with_smooth_normals(mesh)) } else { None };
    let mesh = smooth.as_ref().unwrap_or(mesh);
    let geometry = Geometry::new(mesh);
    let area = geometry.total_area();
    if area <= 0.0 || !area.is_finite() {
        return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
    }
    let tree = FaceTree::new(&geometry, options.leaf_triangles);
    let spacing_at = |depth: u32| tree.side / f64::from(options.splats_per_side) / f64::from(depth).exp2();
    // Flag per corner, true if the edge that starts there is a border of the whole mesh.
    let mut is_border = vec![false; 3 * mesh.triangles.len()];
    let shared = {
        let smooth = geometry.smooth();
        smooth.borders.iter().for_each(|border| is_border[border.corner as usize] = true);
        let spacing_of = |leaf: u32| spacing_at(tree.nodes[leaf as usize].depth);
        shared_edges(&geometry, &smooth.corner_normals, &tree.leaf_of_face(), spacing_of)
    };
    let mut edges_of: BTreeMap<u32, Vec<[DVec3; 2]>> = BTreeMap::new();
    for (leaves, shared) in &shared {
        let depths = leaves.map(|leaf| tree.nodes[leaf as usize].depth);
        // If leaves differ in depth, their edge has splats of the finer size, which can't replace the coarser leaf's.
        let finest = leaves.iter().zip(depths).filter(|(_, depth)| *depth == depths[0].max(depths[1]));
        finest.for_each(|(leaf, _)| edges_of.entry(*leaf).or_default().extend(&shared.edges));
    }
    let mut splats = Collected::default();
    let mut nodes: Vec<OctreeNode> = Vec::with_capacity(tree.nodes.len());
    for level in tree.nodes.chunk_by(|a, b| a.depth == b.depth) {
        let spacing = spacing_at(level[0].depth);
        let first = nodes.len() as u32;
        let sampled = Level::new(&geometry, &is_border, &tree, level, (spacing, options.texture), progress)?;
        let radius = radii::DENSITY * sampled.spacing;
        for (i, node) in (first..).zip(level) {
            let edges = edges_of.get(&i).map_or(&[][..], Vec::as_slice);
            let start = splats.len();
            // A leaf that can't be divided further may have any number of edges.
            let boxes = Boxes::new(edges);
            for &k in &sampled.splats_of[(i - first) as usize] {
                let center = sampled.cloud.data().centers.get(k);
                let (distance, _) = boxes.nearest(center, |i| distance_to_segment(center, edges[i]));
                if distance >= 0.5 * sampled.spacing {
                    splats.push(&sampled.cloud, k);
                }
            }
            let faces = &tree.order[node.faces.clone()];
            let own = (start..splats.len()).map(|k| splats.normals[k as usize]);
            // Splats clipped by borders may have grown, also in child nodes, whose splats are half as large.
            let largest = if splats.is_clipped(start) { radius * f64::max(1.0, 0.5 * MAX_GROWN) } else { radius };
            let largest = splats.radius_from(start).max(largest);
            let mut described = describe(&geometry, faces, own, radius, largest);
            described.children = node.children.clone();
            described.splats = start..splats.len();
            described.triangles = node.faces.start as u32..node.faces.end as u32;
            nodes.push(described);
        }
    }
    let transitions = shared
        .iter()
        .map(|(leaves, shared)| {
            let start = splats.len();
            shared.splats.iter().filter(|splat| splat.color[3] > 0.0).for_each(|splat| splats.push_edge(splat));
            Transition { leaves: *leaves, splats: start..splats.len() }
        })
        .collect();
    let ordered = some_triangles(mesh, &tree.order).with_one_material();
    let cloud = splats.cloud(mesh, geometry.is_painted())?;
    weighted(Octree::new(cloud, ordered, nodes, transitions)?)
}

/// Returns the mesh with only the given triangles, in the given order, and all vertices.
fn some_triangles(mesh: &Mesh, faces: &[u32]) -> Mesh {
    Mesh {
        triangles: faces.iter().map(|face| mesh.triangles[*face as usize]).collect(),
        materials: mesh.materials.as_ref().map(|all| all.select(faces.iter().copied())),
        ..mesh.clone()
    }
}

/// Returns the mesh with vertex normals equal to the shading normals of its splats, so that splats and polygons look
/// alike. A vertex whose triangles meet at a crease is split.
fn with_smooth_normals(mesh: &Mesh) -> Mesh {
    let corner_normals = Geometry::new(mesh).smooth().corner_normals;
    let mut vertex_of: BTreeMap<(u32, [u32; 3]), u32> = BTreeMap::new();
    let (mut sources, mut normals): (Vec<u32>, Vec<[f32; 3]>) = (Vec::new(), Vec::new());
    let mut place = |i: u32, normal: DVec3| {
        let normal = normal.as_vec3().to_array();
        *vertex_of.entry((i, normal.map(f32::to_bits))).or_insert_with(|| {
            sources.push(i);
            normals.push(normal);
            sources.len() as u32 - 1
        })
    };
    let corners = mesh.triangles.iter().zip(&corner_normals);
    let triangles = corners.map(|(t, n)| [0, 1, 2].map(|k| place(t[k], n[k]))).collect();
    let pick = |column: &Vec<[f32; 3]>| sources.iter().map(|&i| column[i as usize]).collect();
    Mesh {
        positions: mesh.positions.select(&sources),
        triangles,
        normals: Some(normals),
        colors: mesh.colors.as_ref().map(pick),
        alphas: mesh.alphas.as_ref().map(|column| sources.iter().map(|&i| column[i as usize]).collect()),
        uvs: mesh.uvs.as_ref().map(|column| sources.iter().map(|&i| column[i as usize]).collect()),
        ..mesh.clone()
    }
}

/// Measures the interior weight on the splats of leaves and of shared edges, and adds it to the octree's cloud if it
/// could be measured. Also declares the cloud oriented if the mesh is.
fn weighted(octree: Octree) -> Result<Octree, SampleError> {
    let leaves = octree.nodes().iter().filter(|n| n.is_leaf()).map(|n| n.splats.clone());
    let finest: Vec<_> = leaves.chain(octree.transitions().iter().map(|t| t.splats.clone())).collect();
    let weight = interior::interior_weight(&octree.cloud_of(&finest)?);
    let mut cloud = octree.cloud().clone();
    if let Some(weight) = weight {
        cloud.set_interior_weight(weight);
    }
    cloud.set_oriented(is_oriented(octree.mesh()));
    Ok(Octree::new(cloud, octree.mesh().clone(), octree.nodes().to_vec(), octree.transitions().to_vec())?)
}

/// Splats of all nodes of one depth. All nodes of a depth are sampled together, so that no boundary between nodes is
/// visible.
struct Level {
    cloud: SplatCloud,
    spacing: f64,
    /// Indices in `cloud` of the splats of each node.
    splats_of: Vec<Vec<usize>>,
}

impl Level {
    fn new(
        geometry: &Geometry,
        is_border: &[bool],
        tree: &FaceTree,
        nodes: &[Node],
        (spacing, texture): (f64, TextureSampling),
        progress: &dyn Progress,
    ) -> Result<Self, SampleError> {
        let mesh = geometry.mesh;
        let faces: Vec<u32> = nodes.iter().flat_map(|n| tree.order[n.faces.clone()].iter().copied()).collect();
        let node_of: Vec<usize> = nodes.iter().enumerate().flat_map(|(i, n)| n.faces.clone().map(move |_| i)).collect();
        let area: f64 = faces.iter().map(|face| geometry.areas[*face as usize]).sum();
        let mut splats_of = vec![Vec::new(); nodes.len()];
        let empty = || CloudData::new(mesh.origin, assemble::centers(mesh, &[]), assemble::ellipses(&[]));
        if area <= 0.0 {
            return Ok(Self { cloud: SplatCloud::new(empty(), OnInvalid::Refuse)?.0, spacing, splats_of });
        }
        let most = (MAX_IN_NODE * nodes.len()).max(MAX_ON_TRIANGLE * faces.len()).max(SMALL_LEVEL);
        let count = (area / (spacing * spacing)).ceil().clamp(1.0, MAX_IN_LEVEL.min(most as f64));
        let part = some_triangles(mesh, &faces);
        let mut report = MeshReport {
            method: MeshMethod::Count(count as usize),
            detail: None,
            splats: 0,
            degenerate: 0,
            repeated: 0,
            feature_edges: 0,
            flat: false,
            median_radius: 0.0,
            interior_weight: None,
        };
        let is_cut = |corner: u32| !is_border[3 * faces[corner as usize / 3] as usize + corner as usize % 3];
        let (data, on_face) = splats_and_faces(&part, &is_cut, count as usize, 1.0, &mut report, progress)?;
        for (splat, face) in on_face.iter().enumerate() {
            splats_of[node_of[*face as usize]].push(splat);
        }
        let (cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
        let (cloud, _) = crate::fit_to_mesh(cloud, &part, texture, progress)?;
        Ok(Self { cloud, spacing: (area / count).sqrt(), splats_of })
    }
}

/// Returns a node with the bounding sphere and the normal cone of its triangles `faces` and of its splats, given by
/// their normals. `radius` is the radius of the node's splats before any grows, `largest` that of its largest splat.
/// The node's index ranges are empty.
fn describe(
    geometry: &Geometry,
    faces: &[u32],
    splats: impl Iterator<Item = DVec3>,
    radius: f64,
    largest: f64,
) -> OctreeNode {
    let vertices = || faces.iter().flat_map(|face| geometry.corners(*face as usize));
    let (low, high) = vertices().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let center = (low + high) * 0.5;
    let reach = vertices().map(|v| (v - center).length()).fold(0.0, f64::max);
    let weighted = |face: &u32| geometry.normals[*face as usize] * geometry.areas[*face as usize];
    let axis = unit(faces.iter().map(weighted).sum());
    let normals = faces.iter().map(|face| geometry.normals[*face as usize]).filter(|n| *n != DVec3::ZERO).chain(splats);
    // The cone is slightly wider, to allow for the rounding of normals.
    let cosine = normals.map(|n| n.dot(axis)).fold(1.0, f64::min) - 1e-6;
    let has_axis = axis != DVec3::ZERO;
    OctreeNode {
        center: center.to_array(),
        // The splats of all descendants are on the same triangles and are no larger.
        radius: reach + largest,
        splat_radius: radius,
        cone_axis: if has_axis { axis.to_array() } else { [0.0, 0.0, 1.0] },
        cone_cosine: if has_axis { cosine.max(-1.0) } else { -1.0 },
        children: 0..0,
        splats: 0..0,
        triangles: 0..0,
    }
}

/// Splats of all nodes that were collected so far, in the order of the octree.
#[derive(Default)]
struct Collected {
    centers: Vec<DVec3>,
    axes: Vec<(DVec3, DVec3)>,
    normals: Vec<DVec3>,
    shading_normals: Vec<DVec3>,
    colors: Vec<[f32; 4]>,
    clip_lines: Vec<[ClipLine; 4]>,
}

impl Collected {
    fn len(&self) -> u32 {
        self.centers.len() as u32
    }

    /// True if any splat from index `start` on is clipped.
    fn is_clipped(&self, start: u32) -> bool {
        self.clip_lines[start as usize..].iter().any(|lines| !lines[0].a.is_nan())
    }

    /// Returns the length of the longest half-axis, in object units, of the splats from index `start` on.
    fn radius_from(&self, start: u32) -> f64 {
        self.axes[start as usize..].iter().map(|(s, _)| s.length()).fold(0.0, f64::max)
    }

    fn push(&mut self, cloud: &SplatCloud, i: usize) {
        self.centers.push(cloud.data().centers.get(i));
        self.axes.push(cloud.axes(i));
        self.normals.push(cloud.normal(i));
        self.shading_normals.push(cloud.shading_normal(i));
        let [r, g, b] = cloud.color(i);
        self.colors.push([r, g, b, cloud.alpha(i)]);
        let lines = cloud.data().clips.as_ref().and_then(|clips| clips.lines.as_ref());
        self.clip_lines.push(lines.map_or([NO_LINE; 4], |lines| lines[i]));
    }

    fn push_edge(&mut self, splat: &EdgeSplat) {
        let (s, t) = orthonormal(splat.normal);
        self.centers.push(splat.center);
        self.axes.push((s * splat.radius, t * splat.radius));
        self.normals.push(splat.normal);
        self.shading_normals.push(splat.shading_normal);
        self.colors.push(splat.color);
        self.clip_lines.push([NO_LINE; 4]);
    }

    fn cloud(self, mesh: &Mesh, painted: bool) -> Result<SplatCloud, SampleError> {
        SampleError::check_count("splats", self.centers.len())?;
        let shape = assemble::ellipses(&self.axes);
        let mut data = CloudData::new(mesh.origin, assemble::centers(mesh, &self.centers), shape);
        data.shading_normals = Some(assemble::normals32(&self.shading_normals));
        if self.is_clipped(0) {
            data.clips = Some(ClipColumns { lines: Some(self.clip_lines), ..ClipColumns::default() });
        }
        (data.colors, data.alphas) = assemble::paint(painted.then_some(self.colors));
        data.up = mesh.up;
        Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
    }
}
