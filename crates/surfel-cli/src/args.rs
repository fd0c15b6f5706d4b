//! The command line's grammar: commands and their options. Options of `render`, `figure`, `convert`, `ortho`, `serve`,
//! `view`, `again` and `info` come from the table in [`surfel_app::options`].

use crate::values::{self, Threshold};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser, ValueParser};
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, FromArgMatches as _, ValueHint};
use clap_complete::Shell;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use surfel_app::options::{Audience, Commands, EXPERT, Options, Row, Setter, Table, table};
use surfel_app::values::FrameRange;
use surfel_render::Preset;

/// A parsed command line.
#[derive(Debug)]
pub(crate) struct Cli {
    pub(crate) command: Command,
    /// Options that all commands have, such as verbosity.
    pub(crate) program: Options,
}

#[derive(Debug)]
pub(crate) enum Command {
    Render(Box<Options>),
    Figure(Box<Options>),
    Again(Box<Options>),
    Convert(Box<Options>),
    Ortho(Box<Options>),
    Info(Box<Options>),
    Serve(Box<Options>),
    Stitch(StitchArgs),
    Jobs(JobsArgs),
    Compare(CompareArgs),
    Backends(BackendsArgs),
    #[cfg(feature = "mcp")]
    Mcp(McpArgs),
    /// `surfel view`: its options, and the names and texts of those that the command line states.
    View(Box<Options>, Vec<(String, String)>),
    Completions(CompletionsArgs),
    Man,
}

/// Help text of the positional argument of `render` and `serve`.
const SCENE: &str = "A scene file (.json), or splats, points or meshes that form one scene; - is stdin. With {input} \
                     in OUT, each INPUT gets its own image";

/// Returns the command-line grammar of the program.
pub(crate) fn command() -> clap::Command {
    grammar(table())
}

/// Returns the command-line grammar with the options of `table`.
pub(crate) fn grammar(table: &Table) -> clap::Command {
    let of = |name: &'static str, about: &'static str| of_table(table, clap::Command::new(name).about(about));
    let plain = |name: &'static str, about: &'static str| clap::Command::new(name).about(about);
    let global = table.of(Commands::ALL).filter(|row| row.commands == Commands::ALL);
    let command = clap::Command::new("surfel")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Renders splats, scans, point clouds and meshes by surface splatting")
        .long_about(
            "Renders splats, scans, point clouds and meshes by surface splatting.\n\n`surfel INPUT -o OUT` is short \
             for `surfel render INPUT -o OUT`.",
        )
        .arg_required_else_help(true)
        .subcommand_required(true)
        .args(global.map(|row| argument(row, &[]).global(true)))
        .subcommand(of("render", "Render an image").arg(inputs("INPUT", SCENE, 1..)))
        .subcommand(of("figure", "Draw a figure: panels under one camera, with titles, legend and marks").arg(inputs(
            "INPUT",
            "Splats, points or meshes, a panel for each, or a scene file for one panel",
            1..,
        )))
        .subcommand(of("again", "Draw an image again from the scene stored in its metadata").arg(inputs(
            "IMAGE",
            "A PNG or EXR drawn by surfel, with its metadata",
            1..2,
        )))
        .subcommand(of("convert", "Convert points or a mesh to splats").arg(inputs(
            "INPUT",
            "Points, a mesh or splats; - is stdin. With -o OUT.copc.laz: any number of point files (LAS, LAZ, COPC, \
             PLY, PCD, NPY, XYZ), or all shards that --shard wrote",
            1..,
        )))
        .subcommand(
            of("ortho", "Draw an orthoimage and a surface model as GeoTIFF")
                .hide(!cfg!(feature = "ortho"))
                .arg(inputs("INPUT", "Points, splats or meshes with z up, all of one area; - is stdin", 1..)),
        )
        .subcommand(of("info", "Describe the content of a file").arg(inputs(
            "INPUT",
            "Splats, points or a mesh; - is stdin",
            1..2,
        )))
        .subcommand(derived::<StitchArgs>("stitch", "Merge the tiles of an image"))
        .subcommand(of("serve", "Draw images of one scene, kept in memory, as requested on stdin").arg(inputs(
            "INPUT",
            SCENE,
            1..,
        )))
        .subcommand(derived::<JobsArgs>(
            "jobs",
            "Print a job for a cluster or render farm that draws a scene, or converts points, in shards",
        ))
        .subcommand(derived::<CompareArgs>("compare", "Measure the difference between two images"))
        .subcommand(derived::<BackendsArgs>("backends", "List the backends available on this machine"))
        .subcommand(of("view", "Show a scene on a page in the browser").hide(!cfg!(feature = "view")).arg(inputs(
            "INPUT",
            "A scene file (.json), or splats, points or meshes that form one scene; - is stdin",
            1..,
        )))
        .subcommand(derived::<CompletionsArgs>("completions", "Print a completion script for a shell"))
        .subcommand(plain("man", "Print the manual page"));
    #[cfg(feature = "mcp")]
    let command = command.subcommand(derived::<McpArgs>(
        "mcp",
        "Offer inspect, render, pick and compare as tools of the Model Context Protocol, on stdin and stdout",
    ));
    command
}

