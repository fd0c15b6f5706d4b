//! Surfel renders surfaces given as splats: scans, point clouds and meshes, filtered, blended and shaded.
//!
//! This crate is the front door: it loads files ([`prepare`], [`load_scene`]), frames and lights them where nothing
//! says how ([`auto_scene`], [`frame_camera`], [`studio_lights`]), and draws with whichever backend there is
//! ([`Backend`]). Everything below it is re-exported.
//!
//! ```no_run
//! use surfel::{Backend, Frame, NoProgress, Planes, Renderer, View};
//! # fn main() -> Result<(), surfel::Error> {
//! let opened = surfel::open(&["bunny.obj".as_ref()], &NoProgress)?;
//! let (settings, planes) = (&opened.file.settings, Planes::COLOR);
//! let mut backend = Backend::auto_for(&opened.scene, settings, planes, &Default::default())?;
//! let scene = backend.upload(&opened.scene)?;
//! let view = View::new(&opened.file.camera)?;
//! let mut frame = Frame::default();
//! backend.render(&scene, &view, settings, planes, &mut frame)?;
//! surfel::io::save_png("bunny.png".as_ref(), false, &surfel::planes(&frame), &Default::default())?;
//! # Ok(())
//! # }
//! ```

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod auto;
mod backend;
mod error;
mod framing;
mod hybrid;
mod load;
mod scene;

pub use surfel_io as io;
pub use surfel_math as math;
pub use surfel_model as model;
pub use surfel_render as render;
pub use surfel_sample as sample;

pub use auto::{AutoOptions, DEFAULT_SIZE, Opened, auto_scene, bare_object, is_scene_file, open, studio_lights};
pub use backend::{Backend, BackendError, BackendInfo, BackendOptions, BackendScene, Chosen, backends};
pub use error::Error;
pub use framing::{
    DEFAULT_FOV_Y_DEG, FrameOptions, FrameProjection, NamedView, ViewAxes, depth_range, frame_camera, scene_center,
};
pub use hybrid::{HybridObject, at_detail, prepare_hybrid};
pub use load::{Conversion, LoadOptions, Prepared, prepare};
pub use scene::{
    LoadedObjects, ObjectFacts, ObjectNote, assemble, load_matcap, load_objects, load_scene, may_need_interior_weight,
    read_scene_file,
};
pub use surfel_model::{Camera, Light, Material, Scene, SceneFile, Settings, SplatCloud, Up};
pub use surfel_render::{ColorPlane, Frame, Planes, Preset, Region, RenderError, Renderer, RendererInfo, Stats, View};
pub use surfel_sample::{NoProgress, Progress};

/// Borrows a frame's planes, to write them as a picture. Planes that the frame doesn't have are left out.
pub fn planes(frame: &Frame) -> surfel_io::PlanesView<'_> {
    fn there<T>(plane: &[T]) -> Option<&[T]> {
        (!plane.is_empty()).then_some(plane)
    }
    surfel_io::PlanesView {
        width: frame.width,
        height: frame.height,
        color: there(&frame.color),
        depth: there(&frame.depth),
        normal: there(&frame.normal),
        weight: there(&frame.weight),
        other: Vec::new(),
    }
}

/// The README's example, compiled so that it stays true.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;
