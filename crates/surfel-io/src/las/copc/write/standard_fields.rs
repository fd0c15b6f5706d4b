//! Standard fields of LAS point records that columns of the same name fill, and names that extra bytes can't have.

use super::value_range::ValueRange;
use crate::las::header::RENAMED_SUFFIX;

/// Step of scan angles in point formats 6 to 10, in degrees (LAS 1.4 R15, table 15).
const ANGLE_STEP_DEG: f64 = 0.006;

/// Encoding of a standard field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    /// `count` bits of a byte, above the lowest `shift` bits.
    Bits { shift: u8, count: u8 },
    /// An unsigned 16-bit number.
    U16,
    /// A signed 16-bit number of [`ANGLE_STEP_DEG`].
    Angle,
    /// A 64-bit float.
    F64,
}

/// Standard field of a point record of formats 6 to 10.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct StandardField {
    /// Name as a column, in small letters.
    name: &'static str,
    /// Byte offset in a record.
    at: usize,
    encoding: Encoding,
}

const fn bits(name: &'static str, at: usize, shift: u8, count: u8) -> StandardField {
    StandardField { name, at, encoding: Encoding::Bits { shift, count } }
}

const fn number(name: &'static str, at: usize, encoding: Encoding) -> StandardField {
    StandardField { name, at, encoding }
}

/// Standard fields that a column may fill (LAS 1.4 R15, table 15). The flag *withheld* isn't among them: withheld
/// points are skipped when a file is drawn, and a column of this name asks for nothing.
const FIELDS: [StandardField; 13] = [
    number("intensity", 12, Encoding::U16),
    bits("return_number", 14, 0, 4),
    bits("number_of_returns", 14, 4, 4),
    bits("synthetic", 15, 0, 1),
    bits("key_point", 15, 1, 1),
    bits("overlap", 15, 3, 1),
    bits("scanner_channel", 15, 4, 2),
    bits("edge_of_flight_line", 15, 7, 1),
    bits("classification", 16, 0, 8),
    bits("user_data", 17, 0, 8),
    number("scan_angle", 18, Encoding::Angle),
    number("point_source_id", 20, Encoding::U16),
    number("gps_time", 22, Encoding::F64),
];

/// Further names of the standard's dimensions. laspy refuses files whose extra bytes have such a name.
const RESERVED: [&str; 10] =
    ["x", "y", "z", "red", "green", "blue", "withheld", "scan_direction_flag", "bit_fields", "classification_flags"];

/// True if two names of columns differ at most in case and in underscores, as `GpsTime` and `gps_time` do.
fn is_same(a: &str, b: &str) -> bool {
    let letters = |name: &str| name.chars().filter(|c| *c != '_').map(|c| c.to_ascii_lowercase()).collect::<String>();
    letters(a) == letters(b)
}

impl StandardField {
    /// Returns the standard field that a column fills: the one of its name, if the field can store all of its values.
    pub(super) fn for_column(name: &str, range: &ValueRange) -> Option<Self> {
        FIELDS.into_iter().find(|field| is_same(field.name, name)).filter(|field| field.can_store(range))
    }

    /// Returns the name in a file of extra bytes for a column that has the name of a field, with [`RENAMED_SUFFIX`];
    /// `None` if the column can have its own name.
    pub(super) fn renamed(name: &str) -> Option<String> {
        let is_reserved = FIELDS.iter().map(|field| field.name).chain(RESERVED).any(|field| is_same(field, name));
        // Names have at most 31 bytes.
        let shortened = || name.chars().take(31 - RENAMED_SUFFIX.len()).collect::<String>();
        is_reserved.then(|| shortened() + RENAMED_SUFFIX)
    }

    /// True if the field is the return number or the number of returns. A file has both or none.
    pub(super) fn is_of_returns(&self) -> bool {
        self.at == 14
    }

    /// True if the field can store all values of a column: exactly, except that scan angles are rounded to their step.
    fn can_store(&self, range: &ValueRange) -> bool {
        let is_whole_up_to = |most: f64| range.whole && range.min >= 0.0 && range.max <= most;
        match self.encoding {
            Encoding::Bits { count, .. } => is_whole_up_to(f64::from((1_u16 << count) - 1)),
            Encoding::U16 => is_whole_up_to(f64::from(u16::MAX)),
            Encoding::Angle => range.all_finite && range.min >= -180.0 && range.max <= 180.0,
            Encoding::F64 => range.all_finite,
        }
    }

    /// Writes a value into a record.
    pub(super) fn put(&self, record: &mut [u8], value: f64) {
        match self.encoding {
            Encoding::Bits { shift, count } => {
                let mask = (((1_u16 << count) - 1) << shift) as u8;
                record[self.at] = record[self.at] & !mask | (value as u8) << shift & mask;
            }
            Encoding::U16 => record[self.at..self.at + 2].copy_from_slice(&(value as u16).to_le_bytes()),
            Encoding::Angle => {
                let steps = (value / ANGLE_STEP_DEG).round() as i16;
                record[self.at..self.at + 2].copy_from_slice(&steps.to_le_bytes());
            }
            Encoding::F64 => record[self.at..self.at + 8].copy_from_slice(&value.to_le_bytes()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(values: &[f64]) -> ValueRange {
        let mut range = ValueRange::none();
        values.iter().for_each(|value| range.add(*value));
        range
    }

    #[test]
    fn columns_fill_fields_that_can_store_them() {
        let fills = |name: &str, values: &[f64]| StandardField::for_column(name, &range(values)).is_some();
        assert!(fills("classification", &[0.0, 255.0]) && fills("Classification", &[2.0]) && fills("GpsTime", &[0.5]));
        for wrong in [[0.0, 256.0], [-1.0, 2.0], [0.5, 2.0], [f64::NAN, 2.0]] {
            assert!(!fills("classification", &wrong), "{wrong:?}");
        }
        assert!(fills("return_number", &[1.0, 15.0]) && !fills("return_number", &[16.0]));
        assert!(fills("scan_angle", &[-20.5, 20.0]) && !fills("scan_angle", &[181.0]));
        assert!(!fills("gps_time", &[f64::NAN]) && !fills("withheld", &[1.0]) && !fills("class", &[1.0]));
        let renamed = ["withheld", "Red", "class", "label"].map(StandardField::renamed);
        assert_eq!(renamed.each_ref().map(Option::as_deref), [Some("withheld_2"), Some("Red_2"), None, None]);
        assert_eq!(StandardField::renamed(&format!("{}gps_time", "_".repeat(23))).unwrap().len(), 31);
    }

    #[test]
    fn values_are_written_where_the_standard_has_them() {
        let mut record = [0_u8; 30];
        record[14] = 0x11;
        for (name, value) in [
            ("intensity", 40_000.0),
            ("return_number", 2.0),
            ("number_of_returns", 5.0),
            ("overlap", 1.0),
            ("scanner_channel", 2.0),
            ("classification", 200.0),
            ("user_data", 7.0),
            ("scan_angle", -12.0),
            ("point_source_id", 513.0),
            ("gps_time", 123.25),
        ] {
            StandardField::for_column(name, &range(&[value])).unwrap().put(&mut record, value);
        }
        assert_eq!(u16::from_le_bytes([record[12], record[13]]), 40_000);
        assert_eq!(record[14..18], [0x52, 0b10_1000, 200, 7]);
        assert_eq!(i16::from_le_bytes([record[18], record[19]]), -2000);
        assert_eq!(record[20..22], [1, 2]);
        assert_eq!(f64::from_le_bytes(record[22..30].try_into().unwrap()), 123.25);
    }
}
