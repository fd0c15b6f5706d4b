//! The default scene's primitives, placed in the world and gathered.

use super::accessor::out_of_range;
use super::document::{Node, Primitive, TextureTransform};
use super::{Gltf, uri};
use crate::columns::measured_positions;
use crate::error::{Fault, Problem};
use crate::gaussians::{Gaussians, Kind, SH_C0};
use crate::load::{Content, Context};
use crate::mesh_build::{Material, Parts};
use crate::texture;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use std::sync::Arc;
use surfel_model::{Column3, PointCloud, Texture};

/// Most vertices or corners of a scene: instances multiply what the file holds.
const MAX_VERTICES: usize = 1 << 26;

/// What has been gathered so far.
#[derive(Default)]
struct Gathered {
    parts: Parts,
    points: Points,
    splats: Splats,
    materials: Vec<(Material, Option<TextureTransform>, u32)>,
    textures: Vec<Arc<Texture>>,
    vertices: usize,
    lines: usize,
    skinned: usize,
}

#[derive(Default)]
struct Points {
    positions: Vec<DVec3>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[f32; 4]>,
    any_normal: bool,
    any_color: bool,
}

#[derive(Default)]
struct Splats {
    positions: Vec<DVec3>,
    sigmas: Vec<DVec3>,
    rotations: Vec<DQuat>,
    alphas: Vec<f32>,
    colors: Vec<[f64; 3]>,
    linear: bool,
    /// A node's scale is not the same in all directions.
    sheared: bool,
}

pub(super) fn build(gltf: &Gltf<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut all = Gathered::default();
    materials(gltf, &mut all, context)?;
    for (index, world_from_node) in placed_nodes(gltf)? {
        let node = &gltf.document.nodes[index];
        let Some(mesh) = node.mesh else { continue };
        let meshes = &gltf.document.meshes;
        let mesh = meshes.get(mesh).ok_or_else(|| out_of_range("mesh", mesh, meshes.len()))?;
        all.skinned += usize::from(node.skin.is_some());
        for primitive in &mesh.primitives {
            all.primitive(gltf, primitive, world_from_node)?;
        }
    }
    if all.skinned > 0 {
        context.note("drew skinned meshes in their bind pose".into());
    }
    if all.lines > 0 {
        context.note(format!("ignored {} primitives that are lines", all.lines));
    }
    all.finish(context)
}

/// Nodes of the default scene in depth-first order, with their placement.
fn placed_nodes(gltf: &Gltf<'_>) -> Result<Vec<(usize, DAffine3)>, Problem> {
    let d = &gltf.document;
    let roots: Vec<usize> = match d.scene.or((!d.scenes.is_empty()).then_some(0)) {
        Some(scene) => d.scenes.get(scene).ok_or_else(|| out_of_range("scene", scene, d.scenes.len()))?.nodes.clone(),
        None => {
            let mut child = vec![false; d.nodes.len()];
            for &c in d.nodes.iter().flat_map(|n| &n.children) {
                if let Some(flag) = child.get_mut(c) {
                    *flag = true;
                }
            }
            (0..d.nodes.len()).filter(|&i| !child[i]).collect()
        }
    };
    let mut stack: Vec<(usize, DAffine3)> = roots.into_iter().rev().map(|i| (i, DAffine3::IDENTITY)).collect();
    let mut seen = vec![false; d.nodes.len()];
    let mut placed = Vec::new();
    while let Some((index, parent)) = stack.pop() {
        let node = d.nodes.get(index).ok_or_else(|| out_of_range("node", index, d.nodes.len()))?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(Problem::new(format!("node {index} appears twice in the scene")).expected("a tree of nodes"));
        }
        let placement = parent * placement(node);
        placed.push((index, placement));
        stack.extend(node.children.iter().rev().map(|&c| (c, placement)));
    }
    Ok(placed)
}

fn placement(node: &Node) -> DAffine3 {
    if let Some(m) = node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(&m));
    }
    let q = node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
    let q = if q.length() > 0.0 { q * (1.0 / q.length()) } else { DQuat::IDENTITY };
    let scale = node.scale.map_or(DVec3::ONE, DVec3::from);
    DAffine3::from_scale_rotation_translation(scale, q, node.translation.map_or(DVec3::ZERO, DVec3::from))
}

