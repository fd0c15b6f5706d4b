//! Conversion of textures that don't repeat to equivalent ones that do: rendering repeats all textures.
//!
//! A mirrored texture is extended by its mirror images. A clamped texture is replaced by the range that surfaces show,
//! extended beyond the edges, with one more texel on each side for interpolation.

use super::materials::BaseColor;
use crate::materials::Parts;
use serde_json::Value;
use std::collections::HashMap;
use std::sync::Arc;
use surfel_model::Texture;

/// Maximum number of texels of a converted texture, per texel of the original. A texture that would become larger stays
/// unchanged, unless [`ALWAYS_ALLOWED_TEXELS`] allows its size.
const MAX_GROWTH: usize = 4;
/// Number of texels that a converted texture may always have, however small the original is.
const ALWAYS_ALLOWED_TEXELS: usize = 1 << 22;

/// Wrap mode of a texture: its continuation beyond its edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Wrap {
    #[default]
    Repeat,
    Mirror,
    Clamp,
}

impl Wrap {
    /// Returns the wrap modes along u and v of a texture's sampler.
    pub(super) fn of(document: &Value, texture: usize) -> [Self; 2] {
        let sampler = document.pointer(&format!("/textures/{texture}/sampler")).and_then(Value::as_u64);
        let said = |key: &str| document.pointer(&format!("/samplers/{}/{key}", sampler?)).and_then(Value::as_u64);
        ["wrapS", "wrapT"].map(|key| match said(key) {
            Some(33_071) => Self::Clamp,
            Some(33_648) => Self::Mirror,
            _ => Self::Repeat,
        })
    }
}

/// Conversion of a texture along one axis, u or v, and of the texture coordinates along it. Repeated, the converted
/// texture shows what the original shows with its own wrap mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
enum Change {
    #[default]
    Nothing,
    Mirrored,
    /// The texture is replaced by its texels `first..end` along the axis; indices beyond its edges repeat the texels at
    /// the edges. `of` is the original number of texels along the axis.
    Shown {
        first: i64,
        end: i64,
        of: i64,
    },
}

impl Change {
    /// Selects the conversion along an axis of `size` texels for texture coordinates from `least` to `largest`. `other`
    /// is the number of texels of a second texture, such as a normal map, that uses the same coordinates. Returns
    /// `None` if the coordinates extend too far beyond the texture's edges.
    fn new(wrap: Wrap, [least, largest]: [f32; 2], size: usize, other: usize) -> Option<Self> {
        let (least, largest, texels) = (f64::from(least), f64::from(largest), size as f64);
        let half = 0.5 / texels;
        let is_within = least >= half && largest <= 1.0 - half;
        if wrap == Wrap::Repeat || is_within || size == 0 || other == 0 || least > largest {
            return Some(Self::Nothing);
        }
        if wrap == Wrap::Mirror && (least < 0.0 || largest > 1.0) {
            return Some(Self::Mirrored);
        }
        if least.abs().max(largest.abs()) * texels > ALWAYS_ALLOWED_TEXELS as f64 {
            return None;
        }
        // The range also spans a whole number of the other texture's texels. It has one more texel on each side for
        // interpolation.
        let step = (size / gcd(size, other)) as i64;
        let first = ((least * texels).floor() as i64 - 1).div_euclid(step) * step;
        let end = -((-(largest * texels).ceil() as i64 - 1).div_euclid(step) * step);
        Some(Self::Shown { first, end, of: size as i64 })
    }

    fn coordinate(self, u: f32) -> f32 {
        match self {
            Self::Nothing => u,
            Self::Mirrored => 0.5 * u,
            Self::Shown { first, end, of } => ((f64::from(u) * of as f64 - first as f64) / (end - first) as f64) as f32,
        }
    }

    /// Returns the number of texels after the conversion along an axis that has `size` texels before.
    fn length(self, size: usize) -> usize {
        match self {
            Self::Nothing => size,
            Self::Mirrored => 2 * size,
            Self::Shown { first, end, of } => ((end - first) * size as i64 / of) as usize,
        }
    }