/// Returns a command with arguments that clap derives from `A`. `about` is set last, because doc comments of flattened
/// arguments would replace it.
fn derived<A: Args>(name: &'static str, about: &'static str) -> clap::Command {
    A::augment_args(clap::Command::new(name)).about(about)
}

/// Adds those options of the table that belong to the command.
fn of_table(table: &Table, command: clap::Command) -> clap::Command {
    let of = Commands::named(command.get_name());
    let rows: Vec<&Row> = table.of(of).filter(|row| row.commands != Commands::ALL).collect();
    let known: Vec<&str> = rows.iter().map(|row| row.name).collect();
    let arguments: Vec<Arg> = rows.iter().map(|row| argument(row, &known)).collect();
    command.args(arguments)
}

/// Returns the positional argument for inputs.
fn inputs(name: &'static str, help: &'static str, count: impl Into<clap::builder::ValueRange>) -> Arg {
    let argument = Arg::new("inputs").value_name(name).required(true).num_args(count).help(help);
    argument.value_parser(clap::value_parser!(PathBuf)).action(ArgAction::Append)
}

/// Returns clap's argument for an option of the table. `known` are the names of the command's options, to which
/// conflicts and requirements are limited.
fn argument(row: &Row, known: &[&str]) -> Arg {
    let known = |names: &'static [&'static str]| names.iter().copied().filter(|name| known.contains(name));
    let help = row.help.strip_suffix('.').unwrap_or(row.help);
    let heading = if row.audience == Audience::Expert { EXPERT } else { row.group.heading() };
    let mut argument = Arg::new(row.name)
        .long(row.name)
        .help(help)
        .help_heading(heading)
        .hide(!row.is_built)
        .hide_short_help(row.audience != Audience::Everyday)
        .conflicts_with_all(known(row.conflicts))
        .requires_all(known(row.requires));
    if !row.more.is_empty() {
        argument = argument.long_help(row.full_help());
    }
    if let Some(letter) = row.short {
        argument = argument.short(letter);
    }
    argument = match (row.is_required, row.unless) {
        (false, _) => argument,
        (true, []) => argument.required(true),
        (true, unless) => argument.required_unless_present_any(unless),
    };
    if row.is_switch() {
        return argument.action(ArgAction::SetTrue);
    }
    let several = row.is_repeated || row.is_list;
    argument = argument
        .value_name(row.value)
        .value_parser(ValueParser::new(RowParser(*row)))
        .action(if several { ArgAction::Append } else { ArgAction::Set })
        .allow_hyphen_values(row.is_signed);
    if matches!(row.set, Setter::Path(_)) {
        argument = argument.value_hint(ValueHint::AnyPath);
    }
    if row.is_list {
        argument = argument.value_delimiter(',');
    }
    if let Some(value) = row.default {
        argument = argument.default_value(value);
    }
    match row.missing {
        Some(value) => argument.num_args(0..=1).require_equals(true).default_missing_value(value),
        None => argument,
    }
}

