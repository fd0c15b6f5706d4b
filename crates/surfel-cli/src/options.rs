//! Conversion of the parsed command line to the options that determine an image.

use crate::args::{RenderArgs, SplatArgs};
use crate::failure::Failure;
use surfel::camera::CameraSource;
use surfel::model::ConvertOptions;
use surfel::request::{RenderOptions, SplatOptions};

pub(crate) fn render(args: &RenderArgs) -> Result<RenderOptions, Failure> {
    let mut options = RenderOptions::default();
    options.splats = splats(&args.splats, args.force)?;
    options.size = args.size;
    options.camera = args.camera.clone().map(CameraSource::File);
    options.cameras = args.cameras.is_some();
    options.view = args.view;
    options.eye = args.eye;
    options.target = args.target;
    options.camera_up = args.camera_up;
    options.up = args.up.map(|choice| choice.0);
    options.region = args.region;
    options.tile = args.tile;
    options.fov_y = args.fov_y;
    options.ortho = args.ortho;
    options.preset = args.preset;
    options.filter = args.filter;
    options.mapping = args.mapping;
    options.cutoff = args.cutoff;
    options.prefilter = args.prefilter;
    options.depth_tolerance = args.depth_tolerance;
    options.accumulate = args.accumulate;
    options.transparency = args.transparency;
    options.clip = args.clip;
    options.shader = args.shader;
    options.matcap.clone_from(&args.matcap);
    options.lod_error = args.lod_error;
    options.all_levels = args.all_levels;
    options.shadows = args.shadows;
    options.edge_aa = args.edge_aa;
    options.composite = args.composite;
    options.sort = args.sort;
    options.background = args.background;
    options.samples = args.samples;
    options.planes.clone_from(&args.planes);
    options.label.clone_from(&args.label);
    options.turntable = args.turntable;
    options.verify = args.verify;
    Ok(options)
}

pub(crate) fn splats(args: &SplatArgs, force: bool) -> Result<SplatOptions, Failure> {
    let mut options = SplatOptions::default();
    options.convert = ConvertOptions {
        repair: args.repair,
        texture: Default::default(),
        colors: args.colors,
        per_vertex: args.per_vertex,
        per_face: args.per_face,
        splats: args.splats,
        max_points: args.max_points,
        radius_scale: args.radius_scale,
        sharp: args.sharp,
        crease_angle: args.crease_angle,
        error: args.error,
        color_by: args.color_by.clone(),
        colormap: args.colormap,
        range: None,
        crop: args.crop,
        classes: args.classes.clone(),
        returns: args.returns,
        condition: None,
        every: args.every,
        all_points: args.all_points,
        outliers: args.outliers,
        all_levels: false,
        allow_outside: args.allow_outside,
        max_texture: args.max_texture,
        columns: args.columns.clone(),
    };
    options.cull = args.cull;
    options.memory = args.memory;
    options.colorbar = args.colorbar.clone().flatten();
    options.legend.clone_from(&args.legend);
    options.force = force;
    if let Some(choice) = args.range {
        options.set_range(choice);
    }
    args.condition.iter().for_each(|condition| options.add_condition(condition.clone()));
    for value in &args.texture {
        options.add_texture(value.clone()).map_err(|e| Failure::usage(format!("--texture {e}")))?;
    }
    Ok(options)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Cli, Command, command};
    use clap::FromArgMatches;

    /// Returns a valid value for a flag.
    fn sample(argument: &clap::Arg) -> String {
        if let Some(value) = argument.get_possible_values().last() {
            return value.get_name().to_owned();
        }
        let text = match argument.get_long().unwrap_or_default() {
            "size" => "33x44",
            "region" => "1,2,3,4",
            "tile" => "1/3",
            "up" => "-x",
            "background" => "0.25,0.5,0.75",
            "depth-tolerance" => "abs:0.5",
            "transparency" => "peel:3:drop",
            "crop" => "0,1,2,3,4,5",
            "range" => "-1.5,2",
            "classes" => "2,6",
            "columns" => "x,y,z,_",
            "memory" => "1.5G",
            "where" => "intensity>3",
            "eye" | "target" | "camera-up" => "1,2.5,-3",
            _ => "7",
        };
        text.to_owned()
    }

    fn parsed(words: &[&str]) -> RenderOptions {
        let matches = command().try_get_matches_from(words).unwrap_or_else(|e| panic!("{words:?}: {e}"));
        match Cli::from_arg_matches(&matches).unwrap().command {
            Command::Render(args) => render(&args).unwrap(),
            other => panic!("{other:?}"),
        }
    }

    /// Flags for backends and output files.
    const OTHERS: [&str; 23] = [
        "output",
        "force",
        "print-scene",
        "backend",
        "adapter",
        "storage",
        "cameras",
        "frames",
        "turntable",
        "frame-range",
        "shard",
        "skip-existing",
        "progressive",
        "stats",
        "verify",
        "repeat",
        "exr-f32",
        "png16",
        "no-metadata",
        "quiet",
        "verbose",
        "threads",
        "config",
    ];

    #[test]
    fn every_flag_means_the_same_to_a_library() {
        let grammar = command();
        let render = grammar.find_subcommand("render").unwrap();
        let mut known = 0;
        for argument in render.get_arguments() {
            let Some(flag) = argument.get_long().filter(|flag| !OTHERS.contains(flag) && *flag != "help") else {
                continue;
            };
            let takes_value = argument.get_action().takes_values();
            let text = if takes_value { sample(argument) } else { "on".to_owned() };
            let word = if takes_value { format!("--{flag}={text}") } else { format!("--{flag}") };
            // These flags need another one.
            let sharp = matches!(flag, "crease-angle" | "error");
            let mut words = vec!["surfel", "render", "a.ply", "-o", "a.png", &word];
            let mut options = RenderOptions::default();
            if sharp {
                words.push("--sharp");
                options.set("sharp", "on").unwrap();
            }
            options.set(flag, &text).unwrap_or_else(|e| panic!("--{flag} {text}: {e}"));
            assert_eq!(options, parsed(&words), "--{flag} {text}");
            assert_ne!(options, RenderOptions::default(), "--{flag} {text} says nothing");
            known += 1;
        }
        assert!(known > 45, "{known} flags");
    }

    #[test]
    fn libraries_refuse_what_the_command_line_refuses() {
        for words in [
            "--view top --eye 1,2,3",
            "--view top --camera a.json",
            "--fov-y 30 --ortho",
            "--region 0,0,4,4 --tile 1/2",
            "--error 1",
            "--per-face --per-vertex",
            "--per-face --splats 9",
            "--sharp --per-vertex",
            "--crease-angle 9",
        ] {
            let all = ["surfel", "render", "a.ply", "-o", "a.png"].into_iter().chain(words.split(' '));
            assert!(command().try_get_matches_from(all).is_err(), "{words}");
            let mut options = RenderOptions::default();
            let mut list = words.split(' ').peekable();
            while let Some(flag) = list.next() {
                let text = list.next_if(|next| !next.starts_with("--")).unwrap_or("on");
                options.set(flag.trim_start_matches("--"), text).unwrap();
            }
            assert!(options.check().is_err(), "{words}");
        }
    }
}
