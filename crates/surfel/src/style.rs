//! Styles: choices for an image that its options leave open.

use crate::render_options::RenderOptions;
use surfel_model::EdgeAa;

/// A named set of choices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// An image for a paper.
    Figure,
}

impl Style {
    /// Sets the options that aren't set. The lines of a style are all of its choices.
    pub(crate) fn complete(self, options: &mut RenderOptions) {
        match self {
            Self::Figure => {
                options.size.get_or_insert([2048, 2048]);
                options.background.get_or_insert([1.0; 4]);
                options.edge_aa.get_or_insert(EdgeAa::Samples);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn styles_leave_given_options_alone() {
        let mut options = RenderOptions { size: Some([64, 48]), ..RenderOptions::default() };
        Style::Figure.complete(&mut options);
        assert_eq!((options.size, options.background), (Some([64, 48]), Some([1.0; 4])));
        let once = options.clone();
        Style::Figure.complete(&mut options);
        assert_eq!(options, once);
    }
}
