//! Classification of points by a table of evidence.
//!
//! A neighbourhood is measured once ([`Measured`]). Each piece of evidence compares one or two of the measurements with
//! named thresholds, and [`TABLE`] gives the class of every combination of evidence. Each class has one rule for the
//! radius of the splat's disk ([`PointClass::radius`], limited by [`PointClass::most`]). Each class also has a rule for
//! the normal of a point without a stored normal, which [`crate::points`] applies:
//!
//! | class | radius | normal |
//! | --- | --- | --- |
//! | surface | covers its cell, at least the density radius | of the plane that fits the neighbours |
//! | border | the same, up to the fourth neighbour | the same |
//! | crease | covers its cell, ends where the surface turns; up to the fourth neighbour at another surface | the same |
//! | foliage | up to the fourth neighbour | away from the mean of the points around |
//! | line | up to the second neighbour | across the line, toward the outside |
//! | isolated | up to the second neighbour | toward the outside |
//!
//! In the table, *up to the n-th neighbour* is a radius of at most [`DENSITY`] times that neighbour's distance. Points
//! of the classes foliage, line and isolated belong to no surface. Their disks are at most as large as the density
//! radius ([`DENSITY`]) for the cloud's typical spacing, or 1.5 times as large on lines.
//!
//! A *grid step* is the unit of the coordinates of [`SortedPoints`](crate::sorted::SortedPoints). A *cell* is a point's
//! Voronoi cell in its tangent plane ([`Cell`](crate::cell::Cell)).

/// Radius at which neighbouring splats blend without holes (the density radius), in units of the spacing. The spacing
/// is the square root of the surface area per point.
pub const DENSITY: f64 = 1.65;
/// Radius that covers a point's Voronoi cell, relative to the distance of the cell's farthest corner. The margin makes
/// up for curvature and tilted neighbours. The weight at a corner, where three or more splats meet, rises from exp(−2)
/// = 0.14 to exp(−2/1.15²) = 0.22.
pub(crate) const COVER: f64 = 1.15;

/// Class of a point, by the arrangement of the points around it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PointClass {
    /// Point surrounded by points of the same surface.
    #[default]
    Surface,
    /// Point at the border of a surface: points surround it on one side only.
    Border,
    /// Point where the surface turns within one disk, or where another surface meets it.
    Crease,
    /// Point among leaves and the like, which form no surface.
    Foliage,
    /// Point on a line of points, in a pair, or in a group too small to form a surface.
    Line,
    /// Point far from all others, or among neighbours too sparse and too uneven for a surface.
    Isolated,
}

impl PointClass {
    /// All classes in the order of their declaration, by which reports count them.
    pub const ALL: [Self; 6] = [Self::Surface, Self::Border, Self::Crease, Self::Foliage, Self::Line, Self::Isolated];

    /// Returns the class's name, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Surface => "surface",
            Self::Border => "border",
            Self::Crease => "crease",
            Self::Foliage => "foliage",
            Self::Line => "line",
            Self::Isolated => "isolated",
        }
    }

    /// True for the classes whose points are part of a surface.
    pub fn is_surface(self) -> bool {
        matches!(self, Self::Surface | Self::Border | Self::Crease)
    }

    /// Returns the radius, in grid steps, of a disk that covers its point's cell; `reach` is the distance of the cell's
    /// farthest corner. The radius is at least [`Measured::least_radius`]; its maximum depends on the class.
    pub(crate) fn covering(self, m: &Measured, reach: f32) -> f32 {
        let largest = if self == Self::Border { MAX_AT_BORDER } else { LARGEST };
        (COVER as f32 * reach).clamp(m.least_radius(), (largest * DENSITY) as f32 * m.spacing)
    }

    /// Returns the radius, in grid steps, of the disk of a point of this class, from the measurements of its
    /// neighbourhood. `reach` is the distance of the point's farthest cell corner.
    pub(crate) fn radius(self, m: &Measured, reach: f32) -> f32 {
        let fourth = DENSITY as f32 * m.fourth;
        match self {
            Self::Crease if !m.is_cut() => self.covering(m, reach),
            Self::Surface => self.covering(m, reach),
            Self::Crease | Self::Border => self.covering(m, reach).min(fourth),
            Self::Foliage => fourth,
            Self::Line | Self::Isolated => DENSITY as f32 * m.second,
        }
    }

    /// Returns the largest radius of a disk of this class, in units of the cloud's typical spacing; infinite for points
    /// of surfaces.
    pub(crate) fn most(self) -> f64 {
        match self {
            Self::Surface | Self::Border | Self::Crease => f64::INFINITY,
            Self::Line => MAX_ON_LINE * DENSITY,
            Self::Foliage | Self::Isolated => DENSITY,
        }
    }
}

