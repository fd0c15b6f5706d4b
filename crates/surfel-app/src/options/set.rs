//! Methods that set a single option from text.

use super::{Commands, Options, table};
use crate::render_options::{RenderOptions, SplatOptions};

impl SplatOptions {
    /// Sets an option of `surfel convert` by its long name without dashes, from its text. A switch is set by `on` or
    /// `off`. Returns false if `surfel convert` has no such option, or the option doesn't affect splats.
    ///
    /// # Errors
    /// A message that states the expected values, if the text isn't a valid value of the flag.
    pub fn set(&mut self, flag: &str, text: &str) -> Result<bool, String> {
        if table().find(Commands::CONVERT, flag).is_none_or(|row| !row.is_image) {
            return Ok(false);
        }
        let mut render = RenderOptions { splats: std::mem::take(self), ..RenderOptions::default() };
        let set = render.set(flag, text);
        *self = render.splats;
        set.map(|()| true)
    }
}

impl RenderOptions {
    /// Sets a flag by its long name without dashes, from its text. A switch is set by `on` or `off`.
    ///
    /// # Errors
    /// A message that states the expected values, if the text isn't a valid value; or a message that no such flag
    /// exists here. Flags for backends and output files are handled by the caller.
    pub fn set(&mut self, flag: &str, text: &str) -> Result<(), String> {
        let row = table().find(Commands::RENDER, flag).filter(|row| row.is_image);
        let row = row.ok_or_else(|| "there is no such flag here".to_owned())?;
        if text.is_empty() && row.missing.is_some() {
            return Err("expected a value".to_owned());
        }
        let mut all = Options { render: std::mem::take(self), ..Options::default() };
        let set = row.set(&mut all, text.as_ref());
        *self = all.render;
        set
    }
}
