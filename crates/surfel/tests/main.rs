//! Tests of the facade's public interface.

mod facades;
mod figure;
mod flat_faces;
mod interface;
mod level_pops;
mod level_store;
mod orientation;
mod ortho;
mod out_of_sight;
mod refined;
mod rooms;
mod session;
mod sky;
mod swap;
mod watertight;
mod whites;
