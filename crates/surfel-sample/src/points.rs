//! Conversion of point clouds to splats.
//!
//! A *slot* is a point's place in the order of [`SortedPoints`], and a *grid step* is the unit of its coordinates.

use crate::class::PointClass;
use crate::nearest::Search;
use crate::normals::WIDEST;
use crate::orient::{Oriented, Outside};
use crate::parallel::{for_chunks, map_each, map_tasks};
use crate::radii::{self, Sizes, Spacing};
use crate::sorted::{RUN, SortedPoints};
use crate::{NoProgress, PointOptions, PointReport, Progress, SampleError};
use crate::{assemble, foliage, interior, largest, median, normals, orient};
use glam::{DVec3, Vec3};
use std::borrow::Cow;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{CloudData, Column3, OnInvalid, PointCloud, Shape, SplatCloud, Up};

/// Radius, in object units and before [`PointOptions::radius_scale`], of the splats of a cloud without a spacing: one
/// point, or all points in one place.
const FALLBACK_RADIUS: f64 = 1.0;

/// Comment in a splat file that its splats were made of points. The up axis of a cloud with this comment is estimated
/// as that of a point cloud.
pub const OF_POINTS: &str = "made of points";

/// Largest median of a file's stored radii, in units of the cloud's typical spacing, at which these radii are used for
/// splats.
pub const MAX_SPACINGS: f64 = 5.0;

/// Converts a point cloud to splats, one per point, except for coincident points that the options drop.
///
/// A stored normal (finite, not zero) becomes the disk's normal if it fits the surface that the neighbouring points
/// form. Otherwise the disk gets the normal of the neighbours' plane, on the stored normal's side, and the stored
/// normal becomes the shading normal. Points without normals get estimated normals, oriented by
/// [`PointOptions::viewpoint`].
///
/// Stored radii are used unless their median exceeds [`MAX_SPACINGS`]. All other radii are estimated from the local
/// spacing and the class of the point ([`PointClass`]), so that surfaces have no holes and other points stay small. If
/// the sampling is stretched (scan lines), splats are ellipses, and the whole cloud is [`Shape::Ellipses`]. It is
/// [`Shape::Disks`] if stored radii are used, or if [`PointOptions::ellipses`] is false.
///
/// Order, origin, colours, alphas, extras, up axis and comments are copied, and the cloud's `interior_weight` is
/// estimated unless [`PointOptions::interior_weight`] is false. The cloud is declared oriented if no normal is stored,
/// because estimated normals all point to the outside of a surface.
///
/// Coincident points get the same splat, apart from stored normals and radii. A single point, or points that all
/// coincide, get a radius of 1 times [`PointOptions::radius_scale`] unless one is stored.
///
/// Sources: normals by principal component analysis (Hoppe et al. 1992, §3.2); signs by votes between neighbours, which
/// are compared as in König and Gumhold 2009; radii and classes are our own.
///
/// # Errors
/// [`SampleError::Empty`] without points, [`SampleError::NotFinite`] if [`PointCloud::drop_non_finite`] was not called,
/// [`SampleError::Option`] for options out of range, [`SampleError::TooMany`] above 268 million points, and
/// [`SampleError::Model`] for columns of unequal length or invalid colours.
pub fn splats_from_points(
    points: &PointCloud,
    options: &PointOptions,
    progress: &dyn Progress,
) -> Result<(SplatCloud, PointReport), SampleError> {
    options.check()?;
    points.check_columns()?;
    if points.is_empty() {
        return Err(SampleError::Empty { what: "point cloud", missing: "points" });
    }
    progress.stage("sorting", points.len() as u64);
    let sorted = SortedPoints::new(points.len(), |i| points.positions.get(i))?;
    progress.advance(points.len() as u64);

    let mut report = PointReport { duplicates: points.len() - sorted.len(), ..PointReport::default() };
    let given = GivenNormals(points.normals.as_ref());
    report.normals_given = given.count();
    report.normals_estimated = points.len() - report.normals_given;
    let degree = options.neighbours.min(sorted.len() - 1);
    let outside = match options.viewpoint.or(points.viewpoint) {
        Some(v) => Outside::Toward((v - points.origin - sorted.center) / sorted.step),
        None => Outside::Outward { up: points.up.map_or(DVec3::Z, Up::vector), is_certain: points.up.is_some() },
    };
    let mut layout = orient_disks(&given, &sorted, degree, (outside, options), progress);
    let lone = Spacing::Unknown(FALLBACK_RADIUS / radii::DENSITY / sorted.step);
    let mut sizes =
        radii::sizes(&sorted, (&layout.oriented, &layout.is_level), degree, lone, options.ellipses, progress);
    let is_given = |slot: usize| sorted.inputs(slot).iter().any(|i| given.get(*i as usize).is_some());
    if report.normals_estimated > 0 && !options.level_where_scattered {
        foliage::find(&sorted, &mut layout.oriented, &mut sizes, is_given, outside);
    }
    largest::shorten(&sorted, &mut sizes);
    face_outside(&sorted, &mut layout.oriented, &sizes, is_given, outside);
    report.classes = classes(&sorted, &sizes);
    report.isolated = report.classes[PointClass::Isolated as usize];
    let is_off = |i: &u32| given.get(*i as usize).is_some();
    let off = (0..sorted.len()).filter(|slot| layout.is_off(*slot));
    report.normals_off = off.map(|slot| sorted.inputs(slot).iter().filter(|i| is_off(i)).count()).sum();
    let (slots, scale) = (sorted.len(), sorted.step * options.radius_scale);
    // If all points are in one place, there is no spacing.
    let spacing = if slots > 1 { sizes.typical * sorted.step } else { f64::INFINITY };
    let given_radii = points.radii.as_deref().and_then(|radii| GivenRadii::new(radii, spacing, options, &mut report));
    let slot_of = sorted.into_slots();

    let mut source = Cow::Borrowed(points);
    let mut kept: Option<Vec<u32>> = None;
    if report.duplicates >= options.coincident.max(1) {
        let mut in_slot = vec![0_usize; slots];
        let mut keep = vec![true; points.len()];
        for (keep, slot) in keep.iter_mut().zip(&slot_of) {
            let slot = *slot as usize;
            in_slot[slot] += 1;
            *keep = in_slot[slot] <= options.coincident.max(1);
            report.left_out += usize::from(!*keep);
        }
        source.to_mut().retain(&keep);
        kept = Some((0..points.len() as u32).filter(|i| keep[*i as usize]).collect());
    }
    report.splats = source.len();
    report.ellipses = sizes.stretched;
    let made = Converted { slot_of, kept, layout, given, given_radii, scale };
    if options.level_where_scattered {
        let is_level = |i: &u32| made.layout.is_level(made.place(*i as usize).1);
        report.level = (0..report.splats as u32).filter(is_level).collect();
    }
    let shading_normals = made.shading_normals(report.splats);
    let shape = made.shape(sizes, &mut report);

    let source = source.into_owned();
    let data = CloudData {
        colors: source.colors,
        alphas: source.alphas,
        shading_normals,
        up: source.up,
        rows: source.rows,
        extras: source.extras,
        comments: source.comments,
        oriented: report.normals_given == 0,
        ..CloudData::new(source.origin, source.positions, shape)
    };
    let (mut splats, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    if options.interior_weight {
        progress.stage("interior weight", 1);
        report.interior_weight = interior::interior_weight(&splats);
    }
    if let Some(weight) = report.interior_weight {
        splats.set_interior_weight(weight);
    }
    progress.advance(1);
    Ok((splats, report))
}

/// Column of normals stored in a file, if there is one; zero and non-finite normals count as missing.
struct GivenNormals<'a>(Option<&'a Column3>);

