//! Splat clouds: a checkerboard to the horizon, a sphere, and spheres of coloured glass.

use super::ply::{Cloud, Disk};
use super::scan::SplitMix;

/// Number of squares along a side of the checkerboard.
const SQUARES: usize = 40;
/// Number of disks along a side of a square of the checkerboard.
const DISKS_A_SQUARE: usize = 10;
/// Number of disks of the sphere with bands of colour.
const SPHERE_DISKS: usize = 20_000;
/// Number of disks of each glass sphere.
const GLASS_DISKS: usize = 2_000;

/// Scene file of the checkerboard, on which filters are measured (docs/decisions/017-principal-filter.md).
pub(super) const CHECKERBOARD_SCENE: &str = r#"{
  "up": "+y",
  "camera": { "eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0],
              "projection": { "perspective": { "fov_y_deg": 60 } }, "near": 0.01, "size": [512, 512] },
  "objects": [ { "splats": "checkerboard.ply" } ],
  "settings": { "shader": "unlit" }
}
"#;

/// Returns the disks of a square of side 2 about (0, 0, −1.2). The square is seen from the origin and rotated by 80°
/// out of the image plane.
pub(super) fn checkerboard() -> Cloud {
    let n = SQUARES * DISKS_A_SQUARE;
    let spacing = 2.0 / n as f64;
    let (sin, cos) = 80f64.to_radians().sin_cos();
    let disk = |i: usize| {
        let (column, row) = (i % n, i / n);
        let along = |k: usize| (k as f64 + 0.5) * spacing - 1.0;
        let (x, v) = (along(column), along(row));
        let white = (column / DISKS_A_SQUARE + row / DISKS_A_SQUARE).is_multiple_of(2);
        let level = if white { 255 } else { 0 };
        Disk {
            position: [x, v * cos, -1.2 - v * sin],
            normal: [0.0, sin, cos],
            radius: spacing,
            color: [level, level, level, 255],
        }
    };
    Cloud { title: "checkerboard of disks, 80 degrees off the view", disks: (0..n * n).map(disk).collect() }
}

/// Returns the disks of a unit sphere with bands of colour, along a Fibonacci spiral.
pub(super) fn sphere() -> Cloud {
    let color = |direction: [f64; 3]| {
        let band = ((direction[1] + 1.0) * 4.0) as usize;
        if band.is_multiple_of(2) { [214, 92, 60, 255] } else { [240, 232, 214, 255] }
    };
    let disks = fibonacci(SPHERE_DISKS, [0.0; 3], 1.0).map(|disk| Disk { color: color(disk.normal), ..disk });
    Cloud { title: "unit sphere of disks on a Fibonacci spiral", disks: disks.collect() }
}

/// Returns the disks of 27 spheres of different sizes, colours and alphas that don't touch each other.
pub(super) fn glass_spheres() -> Cloud {
    let mut random = SplitMix(2001);
    let mut disks = Vec::new();
    for i in 0..27 {
        let cell = [i % 3, i / 3 % 3, i / 9].map(|k: usize| k as f64 - 1.0);
        // The radius and the offset of the centre are so small that the sphere stays in its cell of side 1.
        let radius = 0.3 + 0.1 * random.unit();
        let center = cell.map(|c| c + (0.98 - 2.0 * radius) * (random.unit() - 0.5));
        let level = |x: f64| (70.0 + 185.0 * x) as u8;
        let color = [random.unit(), random.unit(), random.unit()].map(level);
        let alpha = (64.0 + 128.0 * random.unit()) as u8;
        let color = [color[0], color[1], color[2], alpha];
        disks.extend(fibonacci(GLASS_DISKS, center, radius).map(|disk| Disk { color, ..disk }));
    }
    Cloud { title: "27 transparent spheres", disks }
}

/// Returns `n` disks of a sphere that represent equal areas. The radius of a disk is the distance to its neighbours.
fn fibonacci(n: usize, center: [f64; 3], radius: f64) -> impl Iterator<Item = Disk> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let spacing = (4.0 * std::f64::consts::PI / n as f64).sqrt();
    (0..n).map(move |i| {
        let y = 1.0 - (2 * i + 1) as f64 / n as f64;
        let (sin, cos) = (golden_angle * i as f64).sin_cos();
        let level = (1.0 - y * y).sqrt();
        let normal = [level * cos, y, level * sin];
        let position = std::array::from_fn(|k| center[k] + radius * normal[k]);
        Disk { position, normal, radius: spacing * radius, color: [255; 4] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn length(v: [f64; 3]) -> f64 {
        v.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
        length(std::array::from_fn(|k| a[k] - b[k]))
    }

    #[test]
    fn clouds_have_their_counts_and_unit_normals() {
        let clouds = [(checkerboard(), 160_000), (sphere(), 20_000), (glass_spheres(), 54_000)];
        for (cloud, count) in clouds {
            assert_eq!(cloud.disks.len(), count, "{}", cloud.title);
            for disk in &cloud.disks {
                // The tolerance allows a few roundings of numbers near 1.
                assert!((length(disk.normal) - 1.0).abs() < 1e-14 && disk.radius > 0.0, "{}: {disk:?}", cloud.title);
            }
        }
    }

    #[test]
    fn checkerboard_lies_in_its_plane_and_is_half_white() {
        let disks = checkerboard().disks;
        let off_plane = |d: &Disk| d.normal[1] * d.position[1] + d.normal[2] * (d.position[2] + 1.2);
        assert!(disks.iter().all(|d| off_plane(d).abs() < 1e-14));
        assert_eq!(disks.iter().filter(|d| d.color[0] == 255).count(), 80_000);
    }

    #[test]
    fn sphere_has_no_hole() {
        let disks = sphere().disks;
        // These directions are independent of the spiral; each must be within a radius of a disk's centre.
        for i in 0..500 {
            let (y, angle) = (f64::from(i) / 250.0 - 0.998, f64::from(i) * 0.7);
            let level = (1.0 - y * y).sqrt();
            let at = [level * angle.cos(), y, level * angle.sin()];
            let nearest = disks.iter().map(|d| distance(d.position, at) / d.radius).fold(f64::MAX, f64::min);
            assert!(nearest < 0.9, "{at:?}: {nearest}");
        }
    }

    #[test]
    fn glass_spheres_are_transparent_and_apart() {
        let disks = glass_spheres().disks;
        let spheres: Vec<_> = disks.chunks(GLASS_DISKS).collect();
        assert_eq!(spheres.len(), 27);
        assert!(disks.iter().all(|d| (64..192).contains(&d.color[3])));
        let ball = |sphere: &[Disk]| {
            let mean = |k: usize| sphere.iter().map(|d| d.position[k]).sum::<f64>() / sphere.len() as f64;
            let center = [mean(0), mean(1), mean(2)];
            (center, distance(center, sphere[0].position))
        };
        for (i, a) in spheres.iter().enumerate() {
            for b in &spheres[..i] {
                let ((a, ra), (b, rb)) = (ball(a), ball(b));
                assert!(distance(a, b) > ra + rb, "{a:?} {b:?}");
            }
        }
    }
}
