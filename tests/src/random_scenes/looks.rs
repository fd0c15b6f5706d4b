//! Random settings, materials, lights and backgrounds.

use crate::random::Random;
use std::sync::Arc;
use surfel_model::{
    ClipPolicy, Cull, DepthTolerance, EdgeAa, Filter, Geometry, Light, Mapping, Matcap, Object, Settings, Shader,
    Texture, Transparency,
};

/// Returns random settings that a scene file can have, except settings that a backend draws with less precision.
pub(super) fn settings(random: &mut Random) -> Settings {
    let usual = Settings::default();
    let layers = 1 + random.below(5) as u32;
    usual
        .with_filter(random.pick(Filter::ALL))
        .with_cutoff(if random.chance(0.5) { usual.cutoff } else { random.factor(0.3, 8.0) })
        .with_prefilter_radius_px(match random.below(10) {
            0..=5 => usual.prefilter_radius_px,
            6 => 0.0,
            _ => random.factor(0.1, 4.0),
        })
        .with_mapping(random.pick([Mapping::Exact, Mapping::Exact, Mapping::Exact, Mapping::Affine]))
        .with_depth_tolerance(match random.below(10) {
            0..=4 => usual.depth_tolerance,
            5 => DepthTolerance::Relative(0.0),
            6 | 7 => DepthTolerance::Relative(random.factor(0.01, 20.0)),
            _ => DepthTolerance::Absolute(random.factor(1e-4, 2.0)),
        })
        .with_shader(match random.below(20) {
            0..=4 => Shader::Unlit,
            5 => Shader::Matcap,
            6 => Shader::Edl,
            7..=13 => Shader::Phong,
            14 | 15 => Shader::Toon,
            16 | 17 => Shader::Normal,
            _ => Shader::Depth,
        })
        .with_edge_aa(if random.chance(0.3) { EdgeAa::Coverage } else { EdgeAa::Off })
        .with_transparency(match random.below(4) {
            0 => Transparency::Off,
            1 | 2 => Transparency::Peel { layers, drop_last: random.chance(0.3) },
            _ => Transparency::ABuffer { layers },
        })
        .with_clip(random.pick([
            ClipPolicy::Exact,
            ClipPolicy::Exact,
            ClipPolicy::Exact,
            ClipPolicy::Paper,
            ClipPolicy::Line,
            ClipPolicy::Off,
        ]))
}

/// Sets the lighting factors of all objects' materials: shared random ones, different ones for each object, or none,
/// which leaves the defaults. Facing properties are random for each object.
pub(super) fn materials(random: &mut Random, objects: &mut [Object]) {
    let differ = random.chance(0.4);
    let factors = |random: &mut Random| {
        let shininess = if random.chance(0.1) { 0.0 } else { random.factor(0.5, 100.0) };
        [random.range(0.0, 1.5), random.range(0.0, 1.5), random.range(0.0, 1.0), shininess]
    };
    let shared = random.chance(0.6).then(|| factors(random));
    for object in objects {
        let of_object = if differ { Some(factors(random)) } else { shared };
        let material = &mut object.material;
        if let Some([ambient, diffuse, specular, shininess]) = of_object {
            (material.ambient, material.diffuse) = (ambient, diffuse);
            (material.specular, material.shininess) = (specular, shininess);
        }
        material.cull = random.pick([Cull::None, Cull::None, Cull::Back]);
        material.two_sided = random.chance(0.7);
    }
}

/// In half of the scenes, declares some clouds oriented, in the cloud or in the material. It uses its own generator, so
/// that other properties of a scene don't depend on the number of clouds.
pub(super) fn facings(seed: u64, objects: &mut [Object]) {
    let mut random = Random::new(seed.rotate_left(16));
    if random.chance(0.5) {
        return;
    }
    for object in objects {
        match (random.below(3), &mut object.geometry) {
            (0, _) => object.material.oriented = Some(true),
            (1, Geometry::Splats(cloud)) => {
                Arc::make_mut(cloud).set_oriented(true);
                object.material.oriented = random.chance(0.3).then_some(false);
            }
            _ => {}
        }
    }
}

/// Returns a matcap of a few random texels. `None` for shaders that need none, and in a fifth of the scenes, which use
/// the built-in matcap. It uses its own generator, so that scenes of other shaders don't depend on matcaps.
pub(super) fn matcap(seed: u64, shader: Shader) -> Option<Arc<Matcap>> {
    let mut random = Random::new(seed.rotate_left(32));
    if shader != Shader::Matcap || random.chance(0.2) {
        return None;
    }
    let [width, height] = [1 + random.below(9) as u32, 1 + random.below(9) as u32];
    let texel = |random: &mut Random| {
        let [r, g, b] = random.color().map(|c| (255.0 * c) as u8);
        [r, g, b, 255]
    };
    let srgba8 = (0..width * height).map(|_| texel(&mut random)).collect();
    Matcap::new(&Texture { width, height, srgba8 }).ok().map(Arc::new)
}

/// Returns a random background: linear RGB and straight alpha.
pub(super) fn background(random: &mut Random) -> [f64; 4] {
    let alpha = if random.chance(0.5) { random.pick([0.0, 1.0]) } else { random.range(0.0, 1.0) };
    [random.range(0.0, 1.0), random.range(0.0, 1.0), random.range(0.0, 1.0), alpha]
}

/// Returns a random colour, linear RGB.
pub(super) fn light_color(random: &mut Random) -> [f64; 3] {
    [random.range(0.0, 1.0), random.range(0.0, 1.0), random.range(0.0, 1.0)]
}

/// Returns random lights of all kinds, no lights, or `None` for the default headlight.
pub(super) fn lights(random: &mut Random, shader: Shader) -> Option<Vec<Light>> {
    if random.chance(0.2) {
        return None;
    }
    // Shadow maps have a million texels. Only one in eight scenes of lit shaders has them, to save time.
    let mut shadows = usize::from(matches!(shader, Shader::Phong | Shader::Toon) && random.chance(0.2));
    let count = random.below(4);
    let mut one = |random: &mut Random| {
        let color = light_color(random);
        let direction = (random.direction() * random.factor(0.1, 10.0)).to_array();
        let position = random.direction() * random.factor(0.3, 5.0);
        let shadow = shadows > 0;
        match random.below(3) {
            0 => {
                shadows = 0;
                Light::Directional { direction, color, shadow }
            }
            1 => Light::Point { position: position.to_array(), color },
            _ => {
                shadows = 0;
                // The light points approximately at the scene.
                let direction = (random.direction() * random.range(0.0, 1.0) - position).to_array();
                let inner_deg = random.range(0.0, 70.0);
                let outer_deg = inner_deg + random.range(0.0, 60.0);
                Light::Spot { position: position.to_array(), direction, color, inner_deg, outer_deg, shadow }
            }
        }
    };
    Some((0..count).map(|_| one(random)).collect())
}
