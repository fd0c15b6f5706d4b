//! Depth maps with the depths of the surfaces that light from one direction reaches first.

use crate::casters::{Caster, Casters};
use glam::{Vec2, Vec3, Vec4};
use surfel_math::V2;
use surfel_math::basis::orthonormal;

/// Orthographic depth map of the unit sphere, viewed from a light's direction. It determines which points the light
/// reaches.
pub(crate) struct DepthMap {
    side: usize,
    right: Vec3,
    down: Vec3,
    /// Unit vector in which the light travels, along which depth is measured.
    forward: Vec3,
    /// Smallest depth of a surface in each texel, row by row; infinite in texels without a surface.
    depths: Vec<f32>,
}

/// Half-width and half-height of a disk, in texels, below which the disk is drawn as one texel, or not at all if it is
/// clipped.
const TINY: f32 = 0.6;
/// Largest half-width and half-height, in texels, of a disk that is drawn by testing all texels of its bounding box.
/// Larger disks are drawn row by row.
const SMALL: f32 = 4.0;
/// Number of texels in a row that are tested at once, by SIMD instructions.
const LANES: usize = 4;
/// Largest slope of a surface in a depth map: change of depth, in texel widths, per texel. Steeper surfaces are treated
/// as if they had this slope.
const MAX_SLOPE: f32 = 8.0;

/// Disk projected to a depth map, as [`DepthMap::draw_small`] needs it.
struct Ellipse {
    /// Position of the centre in the map, in texels.
    middle: Vec2,
    /// Depth of the centre, in radii of the depth map's sphere.
    depth: f32,
    /// Half-width and half-height of the bounding box, in texels.
    half: Vec2,
    /// Change of the unit disk's coordinates (along s and t) per texel to the right.
    right: Vec2,
    /// Change of the unit disk's coordinates (along s and t) per texel down.
    down: Vec2,
    /// Change of the depth per unit of the unit disk's two coordinates.
    slope: Vec2,
}

impl DepthMap {
    /// Creates an empty map of side×side texels.
    pub(crate) fn new(side: usize) -> Self {
        Self { side, right: Vec3::X, down: Vec3::Y, forward: Vec3::Z, depths: vec![f32::INFINITY; side * side] }
    }

    /// Draws the depths of all surfaces into the map, for light from the direction `toward`. Disks of watertight
    /// surfaces that face away from the light ([`Caster::Disk`]) are left out. The previous content is lost.
    pub(crate) fn draw(&mut self, casters: &Casters, toward: Vec3) {
        let (right, down) = orthonormal(toward.as_dvec3());
        (self.right, self.down, self.forward) = (right.as_vec3(), down.as_vec3(), -toward);
        self.depths.fill(f32::INFINITY);
        for caster in &casters.casters {
            match caster {
                Caster::Disk { s, t, facing, .. } if facing * s.cross(*t).dot(toward) < 0.0 => {}
                Caster::Disk { center, s, t, clip, .. } => {
                    self.draw_disk(*center, [*s, *t], clip.map(|clip| &casters.clips[clip as usize]));
                }
                Caster::Ball { center, radius } => self.draw_ball(*center, *radius),
                Caster::Triangle(corners) => self.draw_triangle(corners),
            }
        }
    }

    /// Returns the size of a texel of a map with side×side texels, in units of the sphere's radius.
    pub(crate) fn texel(side: usize) -> f32 {
        2.0 / side as f32
    }

    /// Returns the number of texels per unit of the depth maps' coordinates.
    fn scale(&self) -> f32 {
        0.5 * self.side as f32
    }

    /// Projects a point of the depth maps' coordinates: returns its position in the map, in texels, and its depth, in
    /// radii of the sphere.
    #[inline]
    fn project(&self, p: Vec3) -> (Vec2, f32) {
        let scale = self.scale();
        (Vec2::new(p.dot(self.right), p.dot(self.down)) * scale + scale, p.dot(self.forward))
    }

    /// Projects a vector: returns its components across the light, in texels, and its component along the light, in
    /// radii of the sphere.
    #[inline]
    fn turn(&self, v: Vec3) -> (Vec2, f32) {
        (Vec2::new(v.dot(self.right), v.dot(self.down)) * self.scale(), v.dot(self.forward))
    }

    /// Lowers the depth of the texel that contains the point `at` (in texels) of a plane, unless the texel's depth is
    /// smaller already. The new depth is the plane's at the texel's centre.
    #[inline]
    fn put(&mut self, at: Vec2, depth: f32, normal: Vec3) {
        let (x, y) = (at.x as usize, at.y as usize);
        if at.x >= 0.0 && at.y >= 0.0 && x < self.side && y < self.side {
            let to_center = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - at;
            let depth = depth - self.fall(normal).dot(to_center);
            let texel = &mut self.depths[y * self.side + x];
            *texel = texel.min(depth);
        }
    }

