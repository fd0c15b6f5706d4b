//! Clipping of splats on partly transparent surfaces. Splats end where an alpha mask cuts the surface, or where an
//! opaque surface becomes transparent.
//!
//! Alpha is sampled inside each splat's disk, on the plane of its triangle. If a disk is only partly visible, four
//! disks of half the size replace it, up to twice if that doesn't add too many. The contour of the visible area in the
//! remaining disks becomes up to four clip lines. Invisible splats are removed.

use super::geometry::Geometry;
use crate::assemble;
use crate::parallel::map_each;
use glam::{DVec2, DVec3};
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{AlphaMode, ClipColumns, ClipLine, ClipMode, CloudData, Column3, NO_LINE, Shape};

/// Number of directions from a disk's centre in which the contour of the visible area is searched.
const DIRECTIONS: usize = 24;
/// Number of steps from a disk's centre to its rim in which alpha is sampled along each direction.
const STEPS: usize = 6;
/// Largest distance of contour points from a straight line at which one clip line stands for them, relative to the
/// disk's radius.
const STRAIGHT: f64 = 0.1;
/// Alpha below which a surface is invisible: half a step of 1/255.
const INVISIBLE_ALPHA: f32 = 0.5 / 255.0;
/// Radius, in disk radii, inside which everything must be invisible for a disk of a blended surface to be removed.
/// Neighbouring splats reach that far into the disk, and average their alpha with the disk's. Without the disk, visible
/// neighbours would stand out.
const REACH: f64 = 2.25;
/// Absolute barycentric coordinate from which a place is too far outside of a triangle for the triangle's texture. The
/// disk's centre is sampled instead.
const FAR: f64 = 4.0;
/// Maximum number of times that a partly visible disk is divided into four.
const DIVISIONS: usize = 2;
/// Number of disks that dividing may make, in addition to one per splat. If dividing all partly visible disks would
/// exceed it, none is divided further.
const MAX_ADDED: usize = 100_000;
/// Half of the usual distance between a disk and its neighbours, relative to the disk's radius. It is the offset of the
/// four smaller disks along both axes, and half the side of the square over which a disk's colour is averaged.
const OWN_SHARE: f64 = 0.5 / crate::radii::DENSITY;

/// Splat, or one of the smaller disks that replace it, with its colour and the result of its alpha test.
#[derive(Clone, Copy, Default)]
struct Piece {
    /// Index of the original splat to which the piece belongs.
    source: u32,
    /// Centre of the piece, in (u, v) of the original splat's disk.
    at: DVec2,
    /// Size of the piece, relative to the original splat.
    scale: f64,
    color: [f32; 4],
    fate: AlphaTest,
}

/// Result of the alpha test of a piece, which decides whether the piece is drawn, clipped, divided or removed.
#[derive(Clone, Copy, Default)]
enum AlphaTest {
    #[default]
    Whole,
    /// Clipping by these lines, because the contour of the visible area crosses the piece.
    Clipped([ClipLine; 4]),
    /// Removal after division: an alpha mask cuts the centre of the piece away, but another part is visible.
    MostlyCut,
    /// Division if possible, else no change: the piece is transparent on average, but a part of it is opaque.
    Mixed,
    Gone,
}

/// Disk of a splat in its triangle: barycentric coordinates of the centre, and their change along the half-axes.
struct Disk<'a> {
    geometry: &'a Geometry<'a>,
    face: usize,
    center: [f64; 3],
    along_s: [f64; 3],
    along_t: [f64; 3],
}

