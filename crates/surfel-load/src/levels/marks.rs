//! Drawing parameters of points with levels of detail: splat sizes where finer points are missing or fade in, and radii
//! stored in the file.

use super::selection::{COVERING_RADIUS, Selection};
use glam::Vec3;
use rayon::prelude::*;
use surfel_io::copc::{Copc, LEVEL_COLORS, LEVEL_NORMALS, LevelValues, RADIUS};
use surfel_model::{CloudData, Column3, ExtraColumn, ExtraValues, OnInvalid, PointCloud, Shape, SplatCloud};
use surfel_render::FADE_OCTAVES;
use surfel_sample::PointReport;

/// Largest factor by which an estimated radius is enlarged so that a level's splats cover the surface. It applies where
/// points are denser than the level's spacing suggests, so that the spacing is meaningless. Radii that the file states
/// aren't limited, since they were estimated from all points.
const MAX_GROWTH: f32 = 4.0;

/// Smallest radius of a splat that is fading in, as a fraction of its final radius. The splat then has 1/400 of its
/// area.
const MIN_FADE_RADIUS: f64 = 0.05;

/// Name of the internal column of points that stores [`Mark::spacing`]. It is removed when splats are made.
const SPACING: &str = "surfel_level_spacing";
/// Name of the internal column of points that stores [`Mark::growth`]. It is added only if the file states no radii,
/// and removed when splats are made.
const GROWTH: &str = "surfel_level_growth";

/// Drawing parameters of a point, which depend on the levels that are selected around it.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Mark {
    /// Point spacing, in file units, that the splat is enlarged to fill. It is that of the finest selected level at the
    /// point if finer points are missing, else 0. While that level fades in, other points have larger values, up to the
    /// spacing of the level above; points that fade in themselves have smaller ones.
    spacing: f32,
    /// Weight, from 0 to 1, by which the average colour and normal of the level at the point are blended into the
    /// point's own. The averages represent the finer points that are missing. Negative if the point isn't drawn.
    share: f32,
    /// Current radius of a point that is fading in, as a fraction of its final radius; 1 for other points.
    growth: f32,
}

/// Computes the drawing parameters of a point of level `level`. `deepest` is the finest selected level at the point,
/// and `is_missing` is true if the file has finer points there. `errors` is the projected radius of a splat that covers
/// a level with point spacing 1, in units of the tolerated error; `None` if levels don't fade. `spacing` returns the
/// point spacing of a level.
pub(super) fn mark_of(
    level: u32,
    (mut deepest, mut is_missing): (u32, bool),
    errors: Option<f64>,
    spacing: impl Fn(u32) -> f64,
) -> Mark {
    let above = |of: u32| errors.map_or(f64::INFINITY, |errors| errors * spacing(of - 1));
    // A node is selected by its nearest point to the camera. Elsewhere in the node, its level may be finer than needed.
    while deepest > 0 && above(deepest) <= 1.0 {
        (deepest, is_missing) = (deepest - 1, true);
    }
    // Progress of the fade-in: 0 where a level begins to appear, 1 where its splats have their final areas.
    let fading = if deepest == 0 { 1.0 } else { (above(deepest).log2() / FADE_OCTAVES).min(1.0) };
    let is_new = level == deepest && fading < 1.0;
    let share = match deepest.checked_sub(level) {
        None => -1.0,
        Some(0) => f64::from(u8::from(is_missing)),
        Some(1) => 1.0 - fading,
        _ => 0.0,
    };
    let growth = if is_new { fading.sqrt().max(MIN_FADE_RADIUS) } else { 1.0 };
    let own = if is_missing { spacing(deepest) } else { 0.0 };
    let spacing = match deepest {
        0 => own,
        _ if is_new => own * growth,
        // During the fade-in, areas approach those of the new level linearly. At the file's last level, areas approach
        // those of splats that aren't enlarged.
        _ => (own * own * fading + spacing(deepest - 1).powi(2) * (1.0 - fading)).sqrt(),
    };
    Mark { spacing: spacing as f32, share: share as f32, growth: growth as f32 }
}

