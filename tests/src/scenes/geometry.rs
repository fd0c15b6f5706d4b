//! Scenes that test positions and visibility of splats.

use super::Case;
use crate::build::{Splat, camera, confetti, disk_cloud, object, scene, sheet, sphere};
use crate::random::Random;
use glam::{DAffine3, DMat3, DVec3};
use surfel_model::{Cull, DepthTolerance, EdgeAa, Filter, Mapping, Projection, Scene, SplatCloud};

const RED: [f32; 3] = [0.9, 0.1, 0.1];
const GREEN: [f32; 3] = [0.1, 0.8, 0.2];
const BLUE: [f32; 3] = [0.1, 0.2, 0.9];

pub(super) fn geometry_cases() -> Vec<Case> {
    let mut cases = vec![
        orientation(),
        facing_splat(),
        tilted_splat(),
        tilted_splat().with("affine", |s| s.mapping = Mapping::Affine),
        occluded_pair(),
        occluded_pair().with("absolute", |s| s.depth_tolerance = DepthTolerance::Absolute(0.02)),
        grazing_plane(),
        orthographic(),
        orthographic().with("adjust", |s| s.filter = Filter::Adjust),
        intrinsics(),
        mirrored_object(),
        culled_sphere(),
        disks(),
        closed_sphere().with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        sphere_before_plane(),
        beyond_its_filter(),
        grid(60).with("affine", |s| s.mapping = Mapping::Affine),
        single_pixel(),
        nearly_round(),
        disks_by_their_own_weight(),
    ];
    for filter in Filter::ALL {
        cases.push(grid(60).with(filter.name(), |s| s.filter = filter));
        cases.push(closed_sphere().with(filter.name(), |s| s.filter = filter));
        cases.push(anisotropic().with(filter.name(), |s| s.filter = filter));
        cases.push(grazing_plane().with(filter.name(), |s| s.filter = filter));
    }
    cases
}

/// Returns three splats: right, up and near. Catches flipped or swapped axes, a mirrored image, and a wrong up
/// direction.
pub fn orientation() -> Case {
    let splats = [
        Splat::disk(DVec3::new(0.8, 0.0, 0.0), DVec3::Z, 0.3, RED),
        Splat::disk(DVec3::new(0.0, 0.6, 0.0), DVec3::Z, 0.2, GREEN),
        Splat::disk(DVec3::new(-0.3, -0.3, 0.5), DVec3::Z, 0.1, BLUE),
    ];
    Case::new("orientation", scene(&splats), camera(3.0, 50.0, [80, 56]))
}

/// Returns one splat that faces the eye, a quarter pixel off centre. Catches a wrong kernel, cutoff or pixel centre.
pub fn facing_splat() -> Case {
    // The image is 48 px high, with fov 90° at distance 2: 12 px per unit. The splat is 0.25 px right and 0.125 px
    // down.
    let p = DVec3::new(0.25 / 12.0, -0.125 / 12.0, 0.0);
    Case::new("facing-splat", scene(&[Splat::disk(p, DVec3::Z, 1.5, RED)]), camera(2.0, 90.0, [48, 48]))
}

/// Returns one large splat tilted by 60°. Catches errors in the perspective of the footprint, the depth of its plane,
/// and the depth clamp.
pub fn tilted_splat() -> Case {
    let n = DVec3::new(60f64.to_radians().sin(), 0.2, 60f64.to_radians().cos());
    let splat = Splat::disk(DVec3::new(0.1, 0.05, 0.0), n, 0.9, GREEN);
    Case::new("tilted-splat", scene(&[splat]), camera(2.5, 50.0, [64, 64]))
}

/// Returns two sheets whose gap grows through the tolerance across the image. Catches a wrong ε, or the ε of the wrong
/// splat.
pub fn occluded_pair() -> Case {
    let back = sheet(DVec3::ZERO, [DVec3::X, DVec3::Y], [24, 24], 0.07, |_, _| BLUE);
    let front =
        sheet(DVec3::new(0.0, 0.0, 0.12), [DVec3::new(0.9, 0.0, 0.15), DVec3::Y * 0.6], [22, 16], 0.06, |c, _| {
            if c % 2 == 0 { RED } else { GREEN }
        });
    Case::new("occluded-pair", scene(&[back, front].concat()), camera(3.0, 45.0, [72, 72]))
}

