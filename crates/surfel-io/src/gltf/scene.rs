//! The primitives of the default scene, merged into one mesh, or one cloud of points or splats, in world space.

use super::buffers::Asset;
use super::document::{GAUSSIANS, out_of_range};
use super::draco::{self, DracoMesh};
use super::instances;
use super::materials::Materials;
use super::nodes::Nodes;
use super::primitive::{Attributes, MAX_CUSTOM_COLUMNS, Vertices, same_count, world_positions};
use super::rest_pose::{JointSet, Pose, SkinnedPose, joints};
use super::splats::GatheredSplats;
use super::wrap;
use crate::columns::{f32_step, rounding_note_of_step};
use crate::content::Content;
use crate::context::{Context, ZERO_ALPHAS};
use crate::error::{Fault, Problem, list};
use crate::gathered_points::{GatheredPoints, PointsPart};
use crate::materials::{Material, Parts};
use crate::words::counted;
use glam::{DAffine3, DVec3};
use gltf::accessor::DataType;
use gltf::mesh::Mode;
use gltf::{Node, Primitive, Semantic};
use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;
use surfel_model::{AlphaMode, ExtraColumn, ExtraValues};

/// Maximum number of vertices and indices of a scene together, including those of morph targets, joints, instances and
/// application-specific columns. More are an error, which limits the memory.
const MAX_VERTICES: usize = 1 << 26;

/// Geometry of the primitives that were read from a scene so far.
struct Gathered {
    parts: Parts,
    points: GatheredPoints,
    splats: GatheredSplats,
    materials: Materials,
    vertices: usize,
    lines: usize,
    skinned: usize,
    /// Largest rounding step of the file's 32-bit coordinates, in world units.
    step: f64,
    /// True if some vertex colour has an alpha above 0. If all alphas are 0, they are ignored as unused. `None` if no
    /// primitive so far has vertex colours.
    has_alpha: Option<bool>,
    /// Names of the primitives' application-specific attributes that are read as columns.
    columns: BTreeSet<String>,
    /// Names of the primitives' application-specific attributes that aren't read.
    left_out: BTreeSet<String>,
    /// Joint transforms of the skins that were used so far, by skin index.
    joints: HashMap<usize, Rc<Vec<DAffine3>>>,
    /// Instance placements of the nodes that were used so far, by node index; `None` for nodes without instancing.
    instances: HashMap<usize, Rc<Option<Vec<DAffine3>>>>,
    /// Decompressed primitives, by indices of mesh and primitive, because several nodes may use them.
    compressed: HashMap<(usize, usize), Rc<Option<DracoMesh>>>,
}

/// Reads the geometry of the default scene: its triangles; if it has none, its splats; or else its points. Lines and
/// other ignored geometry are noted.
pub(super) fn read(asset: &Asset<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let all = gather(asset, context)?;
    if all.skinned > 0 {
        context.note("drew skinned meshes in their rest pose".into());
    }
    if !all.left_out.is_empty() {
        let names: Vec<&str> = all.left_out.iter().map(String::as_str).collect();
        context.note(format!(
            "ignored the attributes {}: they aren't one number a vertex, or are more than {MAX_CUSTOM_COLUMNS}",
            list(&names)
        ));
    }
    if all.lines > 0 {
        context.note(format!("ignored {} primitives that are lines", all.lines));
    }
    all.finish(context)
}

/// Reads the points of the default scene; returns `None` if there are none.
pub(super) fn read_points(asset: &Asset<'_>, context: &mut Context<'_>) -> Result<Option<PointsPart>, Fault> {
    let points = gather(asset, context)?.points;
    Ok((!points.positions.is_empty()).then(|| points.into_part()))
}

fn gather(asset: &Asset<'_>, context: &mut Context<'_>) -> Result<Gathered, Problem> {
    let mut all = Gathered {
        parts: Parts::default(),
        points: GatheredPoints::default(),
        splats: GatheredSplats::default(),
        materials: Materials::read(asset, context),
        vertices: 0,
        lines: 0,
        skinned: 0,
        step: 0.0,
        has_alpha: None,
        columns: BTreeSet::new(),
        left_out: BTreeSet::new(),
        joints: HashMap::new(),
        instances: HashMap::new(),
        compressed: HashMap::new(),
    };
    let nodes = Nodes::place(asset.document)?;
    for &index in &nodes.drawn {
        let Some(node) = asset.document.gltf.nodes().nth(index) else { continue };
        let Some(mesh) = node.mesh() else { continue };
        all.skinned += usize::from(node.skin().is_some());
        for primitive in mesh.primitives() {
            all.add(asset, &nodes, &node, &primitive)?;
        }
    }
    Ok(all)
}

