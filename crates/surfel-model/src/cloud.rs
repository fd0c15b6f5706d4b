//! Splat clouds as structures of arrays: an absent attribute needs no memory.

use crate::column::{retain, retain_rows};
use crate::{BallLight, ClipColumns, Column3, ExtraColumn, ModelError, Up};
use glam::{DVec3, Vec3};

/// Shape of a cloud's splats, with the columns that define it (rendering model §2).
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Circular disks.
    Disks {
        /// Outward normals in object space, of any length but zero; one per splat.
        normals: Column3,
        /// Radii in object units, greater than 0; one per splat.
        radii: Vec<f32>,
    },
    /// Elliptical disks p + u·s + v·t, u² + v² ≤ 1, with outward normal s × t.
    Ellipses {
        /// Half-axes s in object units, one per splat; s and t may be any conjugate pair of the ellipse.
        s: Column3,
        /// Half-axes t in object units, one per splat.
        t: Column3,
    },
    /// Balls or dots (rendering model §11).
    Balls {
        /// Radii in object units or in pixels, greater than 0; one per splat.
        radii: Vec<f32>,
        /// True if radii are in pixels of the image, false if they are in object units.
        in_pixels: bool,
        /// True for dots, which are disks parallel to the image; false for balls, which are spheres.
        flat: bool,
    },
}

/// Columns from which a cloud is built, not yet validated.
#[derive(Clone, Debug, PartialEq)]
pub struct CloudData {
    /// Origin of the centres in object space, in object units (f64, to preserve the precision of georeferenced data).
    pub origin: DVec3,
    /// Centres relative to `origin`, in object units; one per splat.
    pub centers: Column3,
    /// Shape, size and orientation of the splats.
    pub shape: Shape,
    /// Linear RGB albedo, one per splat; white when absent.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Alpha in [0, 1], one per splat; opaque when absent.
    pub alphas: Option<Vec<f32>>,
    /// Shading normals in object space, of any length but zero, one per splat; the outward normal when absent.
    pub shading_normals: Option<Column3>,
    /// Light stored in balls, one entry per ball; the shader `unlit` multiplies the balls' colours by it. Other splats
    /// store light in their colours.
    pub ball_light: Option<Vec<BallLight>>,
    /// Clip curves and lines, which cut splats along sharp edges; `None` if no splat is clipped.
    pub clips: Option<ClipColumns>,
    /// Typical sum of the kernel weights w = e^(−2ρ²) of all splats that overlap at a place inside the cloud's surface,
    /// greater than 0. ρ is 0 at a splat's centre and 1 at its rim. A pixel's coverage is its own sum of weights
    /// relative to this value (rendering model §5, coverage). `None` if unknown.
    pub interior_weight: Option<f64>,
    /// True if all normals point to the outside of the same surface. Front and back faces are then blended separately
    /// (rendering model §5).
    pub oriented: bool,
    /// Up axis of the cloud's coordinates; `None` if unknown.
    pub up: Option<Up>,
    /// Row of each splat in the input, shown in the plane `index`. `None` if a splat's row is its own index, or if rows
    /// aren't needed. Renderers store rows that are present, at 4 bytes per splat.
    pub rows: Option<Vec<u32>>,
    /// Label of each splat, shown in the plane `label`; [`NO_LABEL`] for none. `None` if no splat has a label.
    pub labels: Option<Vec<u32>>,
    /// Columns of the file that Surfel doesn't interpret, stored so that writing the file again loses nothing.
    pub extras: Vec<ExtraColumn>,
    /// Comment lines of the file.
    pub comments: Vec<String>,
}

impl CloudData {
    /// Creates column data with only centres and shape. All other columns are absent.
    pub fn new(origin: DVec3, centers: Column3, shape: Shape) -> Self {
        Self {
            origin,
            centers,
            shape,
            colors: None,
            alphas: None,
            shading_normals: None,
            ball_light: None,
            clips: None,
            interior_weight: None,
            oriented: false,
            up: None,
            rows: None,
            labels: None,
            extras: Vec::new(),
            comments: Vec::new(),
        }
    }

