//! Tests of clipped splats of meshes: their visible parts are on the mesh, and cover all of it.

use crate::common;

use glam::{DVec3, Vec3};
use surfel_math::V2;
use surfel_model::{ClipPolicy, Column3, Mesh, SplatCloud};
use surfel_sample::{NoProgress, SampleError, SharpOptions, SharpReport, sharp_splats_from_mesh};

fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { positions: Column3::from_f32(positions), triangles, ..Mesh::default() }
}

fn convert(mesh: &Mesh, options: &SharpOptions) -> (SplatCloud, SharpReport) {
    sharp_splats_from_mesh(mesh, options, &NoProgress).unwrap()
}

fn splats(count: usize) -> SharpOptions {
    SharpOptions { splats: Some(count), ..SharpOptions::default() }
}

/// Returns the cube from −1 to 1 with each face divided into `n`×`n` squares.
fn cube(n: u32) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for normal in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|v| [v, -v]) {
        let across = if normal.x == 0.0 { Vec3::X } else { Vec3::Y };
        let along = normal.cross(across);
        let first = positions.len() as u32;
        let at = |i: u32| i as f32 / n as f32 * 2.0 - 1.0;
        positions.extend((0..=n).flat_map(|j| (0..=n).map(move |i| normal + across * at(i) + along * at(j))));
        for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
            let corner = first + j * (n + 1) + i;
            triangles.push([corner, corner + 1, corner + n + 2]);
            triangles.push([corner, corner + n + 2, corner + n + 1]);
        }
    }
    mesh(positions, triangles)
}

/// Returns the squares that bound a union of unit cubes, each as its centre, its normal and two unit directions along
/// its sides. `cells` are the centres of the cubes.
fn squares(cells: &[[i32; 3]]) -> Vec<[DVec3; 4]> {
    let mut found = Vec::new();
    for cell in cells {
        for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1), (axis, -1)]) {
            let mut beyond = *cell;
            beyond[axis] += sign;
            if !cells.contains(&beyond) {
                let normal = DVec3::AXES[axis] * f64::from(sign);
                let across = DVec3::AXES[(axis + 1) % 3];
                let center = DVec3::from(cell.map(f64::from)) + 0.5 * normal;
                found.push([center, normal, across, normal.cross(across)]);
            }
        }
    }
    found
}

/// Returns the surface of a union of unit cubes with centres `cells`, with each bounding square divided into `n`×`n`
/// squares.
fn blocks(cells: &[[i32; 3]], n: u32) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for [center, _, across, along] in squares(cells) {
        let first = positions.len() as u32;
        let at = |i: u32| f64::from(i) / f64::from(n) - 0.5;
        let point = |i: u32, j: u32| (center + across * at(i) + along * at(j)).as_vec3();
        positions.extend((0..=n).flat_map(|j| (0..=n).map(move |i| point(i, j))));
        for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
            let corner = first + j * (n + 1) + i;
            triangles.push([corner, corner + 1, corner + n + 2]);
            triangles.push([corner, corner + n + 2, corner + n + 1]);
        }
    }
    mesh(positions, triangles)
}

/// Returns a cylinder of radius 1 from z = −1 to 1 with `n` sides. Either cap has `rings` circles and a hub in its
/// middle. Without caps the cylinder is open.
fn cylinder(n: u32, rings: u32, capped: bool) -> Mesh {
    let (mut positions, mut triangles): (Vec<Vec3>, Vec<[u32; 3]>) = (Vec::new(), Vec::new());
    let circle = |radius: f32, z: f32| {
        (0..n).map(move |i| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / n as f32).sin_cos();
            Vec3::new(radius * cos, radius * sin, z)
        })
    };
    let belt = |triangles: &mut Vec<[u32; 3]>, a: u32, b: u32, flip: bool| {
        for i in 0..n {
            let j = (i + 1) % n;
            let (mut s, mut t) = ([a + i, a + j, b + j], [a + i, b + j, b + i]);
            if flip {
                (s, t) = ([s[0], s[2], s[1]], [t[0], t[2], t[1]]);
            }
            triangles.extend([s, t]);
        }
    };
    let levels = 12;
    for level in 0..=levels {
        positions.extend(circle(1.0, level as f32 / levels as f32 * 2.0 - 1.0));
        if level > 0 {
            belt(&mut triangles, (level - 1) * n, level * n, false);
        }
    }
    if !capped {
        return mesh(positions, triangles);
    }
    for (z, rim, flip) in [(-1.0, 0, true), (1.0, levels * n, false)] {
        let mut outer = rim;
        for ring in 1..rings {
            let inner = positions.len() as u32;
            positions.extend(circle(1.0 - ring as f32 / rings as f32, z));
            belt(&mut triangles, outer, inner, flip);
            outer = inner;
        }
        let hub = positions.len() as u32;
        positions.push(Vec3::new(0.0, 0.0, z));
        for i in 0..n {
            let (a, b) = (outer + i, outer + (i + 1) % n);
            triangles.push(if flip { [hub, b, a] } else { [hub, a, b] });
        }
    }
    mesh(positions, triangles)
}