impl GivenNormals<'_> {
    fn get(&self, i: usize) -> Option<DVec3> {
        self.0.map(|c| c.get(i)).filter(|n| n.is_finite() && *n != DVec3::ZERO)
    }

    /// Returns the number of usable normals.
    fn count(&self) -> usize {
        self.0.map_or(0, |c| (0..c.len()).filter(|i| self.get(*i).is_some()).count())
    }
}

/// Radii stored in a file, if they are usable as splat radii.
struct GivenRadii<'a> {
    radii: &'a [f32],
    scale: f64,
}

impl<'a> GivenRadii<'a> {
    /// Checks the stored radii of a cloud with this spacing, in object units. `None` if no radius is valid, or if the
    /// radii are too large ([`MAX_SPACINGS`]), which is reported.
    fn new(radii: &'a [f32], spacing: f64, options: &PointOptions, report: &mut PointReport) -> Option<Self> {
        let is_radius = |r: f32| r > 0.0 && r.is_finite();
        let value = |i: usize| if is_radius(radii[i]) { radii[i] } else { 0.0 };
        let times = f64::from(median::median_of(radii.len(), value)?) / spacing;
        if times > MAX_SPACINGS {
            report.radii_too_large = Some(times);
            return None;
        }
        Some(Self { radii, scale: options.radius_scale })
    }

    /// Returns the scaled radius of a point; `None` if the point has no valid radius.
    fn get(&self, i: usize) -> Option<f32> {
        let radius = self.radii.get(i).copied().filter(|r| *r > 0.0 && r.is_finite())?;
        Some(assemble::radius32(f64::from(radius) * self.scale))
    }
}