    /// Returns the decrease of a plane's depth per texel, along both axes of the map. Slopes are limited to
    /// [`MAX_SLOPE`]. The normal may have any length.
    #[inline]
    pub(crate) fn fall(&self, normal: Vec3) -> Vec2 {
        let slope = Vec2::new(normal.dot(self.right), normal.dot(self.down)) / normal.dot(self.forward);
        let slope = slope.clamp(Vec2::splat(-MAX_SLOPE), Vec2::splat(MAX_SLOPE)) / self.scale();
        // A plane parallel to the light has no slope.
        if slope.is_finite() { slope } else { Vec2::ZERO }
    }

    /// Returns the range of texels, along one axis, whose centres are within `half` texels of the coordinate `middle`.
    fn span(&self, middle: f32, half: f32) -> std::ops::Range<usize> {
        let (lo, hi) = ((middle - half - 0.5).max(0.0), middle + half + 0.5);
        // The conversion to an integer truncates, which is the floor for non-negative numbers.
        let end = (hi.max(0.0) as usize).min(self.side);
        let floor = lo as usize;
        let first = floor + usize::from(floor as f32 != lo);
        first.min(end)..end
    }

    fn draw_disk(&mut self, center: Vec3, [s, t]: [Vec3; 2], clip: Option<&surfel_math::clip::Clip<f64>>) {
        let (middle, depth) = self.project(center);
        let normal = s.cross(t);
        let ((s, s_depth), (t, t_depth)) = (self.turn(s), self.turn(t));
        let half_height = (s.y * s.y + t.y * t.y).sqrt();
        let is_tiny = half_height < TINY && s.x * s.x + t.x * t.x < TINY * TINY;
        let inverse = 1.0 / s.perp_dot(t);
        if is_tiny || !inverse.is_finite() {
            if clip.is_none() {
                self.put(middle, depth, normal);
            }
            return;
        }
        // (u, v) of a texel is right·dx + down·dy, and u² + v² ≤ 1 holds on an interval of each row.
        let (right, down) = (Vec2::new(t.y, -s.y) * inverse, Vec2::new(-t.x, s.x) * inverse);
        let slope = Vec2::new(s_depth, t_depth);
        let half = Vec2::new((s.x * s.x + t.x * t.x).sqrt(), half_height);
        if clip.is_none() && half.max_element() <= SMALL {
            if !self.draw_small(&Ellipse { middle, depth, half, right, down, slope }) {
                self.put(middle, depth, normal);
            }
            return;
        }
        let (along, skew, steepness) = (right.length_squared(), right.dot(down), right.dot(slope));
        let over_along = 1.0 / along;
        let mut is_lost = clip.is_none();
        for y in self.span(middle.y, half_height) {
            let dy = y as f32 + 0.5 - middle.y;
            let half = (along - dy * dy * inverse * inverse).max(0.0).sqrt() * over_along;
            let span = self.span(middle.x - skew * over_along * dy, half);
            let first = span.start as f32 + 0.5 - middle.x;
            let start = depth + dy * down.dot(slope) + first * steepness;
            let row = &mut self.depths[y * self.side..][span];
            is_lost &= row.is_empty();
            for (i, texel) in row.iter_mut().enumerate() {
                let i = i as f32;
                let is_kept = clip.is_none_or(|clip| {
                    let at = right * (first + i) + down * dy;
                    clip.keeps(V2::new(f64::from(at.x), f64::from(at.y)))
                });
                if is_kept {
                    *texel = texel.min(start + i * steepness);
                }
            }
        }
        if is_lost {
            self.put(middle, depth, normal);
        }
    }

    /// Draws a disk by testing all texels of its bounding box. Returns false if the disk covers no texel's centre.
    fn draw_small(&mut self, disk: &Ellipse) -> bool {
        let Ellipse { middle, depth, half, right, down, slope } = *disk;
        let columns = self.span(middle.x, half.x);
        let steepness = right.dot(slope);
        let mut is_found = false;
        for y in self.span(middle.y, half.y) {
            let dy = y as f32 + 0.5 - middle.y;
            let (u, v, start) = (down.x * dy, down.y * dy, depth + dy * down.dot(slope));
            for first in columns.clone().step_by(LANES) {
                // At the end of a row, texels are tested twice rather than reading the next row.
                let first = first.min(self.side - LANES);
                let dx = Vec4::new(0.5, 1.5, 2.5, 3.5) + (first as f32 - middle.x);
                let (u, v) = (dx * right.x + u, dx * right.y + v);
                let is_inside = (u * u + v * v).cmple(Vec4::ONE);
                let depths = Vec4::select(is_inside, dx * steepness + start, Vec4::INFINITY);
                let texels = &mut self.depths[y * self.side + first..][..LANES];
                Vec4::from_slice(texels).min(depths).write_to_slice(texels);
                is_found |= is_inside.any();
            }
        }
        is_found
    }