/// Parser of an option's value for clap. It checks the value, but returns its text, because options are set from texts
/// later.
#[derive(Clone)]
struct RowParser(Row);

impl TypedValueParser for RowParser {
    type Value = OsString;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&Arg>,
        value: &OsStr,
    ) -> Result<OsString, clap::Error> {
        let row = &self.0;
        if let Some(names) = row.names.filter(|_| !row.is_open) {
            return PossibleValuesParser::new(names()).parse_ref(command, argument, value).map(OsString::from);
        }
        if row.set(&mut Options::default(), value).is_ok() {
            return Ok(value.to_owned());
        }
        // A function of `&str` as a parser formats the error message as clap does.
        let row = *row;
        let check = move |text: &str| row.set(&mut Options::default(), text.as_ref()).map(|()| OsString::from(text));
        check.parse_ref(command, argument, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let names = self.0.names?();
        Some(Box::new(names.into_iter().map(|name| PossibleValue::new(name).hide(!is_built(&self.0, name)))))
    }
}

/// True if this build supports the choice `name` of an option, such as a backend.
fn is_built(row: &Row, name: &str) -> bool {
    match (row.name, name) {
        ("backend", "cpu") => cfg!(feature = "cpu"),
        ("backend", "wgpu") => cfg!(feature = "wgpu"),
        ("backend", "ash") => cfg!(feature = "ash"),
        ("backend", "reference") => cfg!(feature = "reference"),
        _ => true,
    }
}

/// Returns the options of a command from its parsed arguments.
fn options(table: &Table, command: Commands, matches: &ArgMatches) -> Result<Options, clap::Error> {
    let mut options = Options::default();
    if let Ok(Some(inputs)) = matches.try_get_many::<PathBuf>("inputs") {
        options.inputs = inputs.cloned().collect();
    }
    for row in table.of(command) {
        let mut set = |value: &OsStr| {
            let wrong =
                |problem: String| clap::Error::raw(ErrorKind::ValueValidation, format!("--{} {problem}\n", row.name));
            row.set(&mut options, value).map_err(wrong)
        };
        if row.is_switch() {
            if matches.get_flag(row.name) {
                set("on".as_ref())?;
            }
            continue;
        }
        let values: Vec<&OsString> = matches.get_many(row.name).into_iter().flatten().collect();
        if row.is_list && !values.is_empty() {
            let values: Vec<&OsStr> = values.iter().map(|value| value.as_os_str()).collect();
            set(&values.join(",".as_ref()))?;
        } else {
            values.into_iter().try_for_each(|value| set(value))?;
        }
    }
    Ok(options)
}

/// Returns the names and texts of the command's own options that the command line states, in the order of the table.
fn given(table: &Table, command: Commands, matches: &ArgMatches) -> Vec<(String, String)> {
    let mut given = Vec::new();
    for row in table.of(command).filter(|row| row.commands != Commands::ALL) {
        if matches.value_source(row.name).is_none_or(|source| source == ValueSource::DefaultValue) {
            continue;
        }
        let mut add = |text: String| given.push((row.name.to_owned(), text));
        if row.is_switch() {
            add("on".to_owned());
        } else {
            let values = matches.get_many::<OsString>(row.name).into_iter().flatten();
            let texts: Vec<String> = values.map(|value| value.to_string_lossy().into_owned()).collect();
            if row.is_list { add(texts.join(",")) } else { texts.into_iter().for_each(add) }
        }
    }
    given
}

