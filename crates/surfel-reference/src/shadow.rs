//! Shadow maps (rendering model §5): draws the visibility pass from the lights, and computes the fraction of a light
//! that reaches a point.

use crate::ball::BallView;
use crate::margin;
use crate::pixels::{center, center_in};
use crate::polygon::Polygons;
use crate::raster::{Bands, Run};
use crate::scene::{ResidentMesh, ResidentObject, ResidentScene};
use crate::splat::project_all;
use glam::DVec3;
use surfel_math::depth::{plane_gradient, slope_allowance};
use surfel_math::shadow::{lookup_bias, taps};
use surfel_math::{V2, V3};
use surfel_model::{Cull, Material};
use surfel_render::{FramePlan, Pass, Planes, ShadowMap, View};

/// Shadow map of a light, with its drawn texels.
pub(crate) struct Shadow<'a> {
    map: &'a ShadowMap,
    texels: Vec<Texel>,
}

/// Texel of a shadow map: the depth in the map's view up to which points are lit. It is the threshold min(z + ε) of the
/// visibility pass, also lowered by polygons and balls.
#[derive(Clone, Copy)]
struct Texel {
    threshold: f64,
    /// Depth limits if all fragments with the texel on their rim cast a shadow, and if none of them does.
    possible: [f64; 2],
}

/// Draws the shadow maps of a plan. Everything opaque casts a shadow, regardless of which side faces the light or the
/// eye.
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
    let planes = Planes::COLOR.with_margin(with_margin).with_color(false);
    let plan = FramePlan { splat_filter: map.splat_filter, planes, keeps_facings: false, ..plan.clone() };
    let mut splats = project_all(objects, &map.view, &plan);
    splats.retain(|s| !plan.separates_transparent || s.alpha >= 1.0);
    let bands = Bands::new(&splats, map.view.region);
    let run = Run::new(&splats, &bands, &map.view, &plan);
    let thresholds = run.thresholds();
    let mut texels: Vec<Texel> = if with_margin {
        let passes = run.accumulate(thresholds);
        let pairs = passes.thresholds.iter().zip(&passes.possible);
        pairs.map(|(t, p)| Texel { threshold: t.depth, possible: [p.nearest.depth, p.farthest.depth] }).collect()
    } else {
        thresholds.iter().map(|t| Texel { threshold: t.depth, possible: [t.depth; 2] }).collect()
    };
    let polygons = Polygons::new(meshes, &map.view, &plan);
    let hits = if meshes.is_empty() {
        Vec::new()
    } else {
        polygons.nearest(map.view.region, with_margin.then_some(margin::RIM_PX))
    };
    for (at, (hit, texel)) in hits.iter().zip(&mut texels).enumerate() {
        if hit.z.is_finite() {
            let gradient = polygons.depth_gradient(hit, center_in(map.view.region, at));
            let z = hit.z + slope_allowance(hit.z, gradient, &map.view.projection);
            texel.threshold = texel.threshold.min(z);
            let possible = if hit.marginal { [z, f64::INFINITY] } else { [z, z] };
            texel.possible = [0, 1].map(|i| texel.possible[i].min(possible[i]));
        }
    }
    cast_by_balls(objects, &plan, map, &mut texels);
    Shadow { map, texels }
}

/// Lowers the thresholds of texels whose centres are inside opaque balls to the depths of the balls' centres. The lit
/// half of a ball is nearer than its centre, and points behind the ball are farther.
fn cast_by_balls(objects: &[ResidentObject], plan: &FramePlan, map: &ShadowMap, texels: &mut [Texel]) {
    if !plan.has(Pass::Balls) {
        return;
    }
    let rect = map.view.region;
    for ball in BallView::of_shadow_map(&map.view).project(objects, plan) {
        if plan.ball_alphas && ball.alpha() < 1.0 {
            continue;
        }
        let (columns, rows) = ball.touched(rect);
        for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let texel = &mut texels[((y - rect.y) * rect.width + x - rect.x) as usize];
            let (pixel, z) = (center(x, y), ball.center.z);
            let (inside, on_rim) = (ball.contains(pixel), ball.is_on_rim(pixel));
            texel.threshold = if inside { texel.threshold.min(z) } else { texel.threshold };
            let possible = [inside || on_rim, inside && !on_rim];
            texel.possible = [0, 1].map(|i| if possible[i] { texel.possible[i].min(z) } else { texel.possible[i] });
        }
    }
}

