//! Conversion to clipped splats that reproduce sharp edges, from meshes (C12 §4, §5) and from points.
//!
//! From a mesh:
//!
//! 1. `surface`: detects creases by dihedral angle, and open edges, and chains both into smooth ridges from corner to
//!    corner;
//! 2. `collapse`: simplifies the mesh without losing a ridge or making a splat that can't be clipped;
//! 3. `conic`: fits one curve in space to each piece of a ridge, so that the same curve clips the splats on both sides;
//! 4. `clip`: makes an ellipse per triangle, clips it exactly by the triangle's own ridges, and excludes the area
//!    beyond other ridges;
//! 5. `measure`: measures the distances between splats and mesh.
//!
//! `points` needs no mesh: it clips the splats of a point cloud along edges detected in the points.

mod clip;
mod collapse;
mod conic;
pub(crate) mod measure;
mod points;
mod surface;

use crate::mesh::geometry::Geometry;
use crate::mesh::{CLOSED_MESH, FLAT_PARTS, is_closed, is_oriented, see_through};
use crate::parallel::map_each;
use crate::{Progress, SampleError, assemble, interior};
use clip::{Border, Borders, ClippedSplat};
use conic::Conic;
use glam::DVec3;
use measure::MeshIndex;
use std::collections::HashMap;
use surface::{Surface, edge, normal_of};
use surfel_model::{ClipColumns, ClipCurve, ClipMode, CloudData, Mesh, OnInvalid, SplatCloud};

pub use measure::SharpErrors;
pub use points::{SharpPointsReport, sharpen_points};

/// Largest distance of a ridge (a crease or open edge) from its chord at which a line clips splats instead of a curve.
/// The distance is relative to the largest side of the mesh's bounding box. It is a twentieth of a pixel in an image
/// 1000 px wide.
const STRAIGHT: f64 = 5e-5;

/// Smallest overlap of the splats on the two sides of a ridge (a crease or open edge), relative to the largest side of
/// the mesh's bounding box: 50 times the rounding of f32.
const MIN_OVERLAP: f64 = 5e-6;

/// Largest distance of a splat from the mesh, beyond the splat's own triangle, relative to the largest side of the
/// mesh's bounding box. It is a quarter of a pixel in an image 1000 px wide. Parts of splats that protrude farther
/// would be visible past silhouettes, and are clipped.
const STRAY: f64 = 2.5e-4;

/// Largest distance of a splat from the mesh, relative to the splat's radius; the larger of this limit and [`STRAY`]
/// counts. On a curved surface, splats must overlap to blend. A larger limit covers too much beyond a silhouette, and a
/// smaller one makes facets visible.
const STRAY_SHARE: f64 = 0.035;

/// Options of the conversion of a mesh to clipped splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SharpOptions {
    /// Smallest dihedral angle of a crease between two faces, in degrees; 1 to 179, default 40.
    pub crease_angle_deg: f64,
    /// Number of splats, as a maximum, to which the mesh is simplified or refined; more remain if no further edge can
    /// be collapsed. `None` means one per triangle, unless `error` is given.
    pub splats: Option<usize>,
    /// Largest distance between splats and mesh that simplification may cause, in object units; `None` means no limit.
    pub error: Option<f64>,
    /// Factor for every radius; greater than 0, default 1.
    pub radius_scale: f64,
}

impl Default for SharpOptions {
    fn default() -> Self {
        Self { crease_angle_deg: 40.0, splats: None, error: None, radius_scale: 1.0 }
    }
}

impl SharpOptions {
    fn check(&self) -> Result<(), SampleError> {
        SampleError::check_scale(self.radius_scale)?;
        SampleError::check_crease_angle(self.crease_angle_deg)?;
        if self.splats == Some(0) {
            return Err(SampleError::option("the number of splats", 0, "at least 1"));
        }
        SampleError::check_count("splats", self.splats.unwrap_or(0))?;
        match self.error {
            Some(e) if !(e > 0.0 && e.is_finite()) => {
                Err(SampleError::option("the largest error", e, "a finite number greater than 0"))
            }
            _ => Ok(()),
        }
    }
}

