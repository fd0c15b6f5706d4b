//! Benches by criterion: `cargo bench -p surfel-benches`. They are a package of their own so that `cargo xtask test`
//! doesn't compile criterion.