/// Removes invisible splats, and divides partly visible ones or clips them to the visible surface. `faces` are the
/// triangles of the splats. Returns the new columns and the triangle of each new splat.
pub(crate) fn cut(geometry: &Geometry, data: CloudData, faces: Vec<u32>) -> (CloudData, Vec<u32>) {
    if !geometry.mesh.is_see_through() {
        return (data, faces);
    }
    let axes: Vec<(DVec3, DVec3)> = (0..faces.len()).map(|i| axes_of(&data.shape, i)).collect();
    let disk = |i: usize| Disk::new(geometry, faces[i] as usize, data.centers.get(i), axes[i]);
    let whole = |i: usize| {
        let [r, g, b] = data.colors.as_ref().map_or([1.0; 3], |colors| colors[i]);
        let opacity = data.alphas.as_ref().map_or(1.0, |alphas| alphas[i]);
        let piece = Piece { source: i as u32, scale: 1.0, color: [r, g, b, opacity], ..Piece::default() };
        Piece { fate: disk(i).map_or(AlphaTest::Whole, |disk| fate(&disk, &piece)), ..piece }
    };
    let mut pieces = map_each(faces.len(), &crate::NoProgress, || (), |(), i| whole(i));
    // A clip curve can't be expressed in the coordinates of a part of the splat.
    let has_curve = |i: u32| data.clips.as_ref().is_some_and(|clips| clips.curve(i as usize).is_some());
    let is_mixed = |p: &Piece| {
        matches!(p.fate, AlphaTest::Clipped(_) | AlphaTest::MostlyCut | AlphaTest::Mixed) && !has_curve(p.source)
    };
    let mut left = faces.len() + MAX_ADDED;
    for _ in 0..DIVISIONS {
        let mixed = pieces.iter().filter(|piece| is_mixed(piece)).count();
        if mixed == 0 || 4 * mixed > left {
            break;
        }
        left -= 4 * mixed;
        let divided = map_each(
            pieces.len(),
            &crate::NoProgress,
            || (),
            |(), i| {
                let piece = pieces[i];
                match disk(piece.source as usize).filter(|_| is_mixed(&piece)) {
                    Some(disk) => quarters(&disk, &piece).to_vec(),
                    None => vec![piece],
                }
            },
        );
        pieces = divided.into_iter().flatten().collect();
    }
    pieces.retain(|piece| !matches!(piece.fate, AlphaTest::Gone | AlphaTest::MostlyCut));
    let faces = pieces.iter().map(|piece| faces[piece.source as usize]).collect();
    (assembled(data, &axes, &pieces), faces)
}

/// Divides a disk into four disks of half the size, and tests their alpha.
fn quarters(disk: &Disk<'_>, piece: &Piece) -> [Piece; 4] {
    let offset = OWN_SHARE * piece.scale;
    [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(x, y)| {
        let (at, scale) = (piece.at + DVec2::new(x, y) * offset, 0.5 * piece.scale);
        let part = Piece { at, scale, color: disk.color(at, scale), ..*piece };
        Piece { fate: fate(disk, &part), ..part }
    })
}

/// Builds the columns of a cloud from the tested pieces.
fn assembled(data: CloudData, axes: &[(DVec3, DVec3)], pieces: &[Piece]) -> CloudData {
    let sources: Vec<u32> = pieces.iter().map(|piece| piece.source).collect();
    let clipped = pieces.iter().any(|piece| matches!(piece.fate, AlphaTest::Clipped(_)));
    let divided = pieces.iter().any(|piece| piece.scale < 1.0);
    let own_axes = |p: &Piece| {
        let (s, t) = axes[p.source as usize];
        (s * p.scale, t * p.scale)
    };
    let shape = match &data.shape {
        Shape::Disks { normals, radii } if !clipped && !divided => Shape::Disks {
            normals: normals.select(&sources),
            radii: sources.iter().map(|&i| radii[i as usize]).collect(),
        },
        _ => assemble::ellipses(&pieces.iter().map(own_axes).collect::<Vec<_>>()),
    };
    let centers = if divided {
        let center = |p: &Piece| {
            let (s, t) = axes[p.source as usize];
            data.centers.get(p.source as usize) + s * p.at.x + t * p.at.y
        };
        let all: Vec<DVec3> = pieces.iter().map(center).collect();
        if data.centers.low().is_some() {
            Column3::from_f64(&all)
        } else {
            Column3::from_f32(all.iter().map(|p| p.as_vec3()).collect())
        }
    } else {
        data.centers.select(&sources)
    };
    let (colors, alphas) = assemble::paint(Some(pieces.iter().map(|piece| piece.color).collect()));
    let clips = (clipped || data.clips.is_some()).then(|| {
        let mut clips = data.clips.clone().unwrap_or_default();
        let (had_lines, had_modes) = (clips.lines.take(), clips.modes.take());
        let mode = |p: &Piece| had_modes.as_ref().map_or(ClipMode::And, |modes| modes[p.source as usize]);
        let lines = |p: &Piece| {
            let given = had_lines.as_ref().map_or([NO_LINE; 4], |lines| lines[p.source as usize]);
            let mut lines = given.map(|line| in_part(line, p));
            let has_lines = lines.iter().any(|line| !line.a.is_nan());
            if let AlphaTest::Clipped(more) = &p.fate
                && !(has_lines && mode(p) == ClipMode::Or)
            {
                let free = lines.iter_mut().filter(|line| line.a.is_nan());
                free.zip(more.iter().filter(|line| !line.a.is_nan())).for_each(|(line, new)| *line = *new);
                return (lines, ClipMode::And);
            }
            (lines, mode(p))
        };
        let (lines, modes) = pieces.iter().map(lines).unzip();
        let curves = clips.curves.map(|curves| sources.iter().map(|&i| curves[i as usize]).collect());
        ClipColumns { curves, lines: Some(lines), modes: Some(modes) }
    });
    let shading_normals = data.shading_normals.as_ref().map(|column| column.select(&sources));
    CloudData { centers, shape, colors, alphas, shading_normals, clips, ..data }
}

