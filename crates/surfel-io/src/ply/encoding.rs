//! Encodings of PLY data.

/// An encoding of PLY data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlyEncoding {
    /// Decimal text.
    Ascii,
    /// Binary, least significant byte first.
    #[default]
    BinaryLittleEndian,
    /// Binary, most significant byte first.
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
