//! Tests of fits against closed forms, a dense solver and a table measured by other code.

use super::system::shares_at;
use super::*;
use crate::NoProgress;
use crate::mesh::random::Random;
use glam::Vec3;
use std::sync::Arc;
use surfel_model::{CloudData, OctreeNode, Texture};

/// Number of texels per splat along each side.
const TEXELS: usize = 6;
/// Radii of the splats in the measured table, in units of the distance between splats.
const RADII: [f32; 3] = [1.0, 1.42, 2.0];

/// Encodes linear light as an sRGB byte.
fn encoded(v: f64) -> u8 {
    (surfel_math::srgb::encode(v) * 255.0).round() as u8
}

/// Returns a square of the plane z = 0 with side length `side` and a grey texture of values in [0, 1] at x, y.
fn textured(side: usize, value: impl Fn(f64, f64) -> f64) -> Mesh {
    let (s, n) = (side as f32, side * TEXELS);
    let texel = |i: usize| {
        let at = |k: usize| (k as f64 + 0.5) / TEXELS as f64;
        let v = encoded(value(at(i % n), at(i / n)));
        [v, v, v, 255]
    };
    let srgba8 = (0..n * n).map(texel).collect();
    Mesh {
        positions: Column3::from_f32([[0., 0.], [s, 0.], [s, s], [0., s]].map(|[x, y]| Vec3::new(x, y, 0.)).to_vec()),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        uvs: Some(vec![[0., 0.], [1., 0.], [1., 1.], [0., 1.]]),
        texture: Some(Arc::new(Texture { width: n as u32, height: n as u32, srgba8 })),
        ..Mesh::default()
    }
}

/// Returns the grey value at x, y of black and white squares four splats wide.
fn checker(x: f64, y: f64) -> f64 {
    f64::from(((x / 4.0).floor() + (y / 4.0).floor()) as i64 % 2 == 0)
}

/// Returns the grey value at x, y of sines with a period of seven splats. The source of the measured table doesn't
/// state its own function; point samples have the same error for both.
fn sines(x: f64, y: f64) -> f64 {
    let turn = std::f64::consts::TAU / 7.0;
    0.5 + 0.22 * ((x * turn).sin() + (y * turn).sin())
}

/// Returns a disk for each unit square, up to 0.35 off its middle along x and y, with the texture's value at its
/// centre.
fn jittered(mesh: &Mesh, side: usize, radius: f32) -> SplatCloud {
    let mut random = Random::new(7);
    let mut jitter = || ((random.unit() - 0.5) * 0.7) as f32;
    let place = |i: usize| Vec3::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5, 0.0);
    let centers: Vec<Vec3> = (0..side * side).map(|i| place(i) + Vec3::new(jitter(), jitter(), 0.0)).collect();
    let texture = mesh.texture.as_ref().unwrap();
    let color = |p: &Vec3| {
        let [r, g, b, _] = texture.sample([p.x / side as f32, p.y / side as f32]);
        [r, g, b]
    };
    let colors: Vec<[f32; 3]> = centers.iter().map(color).collect();
    let n = centers.len();
    SplatCloud::disks(&centers, &vec![Vec3::Z; n], &vec![radius; n]).unwrap().with_colors(&colors).unwrap()
}