/// Largest radius of the disk of a surface or crease point, relative to the density radius for the point's spacing.
/// Larger disks would cover gaps that the scan really has.
const LARGEST: f64 = 2.5;
/// Largest radius of a border point's disk, relative to the density radius for the point's spacing. Corners of a border
/// point's cell may be far outside the surface.
const MAX_AT_BORDER: f64 = 1.5;
/// Largest radius of the disk of a point on a line, relative to the density radius for the cloud's typical spacing. The
/// limit exceeds 1, because a limb with few points around it has gaps that only larger disks cover.
const MAX_ON_LINE: f64 = 1.5;
/// Largest angle, in radians, by which a surface may turn within a disk. At larger angles, the disk would stick out
/// past the outline. The turn is a root mean square over the nearest neighbours. If the surface turns by this angle
/// within the density radius, the disk ends there, unless it needs a larger radius to cover its cell.
pub(crate) const FLAT: f32 = 0.7;
/// Smallest radius of a surface point's disk where the surface turns, relative to the square root of the surface area
/// per point.
const LEAST: f32 = 1.0;

/// Smallest ratio of a point's spacing to a neighbour's spacing at which the neighbour is in a far denser place. A
/// point is isolated if most of its neighbours are.
pub(crate) const ALONE: f64 = 8.0;
/// Range of sparseness ([`Measured::sparseness`]) over which the limits of roughness and coherence for a surface change
/// from their usual to their strictest values.
const SPARSE: (f32, f32) = (2.0, 8.0);
/// Largest mean squared sine at which neighbours form a plane, at points that aren't sparse (0.1 is 18°). The angle is
/// between the point's tangent plane and the directions to the neighbours.
pub(crate) const ROUGH: f32 = 0.1;
/// Largest mean squared sine at which neighbours form a plane, at the sparsest points ([`SPARSE`]). Groups of stray
/// points, whose normals may agree by chance, have values of 0.17 and more, and sparse parts of scans less than 0.05.
const ROUGH_WHERE_SPARSE: f32 = 0.05;
/// Smallest coherence of normals ([`Measured::coherence`]) at which points that aren't sparse form a surface. Half of
/// all points on leaves have a coherence of 0.5 or less. Points on thin limbs, whose neighbours are all around the
/// limb, have more than 0.8.
const COHERENT: f32 = 0.6;
/// Smallest coherence of normals at which the sparsest points ([`SPARSE`]) form a surface.
const COHERENT_WHERE_SPARSE: f32 = 0.9;
/// Inverse of the smallest fraction of closed cells at which points form a surface. A cell is closed if neighbours
/// bound it on all sides. The cells of a point and of its neighbours that face the same way are counted. Of 17 cells,
/// about 10 are closed at a straight border, and 7 in a square's corner.
const SURROUNDED: usize = 3;
/// Fraction of neighbours in other planes ([`Measured::elsewhere`]) above which another surface meets the point's
/// surface. Such neighbours are leaves, stray points, or the other side of a thin edge.
const CUT: f32 = 0.25;