    fn draw_ball(&mut self, center: Vec3, radius: f32) {
        let (middle, depth) = self.project(center);
        let half = radius * self.scale();
        let mut is_lost = true;
        for y in self.span(middle.y, half) {
            for x in self.span(middle.x, half) {
                let d = (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - middle) / half;
                let inside = 1.0 - d.length_squared();
                if inside >= 0.0 {
                    let texel = &mut self.depths[y * self.side + x];
                    *texel = texel.min(depth - radius * inside.sqrt());
                    is_lost = false;
                }
            }
        }
        if is_lost {
            self.put(middle, depth - radius, self.forward);
        }
    }

    fn draw_triangle(&mut self, corners: &[Vec3; 3]) {
        let [(a, a_depth), (b, b_depth), (c, c_depth)] = corners.map(|corner| self.project(corner));
        let (ab, ac) = (b - a, c - a);
        let inverse = 1.0 / ab.perp_dot(ac);
        let mut is_lost = true;
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        let (half, center) = (0.5 * (hi - lo), 0.5 * (hi + lo));
        for y in self.span(center.y, half.y) {
            for x in self.span(center.x, half.x) {
                let d = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - a;
                let (u, v) = (d.perp_dot(ac) * inverse, ab.perp_dot(d) * inverse);
                if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                    let texel = &mut self.depths[y * self.side + x];
                    *texel = texel.min(a_depth + u * (b_depth - a_depth) + v * (c_depth - a_depth));
                    is_lost = false;
                }
            }
        }
        if is_lost {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            self.put((a + b + c) / 3.0, (a_depth + b_depth + c_depth) / 3.0, normal);
        }
    }

    /// True if a sphere is entirely beside the map, so that no surface in the map hides light from it.
    pub(crate) fn misses(&self, center: Vec3, radius: f32) -> bool {
        let reach = 1.0 + radius;
        center.dot(self.right).abs() > reach || center.dot(self.down).abs() > reach
    }

    /// Returns the fraction of the light, 0 to 1, that reaches a point `p` of a surface; 1 outside of the map. It is
    /// the bilinear mean of the depth comparisons at the four nearest texels. At each texel, the surface is taken as a
    /// plane whose [`DepthMap::fall`] is `slope`.
    #[inline]
    pub(crate) fn share(&self, p: Vec3, slope: Vec2) -> f32 {
        let (at, depth) = self.project(p);
        let at = at - 0.5;
        let last = (self.side - 1) as f32;
        if !(at.x >= 0.0 && at.y >= 0.0 && at.x < last && at.y < last) {
            return 1.0;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        let first = y * self.side + x;
        let part = at - Vec2::new(x as f32, y as f32);
        let base = depth + slope.dot(part);
        let lit = |nearest: f32, depth: f32| if depth <= nearest { 1.0f32 } else { 0.0 };
        let (upper, lower) = (&self.depths[first..][..2], &self.depths[first + self.side..][..2]);
        let (a, b) = (lit(upper[0], base), lit(upper[1], base - slope.x));
        let (c, d) = (lit(lower[0], base - slope.y), lit(lower[1], base - slope.x - slope.y));
        let (top, bottom) = (a + (b - a) * part.x, c + (d - c) * part.x);
        top + (bottom - top) * part.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns numbers from −1 to 1.
    fn random(state: &mut u32) -> f32 {
        *state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*state >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    #[test]
    fn small_disks_lower_the_texels_whose_centres_they_cover() {
        const SIDE: usize = 32;
        let mut state = 5;
        for i in 0..2000 {
            let mut next = || random(&mut state);
            // Some lie across the border of the map.
            let center = 1.1 * Vec3::new(next(), next(), next());
            let [s, t] = [(); 2].map(|()| 0.2 * Vec3::new(next(), next(), next()));
            let mut map = DepthMap::new(SIDE);
            map.draw_disk(center, [s, t], None);
            let (s2, t2) = (s.truncate(), t.truncate());
            let (mut compared, mut covered) = (0, 0);
            for (at, depth) in map.depths.iter().enumerate() {
                let texel = Vec2::new((at % SIDE) as f32 + 0.5, (at / SIDE) as f32 + 0.5);
                let d = texel / (0.5 * SIDE as f32) - 1.0 - center.truncate();
                let area = s2.perp_dot(t2);
                let (u, v) = (d.perp_dot(t2) / area, s2.perp_dot(d) / area);
                let inside = 1.0 - (u * u + v * v);
                // Texels at a disk's edge, and disks that are nearly parallel to the light, depend on rounding.
                if inside.abs() < 1e-2 || area.abs() < 1e-3 {
                    continue;
                }
                compared += 1;
                covered += usize::from(inside > 0.0);
                let expected = center.z + u * s.z + v * t.z;
                if inside > 0.0 {
                    assert!((depth - expected).abs() < 1e-3, "{i}: {depth}, expected {expected}");
                }
            }
            let found = map.depths.iter().filter(|depth| depth.is_finite()).count();
            // The texels at the edge may be covered or not, and a disk between centres covers one texel.
            let rest = SIDE * SIDE - compared;
            assert!(found >= covered && found <= covered + rest.max(1), "{i}: {found}, expected {covered}");
        }
    }
}