/// Report of a conversion to clipped splats.
#[derive(Clone, Debug, PartialEq)]
pub struct SharpReport {
    /// Number of splats made, before transparent ones are removed or divided.
    pub splats: usize,
    /// Number of splats clipped by a curve.
    pub with_curve: usize,
    /// Number of splats clipped by lines, including those with a curve too.
    pub with_lines: usize,
    /// Number of splats cut back to about their triangle, because one curve and four lines couldn't clip all that is
    /// beyond ridges or protrudes from the surface.
    pub cut_back: usize,
    /// Number of ridges (smooth chains of creases and open edges), and number of edges of the original mesh in them.
    pub ridges: [usize; 2],
    /// Mean distance between ridges and the curves that clip along them (C12 eq. 12), in object units: for the first
    /// estimate of the curves, and after fitting.
    pub curve_errors: [f64; 2],
    /// Mean distance of curved ridges from the planes of the splats on both sides (C12 fig. 11), in object units. The
    /// first value is for splats in the planes of their triangles. The second one is for the resulting splats, whose
    /// planes are moved to the mean height of their ridges.
    pub mismatch: [f64; 2],
    /// Distances between the resulting splats and the mesh.
    pub errors: SharpErrors,
    /// Median of the splats' larger half-axes, in object units.
    pub median_radius: f64,
    /// Interior weight of the cloud ([`CloudData::interior_weight`]): the typical sum of kernel weights Σw inside its
    /// surface. `None` if it couldn't be measured.
    pub interior_weight: Option<f64>,
}

/// Converts a mesh to clipped splats: one ellipse per triangle, clipped along creases and open edges. A few large
/// splats thus reproduce the mesh's edges.
///
/// With [`SharpOptions::splats`] or [`SharpOptions::error`], the mesh is simplified first. If [`SharpOptions::splats`]
/// is at least four times the number of triangles, the mesh is refined instead. Each triangle is then divided into
/// four, repeatedly, while the total stays within the requested number. Colours are sampled at the splats' centres. On
/// a partly transparent mesh, invisible splats are removed, and partly visible ones are divided or clipped. Origin, up
/// axis and comments are copied, and the cloud's `interior_weight` is set if it can be measured. The errors, the
/// comment [`FLAT_PARTS`] and, for a watertight mesh, [`CLOSED_MESH`] are added as comments.
///
/// Sources: C12 §4 and §5; edge collapse by quadrics (Garland and Heckbert 1997).
///
/// # Errors
/// Same as [`crate::splats_from_mesh`].
pub fn sharp_splats_from_mesh(
    mesh: &Mesh,
    options: &SharpOptions,
    progress: &dyn Progress,
) -> Result<(SplatCloud, SharpReport), SampleError> {
    options.check()?;
    mesh.validate()?;
    if mesh.positions.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "vertices" });
    }
    if mesh.triangles.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "triangles" });
    }
    SampleError::check_count("triangles", mesh.triangles.len())?;
    let geometry = Geometry::new(mesh);
    let crease_cos = options.crease_angle_deg.to_radians().cos();
    let mut surface = Surface::new(&geometry, crease_cos);
    if surface.faces.is_empty() {
        return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
    }
    let index = MeshIndex::new(&geometry);
    let feature_edges = surface.pieces.len();
    if let Some(count) = options.splats {
        let mut times = 0;
        while surface.faces.len() << (2 * (times + 1)) <= count {
            times += 1;
        }
        if times > 0 {
            surface.subdivide(times, crease_cos);
        }
    }
    let straight = STRAIGHT * surface.extent;
    if options.splats.is_some() || options.error.is_some() {
        let limits = collapse::Limits {
            faces: options.splats.unwrap_or(1),
            error: options.error.unwrap_or(f64::INFINITY),
            straight,
            crease_cos,
        };
        let distance = |p: DVec3| index.signed_distance(p).abs();
        collapse::collapse(&mut surface, limits, &distance, progress);
    }
    let Sides { mut borders, own, regions, curve_errors } = borders(&surface, straight);
    let stray = STRAY * surface.extent;
    let (lifts, mismatch) = lift(&surface, &mut borders, &own, MIN_OVERLAP * surface.extent);
    progress.stage("clips", surface.faces.len() as u64);
    let splats: Vec<ClippedSplat> = map_each(
        surface.faces.len(),
        progress,
        || (),
        |(), i| {
            let outside = |p: DVec3, radius: f64| index.signed_distance(p) > stray.max(STRAY_SHARE * radius);
            let corners = surface.corners(surface.faces[i]);
            let lift = lifts[i] * normal_of(corners);
            let margin = 4.0 * lifts[i].abs();
            let moved = corners.map(|p| p + lift);
            clip::clip(moved, own[i], regions[i], &borders, options.radius_scale, margin, outside)
        },
    );
    progress.stage("errors", 1);
    let errors = index.errors(&splats);
    progress.advance(1);
    let mut cloud = assemble_cloud(mesh, &geometry, &index, &splats, &errors)?;
    cloud.set_oriented(is_oriented(mesh));
    let interior_weight = interior::interior_weight(&cloud);
    if let Some(weight) = interior_weight {
        cloud.set_interior_weight(weight);
    }
    let mut radii: Vec<f64> = (0..cloud.len()).map(|i| cloud.radius_max(i)).collect();
    let report = SharpReport {
        splats: splats.len(),
        with_curve: splats.iter().filter(|s| s.curve.is_some()).count(),
        with_lines: splats.iter().filter(|s| !s.lines[0].a.is_nan()).count(),
        cut_back: splats.iter().filter(|s| s.is_cut_back).count(),
        ridges: [surface.ridges.len(), feature_edges],
        curve_errors,
        mismatch,
        errors,
        median_radius: crate::radii::median(&mut radii).unwrap_or(0.0),
        interior_weight,
    };
    Ok((cloud, report))
}