/// Computes the drawing parameters of all points, and stores them in internal columns. `ends` has the index after the
/// last point of each selected node. Blends colours and normals with the averages of their level, if the file has
/// averages. Removes points whose fade-in hasn't begun.
pub(super) fn mark(copc: &Copc, selection: &Selection, ends: &[usize], points: &mut PointCloud) {
    let Selection { nodes, cut, fade, .. } = selection;
    let all = copc.nodes();
    let spacings: Vec<f64> = (0..=all.last().map_or(0, |node| node.level)).map(|level| copc.spacing(level)).collect();
    let (origin, positions) = (points.origin, &points.positions);
    let mut marks = vec![Mark { spacing: 0.0, share: 0.0, growth: 1.0 }; points.len()];
    let (mut rest, mut start) = (&mut marks[..], 0);
    let mut parts = Vec::new();
    for (node, end) in nodes.iter().zip(ends) {
        let (own, others) = rest.split_at_mut(end - start);
        // In complete nodes, no finer points are missing.
        if !cut.is_complete[*node as usize] {
            parts.push((*node as usize, start, own));
        }
        (rest, start) = (others, *end);
    }
    parts.into_par_iter().for_each(|(node, start, marks)| {
        for (i, mark) in marks.iter_mut().enumerate() {
            let at = origin + positions.get(start + i);
            let finest = copc.cell_of(at);
            let mut deepest = node;
            let is_missing = loop {
                let cell = Copc::cell_above(finest, all[deepest].level + 1);
                let mut children = all[deepest].children.clone();
                match children.find(|c| all[*c as usize].cell == cell) {
                    // The file has no finer points nearby.
                    None => break false,
                    Some(child) if cut.is_chosen[child as usize] => deepest = child as usize,
                    Some(_) => break true,
                }
            };
            let errors = fade.as_ref().map(|fade| fade.errors(fade.magnification.at(at)));
            let end = (all[deepest].level, is_missing);
            *mark = mark_of(all[node].level, end, errors, |level| spacings[level as usize]);
            // Without missing points, the average equals the point's own value.
            if cut.values[node] == LevelValues::Alone && mark.share == 0.0 {
                mark.share = 1.0;
            }
        }
    });
    let mut columns = vec![(SPACING, marks.iter().map(|mark| mark.spacing).collect())];
    match points.extras.iter_mut().find(|e| e.name == RADIUS).map(|e| &mut e.values) {
        Some(ExtraValues::F32(radii)) => radii.iter_mut().zip(&marks).for_each(|(radius, mark)| *radius *= mark.growth),
        _ => columns.push((GROWTH, marks.iter().map(|mark| mark.growth).collect())),
    }
    let column = |(name, values): (&str, _)| ExtraColumn { name: name.into(), values: ExtraValues::F32(values) };
    points.extras.extend(columns.into_iter().map(column));
    if marks.iter().any(|mark| mark.share < 0.0) {
        points.retain(&marks.iter().map(|mark| mark.share >= 0.0).collect::<Vec<_>>());
        marks.retain(|mark| mark.share >= 0.0);
    }
    // The file may omit a column that is zero everywhere.
    let column = |names: [&str; 3]| {
        let found = names.map(|name| points.extras.iter().find(|e| e.name == name).map(|e| &e.values));
        found.iter().any(Option::is_some).then_some(found)
    };
    let value = |values: Option<&ExtraValues>, i: usize| values.map_or(0.0, |values| values.get(i));
    if let (Some(levels), Some(linear)) = (column(LEVEL_COLORS), &mut points.colors) {
        linear.par_iter_mut().zip(&marks).enumerate().filter(|(_, (_, mark))| mark.share > 0.0).for_each(
            |(i, (color, mark))| {
                let level = levels.map(|level| surfel_math::srgb::decode(value(level, i) / 65_535.0) as f32);
                *color = Vec3::from(*color).lerp(Vec3::from(level), mark.share).to_array();
            },
        );
    }
    if let (Some(levels), Some(own)) = (column(LEVEL_NORMALS), &mut points.normals) {
        let vector = |i: usize| {
            let (own, share) = (own.get(i).as_vec3(), marks[i].share);
            let level = if share > 0.0 { Vec3::from(levels.map(|level| value(level, i) as f32)) } else { Vec3::ZERO };
            if level == Vec3::ZERO {
                return own;
            }
            own.normalize_or_zero().lerp(level.normalize_or_zero(), share).normalize_or(own)
        };
        *own = Column3::from_f32((0..own.len()).into_par_iter().map(vector).collect());
    }
}

/// Returns the columns that the file's points had, without the internal columns that [`mark`] appends.
pub(crate) fn own_columns(extras: &[ExtraColumn]) -> &[ExtraColumn] {
    let first_added = extras.iter().position(|e| e.name == SPACING || e.name == GROWTH);
    &extras[..first_added.unwrap_or(extras.len())]
}

/// Splat radii, one per point, that Surfel stored as a column of a COPC file; `None` if the file has no such column.
pub(crate) struct Radii(Option<Vec<f32>>);

impl Radii {
    /// Removes the columns that Surfel stored in a COPC file from the file's points: radii, and averages for levels of
    /// detail. Returns the radii.
    pub(crate) fn take(points: &mut PointCloud) -> Self {
        let radii = take_f32(&mut points.extras, RADIUS);
        points.extras.retain(|e| !LEVEL_COLORS.iter().chain(&LEVEL_NORMALS).any(|name| e.name == *name));
        Self(radii)
    }