impl Gathered {
    /// Counts `vertices` more vertices of the scene; returns an error beyond [`MAX_VERTICES`].
    fn spend(&mut self, vertices: usize) -> Result<(), Problem> {
        self.vertices = self.vertices.saturating_add(vertices);
        if self.vertices > MAX_VERTICES {
            let what = format!("the scene has more than {MAX_VERTICES} vertices, instances counted");
            return Err(Problem::new(what).help("split it into several files"));
        }
        Ok(())
    }

    fn add(
        &mut self,
        asset: &Asset<'_>,
        nodes: &Nodes,
        node: &Node<'_>,
        primitive: &Primitive<'_>,
    ) -> Result<(), Problem> {
        let Some(mesh) = node.mesh() else { return Ok(()) };
        if matches!(primitive.mode(), Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            self.lines += 1;
            return Ok(());
        }
        let key = (mesh.index(), primitive.index());
        let compressed = match self.compressed.get(&key) {
            Some(known) => known.clone(),
            None => {
                let decoded = Rc::new(draco::decode(asset, primitive, mesh.index())?);
                self.compressed.insert(key, decoded.clone());
                decoded
            }
        };
        let attributes = Attributes { asset, primitive, mesh: mesh.index(), compressed: compressed.as_ref().as_ref() };
        let Some(mut positions) = attributes.floats::<3>(&Semantic::Positions)? else { return Ok(()) };
        let n = positions.len();
        self.spend(n)?;
        let weights = node.weights().or(mesh.weights()).unwrap_or_default();
        let active = weights.iter().filter(|w| **w != 0.0).count().min(primitive.morph_targets().len());
        self.spend(n.saturating_mul(active))?;
        let normals = attributes.at_rest(&mut positions, weights)?;
        let poses = self.poses(&attributes, nodes, node, n)?;
        self.spend(n.saturating_mul(poses.len().saturating_sub(1)))?;
        if primitive.get(&Semantic::Positions).is_some_and(|a| a.data_type() == DataType::F32) {
            let finite = positions.as_flattened().iter().copied().filter(|c| c.is_finite());
            let step = f32_step(finite.fold(0.0, |most: f32, c| most.max(c.abs())).into());
            self.step = poses.iter().fold(self.step, |most, pose| most.max(step * pose.scale()));
        }
        if let Some(extension) = asset.document.primitive_extension(primitive, mesh.index(), GAUSSIANS) {
            for pose in &poses {
                let world = pose.of_vertex(0);
                self.splats.add(&attributes, extension, world_positions(&positions, pose), world)?;
            }
            return Ok(());
        }
        let material = primitive.material().index();
        let base = material.and_then(|m| self.materials.all.get(m));
        let surface = attributes.surface(positions, normals, base)?;
        if let Some(colors) = surface.colors() {
            self.has_alpha = Some(self.has_alpha == Some(true) || colors.iter().any(|c| c[3] != 0.0));
        }
        let extras = self.own_columns(&attributes, n, poses.len())?;
        if primitive.mode() == Mode::Points {
            for pose in &poses {
                let Vertices { positions, normals, colors, .. } = surface.place(pose);
                self.points.add(PointsPart { positions, normals, colors, extras: extras.clone(), step: self.step });
            }
            return Ok(());
        }
        let corners = attributes.corners(n)?;
        self.spend(corners.len().saturating_mul(poses.len()))?;
        if let Some(bad) = corners.iter().find(|&&i| i as usize >= n) {
            return Err(out_of_range("vertex", *bad as usize, n));
        }
        // Compressed triangles are always a triangle list.
        let mode = if attributes.compressed.is_some() { Mode::Triangles } else { primitive.mode() };
        for pose in &poses {
            self.add_triangles(surface.place(pose), &extras, material, &corners, mode);
        }
        Ok(())
    }