/// Converts the arguments that clap has parsed to a command line of this program.
pub(crate) fn parsed(matches: &ArgMatches) -> Result<Cli, clap::Error> {
    let (name, of) = matches.subcommand().ok_or_else(|| clap::Error::new(ErrorKind::MissingSubcommand))?;
    let options = |command| options(table(), command, of).map(Box::new);
    let command = match name {
        "render" => Command::Render(options(Commands::RENDER)?),
        "figure" => Command::Figure(options(Commands::FIGURE)?),
        "again" => Command::Again(options(Commands::AGAIN)?),
        "convert" => Command::Convert(options(Commands::CONVERT)?),
        "ortho" => Command::Ortho(options(Commands::ORTHO)?),
        "info" => Command::Info(options(Commands::INFO)?),
        "serve" => Command::Serve(options(Commands::SERVE)?),
        "stitch" => Command::Stitch(StitchArgs::from_arg_matches(of)?),
        "jobs" => Command::Jobs(JobsArgs::from_arg_matches(of)?),
        "compare" => Command::Compare(CompareArgs::from_arg_matches(of)?),
        "backends" => Command::Backends(BackendsArgs::from_arg_matches(of)?),
        #[cfg(feature = "mcp")]
        "mcp" => Command::Mcp(McpArgs::from_arg_matches(of)?),
        "view" => Command::View(options(Commands::VIEW)?, given(table(), Commands::VIEW, of)),
        "completions" => Command::Completions(CompletionsArgs::from_arg_matches(of)?),
        _ => Command::Man,
    };
    let program = table().of(Commands::ALL).filter(|row| row.commands == Commands::ALL);
    let mut set = Options::default();
    for row in program {
        let value = if row.is_switch() {
            matches.get_flag(row.name).then(|| OsString::from("on"))
        } else {
            matches.get_one::<OsString>(row.name).cloned()
        };
        let wrong =
            |problem: String| clap::Error::raw(ErrorKind::ValueValidation, format!("--{} {problem}\n", row.name));
        value.map_or(Ok(()), |value| row.set(&mut set, &value)).map_err(wrong)?;
    }
    Ok(Cli { command, program: set })
}

#[cfg(feature = "mcp")]
#[derive(Args, Debug)]
pub(crate) struct McpArgs {
    /// Files, and folders with files, that the tools may read; without any, the current folder.
    #[arg(value_name = "PATH")]
    pub(crate) roots: Vec<PathBuf>,
}

#[derive(Args, Debug)]
pub(crate) struct CompareArgs {
    /// Reference image, EXR or PNG.
    #[arg(value_name = "A")]
    pub(crate) a: PathBuf,
    /// Image to compare with A.
    #[arg(value_name = "B")]
    pub(crate) b: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Write FLIP's error map to this file.
    #[arg(long, value_name = "D.png")]
    pub(crate) diff: Option<PathBuf>,
    /// Overwrite an existing error map.
    #[arg(short, long)]
    pub(crate) force: bool,
    /// Exit with 5 if a metric (max_abs, rmse, psnr, flip) is above a value; may be given several times.
    #[arg(long, value_name = "METRIC=V", value_parser = values::threshold)]
    pub(crate) fail_above: Vec<Threshold>,
    /// Exit with 5 if a metric is below a value; may be given several times.
    #[arg(long, value_name = "METRIC=V", value_parser = values::threshold)]
    pub(crate) fail_below: Vec<Threshold>,
    /// Exit with 5 if B differs from A, an image with the preset reference, by more than this preset promises.
    #[arg(long, value_parser = preset())]
    pub(crate) verify_preset: Option<Preset>,
}

#[derive(Args, Debug)]
pub(crate) struct StitchArgs {
    /// All tiles of one image, PNG or EXR, drawn by surfel with --tile or --region, in any order.
    #[arg(required = true, value_name = "TILE")]
    pub(crate) tiles: Vec<PathBuf>,
    /// Image to write, in the tiles' format; for PNG tiles also .tif.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// Overwrite an existing file.
    #[arg(short, long)]
    pub(crate) force: bool,
}