/// Returns `n`×`n` splats in random colours, smaller than pixels at the far side. Catches aliasing, and splats that no
/// pixel centre hits.
pub fn grid(n: usize) -> Case {
    let mut random = Random::new(7);
    let axes = [DVec3::X, DVec3::new(0.0, 0.6, -0.8)];
    let splats = sheet(DVec3::ZERO, axes, [n, n], 2.4 / n as f64, |_, _| random.color());
    Case::new("grid", scene(&splats), camera(2.2, 50.0, [40, 40]))
}

/// Returns a watertight sphere, with silhouettes, back sides, and splats of every tilt.
pub fn closed_sphere() -> Case {
    let mut scene = scene(&sphere(1500, 1.1, 11));
    scene.objects[0].material.interior_weight = Some(2.0);
    Case::new("sphere", scene, camera(3.0, 45.0, [72, 72]))
}

/// Returns a large tilted disk in front of a wall, with antialiased edges. On the screen, the disk is wider than its
/// affine filter. Some pixels are inside the disk but have no filtered fragment: they must show the wall.
pub fn beyond_its_filter() -> Case {
    let axes = [DVec3::X * 6.0, DVec3::Y * 6.0];
    let mut splats = sheet(DVec3::new(0.0, 0.0, -6.0), axes, [10, 10], 1.2, |_, _| BLUE);
    let (sin, cos) = 78f64.to_radians().sin_cos();
    splats.push(Splat::disk(DVec3::new(0.9, 0.1, 0.4), DVec3::new(sin, 0.0, cos), 1.2, RED));
    let mut scene = scene(&splats);
    scene.objects[0].material.interior_weight = Some(2.0);
    let case = Case::new("beyond-its-filter", scene, camera(3.0, 70.0, [56, 48]));
    case.with("ewa/edge-aa", |s| (s.filter, s.edge_aa) = (Filter::Ewa, EdgeAa::Coverage))
}

/// Returns the sphere in front of a wall, with antialiased edges. Catches errors in coverage and in the surface behind
/// an edge.
pub fn sphere_before_plane() -> Case {
    let wall = sheet(DVec3::new(0.0, 0.0, -2.0), [DVec3::X * 3.0, DVec3::Y * 3.0], [40, 40], 0.2, |c, r| {
        if (c / 4 + r / 4) % 2 == 0 { GREEN } else { BLUE }
    });
    let mut scene = scene(&[sphere(900, 1.1, 12), wall].concat());
    scene.objects[0].material.interior_weight = Some(2.0);
    Case::new("sphere-before-plane", scene, camera(3.0, 45.0, [64, 64]))
        .with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage)
}

/// Returns ellipses of aspect up to 6 at any angle. Catches confused axes, and a filter that is right only for circles.
pub fn anisotropic() -> Case {
    Case::new("anisotropic", scene(&confetti(500, 0.02, 6.0, 13)), camera(3.0, 45.0, [56, 56]))
}

/// Returns a floor that extends to a far horizon. Catches errors in the slope term of ε, and in depths far outside
/// disks.
pub fn grazing_plane() -> Case {
    let mut random = Random::new(17);
    let axes = [DVec3::X * 2.0, DVec3::new(0.0, 0.0, -8.0)];
    let splats = sheet(DVec3::new(0.0, -0.25, -6.5), axes, [40, 110], 0.13, |_, _| random.color());
    Case::new("grazing-plane", scene(&splats), camera(2.0, 60.0, [64, 40]))
}

/// Returns an orthographic view of tilted splats, some beyond z_far. Catches errors in constant scale and linear depth.
pub fn orthographic() -> Case {
    let mut camera = camera(4.0, 45.0, [60, 48]);
    camera.projection = Projection::Orthographic { height: 2.2 };
    camera.far = Some(4.4);
    Case::new("orthographic", scene(&confetti(300, 0.06, 3.0, 19)), camera)
}

