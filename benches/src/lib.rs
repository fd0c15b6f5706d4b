//! Benches of the CPU backend's stages, by criterion: `cargo bench -p surfel-benches`.
//!
//! `benches/stages.rs` times the stages of a frame, `benches/clips.rs` the evaluation of clips. The package depends on
//! the CPU backend and the formulas; nothing depends on it. It is separate so that `cargo xtask test` doesn't compile
//! criterion. The library itself is empty.