/// Returns the RMSE between the blend of values and the texture's red, at 5×5 places per splat. Places less than four
/// splats from the square's border are left out.
fn rmse(cloud: &SplatCloud, values: &dyn Fn(usize) -> f64, mesh: &Mesh, side: usize) -> f64 {
    let kernels = Kernels::new(cloud);
    let texture = mesh.texture.as_ref().unwrap();
    let (mut sum, mut count) = (0.0, 0);
    for i in 20..side * 5 - 20 {
        for j in 20..side * 5 - 20 {
            let at = |k: usize| (k as f64 + 0.5) / 5.0;
            let p = DVec3::new(at(i), at(j), 0.0);
            let near = kernels.near(p, 0.0);
            let weight = |s: &u32| kernels.get(*s as usize).weight(p, DVec3::Z);
            let weights: Vec<f64> = near.iter().map(weight).collect();
            let total: f64 = weights.iter().sum();
            let blend = near.iter().zip(&weights).map(|(s, w)| w * values(kernels.tree.index(*s as usize)));
            let want = texture.sample([p.x as f32 / side as f32, p.y as f32 / side as f32])[0];
            sum += (blend.sum::<f64>() / total - f64::from(want)).powi(2);
            count += 1;
        }
    }
    (sum / f64::from(count)).sqrt()
}

fn red(cloud: &SplatCloud) -> impl Fn(usize) -> f64 + '_ {
    |i| cloud.color(i)[0].into()
}

fn fitted(cloud: &SplatCloud, mesh: &Mesh, sampling: TextureSampling) -> (SplatCloud, FitReport) {
    fit_to_mesh(cloud.clone(), mesh, sampling, &NoProgress).unwrap()
}

/// Builds the normal equations of a cloud's first colour channel.
fn system(cloud: &SplatCloud, mesh: &Mesh) -> (Kernels, Samples<1>, Vec<[f32; 1]>, System<1>) {
    let geometry = Geometry::new(mesh);
    let kernels = Kernels::new(cloud);
    let value = |face: usize, b: [f64; 3], _: f64| {
        let [r, _, _, a] = geometry.color(face, b);
        ([r], a)
    };
    let samples = Samples::of_mesh(&geometry, DVec3::ZERO, &kernels, &value);
    let present: Vec<[f32; 1]> = (0..cloud.len()).map(|slot| [cloud.color(kernels.tree.index(slot))[0]]).collect();
    let system = System::new(&kernels, &samples, &present, &NoProgress);
    (kernels, samples, present, system)
}

/// Compares the errors of fits with a table that was measured by a NumPy program: RMSE of point samples, of
/// view-independent EWA and of the bounded fit.
#[test]
fn the_measured_table_is_reproduced() {
    let side = 60;
    let black_and_white = [[0.2343, 0.2700, 0.2311], [0.2735, 0.3238, 0.2731], [0.3248, 0.3817, 0.3247]];
    let smooth = [[0.0322, 0.0386, 0.0206], [0.0345, 0.0546, 0.0114], [0.0552, 0.0919, 0.0093]];
    let gains = [1.5, 2.9, 5.6];
    for (name, mesh, table) in
        [("checker", textured(side, checker), black_and_white), ("sines", textured(side, sines), smooth)]
    {
        for ((radius, measured), gain) in RADII.into_iter().zip(table).zip(gains) {
            let cloud = jittered(&mesh, side, radius);
            let errors = TextureSampling::ALL.map(|sampling| {
                let (fit, report) = fitted(&cloud, &mesh, sampling);
                // The solver minimises the mean over the whole square.
                assert!(sampling != TextureSampling::Fit || report.color_rms[1] <= report.color_rms[0], "{report:?}");
                assert!(report.residual <= 1e-4, "{report:?}");
                assert!(fit.data().colors.iter().flatten().flatten().all(|c| (0.0..=1.0).contains(c)));
                rmse(&fit, &red(&fit), &mesh, side)
            });
            println!("{name} {radius}: {errors:.4?}, {measured:?}");
            for (found, measured) in errors.iter().zip(measured) {
                // Other random numbers change the error by up to 5 %, as accepted in the issue.
                assert!((found / measured - 1.0).abs() < 0.05, "{name} {radius}: {errors:.4?}, {measured:?}");
            }
            assert!(errors[2] <= errors[0], "{name} {radius}: {errors:.4?}");
            assert!(name == "checker" || errors[0] / errors[2] >= gain, "{radius}: {errors:.4?}");
        }
    }
}

