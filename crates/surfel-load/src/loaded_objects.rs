//! Loaded objects of a scene, and facts about them for automatic framing and lighting.

use crate::coloring::Colorings;
use crate::coloring::together::ColorJob;
use crate::effects::UnusedOption;
use crate::points_as::SparseReason;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use surfel_framing::UpReason;
use surfel_model::{Object, Up};

/// Note about a file, for the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectNote {
    /// Path of the file that the note is about.
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
    /// Facts about each object, in the same order.
    pub facts: Vec<ObjectFacts>,
    /// Notes for the user on data that was dropped, assumed or estimated, with the file of each.
    pub notes: Vec<ObjectNote>,
    /// Files to which the input files refer, such as textures and buffers, whether they exist or not.
    pub beside: BTreeSet<PathBuf>,
    /// Options without effect on any object of splats, with the path of the first object's file.
    pub unused: Vec<(PathBuf, UnusedOption)>,
    /// Colourings by attributes; empty unless the options request some.
    pub colorings: Colorings,
    /// Colouring requests, one for each object.
    pub color_jobs: ColorJobs,
    /// True if all balls and disks without a stated radius share one radius, so that objects can be compared.
    pub has_one_radius: bool,
}

/// Colouring requests, one for each of [`LoadedObjects::objects`]. An object that isn't coloured by an attribute has
/// `None`.
#[derive(Clone, Debug, Default)]
pub struct ColorJobs(pub(crate) Vec<Option<ColorJob>>);

impl ColorJobs {
    /// Appends the requests of further objects.
    pub fn append(&mut self, others: Self) {
        self.0.extend(others.0);
    }

    /// Sets the axis along which heights are measured, for files whose up axis isn't certain.
    pub fn assume_up(&mut self, up: Up) {
        self.0.iter_mut().flatten().for_each(|job| job.up = job.up.or(Some(up)));
    }
}

/// Facts about an object, for automatic framing and lighting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectFacts {
    /// Up axis of the object's file.
    pub up: Up,
    /// Reason why the up axis is certain. `None` if it is only the format's default, and files of the format have any
    /// up axis.
    pub up_reason: Option<UpReason>,
    /// True if the splats were made from points.
    pub points: bool,
    /// Reason why the file's points aren't sufficient to estimate a surface; `None` if they are.
    pub sparse: Option<SparseReason>,
    /// True if the file has so few points that a surface may not be estimated reliably.
    pub few: bool,
    /// True if a mesh's edges or a comment of the file determine whether the surface is watertight, so that it needn't
    /// be estimated.
    pub sides_known: bool,
    /// True if the object has colours, whether from its file or by an attribute.
    pub colored: bool,
    /// True if no back of a splat is ever visible. The splats cover a watertight surface from outside, according to the
    /// file or its mesh, or there are splats for each visible side.
    pub is_watertight: bool,
    /// True if overlapping splats have nearly the same depth, because they were made from a mesh of flat parts or
    /// clipped by `sharp`. A small depth tolerance then suffices.
    pub flat: bool,
    /// True if overlapping splats differ little in depth, because there is at least one splat per triangle of their
    /// mesh. A small depth tolerance then suffices.
    pub fine: bool,
    /// True if the cloud has separate splats for each visible side of the surface. Back faces are then always culled.
    pub each_side: bool,
    /// True if only an overview of the file was read, which [`refine_objects`](crate::scene::refine_objects) completes.
    pub partial: bool,
    /// True if the file has more points than the point limit, so that only some of them became splats.
    pub thinned: bool,
    /// True if the options select points of all classes. Stray points, such as isolated ones far from the others, are
    /// then framed, too.
    pub all_classes: bool,
    /// True if some points are noise or withheld. Such points don't influence the camera ([`LoadedObjects::framed`]).
    pub noise: bool,
    /// True if some splats are transparent. False for surfaces made from trained Gaussians, since their opacity results
    /// from the overlap of many splats.
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
            is_watertight: false,
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