    /// Returns, for each texel after the conversion along an axis of `size` texels, the index of the original texel.
    fn side(self, size: usize) -> Vec<usize> {
        match self {
            Self::Nothing => (0..size).collect(),
            Self::Mirrored => (0..size).chain((0..size).rev()).collect(),
            Self::Shown { first, of, .. } => {
                let first = first * size as i64 / of;
                (0..self.length(size)).map(|i| (first + i as i64).clamp(0, size as i64 - 1) as usize).collect()
            }
        }
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Converts the textures that don't repeat, and the texture coordinates that refer to them. Returns the number of
/// materials that stay unchanged because their surfaces extend too far beyond the texture's edges.
pub(super) fn resolve(parts: &mut Parts, materials: &mut [BaseColor], textures: &mut Vec<Arc<Texture>>) -> usize {
    let Some(uvs) = &mut parts.uvs else { return 0 };
    let mut range = vec![[[f32::INFINITY, f32::NEG_INFINITY]; 2]; materials.len()];
    for (uv, material) in uvs.iter().zip(&parts.materials_of) {
        let Some(range) = range.get_mut(*material as usize) else { continue };
        for ([least, largest], u) in range.iter_mut().zip(uv) {
            (*least, *largest) = (least.min(*u), largest.max(*u));
        }
    }
    let mut left = 0;
    let mut known = HashMap::new();
    let mut changes = vec![[Change::Nothing; 2]; materials.len()];
    for ((base, range), change) in materials.iter_mut().zip(&range).zip(&mut changes) {
        let material = &mut base.material;
        let normals = material.normal_map.map(|(image, _)| image);
        let Some(first) = material.texture.or(normals) else { continue };
        let sizes = |index: usize| [textures[index].width as usize, textures[index].height as usize];
        let (own, other) = (sizes(first), sizes(normals.unwrap_or(first)));
        let along = |k: usize| Change::new(base.wrap[k], range[k], own[k], other[k]);
        let is_small = |[u, v]: [Change; 2]| {
            let texels = |[width, height]: [usize; 2]| u.length(width).saturating_mul(v.length(height));
            let most = |[width, height]: [usize; 2]| (MAX_GROWTH * width * height).max(ALWAYS_ALLOWED_TEXELS);
            texels(own) <= most(own) && texels(other) <= most(other)
        };
        let Some([u, v]) = along(0).zip(along(1)).map(<[Change; 2]>::from).filter(|both| is_small(*both)) else {
            left += 1;
            continue;
        };
        *change = [u, v];
        if *change == [Change::Nothing; 2] {
            continue;
        }
        let mut changed = |index: usize| {
            *known.entry((index, *change)).or_insert_with(|| {
                textures.push(Arc::new(apply(&textures[index], *change)));
                textures.len() - 1
            })
        };
        material.texture = material.texture.map(&mut changed);
        material.normal_map = material.normal_map.map(|(image, scale)| (changed(image), scale));
    }
    for (uv, material) in uvs.iter_mut().zip(&parts.materials_of) {
        if let Some([u, v]) = changes.get(*material as usize) {
            *uv = [u.coordinate(uv[0]), v.coordinate(uv[1])];
        }
    }
    left
}

fn apply(texture: &Texture, [u, v]: [Change; 2]) -> Texture {
    let (width, height) = (texture.width as usize, texture.height as usize);
    let (columns, rows) = (u.side(width), v.side(height));
    let row = |y: &usize| {
        let row = &texture.srgba8[y * width..(y + 1) * width];
        columns.iter().map(|x| row[*x]).collect::<Vec<_>>()
    };
    let srgba8 = rows.iter().flat_map(row).collect();
    Texture { width: columns.len() as u32, height: rows.len() as u32, srgba8 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::Material;

    /// Returns the exact level at `u` of a row of four texels, continued by `wrap`.
    fn truth(wrap: Wrap, u: f64) -> f64 {
        let level = |i: i64| {
            let inside = match wrap {
                Wrap::Repeat => i.rem_euclid(4),
                Wrap::Clamp => i.clamp(0, 3),
                Wrap::Mirror => {
                    if i.rem_euclid(8) < 4 {
                        i.rem_euclid(8)
                    } else {
                        7 - i.rem_euclid(8)
                    }
                }
            };
            [10.0, 200.0, 60.0, 120.0][inside as usize] / 255.0
        };
        let x = u * 4.0 - 0.5;
        let share = x - x.floor();
        level(x.floor() as i64) * (1.0 - share) + level(x.floor() as i64 + 1) * share
    }

    #[test]
    fn textures_are_continued_as_they_say() {
        let row = [10, 200, 60, 120].map(|v| [v; 4]);
        let srgba8: Vec<[u8; 4]> = (0..8).flat_map(|_| row).collect();
        for (wrap, range) in [
            (Wrap::Repeat, [-3.0, 4.0]),
            (Wrap::Clamp, [0.0, 1.0]),
            (Wrap::Clamp, [-0.2, 1.1]),
            (Wrap::Clamp, [-2.0, 3.0]),
            (Wrap::Clamp, [1.3, 2.3]),
            (Wrap::Mirror, [0.5, 1.0]),
            (Wrap::Mirror, [-2.0, 3.0]),
            (Wrap::Mirror, [0.0, 1.0]),
            (Wrap::Clamp, [0.3, 0.4]),
        ] {
            // A normal map of twice the width is continued in the same way.
            let normals = (0..64).map(|i| row[i % 8 / 2]).collect();
            let mut textures = vec![
                Arc::new(Texture { width: 4, height: 8, srgba8: srgba8.clone() }),
                Arc::new(Texture { width: 8, height: 8, srgba8: normals }),
            ];
            let uvs: Vec<[f32; 2]> =
                (0..=100).map(|i| [range[0] + (range[1] - range[0]) * i as f32 / 100.0, 0.5]).collect();
            let mut parts = Parts { uvs: Some(uvs.clone()), materials_of: vec![0; uvs.len()], ..Parts::default() };
            let material = Material { texture: Some(0), normal_map: Some((1, 1.0)), ..Material::WHITE };
            let mut materials = [BaseColor { material, transform: None, set: 0, wrap: [wrap, Wrap::Repeat] }];
            assert_eq!(resolve(&mut parts, &mut materials, &mut textures), 0);
            let [base] = &materials;
            let shown = &textures[base.material.texture.unwrap()];
            let mapped = &textures[base.material.normal_map.unwrap().0];
            for ([u, _], uv) in uvs.iter().zip(parts.uvs.as_ref().unwrap()) {
                let [r, ..] = shown.sample_numbers(*uv);
                let expected = truth(wrap, f64::from(*u));
                assert!((f64::from(r) - expected).abs() < 1e-5, "{wrap:?} {u}: {r}, expected {expected}");
                let apart = f64::from(mapped.sample_numbers(*uv)[0]) - expected;
                assert!(apart.abs() < 0.38, "{wrap:?} {u}: normals {apart}");
            }
        }
    }

    #[test]
    fn what_lies_far_beyond_an_edge_is_left_and_counted() {
        let texture = || Arc::new(Texture { width: 4, height: 4, srgba8: vec![[9; 4]; 16] });
        for (range, left) in
            [([-9e6, 0.5], 1), ([0.0, f32::MAX], 1), ([-9e5, 9e5], 1), ([0.5, 0.5], 0), ([f32::NAN, f32::NAN], 0)]
        {
            let uvs = vec![[range[0], 0.5], [range[1], 0.5]];
            let mut parts = Parts { uvs: Some(uvs.clone()), materials_of: vec![0, 0], ..Parts::default() };
            let material = Material { texture: Some(0), ..Material::WHITE };
            let mut materials = [BaseColor { material, transform: None, set: 0, wrap: [Wrap::Clamp; 2] }];
            let mut textures = vec![texture()];
            assert_eq!(resolve(&mut parts, &mut materials, &mut textures), left, "{range:?}");
            assert_eq!(textures.len(), 1);
            assert_eq!(format!("{:?}", parts.uvs.unwrap()), format!("{uvs:?}"));
        }
    }
}
