//! Tests of a mesh's splats against its polygons: the same silhouette, facing and shading.

use glam::DVec3;
use std::f64::consts::{PI, TAU};
use surfel_conformance::build::object;
use surfel_conformance::polygons::{cube, mesh, mesh_object, quad};
use surfel_model::{Camera, Cull, EdgeAa, Mesh, Projection, Scene, Settings, Shader};
use surfel_render::{Frame, Planes, Renderer, View};
use surfel_sample::{MeshMethod, MeshOptions, NoProgress, splats_from_mesh};

const SIZE: u32 = 200;
/// Half the height of the view at the middle of the scene, in units of the scene.
const REACH: f64 = 2.3;
/// Number of facets around and along a capsule.
const TESSELLATIONS: [[u32; 2]; 5] = [[8, 6], [16, 8], [32, 16], [64, 32], [128, 64]];
pub(crate) const VIEWS: u32 = 48;

/// Returns a capsule of radius 1 and length 4 along the z axis, with the normals of the smooth surface; without the
/// upper cap if open.
fn capsule([around, along]: [u32; 2], is_open: bool) -> Mesh {
    let cap = along / 2 - 1;
    let ring = |z: f64, polar: f64| {
        (0..around).map(move |i| {
            let angle = TAU * f64::from(i) / f64::from(around);
            // All vertices of a pole coincide exactly.
            let radius = if polar.abs() < 1.57 { polar.cos() } else { 0.0 };
            let normal = DVec3::new(radius * angle.cos(), radius * angle.sin(), polar.sin());
            (normal + DVec3::Z * z, normal)
        })
    };
    let polar = |i: u32| 0.5 * PI * f64::from(i) / f64::from(cap);
    let mut rings: Vec<Vec<(DVec3, DVec3)>> = (0..=cap).rev().map(|i| ring(-1.0, -polar(i)).collect()).collect();
    rings.push(ring(0.0, 0.0).collect());
    let upper = if is_open { 0..1 } else { 0..cap + 1 };
    rings.extend(upper.map(|i| ring(1.0, polar(i)).collect()));
    let mut triangles = Vec::new();
    for j in 0..rings.len() as u32 - 1 {
        for i in 0..around {
            let (a, b) = (j * around + i, j * around + (i + 1) % around);
            triangles.extend([[a, b, b + around], [a, b + around, a + around]]);
        }
    }
    let vertices: Vec<(DVec3, DVec3)> = rings.concat();
    let positions: Vec<DVec3> = vertices.iter().map(|v| v.0).collect();
    let normals = vertices.iter().map(|v| v.1.as_vec3().to_array()).collect();
    Mesh { normals: Some(normals), ..mesh(&positions, triangles) }
}

fn area(mesh: &Mesh) -> f64 {
    let corners = |t: &[u32; 3]| t.map(|i| mesh.positions.get(i as usize));
    mesh.triangles.iter().map(corners).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
}

/// Returns evenly distributed directions: a Fibonacci spiral.
pub(crate) fn directions(count: u32) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let (z, angle) = (1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count), f64::from(i) * PI * (3.0 - 5f64.sqrt()));
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
    })
}

/// Returns the number of covered pixels among a pixel and its neighbours, and the number of these pixels.
fn covered_around(polygons: &Frame, at: usize) -> [usize; 2] {
    let (width, height) = (polygons.width() as usize, polygons.height() as usize);
    let (x, y) = (at % width, at / width);
    let around = (y.saturating_sub(1)..(y + 2).min(height))
        .flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
    [around.clone().filter(|at| polygons.depth()[*at].is_finite()).count(), around.count()]
}

/// Returns the number of holes and the number of inner pixels. Holes have no splat; inner pixels are within the
/// polygons' silhouette without its rim of one pixel.
pub(crate) fn hole_count(splats: &Frame, polygons: &Frame) -> [usize; 2] {
    let is_inside = |at: &usize| {
        let [covered, around] = covered_around(polygons, *at);
        covered == around
    };
    let inside = (0..polygons.depth().len()).filter(is_inside);
    let holes = inside.clone().filter(|at| splats.depth()[*at].is_infinite()).count();
    [holes, inside.count()]
}

/// Differences between an image of splats and one of polygons, over all views.
#[derive(Debug, Default)]
struct Differences {
    /// Number of pixels inside the polygons' silhouette, without its rim of one pixel.
    inside: usize,
    /// Number of inside pixels without any splat.
    holes: usize,
    /// Number of inside pixels covered by less than half.
    thin: usize,
    /// Number of pixels more than one pixel outside the silhouette, covered by at least half.
    beyond: usize,
    /// Number of inside pixels whose normals are more than 30° apart.
    turned: usize,
    /// Sum of squared differences of the colour's channels inside.
    squares: f64,
}

