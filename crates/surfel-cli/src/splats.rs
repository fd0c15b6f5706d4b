//! The flags on how files become splats, which `render` and `convert` share.

use crate::args::SplatArgs;
use crate::console::Console;
use crate::failure::Failure;
use crate::stdin;
use std::path::PathBuf;
use surfel::model::ConvertOptions;
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
    if let Some(texture) = &args.texture {
        // A flag's file is looked for here, a scene file's beside it.
        let absolute = std::path::absolute(texture);
        convert.texture = Some(absolute.map_err(|e| Failure::usage(format!("{}: {e}", texture.display())))?);
    }
    convert.splats = args.splats.or(convert.splats);
    convert.max_points = args.max_points.or(convert.max_points);
    convert.radius_scale = args.radius_scale.or(convert.radius_scale);
    convert.sharp |= args.sharp;
    convert.crease_angle = args.crease_angle.or(convert.crease_angle);
    convert.error = args.error.or(convert.error);
    Ok(())
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
            _ => false,
        };
        let name = stdin::display(path);
        if flagged {
            let flag = option.replace('_', "-");
            return Err(Failure::usage(format!("{name}: holds {holds}, expected {expected} for --{flag}")));
        }
        console.note(&format!("{name}: holds {holds}, so that convert.{option} has no effect: it is for {expected}"));
    }
    Ok(())
}