    /// Drops the splats whose flag is false, and records the input rows of the others.
    pub fn retain(&mut self, keep: &[bool]) {
        retain_rows(&mut self.rows, keep);
        if let Some(labels) = &mut self.labels {
            retain(labels, keep);
        }
        self.centers.retain(keep);
        match &mut self.shape {
            Shape::Disks { normals, radii } => {
                normals.retain(keep);
                retain(radii, keep);
            }
            Shape::Ellipses { s, t } => {
                s.retain(keep);
                t.retain(keep);
            }
            Shape::Balls { radii, .. } => retain(radii, keep),
        }
        if let Some(c) = &mut self.colors {
            retain(c, keep);
        }
        if let Some(c) = &mut self.alphas {
            retain(c, keep);
        }
        if let Some(c) = &mut self.shading_normals {
            c.retain(keep);
        }
        if let Some(c) = &mut self.ball_light {
            retain(c, keep);
        }
        if let Some(clips) = &mut self.clips {
            if let Some(c) = &mut clips.curves {
                retain(c, keep);
            }
            if let Some(c) = &mut clips.lines {
                retain(c, keep);
            }
            if let Some(c) = &mut clips.modes {
                retain(c, keep);
            }
        }
        for e in &mut self.extras {
            e.values.retain(keep);
        }
    }

    fn check_columns(&self) -> Result<(), ModelError> {
        let expected = self.centers.len();
        let clips = self.clips.as_ref();
        let (shape, second) = match &self.shape {
            Shape::Disks { normals, radii } => (("normals", normals.len()), ("radii", radii.len())),
            Shape::Ellipses { s, t } => (("s", s.len()), ("t", t.len())),
            Shape::Balls { radii, .. } => (("radii", radii.len()), ("radii", radii.len())),
        };
        let columns = [
            Some(shape),
            Some(second),
            self.colors.as_ref().map(|c| ("colors", c.len())),
            self.alphas.as_ref().map(|c| ("alphas", c.len())),
            self.shading_normals.as_ref().map(|c| ("shading_normals", c.len())),
            self.ball_light.as_ref().map(|c| ("ball_light", c.len())),
            clips.and_then(|c| c.curves.as_ref()).map(|c| ("clip curves", c.len())),
            clips.and_then(|c| c.lines.as_ref()).map(|c| ("clip lines", c.len())),
            clips.and_then(|c| c.modes.as_ref()).map(|c| ("clip modes", c.len())),
            self.rows.as_ref().map(|c| ("rows", c.len())),
            self.labels.as_ref().map(|c| ("labels", c.len())),
            self.extras.iter().map(|e| ("extras", e.values.len())).find(|c| c.1 != expected),
        ];
        match columns.into_iter().flatten().find(|c| c.1 != expected) {
            Some((column, found)) => Err(ModelError::ColumnLength { column, found, expected }),
            None => Ok(()),
        }
    }