#[test]
fn no_step_within_the_bounds_improves_a_fit() {
    for (mesh, radius) in [(textured(30, checker), 1.42), (textured(30, sines), 2.0)] {
        let (fit, _) = fitted(&jittered(&mesh, 30, radius), &mesh, TextureSampling::Fit);
        // Assembled anew around the solution, b is minus the gradient there.
        let (_, _, present, system) = system(&fit, &mesh);
        for (k, value) in present.iter().enumerate() {
            let c = f64::from(value[0]);
            let [least, largest] = system.local[k][0].map(f64::from);
            let beyond = BEYOND * (largest - least);
            let (low, high) = ((least - beyond).max(0.0), (largest + beyond).min(1.0));
            // The values were computed in f32.
            assert!(low - 1e-6 <= c && c <= high + 1e-6, "{k}: {c} of {low} to {high}");
            let step = (c + system.b[k][0] / system.gram.mass[k]).clamp(low, high) - c;
            assert!(step.abs() <= 1e-4, "{k}: {c} moves by {step}");
        }
    }
}

#[test]
fn channels_go_beyond_the_texture_by_one_share_that_keeps_its_hue() {
    let bounds = |local: [[f32; 2]; 3], present: [f32; 3]| within(&[[0.0, 1.0]; 4], &local, &present);
    // Black on rose: red has no room left above, and no channel has room below.
    let rose = bounds([[0.0, 1.0], [0.0, 0.8], [0.0, 0.75]], [0.5, 0.4, 0.3]);
    let expected = [[-0.5, 0.5], [-0.4, 0.4], [-0.3, 0.45], [0.0; 2]];
    assert!(rose.as_flattened().iter().zip(expected.as_flattened()).all(|(b, e)| (b - e).abs() < 1e-6), "{rose:?}");
    // Green has a fifth of its range left above; blue doesn't vary.
    let some = bounds([[0.5, 0.6], [0.4, 0.9], [1.0, 1.0]], [0.5, 0.5, 1.0]);
    let expected = [[-0.035, 0.12], [-0.275, 0.5], [0.0, 0.0], [0.0; 2]];
    assert!(some.as_flattened().iter().zip(expected.as_flattened()).all(|(b, e)| (b - e).abs() < 1e-6), "{some:?}");
    // A present value beyond the bounds may remain.
    assert_eq!(bounds([[0.2, 0.4]; 3], [0.9; 3])[0][1], 0.0);
    // No sample at all.
    assert_eq!(bounds([[f32::INFINITY, f32::NEG_INFINITY]; 3], [0.5; 3]), [[0.0; 2]; 4]);
}

#[test]
fn normal_equations_are_the_sums_over_all_pairs() {
    let mesh = textured(12, sines);
    let cloud = jittered(&mesh, 12, 1.42);
    let (kernels, samples, present, system) = system(&cloud, &mesh);
    let n = cloud.len();
    let (mut gram, mut b, mut ewa) = (vec![0.0; n * n], vec![0.0; n], vec![[0.0; 2]; n]);
    for sample in samples.all() {
        let (p, normal) = (samples.point(sample), samples.normal(sample));
        let w: Vec<f64> = (0..n).map(|k| kernels.get(k).weight(p, normal)).collect();
        let total: f64 = w.iter().sum();
        let weight = f64::from(sample.weight);
        let blend: f64 = (0..n).map(|k| w[k] / total * f64::from(present[k][0])).sum();
        for k in (0..n).filter(|k| w[*k] > 0.0) {
            b[k] += weight * w[k] / total * (f64::from(sample.value[0]) - blend);
            ewa[k][0] += weight * w[k] * f64::from(sample.value[0] - present[k][0]);
            ewa[k][1] += weight * w[k];
            (0..n).for_each(|j| gram[k * n + j] += weight * w[k] * w[j] / (total * total));
        }
    }
    let scale = gram.iter().copied().fold(0.0, f64::max);
    for k in 0..n {
        let mut row = vec![0.0; n];
        for entry in system.gram.starts[k]..system.gram.starts[k + 1] {
            row[system.gram.columns[entry] as usize] = f64::from(system.gram.values[entry]);
        }
        for j in 0..n {
            // Entries are f32.
            assert!((row[j] - gram[k * n + j]).abs() <= 1e-7 * scale, "{k} {j}: {} {}", row[j], gram[k * n + j]);
        }
        assert!((system.b[k][0] - b[k]).abs() < 1e-6 * scale, "{k}: {} {}", system.b[k][0], b[k]);
        assert!((system.ewa[k][0] - ewa[k][0] / ewa[k][1]).abs() < 1e-6);
    }
}

