//! The facade as its callers use it.

mod closed;
mod facades;
mod interface;
mod level_pops;
mod orientation;
mod ortho;
mod swap;
mod whites;
