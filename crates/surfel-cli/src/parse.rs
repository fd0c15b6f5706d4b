//! Parsing of the command line and the configuration file.

use crate::args::{self, Cli, Command, command};
use crate::failure::Failure;
use crate::{config, console, render};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use surfel_app::options::{Commands, Near, Row, Setter, table};

/// Parses a command line. Inserts `render` if no command is given, and the flags of the configuration file.
///
/// Errors and help are printed here; the error is the exit code.
pub(crate) fn parse(mut arguments: Vec<OsString>) -> Result<Cli, u8> {
    join_values(&mut arguments);
    let words: Vec<String> = arguments.iter().skip(1).map(|a| a.to_string_lossy().into_owned()).collect();
    // The grammar takes 4 million instructions to build, so it is built once.
    let grammar = command();
    let bare = insert_render(&mut arguments, &words, &grammar);
    let matches = grammar.try_get_matches_from(&arguments).map_err(|e| print_parse_error(&e, &arguments))?;
    let cli = args::parsed(&matches).map_err(|e| print_parse_error(&e, &arguments))?;
    let Some(path) = &cli.program.config else { return completed(cli, bare) };
    let extra = config::arguments(path, &matches).map_err(|failure| tell(&failure))?;
    let end = arguments.iter().position(|a| a == "--").unwrap_or(arguments.len());
    arguments.splice(end..end, extra);
    let matches = command().try_get_matches_from(&arguments).map_err(|e| print_parse_error(&e, &arguments))?;
    let cli = args::parsed(&matches).map_err(|e| print_parse_error(&e, &arguments))?;
    completed(cli, bare)
}

/// Records whether the command line omitted `render`, and sets default file names.
fn completed(mut cli: Cli, bare: bool) -> Result<Cli, u8> {
    if let Command::Render(args) = &mut cli.command {
        args.names_output = bare;
    }
    name_color_bar(&mut cli).map_err(|failure| tell(&failure))?;
    Ok(cli)
}

fn tell(failure: &Failure) -> u8 {
    console::error(failure.message());
    failure.code()
}

/// Joins a flag whose value is optional with the next word, if that word is a value of the flag. `--edge-aa samples`
/// becomes `--edge-aa=samples`, and `--colorbar BAR.png` becomes `--colorbar=BAR.png`. For a path, the word must have
/// the extension of the option's example. Any other word is an input.
pub(crate) fn join_values(arguments: &mut Vec<OsString>) {
    for row in table().rows().filter(|row| row.missing.is_some()) {
        let flag = format!("--{}", row.name);
        let extension = Path::new(row.example).extension();
        let is_value = |word: &OsString| match row.set {
            Setter::Path(_) => Path::new(word).extension().map(OsStr::to_ascii_lowercase).as_deref() == extension,
            _ => word.to_str().is_some_and(|word| row.has_name(word)),
        };
        let end = arguments.iter().position(|a| a == "--").unwrap_or(arguments.len());
        if let Some(at) = arguments[..end].windows(2).position(|pair| pair[0] == *flag && is_value(&pair[1])) {
            let value = arguments.remove(at + 1);
            arguments[at].push("=");
            arguments[at].push(value);
        }
    }
}

/// Sets the file name of a colour bar that has none. For OUT.png, the name is OUT-colorbar.png.
fn name_color_bar(cli: &mut Cli) -> Result<(), Failure> {
    let args = match &mut cli.command {
        Command::Render(args) | Command::Convert(args) | Command::Ortho(args) if args.names_colorbar => args,
        _ => return Ok(()),
    };
    let first = [&args.output, &args.dsm, &args.normals].into_iter().flatten().next();
    let output = first.cloned().or_else(|| render::default_output(args));
    let Some(output) = output.filter(|output| output.as_os_str() != "-") else {
        return Err(Failure::usage("--colorbar: there is no OUT to name it after, expected --colorbar=FILE.png"));
    };
    args.render.splats.colorbar.get_or_insert_with(|| default_color_bar_path(&output));
    Ok(())
}

/// Returns the file name of an image's colour bar, which all frames and cameras of an input share.
pub(crate) fn default_color_bar_path(output: &Path) -> PathBuf {
    let stem = output.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = ["{frame}", "{name}", "{backend}"].iter().fold(stem, |stem, placeholder| stem.replace(placeholder, ""));
    let stem = stem.trim_matches(['-', '_', '.', ' ']);
    output.with_file_name(if stem.is_empty() { "colorbar.png".to_owned() } else { format!("{stem}-colorbar.png") })
}