/// Converts a splat's clip line to the (u, v) coordinates of one of the pieces that replace the splat.
fn in_part(line: ClipLine, part: &Piece) -> ClipLine {
    let (a, b) = (f64::from(line.a), f64::from(line.b));
    let c = f64::from(line.c) + a * part.at.x + b * part.at.y;
    ClipLine { a: (a * part.scale) as f32, b: (b * part.scale) as f32, c: c as f32 }
}

fn axes_of(shape: &Shape, i: usize) -> (DVec3, DVec3) {
    match shape {
        Shape::Ellipses { s, t } => (s.get(i), t.get(i)),
        Shape::Disks { normals, radii } => {
            let (s, t) = orthonormal(unit(normals.get(i)));
            (s * f64::from(radii[i]), t * f64::from(radii[i]))
        }
        Shape::Balls { radii, .. } => (DVec3::X * f64::from(radii[i]), DVec3::Y * f64::from(radii[i])),
    }
}

/// Tests a piece by the opacity of its colour and the alpha inside its disk.
fn fate(disk: &Disk<'_>, piece: &Piece) -> AlphaTest {
    let alpha = |at: DVec2| disk.alpha(piece.at + at * piece.scale);
    let ring = |reach: f64| (0..DIRECTIONS).flat_map(move |k| [0.33, 0.66, 1.0].map(|r| direction(k) * (r * reach)));
    let opacity = piece.color[3];
    match disk.geometry.mesh.material(disk.face).alpha {
        AlphaMode::Opaque => AlphaTest::Whole,
        AlphaMode::Mask { cutoff } if opacity > 0.0 => contour(alpha, cutoff),
        AlphaMode::Mask { cutoff } if ring(1.0).any(|at| alpha(at) >= cutoff) => AlphaTest::MostlyCut,
        AlphaMode::Mask { .. } => AlphaTest::Gone,
        AlphaMode::Blend if opacity >= assemble::OPAQUE_ALPHA => contour(alpha, assemble::OPAQUE_ALPHA),
        AlphaMode::Blend if opacity < INVISIBLE_ALPHA && ring(REACH).all(|at| alpha(at) < INVISIBLE_ALPHA) => {
            AlphaTest::Gone
        }
        AlphaMode::Blend if ring(1.0).any(|at| alpha(at) >= assemble::OPAQUE_ALPHA) => AlphaTest::Mixed,
        AlphaMode::Blend => AlphaTest::Whole,
    }
}

impl<'a> Disk<'a> {
    /// Creates the disk of a splat. `None` if the triangle is opaque throughout, or if it has no area.
    fn new(geometry: &'a Geometry<'a>, face: usize, center: DVec3, (s, t): (DVec3, DVec3)) -> Option<Self> {
        let mesh = geometry.mesh;
        let textured = mesh.uvs.is_some() && mesh.material(face).texture.is_some();
        let one_alpha = mesh.alphas.as_ref().is_none_or(|a| {
            let [a, b, c] = mesh.triangles[face].map(|i| a[i as usize]);
            a == b && b == c && a >= assemble::OPAQUE_ALPHA
        });
        if !textured && one_alpha {
            return None;
        }
        let [along_s, along_t] = [s, t].map(|axis| geometry.barycentric_change(face, axis));
        let to_center = geometry.barycentric_change(face, center - geometry.corners(face)[0])?;
        let center = [1.0 + to_center[0], to_center[1], to_center[2]];
        Some(Self { geometry, face, center, along_s: along_s?, along_t: along_t? })
    }