/// Returns the visible points of splat `i` among those of a grid of `steps`² points over the square around its disk.
fn kept(cloud: &SplatCloud, i: usize, steps: u32) -> impl Iterator<Item = DVec3> {
    let ((s, t), p) = (cloud.axes(i), cloud.center(i));
    let clip = cloud.data().clips.as_ref().and_then(|c| c.clip(i, ClipPolicy::Exact));
    let at = move |k: u32| (f64::from(k) + 0.5) / f64::from(steps) * 2.0 - 1.0;
    (0..steps * steps)
        .map(move |k| V2::new(at(k % steps), at(k / steps)))
        .filter(move |uv| uv.length() <= 1.0 && clip.is_none_or(|c| c.keeps(*uv)))
        .map(move |uv| p + s * uv.x + t * uv.y)
}

/// Counts the splats that cover the point `p`: `p` is within `distance` of their plane, over their visible part, and
/// their normals are within 60° of `normal`.
fn covering(cloud: &SplatCloud, p: DVec3, normal: DVec3, distance: f64) -> usize {
    let covers = |i: &usize| {
        let (s, t) = cloud.axes(*i);
        let d = p - cloud.center(*i);
        let uv = V2::new(d.dot(s) / s.length_squared(), d.dot(t) / t.length_squared());
        let clip = cloud.data().clips.as_ref().and_then(|c| c.clip(*i, ClipPolicy::Exact));
        let own = s.cross(t).normalize();
        d.dot(own).abs() <= distance && own.dot(normal) > 0.5 && uv.length() <= 1.0 && clip.is_none_or(|c| c.keeps(uv))
    };
    (0..cloud.len()).filter(covers).count()
}

#[test]
fn sharp_cube_is_a_cube_at_any_count() {
    let mesh = cube(8);
    for options in [SharpOptions::default(), splats(300), splats(60), splats(12)] {
        let (cloud, report) = convert(&mesh, &options);
        let asked = options.splats.unwrap_or(768);
        assert!(cloud.len() <= asked && cloud.len() * 10 >= asked * 9, "{} of {asked}", cloud.len());
        assert_eq!(report.ridges, [12, 96]);
        // The overlap of both sides of a ridge is 5e-6 of the extent 2; a splat cut to its triangle extends by 2e-4 of
        // its radius.
        assert!(report.errors.splats_to_mesh[1] < 3e-4 && report.errors.mesh_to_splats[1] < 1e-6, "{report:?}");
        assert!(report.errors.normal_deg < 1e-4 && report.with_curve == 0, "{report:?}");
        for i in 0..cloud.len() {
            for p in kept(&cloud, i, 24) {
                assert!((p.abs().max_element() - 1.0).abs() < 3e-4, "splat {i} of {asked} keeps {p}");
            }
        }
        // Nothing is missing up to the edges and corners.
        for k in 0..4000 {
            let at = |step: f64| (f64::from(k) * step).fract() * 2.0 - 1.0;
            let (u, v) = (at(0.754_877_666_246_693), at(0.569_840_290_998_053));
            let normal = [DVec3::X, DVec3::NEG_Y, DVec3::Z][k as usize % 3];
            let p = match k % 3 {
                0 => DVec3::new(1.0, u, v),
                1 => DVec3::new(u, -1.0, v),
                _ => DVec3::new(u, v, 1.0),
            };
            assert!(covering(&cloud, p, normal, 1e-5) > 0, "{p} of {asked}");
        }
    }
}

