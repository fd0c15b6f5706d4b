//! Writing of NumPy archives (NPZ). Each channel of a plane, such as R or Z, is an array of height × width, with the
//! name of the channel in an EXR file.

use crate::planes::PlanesView;
use flate2::Crc;
use std::io::{self, Write};
use std::path::Path;
use surfel_files::atomic;
use surfel_files::error::IoError;

/// Writes all planes, except 8-bit colours, uncompressed: colours, depth, normals and weights as `<f4`, positions as
/// `<f8`, integers as `<u4`. `numpy.load(file)["Z"]` has the shape (height, width). Equal planes give equal bytes.
///
/// # Errors
/// [`io::Error`] if there is no plane, a plane has the wrong size, the file would have 4 GiB or more, or `out` fails.
pub fn write_npz(out: &mut dyn Write, planes: &PlanesView<'_>) -> io::Result<()> {
    let pixels = planes.pixels()?;
    let shape = [planes.height, planes.width];
    let mut archive = Archive { out, written: 0, directory: Vec::new(), members: 0 };
    let floats = |values: &mut dyn Iterator<Item = f32>| values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    for (i, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
        if let Some(color) = planes.color {
            archive.array(name, "<f4", shape, &floats(&mut color.iter().map(|c| c[i])))?;
        }
    }
    for (name, plane) in [("Z", planes.depth), ("weight", planes.weight)] {
        if let Some(plane) = plane {
            archive.array(name, "<f4", shape, &floats(&mut plane.iter().copied()))?;
        }
    }
    for (i, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
        if let Some(normal) = planes.normal {
            archive.array(&format!("normal.{axis}"), "<f4", shape, &floats(&mut normal.iter().map(|n| n[i])))?;
        }
        if let Some(position) = planes.position {
            let values: Vec<u8> = position.iter().flat_map(|p| p[i].to_le_bytes()).collect();
            archive.array(&format!("position.{axis}"), "<f8", shape, &values)?;
        }
    }
    for (name, plane) in &planes.whole {
        archive.array(name, "<u4", shape, &plane.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?;
    }
    for (name, plane) in &planes.other {
        archive.array(name, "<f4", shape, &floats(&mut plane.iter().copied()))?;
    }
    if archive.members == 0 {
        return Err(invalid(format!("there is no plane of the image's {pixels} pixels to write")));
    }
    archive.finish()
}

/// Writes an archive like [`write_npz`], to a file and atomically.
///
/// # Errors
/// [`IoError::Exists`] if the file exists and `overwrite` is false; [`IoError::System`].
pub fn save_npz(path: &Path, overwrite: bool, planes: &PlanesView<'_>) -> Result<(), IoError> {
    atomic::write(path, overwrite, |out| write_npz(out, planes))
}

fn invalid(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, message)
}

/// Writer of a ZIP file with uncompressed members.
struct Archive<'a> {
    out: &'a mut dyn Write,
    written: u64,
    directory: Vec<u8>,
    members: u16,
}

impl Archive<'_> {
    /// Appends an array of numbers as `NAME.npy`. `kind` is NumPy's name of the number type, and `values` are the
    /// numbers' bytes, row by row.
    fn array(&mut self, name: &str, kind: &str, [height, width]: [u32; 2], values: &[u8]) -> io::Result<()> {
        let mut header =
            format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({height}, {width}), }}").into_bytes();
        // Magic, version, length and header together are a multiple of 64 bytes. The header ends with a newline.
        let padded = (header.len() + 11).next_multiple_of(64) - 10;
        header.resize(padded - 1, b' ');
        header.push(b'\n');
        let mut head = b"\x93NUMPY\x01\x00".to_vec();
        head.extend((header.len() as u16).to_le_bytes());
        head.extend(header);
        let mut crc = Crc::new();
        crc.update(&head);
        crc.update(values);
        let name = format!("{name}.npy");
        let size = head.len() as u64 + values.len() as u64;
        let end = self.written + size + 2 * (name.len() as u64 + 64) + self.directory.len() as u64 + 64;
        let (Ok(start), Ok(size), Ok(_)) = (u32::try_from(self.written), u32::try_from(size), u32::try_from(end))
        else {
            return Err(invalid("planes of 4 GiB and more don't fit into an NPZ: write an EXR, or draw parts".into()));
        };
        // These fields are common to the member's two headers, before its bytes and in the directory: version 2.0, no
        // flags, no compression, date 1980-01-01, checksum, sizes and length of the name.
        let mut common = Vec::new();
        [20u16, 0, 0, 0, 0x21].iter().for_each(|v| common.extend(v.to_le_bytes()));
        [crc.sum(), size, size].iter().for_each(|v| common.extend(v.to_le_bytes()));
        [name.len() as u16, 0].iter().for_each(|v| common.extend(v.to_le_bytes()));
        self.put(b"PK\x03\x04")?;
        self.put(&common)?;
        self.put(name.as_bytes())?;
        self.put(&head)?;
        self.put(values)?;
        self.directory.extend(b"PK\x01\x02\x14\x00");
        self.directory.extend(&common);
        // No comment, first disk, no attributes.
        self.directory.extend([0; 10]);
        self.directory.extend(start.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.members += 1;
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.written += bytes.len() as u64;
        self.out.write_all(bytes)
    }

    fn finish(mut self) -> io::Result<()> {
        let (start, directory) = (self.written as u32, std::mem::take(&mut self.directory));
        self.put(&directory)?;
        let mut end = b"PK\x05\x06\x00\x00\x00\x00".to_vec();
        [self.members; 2].iter().for_each(|v| end.extend(v.to_le_bytes()));
        [directory.len() as u32, start].iter().for_each(|v| end.extend(v.to_le_bytes()));
        end.extend([0; 2]);
        self.put(&end)
    }
}
