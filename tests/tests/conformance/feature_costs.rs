//! Tests that a feature costs nothing where it is absent: no pass, sum, target or byte; and only its own where it is
//! present.

use crate::drawing::{counter, drawn_once};
use crate::validated_gpu;
use glam::DVec3;
use surfel_conformance::build::{Clipped, Splat, camera, clipped_cloud, object, scene, sphere, with_alpha};
use surfel_conformance::polygons::{mesh_object, quad};
use surfel_conformance::scenes::{self, Case};
use surfel_gpu::{Draw, GpuPath, Precision, Target, target_bytes};
use surfel_model::{
    ClipLine, ClipMode, ClipPolicy, Cull, EdgeAa, Geometry, Light, Matcap, Material, Settings, Shader, Transparency,
};
use surfel_render::{
    Capabilities, Feature, FramePlan, Pass, Planes, Renderer, SHADOW_MAP_SIDE, SceneSummary, Stats, plan,
};

/// Side of the image, one tile of the CPU backend.
const SIDE: u32 = 32;

type Change = fn(&mut Case);

/// A feature, and its allowed costs.
struct Row {
    name: &'static str,
    /// Function that changes the settings both of the case with the feature and of the case without it.
    before: fn(&mut Settings),
    /// Function that adds the feature to the scene.
    there: Change,
    /// Function that requests the feature in the settings.
    asked: fn(&mut Settings),
    /// True if requesting the feature must change nothing when the scene doesn't have it.
    is_of_the_scene: bool,
    /// Function that disables the feature in the settings; `None` if the settings can't disable it.
    unasked: Option<fn(&mut Settings)>,
    /// Passes that only this feature adds to a plan, in order.
    passes: &'static [Pass],
    /// Number of sums per pixel that the feature adds.
    sums: usize,
    /// GPU targets that only this feature adds.
    targets: &'static [Target],
    /// Bytes per pixel of GPU targets and layer composites, including shared ones; `None` if no GPU backend draws the
    /// feature.
    gpu_bytes: Option<u64>,
    /// Bytes per tile that the CPU backend stores for passes that read neighbours. `None` if it also stores records of
    /// other splats or triangles, whose size isn't checked.
    cpu_bytes: Option<u64>,
    /// Number of shadow maps that are drawn.
    maps: u64,
}

/// Bytes of a plane of a tile with four bytes per pixel.
const PLANE: u64 = 4 * (SIDE * SIDE) as u64;
/// Bytes of the flags of a tile's blocks.
const MARKS: u64 = 16;

const NOTHING: Row = Row {
    name: "",
    before: |_| (),
    there: |_| (),
    asked: |_| (),
    is_of_the_scene: false,
    unasked: None,
    passes: &[],
    sums: 0,
    targets: &[],
    gpu_bytes: Some(0),
    cpu_bytes: Some(0),
    maps: 0,
};

fn glass(case: &mut Case) {
    if let Geometry::Splats(cloud) = &case.scene.objects[0].geometry {
        case.scene.objects[0].geometry = Geometry::Splats(with_alpha((**cloud).clone(), |_| 0.5).into());
    }
}

fn pane(case: &mut Case) {
    case.scene.objects.push(mesh_object(quad(DVec3::ZERO, [DVec3::X * 1.5, DVec3::Y * 1.5], 1.0)));
}

fn balls(case: &mut Case) {
    case.scene.objects.push(object(scenes::ball_cloud(&[(DVec3::new(0.5, 0.5, 0.9), 0.3)], false, false)));
}

fn half(case: &mut Case) {
    let lines = [ClipLine { a: 1.0, b: 0.0, c: 0.0 }];
    let half = |splat| Clipped { splat, curve: None, lines: lines.to_vec(), mode: ClipMode::And };
    let clipped = clipped_cloud(&splats().into_iter().map(half).collect::<Vec<_>>());
    case.scene.objects[0].geometry = Geometry::Splats(clipped.into());
}

fn cast(case: &mut Case) {
    for light in case.scene.lights.iter_mut().flatten() {
        if let Light::Directional { shadow, .. } = light {
            *shadow = true;
        }
    }
}

fn phong(settings: &mut Settings) {
    settings.shader = Shader::Phong;
}

