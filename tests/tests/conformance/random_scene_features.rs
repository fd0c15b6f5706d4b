//! Tests of random scenes: their features, agreement of backends, and detection of faults.

use crate::faulty_renderer::{FAULTS, Faulty, KnownFault};
use crate::{scene_files, validated_gpu};
use std::collections::BTreeMap;
use surfel_conformance::harness::{Truth, Verdict, check, check_case, render};
use surfel_conformance::random_scenes::{MAX_SIDE_PX, MAX_SPLATS, case, shrink::shrink, store};
use surfel_conformance::scenes::Case;
use surfel_model::{Cull, EdgeAa, Geometry, Light, Mapping, Projection, Shader, Shape, Transparency};
use surfel_reference::Renderer as Reference;
use surfel_render::{Planes, Renderer};

fn splats(case: &Case) -> usize {
    let of = |geometry: &Geometry| if let Geometry::Splats(cloud) = geometry { cloud.len() } else { 0 };
    case.scene.objects.iter().map(|o| of(&o.geometry)).sum()
}

/// Compares every scene of these seeds with the reference.
fn agrees(mut renderer: impl Renderer, seeds: std::ops::Range<u64>, least_drawn: usize) {
    let mut reference = Reference::new(Default::default()).unwrap();
    let (mut drawn, mut failed) = (0, Vec::new());
    for seed in seeds {
        let report = check_case(&mut renderer, &mut reference, &case(seed));
        drawn += usize::from(!matches!(report.verdict, Verdict::Skipped(_)));
        if !report.is_ok() {
            failed.push(report.to_string());
        }
    }
    let again = "run `cargo xtask conformance --random 1 --seed S` for its scene file";
    assert!(failed.is_empty(), "{}\n{again}", failed.join("\n"));
    assert!(drawn >= least_drawn, "{drawn}");
}

#[test]
fn random_scenes_cpu_agrees_with_the_reference() {
    agrees(surfel_cpu::Renderer::new(Default::default()).unwrap(), 0..80, 80);
}

#[test]
#[ignore = "15 s on lavapipe with two cores: cargo xtask test --full"]
fn random_scenes_wgpu_agrees_with_the_reference() {
    if let Some(wgpu) = validated_gpu::wgpu() {
        agrees(wgpu, 200..220, 12);
        validated_gpu::no_messages();
    }
}

#[test]
fn random_scenes_ash_agrees_with_the_reference() {
    if let Some(ash) = validated_gpu::ash() {
        agrees(ash, 300..320, 12);
    }
}

#[test]
fn random_scenes_are_small_valid_and_the_same_again() {
    for seed in 0..400 {
        let case = case(seed);
        case.scene.validate().unwrap();
        case.settings.validate().unwrap();
        assert!(case.view().size.iter().all(|side| *side <= MAX_SIDE_PX));
        // A sheet has a whole number of rows.
        assert!(splats(&case) <= MAX_SPLATS + 3 * 15, "{seed}: {}", splats(&case));
    }
    let twice = [(); 2].map(|()| format!("{:?}", case(7)));
    assert_eq!(twice[0], twice[1]);
    assert_ne!(twice[0], format!("{:?}", case(8)));
}

/// Returns the names of the features that a case has.
fn features(case: &Case) -> Vec<String> {
    let s = &case.settings;
    let mut words = vec![
        s.filter.name().to_owned(),
        format!("{:?}", s.mapping),
        format!("{:?}", s.shader),
        format!("clip {:?}", s.clip),
        format!("edge_aa {}", s.edge_aa.name()),
        s.transparency.to_string().split(':').next().unwrap_or_default().to_owned(),
        format!("{:?}", case.camera.projection).split(' ').next().unwrap_or_default().to_owned(),
    ];
    let mut add = |is_so: bool, word: &str| words.extend(is_so.then(|| word.to_owned()));
    add(matches!(s.transparency, Transparency::Peel { drop_last: true, .. }), "drop");
    add(case.region.is_some(), "region");
    add(case.scene.lights.is_none(), "headlight");
    for light in case.scene.lights.iter().flatten() {
        add(light.casts_shadow() && matches!(s.shader, Shader::Phong | Shader::Toon), "shadow");
        add(matches!(light, Light::Directional { .. }), "directional");
        add(matches!(light, Light::Point { .. }), "point");
        add(matches!(light, Light::Spot { outer_deg, .. } if *outer_deg > 60.0), "wide spot");
    }
    for object in &case.scene.objects {
        add(object.world_from_object.matrix3.determinant() < 0.0, "mirrored");
        add(object.world_from_object.translation.length() > 1e3, "far");
        match &object.geometry {
            Geometry::Splats(cloud) => {
                let data = cloud.data();
                add(matches!(data.shape, Shape::Disks { .. }), "disks");
                add(data.alphas.is_some(), "alpha");
                add(data.shading_normals.is_some(), "shading normals");
                add(data.colors.is_none(), "colourless");
                let is_seen_through = object.material.cull == Cull::None;
                add(object.material.is_oriented(cloud) && is_seen_through, "both sides");
                add(data.clips.as_ref().is_some_and(|c| c.curves.is_some()), "clips");
            }
            Geometry::Octree(_) => add(true, "octree"),
            Geometry::Gaussians(_) => add(true, "gaussians"),
            Geometry::Mesh(mesh) => {
                add(true, "mesh");
                add(mesh.texture.is_some(), "texture");
            }
        }
    }
    words
}