impl Differences {
    fn rmse(&self) -> f64 {
        (self.squares / (3 * self.inside) as f64).sqrt()
    }

    fn add(&mut self, splats: &Frame, polygons: &Frame) {
        let size = SIZE as usize;
        for at in 0..size * size {
            let [covered, around] = covered_around(polygons, at);
            let alpha = splats.color()[at][3];
            self.beyond += usize::from(covered == 0 && alpha >= 0.5);
            if covered < around {
                continue;
            }
            self.inside += 1;
            self.holes += usize::from(splats.depth()[at].is_infinite());
            self.thin += usize::from(alpha < 0.5);
            let normal = |frame: &Frame| DVec3::from(frame.normal()[at].map(f64::from));
            self.turned += usize::from(normal(splats).dot(normal(polygons)) < 30f64.to_radians().cos());
            for channel in 0..3 {
                self.squares += f64::from(splats.color()[at][channel] - polygons.color()[at][channel]).powi(2);
            }
        }
    }
}

/// Compares the splats of a mesh around the origin with its polygons, from those of 48 directions that `seen_from`
/// selects. The splats are `spacing_px` apart if they face the eye.
fn differences(mesh: &Mesh, cull: Cull, spacing_px: f64, seen_from: impl Fn(DVec3) -> bool) -> Differences {
    let count = area(mesh) * (f64::from(SIZE) / (2.0 * REACH * spacing_px)).powi(2);
    let options = MeshOptions::new(MeshMethod::Count(count as usize));
    let (cloud, _) = splats_from_mesh(mesh, &options, &NoProgress).unwrap();
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let [of_splats, of_polygons] = [object(cloud), mesh_object(mesh.clone())].map(|mut object| {
        object.material.cull = cull;
        cpu.upload(&Scene { objects: vec![object], ambient: [0.2; 3], ..Scene::default() }).unwrap()
    });
    let settings = Settings::default().with_shader(Shader::Phong).with_edge_aa(EdgeAa::Coverage);
    let mut found = Differences::default();
    for direction in directions(VIEWS).filter(|direction| seen_from(*direction)) {
        let camera = Camera {
            eye: (direction * 9.0).to_array(),
            target: [0.0; 3],
            up: if direction.z.abs() > 0.99 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] },
            projection: Projection::Perspective { fov_y_deg: 2.0 * (REACH / 9.0).atan().to_degrees() },
            near: 0.1,
            far: None,
            size: [SIZE; 2],
        };
        let view = View::new(&camera).unwrap();
        let [splats, polygons] = [&of_splats, &of_polygons].map(|scene| {
            let mut frame = Frame::default();
            cpu.render_into(scene, &view, &settings, Planes::ALL, &mut frame).unwrap();
            frame
        });
        found.add(&splats, &polygons);
    }
    found
}

#[test]
fn capsules_of_splats_look_like_their_polygons() {
    for is_open in [false, true] {
        for tessellation in TESSELLATIONS {
            let mesh = capsule(tessellation, is_open);
            assert_eq!(surfel_sample::is_closed(&mesh), !is_open);
            let found = differences(&mesh, if is_open { Cull::None } else { Cull::Back }, 2.0, |_| true);
            println!("{tessellation:?}, open {is_open}: RMSE {:.4}, {found:?}", found.rmse());
            assert!(found.inside > 300_000 && found.holes == 0 && found.beyond == 0, "{tessellation:?}: {found:?}");
            // Inside an open capsule, splats within 10° of edge-on are lit like its front (§2).
            let turned = if is_open { 300 } else { 2000 };
            assert!(found.rmse() < 0.02 && found.turned * turned < found.inside, "{tessellation:?}: {found:?}");
        }
    }
}

/// Splats end where the mesh does, at its open edges and at its creases, at any size.
#[test]
fn a_cube_and_a_sheet_of_large_splats_end_at_their_edges() {
    let ends = |mesh: Mesh, cull: Cull, seen_from: fn(DVec3) -> bool| {
        let found = differences(&mesh, cull, 8.0, seen_from);
        println!("RMSE {:.4}, {found:?}", found.rmse());
        assert!(found.inside > 200_000 && found.holes == 0 && found.beyond == 0, "{found:?}");
        assert!(found.turned * 10_000 < found.inside && found.rmse() < 0.01, "{found:?}");
    };
    ends(cube(), Cull::Back, |_| true);
    // From behind and within 10° of edge-on, an oriented surface is lit like its front (§2). The eye is so near that
    // other places of the sheet are seen at up to 15° more.
    let sheet = quad(DVec3::ZERO, [DVec3::X * 1.5, DVec3::Y], 1.0);
    ends(sheet, Cull::None, |direction| !(-0.5..0.0).contains(&direction.z));
}