#[test]
fn sharp_ridges_between_faces_stay_where_they_are_convex_or_concave() {
    // An L: 17 convex edges and a concave one, with a total length of 22 units.
    let cells = [[0, 0, 0], [1, 0, 0], [0, 1, 0]];
    let squares = squares(&cells);
    let distance = |p: DVec3| {
        let to = |[center, normal, across, along]: &[DVec3; 4]| {
            let d = p - *center;
            let over = |axis: &DVec3| (d.dot(*axis).abs() - 0.5).max(0.0);
            DVec3::new(d.dot(*normal), over(across), over(along)).length()
        };
        squares.iter().map(to).fold(f64::INFINITY, f64::min)
    };
    let mesh = blocks(&cells, 6);
    for count in [300, 100, 60] {
        let (cloud, report) = convert(&mesh, &splats(count));
        assert!(cloud.len() <= count, "{} of {count}", cloud.len());
        assert_eq!(report.ridges, [18, 22 * 6]);
        // As for the cube: no splat is visible beyond a crease, where it would protrude from the surface or be inside
        // the solid.
        for i in 0..cloud.len() {
            for p in kept(&cloud, i, 48) {
                assert!(distance(p) < 3e-4, "splat {i} of {count} keeps {p}, {} off", distance(p));
            }
        }
        // Up to 1e-4 beside every crease, both of its faces are covered in their own planes.
        for [center, normal, across, along] in &squares {
            for (edge, k) in (0..4).flat_map(|edge| (0..=40).map(move |k| (edge, k))) {
                let (beside, at) = (0.5 - 1e-4, f64::from(k) * 0.02498 - 0.4996);
                let (u, v) = [(beside, at), (-beside, at), (at, beside), (at, -beside)][edge];
                let p = *center + *across * u + *along * v;
                assert!(covering(&cloud, p, *normal, 1e-5) > 0, "{p} of {count}");
            }
        }
    }
}

#[test]
fn sharp_cylinder_rims_are_circles_on_both_sides() {
    let mesh = cylinder(256, 6, true);
    let (cloud, report) = convert(&mesh, &splats(160));
    // Two rims of 256 edges; each loop gets one corner.
    assert_eq!(report.ridges, [2, 512]);
    assert!(report.with_curve > 30, "{report:?}");
    // The fitted curve is at least as good as the parabola from which it starts.
    assert!(report.curve_errors[1] <= report.curve_errors[0] && report.curve_errors[1] < 2e-4, "{report:?}");
    // Moving the wall's planes to the mean height of their rim halves the distance between the two sides.
    assert!(report.mismatch[1] < 0.7 * report.mismatch[0], "{report:?}");
    let data = cloud.data();
    let curves = data.clips.as_ref().unwrap().curves.as_ref().unwrap();
    let (mut caps, mut walls) = (0, 0);
    for i in (0..cloud.len()).filter(|i| !curves[*i].w.is_nan()) {
        let curve = data.clips.as_ref().unwrap().curve(i).unwrap();
        let ((s, t), p) = (cloud.axes(i), cloud.center(i));
        let is_cap = s.cross(t).normalize().z.abs() > 0.99;
        (caps, walls) = (caps + usize::from(is_cap), walls + usize::from(!is_cap));
        for k in 0..=20 {
            let uv = curve.at(f64::from(k) / 20.0);
            let q = p + s * uv.x + t * uv.y;
            // Each side's curve is the rim seen along its own normal: a circle for the cap, a straight line for the
            // wall. The overlap covers the gap of the wall's planes, at most a chord's height.
            if is_cap {
                assert!((q.truncate().length() - 1.0).abs() < 0.03, "cap {i}: {}", q.truncate().length());
            } else {
                assert!((q.z.abs() - 1.0).abs() < 0.03, "wall {i}: {q}");
            }
        }
    }
    assert!(caps > 10, "{caps} caps, {walls} walls");
    // No scallops: nothing protrudes from the rims or above the caps.
    for i in 0..cloud.len() {
        for p in kept(&cloud, i, 16) {
            // A splat may protrude by 5 % of its radius, and the planes' overlap adds at most a chord's height.
            let most = 1.0 + 0.05 * cloud.radius_max(i) + 0.03;
            assert!(p.truncate().length() < most && p.z.abs() < 1.03, "splat {i}: {p}");
        }
    }
}

#[test]
fn sharp_border_of_an_open_surface_is_clipped_like_a_crease() {
    let mesh = cylinder(96, 0, false);
    let (cloud, report) = convert(&mesh, &splats(300));
    assert_eq!(report.ridges, [2, 192]);
    for i in 0..cloud.len() {
        for p in kept(&cloud, i, 16) {
            assert!(p.z.abs() < 1.005, "splat {i}: {p}");
        }
    }
    for k in 0..2000 {
        let angle = f64::from(k) * 2.399_963;
        let normal = DVec3::new(angle.cos(), angle.sin(), 0.0);
        let z = (f64::from(k) + 0.5) / 1000.0 - 1.0;
        // Chords of the 96 sides and of the simplified ones are up to 1 − cos(π/24) inside.
        assert!(covering(&cloud, normal + DVec3::Z * z, normal, 0.02) > 0, "{angle} {z}");
    }
}