const ROWS: [Row; 12] = [
    Row {
        name: "antialiased edges",
        asked: |s| s.edge_aa = EdgeAa::Coverage,
        passes: &[Pass::EdgeAntialiasing],
        // The sum is coverage.
        sums: 1,
        targets: &[Target::EdgeThreshold, Target::EdgeBackgroundThreshold, Target::EdgeBackgroundColor],
        // The three targets have 4, 4 and 16 bytes, tolerances 8, and the coverage pass 16 and 8.
        gpu_bytes: Some(56),
        // Begin and reach of surfaces, the depth threshold, and coverage.
        cpu_bytes: Some(4 * PLANE + MARKS),
        ..NOTHING
    },
    Row {
        name: "edges by samples",
        asked: |s| s.edge_aa = EdgeAa::Samples,
        passes: &[Pass::EdgeSamples],
        targets: &[Target::Steps],
        // Steps and tolerances of thresholds have 8 bytes each. Samples are drawn into the image's own targets.
        gpu_bytes: Some(16),
        // Splats around the sampled pixels are set up once more.
        cpu_bytes: None,
        ..NOTHING
    },
    Row {
        name: "peeled layers",
        there: glass,
        asked: |s| s.transparency = Transparency::Peel { layers: 3, drop_last: false },
        is_of_the_scene: true,
        unasked: Some(|s| s.transparency = Transparency::Off),
        passes: &[Pass::PeelLayer, Pass::PeelLayer, Pass::RemainingLayer],
        // The sums are alpha and depth.
        sums: 2,
        // The layer's other targets are an A-buffer's, too.
        targets: &[Target::LayerCounts],
        // A layer's targets have 4, three times 16, and 8 bytes, the depth of opaque surfaces 16, layer composites 48.
        gpu_bytes: Some(60 + 16 + 48),
        cpu_bytes: None,
        ..NOTHING
    },
    Row {
        name: "an A-buffer",
        there: glass,
        asked: |s| s.transparency = Transparency::ABuffer { layers: 4 },
        is_of_the_scene: true,
        unasked: Some(|s| s.transparency = Transparency::Off),
        passes: &[Pass::ABuffer],
        // The sums are alpha, depth and coverage.
        sums: 3,
        targets: &[Target::LayerCoverage],
        // A layer's targets have 4 and four times 16 bytes, the depth of opaque surfaces 16, their coverage 24,
        // composites 48.
        gpu_bytes: Some(68 + 16 + 24 + 48),
        cpu_bytes: None,
        ..NOTHING
    },
    Row {
        name: "clips",
        there: half,
        unasked: Some(|s| s.clip = ClipPolicy::Off),
        // Forms of every clip, in separate records.
        cpu_bytes: None,
        ..NOTHING
    },
    Row {
        name: "polygons",
        there: pane,
        passes: &[Pass::Polygons],
        // The sum is coverage.
        sums: 1,
        targets: &[Target::PolygonDepth, Target::Polygons],
        // The two targets have 4 and 8 bytes, and the coverage pass 24.
        gpu_bytes: Some(12 + 24),
        cpu_bytes: None,
        ..NOTHING
    },
    Row {
        name: "balls",
        there: balls,
        passes: &[Pass::Balls],
        // The sum is depth.
        sums: 1,
        gpu_bytes: Some(16),
        cpu_bytes: None,
        ..NOTHING
    },
    Row {
        name: "shadows",
        before: phong,
        there: cast,
        unasked: Some(|s| s.shader = Shader::Unlit),
        passes: &[Pass::ShadowMap],
        // The sum is depth, from which a surface's position is computed.
        sums: 1,
        maps: 1,
        ..NOTHING
    },
    Row {
        name: "toon's outlines",
        before: phong,
        asked: |s| s.shader = Shader::Toon,
        passes: &[Pass::Outlines],
        // The sum is depth.
        sums: 1,
        // Depths, and depth limits of neighbours.
        cpu_bytes: Some(2 * PLANE + MARKS),
        ..NOTHING
    },
    Row {
        name: "eye-dome lighting",
        asked: |s| s.shader = Shader::Edl,
        passes: &[Pass::EyeDome],
        // The sum is depth.
        sums: 1,
        gpu_bytes: Some(16),
        cpu_bytes: Some(PLANE + MARKS),
        ..NOTHING
    },
    Row {
        name: "both sides of an oriented cloud",
        there: |case| case.scene.objects[0].material.oriented = Some(true),
        targets: &[Target::FacingDepth, Target::Facing],
        // The two targets have 4 bytes each.
        gpu_bytes: Some(8),
        ..NOTHING
    },
    Row {
        name: "a matcap",
        there: |case| case.scene.matcap = Some(Matcap::builtin()),
        asked: |s| s.shader = Shader::Matcap,
        unasked: Some(|s| s.shader = Shader::Unlit),
        // The sums are the three components of the normal.
        sums: 3,
        gpu_bytes: Some(16),
        ..NOTHING
    },
];

