//! What a scene's features cost, by the plan and by the clock: each added alone to the plainest scene there is. Cost follows
//! content, so a setting whose feature a scene lacks must plan the plain frame.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use surfel::model::{
    ClipColumns, ClipLine, ClipMode, Column3, Geometry, Mesh, ModelError, NO_LINE, Object, OnInvalid, Shader, Shape,
    Transparency,
};
use surfel::render::{Attributes, Capabilities, Feature, FramePlan, Pass, SceneSummary, plan};
use surfel::{Camera, Frame, Light, Material, Planes, Renderer, Scene, Settings, SplatCloud, View};
use surfel_plot::Table;

use super::measure::Backends;
use crate::machine::busy_ms;
use crate::{Failure, clouds};

/// A backend that draws everything, so that all can be planned.
const EVERYTHING: Capabilities = Capabilities {
    backend: "plan",
    features: &[
        Feature::EdgeAntialiasing,
        Feature::Clips,
        Feature::Meshes,
        Feature::Peel,
        Feature::ABuffer,
        Feature::Shadows,
        Feature::Toon,
    ],
};

/// The plain scene with one feature.
struct Case {
    name: &'static str,
    scene: Scene,
    settings: Settings,
    planes: Planes,
    quantised: bool,
    /// The settings (and planes) ask for what only a scene can have: without it the plan is the plain one.
    idle: bool,
}

fn cloud(change: impl FnOnce(&mut surfel::model::CloudData)) -> Result<SplatCloud, Failure> {
    let mut data = clouds::ball(40_000)?.into_data();
    data.colors = None;
    data.interior_weight = Some(3.0);
    change(&mut data);
    Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
}

fn scene(cloud: SplatCloud) -> Scene {
    let geometry = Geometry::Splats(Arc::new(cloud));
    let object = Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() };
    Scene { objects: vec![object], ..Scene::default() }
}

/// The same splats as ellipses, so that they can be clipped.
fn ellipses(data: &mut surfel::model::CloudData) {
    if let Shape::Disks { normals, radii } = &data.shape {
        let axes = |i: usize| {
            let (s, t) = surfel::math::basis::orthonormal(normals.get(i));
            (s * f64::from(radii[i]), t * f64::from(radii[i]))
        };
        let (s, t): (Vec<DVec3>, Vec<DVec3>) = (0..radii.len()).map(axes).unzip();
        let column = |v: &[DVec3]| Column3::from_f32(v.iter().map(|v| v.as_vec3()).collect());
        data.shape = Shape::Ellipses { s: column(&s), t: column(&t) };
    }
}

fn clip(data: &mut surfel::model::CloudData) {
    ellipses(data);
    let n = data.centers.len();
    let line = ClipLine { a: 1.0, b: 0.3, c: 0.6 };
    data.clips = Some(ClipColumns {
        curves: None,
        lines: Some(vec![[line, NO_LINE, NO_LINE, NO_LINE]; n]),
        modes: Some(vec![ClipMode::And; n]),
    });
}

fn cases() -> Result<Vec<Case>, Failure> {
    let plain = || cloud(|_| ()).map(scene);
    let phong = Settings { shader: Shader::Phong, ..Settings::default() };
    let case =
        |name, scene, settings| Case { name, scene, settings, planes: Planes::COLOR, quantised: false, idle: false };
    let peel = Settings { transparency: Transparency::Peel { layers: 4, drop_last: false }, ..Settings::default() };
    let mut lit = plain()?;
    lit.lights = Some(vec![Light::Directional { direction: [-1.0, -1.0, -1.0], color: [1.0; 3], shadow: true }]);
    let mut materials = plain()?;
    let shiny = Object { material: Material { specular: 0.8, ..Material::default() }, ..materials.objects[0].clone() };
    materials.objects.push(Object { world_from_object: DAffine3::from_translation(DVec3::X * 50.0), ..shiny });
    let mut meshes = plain()?;
    meshes.objects.push(quad()?);
    let colors = |data: &mut surfel::model::CloudData| data.colors = Some(vec![[0.5, 0.6, 0.7]; data.centers.len()]);
    let alphas = |data: &mut surfel::model::CloudData| data.alphas = Some(vec![0.5; data.centers.len()]);
    let idle = |name, settings| plain().map(|scene| Case { idle: true, ..case(name, scene, settings) });
    Ok(vec![
        case("nothing: white disks, unlit", plain()?, Settings::default()),
        idle("settings for what isn't there: clip exact, peel:4", peel)?,
        case("colours", scene(cloud(colors)?), Settings::default()),
        case("light (phong)", plain()?, phong),
        case("light, objects of different material", materials, phong),
        case("light that casts a shadow", lit, phong),
        case("toon", plain()?, Settings { shader: Shader::Toon, ..phong }),
        case("ellipses", scene(cloud(ellipses)?), Settings::default()),
        case("ellipses clipped by a line", scene(cloud(clip)?), Settings::default()),
        case("antialiased edges", plain()?, Settings { edge_aa: true, ..Settings::default() }),
        case("a polygon mesh", meshes, Settings::default()),
        case("transparent splats, peel:4", scene(cloud(alphas)?), peel),
        Case { planes: Planes::ALL, ..case("depth, normal and weight planes", plain()?, Settings::default()) },
        Case { quantised: true, ..case("16-bit storage", plain()?, Settings::default()) },
    ])
}