fn materials(gltf: &Gltf<'_>, all: &mut Gathered, context: &mut Context<'_>) -> Result<(), Problem> {
    let d = &gltf.document;
    let mut of_image: Vec<Option<Option<usize>>> = vec![None; d.images.len()];
    for material in &d.materials {
        let pbr = &material.pbr_metallic_roughness;
        let mut factor = pbr.base_color_factor.unwrap_or([1.0; 4]);
        if material.alpha_mode.as_deref() != Some("BLEND") {
            factor[3] = 1.0;
        }
        let mut found = (Material { factor, texture: None }, None, 0);
        if let Some(info) = &pbr.base_color_texture {
            let texture = d.textures.get(info.index);
            let texture = texture.ok_or_else(|| out_of_range("texture", info.index, d.textures.len()))?;
            if let Some(source) = texture.source {
                let slot = of_image.get(source).ok_or_else(|| out_of_range("image", source, d.images.len()))?;
                let image = match slot {
                    Some(known) => *known,
                    None => {
                        let image = image(gltf, source, context).map(|image| {
                            all.textures.push(Arc::new(image));
                            all.textures.len() - 1
                        });
                        of_image[source] = Some(image);
                        image
                    }
                };
                found.0.texture = image;
            }
            found.1 = info.extensions.transform;
            found.2 = info.extensions.transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
        }
        all.materials.push(found);
    }
    Ok(())
}

fn image(gltf: &Gltf<'_>, index: usize, context: &mut Context<'_>) -> Option<Texture> {
    let image = gltf.document.images.get(index)?;
    let decoded = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => uri::read(uri, &context.beside).and_then(|bytes| context.textures.decode(&bytes)),
        (None, Some(view)) => {
            gltf.view_bytes(view).map_err(|p| p.what).and_then(|bytes| context.textures.decode(bytes))
        }
        (None, None) => Err("it has no data".into()),
    };
    match decoded {
        Ok(texture) => Some(texture),
        Err(why) => {
            let name = image.uri.as_deref().filter(|u| !u.starts_with("data:"));
            context.note(texture::missing(name.unwrap_or(&format!("image {index}")), &why));
            None
        }
    }
}

impl Gathered {
    fn primitive(&mut self, gltf: &Gltf<'_>, primitive: &Primitive, world: DAffine3) -> Result<(), Problem> {
        let Some(&positions) = primitive.attributes.get("POSITION") else { return Ok(()) };
        let mode = primitive.mode.unwrap_or(4);
        if matches!(mode, 1..=3) {
            self.lines += 1;
            return Ok(());
        }
        let positions: Vec<DVec3> = gltf
            .floats::<3>(positions)?
            .into_iter()
            .map(|p| world.transform_point3(DVec3::from(p.map(f64::from))))
            .collect();
        let n = positions.len();
        self.vertices = self.vertices.saturating_add(n);
        if self.vertices > MAX_VERTICES {
            let what = format!("the scene has more than {MAX_VERTICES} vertices, instances counted");
            return Err(Problem::new(what).help("split it into several files"));
        }
        let same = |name: &str, found: usize| {
            if found == n {
                return Ok(());
            }
            Err(Problem::new(format!("{name} has {found} values")).expected(format!("{n}, as POSITION")))
        };
        if let Some(extension) = &primitive.extensions.gaussian_splatting {
            if let Some(name) = extension.extensions.keys().next() {
                let what = format!("the Gaussian splats need the extension {}", crate::error::quote(name));
                return Err(Problem::new(what).help("export them uncompressed, or as PLY"));
            }
            self.splats.linear = extension.color_space.as_deref().is_some_and(|c| c.starts_with("lin"));
            if extension.kernel.as_deref().is_some_and(|k| k != "ellipse") {
                return Err(Problem::new("the Gaussian splats have an unknown kernel").expected("\"ellipse\""));
            }
            return self.splats.add(gltf, primitive, positions, world, same);
        }
        let attribute = |name: &str| primitive.attributes.get(name).copied();
        let normals = attribute("NORMAL").map(|a| gltf.floats::<3>(a)).transpose()?;
        let colors = attribute("COLOR_0").map(|a| gltf.floats::<4>(a)).transpose()?;
        same("NORMAL", normals.as_ref().map_or(n, Vec::len))?;
        same("COLOR_0", colors.as_ref().map_or(n, Vec::len))?;
        let normal_matrix = inverse_transpose(world);
        let normals = normals.map(|v| v.into_iter().map(|x| transform_normal(normal_matrix, x)).collect::<Vec<_>>());
        if mode == 0 {
            self.points.add(positions, normals, colors);
            return Ok(());
        }
        let material = primitive.material.filter(|&m| m < self.materials.len());
        let (transform, set) = material.map_or((None, 0), |m| (self.materials[m].1, self.materials[m].2));
        let uvs = attribute(&format!("TEXCOORD_{set}")).map(|a| gltf.floats::<2>(a)).transpose()?;
        same("TEXCOORD", uvs.as_ref().map_or(n, Vec::len))?;
        let uvs = uvs.map(|v| match transform {
            Some(t) => v.into_iter().map(|uv| t.apply(uv)).collect(),
            None => v,
        });
        let corners = match primitive.indices {
            Some(indices) => gltf.indices(indices)?,
            None => (0..n as u32).collect(),
        };
        self.vertices = self.vertices.saturating_add(corners.len());
        if let Some(bad) = corners.iter().find(|&&i| i as usize >= n) {
            return Err(out_of_range("vertex", *bad as usize, n));
        }
        self.add_triangles(positions, normals, uvs, colors, material, &corners, mode, world.matrix3.determinant() < 0.0)
    }

