//! Labels of splats, from an attribute of their file.

use crate::Error;
use std::path::Path;
use surfel_model::{ExtraColumn, NO_LABEL, SplatCloud};

/// Name of the attribute from which labels are taken if the options name none.
pub const DEFAULT_LABEL: &str = "classification";

/// Sets labels from an attribute of the cloud's file. Values are integers from 0; −1 and NaN mean that a splat has no
/// label. Returns false if the file doesn't have the attribute.
pub(crate) fn label(cloud: &mut SplatCloud, attribute: &str, path: &Path) -> Result<bool, Error> {
    let Some(column) = ExtraColumn::find(&cloud.data().extras, attribute) else { return Ok(false) };
    let label = |i: usize| {
        let value = column.values.get(i);
        if value.is_nan() || value == -1.0 {
            return Ok(NO_LABEL);
        }
        if value < 0.0 || value >= f64::from(NO_LABEL) || value.fract() != 0.0 {
            let problem = format!(
                "its attribute {} is {value} at point {i}, expected whole numbers from 0 to 4294967294, or -1 for \
                 none: choose another by `label`",
                column.name.escape_debug()
            );
            return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
        }
        Ok(value as u32)
    };
    let labels = (0..cloud.len()).map(label).collect::<Result<Vec<u32>, Error>>()?;
    cloud.set_labels(labels);
    Ok(true)
}