#[test]
fn sharp_error_bounds_the_distance() {
    let mesh = cylinder(128, 6, true);
    let mut before = usize::MAX;
    for error in [1e-3, 4e-3, 2e-2] {
        let (cloud, report) = convert(&mesh, &SharpOptions { error: Some(error), ..SharpOptions::default() });
        // Each collapse stays within the limit, measured on the new triangles; splats reach a little beyond them.
        assert!(report.errors.mesh_to_splats[1] < 2.0 * error, "{error}: {report:?}");
        assert!(cloud.len() < before && report.errors.splats_to_mesh[0] < error, "{error}: {report:?}");
        before = cloud.len();
    }
}

#[test]
fn sharp_result_scales_with_the_mesh() {
    let unit = cube(4);
    let (_, report) = convert(&unit, &splats(60));
    for scale in [1e-18f32, 1e18] {
        let positions = unit.positions.high().iter().map(|p| *p * scale).collect();
        let (cloud, scaled) = convert(&mesh(positions, unit.triangles.clone()), &splats(60));
        assert_eq!((cloud.len(), scaled.with_lines), (report.splats, report.with_lines), "{scale}");
        assert!(scaled.errors.mesh_to_splats[1] < 1e-6 * f64::from(scale), "{scale}: {scaled:?}");
    }
}

#[test]
fn sharp_mesh_is_subdivided_for_more_splats() {
    let (cloud, report) = convert(&cube(2), &splats(1000));
    // 48 triangles, divided into four twice.
    assert_eq!((cloud.len(), report.ridges), (768, [12, 24]));
    assert!(report.errors.splats_to_mesh[1] < 2e-5);
}

#[test]
fn sharp_result_does_not_depend_on_threads() {
    let mesh = cylinder(64, 5, true);
    let in_pool = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (cloud, report) = pool.install(|| convert(&mesh, &splats(400)));
        (format!("{:?}", cloud.data()), report)
    };
    let (one, three) = (in_pool(1), in_pool(3));
    assert!(one == three);
    assert!(in_pool(3) == one);
}

#[test]
fn sharp_takes_any_mesh_without_panic() {
    let mut random = common::Lcg(7);
    for count in [1, 2, 30, 300] {
        for seed in 0..6 {
            // Soup: triangles over few vertices, so that edges have many faces, and some triangles without area.
            let vertices = 4 + count / 3;
            let positions = (0..vertices).map(|_| {
                let mut unit = || (random.unit() * 4.0).round() as f32 * if seed % 2 == 0 { 1.0 } else { 1e-12 };
                Vec3::new(unit(), unit(), unit())
            });
            let positions: Vec<Vec3> = positions.collect();
            let triangles =
                (0..count).map(|_| std::array::from_fn(|_| (random.unit() * vertices as f64) as u32)).collect();
            let soup = mesh(positions, triangles);
            for options in [SharpOptions::default(), splats(10), SharpOptions { error: Some(0.5), ..splats(1) }] {
                match sharp_splats_from_mesh(&soup, &options, &NoProgress) {
                    Ok((cloud, _)) => assert!(!cloud.is_empty()),
                    Err(SampleError::NoArea { .. }) => {}
                    Err(error) => panic!("{error}"),
                }
            }
        }
    }
}

#[test]
fn sharp_options_out_of_range_are_refused() {
    let mesh = cube(1);
    let refused = |options: SharpOptions| {
        matches!(sharp_splats_from_mesh(&mesh, &options, &NoProgress), Err(SampleError::Option { .. }))
    };
    let defaults = SharpOptions::default();
    assert!(refused(SharpOptions { crease_angle_deg: 0.0, ..defaults }));
    assert!(refused(SharpOptions { crease_angle_deg: f64::NAN, ..defaults }));
    assert!(refused(splats(0)));
    let many = sharp_splats_from_mesh(&mesh, &splats(usize::MAX), &NoProgress);
    assert!(matches!(many, Err(SampleError::TooMany { .. })));
    assert!(refused(SharpOptions { error: Some(-1.0), ..defaults }));
    assert!(refused(SharpOptions { error: Some(f64::INFINITY), ..defaults }));
    assert!(refused(SharpOptions { radius_scale: 0.0, ..defaults }));
    let empty = sharp_splats_from_mesh(&Mesh::default(), &defaults, &NoProgress);
    assert!(matches!(empty, Err(SampleError::Empty { .. })));
}
