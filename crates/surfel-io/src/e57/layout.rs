//! Layout of an E57 scan: its pose, and the records with coordinates, colours, normals and other columns. In the terms
//! of the crate `e57`, a *record* is a field that each point of a scan has, and the *prototype* is the list of these
//! records.

use crate::survey::{NORMAL_NAMES, plain_name};
use ::e57::{PointCloud as Scan, Record, RecordDataType, RecordName, RecordValue};
use glam::{DMat3, DQuat, DVec3, Vec3};

/// Returns the name of the column that a record becomes; `None` for records that aren't read as a column of their own.
fn column_name(name: &RecordName) -> Option<String> {
    Some(match name {
        RecordName::Intensity => "intensity".into(),
        RecordName::RowIndex => "row_index".into(),
        RecordName::ColumnIndex => "column_index".into(),
        RecordName::ReturnCount => "return_count".into(),
        RecordName::ReturnIndex => "return_index".into(),
        RecordName::TimeStamp => "time_stamp".into(),
        RecordName::Unknown { name, .. } if !NORMAL_NAMES.contains(&plain_name(name).as_str()) => name.clone(),
        _ => return None,
    })
}

/// Converts a stored value to a number. `kind`, the type of the value's record, states scale and offset of scaled
/// integers.
fn number(value: &RecordValue, kind: &RecordDataType) -> f64 {
    match (value, kind) {
        (RecordValue::Single(v), _) => f64::from(*v),
        (RecordValue::Double(v), _) => *v,
        (RecordValue::ScaledInteger(v), RecordDataType::ScaledInteger { scale, offset, .. }) => {
            *v as f64 * scale + offset
        }
        (RecordValue::ScaledInteger(v) | RecordValue::Integer(v), _) => *v as f64,
    }
}

/// Returns the number of bits that each value of a record takes in the file.
fn bits(kind: &RecordDataType) -> u32 {
    match *kind {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::ScaledInteger { min, max, .. } | RecordDataType::Integer { min, max } => {
            64 - max.abs_diff(min).leading_zeros()
        }
    }
}

/// Returns the minimum and maximum of a colour channel (0 red, 1 green, 2 blue) that the scan or else the record's type
/// states. Returns `None` if neither states a valid range.
fn color_range(scan: &Scan, record: &Record, channel: usize) -> Option<(f64, f64)> {
    let limits = scan.color_limits.as_ref().and_then(|l| {
        let (min, max) = match channel {
            0 => (&l.red_min, &l.red_max),
            1 => (&l.green_min, &l.green_max),
            _ => (&l.blue_min, &l.blue_max),
        };
        Some((number(min.as_ref()?, &record.data_type), number(max.as_ref()?, &record.data_type)))
    });
    let of_type = || match record.data_type {
        RecordDataType::Single { min, max } => Some((min?.into(), max?.into())),
        RecordDataType::Double { min, max } => Some((min?, max?)),
        RecordDataType::ScaledInteger { min, max, scale, offset } => {
            Some((min as f64 * scale + offset, max as f64 * scale + offset))
        }
        RecordDataType::Integer { min, max } => Some((min as f64, max as f64)),
    };
    let fine = |(min, max): &(f64, f64)| (max - min).is_finite() && max - min > 0.0 && max - min < 1e12;
    limits.filter(fine).or_else(|| of_type().filter(fine))
}

/// Record indices of red, green and blue, and the minimum and maximum of each channel's values.
pub(super) type ColorRecords = ([usize; 3], [(f64, f64); 3]);

/// A column of a scan that is neither position, colour nor normal.
#[derive(Clone, Debug)]
pub(super) struct OtherColumn {
    pub(super) name: String,
    /// Index of the column's record in a row of values.
    pub(super) record: usize,
    /// Index of the record that flags the column's invalid values, if there is one.
    invalid: Option<usize>,
}

/// Layout of a scan's rows: the scan's pose, and the record indices of its values. It converts rows to points.
pub(super) struct Layout<'a> {
    pub(super) scan: &'a Scan,
    pub(super) index: u32,
    /// Record indices of x, y, z, or of range, azimuth and elevation.
    position: [usize; 3],
    spherical: bool,
    invalid: Option<usize>,
    pub(super) color: Option<ColorRecords>,
    color_invalid: Option<usize>,
    pub(super) normal: Option<[usize; 3]>,
    /// Columns other than position, colour and normal.
    pub(super) extras: Vec<OtherColumn>,
    rotation: DMat3,
    translation: DVec3,
}