    /// Returns alpha at a point in (u, v) of the disk.
    fn alpha(&self, at: DVec2) -> f32 {
        self.geometry.alpha(self.face, self.barycentric(at))
    }

    /// Returns the mean colour and opacity of a part of the disk, with its centre in (u, v) and its relative size.
    fn color(&self, at: DVec2, scale: f64) -> [f32; 4] {
        let radius = 0.5 * (self.length(self.along_s) + self.length(self.along_t)) * scale;
        self.geometry.color_about(self.face, self.barycentric(at), 2.0 * OWN_SHARE * radius)
    }

    fn barycentric(&self, at: DVec2) -> [f64; 3] {
        let b: [f64; 3] = std::array::from_fn(|k| self.center[k] + at.x * self.along_s[k] + at.y * self.along_t[k]);
        if b.iter().all(|b| b.abs() < FAR) { b } else { self.center }
    }

    /// Returns the length, in object units, of a vector given by its change of barycentric coordinates.
    fn length(&self, change: [f64; 3]) -> f64 {
        let [a, b, c] = self.geometry.corners(self.face);
        ((b - a) * change[1] + (c - a) * change[2]).length()
    }
}

fn direction(k: usize) -> DVec2 {
    DVec2::from_angle(std::f64::consts::TAU * k as f64 / DIRECTIONS as f64)
}

/// Finds up to four clip lines along the contour at which alpha falls below `level`, and searches from the opaque
/// centre outward. The disk stays whole if there is no such contour. `alpha` returns alpha at a point in (u, v).
fn contour(alpha: impl Fn(DVec2) -> f32, level: f32) -> AlphaTest {
    let own = alpha(DVec2::ZERO);
    let crossing = |k: usize| {
        let mut before = own.max(level);
        for step in 1..=STEPS {
            let at = direction(k) * (step as f64 / STEPS as f64);
            let here = alpha(at);
            if here < level {
                let share = f64::from((before - level) / (before - here));
                return Some(direction(k) * ((step as f64 - 1.0 + share) / STEPS as f64));
            }
            before = here;
        }
        None
    };
    let points: [Option<DVec2>; DIRECTIONS] = std::array::from_fn(crossing);
    let mut left = points;
    let mut lines = [NO_LINE; 4];
    for line in &mut lines {
        let nearest = (0..DIRECTIONS).filter_map(|k| Some((k, left[k]?)));
        let Some((k, _)) = nearest.min_by(|a, b| a.1.length_squared().total_cmp(&b.1.length_squared())) else { break };
        let (normal, distance) = straight(&points, k);
        *line = ClipLine { a: -normal.x as f32, b: -normal.y as f32, c: distance as f32 };
        left[k] = None;
        for point in &mut left {
            if point.is_some_and(|p| p.dot(normal) >= distance - STRAIGHT) {
                *point = None;
            }
        }
    }
    if lines[0].a.is_nan() { AlphaTest::Whole } else { AlphaTest::Clipped(lines) }
}

