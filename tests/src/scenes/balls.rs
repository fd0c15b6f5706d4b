//! Scenes of balls and dots (rendering model §11).

use super::Case;
use crate::build::{Splat, camera, cloud, confetti, object, sheet, with_alpha};
use crate::polygons::{mesh_object, quad};
use crate::random::Random;
use glam::{DAffine3, DMat3, DVec3};
use surfel_model::{
    BallLight, Camera, CloudData, Column3, EdgeAa, Light, Object, OnInvalid, Projection, Scene, Shader, Shape,
    SplatCloud, Transparency,
};

pub(super) fn ball_cases() -> Vec<Case> {
    let (large, small, tiny, mixed) = (large_balls(), small_balls(), tiny_balls(), balls_among_others());
    let peel = Transparency::Peel { layers: 3, drop_last: false };
    let drop = Transparency::Peel { layers: 3, drop_last: true };
    let abuffer = Transparency::ABuffer { layers: 3 };
    let glass = balls_among_glass();
    let mut cases = vec![
        large.with("orthographic", |_| ()).in_orthographic(2.6, 9.0),
        small.with("orthographic", |_| ()).in_orthographic(2.6, 9.0),
        tiny.with("orthographic", |_| ()).in_orthographic(2.6, 9.0),
        small.with("intrinsics", |_| ()).in_intrinsics(),
        tiny.with("intrinsics", |_| ()).in_intrinsics(),
        small.with("abuffer-without-alphas", |s| s.transparency = abuffer),
        balls_in_pixels(false),
        balls_in_pixels(true),
        balls_in_pixels(true).with("intrinsics", |_| ()).in_intrinsics(),
        balls_in_pixels(false).with("orthographic", |_| ()).in_orthographic(2.6, 9.0),
        dots(),
        placed_balls(),
        balls_at_near_plane(),
        balls_at_near_plane().with("orthographic", |_| ()).in_orthographic(2.6, 3.4),
        glassy_balls(),
        glassy_balls().with("abuffer", |s| s.transparency = abuffer),
        mixed.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        mixed.sampled(),
        glass.with("peel", |s| s.transparency = peel),
        glass.with("drop", |s| s.transparency = drop),
        glass.with("abuffer", |s| s.transparency = abuffer),
        glass.with("edge-aa", |s| (s.transparency, s.edge_aa) = (peel, EdgeAa::Coverage)),
        glass.with("samples", |s| (s.transparency, s.edge_aa) = (abuffer, EdgeAa::Samples)),
        shadows_of_balls(1.0),
        shadows_of_balls(0.02),
        region_of_balls(),
        ball_beyond_the_view(),
        balls_with_stored_light(),
        balls_with_stored_light().sampled(),
    ];
    for shader in [Shader::Unlit, Shader::Normal, Shader::Depth, Shader::Matcap, Shader::Edl, Shader::Toon] {
        cases.push(small.with(&format!("{shader:?}").to_lowercase(), |s| s.shader = shader));
        cases.push(mixed.with(&format!("{shader:?}").to_lowercase(), |s| s.shader = shader));
    }
    cases.extend([large, small, tiny, mixed, glass]);
    cases
}

/// Creates a cloud of balls given by centres and radii, or of dots if `flat` is true, with random colours. Radii are in
/// pixels if `in_pixels` is true, otherwise in object units.
///
/// # Panics
/// If a ball is invalid: scenes are written in code, not read.
pub fn ball_cloud(balls: &[(DVec3, f64)], in_pixels: bool, flat: bool) -> SplatCloud {
    let mut random = Random::new(balls.len() as u64);
    let (origin, centers) = Column3::with_origin(&balls.iter().map(|b| b.0).collect::<Vec<_>>());
    let shape = Shape::Balls { radii: balls.iter().map(|b| b.1 as f32).collect(), in_pixels, flat };
    let mut data = CloudData::new(origin, centers, shape);
    data.colors = Some(balls.iter().map(|_| random.color()).collect());
    data.rows = Some((0..balls.len() as u32).rev().collect());
    data.labels = Some((0..balls.len() as u32).map(|i| i % 5).collect());
    SplatCloud::new(data, OnInvalid::Refuse).expect("scenes hold valid splats").0
}

/// Returns random points in the unit ball, with random radii between the two given ones.
fn points(count: usize, radii: [f64; 2], seed: u64) -> Vec<(DVec3, f64)> {
    let mut random = Random::new(seed);
    let point = |random: &mut Random| random.direction() * random.range(0.0, 1.0).cbrt();
    (0..count).map(|_| (point(&mut random), random.range(radii[0], radii[1]))).collect()
}

fn lit(name: &str, objects: Vec<Object>, camera: Camera) -> Case {
    let mut scene = Scene { background: [0.02, 0.03, 0.05, 0.5], ..Scene::default() };
    scene.objects = objects;
    scene.ambient = [0.1; 3];
    scene.lights = Some(vec![
        Light::Directional { direction: [0.4, -0.8, -0.5], color: [0.8, 0.7, 0.6], shadow: false },
        Light::Point { position: [-1.0, 2.0, 2.5], color: [0.2, 0.3, 0.4] },
    ]);
    let mut case = Case::new(name, scene, camera);
    case.settings.shader = Shader::Phong;
    case
}

