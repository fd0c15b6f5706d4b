//! Formatting of counts in messages.

/// Formats a count with its noun, given in plural: `1 point`, `2 points`.
pub fn counted(count: u64, plural: &str) -> String {
    match (count, plural) {
        (1, "vertices") => "1 vertex".to_owned(),
        (1, _) => format!("1 {}", plural.strip_suffix('s').unwrap_or(plural)),
        _ => format!("{count} {plural}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_is_singular() {
        assert_eq!(counted(1, "splats"), "1 splat");
        assert_eq!(counted(1, "vertices"), "1 vertex");
        assert_eq!((counted(0, "points"), counted(2, "points")), ("0 points".to_owned(), "2 points".to_owned()));
    }
}