/// Job system that runs a job.
#[derive(Args, Clone, Copy, Debug)]
#[group(required = true, multiple = false)]
pub(crate) struct Engine {
    /// Print a job template for OpenJD (Deadline Cloud, openjd-cli), as JSON.
    #[arg(long)]
    pub(crate) openjd: bool,
    /// Print a script for Slurm's sbatch with an array of tasks; run by bash, it also submits a second job that merges
    /// results.
    #[arg(long)]
    pub(crate) slurm: bool,
    /// Print a Kubernetes Job with indexed completions, as JSON; for tiles and shards, also a job that merges their
    /// files.
    #[arg(long)]
    pub(crate) k8s: bool,
    /// Print shell commands, one per line, for OpenCue's cuecmd or GNU parallel.
    #[arg(long)]
    pub(crate) cuecmd: bool,
    /// Print a Snakefile.
    #[arg(long)]
    pub(crate) snakemake: bool,
}

#[derive(Args, Debug)]
pub(crate) struct JobsArgs {
    /// A scene file, splats, points or meshes.
    #[arg(required = true, value_name = "SCENE")]
    pub(crate) inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) engine: Engine,
    /// Images to write; by default {frame}.png, {name}.png or whole.png in the current folder. OUT.copc.laz converts
    /// all inputs, by shards OUT.NUMBER.shard.
    #[arg(short, long, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Draw a turntable of N images.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) frames: Option<u32>,
    /// Draw only these frames or cameras.
    #[arg(long, value_name = "A-B[:STEP]", value_parser = surfel_app::values::frame_range)]
    pub(crate) frame_range: Option<FrameRange>,
    /// Draw from all cameras of another program.
    #[arg(long, value_name = "FILE|DIR", conflicts_with = "frames")]
    pub(crate) cameras: Option<PathBuf>,
    /// Draw one image as N tiles, and merge them.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000),
        conflicts_with_all = ["frames", "cameras", "frame_range"])]
    pub(crate) tiles: Option<u32>,
    /// Number of tasks that the images or points are divided into; by default 64, and at most one per image.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), conflicts_with = "tiles")]
    pub(crate) tasks: Option<u32>,
    /// Container image for --k8s, with surfel on its PATH.
    #[arg(long, value_name = "NAME", default_value = "surfel")]
    pub(crate) image: String,
    /// Flags of `surfel render`, or of `surfel convert`, for all tasks.
    #[arg(last = true, value_name = "FLAG", allow_hyphen_values = true)]
    pub(crate) flags: Vec<String>,
}

#[derive(Args, Debug)]
pub(crate) struct BackendsArgs {
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Args, Debug)]
pub(crate) struct ViewArgs {
    /// A scene file, splats, points or meshes.
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
}

#[derive(Args, Debug)]
pub(crate) struct CompletionsArgs {
    /// Shell that the script is for.
    pub(crate) shell: Shell,
}