/// Fits a line to the `k`th contour point and as many points around it as are collinear. Returns the line's unit
/// normal, which points away from the centre, and its distance from the centre.
fn straight(points: &[Option<DVec2>; DIRECTIONS], k: usize) -> (DVec2, f64) {
    let own = points[k].unwrap_or_default();
    let mut best = (own.normalize_or(direction(k)), own.length());
    let mut chosen = vec![own];
    for reach in 1..=DIRECTIONS / 4 {
        let pair = [(k + reach) % DIRECTIONS, (k + DIRECTIONS - reach) % DIRECTIONS].map(|i| points[i]);
        chosen.extend(pair.into_iter().flatten());
        if chosen.len() < 2 {
            break;
        }
        let mean = chosen.iter().sum::<DVec2>() / chosen.len() as f64;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for d in chosen.iter().map(|p| *p - mean) {
            (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
        }
        // The direction of largest extent, and the normal across it.
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let normal = DVec2::from_angle(angle).perp();
        let normal = if normal.dot(mean) < 0.0 { -normal } else { normal };
        let distance = normal.dot(mean);
        if chosen.iter().any(|p| (normal.dot(*p) - distance).abs() > STRAIGHT) {
            break;
        }
        best = (normal, distance);
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshMethod, MeshOptions, splats_from_mesh};
    use glam::Vec3;
    use std::sync::Arc;
    use surfel_math::V2;
    use surfel_model::{ClipPolicy, Mesh, MeshMaterial, SplatCloud, Texture, TriangleMaterials};

    /// Returns a unit square with a texture of 64 columns whose alpha is a function of u.
    fn square(alpha: impl Fn(f32) -> u8, mode: AlphaMode) -> Mesh {
        let texel = |x: u32| [255, 255, 255, alpha((x as f32 + 0.5) / 64.0)];
        let texture = Texture { width: 64, height: 1, srgba8: (0..64).map(texel).collect() };
        let material = MeshMaterial { texture: Some(Arc::new(texture)), alpha: mode, normal_map: None };
        Mesh {
            positions: Column3::from_f32(vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y]),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            uvs: Some(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
            materials: Some(TriangleMaterials { materials: vec![material], of_triangle: vec![0; 2] }),
            ..Mesh::default()
        }
    }

    fn splats(mesh: &Mesh) -> SplatCloud {
        splats_from_mesh(mesh, &MeshOptions::new(MeshMethod::Count(2000)), &crate::NoProgress).unwrap().0
    }

    /// True if the visible part of any splat's disk covers a place; only opaque splats count if `opaque`.
    fn is_covered(cloud: &SplatCloud, p: DVec3, opaque: bool) -> bool {
        (0..cloud.len()).any(|i| {
            let (d, (s, t)) = (p - cloud.center(i), cloud.axes(i));
            let at = V2::new(d.dot(s) / s.length_squared(), d.dot(t) / t.length_squared());
            let clip = cloud.data().clips.as_ref().and_then(|clips| clips.clip(i, ClipPolicy::Exact));
            let inside = at.x * at.x + at.y * at.y <= 1.0 && clip.is_none_or(|clip| clip.keeps(at));
            inside && (!opaque || cloud.alpha(i) == 1.0)
        })
    }

    /// Returns places of a grid over the square, away from its border.
    fn places() -> impl Iterator<Item = DVec3> {
        let at = |i: usize| 0.06 + 0.88 * i as f64 / 60.0;
        (0..61).flat_map(move |x| (0..13).map(move |y| DVec3::new(at(x), at(5 * y), 0.0)))
    }

    #[test]
    fn masks_are_covered_up_to_their_edge_and_not_beyond() {
        // A wide stripe and a stem of 4/64, narrower than a splat's disk of 0.074.
        let kept = |u: f32| (0.25..0.5).contains(&u) || (0.75..0.8125).contains(&u);
        let cloud = splats(&square(|u| if kept(u) { 255 } else { 0 }, AlphaMode::Mask { cutoff: 0.5 }));
        assert!(cloud.data().alphas.is_none());
        // Alpha is interpolated between texels, and ½ at the stripes' ends; a tenth of a divided disk's radius is
        // 0.002.
        for p in places().filter(|p| [0.25, 0.5, 0.75, 0.8125].iter().all(|end| (p.x - end).abs() > 0.01)) {
            assert_eq!(is_covered(&cloud, p, false), kept(p.x as f32), "{p}");
        }
    }

    #[test]
    fn what_is_opaque_ends_where_blending_begins_and_what_is_not_seen_is_left_out() {
        let alpha = |u: f32| match u {
            0.3..0.6 => 128,
            0.6..0.9 => 255,
            _ => 0,
        };
        let cloud = splats(&square(alpha, AlphaMode::Blend));
        for p in places().filter(|p| [0.6, 0.9].iter().all(|end| (p.x - end).abs() > 0.02)) {
            assert_eq!(is_covered(&cloud, p, true), (0.6..0.9).contains(&p.x), "{p}");
        }
        let half = (0..cloud.len()).filter(|&i| (0.4..0.5).contains(&cloud.center(i).x));
        assert!(half.map(|i| cloud.alpha(i)).all(|a| (a - 128.0 / 255.0).abs() < 1e-3));
        // Invisible splats remain only where visible ones are averaged with them.
        let unseen: Vec<f64> = (0..cloud.len()).filter(|&i| cloud.alpha(i) == 0.0).map(|i| cloud.center(i).x).collect();
        assert!(!unseen.is_empty() && unseen.iter().all(|x| *x > 0.1), "{unseen:?}");
    }

    #[test]
    fn opaque_alpha_changes_nothing() {
        let opaque = square(|u| if u < 0.5 { 0 } else { 255 }, AlphaMode::Opaque);
        let cloud = splats(&opaque);
        assert_eq!((cloud.len(), cloud.data().alphas.is_none()), (2000, true));
    }
}
