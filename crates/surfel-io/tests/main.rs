//! Tests of readers and writers.

mod atomic;
mod copc;
mod formats;
mod gaussian_formats;
mod gltf;
mod images;
mod left_out;
mod mutations;
mod numpy;
mod octree;
mod ply;
mod point_formats;
mod read_right;
mod scans;
mod support;
mod tables;
mod tilesets;