/// Returns the fraction of the light with index `light` that reaches a point, and true if rounding could change it. A
/// light without shadow maps reaches every point. `position` is relative to the eye of `view`, and `normal` is a unit
/// vector, both in world space.
pub(crate) fn visibility(shadows: &[Shadow], light: usize, view: &View, position: DVec3, normal: DVec3) -> (f64, bool) {
    // Of a light's several maps, the one along whose axis the point is farthest is used.
    let views = shadows.iter().filter(|s| s.map.light == light).map(|s| {
        let from_light = position + (view.eye - s.map.view.eye);
        (s, s.map.view.view_from_world * from_light)
    });
    match views.max_by(|(_, a), (_, b)| a.z.total_cmp(&b.z)) {
        Some((shadow, p)) => shadow.visibility(p, shadow.map.view.view_from_world * normal),
        None => (1.0, false),
    }
}

impl Shadow<'_> {
    /// Returns the fraction of the light that reaches a point, and true if rounding could change it. Points nearer to
    /// the light than the map's z_near are lit. Point and normal are in the map's view space.
    fn visibility(&self, p: DVec3, normal: DVec3) -> (f64, bool) {
        let projection = &self.map.view.projection;
        if p.z < projection.near {
            return (1.0, false);
        }
        let p = V3::from(p);
        let at = projection.pixel(p);
        let gradient = plane_gradient(p, V3::from(normal), projection);
        let ((left, columns), (top, rows)) = (taps(at.x), taps(at.y));
        let nearer = p.z - lookup_bias(p.z, projection);
        let (mut share, mut marginal) = (0.0, false);
        for (j, row_weight) in (0u8..).zip(rows) {
            for (i, column_weight) in (0u8..).zip(columns) {
                let tap = V2::new(left + f64::from(i), top + f64::from(j));
                let weight = column_weight * row_weight;
                let Some(texel) = self.texel(tap) else {
                    share += weight;
                    continue;
                };
                let z = nearer + gradient.dot(V2::new(tap.x + 0.5 - at.x, tap.y + 0.5 - at.y));
                if z <= texel.threshold {
                    share += weight;
                }
                marginal |=
                    margin::on_depth(z, texel.threshold) || (z <= texel.possible[0]) != (z <= texel.possible[1]);
            }
        }
        (share, marginal)
    }

    /// Returns the texel in this column and row; `None` outside the map, where nothing casts a shadow.
    fn texel(&self, at: V2<f64>) -> Option<&Texel> {
        let side = self.map.view.size[0];
        let inside = |v: f64| (0.0..f64::from(side)).contains(&v);
        (inside(at.x) && inside(at.y)).then(|| &self.texels[at.y as usize * side as usize + at.x as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Light;
    use surfel_render::ShadowScene;

    /// Returns the fraction of light at the middle of a map along +x. All texels of the map are lit except `texel`, in
    /// column 512 and row 512.
    fn at_middle(texel: Texel, depth: f64) -> (f64, bool) {
        let sun = Light::Directional { direction: [1.0, 0.0, 0.0], color: [1.0; 3], shadow: true };
        let maps = ShadowScene { lights: vec![(0, sun)], center: DVec3::ZERO, radius: 1.0 }.maps(2.0);
        let side = maps[0].view.size[0] as usize;
        let open = Texel { threshold: f64::INFINITY, possible: [f64::INFINITY; 2] };
        let mut texels = vec![open; side * side];
        texels[512 * side + 512] = texel;
        let shadow = Shadow { map: &maps[0], texels };
        // Half a texel right of and below the optical axis: the centre of that texel, and the middle of the filter.
        let half_texel = 0.5 / maps[0].view.projection.focal_px[0];
        shadow.visibility(DVec3::new(half_texel, half_texel, depth), DVec3::NEG_Z)
    }

    fn assert_share((share, marginal): (f64, bool), want: f64, open: bool) {
        assert!((share - want).abs() < 1e-9 && marginal == open, "{share} {marginal}");
    }

    #[test]
    fn shadow_of_a_texel_is_its_share_of_the_filter() {
        let texel = |threshold: f64| Texel { threshold, possible: [threshold; 2] };
        assert_share(at_middle(texel(1.0), 1.5), 8.0 / 9.0, false);
        assert_share(at_middle(texel(1.0), 0.5), 1.0, false);
        // The view is 2.008 high, so that the bias of a lookup is 0.001004.
        assert_share(at_middle(texel(1.0), 1.0008), 1.0, false);
        assert_share(at_middle(texel(1.0), 1.0012), 8.0 / 9.0, false);
        assert_share(at_middle(texel(1.0), 1.00095), 1.0, true);
        assert_share(at_middle(texel(1.0), 1.00105), 8.0 / 9.0, true);
    }

    #[test]
    fn shadow_of_a_rim_is_marginal_where_it_matters() {
        let rim = Texel { threshold: 1.0, possible: [1.0, 1.8] };
        assert_share(at_middle(rim, 0.5), 1.0, false);
        assert_share(at_middle(rim, 1.5), 8.0 / 9.0, true);
        assert_share(at_middle(rim, 1.9), 8.0 / 9.0, false);
    }
}
