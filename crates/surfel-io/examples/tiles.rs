//! Writes a survey flight over generated terrain as LAZ tiles of a million points each, to measure how conversion
//! scales. Usage: `cargo run --release -p surfel-io --example tiles -- FOLDER TILES`. Each run writes the same tiles,
//! and more tiles include all tiles of a smaller run. `cargo xtask growth` runs it.

use laz::laszip::LasZipCompressor;
use laz::{LazVlr, LazVlrBuilder};
use rayon::prelude::*;
use std::error::Error;
use std::io::Cursor;
use std::path::Path;

/// Points along a tile's side, and their spacing in millimetres.
const SIDE: u32 = 1000;
const APART_MM: f64 = 100.0;
const CHUNK_POINTS: usize = 50_000;
/// LAS point format with GPS time and colour.
const FORMAT: u8 = 7;
const RECORD_BYTES: usize = 36;
const HEADER_BYTES: usize = 375;

/// Returns a pseudorandom number from 0 to 1 for a cell.
fn hash(x: i64, y: i64, what: u64) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f) ^ what;
    for _ in 0..2 {
        h = (h ^ h >> 31).wrapping_mul(0xd6e8_feb8_6659_fd93);
    }
    (h >> 11) as f64 / (1_u64 << 53) as f64
}

/// Returns the height of the terrain in millimetres: hills from 300 m down to 3 m across. `x` and `y` are in
/// millimetres.
fn land(x: f64, y: f64) -> f64 {
    let wave = |length: f64, height: f64| height * (x / length).sin() * (y / (1.13 * length) + 1.0).cos();
    wave(50_000.0, 12_000.0) + wave(11_000.0, 1500.0) + wave(500.0, 60.0)
}

/// Returns height and colour at a position, in millimetres: terrain, and a house in about every third square of 25 m.
fn surface(x: f64, y: f64) -> (f64, [u16; 3]) {
    let square = [x, y].map(|v| (v / 25_000.0).floor());
    let within = [x - square[0] * 25_000.0, y - square[1] * 25_000.0];
    let of = |what: u64| hash(square[0] as i64, square[1] as i64, what);
    let is_house = of(1) < 0.33 && within.iter().all(|v| (6000.0..18_000.0).contains(v));
    if is_house {
        let middle = [0, 1].map(|k| square[k] * 25_000.0 + 12_000.0);
        let roof = land(middle[0], middle[1]) + 6000.0 + 4000.0 * of(2) - (within[0] - 12_000.0).abs() * 0.5;
        return (roof, [45_000, 16_000 + (9000.0 * of(3)) as u16, 12_000]);
    }
    let z = land(x, y);
    let wet = ((z + 13_000.0) / 26_000.0).clamp(0.0, 1.0);
    (z, [(14_000.0 + 26_000.0 * wet) as u16, (34_000.0 - 6000.0 * wet) as u16, (9000.0 + 9000.0 * wet) as u16])
}

/// Returns the records of a tile, line by line as a scanner writes them.
fn points(tile: [u32; 2]) -> (Vec<u8>, [i32; 2]) {
    let mut bytes = Vec::with_capacity((SIDE * SIDE) as usize * RECORD_BYTES);
    let mut ends = [i32::MAX, i32::MIN];
    for row in 0..SIDE {
        for column in 0..SIDE {
            let at = [tile[0] * SIDE + column, tile[1] * SIDE + row].map(i64::from);
            let jitter = [4, 5].map(|what| 0.8 * (hash(at[0], at[1], what) - 0.5));
            let [x, y] = [0, 1].map(|k| ((at[k] as f64 + 0.5 + jitter[k]) * APART_MM).round());
            let (height, color) = surface(x, y);
            // Scanner noise of 10 mm.
            let noise = 10.0 * ((6..12).map(|what| hash(at[0], at[1], what)).sum::<f64>() - 3.0) * 2_f64.sqrt();
            let z = (height + noise).round() as i32;
            ends = [ends[0].min(z), ends[1].max(z)];
            [x as i32, y as i32, z].iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
            let light = 0.9 + 0.2 * hash(at[0], at[1], 12);
            let intensity = (20_000.0 * light) as u16;
            bytes.extend_from_slice(&intensity.to_le_bytes());
            // A single return, class ground, with the scan angle from the column.
            bytes.extend_from_slice(&[0x11, 0, 2, 0]);
            bytes.extend_from_slice(&((column as i16 - 500) * 5).to_le_bytes());
            bytes.extend_from_slice(&1_u16.to_le_bytes());
            let pulse = (u64::from(tile[1]) * 1000 + u64::from(tile[0])) * 1_000_000 + u64::from(row * SIDE + column);
            bytes.extend_from_slice(&(1e8 + pulse as f64 * 2e-6).to_le_bytes());
            color.iter().for_each(|v| bytes.extend_from_slice(&((f64::from(*v) * light) as u16).to_le_bytes()));
        }
    }
    (bytes, ends)
}