/// Returns a view with unequal focal lengths and a principal point outside the image. Catches f or c derived from the
/// fov.
pub fn intrinsics() -> Case {
    let mut camera = camera(3.0, 45.0, [64, 48]);
    camera.projection = Projection::Intrinsics { fx: 90.0, fy: 50.0, cx: -6.5, cy: 30.25 };
    let mut splats = confetti(300, 0.05, 3.0, 23);
    for splat in &mut splats {
        splat.p.x += 1.1;
    }
    Case::new("intrinsics", scene(&splats), camera)
}

/// Returns a mirrored, sheared object seen from outside, with back-face culling. Catches normals transformed by the
/// wrong matrix, and inverted sides.
pub fn mirrored_object() -> Case {
    let mut scene = scene(&sphere(900, 1.2, 29));
    let columns = [DVec3::new(-0.8, 0.2, 0.0), DVec3::new(0.0, 0.6, 0.3), DVec3::new(0.1, 0.0, 1.0)];
    let place =
        DAffine3::from_mat3_translation(DMat3::from_cols_array_2d(&columns.map(|c| c.to_array())), DVec3::X * 0.1);
    scene.objects[0].world_from_object = place;
    scene.objects[0].material.cull = Cull::Back;
    scene.objects[0].material.two_sided = false;
    Case::new("mirrored-object", scene, camera(3.0, 45.0, [56, 56])).with("lit", |s| {
        s.shader = surfel_model::Shader::Phong;
    })
}

/// Returns the far three quarters of a sphere with back-face culling, so that only its rim may be visible. Catches the
/// wrong sign of the facing test.
pub fn culled_sphere() -> Case {
    let far: Vec<Splat> = sphere(1200, 1.1, 31).into_iter().filter(|s| s.p.z < 0.5).collect();
    let mut scene = scene(&far);
    scene.objects[0].material.cull = Cull::Back;
    Case::new("culled-sphere", scene, camera(3.0, 45.0, [56, 56]))
}

/// Returns disks given by normals and radii. Catches half-axes whose length isn't the radius.
pub fn disks() -> Case {
    let mut random = Random::new(37);
    let disks: Vec<_> = (0..250)
        .map(|_| (random.direction() * 0.8, random.direction() * random.range(0.1, 9.0), random.range(0.02, 0.2)))
        .collect();
    let scene = Scene { objects: vec![object(disk_cloud(&disks, GREEN))], ..scene(&[]) };
    Case::new("disks", scene, camera(3.0, 45.0, [56, 56])).with("adjust", |s| s.filter = Filter::Adjust)
}

/// Returns an image of one pixel. Catches errors with neighbours, tiles and regions at the end of an image.
pub fn single_pixel() -> Case {
    let mut scene = scene(&sphere(200, 1.2, 41));
    scene.objects[0].material.interior_weight = Some(2.0);
    Case::new("single-pixel", scene, camera(3.0, 30.0, [1, 1])).with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage)
}

/// Returns ellipses with aspect ratios from 1.0005 to 1.0015, seen nearly edge-on, at any angle within their planes.
/// They test which ellipses `adjust` treats as disks, and by which angle it rotates these.
pub fn nearly_round() -> Case {
    let mut random = Random::new(127);
    let eye = DVec3::Z * 3.0;
    let splats: Vec<Splat> = (0..12)
        .map(|i| {
            let p = DVec3::new(0.2 * f64::from(i % 4) - 0.3, 0.5 * f64::from(i / 4) - 0.5, random.range(-0.2, 0.2));
            let toward = (p - eye).normalize();
            let (a, b) = surfel_math::basis::orthonormal(toward);
            let (sin, cos) = random.range(0.0, std::f64::consts::TAU).sin_cos();
            let elevation = random.range(0.002, 0.004);
            let n = (a * cos + b * sin) * elevation.cos() + toward * elevation.sin();
            let across = toward.cross(n).normalize();
            let (sin, cos) = random.range(0.6, 1.0).sin_cos();
            let roundness = [1.0 - 9e-4, 1.0 - 5e-4, 1.0 - 1.5e-3][i as usize % 3];
            let s = across * cos + n.cross(across) * sin;
            Splat { p, s: s * 0.7, t: n.cross(s) * (0.7 * roundness), color: random.color() }
        })
        .collect();
    Case::new("nearly-round", scene(&splats), camera(3.0, 45.0, [64, 64])).with("adjust", |s| {
        (s.filter, s.prefilter_radius_px) = (Filter::Adjust, 1.5);
    })
}

