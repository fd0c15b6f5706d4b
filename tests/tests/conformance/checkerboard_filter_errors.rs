//! The checkerboard's table in docs/decisions/017-principal-filter.md, measured again.

use surfel_conformance::checkerboard::{Bands, measure, variants};

/// Rows of the table at cutoff 2 and prefilter radius h = √½ px: filter, and RMSE of its image in each band.
const TABLE: [(&str, Bands); 4] = [
    ("none", [0.189, 0.113, 0.076, 0.061, 0.097]),
    ("clamp", [0.064, 0.063, 0.062, 0.060, 0.097]),
    ("ewa", [0.035, 0.050, 0.054, 0.068, 0.099]),
    ("principal", [0.031, 0.038, 0.044, 0.060, 0.097]),
];

#[test]
fn filter_errors_on_a_checkerboard_are_the_models_table() {
    let wanted: Vec<_> = variants().into_iter().filter(|(name, _)| TABLE.iter().any(|t| t.0 == *name)).collect();
    let measured = measure(&wanted).unwrap();
    assert_eq!(measured.len(), TABLE.len());
    for ((name, got), (expected, want)) in measured.iter().zip(TABLE) {
        println!("{name}: {got:.4?}");
        assert_eq!(*name, expected);
        for (band, (g, w)) in got.iter().zip(want).enumerate() {
            // Half of the table's last digit, and a little more. The far band is 18 rows high, and without a filter it
            // is pure aliasing: starting it a row later, or adding a row, changes it by up to 0.005.
            let tolerance = if *name == "none" && band == 0 { 0.006 } else { 0.001 };
            assert!((g - w).abs() <= tolerance, "{name}: {got:?}, decision 017 has {want:?}");
        }
    }
    let far = |name: &str| measured.iter().find(|m| m.0 == name).unwrap().1[0];
    assert!(far("principal") <= 0.035);
    assert!(["none", "clamp", "ewa"].iter().all(|name| far(name) > far("principal")));
}
