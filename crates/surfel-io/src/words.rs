//! Formatting of counts and sizes in messages.

/// Formats a count with its noun, given in plural: `1 point`, `2 points`.
pub fn counted(count: u64, plural: &str) -> String {
    match (count, plural) {
        (1, "vertices") => "1 vertex".to_owned(),
        (1, _) => format!("1 {}", plural.strip_suffix('s').unwrap_or(plural)),
        _ => format!("{count} {plural}"),
    }
}

/// Formats a number of bytes in decimal units: `402 kB` and `20 MB`, rounded up, or `1.5 GB`.
pub fn byte_size(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{} kB", bytes.div_ceil(1_000)),
        1_000_000..1_000_000_000 => format!("{} MB", bytes.div_ceil(1_000_000)),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_the_unit_that_shows_them() {
        let sizes = [0, 1, 402_000, 1_000_001, 999_999_999, 1_540_000_000];
        assert_eq!(sizes.map(byte_size), ["0 kB", "1 kB", "402 kB", "2 MB", "1000 MB", "1.5 GB"]);
    }

    #[test]
    fn one_thing_is_singular() {
        assert_eq!(counted(1, "splats"), "1 splat");
        assert_eq!(counted(1, "vertices"), "1 vertex");
        assert_eq!((counted(0, "points"), counted(2, "points")), ("0 points".to_owned(), "2 points".to_owned()));
    }
}