/// Normals of the splats' disks, one per slot (distinct position), and flags that tell how they were found.
struct Layout {
    oriented: Vec<Oriented>,
    /// Flag per slot, true if the neighbours form no plane and the estimated normal therefore points up. Empty if there
    /// are no such slots.
    is_level: Vec<bool>,
    /// Flag per slot, true if its stored normal doesn't fit the neighbours, so that the disk has another normal. Empty
    /// if all stored normals fit.
    is_off: Vec<bool>,
}

impl Layout {
    fn is_level(&self, slot: usize) -> bool {
        self.is_level.get(slot).copied().unwrap_or(false)
    }

    fn is_off(&self, slot: usize) -> bool {
        self.is_off.get(slot).copied().unwrap_or(false)
    }
}

/// Computes the normal of each slot's disk: the first stored normal of the slot's points if it fits the neighbours or
/// if [`PointOptions::lays_by_normals`] is set, else the normal of the neighbours' plane.
fn orient_disks(
    given: &GivenNormals,
    sorted: &SortedPoints,
    degree: usize,
    (outside, options): (Outside, &PointOptions),
    progress: &dyn Progress,
) -> Layout {
    let level_where_scattered = options.level_where_scattered;
    let known = given.0.map(|_| {
        let normal = |slot: usize| {
            let first = sorted.inputs(slot).iter().find_map(|i| given.get(*i as usize));
            first.map_or(Vec3::ZERO, |n| unit(n).as_vec3())
        };
        map_each(sorted.len(), &NoProgress, || (), |(), slot| normal(slot))
    });
    let Some(known) = known else {
        let (oriented, is_level) = orient::normals(sorted, degree, None, outside, level_where_scattered, progress);
        return Layout { oriented, is_level, is_off: Vec::new() };
    };
    let (mut oriented, is_level) = if known.contains(&Vec3::ZERO) {
        orient::normals(sorted, degree, Some(&known), outside, level_where_scattered, progress)
    } else {
        progress.stage("normals", sorted.len() as u64);
        let mut oriented = vec![Oriented::default(); sorted.len()];
        for_chunks(&mut oriented, RUN, &|first, chunk| {
            let mut search = Search::new(sorted);
            for (slot, o) in (first..).zip(chunk.iter_mut()) {
                let (near, farthest2) = search.nearest(slot, degree, 0.0);
                let normal = normals::fitted_stored_normal(sorted, slot, near, known[slot], |other| known[other]);
                *o = Oriented { normal, farthest2 };
            }
            progress.advance(chunk.len() as u64);
        });
        (oriented, Vec::new())
    };
    if options.lays_by_normals {
        let given = oriented.iter_mut().zip(&known).filter(|(_, normal)| **normal != Vec3::ZERO);
        given.for_each(|(o, normal)| o.normal = *normal);
    }
    let is_off = |slot: usize| known[slot] != Vec3::ZERO && known[slot] != oriented[slot].normal;
    let is_off = if (0..sorted.len()).any(is_off) { (0..sorted.len()).map(is_off).collect() } else { Vec::new() };
    Layout { oriented, is_level, is_off }
}

/// Counts the input points of each class, in the order of [`PointClass::ALL`].
fn classes(sorted: &SortedPoints, sizes: &Sizes) -> [usize; PointClass::ALL.len()] {
    let parts = map_tasks(sorted.len().div_ceil(RUN), |task| {
        let mut counts = [0; PointClass::ALL.len()];
        for slot in task * RUN..sorted.len().min((task + 1) * RUN) {
            counts[sizes.class(slot) as usize] += sorted.inputs(slot).len();
        }
        counts
    });
    std::array::from_fn(|class| parts.iter().map(|counts| counts[class]).sum())
}

/// Replaces the normals of isolated points and of points on lines, unless a normal is stored (`is_given`). Isolated
/// points face the outside. Normals on a line are perpendicular to the line, and face the outside as far as possible.
/// They are unchanged if the neighbours aren't collinear ([`normals::across_line`]).
fn face_outside(
    sorted: &SortedPoints,
    oriented: &mut [Oriented],
    sizes: &Sizes,
    is_given: impl Fn(usize) -> bool,
    outside: Outside,
) {
    let is_concerned = |slot: &usize| matches!(sizes.class(*slot), PointClass::Line | PointClass::Isolated);
    let slots: Vec<usize> = (0..sorted.len()).filter(is_concerned).filter(|slot| !is_given(*slot)).collect();
    let normal = |search: &mut Search, i: usize| {
        let toward = outside.at(sorted.point(slots[i]));
        if sizes.class(slots[i]) == PointClass::Isolated {
            return Some(toward);
        }
        let (near, _) = search.nearest(slots[i], WIDEST, 0.0);
        normals::across_line(sorted, slots[i], near, toward)
    };
    let found = map_each(slots.len(), &NoProgress, || Search::new(sorted), normal);
    for (slot, normal) in slots.iter().zip(found) {
        oriented[*slot].normal = normal.map_or(oriented[*slot].normal, DVec3::as_vec3);
    }
}