/// Solves a dense symmetric positive definite system by Cholesky's decomposition, and checks the residual.
fn dense(n: usize, gram: impl Fn(usize, usize) -> f64, b: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut lower = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in 0..=i {
            let rest = gram(i, j) - (0..j).map(|k| lower[i][k] * lower[j][k]).sum::<f64>();
            lower[i][j] = if i == j { rest.sqrt() } else { rest / lower[j][j] };
        }
    }
    let mut x: Vec<f64> = (0..n).map(b).collect();
    let right = x.clone();
    for i in 0..n {
        x[i] = (x[i] - (0..i).map(|k| lower[i][k] * x[k]).sum::<f64>()) / lower[i][i];
    }
    for i in (0..n).rev() {
        x[i] = (x[i] - (i + 1..n).map(|k| lower[k][i] * x[k]).sum::<f64>()) / lower[i][i];
    }
    for (i, right) in right.iter().enumerate() {
        let residual = (0..n).map(|k| gram(i, k) * x[k]).sum::<f64>() - right;
        assert!(residual.abs() <= 1e-12 * (1.0 + right.abs()), "row {i} of the dense solver: {residual:e}");
    }
    x
}

#[test]
fn without_bounds_the_solution_is_that_of_a_dense_solver() {
    for radius in [1.0, 1.42] {
        let mesh = textured(20, checker);
        let (_, _, present, system) = system(&jittered(&mesh, 20, radius), &mesh);
        let n = system.b.len();
        let mut gram = vec![0.0; n * n];
        for k in 0..n {
            for entry in system.gram.starts[k]..system.gram.starts[k + 1] {
                gram[k * n + system.gram.columns[entry] as usize] = f64::from(system.gram.values[entry]);
            }
        }
        let want = dense(n, |i, j| gram[i * n + j], |k| system.b[k][0]);
        let free = |_: usize| [[f64::MIN, f64::MAX]; 4];
        let problem = Problem { gram: &system.gram, b: &system.lanes::<f64>(0), bounds: &free };
        let found = problem.minimise(Stop { residual: 1e-11, steps: 20_000 }, &mut |_| true);
        let error = found.d.iter().zip(&want).map(|(d, want)| (d[0] - want).abs()).fold(0.0, f64::max);
        // A step of 1e-11 times the condition number, about 600.
        assert!(error < 1e-6, "{radius}: {error:e} after {} steps", found.steps);
        // Such values aren't colours: this is why the product's fit has bounds.
        let values = present.iter().zip(&want).map(|(c, d)| f64::from(c[0]) + d);
        assert!(values.clone().any(|c| c < -0.1) && values.clone().any(|c| c > 1.1), "{radius}");
    }
}