    /// Returns the primitive's application-specific attributes as columns. Columns beyond the scene's first
    /// [`MAX_CUSTOM_COLUMNS`] are left out. The values count as vertices, including the NaNs that fill a new column for
    /// earlier primitives.
    fn own_columns(
        &mut self,
        attributes: &Attributes<'_>,
        vertices: usize,
        poses: usize,
    ) -> Result<Vec<ExtraColumn>, Problem> {
        let (mut extras, left_out) = attributes.own_columns(vertices)?;
        self.left_out.extend(left_out);
        let before = self.columns.len();
        extras.retain(|extra| {
            let is_kept = self.columns.contains(&extra.name) || self.columns.len() < MAX_CUSTOM_COLUMNS;
            let names = if is_kept { &mut self.columns } else { &mut self.left_out };
            names.insert(extra.name.clone());
            is_kept
        });
        let filled = (self.columns.len() - before).saturating_mul(self.parts.positions.len());
        self.spend(vertices.saturating_mul(self.columns.len()).saturating_mul(poses).saturating_add(filled))?;
        Ok(extras)
    }

    /// Returns the poses in which a primitive is drawn: one per instance of its node, or the single pose of the node or
    /// of its skin. Instances of a node with a skin are ignored.
    fn poses(
        &mut self,
        attributes: &Attributes<'_>,
        nodes: &Nodes,
        node: &Node<'_>,
        vertices: usize,
    ) -> Result<Vec<Pose>, Problem> {
        if node.skin().is_some() {
            return Ok(vec![self.pose(attributes, nodes, node, vertices)?]);
        }
        let instances = match self.instances.get(&node.index()) {
            Some(known) => known.clone(),
            None => {
                let placed = Rc::new(instances::of_node(attributes.asset, node.index(), nodes.world[node.index()])?);
                self.instances.insert(node.index(), placed.clone());
                placed
            }
        };
        match instances.as_ref() {
            Some(places) => Ok(places.iter().map(|world| Pose::Rigid(*world)).collect()),
            None => Ok(vec![self.pose(attributes, nodes, node, vertices)?]),
        }
    }

    /// Returns the pose of a primitive without instances: that of its skin or, if the node has no skin or the primitive
    /// no joints, that of the node.
    fn pose(
        &mut self,
        attributes: &Attributes<'_>,
        nodes: &Nodes,
        node: &Node<'_>,
        vertices: usize,
    ) -> Result<Pose, Problem> {
        let world = nodes.world[node.index()];
        let Some(skin) = node.skin() else { return Ok(Pose::Rigid(world)) };
        let mut sets = Vec::new();
        for set in 0.. {
            let indices = attributes.floats::<4>(&Semantic::Joints(set))?;
            let weights = attributes.floats::<4>(&Semantic::Weights(set))?;
            let (Some(indices), Some(weights)) = (indices, weights) else { break };
            same_count("JOINTS", Some(indices.len()), vertices)?;
            same_count("WEIGHTS", Some(weights.len()), vertices)?;
            self.spend(vertices)?;
            sets.push(JointSet { indices, weights });
        }
        if sets.is_empty() {
            return Ok(Pose::Rigid(world));
        }
        let joints = match self.joints.get(&skin.index()) {
            Some(known) => known.clone(),
            None => {
                let placed = Rc::new(joints(attributes.asset, &skin, nodes)?);
                self.joints.insert(skin.index(), placed.clone());
                placed
            }
        };
        Ok(Pose::Skinned(SkinnedPose { joints, sets, world }))
    }

