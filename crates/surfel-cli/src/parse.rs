//! From the command line and the configuration file to what is asked for.

use crate::args::{Cli, Command, command};
use crate::{config, console};
use clap::FromArgMatches;
use clap::error::ErrorKind;
use std::ffi::OsString;

/// Parses a command line: the bare form gets its `render`, and the configuration file its say.
///
/// Errors (and help) are printed; then there is only the exit code.
pub(crate) fn parse(mut arguments: Vec<OsString>) -> Result<Cli, u8> {
    join_edge_aa(&mut arguments);
    let words: Vec<String> = arguments.iter().skip(1).map(|a| a.to_string_lossy().into_owned()).collect();
    let bare = insert_render(&mut arguments, &words);
    let matches = command().try_get_matches_from(&arguments).map_err(|e| complain(&e))?;
    let cli = Cli::from_arg_matches(&matches).map_err(|e| complain(&e))?;
    let Some(path) = &cli.config else { return Ok(said_bare(cli, bare)) };
    let extra = config::arguments(path, &matches).map_err(|failure| {
        console::error(failure.message());
        failure.code()
    })?;
    let end = arguments.iter().position(|a| a == "--").unwrap_or(arguments.len());
    arguments.splice(end..end, extra);
    let matches = command().try_get_matches_from(&arguments).map_err(|e| complain(&e))?;
    let cli = Cli::from_arg_matches(&matches).map_err(|e| complain(&e))?;
    Ok(said_bare(cli, bare))
}

/// Tells `render` whether the command line left its name out.
fn said_bare(mut cli: Cli, bare: bool) -> Cli {
    if let Command::Render(args) = &mut cli.command {
        args.bare = bare;
    }
    cli
}

/// `--edge-aa samples` is `--edge-aa=samples`. What else follows the flag, which may stand alone, is an input.
fn join_edge_aa(arguments: &mut Vec<OsString>) {
    let end = arguments.iter().position(|a| a == "--").unwrap_or(arguments.len());
    let is_value = |word: &OsString| ["on", "off", "samples"].iter().any(|value| word == value);
    if let Some(at) = arguments[..end].windows(2).position(|pair| pair[0] == "--edge-aa" && is_value(&pair[1])) {
        let value = arguments.remove(at + 1);
        arguments[at].push("=");
        arguments[at].push(value);
    }
}

/// `surfel INPUT …` is `surfel render INPUT …`: where the first word after global flags is no command. Says
/// whether it is so.
fn insert_render(arguments: &mut Vec<OsString>, words: &[String]) -> bool {
    let commands: Vec<String> = command().get_subcommands().map(|s| s.get_name().to_owned()).collect();
    let mut i = 0;
    while let Some(word) = words.get(i).map(String::as_str) {
        match word {
            "-q" | "--quiet" | "-v" | "--verbose" => i += 1,
            "--threads" | "--config" => i += 2,
            _ if word.starts_with("--threads=") || word.starts_with("--config=") => i += 1,
            "-h" | "--help" | "-V" | "--version" | "help" => return false,
            _ if commands.iter().any(|c| c == word) => return false,
            _ => break,
        }
    }
    if !words.is_empty() {
        arguments.insert(1, "render".into());
    }
    !words.is_empty()
}

/// Prints clap's error in at most four lines (help and versions whole) and gives the exit code.
fn complain(error: &clap::Error) -> u8 {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            // A closed pipe is no reason to complain.
            let _ = error.print();
            0
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = error.print();
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
    fn edge_aa_takes_the_value_that_follows_it() {
        let joined = |line: &str| {
            let mut arguments: Vec<OsString> = line.split(' ').map(Into::into).collect();
            join_edge_aa(&mut arguments);
            arguments.join(" ".as_ref()).into_string().unwrap()
        };
        assert_eq!(joined("surfel a.ply --edge-aa samples -o x.png"), "surfel a.ply --edge-aa=samples -o x.png");
        for whole in
            ["surfel --edge-aa a.ply", "surfel --edge-aa=off on", "surfel a.ply --edge-aa", "surfel -- --edge-aa on"]
        {
            assert_eq!(joined(whole), whole);
        }
    }

    #[test]
    fn bare_form_gets_its_render() {
        let inserted = |line: &str| {
            let mut arguments: Vec<OsString> = line.split(' ').map(Into::into).collect();
            let words: Vec<String> = line.split(' ').skip(1).map(Into::into).collect();
            let inserted = insert_render(&mut arguments, &words);
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
