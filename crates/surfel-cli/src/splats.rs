//! The flags on how files become splats, which `render` and `convert` share.

use crate::args::SplatArgs;
use crate::console::Console;
use crate::failure::Failure;
use crate::stdin;
use std::path::{Path, PathBuf};
use surfel::coloring::{ColorScale, Coloring, save_color_bar};
use surfel::model::{ConvertOptions, PointColors, SplatCount, TextureOption, TextureSampling};
use surfel::scene::UnusedOption;

/// Puts what the flags say over what a scene file may have said.
pub(crate) fn apply(args: &SplatArgs, convert: &mut ConvertOptions) -> Result<(), Failure> {
    #[cfg(not(feature = "sharp"))]
    if args.sharp {
        return Err(Failure::usage(
            "--sharp is not built into this program: build it with Cargo's feature 'sharp', as in cargo build \
             --release --features sharp",
        ));
    }
    if args.per_vertex || args.per_face {
        (convert.splats, convert.sharp, convert.crease_angle, convert.error) = (None, false, None, None);
    }
    if args.per_vertex || args.per_face || args.splats.is_some() || args.sharp {
        (convert.per_vertex, convert.per_face) = (args.per_vertex, args.per_face);
    }
    convert.repair |= args.repair;
    let TextureOption { file, sampling } = texture(&args.texture)?;
    if let Some(file) = file {
        // A flag's file is looked for here, a scene file's beside it.
        let absolute = std::path::absolute(&file);
        convert.texture.file = Some(absolute.map_err(|e| Failure::usage(format!("{}: {e}", file.display())))?);
    }
    convert.texture.sampling = sampling.or(convert.texture.sampling);
    convert.colors = args.colors.or(convert.colors);
    convert.splats = args.splats.or(convert.splats);
    convert.max_points = args.max_points.or(convert.max_points);
    convert.radius_scale = args.radius_scale.or(convert.radius_scale);
    convert.sharp |= args.sharp;
    convert.crease_angle = args.crease_angle.or(convert.crease_angle);
    convert.error = args.error.or(convert.error);
    if convert.sharp && convert.splats == Some(SplatCount::Auto) {
        return Err(Failure::usage(
            "--sharp with --splats auto: expected --error, which chooses the number, or a number",
        ));
    }
    if args.color_by.is_some() {
        // What a scene file says of its own attribute's colours means nothing for another.
        (convert.color_by, convert.colormap, convert.range) = (args.color_by.clone(), None, None);
    }
    convert.colormap = args.colormap.or(convert.colormap);
    convert.range = args.range.or(convert.range);
    if convert.color_by.is_none() && (args.colormap.is_some() || args.range.is_some() || args.colorbar.is_some()) {
        let flag = match (&args.colormap, &args.range) {
            (Some(_), _) => "--colormap",
            (_, Some(_)) => "--range",
            _ => "--colorbar",
        };
        return Err(Failure::usage(format!("{flag} is for values: give --color-by ATTRIBUTE with it")));
    }
    convert.crop = args.crop.or(convert.crop);
    if !args.classes.is_empty() {
        convert.classes.clone_from(&args.classes);
    }
    convert.returns = args.returns.or(convert.returns);
    convert.condition = args.condition.clone().or(convert.condition.take());
    convert.every = args.every.or(convert.every);
    convert.all_points |= args.all_points;
    convert.allow_outside |= args.allow_outside;
    convert.max_texture = args.max_texture.or(convert.max_texture);
    Ok(())
}

/// A sampling and a file, at most one of each.
fn texture(given: &[PathBuf]) -> Result<TextureOption, Failure> {
    let mut option = TextureOption::default();
    for value in given {
        let is_first = match value.to_str().and_then(TextureSampling::from_name) {
            Some(sampling) => option.sampling.replace(sampling).is_none(),
            None => option.file.replace(value.clone()).is_none(),
        };
        if !is_first {
            return Err(Failure::usage("--texture is given twice: expected one of point, ewa and fit, and one file"));
        }
    }
    Ok(option)
}

/// Refuses flags that no input has a use for, and says which keys of a scene file are of no use.
pub(crate) fn check_used(
    args: &SplatArgs,
    unused: &[(PathBuf, UnusedOption)],
    console: &Console,
) -> Result<(), Failure> {
    for (path, UnusedOption { option, holds, expected }) in unused {
        let flagged = match *option {
            "splats" => args.splats.is_some(),
            "per_face" => args.per_face,
            "per_vertex" => args.per_vertex,
            "max_points" => args.max_points.is_some(),
            "radius_scale" => args.radius_scale.is_some(),
            "sharp" => args.sharp,
            "error" => args.error.is_some(),
            "texture" => args.texture.iter().any(|t| t.to_str().and_then(TextureSampling::from_name).is_some()),
            "colors" => args.colors == Some(PointColors::Fit),
            "color_by" => args.color_by.is_some(),
            "crop" => args.crop.is_some(),
            "classes" => !args.classes.is_empty(),
            "returns" => args.returns.is_some(),
            "where" => args.condition.is_some(),
            "every" => args.every.is_some(),
            "all_points" => args.all_points,
            _ => false,
        };
        let name = stdin::display(path);
        if flagged {
            let flag = option.replace('_', "-");
            return Err(Failure::usage(format!("{name}: holds {holds}, expected {expected} for --{flag}")));
        }
        if *option == "color_by" {
            return Err(Failure::input(format!("{name}: holds {holds}, expected {expected} for convert.color_by")));
        }
        console.note(&format!("{name}: holds {holds}, so that convert.{option} has no effect: it is for {expected}"));
    }
    Ok(())
}

/// Writes the colour bar that the flag asks for, of the first file that has colours of values.
pub(crate) fn write_color_bar<'a>(
    args: &SplatArgs,
    force: bool,
    colorings: impl Iterator<Item = (&'a Path, &'a Coloring)>,
    console: &Console,
) -> Result<(), Failure> {
    let Some(file) = &args.colorbar else { return Ok(()) };
    let mut first: Option<(&Path, &Coloring)> = None;
    for (path, coloring) in colorings.filter(|(_, coloring)| coloring.scale != ColorScale::Direct) {
        match first {
            None => first = Some((path, coloring)),
            Some((_, known)) if known.scale == coloring.scale => {}
            Some((known, _)) => console.note(&format!(
                "{}: its colours mean other values than those of {}, which the colour bar shows: give --range",
                stdin::display(path),
                stdin::display(known)
            )),
        }
    }
    let Some((_, coloring)) = first else {
        return Err(Failure::usage("--colorbar is for values, but no file is coloured by one"));
    };
    save_color_bar(file, force, coloring)?;
    Ok(())
}
