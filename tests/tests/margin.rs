//! The reference's margin plane: what rounding could flip is marked, and little else.

use glam::DVec3;
use surfel_conformance::harness::reference_frame;
use surfel_conformance::scenes::{self, Case};
use surfel_model::Light;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Renderer, View};

fn margin(case: &Case) -> Vec<f32> {
    reference_frame(&mut Reference::new(0).unwrap(), case).unwrap().margin
}

/// A facing plane under a light at this n·l, shining from the right.
fn at_terminator(cosine: f64, specular: f64) -> Case {
    let mut case = scenes::facing_plane();
    case.scene.objects[0].material.specular = specular;
    let direction = [-1.0, 0.0, -cosine];
    case.scene.lights = Some(vec![Light::Directional { direction, color: [1.0; 3], shadow: false }]);
    case
}

#[test]
fn margin_holds_highlights_at_the_terminator() {
    let splats_alone = margin(&at_terminator(0.0, 0.0));
    let inner = |m: &[f32], x: std::ops::Range<usize>| {
        let pixels = (2..46).flat_map(move |y| x.clone().map(move |x| y * 48 + x));
        let pixels: Vec<usize> = pixels.filter(|i| splats_alone[*i] == 0.0).collect();
        assert!(pixels.len() > 700);
        (pixels.iter().filter(|i| m[**i] != 0.0).count(), pixels.len())
    };
    for cosine in [5e-5, 0.0, -5e-5] {
        let m = margin(&at_terminator(cosine, 0.5));
        let (marked, all) = inner(&m, 26..46);
        assert_eq!(marked, all, "r·v > 0 on the right: the highlight comes and goes at {cosine}");
        // r·v < 0 on the left: there is no highlight.
        assert_eq!(inner(&m, 2..22).0, 0, "{cosine}");
        assert_eq!(inner(&margin(&at_terminator(cosine, 0.0)), 2..46).0, 0, "nothing jumps without a highlight");
    }
    for cosine in [2e-4, -2e-4] {
        assert_eq!(inner(&margin(&at_terminator(cosine, 0.5)), 2..46).0, 0, "{cosine}");
    }
}

/// Edge antialiasing decides more, so it marks at least what a picture without it marks.
#[test]
fn margin_of_edges_adds_to_that_of_fragments_and_stays_small() {
    let with = scenes::sphere_before_plane();
    let without = with.with("off", |s| s.edge_aa = false);
    let (a, b) = (margin(&with), margin(&without));
    assert!(a.iter().zip(&b).all(|(a, b)| a >= b));
    let share = a.iter().sum::<f32>() / a.len() as f32;
    assert!(share < 0.02, "{share}");
}

/// Whatever a third of the margin can flip is marked: seen from that little beside, no scene's pixel jumps that isn't.
#[test]
fn margin_holds_all_that_a_third_of_it_flips() {
    let shifts: [fn(&mut View); 4] = [
        |v| v.projection.principal_px = v.projection.principal_px.map(|c| c + 3e-4),
        |v| v.projection.principal_px = v.projection.principal_px.map(|c| c - 3e-4),
        |v| v.projection.focal_px = v.projection.focal_px.map(|f| f * (1.0 - 3e-6)),
        |v| v.eye += DVec3::new(0.7, -0.5, 0.6) * (1e-6 * v.projection.near.max(1e-6)),
    ];
    let mut reference = Reference::new(0).unwrap();
    let (mut jumps, mut marked) = (Vec::new(), 0);
    for case in scenes::all() {
        let want = reference_frame(&mut reference, &case).unwrap();
        let resident = reference.upload(&case.scene).unwrap();
        for (i, shift) in shifts.into_iter().enumerate() {
            let mut view = case.view();
            shift(&mut view);
            let mut got = Frame::default();
            reference.render(&resident, &view, &case.settings, Planes::ALL, &mut got).unwrap();
            for at in 0..want.color.len() {
                // What doesn't jump moves by less: colours change by under 40 a pixel, depths by under 100 times themselves.
                let color = got.color[at].iter().zip(want.color[at]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                let depth = (got.depth[at] - want.depth[at]).abs() / want.depth[at].abs().min(f32::MAX);
                if color > 0.012 || depth > 0.03 {
                    match want.margin[at] == 0.0 {
                        true => jumps.push((case.name.clone(), i, at, color, depth)),
                        false => marked += 1,
                    }
                }
            }
        }
    }
    println!("{marked} pixels jumped, all marked but {}", jumps.len());
    assert!(jumps.is_empty(), "{} of {}: {jumps:#?}", jumps.len(), jumps.len() + marked);
    assert!(marked > 150, "{marked}");
}
