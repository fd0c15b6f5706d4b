//! Classes of points, and the table of evidence that decides them.
//!
//! A neighbourhood is measured once ([`Measured`]). Each piece of evidence compares one or two of the measured values
//! with named thresholds, and [`TABLE`] gives the class of every combination of evidence. A class has one rule for the
//! radius ([`PointClass::radius`], limited by [`PointClass::most`]) and one for the normal of a point that has none of
//! its own ([`crate::points`] applies it):
//!
//! | class | radius | normal |
//! | --- | --- | --- |
//! | surface | covers its cell, at least the density radius | of the plane that fits the neighbours |
//! | border | the same, up to the fourth neighbour | the same |
//! | crease | covers its cell, ends where the surface turns | the same |
//! | foliage | up to the fourth neighbour | away from the middle of what is around it |
//! | line | up to the second neighbour | across the line, toward the outside |
//! | isolated | up to the second neighbour | toward the outside |
//!
//! The last three are in no surface: whatever their neighbours are, their disks are no larger than the density radius
//! of the cloud's typical spacing, and half as large again on lines.

/// Radius over the square root of the area per point.
pub(crate) const DENSITY: f64 = 1.65;
/// Radius over the reach of the Voronoi cell: what curvature and tilted neighbours may take away, and a weight of
/// exp(−2/1.15²) = 0.22 instead of exp(−2) = 0.14 at the corner, times the three or more splats that meet there.
pub(crate) const COVER: f64 = 1.15;

/// Kind of place that a point is in, by the points around it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PointClass {
    /// Surrounded by points of the same surface.
    #[default]
    Surface,
    /// At the rim of a surface: no points surround it.
    Border,
    /// In a surface that turns within a disk, or that another one meets.
    Crease,
    /// Among leaves and the like, which lie in no surface.
    Foliage,
    /// On a line of points, in a pair, or in a few that surround nothing.
    Line,
    /// Far from the others, or where neighbours are too sparse and too uneven for a surface.
    Isolated,
}

impl PointClass {
    /// All classes, in the order of their declaration.
    pub const ALL: [Self; 6] = [Self::Surface, Self::Border, Self::Crease, Self::Foliage, Self::Line, Self::Isolated];

    /// The class's name, in lower case.
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

    /// True of the classes whose points are part of a surface.
    pub fn is_surface(self) -> bool {
        matches!(self, Self::Surface | Self::Border | Self::Crease)
    }

    /// Radius that covers a cell whose corners are at most so far, but no less than the density rule's.
    pub(crate) fn covering(self, m: &Measured, reach: f32) -> f32 {
        let largest = if self == Self::Border { LARGEST_AT_BORDER } else { LARGEST };
        (COVER as f32 * reach).clamp(m.least_radius(), (largest * DENSITY) as f32 * m.spacing)
    }

    /// Radius of a disk, from what its neighbourhood measures and how far the corners of its cell are.
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

    /// Largest radius of a disk, in spacings that are typical of the cloud.
    pub(crate) fn most(self) -> f64 {
        match self {
            Self::Surface | Self::Border | Self::Crease => f64::INFINITY,
            Self::Line => LARGEST_ON_LINE * DENSITY,
            Self::Foliage | Self::Isolated => DENSITY,
        }
    }
}

/// No radius exceeds this times that of the density rule: beyond it a gap is one of the scan, not of the sampling.
const LARGEST: f64 = 2.5;
/// The same at a border, where the corners of a cell may lie far outside the surface.
const LARGEST_AT_BORDER: f64 = 1.5;
/// The same of disks on lines, over the density radius of the typical spacing: limbs that few points go around have
/// gaps.
const LARGEST_ON_LINE: f64 = 1.5;
/// Where a surface turns within the radius of the density rule by so many radians (root mean square, over the nearest
/// neighbours), a disk would stick out past the outline. It ends there, but not before it covers its cell, nor before
/// [`LEAST`] over the square root of the area per point.
pub(crate) const FLAT: f32 = 0.7;
const LEAST: f32 = 1.0;

