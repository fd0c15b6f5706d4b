//! Detection of thin sheets over other surfaces, such as a roof over walls. Their back faces are drawn, because the
//! underside of a sheet separates its top from surfaces below it (rendering model §5).

use glam::DVec3;
use std::collections::HashMap;
use surfel_framing::patches::{Patch, Patches};
use surfel_model::Object;
use surfel_render::View;

/// Cosine of the largest angle (60°) between the normal of an underside and the reversed normal of the patch above.
/// Patches with a smaller angle are the back of a sheet; others belong to another surface.
const ALIKE: f64 = 0.5;
/// Two limits from which an object counts as having a thin sheet, for its patches that lie over another surface. The
/// first is their fraction of all patches, the second their number.
const LEAST: (f64, usize) = (0.001, 4);
/// Distance, in pixels, by which the depth tolerance reaches farther behind a surface than a splat's radius. It is
/// measured along the normal, and stands for the tolerance's slope term at a grazing angle (rendering model §5).
const REACH_PX: f64 = 1.5;
/// Largest relative difference between the depths of a sheet's underside and of a surface at which the two count as
/// touching.
const CONTACT: f64 = 1e-3;

/// True if an object has a thin sheet over another of its surfaces, within the reach of a view's depth tolerance. If
/// the sheet's back faces were culled, the other surface would shine through the sheet.
pub(crate) fn has_thin_sheets(object: &Object, patches: &Patches, view: &View) -> bool {
    let middle = view.view_from_world * (patches.middle - view.eye);
    let distance = if view.projection.is_perspective() { middle.z.max(view.projection.near) } else { 1.0 };
    let pixel = distance / view.projection.focal_px[0] / patches.scale;
    let (grid, growth) = (Grid::new(patches), Patches::growth(object));
    let lies_over = |patch: &&Patch| grid.lies_over_others(patch, radius(patch) / growth + REACH_PX * pixel);
    let count = patches.all.iter().filter(lies_over).count();
    count >= LEAST.1 && count as f64 >= LEAST.0 * patches.all.len() as f64
}

fn radius(patch: &Patch) -> f64 {
    patch.axes[0].length().max(patch.axes[1].length())
}

/// Returns the indices along x, y and z of the grid cell that contains a position. `cell` is the side of a cell.
fn cell_of(position: DVec3, cell: f64) -> [i32; 3] {
    (position / cell).floor().to_array().map(|index| index as i32)
}

/// Patches of an object in a grid of cubic cells, by which the patches close below another patch are found.
struct Grid<'a> {
    cell: f64,
    cells: HashMap<[i32; 3], Vec<&'a Patch>>,
}

impl<'a> Grid<'a> {
    fn new(patches: &'a Patches) -> Self {
        // A cell is about as large as an average patch.
        let cell = 2.0 * (patches.area / patches.all.len() as f64).sqrt();
        let mut cells: HashMap<[i32; 3], Vec<&Patch>> = HashMap::new();
        for patch in &patches.all {
            cells.entry(cell_of(patch.position, cell)).or_default().push(patch);
        }
        Self { cell, cells }
    }

    /// True if a patch is the top of a thin sheet over another surface: within the depth `reach` below the patch, there
    /// are the sheet's underside and, at the same depth or deeper, the other surface. Patches more than two cells away
    /// aren't searched.
    fn lies_over_others(&self, patch: &Patch, reach: f64) -> bool {
        let lateral = radius(patch);
        let (mut underside, mut other) = (f64::INFINITY, f64::NEG_INFINITY);
        let extent = DVec3::splat(lateral.max(reach).min(2.0 * self.cell));
        let [low, high] = [patch.position - extent, patch.position + extent].map(|p| cell_of(p, self.cell));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    for below in self.cells.get(&[x, y, z]).into_iter().flatten() {
                        let offset = below.position - patch.position;
                        let depth = -patch.normal.dot(offset);
                        let is_below = depth > 0.0 && depth <= reach;
                        if !is_below || (offset + patch.normal * depth).length_squared() > lateral * lateral {
                            continue;
                        }
                        match below.normal.dot(patch.normal) < -ALIKE {
                            true => underside = underside.min(depth),
                            false => other = other.max(depth),
                        }
                    }
                }
            }
        }
        other >= underside * (1.0 - CONTACT)
    }
}