fn quad() -> Result<Object, ModelError> {
    let corners = [[-2.0, -0.4, -2.0], [2.0, -0.4, -2.0], [2.0, -0.4, 2.0], [-2.0, -0.4, 2.0]].map(Vec3::from);
    let mesh = Mesh {
        origin: DVec3::ZERO,
        positions: Column3::from_f32(corners.to_vec()),
        triangles: vec![[0, 2, 1], [0, 3, 2]],
        normals: None,
        colors: None,
        alphas: None,
        uvs: None,
        texture: None,
        up: None,
        comments: Vec::new(),
    };
    mesh.validate()?;
    let geometry = Geometry::Mesh(Arc::new(mesh));
    Ok(Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() })
}

fn planned(case: &Case, view: &View) -> Result<FramePlan, Failure> {
    Ok(plan(&SceneSummary::of(&case.scene), view, &case.settings, case.planes, &EVERYTHING)?)
}

/// Sums that the plan keeps for a pixel: Σw and what is accumulated.
fn sums(a: &Attributes) -> usize {
    let wide = [(a.color, 3), (a.normal, 3), (a.depth, 1), (a.material, 4), (a.coverage, 1), (a.alpha, 1)];
    1 + wide.iter().filter(|(has, _)| *has).map(|(_, n)| n).sum::<usize>()
}

/// Passes besides those that every frame has, with how many there are of each.
fn passes(plan: &FramePlan) -> String {
    let mut found: Vec<(Pass, usize)> = Vec::new();
    for pass in &plan.passes {
        match found.iter_mut().find(|(p, _)| p == pass) {
            Some((_, count)) => *count += 1,
            None => found.push((*pass, 1)),
        }
    }
    let name = |(pass, count): &(Pass, usize)| {
        if *count > 1 { format!("{count} {pass:?}") } else { format!("{pass:?}") }
    };
    found.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Draws and plans every case.
pub(crate) fn table(backends: &mut Backends, runs: usize, size: u32) -> Result<Table, Failure> {
    let camera = Camera {
        eye: [0.0, 0.3, 4.6],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: surfel::model::Projection::Perspective { fov_y_deg: 32.0 },
        near: 0.01,
        far: None,
        size: [size; 2],
    };
    let view = View::new(&camera)?;
    let cases = cases()?;
    let mut times: Vec<Vec<f64>> = vec![Vec::new(); cases.len()];
    let mut bytes: Vec<Option<f64>> = vec![None; cases.len()];
    let mut uploads = Vec::new();
    for case in &cases {
        let backend = if case.quantised { &mut backends.narrow } else { &mut backends.wide };
        uploads.push(backend.upload(&case.scene)?);
    }
    let mut frame = Frame::default();
    for round in 0..=runs {
        for (i, case) in cases.iter().enumerate() {
            let backend = if case.quantised { &mut backends.narrow } else { &mut backends.wide };
            let (clock, busy) = (std::time::Instant::now(), busy_ms());
            let Ok(stats) = backend.render(&uploads[i], &view, &case.settings, case.planes, &mut frame) else {
                continue;
            };
            let elapsed = clock.elapsed().as_secs_f64() * 1e3;
            let busy = busy_ms().zip(busy).map(|(end, start)| end - start).filter(|_| backends.on_processor);
            bytes[i] = Some(stats.bytes_per_splat);
            if round > 0 {
                times[i].push(busy.unwrap_or(elapsed));
            }
        }
    }
    let head = ["feature", "passes", "sums a pixel", "bytes a pixel", "bytes a splat", "ms", "over nothing"];
    let mut table = Table::new(&head);
    let base_plan = planned(&cases[0], &view)?;
    let base = super::measure::median(&times[0]);
    for (i, case) in cases.iter().enumerate() {
        let plan = planned(case, &view)?;
        if case.idle && plan != base_plan {
            return Err(format!("{}: the plan is not the plain one", case.name).into());
        }
        let ms = super::measure::median(&times[i]);
        let dash = || "-".to_owned();
        table.rows.push(vec![
            case.name.to_owned(),
            passes(&plan),
            sums(&plan.attributes).to_string(),
            (4 * sums(&plan.attributes)).to_string(),
            bytes[i].map_or_else(dash, |b| format!("{b:.1}")),
            ms.map_or_else(|| "not drawn yet".to_owned(), |ms| format!("{ms:.2}")),
            ms.zip(base).map_or_else(dash, |(ms, base)| format!("{:.2}×", ms / base)),
        ]);
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> View {
        let camera = Camera {
            eye: [0.0, 0.0, 4.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            projection: surfel::model::Projection::Perspective { fov_y_deg: 32.0 },
            near: 0.01,
            far: None,
            size: [8, 8],
        };
        View::new(&camera).unwrap()
    }

    #[test]
    fn feature_that_a_scene_lacks_is_planned_nowhere_and_each_that_it_has_is() {
        let cases = cases().unwrap();
        let plain = planned(&cases[0], &view()).unwrap();
        for case in &cases[1..] {
            let plan = planned(case, &view()).unwrap();
            // Shape and storage of splats are a backend's matter, not the plan's.
            let same = case.idle || case.quantised || case.name == "ellipses";
            assert_eq!(plan == plain, same, "{}", case.name);
        }
        assert_eq!(sums(&plain.attributes), 1);
    }
}