    #[expect(clippy::too_many_arguments, reason = "the columns of a primitive")]
    fn add_triangles(
        &mut self,
        positions: Vec<DVec3>,
        normals: Option<Vec<[f32; 3]>>,
        uvs: Option<Vec<[f32; 2]>>,
        colors: Option<Vec<[f32; 4]>>,
        material: Option<usize>,
        corners: &[u32],
        mode: u32,
        mirrored: bool,
    ) -> Result<(), Problem> {
        let parts = &mut self.parts;
        let (base, n) = (parts.positions.len(), positions.len());
        append(&mut parts.normals, normals, base, n, [0.0; 3]);
        append(&mut parts.uvs, uvs, base, n, [0.0; 2]);
        append(&mut parts.colors, colors, base, n, [1.0; 4]);
        parts.positions.extend(positions);
        parts.materials_of.resize(base + n, material.unwrap_or(self.materials.len()) as u32);
        // A mirroring placement turns corners around; turned back, they stay counter-clockwise from outside.
        let mut push = |[a, b, c]: [u32; 3]| {
            let (b, c) = if mirrored { (c, b) } else { (b, c) };
            parts.triangles.push([a, b, c].map(|i| i + base as u32));
        };
        match mode {
            4 => corners.chunks_exact(3).for_each(|c| push([c[0], c[1], c[2]])),
            5 => corners.windows(3).enumerate().for_each(|(i, c)| {
                if c[0] != c[1] && c[1] != c[2] && c[0] != c[2] {
                    push(if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[1], c[0], c[2]] });
                }
            }),
            6 => {
                if let [first, rest @ ..] = corners {
                    rest.windows(2).for_each(|c| push([*first, c[0], c[1]]));
                }
            }
            _ => return Err(Problem::new(format!("a primitive has mode {mode}")).expected("0 to 6")),
        }
        Ok(())
    }

    fn finish(self, context: &mut Context<'_>) -> Result<Content, Fault> {
        let (points, splats) = (self.points.positions.len(), self.splats.positions.len());
        if !self.parts.triangles.is_empty() {
            if points + splats > 0 {
                context.note(format!("ignored {points} points and {splats} Gaussian splats beside the mesh"));
            }
            let materials: Vec<Material> = self.materials.into_iter().map(|m| m.0).collect();
            return context.parts(self.parts, &materials, &self.textures);
        }
        if splats > 0 {
            if points > 0 {
                context.note(format!("ignored {points} points beside the Gaussian splats"));
            }
            return self.splats.finish(context);
        }
        if points == 0 {
            return Err(Problem::new("the scene has nothing to draw").expected("triangles, points or splats").into());
        }
        self.points.finish(context)
    }
}

/// Appends a column that may be absent here or in what came before.
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

/// The inverse transpose up to scale, which is finite for any finite matrix.
fn inverse_transpose(world: DAffine3) -> DMat3 {
    let m = world.matrix3;
    let sign = 1.0_f64.copysign(m.determinant());
    DMat3::from_cols(m.y_axis.cross(m.z_axis) * sign, m.z_axis.cross(m.x_axis) * sign, m.x_axis.cross(m.y_axis) * sign)
}