/// Measurements of one point's neighbourhood, by which the point is classified; lengths are in grid steps.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Measured {
    /// Square root of the surface area per point around the point. It is the distance of the second neighbour if few
    /// cells around the point are closed.
    pub(crate) spacing: f32,
    /// Distance from the point to its second nearest neighbour.
    pub(crate) second: f32,
    /// Distance from the point to its fourth nearest neighbour.
    pub(crate) fourth: f32,
    /// Distance along the surface, from the point, at which the surface has turned by [`FLAT`]; infinite if it doesn't
    /// turn.
    pub(crate) flat_reach: f32,
    /// Distance of the point's farthest listed neighbour, relative to the median of this distance over the cloud.
    pub(crate) sparseness: f32,
    /// Mean squared sine of the angle between the point's tangent plane and the directions to its neighbours.
    pub(crate) roughness: f32,
    /// Mean agreement of the nearest neighbours' normals with the point's own ([`crate::orient::coherence`]); 1 if not
    /// computed.
    pub(crate) coherence: f32,
    /// Fraction of the neighbours whose spacing is at least [`ALONE`] times smaller than the point's.
    pub(crate) denser: f32,
    /// Number of neighbours whose normals face the same way as the point's, plus the point itself.
    pub(crate) together: usize,
    /// Number of points counted by [`Self::together`] whose cells are closed: bounded by neighbours on all sides.
    pub(crate) closed: usize,
    /// True if the point's own cell isn't closed, as at a border.
    pub(crate) is_open: bool,
    /// True if the point's cell is closed only by points of other scan lines, which are far beyond the neighbours on
    /// its own line.
    pub(crate) is_between_lines: bool,
    /// Fraction of the nearest neighbours that belong to other surfaces than the point's.
    pub(crate) elsewhere: f32,
}

impl Measured {
    /// Returns the smallest radius of the point's disk, in grid steps: the density radius, or less where the surface
    /// turns. Between scan lines that are far apart, the smallest radius is 0, so that the disk only covers its cell.
    /// At the last line, a larger disk would stick out of the surface by more than the distance between lines.
    fn least_radius(&self) -> f32 {
        if self.is_between_lines {
            return 0.0;
        }
        self.flat_reach.clamp(LEAST * self.spacing, DENSITY as f32 * self.spacing)
    }

    /// True if another surface meets the point's surface within its neighbourhood ([`CUT`]).
    pub(crate) fn is_cut(&self) -> bool {
        self.elsewhere > CUT
    }

    /// True if enough cells around the point are closed for a surface ([`SURROUNDED`]).
    pub(crate) fn is_surrounded(&self) -> bool {
        self.closed > 0 && SURROUNDED * self.closed >= self.together
    }

    /// True if the point is sparse, and its roughness is too high or its normals too incoherent for a surface.
    fn is_scattered(&self) -> bool {
        let much = sparse(self.sparseness);
        much > 0.0
            && (self.roughness > between(ROUGH, ROUGH_WHERE_SPARSE, much)
                || self.coherence < between(COHERENT, COHERENT_WHERE_SPARSE, much))
    }

    /// Returns the evidence for the point's class.
    pub(crate) fn evidence(&self) -> Evidence {
        let bent = self.flat_reach < DENSITY as f32 * self.spacing || self.is_cut();
        Evidence::default()
            .with(Evidence::ALONE, self.denser > 0.5)
            .with(Evidence::SCATTERED, self.is_scattered())
            .with(Evidence::INCOHERENT, self.is_incoherent())
            .with(Evidence::FEW_CLOSED_CELLS, !self.is_surrounded())
            .with(Evidence::OPEN, self.is_open)
            .with(Evidence::BENT, bent)
    }

    /// True if the point's neighbours form no plane and their normals disagree.
    fn is_incoherent(&self) -> bool {
        self.roughness > ROUGH && self.coherence < COHERENT
    }
}

