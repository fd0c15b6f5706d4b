//! Loading of files as the objects of a scene. Splat files are used as they are; points and meshes are converted to
//! splats.
//!
//! Main functions and types, in reading order:
//!
//! 1. [`load()`]: loads one file as a [`LoadedCloud`], according to [`LoadOptions`];
//! 2. [`load_scene`] and [`scene`]: read scene files, and load all files of a scene, each once, as [`LoadedObjects`]
//!    with [`ObjectFacts`];
//! 3. [`coloring`]: colours splats by an attribute, on a scale that files share; [`labels`]: stores an attribute as
//!    labels;
//! 4. [`levels`] and [`LevelStore`]: read the levels of detail of COPC files that a view needs;
//! 5. [`memory`]: estimates the memory that a file's points need, before they are read;
//! 6. [`effects`]: lists the kinds of files that an option affects;
//! 7. [`info`]: describes a file as JSON;
//! 8. [`Error`]: errors of this package and of all packages below it.
//!
//! ```no_run
//! use surfel_load::{LoadOptions, load};
//! use surfel_model::ConvertOptions;
//! # fn main() -> Result<(), surfel_load::Error> {
//! let convert = ConvertOptions { color_by: Some("height".into()), ..ConvertOptions::default() };
//! let options = LoadOptions::default().with_convert(&convert, "".as_ref());
//! let loaded = load("scan.laz".as_ref(), &options, &surfel_sample::NoProgress)?;
//! println!("{} splats, up {}", loaded.cloud.len(), loaded.up);
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate combines `surfel-io`, which reads files, and `surfel-sample`, which converts points and meshes to splats.
//! It chooses no camera and no light: `surfel-stage` does. It prints nothing and has no global state.
//!
//! # Features
//! `sharp` clips splats along sharp features of meshes and points; `zstd` reads SPZ files of version 4.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod coloring;
mod convert;
pub mod effects;
mod error;
pub mod info;
pub mod labels;
mod level_choice;
mod level_store;
pub mod levels;
mod load;
mod loaded_cloud;
mod loaded_objects;
pub mod memory;
mod mesh_columns;
pub mod noise;
pub mod octree;
mod options;
pub mod paths;
pub mod points_as;
pub mod scene;
mod single_sided;
pub mod words;

/// Single steps of loading, for callers that load a file chunk by chunk.
pub mod steps {
    pub use crate::convert::{chosen_points, splats_of_points};
    pub use crate::load::{check_size, read, splats_of, without_attribute};
    pub use crate::options::io_options;
}

pub use error::Error;
pub use level_store::LevelStore;
pub use load::{load, up_reason};
pub use loaded_cloud::{Conversion, LoadedCloud};
pub use loaded_objects::{ColorJobs, LoadedObjects, ObjectFacts, ObjectNote};
pub use options::{LoadOptions, STDIN};
pub use points_as::SparseReason;
pub use scene::load_scene;