/// Borders of a surface that clip its splats, and the smooth regions between them.
struct Sides {
    /// Borders, two for each piece of a ridge: one for the surface on either side.
    borders: Borders,
    /// Index of the border along each of the three edges of each triangle; `None` for edges on no ridge.
    own: Vec<[Option<usize>; 3]>,
    /// Index of the smooth region that contains each triangle.
    regions: Vec<u32>,
    /// Mean distance between ridges and the curves that clip along them (C12 eq. 12): for the first estimate, and after
    /// fitting.
    curve_errors: [f64; 2],
}

/// Fits one curve to each piece of a ridge, and makes a border for the surface on either side. Pieces within `straight`
/// of their chord get the chord.
fn borders(surface: &Surface, straight: f64) -> Sides {
    let regions = regions(surface);
    let mut pieces: Vec<_> = surface.pieces.iter().map(|(e, p)| (*e, *p)).collect();
    pieces.sort_unstable_by_key(|(e, p)| (p.ridge, p.from, *e));
    let fits: Vec<_> = map_each(
        pieces.len(),
        &crate::NoProgress,
        || (),
        |(), i| {
            let line = surface.line(&pieces[i].1);
            let fit = conic::fit(&line);
            let chord = Conic::straight(fit.conic.p1, fit.conic.p3);
            if fit.conic.sagitta() > straight { fit } else { conic::Fit { conic: chord, ..fit } }
        },
    );
    let sum = |k: usize| fits.iter().map(|f| f.errors[k]).sum::<f64>() / fits.len().max(1) as f64;
    let errors = [sum(0), sum(1)];
    let curves: HashMap<_, _> = pieces.iter().zip(&fits).map(|((e, p), fit)| (*e, (*p, fit.conic))).collect();
    let mut all = Vec::new();
    let own = surface.faces.iter().enumerate().map(|(i, face)| {
        std::array::from_fn(|k| {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let (piece, conic) = curves.get(&edge(a, b))?;
            let starts_at_a = surface.ridges[piece.ridge as usize][piece.from as usize] == a;
            all.push(Border {
                conic: if starts_at_a { *conic } else { conic.reversed() },
                ridge: piece.ridge,
                region: regions[i],
                normal: normal_of(surface.corners(*face)),
                is_straight: conic.sagitta() <= straight,
                overlap: 0.0,
            });
            Some(all.len() - 1)
        })
    });
    let own = own.collect();
    Sides { borders: Borders::new(all), own, regions, curve_errors: errors }
}

/// Numbers the smooth regions, which ridges separate, and returns the region of each triangle.
fn regions(surface: &Surface) -> Vec<u32> {
    let mut beyond: HashMap<_, Vec<u32>> = HashMap::new();
    for (i, face) in surface.faces.iter().enumerate() {
        for k in 0..3 {
            beyond.entry(edge(face[k], face[(k + 1) % 3])).or_default().push(i as u32);
        }
    }
    let mut regions = vec![u32::MAX; surface.faces.len()];
    let mut next = 0;
    for start in 0..surface.faces.len() {
        if regions[start] != u32::MAX {
            continue;
        }
        let mut open = vec![start];
        regions[start] = next;
        while let Some(face) = open.pop() {
            for k in 0..3 {
                let e = edge(surface.faces[face][k], surface.faces[face][(k + 1) % 3]);
                if surface.pieces.contains_key(&e) {
                    continue;
                }
                for &other in beyond.get(&e).into_iter().flatten() {
                    if regions[other as usize] == u32::MAX {
                        regions[other as usize] = next;
                        open.push(other as usize);
                    }
                }
            }
        }
        next += 1;
    }
    regions
}

