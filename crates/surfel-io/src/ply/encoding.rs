//! Encodings of PLY data.

/// An encoding of PLY data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlyEncoding {
    /// Numbers as decimal text.
    Ascii,
    /// Binary numbers, least significant byte first.
    #[default]
    BinaryLittleEndian,
    /// Binary numbers, most significant byte first.
    BinaryBigEndian,
}

impl PlyEncoding {
    /// Returns the encoding's name in a header's format line.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::BinaryLittleEndian => "binary_little_endian",
            Self::BinaryBigEndian => "binary_big_endian",
        }
    }
}