/// Inserts `render` if the first word after global flags isn't a command, so that `surfel INPUT …` means `surfel render
/// INPUT …`. Returns true if it did.
fn insert_render(arguments: &mut Vec<OsString>, words: &[String], grammar: &clap::Command) -> bool {
    let mut i = 0;
    while let Some(word) = words.get(i).map(String::as_str) {
        match word {
            "-q" | "--quiet" | "-v" | "--verbose" => i += 1,
            "--threads" | "--config" => i += 2,
            _ if word.starts_with("--threads=") || word.starts_with("--config=") => i += 1,
            "-h" | "--help" | "-V" | "--version" | "help" => return false,
            _ if grammar.get_subcommands().any(|command| command.get_name() == word) => return false,
            _ => break,
        }
    }
    if !words.is_empty() {
        arguments.insert(1, "render".into());
    }
    !words.is_empty()
}

/// Returns the message about a flag that the command doesn't have; `None` for other errors.
fn unknown(error: &clap::Error, arguments: &[OsString]) -> Option<String> {
    let Some(ContextValue::String(flag)) = error.get(ContextKind::InvalidArg) else { return None };
    let mut words = arguments.iter().skip(1).filter_map(|word| word.to_str());
    let name = words.find(|word| Commands::named(word) != Commands::NONE)?;
    let help = format!("  help: surfel {name} --help");
    let usage = |row: &Row| format!("{}: {}", row.usage(), row.help.trim_end_matches('.'));
    Some(match table().near(Commands::named(name), flag.trim_start_matches('-')) {
        Some(Near::Here(row)) => format!("unexpected argument '{flag}' found\n  tip: {}\n{help}", usage(row)),
        Some(Near::Elsewhere(row)) => {
            let others: Vec<String> = row.commands.names().map(|name| format!("surfel {name}")).collect();
            format!("{flag} is not for surfel {name}, but for {}\n{help}", others.join(", "))
        }
        None => format!("unexpected argument '{flag}' found\n{help}"),
    })
}

/// Prints clap's error in at most four lines (help and version completely) and returns the exit code.
fn print_parse_error(error: &clap::Error, arguments: &[OsString]) -> u8 {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            // A closed pipe isn't an error.
            let _ = error.print();
            0
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = error.print();
            2
        }
        ErrorKind::UnknownArgument if unknown(error, arguments).is_some() => {
            console::error(&unknown(error, arguments).unwrap_or_default());
            2
        }
        _ => {
            let text = error.render().to_string();
            let lines = text.lines().map(str::trim_end).filter(|l| !l.trim().is_empty());
            let lines = lines.take_while(|l| !l.starts_with("Usage:"));
            let mut message: Vec<&str> = lines.filter(|l| !l.starts_with("For more information")).take(3).collect();
            if let Some(first) = message.first_mut() {
                *first = first.strip_prefix("error: ").unwrap_or(first);
            }
            message.push("  help: surfel --help, or surfel COMMAND --help");
            console::error(&message.join("\n"));
            2
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_that_may_stand_alone_take_the_value_that_follows_them() {
        let joined = |line: &str| {
            let mut arguments: Vec<OsString> = line.split(' ').map(Into::into).collect();
            join_values(&mut arguments);
            arguments.join(" ".as_ref()).into_string().unwrap()
        };
        assert_eq!(joined("surfel a.ply --edge-aa samples -o x.png"), "surfel a.ply --edge-aa=samples -o x.png");
        assert_eq!(joined("surfel --colorbar b.PNG a.ply"), "surfel --colorbar=b.PNG a.ply");
        for whole in [
            "surfel --edge-aa a.ply",
            "surfel --edge-aa=off on",
            "surfel a.ply --edge-aa",
            "surfel -- --edge-aa on",
            "surfel --colorbar a.ply",
            "surfel --colorbar -o b.png",
        ] {
            assert_eq!(joined(whole), whole);
        }
    }

    #[test]
    fn color_bars_are_named_after_the_image() {
        let named = |output: &str| default_color_bar_path(Path::new(output)).to_string_lossy().replace('\\', "/");
        assert_eq!(named("out/a.png"), "out/a-colorbar.png");
        assert_eq!(named("{input}.png"), "{input}-colorbar.png");
        assert_eq!(named("out/turn-{frame}.exr"), "out/turn-colorbar.png");
        assert_eq!(named("out/{name}.exr"), "out/colorbar.png");
    }

    #[test]
    fn bare_form_gets_its_render() {
        let inserted = |line: &str| {
            let mut arguments: Vec<OsString> = line.split(' ').map(Into::into).collect();
            let words: Vec<String> = line.split(' ').skip(1).map(Into::into).collect();
            let inserted = insert_render(&mut arguments, &words, &command());
            assert_eq!(inserted, arguments.len() > words.len() + 1);
            arguments.get(1).is_some_and(|a| a == "render") && inserted
        };
        assert!(inserted("surfel a.ply -o x.png"));
        assert!(inserted("surfel -o x.png a.ply"));
        assert!(inserted("surfel -q --threads 2 a.ply -o x.png"));
        assert!(!inserted("surfel info a.ply"));
        assert!(!inserted("surfel -q --threads 2 info a.ply"));
        assert!(!inserted("surfel --help"));
    }
}