/// Returns the distance by which each triangle's plane is moved along its normal, to the mean height of the triangle's
/// own curved borders. Borders bulge out of the plane if the surface is curved across the ridge. The second value is
/// the mean distance of the borders from the planes, before and after the move (C12 fig. 11). The remaining distance
/// would open a gap between the two sides of a ridge, so both sides overlap by that distance. They overlap at least by
/// `least_overlap`, which exceeds the rounding of f32 axes.
fn lift(
    surface: &Surface,
    borders: &mut Borders,
    own: &[[Option<usize>; 3]],
    least_overlap: f64,
) -> (Vec<f64>, [f64; 2]) {
    let (mut sums, mut count) = ([0.0; 2], 0usize);
    let mut gaps: HashMap<surface::Edge, f64> = HashMap::new();
    let mut lifts = Vec::with_capacity(own.len());
    for (face, own) in surface.faces.iter().zip(own) {
        let (normal, p) = (normal_of(surface.corners(*face)), surface.positions[face[0] as usize]);
        let heights = |border: &Border| {
            let points = border.conic.even_points(clip::PIECE_SAMPLES);
            points.into_iter().map(|q| (q - p).dot(normal)).collect::<Vec<f64>>()
        };
        let curved = |k: &usize| own[*k].map(|i| &borders.all[i]).filter(|b| !b.is_straight);
        let all: Vec<f64> = (0..3).filter_map(|k| curved(&k)).flat_map(heights).collect();
        let lift = all.iter().sum::<f64>() / all.len().max(1) as f64;
        lifts.push(lift);
        if !all.is_empty() {
            let mean = |lift: f64| all.iter().map(|h| (h - lift).abs()).sum::<f64>() / all.len() as f64;
            sums = [sums[0] + mean(0.0), sums[1] + mean(lift)];
            count += 1;
        }
        for k in 0..3 {
            let Some(border) = own[k].map(|i| &borders.all[i]) else { continue };
            // A straight border is also off a plane that was moved toward another border.
            let gap = heights(border).into_iter().map(|h| (h - lift).abs()).fold(0.0, f64::max);
            let entry = gaps.entry(edge(face[k], face[(k + 1) % 3])).or_default();
            *entry = entry.max(gap);
        }
    }
    for (face, own) in surface.faces.iter().zip(own) {
        for k in 0..3 {
            if let (Some(i), Some(gap)) = (own[k], gaps.get(&edge(face[k], face[(k + 1) % 3]))) {
                borders.all[i].overlap = gap.max(least_overlap);
            }
        }
    }
    (lifts, sums.map(|s| s / count.max(1) as f64))
}

fn assemble_cloud(
    mesh: &Mesh,
    geometry: &Geometry,
    index: &MeshIndex,
    splats: &[ClippedSplat],
    errors: &SharpErrors,
) -> Result<SplatCloud, SampleError> {
    let positions: Vec<DVec3> = splats.iter().map(|s| s.center).collect();
    let axes: Vec<(DVec3, DVec3)> = splats.iter().map(|s| (s.s, s.t)).collect();
    let mut data = CloudData::new(mesh.origin, assemble::centers(mesh, &positions), assemble::ellipses(&axes));
    if splats.iter().any(ClippedSplat::is_clipped) {
        let none = ClipCurve { theta1: 0.0, theta3: 0.0, u: 0.0, v: 0.0, w: f32::NAN };
        let has_curves = splats.iter().any(|s| s.curve.is_some());
        let has_lines = splats.iter().any(|s| !s.lines[0].a.is_nan());
        data.clips = Some(ClipColumns {
            curves: has_curves.then(|| splats.iter().map(|s| s.curve.unwrap_or(none)).collect()),
            lines: has_lines.then(|| splats.iter().map(|s| s.lines).collect()),
            modes: has_lines.then(|| vec![ClipMode::And; splats.len()]),
        });
    }
    let rgba = geometry.is_painted().then(|| splats.iter().map(|s| index.color(geometry, s.center)).collect());
    (data.colors, data.alphas) = assemble::paint(rgba);
    if mesh.is_see_through() {
        let faces = positions.iter().map(|p| index.face(*p)).collect();
        data = see_through::cut(geometry, data, faces).0;
    }
    data.up = mesh.up;
    data.comments = mesh.comments.clone();
    data.comments.push(errors.comment());
    data.comments.push(FLAT_PARTS.into());
    if is_closed(mesh) {
        data.comments.push(CLOSED_MESH.into());
    }
    Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
}