/// Returns intersecting balls of up to half the width of a wide view. Catches wrong outlines and depths.
fn large_balls() -> Case {
    let balls = points(24, [0.1, 0.6], 5);
    lit("large_balls", vec![object(ball_cloud(&balls, false, false))], camera(2.2, 70.0, [96, 72]))
}

/// Returns a ball whose radius is 300 times its distance, so that it covers the whole view. Catches lost digits inside
/// a large outline.
fn ball_beyond_the_view() -> Case {
    let ball = ball_cloud(&[(DVec3::NEG_Z * 301.0, 300.0)], false, false);
    let view = Camera { target: [0.0, 0.0, -1.0], ..camera(0.0, 60.0, [24, 24]) };
    lit("ball_beyond_the_view", vec![object(ball)], view)
}

/// Returns a rotated object with stored light, and one without. Catches stored light that isn't shown, or is looked up
/// by a wrong normal.
fn balls_with_stored_light() -> Case {
    let mut random = Random::new(14);
    let balls = ball_cloud(&points(60, [0.05, 0.3], 12), false, false);
    let mut light = || {
        let mut light = BallLight::default();
        for _ in 0..6 {
            light.add(random.direction().as_vec3(), random.range(0.0, 0.4) as f32);
        }
        light
    };
    let data = CloudData { ball_light: Some((0..balls.len()).map(|_| light()).collect()), ..balls.into_data() };
    let mut turned = object(SplatCloud::new(data, OnInvalid::Refuse).expect("scenes hold valid splats").0);
    turned.world_from_object = DAffine3::from_rotation_x(0.7) * DAffine3::from_rotation_y(-0.4);
    let other = object(ball_cloud(&points(20, [0.05, 0.2], 13), false, false));
    // Edges by samples need a depth step, which balls alone don't have.
    let floor = object(cloud(&floor(0.7, -0.3)));
    let mut case = lit("balls_with_stored_light", vec![turned, other, floor], camera(2.4, 52.0, [80, 80]));
    case.scene.objects[2].material.interior_weight = Some(1.3);
    case.settings.shader = Shader::Unlit;
    case
}

/// Returns balls with diameters of 1 to 4 pixels. Catches wrong coverage where outlines are strongly curved.
fn small_balls() -> Case {
    let balls = points(500, [0.01, 0.05], 6);
    lit("small_balls", vec![object(ball_cloud(&balls, false, false))], camera(2.6, 52.0, [96, 96]))
}

/// Returns balls with diameters of 1/20 pixel to a pixel. Catches lost area.
fn tiny_balls() -> Case {
    let balls = points(2500, [0.001, 0.016], 7);
    lit("tiny_balls", vec![object(ball_cloud(&balls, false, false))], camera(2.6, 52.0, [72, 72]))
}

/// Returns balls or dots with radii in pixels. Catches radii that change with depth or with the size of a sample.
fn balls_in_pixels(flat: bool) -> Case {
    let balls = points(200, [0.4, 5.0], 8);
    let name = if flat { "dots_in_pixels" } else { "balls_in_pixels" };
    lit(name, vec![object(ball_cloud(&balls, true, flat))], camera(2.6, 52.0, [80, 64]))
}

/// Returns dots. Catches dots that aren't parallel to the image, or whose depth varies.
fn dots() -> Case {
    let balls = points(200, [0.02, 0.12], 9);
    lit("dots", vec![object(ball_cloud(&balls, false, true))], camera(2.6, 52.0, [80, 64]))
}

/// Returns balls of scaled objects, far from the origin. Catches a wrong scale of radii, and lost digits.
fn placed_balls() -> Case {
    let far = DVec3::new(4.0e5, -3.0e5, 2.0e4);
    let mut placed = object(ball_cloud(&points(150, [0.1, 0.3], 10), false, false));
    let turn = DMat3::from_rotation_y(0.4) * DMat3::from_diagonal(DVec3::new(0.5, -0.25, 0.3));
    placed.world_from_object = DAffine3 { matrix3: turn, translation: far };
    placed.material.shininess = 7.0;
    let mut other = object(ball_cloud(&points(60, [0.02, 0.06], 11), false, false));
    other.world_from_object = DAffine3::from_translation(far);
    let mut case = lit("placed_balls", vec![placed, other], camera(2.4, 50.0, [80, 80]));
    for side in [&mut case.camera.eye, &mut case.camera.target] {
        *side = (DVec3::from(*side) + far).to_array();
    }
    case.scene.lights = None;
    case
}

/// Returns balls at the near plane; an orthographic case has balls at the far plane, too. Catches balls that are drawn
/// although they reach z_near or lie beyond z_far.
fn balls_at_near_plane() -> Case {
    let balls: Vec<_> = points(120, [0.05, 0.3], 12).into_iter().map(|(p, r)| (p * 1.6, r)).collect();
    let mut case =
        lit("balls_at_near_plane", vec![object(ball_cloud(&balls, false, false))], camera(1.9, 60.0, [72, 72]));
    case.camera.near = 0.8;
    case
}