/// True if a point with this sparseness and roughness needs the coherence of normals for its class.
pub(crate) fn needs_coherence(sparseness: f32, roughness: f32) -> bool {
    roughness > ROUGH || sparse(sparseness) > 0.0
}

/// Returns the position of a sparseness in the range [`SPARSE`], on a logarithmic scale: 0 at its start or below, 1 at
/// its end or above.
fn sparse(sparseness: f32) -> f32 {
    if sparseness <= SPARSE.0 { 0.0 } else { ((sparseness / SPARSE.0).ln() / (SPARSE.1 / SPARSE.0).ln()).min(1.0) }
}

/// Interpolates between two values; `share` is 0 at `from` and 1 at `to`.
fn between(from: f32, to: f32, share: f32) -> f32 {
    from + (to - from) * share
}

/// Pieces of evidence about one point, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Evidence(u8);

impl Evidence {
    /// Bit of an isolated point: most of its neighbours have a far smaller spacing, or its spacing is large and few
    /// other sparse points are near it.
    pub(crate) const ALONE: u8 = 1 << 0;
    /// Bit of a sparse point whose neighbours form no plane or whose normals disagree too much for a surface.
    pub(crate) const SCATTERED: u8 = 1 << 1;
    /// Bit of an incoherent point: its neighbours form no plane, and their normals disagree.
    pub(crate) const INCOHERENT: u8 = 1 << 2;
    /// Bit of a foliage point: many of the points around it are incoherent ([`Self::INCOHERENT`]), and the points
    /// around it form no thin layer.
    pub(crate) const AMONG_INCOHERENT: u8 = 1 << 3;
    /// Bit of a point around which too few cells are closed for a surface ([`SURROUNDED`]).
    pub(crate) const FEW_CLOSED_CELLS: u8 = 1 << 4;
    /// Bit of a point whose own cell isn't closed.
    pub(crate) const OPEN: u8 = 1 << 5;
    /// Bit of a point where the surface turns within a disk, or where another surface meets it.
    pub(crate) const BENT: u8 = 1 << 6;
    /// Number of pieces of evidence, which is the number of bits used.
    const COUNT: u32 = 7;

    /// Returns this evidence, with the bit `piece` added if `is_there` is true.
    pub(crate) fn with(self, piece: u8, is_there: bool) -> Self {
        Self(self.0 | if is_there { piece } else { 0 })
    }

    pub(crate) fn has(self, piece: u8) -> bool {
        self.0 & piece != 0
    }

    /// Returns the class of a point with this evidence.
    pub(crate) fn class(self) -> PointClass {
        CLASSES[usize::from(self.0)]
    }
}

/// Row of [`TABLE`]: a class, the evidence that must be present, and the evidence that must be absent.
type Row = (PointClass, u8, u8);

/// Class of every combination of evidence; exactly one row matches each combination.
const TABLE: [Row; 7] = {
    use Evidence as E;
    const NOWHERE: u8 = E::ALONE | E::AMONG_INCOHERENT | E::SCATTERED;
    [
        (PointClass::Isolated, E::ALONE, 0),
        (PointClass::Foliage, E::AMONG_INCOHERENT, E::ALONE),
        (PointClass::Isolated, E::SCATTERED, E::ALONE | E::AMONG_INCOHERENT),
        (PointClass::Line, E::FEW_CLOSED_CELLS, NOWHERE),
        (PointClass::Border, E::OPEN, NOWHERE | E::FEW_CLOSED_CELLS),
        (PointClass::Crease, E::BENT, NOWHERE | E::FEW_CLOSED_CELLS | E::OPEN),
        (PointClass::Surface, 0, NOWHERE | E::FEW_CLOSED_CELLS | E::OPEN | E::BENT),
    ]
};

