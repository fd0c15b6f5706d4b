//! Meaningful comments: up axis, interior weight, oriented normals, and linear float colours.

use crate::error::{Fault, Problem, quote};
use surfel_model::Up;

/// Returns the up axis and the interior weight, if some of the header's comments state them.
pub(super) fn interpret_comments(header_comments: &[String]) -> Result<(Option<Up>, Option<f64>), Fault> {
    let up = header_comments.iter().find_map(|c| comment_up(c));
    let weight = header_comments.iter().find_map(|c| comment_interior_weight(c)).transpose()?;
    Ok((up, weight))
}

/// Returns the up axis that a comment states: `Vertical axis: z`, `up +z`.
pub(super) fn comment_up(comment: &str) -> Option<Up> {
    let text = comment.trim().to_ascii_lowercase();
    let axis = text.strip_prefix("vertical axis:").or_else(|| text.strip_prefix("up "))?;
    axis.trim().parse().ok()
}

/// Returns the interior weight that a comment `interior_weight W0` states; `None` for other comments.
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