/// Returns balls with alpha. Catches alphas that are ignored, or that have an effect with `transparency: off`.
fn glassy_balls() -> Case {
    let cloud = ball_cloud(&points(120, [0.05, 0.25], 13), false, false);
    let cloud = with_alpha(cloud, |i| if i % 3 == 0 { 1.0 } else { 0.2 + 0.1 * (i % 7) as f32 });
    lit("glassy_balls", vec![object(cloud)], camera(2.6, 52.0, [80, 80]))
}

fn floor(size: f64, z: f64) -> Vec<Splat> {
    sheet(DVec3::new(0.0, 0.0, z), [DVec3::X * size, DVec3::Y * size], [24, 24], 0.14 * size, |i, j| {
        if (i / 3 + j / 3) % 2 == 0 { [0.7, 0.6, 0.5] } else { [0.2, 0.3, 0.5] }
    })
}

/// Returns balls among splats and polygons. Catches a wrong order of the three, also behind edges.
fn balls_among_others() -> Case {
    let balls = ball_cloud(&points(60, [0.03, 0.2], 14), false, false);
    let splats = confetti(40, 0.12, 2.0, 15).into_iter().map(|s| Splat { p: s.p * 0.8, ..s }).collect::<Vec<_>>();
    let splats: Vec<Splat> = splats.into_iter().chain(floor(0.7, -0.3)).collect();
    let mut case = lit("balls_among_others", vec![object(cloud(&splats)), object(balls)], camera(2.6, 52.0, [80, 80]));
    case.scene.objects[0].material.interior_weight = Some(1.3);
    case.scene.objects.push(mesh_object(quad(DVec3::new(0.2, 0.1, 0.2), [DVec3::X * 0.4, DVec3::Y * 0.5], 1.0)));
    case
}

/// Returns balls among transparent layers. Catches a wrong order of balls in front of, between and behind layers.
fn balls_among_glass() -> Case {
    let balls = ball_cloud(&points(50, [0.03, 0.2], 16), false, false);
    let mut panes = Vec::new();
    for (i, z) in [-0.5, 0.0, 0.45].into_iter().enumerate() {
        let color = [[0.9, 0.2, 0.1], [0.1, 0.8, 0.2], [0.2, 0.3, 0.9]][i];
        panes.extend(sheet(
            DVec3::new(0.1 * i as f64, 0.0, z),
            [DVec3::X * 0.6, DVec3::Y * 0.6],
            [14, 14],
            0.1,
            |_, _| color,
        ));
    }
    let glass = with_alpha(cloud(&panes), |_| 0.4);
    let mut case = lit(
        "balls_among_glass",
        vec![object(glass), object(balls), object(cloud(&floor(0.8, -0.8)))],
        camera(2.8, 50.0, [72, 72]),
    );
    for i in [0, 2] {
        case.scene.objects[i].material.interior_weight = Some(1.3);
    }
    case
}

/// Returns balls with shadows, whose radii are multiplied by `scale`. Catches shadows that balls don't cast or receive,
/// or that a ball casts on itself.
fn shadows_of_balls(scale: f64) -> Case {
    let balls: Vec<_> = points(40, [0.06, 0.2], 17).into_iter().map(|(p, r)| (p * 0.8, r * scale)).collect();
    let mut case = lit(
        if scale < 1.0 { "shadows_of_tiny_balls" } else { "shadows_of_balls" },
        vec![object(ball_cloud(&balls, false, false)), object(cloud(&floor(1.2, -1.0)))],
        camera(3.0, 52.0, [80, 80]),
    );
    let spot = |outer_deg: f64, position: [f64; 3]| Light::Spot {
        position,
        direction: [-position[0], -position[1], -position[2]],
        color: [0.4, 0.4, 0.5],
        inner_deg: 0.5 * outer_deg,
        outer_deg,
        shadow: true,
    };
    case.scene.lights = Some(vec![
        Light::Directional { direction: [0.4, 0.3, -0.9], color: [0.6, 0.5, 0.4], shadow: true },
        spot(40.0, [-1.5, 1.0, 2.5]),
        spot(80.0, [1.2, 0.4, 1.8]),
    ]);
    case.scene.objects[1].material.interior_weight = Some(1.3);
    case
}

/// Returns a region of a scene of balls. Catches a region that isn't a crop of the image.
fn region_of_balls() -> Case {
    let mut case = small_balls();
    case.name = "small_balls/region".into();
    case.region = Some(surfel_render::Region { x: 21, y: 13, width: 47, height: 39 });
    case
}

impl Case {
    /// Returns the case with a camera whose optical axis is off the centre, and whose pixels aren't square.
    fn in_intrinsics(mut self) -> Self {
        let [w, h] = self.camera.size.map(f64::from);
        self.camera.projection =
            Projection::Intrinsics { fx: 1.1 * w, fy: 0.8 * h, cx: 0.55 * w + 0.3, cy: 0.46 * h - 0.2 };
        self
    }
}