fn header(tile: [u32; 2], heights: [i32; 2], vlr: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; HEADER_BYTES];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, b"LASF");
    put(24, &[1, 4]);
    put(94, &(HEADER_BYTES as u16).to_le_bytes());
    put(96, &((HEADER_BYTES + 54 + vlr.len()) as u32).to_le_bytes());
    put(100, &1_u32.to_le_bytes());
    put(104, &[FORMAT | 0x80]);
    put(105, &(RECORD_BYTES as u16).to_le_bytes());
    let side = f64::from(SIDE) * APART_MM;
    let low = [f64::from(tile[0]) * side, f64::from(tile[1]) * side, f64::from(heights[0])];
    let high = [low[0] + side, low[1] + side, f64::from(heights[1])];
    for (k, offset) in [500_000.0, 5_000_000.0, 400.0].into_iter().enumerate() {
        put(131 + 8 * k, &0.001_f64.to_le_bytes());
        put(155 + 8 * k, &f64::to_le_bytes(offset));
        put(179 + 16 * k, &(high[k] * 0.001 + offset).to_le_bytes());
        put(187 + 16 * k, &(low[k] * 0.001 + offset).to_le_bytes());
    }
    for at in [247, 255] {
        put(at, &u64::from(SIDE * SIDE).to_le_bytes());
    }
    let mut record = [0; 54];
    record[2..16].copy_from_slice(b"laszip encoded");
    record[18..20].copy_from_slice(&22_204_u16.to_le_bytes());
    record[20..22].copy_from_slice(&(vlr.len() as u16).to_le_bytes());
    bytes.extend_from_slice(&record);
    bytes.extend_from_slice(vlr);
    bytes
}

fn write(path: &Path, tile: [u32; 2]) -> Result<(), Box<dyn Error + Send + Sync>> {
    let laz: LazVlr =
        LazVlrBuilder::default().with_point_format(FORMAT, 0)?.with_fixed_chunk_size(CHUNK_POINTS as u32).build();
    let mut vlr = Vec::new();
    laz.write_to(&mut vlr)?;
    let (points, heights) = points(tile);
    // The chunk table has offsets in the file, so that the points are compressed after its header.
    let mut file = Cursor::new(header(tile, heights, &vlr));
    file.set_position(file.get_ref().len() as u64);
    let mut compressor = LasZipCompressor::new(file, laz)?;
    compressor.compress_many(&points)?;
    compressor.done()?;
    Ok(std::fs::write(path, compressor.into_inner().into_inner())?)
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(folder), Some(count)) = (arguments.next(), arguments.next()) else {
        return Err("expected FOLDER TILES".into());
    };
    let (folder, count) = (Path::new(&folder), count.parse::<u32>()?);
    std::fs::create_dir_all(folder)?;
    let along = f64::from(count).sqrt().ceil() as u32;
    (0..count).into_par_iter().try_for_each(|i| {
        let tile = [i % along, i / along];
        write(&folder.join(format!("{}-{}.laz", tile[0], tile[1])), tile)
    })
}