fn transform_normal(matrix: DMat3, normal: [f32; 3]) -> [f32; 3] {
    if matrix == DMat3::IDENTITY {
        return normal;
    }
    surfel_math::basis::unit(matrix * DVec3::from(normal.map(f64::from))).as_vec3().to_array()
}

impl Points {
    fn add(&mut self, positions: Vec<DVec3>, normals: Option<Vec<[f32; 3]>>, colors: Option<Vec<[f32; 4]>>) {
        let total = self.positions.len() + positions.len();
        self.positions.extend(positions);
        self.any_normal |= normals.is_some();
        self.any_color |= colors.is_some();
        self.normals.extend(normals.into_iter().flatten());
        self.normals.resize(total, [0.0; 3]);
        self.colors.extend(colors.into_iter().flatten());
        self.colors.resize(total, [1.0; 4]);
    }

    fn finish(self, context: &mut Context<'_>) -> Result<Content, Fault> {
        let (origin, positions) = measured_positions(&self.positions);
        let alphas = self.any_color && self.colors.iter().any(|c| c[3] < 1.0);
        context.points(PointCloud {
            origin,
            positions,
            normals: self.any_normal.then(|| Column3::from_f32(self.normals.into_iter().map(Into::into).collect())),
            alphas: alphas.then(|| self.colors.iter().map(|c| c[3]).collect()),
            colors: self.any_color.then(|| self.colors.iter().map(|c| [c[0], c[1], c[2]]).collect()),
            ..PointCloud::default()
        })
    }
}

impl Splats {
    fn add(
        &mut self,
        gltf: &Gltf<'_>,
        primitive: &Primitive,
        positions: Vec<DVec3>,
        world: DAffine3,
        same: impl Fn(&str, usize) -> Result<(), Problem>,
    ) -> Result<(), Problem> {
        let attribute = |name: &str| {
            let name = format!("KHR_gaussian_splatting:{name}");
            let index = primitive.attributes.get(&name).copied();
            index.ok_or_else(|| Problem::new(format!("Gaussian splats without {name}")).expected("that attribute"))
        };
        let rotations = gltf.floats::<4>(attribute("ROTATION")?)?;
        let scales = gltf.floats::<3>(attribute("SCALE")?)?;
        let alphas = gltf.floats::<1>(attribute("OPACITY")?)?;
        let colors = gltf.floats::<3>(attribute("SH_DEGREE_0_COEF_0")?)?;
        same("ROTATION", rotations.len())?;
        same("SCALE", scales.len())?;
        same("OPACITY", alphas.len())?;
        same("SH_DEGREE_0_COEF_0", colors.len())?;
        let (scale, rotation, _) = world.to_scale_rotation_translation();
        let uniform = scale.abs().max_element() - scale.abs().min_element() <= 1e-6 * scale.abs().max_element();
        self.sheared |= !uniform || scale.min_element() < 0.0;
        let scale = scale.abs().element_product().cbrt();
        self.positions.extend(positions);
        self.sigmas.extend(scales.iter().map(|s| DVec3::from(s.map(f64::from)) * scale));
        self.rotations.extend(rotations.iter().map(|q| rotation * DQuat::from_array(q.map(f64::from))));
        self.alphas.extend(alphas.iter().map(|a| a[0]));
        self.colors.extend(colors.iter().map(|c| c.map(|c| 0.5 + SH_C0 * f64::from(c))));
        Ok(())
    }

    fn finish(self, context: &mut Context<'_>) -> Result<Content, Fault> {
        if self.sheared {
            context.note("a node scales its Gaussian splats unevenly or mirrors them: their size is an average".into());
        }
        // A third axis of no extent everywhere means that the splats were flat already.
        let flat = self.sigmas.iter().all(|s| s.z == 0.0);
        let (origin, centers) = measured_positions(&self.positions);
        context.gaussians(Gaussians {
            origin,
            centers,
            kind: if flat { Kind::Flat } else { Kind::Solid },
            sigmas: self.sigmas,
            rotations: self.rotations,
            alphas: self.alphas,
            display_colors: self.colors,
            linear_colors: self.linear,
            up: None,
            comments: Vec::new(),
        })
    }
}
