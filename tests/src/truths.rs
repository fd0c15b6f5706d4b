//! File of the reference's images of scenes, for machines on which drawing them would take too long.
//!
//! The file is one gzip stream. A line names the format. Then follow, for each scene, a line with its name and size,
//! and its planes as f32. Bytes of equal significance are stored together, which makes the stream a third smaller.

use crate::harness::Truth;
use crate::scenes::{self, Case};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use surfel_render::{Frame, Planes};

/// First line of a file, which names its format and version.
const FORMAT: &str = "surfel truths 1";

/// Maximum side of an image in the file, in pixels.
pub const MOST_SIDE_PX: u32 = 256;
/// Number of floats per pixel: colour, depth, normal, weight, margin.
const FLOATS: usize = 10;

/// True if the file contains the image of this scene.
pub fn is_packed(case: &Case) -> bool {
    let region = case.view().region;
    region.width.max(region.height) <= MOST_SIDE_PX
}

/// Writes the images of those truths that the file contains.
///
/// # Errors
/// If the file can't be written, or if the reference refused a scene.
pub fn write(path: &Path, truths: &[Truth]) -> Result<(), Box<dyn std::error::Error>> {
    let mut out = GzEncoder::new(Vec::new(), Compression::best());
    writeln!(out, "{FORMAT}")?;
    for truth in truths.iter().filter(|truth| is_packed(&truth.case)) {
        let name = &truth.case.name;
        let frame = truth.want.as_ref().map_err(|error| format!("{name}: the reference refuses it: {error}"))?;
        writeln!(out, "{}\t{}\t{name}", frame.width(), frame.height())?;
        out.write_all(&shuffled(&floats(frame)))?;
    }
    let bytes = out.finish()?;
    surfel_io::atomic::write(path, true, |out| out.write_all(&bytes))?;
    Ok(())
}

/// Reads a file of images. Returns the truths of scenes that the file should contain and that `is_wanted` selects by
/// name.
///
/// # Errors
/// If the file is invalid, lacks a scene, or has a scene in another size. It then belongs to another version.
pub fn read(path: &Path, is_wanted: impl Fn(&str) -> bool) -> Result<Vec<Truth>, Box<dyn std::error::Error>> {
    let place = path.display();
    let mut images = images(path).map_err(|error| format!("{place}: {error}"))?;
    let cases = scenes::all().into_iter().filter(|case| is_packed(case) && is_wanted(&case.name));
    let truths = cases.map(|case| {
        let name = &case.name;
        let frame = images.remove(name).ok_or_else(|| {
            format!("{place}: holds no image of '{name}', which this program draws: build program and file together")
        })?;
        let region = case.view().region;
        if [frame.width(), frame.height()] != [region.width, region.height] {
            return Err(format!("{place}: '{name}' has another size in this program: build both together").into());
        }
        Ok(Truth { case, want: Ok(frame) })
    });
    truths.collect()
}

fn images(path: &Path) -> Result<HashMap<String, Frame>, Box<dyn std::error::Error>> {
    let file = std::fs::File::open(path)?;
    let mut input = BufReader::new(GzDecoder::new(BufReader::new(file)));
    let mut line = String::new();
    input.read_line(&mut line)?;
    if line.trim_end() != FORMAT {
        return Err(format!("begins with '{}', expected '{FORMAT}'", line.trim_end()).into());
    }
    let mut images = HashMap::new();
    loop {
        line.clear();
        if input.read_line(&mut line)? == 0 {
            return Ok(images);
        }
        let mut words = line.trim_end_matches('\n').splitn(3, '\t');
        let mut side = || words.next()?.parse().ok().filter(|side| *side <= MOST_SIDE_PX);
        let (Some(width), Some(height)) = (side(), side()) else {
            return Err(format!("has the line '{}', expected a size and a name", line.trim_end()).into());
        };
        let name = words.next().unwrap_or_default().to_owned();
        let mut bytes = vec![0; 4 * FLOATS * width as usize * height as usize];
        input.read_exact(&mut bytes).map_err(|error| format!("'{name}': {error}"))?;
        images.insert(name, frame(width, height, &ordered(&bytes)));
    }
}

/// Returns the floats of a frame, plane by plane.
fn floats(frame: &Frame) -> Vec<f32> {
    let planes =
        [frame.color().as_flattened(), frame.depth(), frame.normal().as_flattened(), frame.weight(), frame.margin()];
    planes.concat()
}

/// Creates the frame of these floats.
fn frame(width: u32, height: u32, floats: &[f32]) -> Frame {
    let mut frame = Frame::default();
    frame.reset(width, height, Planes::ALL.with_margin(true));
    let planes = frame.planes_mut();
    let targets =
        [planes.color.as_flattened_mut(), planes.depth, planes.normal.as_flattened_mut(), planes.weight, planes.margin];
    let mut rest = floats;
    for target in targets {
        let (plane, after) = rest.split_at(target.len());
        target.copy_from_slice(plane);
        rest = after;
    }
    frame
}

/// Returns the bytes of floats in the order of their significance: all first bytes, then all second bytes, and so on.
fn shuffled(floats: &[f32]) -> Vec<u8> {
    (0..4).flat_map(|k| floats.iter().map(move |value| value.to_le_bytes()[k])).collect()
}

/// Restores the floats from bytes in the order of [`shuffled`].
fn ordered(bytes: &[u8]) -> Vec<f32> {
    let count = bytes.len() / 4;
    (0..count).map(|i| f32::from_le_bytes([0, 1, 2, 3].map(|k| bytes[k * count + i]))).collect()
}