/// Solves Z01's eq. 10 and 11 as printed, for the record: with weights that aren't normalised, and without bounds.
#[test]
fn the_papers_own_basis_draws_worse_than_the_one_that_is_drawn() {
    let (side, radius) = (20, 1.42);
    let mesh = textured(side, sines);
    let cloud = jittered(&mesh, side, radius);
    let (kernels, samples, _, _) = system(&cloud, &mesh);
    let n = cloud.len();
    let solve = |share: &dyn Fn(f64, f64) -> f64| {
        let (mut gram, mut b) = (vec![0.0; n * n], vec![0.0; n]);
        for sample in samples.all() {
            let (p, normal) = (samples.point(sample), samples.normal(sample));
            let w: Vec<f64> = (0..n).map(|k| kernels.get(k).weight(p, normal)).collect();
            let total: f64 = w.iter().sum();
            for k in (0..n).filter(|k| w[*k] > 0.0) {
                b[k] += share(w[k], total) * f64::from(sample.value[0]);
                (0..n).for_each(|j| gram[k * n + j] += share(w[k], total) * share(w[j], total));
            }
        }
        let by_slot = dense(n, |i, j| gram[i * n + j], |k| b[k]);
        let mut values = vec![0.0; n];
        (0..n).for_each(|slot| values[kernels.tree.index(slot)] = by_slot[slot]);
        values
    };
    let normalised = solve(&|w, total| w / total);
    let raw = solve(&|w, _| w);
    // Raw values are fractions of the colour; dividing by the mean Σw makes them colours.
    let sums = samples.all().iter().map(|s| {
        let (p, normal) = (samples.point(s), samples.normal(s));
        (0..n).map(|k| kernels.get(k).weight(p, normal)).sum::<f64>()
    });
    let mean = sums.sum::<f64>() / samples.len() as f64;
    let drawn = |values: &[f64], scale: f64| rmse(&cloud, &|i| values[i] * scale, &mesh, side);
    let (point, ours, papers) = (rmse(&cloud, &red(&cloud), &mesh, side), drawn(&normalised, 1.0), drawn(&raw, mean));
    let widest = |values: &[f64], scale: f64| {
        let scaled = values.iter().map(|v| v * scale);
        (scaled.clone().fold(f64::MAX, f64::min), scaled.fold(f64::MIN, f64::max))
    };
    println!(
        "point {point:.4}, shares {ours:.4} {:?}, raw {papers:.4} {:?}",
        widest(&normalised, 1.0),
        widest(&raw, mean)
    );
    assert!(ours < point && ours < 0.5 * papers, "{point} {ours} {papers}");
}

#[test]
fn fits_are_the_same_to_the_bit_for_any_number_of_threads() {
    // More splats than one task of the solver.
    let mesh = textured(80, sines);
    let cloud = jittered(&mesh, 80, 1.65);
    let mut points = cloud.clone().into_data();
    points.colors.as_mut().unwrap().iter_mut().enumerate().for_each(|(i, c)| c[i % 3] *= 0.9);
    let points = SplatCloud::new(points, OnInvalid::Refuse).unwrap().0;
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (of_mesh, report) = fitted(&cloud, &mesh, TextureSampling::Fit);
            let (of_points, points_report) = fit_point_colors(points.clone(), &NoProgress).unwrap();
            (of_mesh.into_data().colors, report, of_points.into_data().colors, points_report)
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(5));
    assert!(one.1.steps > 1 && one.3.steps.is_some(), "{:?} {:?}", one.1, one.3);
}

