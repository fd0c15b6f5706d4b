//! The program's tests, in one binary, since each binary links the whole program.

mod again;
mod attributes;
mod colors;
mod common;
mod exit_codes;
mod figure;
mod film;
mod gaussians;
mod interface;
mod levels;
mod losses;
#[cfg(feature = "mcp")]
mod mcp;
mod net;
mod options;
mod ortho;
mod output_images;
mod pieces;
mod planes;
mod render;
mod splats;
mod strangers;
mod tables;
mod tools;
#[cfg(feature = "view")]
mod view;