/// Returns a parser of presets.
fn preset() -> impl TypedValueParser<Value = Preset> {
    let names = surfel_app::values::PRESETS.iter().map(|(name, _)| *name);
    PossibleValuesParser::new(names).try_map(|name| surfel_app::values::preset(&name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed_by(table: &Table, words: &[&str]) -> Options {
        let matches = grammar(table).try_get_matches_from(words).unwrap_or_else(|e| panic!("{words:?}: {e}"));
        let (name, of) = matches.subcommand().unwrap();
        options(table, Commands::named(name), of).unwrap()
    }

    #[test]
    fn grammar_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn every_flag_means_the_same_to_a_library() {
        for row in table().rows() {
            for name in row.commands.names() {
                let command = Commands::named(name);
                let needed: Vec<&Row> = table().of(command).filter(|r| r.is_required && r.name != row.name).collect();
                let needed = needed.iter().map(|row| row.name).chain(row.requires.iter().copied());
                let mut words = vec!["surfel".to_owned(), name.to_owned(), "a.ply".to_owned()];
                let mut set = Options::default();
                set.inputs = vec!["a.ply".into()];
                for flag in std::iter::once(row.name).chain(needed) {
                    let row = table().find(command, flag).unwrap();
                    let sample = row.sample();
                    words.push(if row.is_switch() { format!("--{flag}") } else { format!("--{flag}={sample}") });
                    table().set(&mut set, command, flag, &sample).unwrap();
                }
                for row in table().of(command).filter(|other| !words.iter().any(|w| w.contains(other.name))) {
                    row.default.iter().for_each(|value| row.set(&mut set, value.as_ref()).unwrap());
                }
                let words: Vec<&str> = words.iter().map(String::as_str).collect();
                assert_eq!(parsed_by(table(), &words), set, "{words:?}");
                if row.is_image && command == Commands::RENDER {
                    let mut render = surfel_app::request::RenderOptions::default();
                    render.set(row.name, &row.sample()).unwrap();
                    assert_ne!(render, surfel_app::request::RenderOptions::default(), "{}", row.name);
                }
            }
        }
    }

    #[test]
    fn a_new_row_is_a_flag_in_help_and_completions() {
        let row = Row::text("glow", "G", |o, text| {
            o.render.cutoff = Some(surfel_app::values::cutoff(text)?);
            Ok(())
        });
        let row = row.help("Glow of splats.", "It is a test's.").everyday();
        let table = table().clone().with(row);
        assert_eq!(parsed_by(&table, &["surfel", "render", "a.ply", "--glow", "3"]).render.cutoff, Some(3.0));
        let refused = grammar(&table).try_get_matches_from(["surfel", "render", "a.ply", "--glow", "0"]);
        assert!(refused.unwrap_err().to_string().contains("--glow <G>"));
        let mut command = grammar(&table);
        let render = command.find_subcommand_mut("render").unwrap();
        assert!(render.render_help().to_string().contains("Glow of splats"));
        assert!(render.render_long_help().to_string().contains("It is a test's"));
        let mut script = Vec::new();
        clap_complete::generate(Shell::Bash, &mut grammar(&table), "surfel", &mut script);
        assert!(String::from_utf8(script).unwrap().contains("--glow"));
    }

    #[test]
    fn short_help_has_what_people_use_and_experts_flags_come_last() {
        let mut command = command();
        let render = command.find_subcommand_mut("render").unwrap();
        let short = render.render_help().to_string();
        let count = short.lines().filter(|line| line.trim_start().starts_with('-') && line.contains("--")).count();
        assert!((18..=26).contains(&count), "{count}: {short}");
        let long = render.render_long_help().to_string();
        let (common, expert) = long.split_once(EXPERT).unwrap();
        for flag in ["mapping", "cutoff", "prefilter", "accumulate", "clip", "sort", "storage", "repeat", "stats"] {
            let flag = format!("--{flag}");
            let is_listed = |text: &str| text.lines().any(|line| line.split_whitespace().next() == Some(flag.as_str()));
            assert!(is_listed(expert) && !is_listed(common), "{flag}");
        }
        let ortho = command.find_subcommand_mut("ortho").unwrap().render_long_help().to_string();
        assert!(!ortho.contains("--cull") && ortho.contains("--gsd"));
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
            let mut options = surfel_app::request::RenderOptions::default();
            let mut list = words.split(' ').peekable();
            while let Some(flag) = list.next() {
                let text = list.next_if(|next| !next.starts_with("--")).unwrap_or("on");
                options.set(flag.trim_start_matches("--"), text).unwrap();
            }
            assert!(options.check().is_err(), "{words}");
        }
    }
}