impl<'a> Layout<'a> {
    /// Determines a scan's layout from its prototype. Returns `None` if the scan has no coordinates. Adds notes on
    /// missing limits of colours and on an invalid rotation.
    pub(super) fn new(scan: &'a Scan, index: u32, notes: &mut Vec<String>) -> Option<Self> {
        let at = |name: &RecordName| scan.prototype.iter().position(|r| r.name == *name);
        let triple = |names: [RecordName; 3]| -> Option<[usize; 3]> {
            let [a, b, c] = names;
            Some([at(&a)?, at(&b)?, at(&c)?])
        };
        let xyz = triple([RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ]);
        let angles = [RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation];
        let (position, spherical) = match xyz {
            Some(xyz) => (xyz, false),
            None => (triple(angles)?, true),
        };
        let state = if spherical { RecordName::SphericalInvalidState } else { RecordName::CartesianInvalidState };
        let color = triple([RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue]).map(|at| {
            let mut assumed = false;
            let ranges = [0, 1, 2].map(|k| {
                color_range(scan, &scan.prototype[at[k]], k).unwrap_or_else(|| {
                    assumed = true;
                    (0.0, 255.0)
                })
            });
            if assumed {
                notes.push("took the colours as from 0 to 255: the file says no limits".into());
            }
            (at, ranges)
        });
        let named = |wanted: &str| {
            let is = |r: &Record| matches!(&r.name, RecordName::Unknown { name, .. } if plain_name(name) == wanted);
            scan.prototype.iter().position(is)
        };
        let normal = named("normalx").zip(named("normaly")).zip(named("normalz")).map(|((x, y), z)| [x, y, z]);
        let mut extras = Vec::new();
        for (i, record) in scan.prototype.iter().enumerate() {
            let Some(name) = column_name(&record.name) else { continue };
            let invalid = match record.name {
                RecordName::Intensity => at(&RecordName::IsIntensityInvalid),
                RecordName::TimeStamp => at(&RecordName::IsTimeStampInvalid),
                _ => None,
            };
            extras.push(OtherColumn { name, record: i, invalid });
        }
        let pose = scan.transform.clone().unwrap_or_default();
        let (q, t) = (pose.rotation, pose.translation);
        let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
        let turned = rotation.is_finite() && rotation.length() > 1e-9;
        if !turned {
            notes.push(format!("scan {} has no valid rotation: it is left unturned", index + 1));
        }
        let rotation = if turned { DMat3::from_quat(rotation.normalize()) } else { DMat3::IDENTITY };
        Some(Self {
            scan,
            index,
            position,
            spherical,
            invalid: at(&state),
            color,
            color_invalid: at(&RecordName::IsColorInvalid),
            normal,
            extras,
            rotation,
            translation: DVec3::new(t.x, t.y, t.z),
        })
    }

    pub(super) fn bits_per_point(&self) -> u64 {
        self.scan.prototype.iter().map(|r| u64::from(bits(&r.data_type))).sum()
    }

    /// Returns the value of record `i` in a point's row.
    pub(super) fn value(&self, row: &[RecordValue], i: usize) -> f64 {
        number(&row[i], &self.scan.prototype[i].data_type)
    }

    fn is_flagged(&self, row: &[RecordValue], i: Option<usize>) -> bool {
        i.is_some_and(|i| self.value(row, i) != 0.0)
    }

    /// True unless the point is flagged as invalid.
    pub(super) fn is_valid(&self, row: &[RecordValue]) -> bool {
        !self.is_flagged(row, self.invalid)
    }

    /// Returns a point's position in the file's coordinates, with the scan's pose applied.
    pub(super) fn place(&self, row: &[RecordValue]) -> DVec3 {
        let [a, b, c] = self.position.map(|i| self.value(row, i));
        let local = if self.spherical {
            let (azimuth, elevation) = (b.sin_cos(), c.sin_cos());
            a * DVec3::new(elevation.1 * azimuth.1, elevation.1 * azimuth.0, elevation.0)
        } else {
            DVec3::new(a, b, c)
        };
        self.rotation * local + self.translation
    }

    /// Returns a point's normal, with the scan's pose applied; zero if there is none.
    pub(super) fn normal(&self, row: &[RecordValue]) -> Vec3 {
        let turned = |n: [usize; 3]| (self.rotation * DVec3::from(n.map(|i| self.value(row, i)))).as_vec3();
        self.normal.map_or(Vec3::ZERO, turned)
    }

    /// Returns a point's red, green and blue levels, in the layout's ranges; `None` if the point has no colour.
    pub(super) fn levels(&self, row: &[RecordValue]) -> Option<[f64; 3]> {
        let (at, _) = self.color.filter(|_| !self.is_flagged(row, self.color_invalid))?;
        Some(at.map(|i| self.value(row, i)))
    }

    /// Returns a point's value in one of the other columns; 0 if the value is flagged as invalid.
    pub(super) fn extra(&self, row: &[RecordValue], column: &OtherColumn) -> f64 {
        if self.is_flagged(row, column.invalid) { 0.0 } else { self.value(row, column.record) }
    }

    /// Returns the position of the scanner in the file's coordinates; `None` unless the scan shows that the scanner
    /// stood in one place.
    pub(super) fn viewpoint(&self) -> Option<DVec3> {
        let stands = self.spherical || self.scan.has_spherical() || self.scan.has_row_column();
        // Angles, or rows and columns, show that the scanner didn't move.
        Some(self.translation).filter(|at| stands && at.is_finite())
    }
}