    /// Returns a description of what makes splat `i` invalid (rendering model §10), or `None` if it is valid.
    fn problem(&self, i: usize) -> Option<String> {
        let p = self.centers.get(i);
        if !p.is_finite() {
            return Some(format!("its position ({}, {}, {}) is not finite", p.x, p.y, p.z));
        }
        if let Shape::Disks { radii, .. } | Shape::Balls { radii, .. } = &self.shape
            && (!radii[i].is_finite() || radii[i] <= 0.0)
        {
            return Some(format!("its radius is {}, expected a finite number greater than 0", radii[i]));
        }
        match &self.shape {
            Shape::Balls { .. } => {}
            Shape::Disks { normals, .. } => {
                let n = normals.get(i);
                if !n.is_finite() || n == DVec3::ZERO {
                    return Some(format!("its normal is ({}, {}, {}), expected finite and not zero", n.x, n.y, n.z));
                }
            }
            Shape::Ellipses { s, t } => {
                for (name, a) in [("s", s.get(i)), ("t", t.get(i))] {
                    if !a.is_finite() || a == DVec3::ZERO {
                        let expected = "expected finite and not zero";
                        return Some(format!("its half-axis {name} is ({}, {}, {}), {expected}", a.x, a.y, a.z));
                    }
                }
                let (a, b) = (s.get(i), t.get(i));
                // Scaled to unit length first, so that tiny splats aren't mistaken for degenerate ones. Below 1e-12 the
                // plane's direction is lost in the rounding of f32 axes at any usable aspect ratio.
                let (a, b) = (a / a.abs().max_element(), b / b.abs().max_element());
                if a.normalize().cross(b.normalize()).length() < 1e-12 {
                    return Some("its half-axes are parallel, so it has no normal".into());
                }
            }
        }
        if let Some(n) = self.shading_normals.as_ref().map(|c| c.get(i))
            && (!n.is_finite() || n == DVec3::ZERO)
        {
            return Some(format!("its shading normal is ({}, {}, {}), expected finite and not zero", n.x, n.y, n.z));
        }
        if let Some(c) = self.colors.as_ref().map(|c| c[i])
            && c.iter().any(|c| !c.is_finite())
        {
            return Some(format!("its colour is {c:?}, expected finite numbers"));
        }
        if let Some(a) = self.alphas.as_ref().map(|a| a[i])
            && !(0.0..=1.0).contains(&a)
        {
            return Some(format!("its alpha is {a}, expected a number in [0, 1]"));
        }
        if let Some(light) = self.ball_light.as_ref().map(|c| c[i])
            && light.to_array().iter().any(|x| !x.is_finite())
        {
            return Some("its stored light is not finite".into());
        }
        self.clip_problem(i)
    }

    fn clip_problem(&self, i: usize) -> Option<String> {
        let clips = self.clips.as_ref()?;
        if let Some(c) = clips.curves.as_ref().map(|c| c[i]).filter(|c| !c.w.is_nan()) {
            if c.w < 0.0 || c.w.is_infinite() {
                return Some(format!(
                    "its clip_w is {}, expected a finite number of at least 0, or NaN for no clip",
                    c.w
                ));
            }
            if [c.theta1, c.theta3, c.u, c.v].iter().any(|x| !x.is_finite()) {
                return Some("its clip curve has a coordinate that is not finite".into());
            }
        }
        let lines = clips.lines.as_ref().map(|l| l[i])?;
        lines
            .iter()
            .any(|l| [l.a, l.b, l.c].iter().any(|x| x.is_infinite()))
            .then(|| "its clip line has an infinite coefficient".into())
    }
}

/// Number that means "none" in the planes `index`, `object` and `label`, and in the column [`CloudData::labels`].
pub const NO_LABEL: u32 = u32::MAX;

/// Handling of invalid splats (rendering model §10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnInvalid {
    /// The whole cloud is rejected with an error that names the first invalid splat.
    Refuse,
    /// The invalid splats are dropped and counted.
    Drop,
}

/// Report of the splats that [`SplatCloud::new`] dropped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repaired {
    /// Number of splats dropped.
    pub dropped: usize,
    /// Index of the first dropped splat in the input, and its problem; `None` if no splat was dropped.
    pub first: Option<(usize, String)>,
}

/// A validated splat cloud.
///
/// ```
/// use surfel_model::SplatCloud;
/// let (centers, normals, radii) = ([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]], [[0.0, 0.0, 1.0]; 2], [0.4, 0.4]);
/// let cloud = SplatCloud::disks(&centers, &normals, &radii)?.with_colors(&[[0.8, 0.1, 0.1], [0.1, 0.1, 0.8]])?;
/// assert_eq!(cloud.len(), 2);
/// # Ok::<(), surfel_model::ModelError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SplatCloud {
    data: CloudData,
}

/// Minimum number of splats per task when splats are validated in parallel. Smaller clouds are validated on one thread,
/// because starting threads would take longer.
#[cfg(feature = "rayon")]
const SPLATS_PER_VALIDATION_TASK: usize = 1 << 14;

