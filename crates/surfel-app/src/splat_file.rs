//! Conversion of a file of points, a mesh or splats to splats, as `surfel convert` does.

use crate::render_options::SplatOptions;
use crate::splats;
use std::path::Path;
use std::sync::Arc;
use surfel_load::paths::display;
use surfel_load::words::{counted, number};
use surfel_load::{Conversion, Error, LoadOptions, LoadedCloud, load};
use surfel_model::{ConvertOptions, Cull, OnInvalid, Shape, SplatCloud, Up};
use surfel_sample::{BOTH_SIDES, CLOSED_MESH, Progress};

/// Request to convert a file to splats.
#[derive(Clone, Debug)]
pub struct ConvertRequest<'a> {
    /// Path of the file; `-` stands for the content of `stdin`.
    pub path: &'a Path,
    /// Options for the conversion.
    pub options: &'a SplatOptions,
    /// Content of the input named `-`.
    pub stdin: Option<Arc<[u8]>>,
}

impl ConvertRequest<'_> {
    /// Returns the options for loading the file.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that contradict or lack another option.
    pub fn load_options(&self) -> Result<LoadOptions, Error> {
        self.options.check()?;
        let mut convert = ConvertOptions::default();
        splats::apply(self.options, &mut convert)?;
        Ok(LoadOptions::default()
            .with_convert(&convert, Path::new(""))
            .with_stdin(self.stdin.clone())
            .with_mesh_columns(true)
            .with_withheld(true)
            .with_memory(self.options.memory))
    }

    /// Loads the file, and estimates its interior weight.
    ///
    /// # Errors
    /// Errors of [`load`] and [`ConvertRequest::load_options`].
    pub fn load(&self, progress: &dyn Progress) -> Result<LoadedCloud, Error> {
        load(self.path, &self.load_options()?.with_interior_weight(true), progress)
    }

    /// Returns the splats of a loaded file, and writes the colour bar if the options name a file for it. Passes notes
    /// for the user to `note`, as sentences without a full stop.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that have no effect on the file.
    pub fn convert(&self, loaded: LoadedCloud, note: &mut dyn FnMut(String)) -> Result<SplatCloud, Error> {
        for text in &loaded.notes {
            note(format!("{}: {text}", display(self.path)));
        }
        let unused: Vec<_> = loaded.unused.into_iter().map(|option| (self.path.to_path_buf(), option)).collect();
        splats::check_used(self.options, &unused, note)?;
        splats::write_color_bar(self.options, loaded.coloring.iter().map(|coloring| (self.path, coloring)), note)?;
        let of_mesh = !matches!(loaded.conversion, Conversion::None | Conversion::Points(_));
        let mut cloud = loaded.cloud;
        // PLY's default up axis needn't be stored.
        if loaded.up != Up::PlusY || cloud.data().up.is_some() {
            cloud.set_up(loaded.up);
        }
        match (self.options.cull, loaded.is_watertight) {
            (Some(cull), _) => culled(cloud, cull),
            (None, true) => culled(cloud, Cull::Back),
            // The edges of a mesh show that it is open. For splats this isn't determined, so that no comment is added.
            (None, false) if of_mesh => culled(cloud, Cull::None),
            (None, false) => Ok(cloud),
        }
    }
}

/// Adds the comment to a cloud that states whether back-facing splats are culled.
fn culled(cloud: SplatCloud, cull: Cull) -> Result<SplatCloud, Error> {
    let mut data = cloud.into_data();
    data.comments.retain(|comment| comment != CLOSED_MESH && comment != BOTH_SIDES);
    let comment = if cull == Cull::Back { CLOSED_MESH } else { BOTH_SIDES };
    data.comments.push(comment.to_owned());
    Ok(SplatCloud::new(data, OnInvalid::Refuse).map_err(Error::from)?.0)
}

/// Returns a phrase with the number, the shape and the radii of splats, and with their interior weight if it is known.
pub fn summary(cloud: &SplatCloud) -> String {
    let shape = match cloud.data().shape {
        Shape::Disks { .. } => "disks",
        Shape::Ellipses { .. } => "ellipses",
        Shape::Balls { flat: false, .. } => "balls",
        Shape::Balls { flat: true, .. } => "dots",
    };
    let mut radii: Vec<f64> = (0..cloud.len()).map(|i| cloud.radius_max(i)).collect();
    radii.sort_unstable_by(f64::total_cmp);
    let at = |share: usize| radii.get((radii.len().saturating_sub(1)) * share / 2).copied().unwrap_or(0.0);
    let weight = cloud.data().interior_weight.map(|w| format!(", interior weight {w:.3}")).unwrap_or_default();
    let [count, least, most, median] =
        [counted(cloud.len() as u64, shape), number(at(0)), number(at(2)), number(at(1))];
    format!("{count}, radii {least} to {most}, median {median}{weight}")
}