/// A point is alone when its spacing is this many times that of more than half of its neighbours.
pub(crate) const ALONE: f64 = 8.0;
/// Sparseness from which more and more is asked of a surface, and from which the most is: distance of the farthest
/// neighbour, over the cloud's median.
const SPARSE: (f32, f32) = (2.0, 8.0);
/// Mean squared sine of the angle between a tangent plane and the neighbours (18°) beyond which these lie in no plane,
/// of a point that isn't sparse and of the sparsest: of strays beside strays, whose normals may agree by chance, it is
/// 0.17 and more, of sparse parts of scans below 0.05.
pub(crate) const ROUGH: f32 = 0.1;
const ROUGH_WHERE_SPARSE: f32 = 0.05;
/// Mean relation of the nearest normals below which these belong to no surface, of a point that isn't sparse and of the
/// sparsest: of leaves half of them agree by 0.5 at most, of limbs so thin that neighbours go around them by more than
/// 0.8.
const COHERENT: f32 = 0.6;
const COHERENT_WHERE_SPARSE: f32 = 0.9;
/// A point is part of a surface where one in this many has a closed cell, of itself and its neighbours of its side: of
/// 17 at a straight border some 10, in a square's corner 7.
const SURROUNDED: usize = 3;
/// Share of the neighbours in other planes from which a surface is cut: leaves, strays and thin edges.
const CUT: f32 = 0.25;

/// What is measured of one point's neighbourhood. Lengths are in steps.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Measured {
    /// √ of the area per point; where few points are surrounded, the distance of the second neighbour.
    pub(crate) spacing: f32,
    /// Distances of the second neighbour and of the fourth.
    pub(crate) second: f32,
    pub(crate) fourth: f32,
    /// How far the surface reaches until it turns by [`FLAT`].
    pub(crate) flat_reach: f32,
    /// Distance of the farthest neighbour, over the cloud's median.
    pub(crate) sparseness: f32,
    /// Mean squared sine of the angle between the tangent plane and the neighbours.
    pub(crate) roughness: f32,
    /// Mean relation of the normals of the nearest to the point's own; 1 where it wasn't needed.
    pub(crate) coherence: f32,
    /// Share of the neighbours that are [`ALONE`] times closer to each other than the point to them.
    pub(crate) denser: f32,
    /// Neighbours of the point's side and itself, and how many of these have closed cells.
    pub(crate) together: usize,
    pub(crate) closed: usize,
    /// True if the point's own cell is open.
    pub(crate) is_open: bool,
    /// True if points of other scan lines close it, far beyond those of its own.
    pub(crate) is_between_lines: bool,
    /// Share of the neighbours that lie in other planes.
    pub(crate) elsewhere: f32,
}

impl Measured {
    /// Radius that a disk has at least: that of the density rule, less where the surface turns. Between lines that are
    /// far apart a disk only covers its cell: at the last of them it would stick out by more than the gap is wide.
    fn least_radius(&self) -> f32 {
        if self.is_between_lines {
            return 0.0;
        }
        self.flat_reach.clamp(LEAST * self.spacing, DENSITY as f32 * self.spacing)
    }

    /// True where another surface meets the point's own.
    pub(crate) fn is_cut(&self) -> bool {
        self.elsewhere > CUT
    }

    /// True where enough cells are closed for a surface.
    pub(crate) fn is_surrounded(&self) -> bool {
        self.closed > 0 && SURROUNDED * self.closed >= self.together
    }

    /// True where the roughness or the normals of a sparse point say that no surface is there.
    fn is_scattered(&self) -> bool {
        let much = sparse(self.sparseness);
        much > 0.0
            && (self.roughness > between(ROUGH, ROUGH_WHERE_SPARSE, much)
                || self.coherence < between(COHERENT, COHERENT_WHERE_SPARSE, much))
    }

    /// The evidence in it.
    pub(crate) fn evidence(&self) -> Evidence {
        let bent = self.flat_reach < DENSITY as f32 * self.spacing || self.is_cut();
        Evidence::default()
            .with(Evidence::ALONE, self.denser > 0.5)
            .with(Evidence::SCATTERED, self.is_scattered())
            .with(Evidence::TANGLED, self.is_tangled())
            .with(Evidence::UNSURROUNDED, !self.is_surrounded())
            .with(Evidence::OPEN, self.is_open)
            .with(Evidence::BENT, bent)
    }

    /// True where a point's neighbours lie in no plane and their normals disagree.
    fn is_tangled(&self) -> bool {
        self.roughness > ROUGH && self.coherence < COHERENT
    }
}

/// True if the coherence of a neighbourhood with this sparseness and roughness is part of the evidence.
pub(crate) fn needs_coherence(sparseness: f32, roughness: f32) -> bool {
    roughness > ROUGH || sparse(sparseness) > 0.0
}