    /// True if the points have stored normals and radii. Splats are then made without searching for neighbours.
    pub(crate) fn are_stated(points: &PointCloud) -> bool {
        points.normals.is_some() && points.extras.iter().any(|e| e.name == RADIUS)
    }

    /// True if the points have normals, and at least one radius is valid.
    pub(crate) fn are_known(&self, points: &PointCloud) -> bool {
        points.normals.is_some() && self.0.iter().flatten().any(is_valid_radius)
    }

    /// Makes splats of the stored radii and normals, multiplying radii by `scale`. Invalid radii are replaced by the
    /// median of the valid ones, invalid normals by +z. Reuses the memory of the points.
    pub(crate) fn splats(
        self,
        points: PointCloud,
        scale: f64,
    ) -> Result<(SplatCloud, PointReport), surfel_model::ModelError> {
        let radii = self.0.unwrap_or_default();
        let mut sorted: Vec<f32> = radii.iter().copied().filter(is_valid_radius).collect();
        let middle = sorted.len().saturating_sub(1) / 2;
        let median = if sorted.is_empty() { 0.0 } else { *sorted.select_nth_unstable_by(middle, f32::total_cmp).1 };
        drop(sorted);
        let radii = radii.into_iter().map(|r| if is_valid_radius(&r) { r } else { median } * scale as f32).collect();
        let normals = points.normals.unwrap_or_default();
        let up = |n: Vec3| if n.is_finite() && n != Vec3::ZERO { n } else { Vec3::Z };
        let normals = Column3::from_f32((0..normals.len()).map(|i| up(normals.get(i).as_vec3())).collect());
        let data = CloudData {
            colors: points.colors,
            alphas: points.alphas,
            up: points.up,
            extras: points.extras,
            comments: points.comments,
            rows: points.rows,
            ..CloudData::new(points.origin, points.positions, Shape::Disks { normals, radii })
        };
        let (mut splats, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
        let mut report = PointReport::default();
        (report.splats, report.normals_given) = (splats.len(), splats.len());
        report.median_radius = f64::from(median) * scale;
        // Splats of a level are enlarged later, so that their interior weight is estimated then.
        let is_level = splats.data().extras.iter().any(|e| e.name == SPACING);
        report.interior_weight = if is_level { None } else { surfel_sample::interior_weight(&splats) };
        if let Some(weight) = report.interior_weight {
            splats.set_interior_weight(weight);
        }
        Ok((splats, report))
    }
}

/// True if a stored radius is valid: positive and finite. Other values mean that the radius is unknown.
pub(super) fn is_valid_radius(radius: &f32) -> bool {
    *radius > 0.0 && radius.is_finite()
}

fn take_f32(extras: &mut Vec<ExtraColumn>, name: &str) -> Option<Vec<f32>> {
    let at = extras.iter().position(|e| e.name == name)?;
    match extras.remove(at).values {
        ExtraValues::F32(values) => Some(values),
        _ => None,
    }
}

/// Enlarges splats so that each level covers the surface without gaps. Clouds without the internal column of
/// `Mark::spacing` are returned unchanged. If `weighed`, the interior weight is estimated; otherwise none is stored.
/// `stated` is true if the file states the radii; otherwise they are enlarged by a factor of at most [`MAX_GROWTH`].
pub(crate) fn close(cloud: SplatCloud, weighed: bool, stated: bool) -> Result<SplatCloud, surfel_model::ModelError> {
    let weight = cloud.data().interior_weight;
    if !cloud.data().extras.iter().any(|e| e.name == SPACING) {
        return Ok(cloud);
    }
    let mut data = cloud.into_data();
    let spacing = take_f32(&mut data.extras, SPACING).unwrap_or_default();
    let growth = take_f32(&mut data.extras, GROWTH).unwrap_or_default();
    let closing = |radius: f32, i: usize| {
        let radius = radius * growth.get(i).copied().unwrap_or(1.0);
        let grown = COVERING_RADIUS * spacing.get(i).copied().unwrap_or(0.0);
        radius.max(if stated { grown } else { grown.min(MAX_GROWTH * radius) })
    };
    match &mut data.shape {
        Shape::Disks { radii, .. } | Shape::Balls { radii, .. } => {
            radii.iter_mut().enumerate().for_each(|(i, r)| *r = closing(*r, i));
        }
        Shape::Ellipses { s, t } => {
            let grown = |axis: &Column3| {
                let one = |i: usize| {
                    let v = axis.get(i).as_vec3();
                    v * (closing(v.length(), i) / v.length().max(f32::MIN_POSITIVE))
                };
                Column3::from_f32((0..axis.len()).map(one).collect())
            };
            (*s, *t) = (grown(s), grown(t));
        }
    }
    data.interior_weight = None;
    let (mut cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    if weighed && let Some(weight) = surfel_sample::interior_weight(&cloud).or(weight) {
        cloud.set_interior_weight(weight);
    }
    Ok(cloud)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Checks that splats change gradually while a camera approaches in steps of 0.1 %.
    #[test]
    fn points_come_in_without_a_step() {
        const FINEST: u32 = 4;
        let spacing = |level: u32| (-f64::from(level)).exp2();
        for extra in [0, 1] {
            for level in 0..=FINEST {
                let mut before: Option<Mark> = None;
                let mut errors = 0.3;
                while errors < 40.0 {
                    // The least deep selection that the views need nearby, and one level more.
                    let needed = (0..FINEST).take_while(|above| errors * spacing(*above) > 1.0).count() as u32;
                    let deepest = (needed + extra).min(FINEST);
                    let of =
                        |level: u32, deepest: u32| mark_of(level, (deepest, deepest < FINEST), Some(errors), spacing);
                    if level > needed {
                        // Not selected, or not yet faded in.
                        assert!(of(level, deepest.max(level)).share < 0.0, "{level} at {errors}");
                    } else {
                        let mark = of(level, deepest);
                        // Splats are never larger than the error.
                        let size_px = f64::from(mark.spacing) * errors;
                        assert!(size_px <= 1.0 + 1e-6, "{level} at {errors}: {size_px}");
                        // Per step, areas change by 0.003 of half an octave; new splats start at 1/400.
                        let nothing = Mark { growth: 0.0, spacing: 0.0, ..mark };
                        let last = before.unwrap_or(if level == 0 { mark } else { nothing });
                        let grown = (mark.growth.powi(2) - last.growth.powi(2)).abs();
                        let apart =
                            (mark.spacing.powi(2) - last.spacing.powi(2)).abs() / spacing(needed).powi(2) as f32;
                        assert!(grown < 0.006 && (level == 0 || apart < 0.013), "{level} at {errors}: {grown} {apart}");
                        assert!(mark.share >= 0.0 && (mark.share - last.share).abs() < 0.01, "{level} at {errors}");
                        if (1..FINEST).contains(&needed) {
                            // One existing splat and three new ones cover what four splats of the new level cover.
                            let [old, new] = [needed - 1, needed].map(|level| of(level, deepest).spacing.powi(2));
                            let covered = (old + 3.0 * new) / (4.0 * spacing(needed).powi(2) as f32);
                            let fades = of(needed, deepest).growth < 1.0;
                            assert!(
                                if fades { (covered - 1.0).abs() < 0.01 } else { old == new },
                                "{errors}: {covered}"
                            );
                        }
                        before = Some(mark);
                    }
                    errors *= 1.001;
                }
                let done = mark_of(level, (FINEST, false), Some(errors), spacing);
                assert!(done == Mark { spacing: 0.0, share: 0.0, growth: 1.0 } && before == Some(done), "{level}");
            }
        }
        // Images that share a selection draw the selected level as it is.
        let shared = |level, deepest, is_missing| mark_of(level, (deepest, is_missing), None, spacing);
        assert_eq!([shared(2, 2, true).spacing, shared(2, 2, true).share], [0.25, 1.0]);
        assert_eq!([shared(1, 2, true).spacing, shared(1, 2, true).share], [0.25, 0.0]);
        assert_eq!([shared(1, 2, false).spacing, shared(1, 2, false).share], [0.0, 0.0]);
    }

    #[test]
    fn splats_close_their_level_however_dense_all_points_are() {
        let cloud = || {
            let centers = Column3::from_f32(vec![Vec3::ZERO, Vec3::X]);
            let normals = Column3::from_f32(vec![Vec3::Z; 2]);
            let column = |name: &str, values| ExtraColumn { name: name.into(), values: ExtraValues::F32(values) };
            let extras = vec![column(SPACING, vec![1.0, 0.0]), column(GROWTH, vec![1.0, 0.5])];
            let shape = Shape::Disks { normals, radii: vec![0.1; 2] };
            let data = CloudData { extras, ..CloudData::new(DVec3::ZERO, centers, shape) };
            SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
        };
        // Radii stated for all points, and radii estimated from the points read.
        for (stated, radius) in [(true, COVERING_RADIUS), (false, MAX_GROWTH * 0.1)] {
            let closed = close(cloud(), false, stated).unwrap();
            assert_eq!([0, 1].map(|i| closed.radius_max(i) as f32), [radius, 0.05]);
        }
    }
}
