//! Options, requests and sessions: the code that the command line, the Python package, `surfel serve` and `surfel view`
//! share. Only this package and the programs above it word messages for users as flags or keywords.
//!
//! Main types, in reading order:
//!
//! 1. [`options`]: the table of all options, one row per option. The flags of the command line, the keys of scene
//!    files, Python's keywords, shell completions and the page on options are generated from the table; [`values`]
//!    parses the options' values;
//! 2. [`request::RenderOptions`]: the options of an image as data;
//! 3. [`request`]: turns files and options into the scene, camera, settings and planes of an image;
//! 4. [`session`]: a scene that is drawn many times with changing options;
//! 5. [`figure`] and [`film`]: several images in one figure, and films;
//! 6. [`splat_file`], [`ortho_request`] and [`copc_output`]: requests for output files that aren't images;
//! 7. [`metadata`] and [`compare`]: descriptions of how an image was made, and of differences;
//! 8. [`wording`]: words options in messages as flags, or as Python's keywords.
//!
//! ```
//! let mut options = surfel_app::request::RenderOptions::default();
//! options.set("size", "640x480")?;
//! assert!(options.set("size", "640").is_err());
//! assert_eq!(options.size, Some([640, 480]));
//! # Ok::<(), String>(())
//! ```
//!
//! # Layer
//! The crate lies between the programs and the packages that load (`surfel-load`), choose (`surfel-stage`) and draw
//! (`surfel-backend`, `surfel-ortho`). It prints nothing and has no global state.
//!
//! # Features
//!
//! | feature | effect |
//! | --- | --- |
//! | `cpu`, `reference`, `wgpu`, `ash` | backends |
//! | `ortho` | orthoimages as GeoTIFF |
//! | `sharp` | splats clipped along sharp features of meshes and points |
//! | `zstd` | SPZ files of version 4 |
//! | `export` | the option `--export` of `surfel view` |

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod blank_image;
pub mod camera;
mod color_bar;
pub mod compare;
pub mod copc_output;
pub mod figure;
mod figure_options;
pub mod film;
pub mod metadata;
pub mod options;
#[cfg(feature = "ortho")]
pub mod ortho_request;
pub mod progressive;
pub mod render_options;
pub mod request;
pub mod session;
mod sky;
pub mod splat_file;
pub mod splats;
pub mod style;
pub mod values;
pub mod wording;

pub use color_bar::save_color_bar;
pub use render_options::RenderOptions;
