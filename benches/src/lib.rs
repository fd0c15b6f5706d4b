//! Benches by criterion: `cargo bench -p surfel-benches`. They have their own package so that `cargo xtask test`
//! doesn't compile criterion.
