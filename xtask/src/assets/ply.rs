//! Writer of disks as a PLY file in Surfel's splat profile (docs/format.md).

use std::fmt::Write as _;

/// Disk with its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Disk {
    pub(super) position: [f64; 3],
    /// Unit normal.
    pub(super) normal: [f64; 3],
    /// Radius, in the units of the file.
    pub(super) radius: f64,
    /// Colour as sRGB-encoded red, green, blue, and alpha.
    pub(super) color: [u8; 4],
}

/// Disks of one file, with its title.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cloud {
    pub(super) title: &'static str,
    pub(super) disks: Vec<Disk>,
}

impl Cloud {
    /// Returns a binary PLY file. It has the property `alpha` only if a disk isn't opaque.
    pub(super) fn to_ply(&self) -> Vec<u8> {
        let alpha = self.disks.iter().any(|disk| disk.color[3] < 255);
        let mut header = format!(
            "ply\nformat binary_little_endian 1.0\ncomment {}\ncomment up +y\nelement vertex {}\n",
            self.title,
            self.disks.len()
        );
        for name in ["x", "y", "z", "nx", "ny", "nz", "radius"] {
            // Writing to a string can't fail.
            let _ = writeln!(header, "property float {name}");
        }
        let levels = if alpha { 4 } else { 3 };
        for name in &["red", "green", "blue", "alpha"][..levels] {
            let _ = writeln!(header, "property uchar {name}");
        }
        header.push_str("end_header\n");
        let mut bytes = header.into_bytes();
        for disk in &self.disks {
            for value in disk.position.iter().chain(&disk.normal).chain([&disk.radius]) {
                bytes.extend_from_slice(&(*value as f32).to_le_bytes());
            }
            bytes.extend_from_slice(&disk.color[..levels]);
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ply_has_a_row_a_disk_and_alpha_only_where_it_says_something() {
        let disk = Disk { position: [1.0, 2.0, 3.0], normal: [0.0, 1.0, 0.0], radius: 0.5, color: [1, 2, 3, 255] };
        let size = |disks: &[Disk]| {
            let bytes = Cloud { title: "test", disks: disks.to_vec() }.to_ply();
            let end = b"end_header\n";
            let body = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
            bytes.len() - body
        };
        assert_eq!(size(&[disk, disk]), 2 * (7 * 4 + 3));
        assert_eq!(size(&[disk, Disk { color: [1, 2, 3, 254], ..disk }]), 2 * (7 * 4 + 4));
    }
}
