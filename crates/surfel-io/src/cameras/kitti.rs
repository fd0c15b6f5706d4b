//! Reader of KITTI's calibration files: one matrix per line, by name.

use super::NamedCamera;
use super::json::calibrated;
use crate::error::{Fault, Location, Problem};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// Numbers of each line of a calibration file, by the name before the colon. A line with other content, such as a date,
/// has an empty list.
type Entries = BTreeMap<String, Vec<f64>>;

fn entries(bytes: &[u8]) -> Result<Entries, Problem> {
    let text = String::from_utf8_lossy(bytes);
    let mut all = Entries::new();
    for (i, line) in text.lines().enumerate() {
        let Some((name, rest)) = line.split_once(':') else {
            if line.trim().is_empty() {
                continue;
            }
            let problem = Problem::new("is no calibration of KITTI: a line has no name").at(Location::Line(i + 1));
            return Err(problem.expected("lines such as P0: and twelve numbers, or a file of another program"));
        };
        let numbers: Option<Vec<f64>> = rest.split_whitespace().map(|word| word.parse().ok()).collect();
        all.insert(name.trim().to_owned(), numbers.unwrap_or_default());
    }
    Ok(all)
}

/// Returns the 3×3 part and the last column of the 3×4 matrix with the name `name`, if the file has one.
fn matrix(entries: &Entries, name: &str) -> Result<Option<(DMat3, DVec3)>, Problem> {
    let Some(m) = entries.get(name) else { return Ok(None) };
    let Ok(m) = <[f64; 12]>::try_from(m.as_slice()) else {
        return Err(Problem::new(format!("has {} numbers in {name}", m.len())).expected("12"));
    };
    let row = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
    Ok(Some((DMat3::from_cols(row(0), row(1), row(2)).transpose(), DVec3::new(m[3], m[7], m[11]))))
}

fn square(entries: &Entries, name: &str) -> Result<Option<DMat3>, Problem> {
    let Some(m) = entries.get(name) else { return Ok(None) };
    match <[f64; 9]>::try_from(m.as_slice()) {
        Ok(m) => Ok(Some(DMat3::from_cols_array(&m).transpose())),
        Err(_) => Err(Problem::new(format!("has {} numbers in {name}", m.len())).expected("9")),
    }
}

/// Parses the cameras of a calibration file: `P0`… of the benchmarks, `P_rect_00`… of the raw recordings. `scanner`
/// returns the contents of `calib_velo_to_cam.txt`, which raw recordings have in the same folder.
pub(super) fn parse(bytes: &[u8], scanner: impl FnOnce() -> Option<Vec<u8>>) -> Result<Vec<NamedCamera>, Fault> {
    let own = entries(bytes)?;
    let is_raw = own.contains_key("P_rect_00");
    let (rectify, camera_from_scanner) = if is_raw {
        let from_scanner = match scanner() {
            Some(bytes) => {
                let entries = entries(&bytes)?;
                let t = entries.get("T").and_then(|t| <[f64; 3]>::try_from(t.as_slice()).ok());
                square(&entries, "R")?.zip(t.map(DVec3::from))
            }
            None => None,
        };
        (square(&own, "R_rect_00")?, from_scanner)
    } else {
        let from_scanner = match matrix(&own, "Tr_velo_to_cam")? {
            Some(found) => Some(found),
            None => matrix(&own, "Tr")?,
        };
        (square(&own, "R0_rect")?, from_scanner)
    };
    let rectify = rectify.unwrap_or(DMat3::IDENTITY);
    // From the world to the first rectified camera. The world is that of the scanner if its calibration is available.
    let (turn, shift) = match camera_from_scanner {
        Some((turn, shift)) => (rectify * turn, rectify * shift),
        None => (DMat3::IDENTITY, DVec3::ZERO),
    };
    let mut cameras = Vec::new();
    for i in 0..10 {
        let (name, image) = if is_raw {
            (format!("P_rect_0{i}"), format!("image_0{i}"))
        } else {
            (format!("P{i}"), format!("image_{i}"))
        };
        let Some((k, last)) = matrix(&own, &name)? else { continue };
        let of = |problem: Problem| Problem { what: format!("{name} {}", problem.what), ..problem };
        let size = own.get(&format!("S_rect_0{i}")).and_then(|s| <[f64; 2]>::try_from(s.as_slice()).ok());
        let size = size.filter(|s| s.iter().all(|s| *s >= 1.0 && *s <= 65536.0)).map(|s| s.map(|s| s as u32));
        if k.determinant() == 0.0 {
            return Err(of(Problem::new("is singular").expected("K (I | t)")).into());
        }
        // K(I | K⁻¹p): the camera is displaced from the first one.
        let camera = calibrated(k, turn, shift + k.inverse() * last, size).map_err(of)?;
        cameras.push(NamedCamera { name: image, ..camera });
    }
    if cameras.is_empty() {
        return Err(Problem::new("has no camera that is known").expected("P0, P1, … or P_rect_00, …").into());
    }
    Ok(cameras)
}