/// Results of the conversion, except for the splats' sizes, from which the columns of the cloud are built.
struct Converted<'a> {
    slot_of: Vec<u32>,
    /// Input index of each splat; `None` if every input point became a splat, so that both indices are the same.
    kept: Option<Vec<u32>>,
    layout: Layout,
    given: GivenNormals<'a>,
    given_radii: Option<GivenRadii<'a>>,
    /// Factor from grid steps to object units, times [`PointOptions::radius_scale`].
    scale: f64,
}

impl Converted<'_> {
    /// Returns the input index of splat `i`, and the slot of its position.
    fn place(&self, i: usize) -> (usize, usize) {
        let input = self.kept.as_ref().map_or(i, |kept| kept[i] as usize);
        (input, self.slot_of[input] as usize)
    }

    /// Returns the normal of an input point's disk. The stored normal is used if it fits the neighbours of its slot,
    /// else the slot's normal on the same side.
    fn disk_normal(&self, input: usize, slot: usize) -> Vec3 {
        let own = self.layout.oriented[slot].normal;
        // A stored normal may be too short or too long for f32.
        match self.shading_normal(input) {
            Some(normal) if self.layout.is_off(slot) => own * 1.0_f32.copysign(own.dot(normal)),
            Some(normal) => normal,
            None => own,
        }
    }

    /// Returns the stored normal of an input point, if it is usable in f32.
    fn shading_normal(&self, input: usize) -> Option<Vec3> {
        self.given.get(input).map(DVec3::as_vec3).filter(|n| n.is_finite() && *n != Vec3::ZERO)
    }

    /// Returns the shading normals; `None` if all are equal to the normals of the disks.
    fn shading_normals(&self, count: usize) -> Option<Column3> {
        let normal = |i: usize| {
            let (input, slot) = self.place(i);
            self.shading_normal(input).unwrap_or(self.layout.oriented[slot].normal)
        };
        let is_wanted = !self.layout.is_off.is_empty();
        is_wanted.then(|| Column3::from_f32(map_each(count, &NoProgress, || (), |(), i| normal(i))))
    }

    /// Returns the shape of all splats, disks or ellipses, and completes the report. The sizes are freed before the
    /// normals are allocated, to save memory.
    fn shape(self, sizes: Sizes, report: &mut PointReport) -> Shape {
        let count = report.splats;
        let given_radius = |i: usize| self.given_radii.as_ref()?.get(self.place(i).0);
        if self.given_radii.is_some() {
            report.radii_given = (0..count).filter(|i| given_radius(*i).is_some()).count();
        }
        let estimated = |i: usize| assemble::radius32(sizes.radius(self.place(i).1) * self.scale);
        let radius = |i: usize| given_radius(i).unwrap_or_else(|| estimated(i));
        if sizes.stretched == 0 || self.given_radii.is_some() {
            report.ellipses = 0;
            let radii = map_each(count, &NoProgress, || (), |(), i| radius(i));
            drop(sizes);
            report.median_radius = median::median_of(count, |i| radii[i]).map_or(0.0, f64::from);
            let normal = |i: usize| {
                let (input, slot) = self.place(i);
                self.disk_normal(input, slot)
            };
            let normals = Column3::from_f32(map_each(count, &NoProgress, || (), |(), i| normal(i)));
            return Shape::Disks { normals, radii };
        }
        report.median_radius = median::median_of(count, radius).map_or(0.0, f64::from);
        let axes = |i: usize| {
            let (input, slot) = self.place(i);
            let own = self.layout.oriented[slot].normal.as_dvec3();
            let (s, t) = sizes.axes(slot, own);
            let (s, t) = (s * self.scale, t * self.scale);
            // Coincident points share a slot, but not always a normal.
            let normal = match self.given.get(input) {
                Some(_) if self.layout.is_off(slot) => self.disk_normal(input, slot).as_dvec3(),
                given => given.map_or(own, unit),
            };
            match normal.dot(own) {
                same if same > 0.999 => (s, t),
                opposite if opposite < -0.999 => (s, -t),
                _ => {
                    let (u, v) = orthonormal(normal);
                    let radius = (s.length() * t.length()).sqrt();
                    (u * radius, v * radius)
                }
            }
        };
        let half = |i: usize| {
            let (s, t) = axes(i);
            (s.as_vec3(), t.as_vec3())
        };
        Shape::Ellipses {
            s: Column3::from_f32(map_each(count, &NoProgress, || (), |(), i| half(i).0)),
            t: Column3::from_f32(map_each(count, &NoProgress, || (), |(), i| half(i).1)),
        }
    }
}