/// Returns the index of the first invalid splat, if any.
fn first_invalid(data: &CloudData) -> Option<usize> {
    let count = data.centers.len();
    let is_invalid = |i: &usize| data.problem(*i).is_some();
    #[cfg(feature = "rayon")]
    if count > SPLATS_PER_VALIDATION_TASK {
        use rayon::prelude::*;
        return (0..count).into_par_iter().with_min_len(SPLATS_PER_VALIDATION_TASK).find_first(is_invalid);
    }
    (0..count).find(is_invalid)
}

/// Advice at the end of error messages, for programs whose own splats are invalid.
const ADVICE: &str = "correct them, or have SplatCloud::new drop them by OnInvalid::Drop";

/// Converts vectors to a column of f32 values.
fn column<V: Copy + Into<[f32; 3]>>(vectors: &[V]) -> Column3 {
    Column3::from_f32(vectors.iter().map(|v| Vec3::from((*v).into())).collect())
}

impl SplatCloud {
    /// Creates opaque white disks: centres and radii (greater than 0) in object units, outward normals of any length
    /// but zero. Vectors are `[f32; 3]`, [`glam::Vec3`], or any other type that converts to arrays.
    ///
    /// # Errors
    /// [`ModelError::InvalidElements`] naming the first invalid splat and their number, [`ModelError::ColumnLength`]
    /// naming the column whose length differs from `centers`.
    pub fn disks<C: Copy + Into<[f32; 3]>, N: Copy + Into<[f32; 3]>>(
        centers: &[C],
        normals: &[N],
        radii: &[f32],
    ) -> Result<Self, ModelError> {
        let shape = Shape::Disks { normals: column(normals), radii: radii.to_vec() };
        Self::checked(CloudData::new(DVec3::ZERO, column(centers), shape))
    }

    /// Creates opaque white balls (rendering model §11): centres and radii (greater than 0) in object units.
    ///
    /// # Errors
    /// [`ModelError::InvalidElements`] naming the first invalid ball and their number, [`ModelError::ColumnLength`]
    /// naming the column whose length differs from `centers`.
    pub fn balls<C: Copy + Into<[f32; 3]>>(centers: &[C], radii: &[f32]) -> Result<Self, ModelError> {
        let shape = Shape::Balls { radii: radii.to_vec(), in_pixels: false, flat: false };
        Self::checked(CloudData::new(DVec3::ZERO, column(centers), shape))
    }

    /// Creates opaque white ellipses: splat i is `centers[i]` + u·`s[i]` + v·`t[i]`, u² + v² ≤ 1, in object units, with
    /// outward normal s × t.
    ///
    /// # Errors
    /// [`ModelError::InvalidElements`] naming the first invalid splat (half-axes are parallel or zero, or a number
    /// isn't finite) and their number, [`ModelError::ColumnLength`] naming the column whose length differs from
    /// `centers`.
    pub fn ellipses<C: Copy + Into<[f32; 3]>, A: Copy + Into<[f32; 3]>>(
        centers: &[C],
        s: &[A],
        t: &[A],
    ) -> Result<Self, ModelError> {
        let shape = Shape::Ellipses { s: column(s), t: column(t) };
        Self::checked(CloudData::new(DVec3::ZERO, column(centers), shape))
    }