    fn add_triangles(
        &mut self,
        vertices: Vertices,
        extras: &[ExtraColumn],
        material: Option<usize>,
        corners: &[u32],
        mode: Mode,
    ) {
        let Vertices { positions, normals, colors, uvs, mirrored } = vertices;
        let parts = &mut self.parts;
        let (base, n) = (parts.positions.len(), positions.len());
        append(&mut parts.normals, normals, base, n, [0.0; 3]);
        append(&mut parts.uvs, uvs, base, n, [0.0; 2]);
        append(&mut parts.colors, colors, base, n, [1.0; 4]);
        append_extras(&mut parts.extras, extras, base, n);
        parts.positions.extend(positions);
        parts.materials_of.resize(base + n, material.unwrap_or(self.materials.all.len()) as u32);
        // A mirroring placement reverses the winding order. Reversed again, triangles stay counter-clockwise from
        // outside.
        let mut push = |[a, b, c]: [u32; 3]| {
            let (b, c) = if mirrored { (c, b) } else { (b, c) };
            parts.triangles.push([a, b, c].map(|i| i + base as u32));
        };
        match mode {
            Mode::TriangleStrip => corners.windows(3).enumerate().for_each(|(i, c)| {
                if c[0] != c[1] && c[1] != c[2] && c[0] != c[2] {
                    push(if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[1], c[0], c[2]] });
                }
            }),
            Mode::TriangleFan => {
                if let [first, rest @ ..] = corners {
                    rest.windows(2).for_each(|c| push([*first, c[0], c[1]]));
                }
            }
            _ => corners.chunks_exact(3).for_each(|c| push([c[0], c[1], c[2]])),
        }
    }

    fn finish(mut self, context: &mut Context<'_>) -> Result<Content, Fault> {
        let (points, splats) = (self.points.positions.len(), self.splats.positions.len());
        let places = [&self.parts.positions, &self.points.positions, &self.splats.positions].into_iter().flatten();
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (min, max) = places.filter(|p| p.is_finite()).fold(none, |(lo, hi), p| (lo.min(*p), hi.max(*p)));
        rounding_note_of_step(self.step, min, max).into_iter().for_each(|note| context.note(note));
        if !self.parts.triangles.is_empty() {
            if points + splats > 0 {
                context.note(format!(
                    "ignored {} and {} beside the mesh",
                    counted(points as u64, "points"),
                    counted(splats as u64, "Gaussian splats")
                ));
            }
            let Materials { mut all, mut textures } = self.materials;
            let is_opaque = all.iter().all(|base| base.material.alpha == AlphaMode::Opaque);
            if self.has_alpha == Some(false) && !is_opaque {
                self.parts.colors.iter_mut().flatten().for_each(|c| c[3] = 1.0);
                context.note(ZERO_ALPHAS.into());
            }
            let left = wrap::resolve(&mut self.parts, &mut all, &mut textures);
            if left > 0 {
                context.note(format!(
                    "repeated the textures of {left} materials, whose surfaces go far beyond their textures' edges"
                ));
            }
            let materials: Vec<Material> = all.into_iter().map(|base| base.material).collect();
            return context.parts(self.parts, &materials, &textures);
        }
        if splats > 0 {
            if points > 0 {
                context.note(format!("ignored {} beside the Gaussian splats", counted(points as u64, "points")));
            }
            return self.splats.finish(context);
        }
        if points == 0 {
            let but = match self.lines {
                0 => String::new(),
                lines => format!(" but {lines} primitives that are lines, which are not drawn"),
            };
            let problem = Problem::new(format!("the scene has nothing to draw{but}"));
            return Err(problem.expected("triangles, points or splats").into());
        }
        self.points.finish(context)
    }
}

/// Appends the columns `extras` of `n` vertices to those of the `base` vertices before. Missing values are NaN.
fn append_extras(all: &mut Vec<ExtraColumn>, extras: &[ExtraColumn], base: usize, n: usize) {
    for extra in extras {
        if !all.iter().any(|known| known.name == extra.name) {
            all.push(ExtraColumn { name: extra.name.clone(), values: ExtraValues::F32(vec![f32::NAN; base]) });
        }
    }
    for known in all {
        let ExtraValues::F32(values) = &mut known.values else { continue };
        match extras.iter().find(|extra| extra.name == known.name).map(|extra| &extra.values) {
            Some(ExtraValues::F32(own)) => values.extend(own),
            _ => values.resize(base + n, f32::NAN),
        }
    }
}

/// Appends the values of `n` vertices to a column of the `base` vertices before. If only the vertices before or only
/// the new ones have values, those of the others are `default`.
fn append<T: Copy>(column: &mut Option<Vec<T>>, values: Option<Vec<T>>, base: usize, n: usize, default: T) {
    match (column.as_mut(), values) {
        (None, None) => {}
        (Some(column), None) => column.resize(base + n, default),
        (Some(column), Some(values)) => column.extend(values),
        (None, Some(values)) => {
            let mut all = vec![default; base];
            all.extend(values);
            *column = Some(all);
        }
    }
}