#[test]
fn a_surface_of_one_colour_gets_it_exactly() {
    for value in [0.0, 0.3, 0.731, 1.0] {
        let mesh = textured(20, |_, _| value);
        let cloud = jittered(&mesh, 20, 1.65);
        for sampling in [TextureSampling::Ewa, TextureSampling::Fit] {
            let (fit, report) = fitted(&cloud, &mesh, sampling);
            assert_eq!(fit.data().colors, cloud.data().colors, "{value} {report:?}");
        }
    }
    // A cube with one colour per face: neighbours across an edge are turned by 90°, and have no weight.
    let mut mesh = Mesh::default();
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
    for side in 0..6 {
        let (axis, sign) = (side / 2, if side % 2 == 0 { 1.0 } else { -1.0 });
        let corner = |a: f32, b: f32| {
            let mut p = [0.0; 3];
            (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (sign, a * sign, b);
            Vec3::from(p)
        };
        let first = positions.len() as u32;
        positions.extend([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        colors.extend([[side as f32 / 5.0, 0.25, 1.0 - side as f32 / 8.0]; 4]);
    }
    (mesh.positions, mesh.colors) = (Column3::from_f32(positions), Some(colors));
    for method in [crate::MeshMethod::Count(700), crate::MeshMethod::PerFace] {
        let (cloud, _) = crate::splats_from_mesh(&mesh, &crate::MeshOptions::new(method), &NoProgress).unwrap();
        let (fit, report) = fitted(&cloud, &mesh, TextureSampling::Fit);
        assert!(report.samples > 100);
        assert_eq!(fit.data().colors, cloud.data().colors, "{method:?} {report:?}");
    }
}

#[test]
fn the_two_sides_of_a_sheet_do_not_mix_and_clips_divide() {
    // Two disks, the left one clipped to x ≤ 0, over a step of the texture at x = 3.
    let mesh = textured(6, |x, _| f64::from(x > 3.0));
    let (s, t) = ([3.0, 0.0, 0.0], [0.0, 3.0, 0.0]);
    let line = |a: f32| {
        [
            surfel_model::ClipLine { a, b: 0.0, c: 0.0 },
            surfel_model::NO_LINE,
            surfel_model::NO_LINE,
            surfel_model::NO_LINE,
        ]
    };
    let cloud = SplatCloud::ellipses(&[[3.0, 3.0, 0.0]; 2], &[s; 2], &[t; 2]).unwrap();
    let clips = surfel_model::ClipColumns { lines: Some(vec![line(-1.0), line(1.0)]), ..Default::default() };
    let cloud = cloud.with_clips(clips).unwrap().with_colors(&[[0.5; 3]; 2]).unwrap();
    let (fit, _) = fitted(&cloud, &mesh, TextureSampling::Fit);
    // The step is a texel wide, an eighteenth of each half; there are 36 samples per splat.
    assert!(fit.color(0)[0] < 0.15 && fit.color(1)[0] > 0.85, "{:?}", fit.data().colors);
    // If the splats face away from the surface, none shows it.
    let away = CloudData { clips: None, ..cloud.into_data() };
    let flipped = SplatCloud::ellipses(&[[3.0, 3.0, 0.0]; 2], &[t; 2], &[s; 2]).unwrap();
    let away = SplatCloud::new(CloudData { shape: flipped.into_data().shape, ..away }, OnInvalid::Refuse).unwrap().0;
    assert_eq!(fitted(&away, &mesh, TextureSampling::Fit).0, away);
}

#[test]
fn normals_blend_to_those_of_the_surface() {
    // A ball of 2×14×28 triangles with its exact normals, and splats as large as the triangles.
    let (rows, columns) = (14, 28);
    let at = |i: usize, j: usize| {
        let (polar, turn) =
            (std::f64::consts::PI * i as f64 / rows as f64, std::f64::consts::TAU * j as f64 / columns as f64);
        DVec3::new(polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()).as_vec3()
    };
    let vertices: Vec<Vec3> = (0..=rows).flat_map(|i| (0..columns).map(move |j| at(i, j))).collect();
    let index = |i: usize, j: usize| (i * columns + j % columns) as u32;
    let quads = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j)));
    let triangles = quads.flat_map(|(i, j)| {
        [[index(i, j), index(i + 1, j), index(i + 1, j + 1)], [index(i, j), index(i + 1, j + 1), index(i, j + 1)]]
    });
    let normals = vertices.iter().map(Vec3::to_array).collect();
    let mesh = Mesh {
        triangles: triangles.collect(),
        positions: Column3::from_f32(vertices),
        normals: Some(normals),
        ..Mesh::default()
    };
    let (cloud, _) =
        crate::splats_from_mesh(&mesh, &crate::MeshOptions::new(crate::MeshMethod::Count(400)), &NoProgress).unwrap();
    let (fit, report) = fitted(&cloud, &mesh, TextureSampling::Fit);
    let [before, after] = report.normal_rms.unwrap();
    assert!(after < 0.6 * before && report.color_rms == [0.0; 2], "{report:?}");
    // Each component changes by 0.25 at most.
    let turned = |i: usize| fit.shading_normal(i).dot(cloud.shading_normal(i)).acos().to_degrees();
    let most = (0..fit.len()).map(turned).fold(0.0, f64::max);
    println!("{report:?}, turned by {most} degrees at most");
    assert!(most < 26.0, "{most}");
    // Means under the kernel would be no better than the samples: only the fit changes normals.
    let (ewa, _) = fitted(&cloud, &mesh, TextureSampling::Ewa);
    assert_eq!(ewa.data().shading_normals, cloud.data().shading_normals);
}

