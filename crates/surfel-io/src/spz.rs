//! Reader of SPZ: Gaussians compressed to few bits. Versions 1 to 3 are a gzip stream, version 4 has several Zstandard
//! streams.

use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem, quote};
use crate::gaussians::{Gaussians, Harmonics, Kind, SH_C0};
use crate::strided::f32_of_half;
use glam::{DQuat, DVec3};
use surfel_model::Column3;

/// Number of spherical-harmonic coefficients of a colour channel beyond the constant one, by degree.
const HARMONICS: [usize; 5] = [0, 3, 8, 15, 24];
/// Factor by which the file multiplies the coefficient of the constant spherical harmonic.
const COLOR_SCALE: f64 = 0.15;

struct Header {
    version: u32,
    points: usize,
    degree: usize,
    fractional_bits: u8,
    flags: u8,
}

impl Header {
    /// Returns the number of bytes per splat in each stream: positions, alphas, colours, scales, rotations, harmonics.
    fn stream_bytes(&self) -> [usize; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version <= 2 { 3 } else { 4 };
        [position, 1, 3, 3, rotation, 3 * HARMONICS[self.degree]]
    }
}

/// Reads the bytes of an SPZ file after gzip decompression; those of version 4 have no gzip.
pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let damaged = |what: String| {
        let problem = Problem::new(what).at(Location::Byte(bytes.len()));
        Fault::from(problem.help("copy or download the file again: it is incomplete or damaged"))
    };
    let Some((head, body)) = bytes.split_first_chunk::<16>() else {
        return Err(damaged("the file ends within its header".into()));
    };
    if !head.starts_with(b"NGSP") {
        let problem = Problem::new(format!("is no SPZ file: it starts with {}", quote(&head[..4])));
        return Err(problem.expected("the signature NGSP, in the file or in what gzip wraps").into());
    }
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let header = Header {
        version: word(4),
        points: word(8) as usize,
        degree: head[12].into(),
        fractional_bits: head[13],
        flags: head[14],
    };
    if !(1..=4).contains(&header.version) {
        let problem = Problem::new(format!("is an SPZ file of version {}", header.version)).at(Location::Byte(4));
        return Err(problem.expected("1, 2, 3 or 4").help("convert it to PLY first, e.g. with splat-transform").into());
    }
    if header.degree >= HARMONICS.len() || header.fractional_bits > 30 {
        let (degree, bits) = (header.degree, header.fractional_bits);
        return Err(damaged(format!("its header says harmonics of degree {degree} and {bits} bits of fraction")));
    }
    if header.points == 0 {
        return Err(Problem::new("holds no splat").into());
    }
    let sizes = header.stream_bytes().map(|n| n.checked_mul(header.points));
    let sizes = sizes.map(|n| n.unwrap_or(usize::MAX));
    if header.version < 4 {
        let mut rest = body;
        let mut streams = [&body[..0]; 6];
        for (stream, size) in streams.iter_mut().zip(sizes) {
            (*stream, rest) = rest
                .split_at_checked(size)
                .ok_or_else(|| damaged(format!("the file ends within its {} splats", header.points)))?;
        }
        return build(&header, streams, context);
    }
    let unpacked = streams_of_version_4(bytes, &header, sizes)?;
    build(&header, std::array::from_fn(|i| unpacked[i].as_slice()), context)
}

#[cfg(not(feature = "zstd"))]
fn streams_of_version_4(_: &[u8], _: &Header, _: [usize; 6]) -> Result<[Vec<u8>; 6], Fault> {
    let problem = Problem::new("is an SPZ file of version 4, and this build has no reader for Zstandard");
    let help = "build with the feature zstd, as by cargo run --release --features zstd -- FILE, or convert it to PLY";
    Err(problem.help(help).into())
}

/// Returns the unpacked streams of an SPZ file of version 4, in the order of [`Header::stream_bytes`]. `sizes` are
/// their expected sizes in bytes. In the file, a table has 16 bytes per stream, with packed and unpacked size. The
/// packed streams follow, one after another.
#[cfg(feature = "zstd")]
fn streams_of_version_4(bytes: &[u8], header: &Header, sizes: [usize; 6]) -> Result<[Vec<u8>; 6], Fault> {
    use std::io::Read;
    let damaged = |what: &str| {
        let problem = Problem::new(what).help("copy or download the file again: it is incomplete or damaged");
        Fault::from(problem)
    };
    let cut = || damaged("the file ends within its streams");
    let count = usize::from(*bytes.get(15).ok_or_else(cut)?);
    let needed = if header.degree == 0 { 5 } else { 6 };
    let table = bytes.get(16..).and_then(<[u8]>::first_chunk::<4>).map(|w| u32::from_le_bytes(*w) as usize);
    let rest = bytes.get(table.ok_or_else(cut)?..).ok_or_else(cut)?;
    let (table, mut rest) = rest.split_at_checked(16 * count).ok_or_else(cut)?;
    if count < needed {
        return Err(damaged("it lacks one of its streams"));
    }
    let mut streams: [Vec<u8>; 6] = Default::default();
    for ((entry, stream), size) in table.as_chunks::<16>().0.iter().zip(&mut streams).zip(sizes) {
        let [packed, whole] = [0, 8].map(|at| u64::from_le_bytes(std::array::from_fn(|i| entry[at + i])));
        let packed = usize::try_from(packed).map_err(|_| cut())?;
        let (data, after) = rest.split_at_checked(packed).ok_or_else(cut)?;
        rest = after;
        // The unpacked size has the same limit relative to the file's size as with gzip.
        if whole != size as u64 || whole > crate::files::most_unpacked(bytes.len()) {
            return Err(damaged("a stream's size doesn't fit the number of splats"));
        }
        let decoder = ruzstd::decoding::StreamingDecoder::new(data).map_err(|_| damaged("a stream is damaged"))?;
        let read = decoder.take(whole + 1).read_to_end(stream);
        if read.is_err() || stream.len() != size {
            return Err(damaged("a stream is damaged"));
        }
    }
    Ok(streams)
}