struct Disk {
    center: DVec3,
    normal: DVec3,
    radius: f64,
}

/// Returns two sheets of unevenly spaced disks, 0.85 radii apart, with edges antialiased by the interior weight of the
/// cloud. The weight depends on a disk's pair of half-axes, and on r_max measured from the sampled point. Backends
/// don't compute the weight, so the scene sets it from `interior_weight`.
pub fn disks_by_their_own_weight() -> Case {
    let disks = uneven_sheets();
    let mut scene = Scene { objects: vec![object(cloud_of(&disks))], ..scene(&[]) };
    scene.objects[0].material.interior_weight = Some(interior_weight(&disks));
    Case::new("disks-by-their-own-weight", scene, camera(3.0, 45.0, [56, 56]))
        .with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage)
}

fn cloud_of(disks: &[Disk]) -> SplatCloud {
    disk_cloud(&disks.iter().map(|d| (d.center, d.normal, d.radius)).collect::<Vec<_>>(), BLUE)
}

fn uneven_sheets() -> Vec<Disk> {
    let mut random = Random::new(131);
    let normals = [DVec3::new(0.3, 0.2, 1.0), DVec3::new(0.1, -0.3, 1.0)];
    (0..128)
        .map(|i| {
            let at = |k: i32| 0.2 * f64::from(k) - 0.7;
            let (x, y) = (at(i % 8) + random.range(-0.03, 0.03), at(i / 8 % 8) + random.range(-0.08, 0.08));
            let radius = 0.19;
            let z = 0.85 * radius * f64::from(i / 64);
            Disk { center: DVec3::new(x, y, z - 0.25 * x), normal: normals[i as usize % 2], radius }
        })
        .collect()
}

/// Computes the interior weight of disks by the definition in the rendering model (§5).
fn interior_weight(disks: &[Disk]) -> f64 {
    // Clouds store radii in f32.
    let stored = |d: &Disk| Disk { normal: d.normal.normalize(), radius: f64::from(d.radius as f32), ..*d };
    let disks: Vec<Disk> = disks.iter().map(stored).collect();
    let sample = |d: &Disk| {
        let n = d.normal;
        let sign = if n.z.is_sign_negative() { -1.0 } else { 1.0 };
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        let s = DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
        let t = DVec3::new(b, sign + n.y * n.y * a, -n.y);
        d.center + (s + t) * (0.5 * d.radius)
    };
    let weight_at = |k: &Disk| -> f64 {
        let sample = sample(k);
        let weight = |d: &Disk| {
            let along = d.normal.dot(d.center - sample) / d.normal.dot(k.normal);
            let rho_squared = (sample + k.normal * along - d.center).length_squared() / (d.radius * d.radius);
            let counts = d.normal.dot(k.normal) >= 0.5 && along.abs() <= k.radius && rho_squared <= 1.0;
            if counts { (-2.0 * rho_squared).exp() } else { 0.0 }
        };
        disks.iter().map(weight).sum()
    };
    let mut sums: Vec<f64> = disks.iter().map(weight_at).collect();
    sums.sort_by(f64::total_cmp);
    sums[(sums.len() - 1) / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interior_weight_of_uneven_sheets_is_what_a_cloud_stores() {
        let disks = uneven_sheets();
        let stored = surfel_sample::interior_weight(&cloud_of(&disks)).unwrap();
        let defined = interior_weight(&disks);
        assert!((stored - defined).abs() < 1e-12 * defined, "{stored} {defined}");
    }
}
