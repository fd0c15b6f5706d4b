//! Conversion of point records to the formats that COPC allows: 6, 7 (with colours) and 8 (with near infrared, too).

use super::super::field;
use super::super::header::POINT_BYTES;

/// Returns the point format that COPC allows and that has all fields of `format` except waveforms.
pub(super) fn target(format: u8) -> u8 {
    match format {
        2 | 3 | 5 | 7 => 7,
        8 | 10 => 8,
        _ => 6,
    }
}

/// Appends the record `r` of point format `format`, converted to the format that [`target`] returns. Extra bytes aren't
/// appended.
pub(super) fn append(format: u8, r: &[u8], out: &mut Vec<u8>) {
    if format >= 6 {
        return out.extend_from_slice(&r[..POINT_BYTES[usize::from(target(format))]]);
    }
    // Position and intensity have the same offsets.
    out.extend_from_slice(&r[..14]);
    let (returns, class) = (r[14], r[15]);
    out.push((returns & 7) | (returns >> 3 & 7) << 4);
    // Flags synthetic, key point and withheld, then scan direction and edge of flight line.
    out.push((class >> 5) | returns & 0xc0);
    out.push(class & 31);
    out.push(r[17]);
    // Whole degrees become steps of 0.006 degrees.
    let angle = (f64::from(r[16] as i8) / 0.006).round() as i16;
    out.extend_from_slice(&angle.to_le_bytes());
    out.extend_from_slice(&r[18..20]);
    let has_time = matches!(format, 1 | 3 | 4 | 5);
    let time: [u8; 8] = if has_time { field(r, 20) } else { [0; 8] };
    out.extend_from_slice(&time);
    match format {
        2 => out.extend_from_slice(&r[20..26]),
        3 | 5 => out.extend_from_slice(&r[28..34]),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_formats_keep_every_bit_that_means_something() {
        let mut old = vec![0_u8; 34];
        for (i, byte) in old.iter_mut().enumerate() {
            *byte = (i * 7 + 1) as u8;
        }
        // Return 3 of 5, scan direction and edge; class 12, synthetic and withheld; −20 degrees.
        (old[14], old[15], old[16]) = (3 | 5 << 3 | 0xc0, 12 | 1 << 5 | 1 << 7, (-20_i8) as u8);
        let mut new = Vec::new();
        append(3, &old, &mut new);
        assert_eq!(new.len(), POINT_BYTES[7]);
        assert_eq!((&new[..14], new[14], new[15], new[16]), (&old[..14], 3 | 5 << 4, 0xc5, 12));
        assert_eq!(f64::from(i16::from_le_bytes([new[18], new[19]])) * 0.006, -19.998);
        assert_eq!(
            (new[17], &new[20..22], &new[22..30], &new[30..36]),
            (old[17], &old[18..20], &old[20..28], &old[28..34])
        );
        for format in 0..11_u8 {
            let mut new = Vec::new();
            append(format, &[0; 67], &mut new);
            assert_eq!(new.len(), POINT_BYTES[usize::from(target(format))], "{format}");
        }
    }
}