fn splats() -> Vec<Splat> {
    sphere(200, 1.2, 5)
}

/// Returns two hundred opaque splats under a light.
fn plain() -> Case {
    let mut scene = scene(&splats());
    scene.objects[0].material.interior_weight = Some(2.4);
    scene.lights = Some(vec![Light::Directional { direction: [-0.5, -1.0, -0.4], color: [1.0; 3], shadow: false }]);
    Case::new("plain", scene, camera(3.4, 45.0, [SIDE; 2]))
}

impl Row {
    /// Returns the case without the feature.
    fn absent(&self) -> Case {
        let mut case = plain();
        (self.before)(&mut case.settings);
        case
    }

    /// Returns the case with the feature.
    fn present(&self) -> Case {
        let mut case = self.absent();
        (self.there)(&mut case);
        (self.asked)(&mut case.settings);
        case
    }

    /// Returns pairs of cases that must have equal costs. The first case requests the feature without having it, or has
    /// it without requesting it. The second is the same without the feature.
    fn pairs(&self) -> Vec<[Case; 2]> {
        let mut pairs = Vec::new();
        if self.is_of_the_scene {
            let mut asked = self.absent();
            (self.asked)(&mut asked.settings);
            pairs.push([asked, self.absent()]);
        }
        if let Some(unasked) = self.unasked {
            let [mut with, mut without] = [self.present(), self.absent()];
            unasked(&mut with.settings);
            unasked(&mut without.settings);
            pairs.push([with, without]);
        }
        pairs
    }
}

fn planned(case: &Case) -> FramePlan {
    let everything = Capabilities::everything("plan");
    plan(&SceneSummary::of(&case.scene), &case.view(), &case.settings, Planes::COLOR, &everything).unwrap()
}

/// Returns the targets that a GPU draws for a plan: those that are as large as the image.
fn targets(plan: &FramePlan) -> Vec<Target> {
    let draws = Draw::of(plan);
    Target::ALL.into_iter().filter(|target| target.size(&draws, [SIDE; 2]) == [SIDE; 2]).collect()
}

fn bytes(plan: &FramePlan) -> u64 {
    target_bytes(&Draw::of(plan), [SIDE; 2], Precision::F32)
}

#[test]
fn feature_has_a_row_here_and_a_scene_that_backends_are_held_to() {
    let scenes = scenes::all();
    // The margin is a plane that callers request, and a sky is stored in splats before a backend gets the scene: no
    // scene has either.
    let in_scenes = |feature: &&Feature| !matches!(feature, Feature::Margin | Feature::Sky);
    for feature in Feature::ALL.iter().filter(in_scenes) {
        let without = Capabilities { backend: "test", lacks: std::slice::from_ref(feature) };
        assert!(scenes.iter().any(|case| !case.is_drawn_by(&without)), "no scene has {feature:?}");
        // Gaussians replace a surface's passes instead of adding to them: see `trained_gaussians`.
        if *feature == Feature::Gaussians {
            continue;
        }
        assert!(ROWS.iter().any(|row| !row.present().is_drawn_by(&without)), "no row has {feature:?}");
        assert!(ROWS.iter().all(|row| row.absent().is_drawn_by(&without)), "{feature:?} without being there");
    }
}

#[test]
fn feature_adds_its_own_passes_sums_and_targets_and_no_other() {
    for row in &ROWS {
        let (with, without) = (planned(&row.present()), planned(&row.absent()));
        let own = |pass: &&Pass| row.passes.contains(pass);
        assert!(with.passes.iter().filter(own).eq(row.passes), "{}: {:?}", row.name, with.passes);
        assert!(with.passes.iter().filter(|pass| !own(pass)).eq(&without.passes), "{}: {:?}", row.name, with.passes);
        assert_eq!(with.attributes.sums() - without.attributes.sums(), row.sums, "{}", row.name);
        assert_eq!(with.shadow_maps.len() as u64, row.maps, "{}", row.name);
        if let Some(a_pixel) = row.gpu_bytes {
            // A target that isn't needed has one pixel.
            let pixels = u64::from(SIDE * SIDE) - 1;
            assert_eq!(bytes(&with) - bytes(&without), a_pixel * pixels, "{}: {:?}", row.name, targets(&with));
            assert!(row.targets.iter().all(|target| targets(&with).contains(target)), "{}", row.name);
        }
    }
}