fn build(header: &Header, streams: [&[u8]; 6], context: &mut Context<'_>) -> Result<Content, Fault> {
    let [positions, alphas, colors, scales, rotations, rest] = streams;
    let harmonics = match header.degree {
        0 => Harmonics::None,
        // RGB rows, one per coefficient; 128 is zero.
        degree @ 1..=3 => {
            let value = |c: u8| (f32::from(c) - 128.0) / 128.0;
            Harmonics::Read(degree as u32, rest.as_chunks::<3>().0.iter().map(|c| c.map(value)).collect())
        }
        degree => Harmonics::Unread(Some(3 * HARMONICS[degree])),
    };
    if header.flags & 2 != 0 {
        context.note("ignored the file's extensions, of which one can turn its axes".into());
    }
    let unit = f64::from(header.fractional_bits).exp2().recip();
    let center = |p: &[u8]| match *p {
        [a, b, c, d, e, f] => {
            DVec3::from([[a, b], [c, d], [e, f]].map(|h| f64::from(f32_of_half(u16::from_le_bytes(h)))))
        }
        _ => {
            // 24-bit signed numbers.
            let fixed = |i: usize| i32::from_le_bytes([0, p[i], p[i + 1], p[i + 2]]) >> 8;
            DVec3::from([0, 3, 6].map(|i| f64::from(fixed(i)) * unit))
        }
    };
    let [position_bytes, _, _, _, rotation_bytes, _] = header.stream_bytes();
    let level = |c: &u8| f64::from(*c) / 255.0;
    let rotation = |r: &[u8]| match *r {
        [a, b, c, d] => smallest_three(u32::from_le_bytes([a, b, c, d])),
        _ => {
            let [x, y, z] = [0, 1, 2].map(|i| f64::from(r[i]) / 127.5 - 1.0);
            DQuat::from_xyzw(x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt())
        }
    };
    context.gaussians(Gaussians {
        origin: DVec3::ZERO,
        centers: Column3::from_f32(positions.chunks_exact(position_bytes).map(|p| center(p).as_vec3()).collect()),
        kind: Kind::Solid,
        sigmas: scales
            .as_chunks::<3>()
            .0
            .iter()
            .map(|s| DVec3::from(s.map(|s| (f64::from(s) / 16.0 - 10.0).exp())))
            .collect(),
        rotations: rotations.chunks_exact(rotation_bytes).map(rotation).collect(),
        alphas: alphas.iter().map(|a| level(a) as f32).collect(),
        display_colors: colors
            .as_chunks::<3>()
            .0
            .iter()
            .map(|c| c.map(|c| 0.5 + SH_C0 * (level(&c) - 0.5) / COLOR_SCALE))
            .collect(),
        harmonics,
        linear_colors: false,
        up: None,
        comments: Vec::new(),
    })
}

/// Unpacks a unit quaternion without its largest component. The component's index has 2 bits, and the others have a
/// sign and 9 bits each, the last of them in the lowest bits.
fn smallest_three(mut packed: u32) -> DQuat {
    let largest = (packed >> 30) as usize;
    let (mut parts, mut squares) = ([0.0; 4], 0.0);
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = f64::from(packed & 511) / 511.0 * std::f64::consts::FRAC_1_SQRT_2;
        parts[i] = if packed & 512 != 0 { -magnitude } else { magnitude };
        squares += magnitude * magnitude;
        packed >>= 10;
    }
    parts[largest] = (1.0 - squares).max(0.0).sqrt();
    DQuat::from_array(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_rotations_are_within_half_a_step() {
        for i in 1..2000_u32 {
            let f = |k: f64| (f64::from(i) * k).sin();
            let q = DQuat::from_xyzw(f(1.3), f(2.1), f(0.7), f(3.9)).normalize().to_array();
            let largest = (0..4).max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs())).unwrap();
            let mut packed = largest as u32;
            for part in (0..4).filter(|&k| k != largest).map(|k| q[k] * q[largest].signum()) {
                let magnitude = (part.abs() * std::f64::consts::SQRT_2 * 511.0).round() as u32;
                packed = packed << 10 | u32::from(part < 0.0) << 9 | magnitude;
            }
            let back = smallest_three(packed).to_array();
            for k in 0..4 {
                let error = back[k] - q[k] * q[largest].signum();
                // The error of three components is half a step of 1/(511·√2); the fourth component, at least ½, has the
                // sum of their errors.
                assert!(error.abs() <= 3.0 * 0.5 / 511.0, "{i}: {q:?} {back:?}");
            }
        }
    }
}
