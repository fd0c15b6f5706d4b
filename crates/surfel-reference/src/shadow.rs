//! Shadow maps (§5): the visibility pass from the lights, and whether a point is lit.

use crate::frame::center;
use crate::margin;
use crate::polygon::Polygons;
use crate::raster::{Bands, Run};
use crate::renderer::{ResidentMesh, ResidentObject, ResidentScene};
use crate::splat::project_all;
use glam::DVec3;
use surfel_math::depth::{plane_gradient, slope_allowance};
use surfel_math::shadow::taps;
use surfel_math::{V2, V3};
use surfel_model::{Cull, Material};
use surfel_render::{FramePlan, Planes, ShadowMap, View};

/// A drawn shadow map.
pub(crate) struct Shadow<'a> {
    map: &'a ShadowMap,
    texels: Vec<Texel>,
}

/// Depth, bias included, up to which a texel is lit.
#[derive(Clone, Copy)]
struct Texel {
    kept: f64,
    /// If every fragment on a rim casts, and if none does.
    possible: [f64; 2],
}

/// Draws the plan's maps. Everything opaque casts, whichever side of it the light or the eye sees.
pub(crate) fn draw<'a>(scene: &ResidentScene, plan: &'a FramePlan) -> Vec<Shadow<'a>> {
    if plan.shadow_maps.is_empty() {
        return Vec::new();
    }
    let whole = |material: Material| Material { cull: Cull::None, ..material };
    let uncull = |o: &ResidentObject| ResidentObject { material: whole(o.material), ..o.clone() };
    let objects: Vec<ResidentObject> = scene.objects.iter().map(uncull).collect();
    let uncull = |m: &ResidentMesh| ResidentMesh { material: whole(m.material), ..m.clone() };
    let meshes: Vec<ResidentMesh> = scene.meshes.iter().map(uncull).collect();
    plan.shadow_maps.iter().map(|map| draw_map(&objects, &meshes, plan, map)).collect()
}

fn draw_map<'a>(
    objects: &[ResidentObject],
    meshes: &[ResidentMesh],
    plan: &FramePlan,
    map: &'a ShadowMap,
) -> Shadow<'a> {
    let with_margin = plan.planes.margin;
    let planes = Planes { margin: with_margin, color: false, ..Planes::COLOR };
    let plan = FramePlan { splat_filter: map.splat_filter, planes, ..plan.clone() };
    let mut splats = project_all(objects, &map.view, &plan);
    splats.retain(|s| !plan.separates_transparent || s.alpha >= 1.0);
    let bands = Bands::new(&splats, map.view.region);
    let run = Run::new(&splats, &bands, &map.view, &plan);
    let kept = run.kept();
    let mut texels: Vec<Texel> = if with_margin {
        let passes = run.passes(kept);
        let pairs = passes.kept.iter().zip(&passes.possible);
        pairs.map(|(k, p)| Texel { kept: k.value, possible: [p.nearest.value, p.farthest.value] }).collect()
    } else {
        kept.iter().map(|k| Texel { kept: k.value, possible: [k.value; 2] }).collect()
    };
    let polygons = Polygons::new(meshes, &map.view);
    let hits = if meshes.is_empty() { Vec::new() } else { polygons.nearest(map.view.region, with_margin) };
    for (at, (hit, texel)) in hits.iter().zip(&mut texels).enumerate() {
        if hit.z.is_finite() {
            let z = hit.z
                + slope_allowance(
                    hit.z,
                    polygons.depth_gradient(hit, center(map.view.region, at)),
                    &map.view.projection,
                );
            texel.kept = texel.kept.min(z);
            let possible = if hit.marginal { [z, f64::INFINITY] } else { [z, z] };
            texel.possible = [0, 1].map(|i| texel.possible[i].min(possible[i]));
        }
    }
    Shadow { map, texels }
}

/// Share of a light that reaches a point, and whether rounding could change it. `position` is relative to the eye of `view`,
/// `normal` a unit vector, both in world space.
pub(crate) fn visibility(shadows: &[Shadow], light: usize, view: &View, position: DVec3, normal: DVec3) -> (f64, bool) {
    // Of several maps, the one that sees the point nearest to its axis.
    let seen = shadows.iter().filter(|s| s.map.light == light).map(|s| {
        let from_light = position + (view.eye - s.map.view.eye);
        (s, s.map.view.view_from_world * from_light)
    });
    match seen.max_by(|(_, a), (_, b)| a.z.total_cmp(&b.z)) {
        Some((shadow, p)) => shadow.visibility(p, shadow.map.view.view_from_world * normal),
        None => (1.0, false),
    }
}

impl Shadow<'_> {
    /// The same for a point and a normal in the map's view.
    fn visibility(&self, p: DVec3, normal: DVec3) -> (f64, bool) {
        let projection = &self.map.view.projection;
        if p.z < projection.near {
            return (1.0, false);
        }
        let p = V3::from(p);
        let at = projection.pixel(p);
        let gradient = plane_gradient(p, V3::from(normal), projection);
        let ((left, columns), (top, rows)) = (taps(at.x), taps(at.y));
        let (mut share, mut marginal) = (0.0, false);
        for (j, row_weight) in (0u8..).zip(rows) {
            for (i, column_weight) in (0u8..).zip(columns) {
                let tap = V2::new(left + f64::from(i), top + f64::from(j));
                let weight = column_weight * row_weight;
                let Some(texel) = self.texel(tap) else {
                    share += weight;
                    continue;
                };
                let z = p.z + gradient.dot(V2::new(tap.x + 0.5 - at.x, tap.y + 0.5 - at.y));
                if z <= texel.kept {
                    share += weight;
                }
                marginal |= margin::on_depth(z, texel.kept) || (z <= texel.possible[0]) != (z <= texel.possible[1]);
            }
        }
        (share, marginal)
    }

    /// The texel in this column and row; `None` outside of the map, where nothing casts.
    fn texel(&self, at: V2<f64>) -> Option<&Texel> {
        let side = self.map.view.size[0];
        let inside = |v: f64| (0.0..f64::from(side)).contains(&v);
        (inside(at.x) && inside(at.y)).then(|| &self.texels[at.y as usize * side as usize + at.x as usize])
    }
}