#[test]
fn feature_that_is_absent_is_in_no_plan() {
    let mut pairs = 0;
    for row in &ROWS {
        for [with, without] in row.pairs() {
            assert_eq!(planned(&with), planned(&without), "{}", row.name);
            pairs += 1;
        }
        for other in ROWS.iter().filter(|other| other.name != row.name) {
            let plan = planned(&other.present());
            assert!(!plan.passes.iter().any(|pass| row.passes.contains(pass)), "{} has {}", other.name, row.name);
            let targets = if other.gpu_bytes.is_some() { targets(&plan) } else { Vec::new() };
            assert!(!targets.iter().any(|target| row.targets.contains(target)), "{} has {}", other.name, row.name);
        }
    }
    assert_eq!(pairs, 7);
}

#[test]
fn facings_are_kept_apart_only_where_both_are_drawn() {
    let mut case = plain();
    let without = planned(&case);
    case.scene.objects[0].material.oriented = Some(true);
    assert!(planned(&case).keeps_facings && !without.keeps_facings);
    case.scene.objects[0].material.cull = Cull::Back;
    assert_eq!(planned(&case), without);
    // The material overrides the cloud.
    let Geometry::Splats(cloud) = &mut case.scene.objects[0].geometry else { panic!("splats") };
    std::sync::Arc::make_mut(cloud).set_oriented(true);
    case.scene.objects[0].material = Material { cull: Cull::None, oriented: None, ..case.scene.objects[0].material };
    assert!(planned(&case).keeps_facings);
    case.scene.objects[0].material.oriented = Some(false);
    assert_eq!(planned(&case), without);
}

/// Returns a counter of bytes; 0 if the backend doesn't have it.
fn counted_bytes(stats: &Stats, name: &str) -> u64 {
    counter(stats, name).unwrap_or(0.0) as u64
}

/// Bytes of a shadow map.
const MAP: u64 = 4 * (SHADOW_MAP_SIDE * SHADOW_MAP_SIDE) as u64;

#[test]
fn feature_that_is_absent_takes_no_memory_of_the_cpu() {
    // Each case has its own renderer, since memory is reused for the next frame.
    let drawn = |case: &Case| {
        drawn_once(
            &mut surfel_cpu::Renderer::new(surfel_cpu::Options::default().with_threads(1)).unwrap(),
            case,
            Planes::COLOR,
        )
        .1
    };
    let memory = |stats: &Stats| [counted_bytes(stats, "batch_bytes"), counted_bytes(stats, "shadow_bytes")];
    for row in &ROWS {
        let [with, without] = [row.present(), row.absent()].map(|case| memory(&drawn(&case)));
        match row.cpu_bytes {
            Some(bytes) => assert_eq!(with[0] - without[0], bytes, "{}", row.name),
            None => assert_ne!(with[0], without[0], "{}", row.name),
        }
        assert_eq!([with[1], without[1]], [row.maps * MAP, 0], "{}", row.name);
        for pair in row.pairs() {
            let [with, without] = pair.each_ref().map(drawn);
            assert_eq!(memory(&with), memory(&without), "{}", row.name);
        }
    }
}

fn takes_no_memory_of_the_gpu(renderer: &mut impl Renderer) {
    let mut drawn = |case: &Case| {
        let (_, stats) = drawn_once(renderer, case, Planes::COLOR);
        [counted_bytes(&stats, "target_bytes"), counted_bytes(&stats, "shadow_bytes")]
    };
    for row in ROWS.iter().filter(|row| row.gpu_bytes.is_some()) {
        for (case, maps) in [(row.present(), row.maps), (row.absent(), 0)] {
            // Sums of four bytes, or of two if the adapter can't blend four; an empty buffer has four bytes.
            let [targets, shadows] = drawn(&case);
            let draws = Draw::of(&planned(&case));
            let expected = [Precision::F32, Precision::F16].map(|sums| target_bytes(&draws, [SIDE; 2], sums));
            assert!(expected.contains(&targets) && shadows == (maps * MAP).max(4), "{}: {targets} {shadows}", row.name);
        }
        for pair in row.pairs() {
            let [with, without] = pair.each_ref().map(&mut drawn);
            assert_eq!(with, without, "{}", row.name);
        }
    }
}

#[test]
fn feature_that_is_absent_takes_no_memory_of_gpus() {
    if let Some(mut ash) = validated_gpu::ash_by(GpuPath::Raster) {
        takes_no_memory_of_the_gpu(&mut ash);
    }
    if let Some(mut wgpu) = validated_gpu::wgpu_by(GpuPath::Raster) {
        takes_no_memory_of_the_gpu(&mut wgpu);
        validated_gpu::no_messages();
    }
}