/// How much sparseness asks for more of a surface, 0 to 1, by its logarithm.
fn sparse(sparseness: f32) -> f32 {
    if sparseness <= SPARSE.0 { 0.0 } else { ((sparseness / SPARSE.0).ln() / (SPARSE.1 / SPARSE.0).ln()).min(1.0) }
}

fn between(from: f32, to: f32, share: f32) -> f32 {
    from + (to - from) * share
}

/// Pieces of evidence about one point, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Evidence(u8);

impl Evidence {
    /// Most neighbours are far closer to each other than to the point, or too few points share its sparseness.
    pub(crate) const ALONE: u8 = 1 << 0;
    /// The point is sparse, and its neighbours lie in no plane or their normals disagree.
    pub(crate) const SCATTERED: u8 = 1 << 1;
    /// The neighbours lie in no plane and their normals disagree.
    pub(crate) const TANGLED: u8 = 1 << 2;
    /// Much of what is around is tangled, and as thick as wide.
    pub(crate) const AMONG_TANGLED: u8 = 1 << 3;
    /// Few cells around are closed.
    pub(crate) const UNSURROUNDED: u8 = 1 << 4;
    /// The point's own cell is open.
    pub(crate) const OPEN: u8 = 1 << 5;
    /// The surface turns within a disk, or another one meets it.
    pub(crate) const BENT: u8 = 1 << 6;
    const COUNT: u32 = 7;

    /// This evidence and another piece, if there is one.
    pub(crate) fn with(self, piece: u8, is_there: bool) -> Self {
        Self(self.0 | if is_there { piece } else { 0 })
    }

    pub(crate) fn has(self, piece: u8) -> bool {
        self.0 & piece != 0
    }

    /// The class of a point with this evidence.
    pub(crate) fn class(self) -> PointClass {
        CLASSES[usize::from(self.0)]
    }
}

/// A row of the table: the class, the evidence that must be there, and the evidence that must not be.
type Row = (PointClass, u8, u8);

/// The class of every combination of evidence: exactly one row fits each.
const TABLE: [Row; 7] = {
    use Evidence as E;
    const NOWHERE: u8 = E::ALONE | E::AMONG_TANGLED | E::SCATTERED;
    [
        (PointClass::Isolated, E::ALONE, 0),
        (PointClass::Foliage, E::AMONG_TANGLED, E::ALONE),
        (PointClass::Isolated, E::SCATTERED, E::ALONE | E::AMONG_TANGLED),
        (PointClass::Line, E::UNSURROUNDED, NOWHERE),
        (PointClass::Border, E::OPEN, NOWHERE | E::UNSURROUNDED),
        (PointClass::Crease, E::BENT, NOWHERE | E::UNSURROUNDED | E::OPEN),
        (PointClass::Surface, 0, NOWHERE | E::UNSURROUNDED | E::OPEN | E::BENT),
    ]
};

/// [`TABLE`] by the bits of the evidence.
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
        // Each class is one of some evidence.
        for class in PointClass::ALL {
            assert!(CLASSES.contains(&class), "{class:?}");
        }
    }

    /// A point of an even, flat surface.
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
        // A rough surface is one, unless it is sparse; a smooth one is one at any sparseness.
        let rough = Measured { roughness: 0.09, coherence: 0.7, ..flat() };
        assert_eq!(class(rough), PointClass::Surface);
        assert_eq!(class(Measured { sparseness: 2.0, ..rough }), PointClass::Surface);
        assert_eq!(class(Measured { sparseness: 8.0, ..rough }), PointClass::Isolated);
        assert_eq!(class(Measured { sparseness: 1e3, ..flat() }), PointClass::Surface);
        for (roughness, coherence) in [(0.051, 1.0), (0.0, 0.89)] {
            let m = Measured { sparseness: 8.1, roughness, coherence, ..flat() };
            assert_eq!(class(m), PointClass::Isolated, "{roughness} {coherence}");
        }
        // Half of the way, by ratio.
        let halfway = |roughness| Measured { sparseness: 4.0, roughness, ..flat() };
        assert_eq!((class(halfway(0.074)), class(halfway(0.076))), (PointClass::Surface, PointClass::Isolated));
    }

    #[test]
    fn radii_of_points_in_no_surface_are_small() {
        // The cell reaches far, and so do most neighbours.
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