    /// Sets the linear RGB albedo of each splat.
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] if the number of colours isn't the number of splats,
    /// [`ModelError::InvalidElements`] if a number isn't finite.
    pub fn with_colors<C: Copy + Into<[f32; 3]>>(mut self, colors: &[C]) -> Result<Self, ModelError> {
        self.data.colors = Some(colors.iter().map(|c| (*c).into()).collect());
        Self::checked(self.data)
    }

    /// Sets the alpha of each splat, in [0, 1].
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] if the number of alphas isn't the number of splats, [`ModelError::InvalidElements`]
    /// if an alpha is out of range.
    pub fn with_alphas(mut self, alphas: &[f32]) -> Result<Self, ModelError> {
        self.data.alphas = Some(alphas.to_vec());
        Self::checked(self.data)
    }

    /// Sets the shading normal of each splat, of any length but zero.
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] if the number of normals isn't the number of splats,
    /// [`ModelError::InvalidElements`] if a normal is zero or not finite.
    pub fn with_shading_normals<N: Copy + Into<[f32; 3]>>(mut self, normals: &[N]) -> Result<Self, ModelError> {
        self.data.shading_normals = Some(column(normals));
        Self::checked(self.data)
    }

    /// Sets clip curves and lines, in the splats' half-axes; only ellipses can have them.
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] if a column's length isn't the number of splats, [`ModelError::Conflict`] for disks
    /// and balls, [`ModelError::InvalidElements`] for numbers out of range.
    pub fn with_clips(mut self, clips: ClipColumns) -> Result<Self, ModelError> {
        self.data.clips = Some(clips);
        Self::checked(self.data)
    }

    /// Sets the origin of the centres, in object units (f64, to preserve the precision of georeferenced data).
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] if a coordinate isn't finite.
    pub fn with_origin(mut self, origin: impl Into<DVec3>) -> Result<Self, ModelError> {
        self.data.origin = origin.into();
        Self::checked(self.data)
    }

    /// Sets the row of each splat in the input, shown in the plane `index`. If splats are their own rows, use
    /// [`Self::number_rows`].
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] if the number of rows isn't the number of splats.
    pub fn with_rows(mut self, rows: &[u32]) -> Result<Self, ModelError> {
        self.data.rows = Some(rows.to_vec());
        Self::checked(self.data)
    }

    /// Sets the label of each splat, shown in the plane `label`; [`NO_LABEL`] for none.
    ///
    /// # Errors
    /// [`ModelError::ColumnLength`] if the number of labels isn't the number of splats.
    pub fn with_labels(mut self, labels: &[u32]) -> Result<Self, ModelError> {
        self.data.labels = Some(labels.to_vec());
        Self::checked(self.data)
    }

    /// Numbers the splats if they have no rows, so that renderers store rows for the planes `index` and `label`: 4
    /// bytes per splat.
    pub fn number_rows(&mut self) {
        let count = self.len() as u32;
        self.data.rows.get_or_insert_with(|| (0..count).collect());
    }

    /// Drops the splats' row numbers in the input, which saves renderers 4 bytes per splat. The plane `index` then
    /// shows each splat's own index.
    pub fn discard_rows(&mut self) {
        self.data.rows = None;
    }

    /// Sets the label of each splat, shown in the plane `label`; [`NO_LABEL`] for none. Ignored if the number of labels
    /// isn't the number of splats.
    pub fn set_labels(&mut self, labels: Vec<u32>) {
        if labels.len() == self.len() {
            self.data.labels = Some(labels);
        }
    }

    fn checked(data: CloudData) -> Result<Self, ModelError> {
        match Self::new(data, OnInvalid::Refuse) {
            Ok((cloud, _)) => Ok(cloud),
            Err(ModelError::InvalidElements { what, index, problem, count, total, .. }) => {
                Err(ModelError::InvalidElements { what, index, problem, count, total, advice: ADVICE })
            }
            Err(error) => Err(error),
        }
    }

    /// Validates `data` (rendering model §10) and creates a cloud.
    ///
    /// # Errors
    /// [`ModelError::InvalidElements`] naming the first invalid splat and their number, [`ModelError::ColumnLength`]
    /// for a column of the wrong length, [`ModelError::OutOfRange`] for a number of the whole cloud, and
    /// [`ModelError::Conflict`] for clipped disks or balls and for [`CloudData::ball_light`] of other splats than
    /// balls.
    pub fn new(mut data: CloudData, on_invalid: OnInvalid) -> Result<(Self, Repaired), ModelError> {
        data.check_columns()?;
        if data.clips.is_some() && !matches!(data.shape, Shape::Ellipses { .. }) {
            let message = "clip curves and lines need the half-axes s and t: a disk (normal and radius) or a ball has \
                           none to measure them in";
            return Err(ModelError::Conflict(message.into()));
        }
        if data.ball_light.is_some() && !matches!(data.shape, Shape::Balls { .. }) {
            let message = "only balls store light besides their colours: multiply the colours of other splats by it";
            return Err(ModelError::Conflict(message.into()));
        }
        if !data.origin.is_finite() {
            return Err(ModelError::range("origin", data.origin, "finite coordinates"));
        }
        if let Some(w) = data.interior_weight
            && !(w > 0.0 && w.is_finite())
        {
            return Err(ModelError::range("interior_weight", w, "a finite number greater than 0"));
        }
        let total = data.centers.len();
        let mut repaired = Repaired::default();
        let mut keep = Vec::new();
        for i in first_invalid(&data).map_or(total..total, |first| first..total) {
            if let Some(problem) = data.problem(i) {
                if repaired.first.is_none() {
                    keep = vec![true; total];
                    repaired.first = Some((i, problem));
                }
                keep[i] = false;
                repaired.dropped += 1;
            }
        }
        match (&repaired.first, on_invalid) {
            (None, _) => {}
            (Some((index, problem)), OnInvalid::Refuse) => {
                return Err(ModelError::InvalidElements {
                    what: "splat",
                    index: *index,
                    problem: problem.clone(),
                    count: repaired.dropped,
                    total,
                    advice: "`repair` drops them",
                });
            }
            (Some(_), OnInvalid::Drop) => data.retain(&keep),
        }
        Ok((Self { data }, repaired))
    }

    /// Returns the number of splats.
    pub fn len(&self) -> usize {
        self.data.centers.len()
    }

    /// True if there are no splats.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the columns.
    pub fn data(&self) -> &CloudData {
        &self.data
    }

    /// Returns the columns, to be changed and validated again.
    pub fn into_data(self) -> CloudData {
        self.data
    }

    /// Sets the interior weight ([`CloudData::interior_weight`]): the typical sum of kernel weights inside the cloud's
    /// own surface. Ignored unless finite and greater than 0.
    pub fn set_interior_weight(&mut self, weight: f64) {
        if weight.is_finite() && weight > 0.0 {
            self.data.interior_weight = Some(weight);
        }
    }

    /// Sets whether the cloud is oriented: true if all normals point to the outside of the same surface.
    pub fn set_oriented(&mut self, oriented: bool) {
        self.data.oriented = oriented;
    }

    /// Sets the up axis.
    pub fn set_up(&mut self, up: Up) {
        self.data.up = Some(up);
    }

    /// Returns the centre of splat `i` in object space, in f64.
    #[inline]
    pub fn center(&self, i: usize) -> DVec3 {
        self.data.origin + self.data.centers.get(i)
    }

    /// Returns the half-axes of splat `i` in object space. For a disk, the half-axes are an arbitrary orthogonal pair
    /// with s × t along its normal. For a ball in object units, they are two of its radii; for a ball in pixels, they
    /// are zero.
    #[inline]
    pub fn axes(&self, i: usize) -> (DVec3, DVec3) {
        match &self.data.shape {
            Shape::Ellipses { s, t } => (s.get(i), t.get(i)),
            Shape::Disks { normals, radii } => {
                let (s, t) = surfel_math::basis::orthonormal(normals.get(i));
                let r = f64::from(radii[i]);
                (s * r, t * r)
            }
            Shape::Balls { .. } => {
                let r = self.radius_max(i);
                (DVec3::X * r, DVec3::Y * r)
            }
        }
    }

    /// True if the splats are balls or dots.
    pub fn is_balls(&self) -> bool {
        matches!(self.data.shape, Shape::Balls { .. })
    }

    /// Returns half the side lengths of the axis-aligned box around splat `i`, in object units; zero for a ball in
    /// pixels.
    #[inline]
    pub fn half_extents(&self, i: usize) -> DVec3 {
        if self.is_balls() {
            return DVec3::splat(self.radius_max(i));
        }
        let (s, t) = self.axes(i);
        (s * s + t * t).map(f64::sqrt)
    }

    /// Returns the unit outward normal of splat `i` in object space; +z for a ball.
    #[inline]
    pub fn normal(&self, i: usize) -> DVec3 {
        match &self.data.shape {
            Shape::Disks { normals, .. } => surfel_math::basis::unit(normals.get(i)),
            Shape::Ellipses { s, t } => {
                surfel_math::basis::unit(surfel_math::basis::unit(s.get(i)).cross(surfel_math::basis::unit(t.get(i))))
            }
            Shape::Balls { .. } => DVec3::Z,
        }
    }

    /// Returns the unit shading normal of splat `i` in object space.
    pub fn shading_normal(&self, i: usize) -> DVec3 {
        match &self.data.shading_normals {
            Some(n) => surfel_math::basis::unit(n.get(i)),
            None => self.normal(i),
        }
    }

    /// Returns the linear RGB albedo of splat `i`.
    pub fn color(&self, i: usize) -> [f32; 3] {
        self.data.colors.as_ref().map_or([1.0; 3], |c| c[i])
    }

    /// Returns the alpha of splat `i`.
    pub fn alpha(&self, i: usize) -> f32 {
        self.data.alphas.as_ref().map_or(1.0, |a| a[i])
    }

    /// Returns the larger semi-axis of splat `i` in object units: the largest singular value of [s t] (rendering model
    /// §2), or a ball's radius; 0 for a ball in pixels.
    #[inline]
    pub fn radius_max(&self, i: usize) -> f64 {
        match &self.data.shape {
            Shape::Balls { in_pixels: true, .. } => 0.0,
            Shape::Disks { radii, .. } | Shape::Balls { radii, .. } => f64::from(radii[i]),
            Shape::Ellipses { s, t } => surfel_math::basis::largest_singular_value(s.get(i), t.get(i)),
        }
    }

    /// Returns the smallest and the largest corner of the box around the splats (not only around their centres), in
    /// object space; `None` for an empty cloud.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut bounds: Option<(DVec3, DVec3)> = None;
        for i in 0..self.len() {
            let (p, e) = (self.center(i), self.half_extents(i));
            let (lo, hi) = bounds.unwrap_or((p - e, p + e));
            bounds = Some((lo.min(p - e), hi.max(p + e)));
        }
        bounds
    }

    /// True if any splat has an alpha below 1.
    pub fn is_transparent(&self) -> bool {
        self.data.alphas.as_ref().is_some_and(|a| a.iter().any(|&a| a < 1.0))
    }

    /// Returns the heap memory of the columns, in bytes.
    pub fn bytes(&self) -> usize {
        let d = &self.data;
        let shape = match &d.shape {
            Shape::Disks { normals, radii } => normals.bytes() + size_of_val(radii.as_slice()),
            Shape::Ellipses { s, t } => s.bytes() + t.bytes(),
            Shape::Balls { radii, .. } => size_of_val(radii.as_slice()),
        };
        let clips = d.clips.as_ref().map_or(0, |c| {
            c.curves.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
                + c.lines.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
                + c.modes.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
        });
        d.centers.bytes()
            + shape
            + d.colors.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
            + d.alphas.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
            + d.shading_normals.as_ref().map_or(0, Column3::bytes)
            + d.ball_light.as_ref().map_or(0, |v| size_of_val(v.as_slice()))
            + clips
            + [&d.rows, &d.labels].into_iter().flatten().map(|v| size_of_val(v.as_slice())).sum::<usize>()
            + d.extras.iter().map(|e| e.values.bytes()).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disks(radii: Vec<f32>) -> CloudData {
        let n = radii.len();
        let normals = Column3::from_f32(vec![Vec3::Z; n]);
        CloudData::new(DVec3::ZERO, Column3::from_f32(vec![Vec3::ZERO; n]), Shape::Disks { normals, radii })
    }

    #[test]
    fn an_absent_attribute_costs_nothing() {
        let (cloud, _) = SplatCloud::new(disks(vec![1.0; 100]), OnInvalid::Refuse).unwrap();
        assert_eq!(cloud.bytes(), 100 * (12 + 12 + 4));
    }

    #[test]
    fn clouds_are_made_of_slices_and_refused_with_what_where_and_expected() {
        let (centers, normals, radii) = ([Vec3::ZERO, Vec3::X], [[0.0, 0.0, 1.0]; 2], [1.0, 0.5]);
        let cloud = SplatCloud::disks(&centers, &normals, &radii).unwrap();
        assert_eq!((cloud.len(), cloud.radius_max(1), cloud.normal(0)), (2, 0.5, DVec3::Z));
        let text = |result: Result<SplatCloud, ModelError>| result.unwrap_err().to_string();
        let short = text(SplatCloud::disks(&centers, &normals[..1], &radii));
        assert_eq!(short, "column 'normals' has 1 values, expected 2: one for each element");
        let wrong = text(SplatCloud::disks(&centers, &normals, &[1.0, -1.0]));
        assert!(wrong.starts_with("splat 1 is invalid: its radius is -1, expected a finite number"), "{wrong}");
        assert!(wrong.contains("OnInvalid::Drop") && !wrong.contains("`repair`"), "{wrong}");
        assert!(text(cloud.clone().with_colors(&[Vec3::ONE])).contains("'colors' has 1 values, expected 2"));
        assert!(text(cloud.clone().with_alphas(&[1.0, 2.0])).contains("its alpha is 2, expected a number in [0, 1]"));
        assert!(text(cloud.clone().with_shading_normals(&[Vec3::ZERO; 2])).contains("shading normal"));
        assert!(text(cloud.clone().with_clips(ClipColumns::default())).contains("half-axes"));
        let moved = cloud.with_colors(&[[0.5; 3]; 2]).unwrap().with_origin([1e6, 0.0, 0.0]).unwrap();
        assert_eq!((moved.center(1), moved.color(0)), (DVec3::new(1e6 + 1.0, 0.0, 0.0), [0.5; 3]));
        let flat = SplatCloud::ellipses(&centers, &[Vec3::X; 2], &[Vec3::X; 2]);
        assert!(text(flat).contains("its half-axes are parallel"));
        assert!(SplatCloud::ellipses(&centers, &[Vec3::X; 2], &[Vec3::Y; 2]).is_ok());
    }

    #[test]
    fn invalid_splats_are_named_and_counted() {
        let error = SplatCloud::new(disks(vec![1.0, -2.0, f32::NAN, 1.0]), OnInvalid::Refuse).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("splat 1 is invalid: its radius is -2"), "{text}");
        assert!(text.contains("2 of 4"), "{text}");
    }

    #[test]
    fn repair_drops_them_and_says_how_many() {
        let (cloud, repaired) = SplatCloud::new(disks(vec![1.0, -2.0, f32::NAN, 3.0]), OnInvalid::Drop).unwrap();
        assert_eq!((cloud.len(), repaired.dropped), (2, 2));
        assert_eq!(cloud.radius_max(1), 3.0);
    }

    #[test]
    fn each_rule_of_section_10_is_enforced() {
        let with = |change: fn(&mut CloudData)| {
            let mut data = disks(vec![1.0]);
            change(&mut data);
            SplatCloud::new(data, OnInvalid::Refuse)
        };
        assert!(with(|_| ()).is_ok());
        assert!(with(|d| d.centers = Column3::from_f32(vec![Vec3::INFINITY])).is_err());
        assert!(with(|d| d.alphas = Some(vec![1.5])).is_err());
        assert!(with(|d| d.colors = Some(vec![[f32::NAN, 0.0, 0.0]])).is_err());
        assert!(with(|d| d.shading_normals = Some(Column3::from_f32(vec![Vec3::ZERO]))).is_err());
        assert!(with(|d| d.colors = Some(vec![])).is_err());
        assert!(with(|d| d.clips = Some(ClipColumns::default())).is_err());
        let ellipse = |s: Vec3, t: Vec3| {
            let data = CloudData::new(
                DVec3::ZERO,
                Column3::from_f32(vec![Vec3::ZERO]),
                Shape::Ellipses { s: Column3::from_f32(vec![s]), t: Column3::from_f32(vec![t]) },
            );
            SplatCloud::new(data, OnInvalid::Refuse)
        };
        assert!(ellipse(Vec3::X * 1e-15, Vec3::Y * 1e-15).is_ok());
        assert!(ellipse(Vec3::X, Vec3::ZERO).is_err());
        assert!(ellipse(Vec3::X, Vec3::X * 2.0).is_err());
    }
}