#[test]
fn colours_of_points_are_passed_through_as_far_as_they_are_not_noise() {
    let side = 60;
    let mesh = textured(side, sines);
    let clean = jittered(&mesh, side, 1.65);
    let mut random = Random::new(3);
    for (noise, least_gain) in [(0.0, 2.0), (0.05, 1.3), (1.0, 1.0)] {
        // Uniform noise of this standard deviation; the strongest hides everything else.
        let mut noisy = || ((random.unit() - 0.5) * noise * 12f64.sqrt()) as f32;
        let colors: Vec<[f32; 3]> =
            clean.data().colors.iter().flatten().map(|c| c.map(|c| (c + noisy()).clamp(0.0, 1.0))).collect();
        let cloud = clean.clone().with_colors(&colors).unwrap();
        let (fit, report) = fit_point_colors(cloud.clone(), &NoProgress).unwrap();
        let [before, after] = [&cloud, &fit].map(|c| rmse(c, &red(c), &mesh, side));
        println!("noise {noise}: {report:?}, truth {before:.4} to {after:.4}");
        assert!(report.held_out_rms[1] <= report.held_out_rms[0], "{report:?}");
        assert!(before / after >= least_gain, "noise {noise}: {before} to {after}, {report:?}");
    }
}

#[test]
fn what_cannot_be_fitted_is_left_alone_or_refused() {
    let mesh = textured(10, sines);
    let cloud = jittered(&mesh, 10, 1.42);
    let plain = Mesh { texture: None, uvs: None, ..mesh.clone() };
    assert_eq!(fitted(&cloud, &plain, TextureSampling::Fit).0, cloud);
    assert_eq!(fitted(&cloud, &mesh, TextureSampling::Point).0, cloud);
    let refused = |mesh: &Mesh| fit_to_mesh(cloud.clone(), mesh, TextureSampling::Fit, &NoProgress).is_err();
    assert!(refused(&Mesh { triangles: Vec::new(), ..mesh.clone() }));
    assert!(refused(&Mesh { triangles: vec![[0, 1, 9]], ..mesh.clone() }));
    assert!(refused(&Mesh { triangles: vec![[0, 1, 1]], ..mesh.clone() }));
    // Far from the mesh, and of vanishing or huge size.
    for (scale, move_by) in [(1.0, 1e6), (1e-18, 0.0), (1e12, 0.0)] {
        let moved = cloud.clone().with_origin([move_by, 0.0, 0.0]).unwrap();
        let mut data = moved.into_data();
        let surfel_model::Shape::Disks { radii, .. } = &mut data.shape else { panic!("disks") };
        radii.iter_mut().for_each(|r| *r *= scale);
        let odd = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
        let (fit, report) = fitted(&odd, &mesh, TextureSampling::Fit);
        assert!(fit.data().colors.iter().flatten().flatten().all(|c| c.is_finite()), "{report:?}");
    }
    // With every splat over every other, the equations would not be sparse.
    let mut data = jittered(&textured(20, sines), 20, 100.0).into_data();
    data.origin = DVec3::ZERO;
    let piled = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    let errors = [
        fit_to_mesh(piled.clone(), &textured(20, sines), TextureSampling::Fit, &NoProgress).unwrap_err().to_string(),
        fit_point_colors(piled, &NoProgress).unwrap_err().to_string(),
    ];
    assert!(errors.iter().all(|e| e.contains("expected at most 200")), "{errors:?}");
    let few = jittered(&mesh, 3, 1.0);
    assert_eq!(fit_point_colors(few.clone(), &NoProgress).unwrap().0, few);
}

