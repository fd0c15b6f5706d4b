//! Parsers of the comments in PLY headers that have a meaning: up axis, interior weight, oriented normals, and linear
//! float colours.

use crate::error::{Fault, Problem, quote};
use surfel_model::Up;

/// Returns the up axis and the interior weight, each `None` if no comment of the header states it. Returns an error if
/// the stated interior weight is invalid.
pub(super) fn interpret_comments(header_comments: &[String]) -> Result<(Option<Up>, Option<f64>), Fault> {
    let up = header_comments.iter().find_map(|c| comment_up(c));
    let weight = header_comments.iter().find_map(|c| comment_interior_weight(c)).transpose()?;
    Ok((up, weight))
}

/// Returns the up axis that a comment states, such as `Vertical axis: z` or `up +z`; `None` for other comments.
pub(super) fn comment_up(comment: &str) -> Option<Up> {
    let text = comment.trim().to_ascii_lowercase();
    let axis = text.strip_prefix("vertical axis:").or_else(|| text.strip_prefix("up "))?;
    axis.trim().parse().ok()
}

/// Returns the interior weight W0 that a comment `interior_weight W0` states, or an error if the weight is invalid;
/// `None` for other comments.
pub(super) fn comment_interior_weight(comment: &str) -> Option<Result<f64, Problem>> {
    let mut words = comment.split_ascii_whitespace();
    if words.next() != Some("interior_weight") {
        return None;
    }
    let word = words.next().unwrap_or("");
    let value = word.parse().ok().filter(|w: &f64| *w > 0.0 && w.is_finite() && words.next().is_none());
    Some(value.ok_or_else(|| {
        Problem::new(format!("the comment {} has no valid weight", quote(comment)))
            .expected("'comment interior_weight W0' with a finite number W0 > 0")
    }))
}

/// True if the comment states that all normals point out of the same surface.
pub(super) fn is_oriented(comment: &str) -> bool {
    comment.trim() == "oriented"
}

/// True if the comment states that float colours are linear.
pub(super) fn are_colors_linear(comment: &str) -> bool {
    let mut words = comment.split_ascii_whitespace().map(str::to_ascii_lowercase);
    matches!(words.next().as_deref(), Some("colors" | "colours"))
        && words.next().as_deref() == Some("linear")
        && words.next().is_none()
}
