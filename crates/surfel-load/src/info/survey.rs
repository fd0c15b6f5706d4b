//! Summary of a point file that may be larger than memory. The points are read twice in blocks: first for statistics
//! over all points, then for the neighbourhoods of a few points.

use super::attributes;
use super::radii::{PATCH, PATCHES, Radii, bytes_of_points, radii_of_patch};
use crate::error::Error;
use glam::DVec3;
use serde_json::{Map, Value};
use std::path::Path;
use surfel_io::{Content, LoadOptions, PointSurvey};
use surfel_model::{Column3, PointCloud};

/// Summary of a point file, for `surfel info`.
pub(crate) struct Survey {
    pub read: PointSurvey,
    pub points: usize,
    /// Memory in bytes that all points would take if they were loaded.
    pub bytes: usize,
    pub attributes: Value,
    pub classes: Value,
    pub radii: Option<Radii>,
}

/// Summarises a file of about `count` points; `None` if its format can't be read in blocks.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or is damaged.
pub(crate) fn survey(path: &Path, count: u64, options: &LoadOptions) -> Result<Option<Survey>, Error> {
    let mut whole = Whole::new(count);
    let Some(read) = surfel_io::survey(path, options, &mut |cloud| whole.add(cloud))? else { return Ok(None) };
    let mut patches: Vec<Patch> = whole.middles.iter().map(|middle| Patch::about(*middle)).collect();
    surfel_io::survey(path, options, &mut |cloud| patches.iter_mut().for_each(|patch| patch.add(&cloud)))?;
    let radii = patches.into_iter().flat_map(|patch| radii_of_patch(&patch.cloud()));
    let radii = Radii::of(radii.collect(), "estimated from neighbours, on a sample of the points");
    if let Some((lo, hi)) = read.bounds {
        let exact = attributes::limits(lo.to_array().to_vec(), hi.to_array().to_vec());
        whole.attributes.insert("position".to_owned(), exact);
    }
    if let Some((lo, hi)) = read.colors {
        whole.bytes += whole.points * size_of::<[f32; 3]>();
        whole.attributes.insert("colour".to_owned(), attributes::limits(lo.to_vec(), hi.to_vec()));
    }
    let classes = whole.classes.map_or(Value::Null, |counts| attributes::classes(&counts));
    let attributes = Value::Object(whole.attributes);
    Ok(Some(Survey { read, points: whole.points, bytes: whole.bytes, attributes, classes, radii }))
}

/// Statistics over all points of a file that were read so far.
struct Whole {
    /// Approximate total number of points of the file.
    count: u64,
    points: usize,
    bytes: usize,
    attributes: Map<String, Value>,
    classes: Option<[u64; 256]>,
    /// Positions of points at regular intervals in the file, which become the centres of patches for estimating radii.
    middles: Vec<DVec3>,
}

impl Whole {
    fn new(count: u64) -> Self {
        Self { count, points: 0, bytes: 0, attributes: Map::new(), classes: None, middles: Vec::new() }
    }

    fn add(&mut self, cloud: PointCloud) {
        while self.middles.len() < PATCHES {
            let wanted = (2 * self.middles.len() as u64 + 1) * self.count / (2 * PATCHES as u64);
            let Some(at) = wanted.checked_sub(self.points as u64).filter(|at| *at < cloud.len() as u64) else { break };
            self.middles.push(cloud.origin + cloud.positions.get(at as usize));
        }
        let zeros_before = self.points > 0;
        self.points += cloud.len();
        self.bytes += bytes_of_points(&cloud);
        if let Some(counts) = attributes::class_counts(&cloud.extras) {
            let all = self.classes.get_or_insert([0; 256]);
            if self.points > cloud.len() && all.iter().sum::<u64>() == 0 {
                // Class counts are missing for earlier blocks if all of their points had class 0.
                all[0] = (self.points - cloud.len()) as u64;
            }
            all.iter_mut().zip(counts).for_each(|(all, count)| *all += count);
        } else if let Some(all) = &mut self.classes {
            all[0] += cloud.len() as u64;
        }
        let content = Content::Points(cloud);
        let names = content.attributes();
        let Content::Points(PointCloud { extras, .. }) = &content else { return };
        let found = attributes::ranges(&content, &names, extras);
        // A missing column counts as zeros.
        for (name, range) in &mut self.attributes {
            if !found.contains_key(name) {
                attributes::widen(range, None);
            }
        }
        for (name, range) in found {
            match self.attributes.get_mut(&name) {
                Some(known) => attributes::widen(known, Some(&range)),
                None => {
                    let known = self.attributes.entry(name).or_insert(range);
                    if zeros_before {
                        attributes::widen(known, None);
                    }
                }
            }
        }
    }
}

/// Points nearest to a centre, which are collected while the file is read. Radii are estimated from them.
struct Patch {
    middle: DVec3,
    /// Collected points: squared distance to the centre, position relative to the centre, and normal of each.
    near: Vec<(f64, DVec3, DVec3)>,
    /// Squared distance to the centre from which points are too far to belong to the patch. It shrinks as nearer points
    /// are found.
    limit: f64,
    has_normals: bool,
}

impl Patch {
    fn about(middle: DVec3) -> Self {
        Self { middle, near: Vec::new(), limit: f64::INFINITY, has_normals: false }
    }

    fn add(&mut self, cloud: &PointCloud) {
        self.has_normals |= cloud.normals.is_some();
        let from_middle = cloud.origin - self.middle;
        for i in 0..cloud.len() {
            let distance = (cloud.positions.get(i) + from_middle).length_squared();
            if distance < self.limit {
                let normal = cloud.normals.as_ref().map_or(DVec3::ZERO, |normals| normals.get(i));
                self.near.push((distance, cloud.positions.get(i) + from_middle, normal));
                if self.near.len() >= 2 * PATCH.0 {
                    self.cut();
                }
            }
        }
    }

    fn cut(&mut self) {
        self.near.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.near.truncate(PATCH.0);
        self.limit = self.near.last().filter(|_| self.near.len() == PATCH.0).map_or(f64::INFINITY, |last| last.0);
    }

    /// Returns the points of the patch, nearest first.
    fn cloud(mut self) -> PointCloud {
        self.cut();
        let column =
            |of: fn(&(f64, DVec3, DVec3)) -> DVec3| Column3::from_f64(&self.near.iter().map(of).collect::<Vec<_>>());
        PointCloud {
            positions: column(|near| near.1),
            normals: self.has_normals.then(|| column(|near| near.2)),
            ..PointCloud::default()
        }
    }
}