#[test]
fn random_scenes_have_every_feature_and_pairs_of_them() {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut affine_edges = 0;
    for seed in 0..500 {
        let case = case(seed);
        let orthographic = matches!(case.camera.projection, Projection::Orthographic { .. });
        affine_edges += usize::from(
            case.settings.edge_aa == EdgeAa::Coverage && case.settings.mapping == Mapping::Affine && orthographic,
        );
        for word in features(&case) {
            *counts.entry(word).or_default() += 1;
        }
    }
    println!("{counts:?}");
    // 5 filters, 2 mappings, 7 shaders, 4 clip policies, edges or not, 3 transparencies, 3 projections, 17 others.
    assert_eq!(counts.len(), 5 + 2 + 7 + 4 + 2 + 3 + 3 + 17, "{:?}", counts.keys());
    assert!(counts.values().all(|&count| count >= 10) && affine_edges >= 5, "{counts:?} {affine_edges}");
}

#[test]
fn random_scenes_show_every_fault() {
    let mut reference = Reference::new(Default::default()).unwrap();
    let truths: Vec<Truth> = (0..96).map(|seed| Truth::of(&mut reference, case(seed))).collect();
    let mut unseen = Vec::new();
    // The parts of an octree are selected before there is a scene.
    for KnownFault { name: fault, make: change, .. } in FAULTS.into_iter().filter(|f| !f.scene.starts_with("octree")) {
        let mut faulty = Faulty::new();
        change(&mut faulty);
        let found = truths.iter().position(|truth| !check(&mut faulty, truth).report.is_ok());
        println!("{fault}: {found:?}");
        if found.is_none() {
            unseen.push(fault);
        }
    }
    assert_eq!(unseen, [""; 0]);
}

#[test]
fn random_scenes_that_fail_shrink_to_what_fails() {
    let mut reference = Reference::new(Default::default()).unwrap();
    let mut faulty = Faulty::new();
    faulty.settings = |s| s.cutoff *= 1.1;
    let mut fails = |case: &Case| !check_case(&mut faulty, &mut reference, case).is_ok();
    let whole = (0..).map(case).find(|case| splats(case) > 50 && fails(case)).unwrap();
    let smallest = shrink(&whole, &mut fails);
    assert!(fails(&smallest));
    // One splat is enough to show the kernel.
    assert_eq!(splats(&smallest), 1);
    assert_eq!(smallest.scene.objects.len(), 1);
}

#[test]
fn random_scenes_are_the_same_from_their_files() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("random");
    let folder = store::folder(&folder).unwrap();
    let mut reference = Reference::new(Default::default()).unwrap();
    for seed in 0..24 {
        let mut case = case(seed);
        case.region = None;
        let file = surfel_io::scene_file::read(&store::store(&case, folder).unwrap()).unwrap();
        let read = Case {
            name: case.name.clone(),
            scene: scene_files::scene(&file, folder),
            camera: file.camera,
            settings: file.settings,
            region: None,
        };
        // Splats have another origin, and JSON's numbers may differ by an ulp.
        let want = Truth::of(&mut reference, case);
        let got = render(&mut reference, &read, Planes::ALL).unwrap();
        let margin = &want.want.as_ref().unwrap().margin();
        let report = surfel_conformance::harness::compare_frames("", &got, want.want.as_ref().unwrap(), margin);
        assert!(report.is_ok() && report.planes.iter().all(|p| p.worst < 1e-2), "{seed}: {report}");
    }
}