#[test]
fn shares_at_a_place_sum_to_one() {
    let mesh = textured(12, sines);
    let (kernels, samples, _, _) = system(&jittered(&mesh, 12, 1.42), &mesh);
    for sample in samples.all() {
        let shares = shares_at(&kernels, &samples, sample);
        assert!((shares.iter().map(|(_, w)| w).sum::<f64>() - 1.0).abs() < 1e-12 || shares.is_empty());
    }
}

/// Returns the RMSE of the blend of a cloud's colours relative to the mesh's colours, in the first channel.
fn missing(cloud: &SplatCloud, mesh: &Mesh) -> f64 {
    let (_, _, _, system) = system(cloud, mesh);
    system.rms()[0]
}

#[test]
fn every_level_of_an_octree_is_nearer_to_the_mesh() {
    // Waves with a period of 20 units, and a step that no level resolves.
    let mesh = textured(60, |x, y| 0.5 + 0.2 * ((x * 0.314).sin() + (y * 0.314).sin()) + 0.1 * f64::from(x > 31.0));
    let mut divided = mesh.clone();
    let (mut positions, mut uvs) = (Vec::new(), Vec::new());
    divided.triangles.clear();
    for i in 0..16_u32 * 16 {
        let at = |k: u32, of: u32| (i / of % 16 + k) as f32 / 16.0;
        let first = positions.len() as u32;
        for [u, v] in [[at(0, 1), at(0, 16)], [at(1, 1), at(0, 16)], [at(1, 1), at(1, 16)], [at(0, 1), at(1, 16)]] {
            positions.push(Vec3::new(60.0 * u, 60.0 * v, 0.0));
            uvs.push([u, v]);
        }
        divided.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    (divided.positions, divided.uvs) = (Column3::from_f32(positions), Some(uvs));
    let octree = |texture: TextureSampling| {
        let options = crate::OctreeOptions { leaf_triangles: 40, splats_per_side: 12, texture };
        crate::octree_from_mesh(&divided, &options, &NoProgress).unwrap()
    };
    let (point, fit) = (octree(TextureSampling::Point), octree(TextureSampling::Fit));
    assert_eq!(point.nodes(), fit.nodes());
    let mut first = 0;
    let mut levels = 0;
    while first < point.nodes().len() {
        // Nodes of a level are consecutive, and end where their first child begins.
        let end = point.nodes()[first..].iter().map(|n| n.children.start as usize).find(|c| *c > first);
        let end = end.unwrap_or(point.nodes().len());
        let nodes = &point.nodes()[first..end];
        let mut ranges: Vec<_> = nodes.iter().map(|n| n.splats.clone()).collect();
        if nodes.iter().all(OctreeNode::is_leaf) {
            // Splats drawn in place of the leaves' splats along their edges.
            ranges.extend(point.transitions().iter().map(|t| t.splats.clone()));
        }
        let [before, after] = [&point, &fit].map(|o| missing(&o.cloud_of(&ranges).unwrap(), &mesh));
        println!("level {levels}: {before:.4} to {after:.4}");
        assert!(after < before, "level {levels}: {before} to {after}");
        (first, levels) = (end, levels + 1);
    }
    assert!(levels >= 3);
}