/// Class of every combination of evidence, indexed by the evidence's bits; computed from [`TABLE`].
const CLASSES: [PointClass; 1 << Evidence::COUNT] = {
    let mut classes = [PointClass::Surface; 1 << Evidence::COUNT];
    let mut bits = 0;
    while bits < classes.len() {
        let mut row = 0;
        while row < TABLE.len() {
            let (class, with, without) = TABLE[row];
            if bits as u8 & with == with && bits as u8 & without == 0 {
                classes[bits] = class;
            }
            row += 1;
        }
        bits += 1;
    }
    classes
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_combination_of_evidence_has_exactly_one_class() {
        for bits in 0..1_u8 << Evidence::COUNT {
            let rows: Vec<&Row> =
                TABLE.iter().filter(|(_, with, without)| bits & with == *with && bits & without == 0).collect();
            assert_eq!(rows.len(), 1, "{bits:b}: {rows:?}");
            assert_eq!(Evidence(bits).class(), rows[0].0);
        }
        // Every class results from some evidence.
        for class in PointClass::ALL {
            assert!(CLASSES.contains(&class), "{class:?}");
        }
    }

    /// Returns the measurements of a point in an even, flat surface.
    fn flat() -> Measured {
        Measured {
            spacing: 1.0,
            second: 1.0,
            fourth: 1.0,
            flat_reach: f32::INFINITY,
            sparseness: 1.0,
            coherence: 1.0,
            together: 17,
            closed: 17,
            ..Measured::default()
        }
    }

    #[test]
    fn evidence_begins_at_its_thresholds() {
        let class = |m: Measured| m.evidence().class();
        assert_eq!(class(flat()), PointClass::Surface);
        assert_eq!(class(Measured { is_open: true, ..flat() }), PointClass::Border);
        assert_eq!(class(Measured { closed: 5, ..flat() }), PointClass::Line);
        assert_eq!(class(Measured { closed: 6, ..flat() }), PointClass::Surface);
        assert_eq!(class(Measured { elsewhere: 0.26, ..flat() }), PointClass::Crease);
        assert_eq!(class(Measured { flat_reach: 1.6, ..flat() }), PointClass::Crease);
        assert_eq!(class(Measured { denser: 0.51, ..flat() }), PointClass::Isolated);
        // A rough surface counts as one unless it is sparse; a smooth one does at any sparseness.
        let rough = Measured { roughness: 0.09, coherence: 0.7, ..flat() };
        assert_eq!(class(rough), PointClass::Surface);
        assert_eq!(class(Measured { sparseness: 2.0, ..rough }), PointClass::Surface);
        assert_eq!(class(Measured { sparseness: 8.0, ..rough }), PointClass::Isolated);
        assert_eq!(class(Measured { sparseness: 1e3, ..flat() }), PointClass::Surface);
        for (roughness, coherence) in [(0.051, 1.0), (0.0, 0.89)] {
            let m = Measured { sparseness: 8.1, roughness, coherence, ..flat() };
            assert_eq!(class(m), PointClass::Isolated, "{roughness} {coherence}");
        }
        // Halfway through the range, by ratio.
        let halfway = |roughness| Measured { sparseness: 4.0, roughness, ..flat() };
        assert_eq!((class(halfway(0.074)), class(halfway(0.076))), (PointClass::Surface, PointClass::Isolated));
    }

    #[test]
    fn radii_of_points_in_no_surface_are_small() {
        // The cell reaches far, and most neighbours are far away.
        let m = Measured { spacing: 40.0, second: 1.0, fourth: 2.0, ..flat() };
        let radius = |class: PointClass| class.radius(&m, 100.0);
        assert_eq!(radius(PointClass::Surface), 115.0);
        assert_eq!(radius(PointClass::Border), 3.3);
        assert_eq!(radius(PointClass::Foliage), 3.3);
        for class in [PointClass::Line, PointClass::Isolated] {
            assert_eq!(radius(class), 1.65);
        }
        for class in PointClass::ALL {
            assert_eq!(class.most() < 2.5, !class.is_surface());
        }
    }
}
