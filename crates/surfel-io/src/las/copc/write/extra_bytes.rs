//! Extra-bytes descriptions of the values that Surfel adds to each point.

use crate::las::copc::{LEVEL_COLORS, LEVEL_NORMALS, NORMALS, RADIUS};

/// Builds the data of the extra-bytes record: `given`, the inputs' descriptions, for the first `kept` extra bytes of a
/// point, then descriptions of Surfel's own values. The flags state which values Surfel adds: radius and mean normal
/// (`splats`), also the point's normal (`normals`), and mean colour (`colors`). Also returns the number of bytes of
/// Surfel's values per point.
pub(super) fn descriptions(given: &[u8], kept: usize, splats: bool, normals: bool, colors: bool) -> (Vec<u8>, usize) {
    let mut out = Vec::new();
    let mut described = 0;
    for record in given.chunks_exact(192) {
        let bytes = match record[2] {
            0 => usize::from(record[3]),
            kind @ 1..=30 => {
                [1, 1, 2, 2, 4, 4, 8, 8, 4, 8][usize::from(kind - 1) % 10] * usize::from((kind - 1) / 10 + 1)
            }
            _ => 0,
        };
        if described + bytes > kept {
            break;
        }
        described += bytes;
        out.extend_from_slice(record);
    }
    // Describes the other copied bytes as bytes of unknown meaning (type 0).
    while described < kept {
        let bytes = (kept - described).min(255);
        out.extend_from_slice(&description("", 0, "", false));
        let at = out.len() - 192;
        out[at + 3] = bytes as u8;
        described += bytes;
    }
    let mut bytes = 0;
    let mut add = |name: &str, kind: u8, size: usize, what: &str| {
        out.extend_from_slice(&description(name, kind, what, kind == 2));
        bytes += size;
    };
    if splats {
        add(RADIUS, 9, 4, "radius of the point's splat");
        let of_point = NORMALS.iter().filter(|_| normals).map(|name| (*name, "unit normal"));
        for (name, what) in of_point.chain(LEVEL_NORMALS.map(|name| (name, "mean normal at its level"))) {
            add(name, 2, 1, what);
        }
    }
    if colors {
        LEVEL_COLORS.iter().for_each(|name| add(name, 3, 2, "mean colour at its level"));
    }
    (out, bytes)
}

/// Returns the 192-byte description of one extra-bytes value. `kind` is the number of its type in the LAS standard, and
/// `what` a text for readers. A scaled value is stored in units of 1/127.
pub(super) fn description(name: &str, kind: u8, what: &str, scaled: bool) -> [u8; 192] {
    let mut d = [0; 192];
    d[2] = kind;
    d[4..4 + name.len()].copy_from_slice(name.as_bytes());
    d[160..160 + what.len()].copy_from_slice(what.as_bytes());
    if scaled {
        d[3] = 8;
        d[112..120].copy_from_slice(&(1.0_f64 / 127.0).to_le_bytes());
    }
    d
}
