//! Options for converting files to splats: merging with scene files, and checks against the files' content.

use crate::color_bar::save_color_bar;
use crate::render_options::SplatOptions;
use std::path::{Path, PathBuf};
use surfel_io::ShowPath as _;
use surfel_load::coloring::{ColorScale, Coloring};
use surfel_load::effects;
use surfel_load::effects::UnusedOption;
use surfel_load::paths::display;
use surfel_load::{Error, LoadOptions};
use surfel_model::{ConvertOptions, SplatCount};

/// Merges the options into an object's conversion options. Options that are set take precedence.
///
/// # Errors
/// [`Error::Usage`] for options that contradict or lack another option.
pub fn apply(options: &SplatOptions, convert: &mut ConvertOptions) -> Result<(), Error> {
    let said = &options.convert;
    #[cfg(not(feature = "sharp"))]
    if said.sharp {
        return Err(Error::Usage(
            "--sharp is not built into this program: build it with Cargo's feature 'sharp', as in cargo build \
             --release --features sharp"
                .to_owned(),
        ));
    }
    if said.per_vertex || said.per_face {
        (convert.splats, convert.sharp, convert.crease_angle, convert.error) = (None, false, None, None);
    }
    if said.per_vertex || said.per_face || said.splats.is_some() || said.sharp {
        (convert.per_vertex, convert.per_face) = (said.per_vertex, said.per_face);
    }
    convert.repair |= said.repair;
    if let Some(file) = &said.texture.file {
        convert.texture.file = absolute(Some(file))?;
    }
    convert.texture.sampling = said.texture.sampling.or(convert.texture.sampling);
    convert.colors = said.colors.or(convert.colors);
    convert.points_as = said.points_as.or(convert.points_as);
    convert.splats = said.splats.or(convert.splats);
    convert.max_points = said.max_points.or(convert.max_points);
    convert.radius_scale = said.radius_scale.or(convert.radius_scale);
    convert.sharp |= said.sharp;
    convert.crease_angle = said.crease_angle.or(convert.crease_angle);
    convert.error = said.error.or(convert.error);
    if convert.sharp && convert.splats == Some(SplatCount::Auto) {
        return Err(Error::Usage(
            "--sharp with --splats auto: expected --error, which chooses the number, or a number".to_owned(),
        ));
    }
    if said.color_by.is_some() {
        // A colour map that a scene file states for its own attribute is meaningless for another attribute.
        (convert.color_by, convert.colormap, convert.range) = (said.color_by.clone(), None, None);
        (convert.colormap_file, convert.labels) = (None, None);
    }
    if said.colormap.is_some() || said.colormap_file.is_some() {
        (convert.colormap, convert.colormap_file) = (said.colormap, absolute(said.colormap_file.as_ref())?);
    }
    convert.labels = absolute(said.labels.as_ref())?.or(convert.labels.take());
    convert.range = said.range.or(convert.range);
    let has_range = said.range.is_some() || options.shared_range;
    let has_map = said.colormap.is_some() || said.colormap_file.is_some();
    let of_values = [
        (has_map, "--colormap"),
        (said.labels.is_some(), "--labels"),
        (has_range, "--range"),
        (options.colorbar.is_some(), "--colorbar"),
    ];
    let given = of_values.into_iter().find_map(|(is_given, flag)| is_given.then_some(flag));
    if let Some(flag) = given.filter(|_| convert.color_by.is_none()) {
        return Err(Error::Usage(format!("{flag} is for values: give --color-by ATTRIBUTE with it")));
    }
    convert.crop = said.crop.or(convert.crop);
    convert.classes = said.classes.clone().or(convert.classes.take());
    convert.returns = said.returns.or(convert.returns);
    convert.condition = said.condition.clone().or(convert.condition.take());
    convert.every = said.every.or(convert.every);
    convert.all_points |= said.all_points;
    convert.outliers = said.outliers.or(convert.outliers);
    convert.allow_outside |= said.allow_outside;
    convert.max_texture = said.max_texture.or(convert.max_texture);
    convert.columns = said.columns.clone().or(convert.columns.take());
    Ok(())
}

/// Returns the absolute path of a file that a flag names. The flag's path is relative to the current folder, unlike
/// paths in scene files.
fn absolute(file: Option<&PathBuf>) -> Result<Option<PathBuf>, Error> {
    let absolute =
        |file: &PathBuf| std::path::absolute(file).map_err(|e| Error::Usage(format!("{}: {e}", file.shown())));
    file.map(absolute).transpose()
}

/// Checks that all options have an effect on some input. Passes a note to `note` for each key of a scene file without
/// effect. `unused` has the options and keys without effect, each with the path of an input.
///
/// # Errors
/// [`Error::Usage`] for an option without effect, [`Error::Input`] for an attribute that the files don't have.
pub fn check_used(
    options: &SplatOptions,
    unused: &[(PathBuf, UnusedOption)],
    note: &mut dyn FnMut(String),
) -> Result<(), Error> {
    let said = LoadOptions::default().with_convert(&options.convert, Path::new(""));
    let is_flag = |option: &str| effects::of(option).is_some_and(|effect| (effect.given)(&said));
    for (path, UnusedOption { option, holds, expected }) in unused {
        let name = display(path);
        if is_flag(option) {
            let flag = option.replace('_', "-");
            return Err(Error::Usage(format!("{name}: holds {holds}, expected {expected} for --{flag}")));
        }
        if *option == "color_by" {
            return Err(Error::Input(format!("{name}: holds {holds}, expected {expected} for convert.color_by")));
        }
        note(format!("{name}: holds {holds}, so that convert.{option} has no effect: it is for {expected}"));
    }
    Ok(())
}

/// Writes the colour bar if the options name a file for it. It shows the options' own colouring (`legend`), or else the
/// first of `colorings` that represents values. In the latter case, passes a note to `note` for each later colouring
/// that has another scale.
///
/// # Errors
/// [`Error::Usage`] if no file is coloured by values, [`Error::Io`] if the image can't be written.
pub fn write_color_bar<'a>(
    options: &SplatOptions,
    colorings: impl Iterator<Item = (&'a Path, &'a Coloring)>,
    note: &mut dyn FnMut(String),
) -> Result<(), Error> {
    let Some(file) = &options.colorbar else { return Ok(()) };
    if let Some(legend) = &options.legend {
        save_color_bar(file, options.force, legend)?;
        return Ok(());
    }
    let mut first: Option<(&Path, &Coloring)> = None;
    for (path, coloring) in colorings.filter(|(_, coloring)| coloring.scale != ColorScale::Direct) {
        match first {
            None => first = Some((path, coloring)),
            Some((_, known)) if known.scale == coloring.scale => {}
            Some((known, _)) => note(format!(
                "{}: its convert has another color_by, colormap or range than that of {}, which the colour bar shows",
                display(path),
                display(known)
            )),
        }
    }
    let Some((_, coloring)) = first else {
        return Err(Error::Usage("--colorbar is for values, but no file is coloured by one".to_owned()));
    };
    save_color_bar(file, options.force, coloring)?;
    Ok(())
}
