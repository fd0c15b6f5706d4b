//! Loaded objects of a scene, and facts about them.

use crate::coloring::Colorings;
use crate::coloring::together::ColorJob;
use crate::effects::UnusedOption;
use crate::points_as::SparseReason;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use surfel_framing::UpReason;
use surfel_model::{Object, Up};

/// A note about a file for the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectNote {
    /// The file.
    pub path: PathBuf,
    /// Text of the note: a sentence without a full stop.
    pub text: String,
}

impl ObjectNote {
    pub(crate) fn new(path: &Path, text: &str) -> Self {
        Self { path: path.to_path_buf(), text: text.to_owned() }
    }
}

/// The loaded objects of a scene.
#[derive(Clone, Debug, Default)]
pub struct LoadedObjects {
    /// The objects, in the scene file's order.
    pub objects: Vec<Object>,
    /// Facts about each object.
    pub facts: Vec<ObjectFacts>,
    /// Notes on what was dropped, assumed or estimated, per file.
    pub notes: Vec<ObjectNote>,
    /// Files that the objects' files refer to, such as textures and buffers, whether they exist or not.
    pub beside: BTreeSet<PathBuf>,
    /// Options that had no effect on any splat object, with the content of the first object's file.
    pub unused: Vec<(PathBuf, UnusedOption)>,
    /// Colourings by attribute, if the options ask for any.
    pub colorings: Colorings,
    /// Colouring requests, one per object.
    pub color_jobs: ColorJobs,
    /// True if balls and disks of no stated radius have one radius in all objects, since they are compared.
    pub has_one_radius: bool,
}

/// Colouring requests for the objects of [`LoadedObjects`].
#[derive(Clone, Debug, Default)]
pub struct ColorJobs(pub(crate) Vec<Option<ColorJob>>);

impl ColorJobs {
    /// Adds the requests of further objects.
    pub fn append(&mut self, others: Self) {
        self.0.extend(others.0);
    }

    /// Sets the axis of height where it isn't certain.
    pub fn assume_up(&mut self, up: Up) {
        self.0.iter_mut().flatten().for_each(|job| job.up = job.up.or(Some(up)));
    }
}

/// Facts about an object that automatic framing and lighting use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectFacts {
    /// Up axis of the object's file.
    pub up: Up,
    /// Reason why the up axis is certain; `None` for the default of a format whose files occur with any axis up.
    pub up_reason: Option<UpReason>,
    /// True if the splats were made from points.
    pub points: bool,
    /// Reason why the file's points don't suffice to estimate a surface; `None` if they do.
    pub sparse: Option<SparseReason>,
    /// True if the file has so few points that they may not suffice to estimate a surface.
    pub few: bool,
    /// True if a mesh's edges or a comment of the file determine whether the surface is watertight, so that this isn't
    /// estimated.
    pub sides_known: bool,
    /// True if the object has colours.
    pub colored: bool,
    /// True if the file or its mesh states that the splats cover a watertight surface from outside.
    pub closed: bool,
    /// True if overlapping splats hardly differ in depth: they were made from a mesh of flat parts, or clipped by
    /// `sharp`.
    pub flat: bool,
    /// True if overlapping splats differ little in depth: they are at least as many as the triangles of their mesh.
    pub fine: bool,
    /// True if the cloud has separate splats for each visible side of the surface. Back faces are then always culled.
    pub each_side: bool,
    /// True if only coarse levels of the file were read ([`refine_objects`](crate::scene::refine_objects)).
    pub partial: bool,
    /// True if the file has more points than the point limit.
    pub thinned: bool,
    /// True if the options ask for points of all classes, so that strays are framed, too.
    pub all_classes: bool,
    /// True if some points are noise or withheld; such points don't influence the camera ([`LoadedObjects::framed`]).
    pub noise: bool,
    /// True if some splats are transparent and none is a Gaussian. The opacity of a Gaussian surface depends on how
    /// many of them overlap.
    pub transparent: bool,
}

impl Default for ObjectFacts {
    fn default() -> Self {
        Self {
            up: Up::PlusY,
            up_reason: None,
            points: false,
            sparse: None,
            few: false,
            sides_known: false,
            colored: false,
            closed: false,
            flat: false,
            fine: false,
            each_side: false,
            partial: false,
            thinned: false,
            all_classes: false,
            noise: false,
            transparent: false,
        }
    }
}
