//! Option `--config FILE`: reads flags from a TOML file.

use crate::args;
use crate::failure::Failure;
use clap::ArgMatches;
use clap::parser::ValueSource;
use std::ffi::OsString;
use std::path::Path;
use surfel_app::options::{Commands, Row, table};
use surfel_io::ShowPath as _;
use toml::Value;

/// Names of the flags that place the camera. If the command line has one of them, the others are ignored in the
/// configuration file.
const CAMERAS: [&str; 4] = ["view", "camera", "eye", "target"];

/// Returns the names of a command's options that conflict with `key`.
fn excluding(command: Commands, key: &str) -> Vec<&'static str> {
    let conflicts = |row: &&Row| row.conflicts.contains(&key);
    let by_others = table().of(command).filter(conflicts).map(|row| row.name);
    let own = table().find(command, key).into_iter().flat_map(|row| row.conflicts.iter().copied());
    let of_camera = CAMERAS.into_iter().filter(|_| CAMERAS.contains(&key));
    by_others.chain(own).chain(of_camera).collect()
}

/// Returns the flags of the configuration file as command-line arguments. Flags that the command line also has, flags
/// that conflict with those on the command line, and flags of other commands are omitted.
pub(crate) fn arguments(path: &Path, matches: &ArgMatches) -> Result<Vec<OsString>, Failure> {
    let wrong = |what: String| Failure::usage(format!("{}: {what}", path.shown()));
    let text = std::fs::read_to_string(path).map_err(|e| wrong(format!("cannot read it: {e}")))?;
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| {
        let line = e.span().map_or(1, |s| text[..s.start.min(text.len())].lines().count().max(1));
        wrong(format!("is not a TOML file: {} (line {line})", e.message().replace('\n', " ")))
    })?;
    let grammar = args::command();
    let Some((name, given)) = matches.subcommand() else { return Ok(Vec::new()) };
    let Some(command) = grammar.find_subcommand(name) else { return Ok(Vec::new()) };
    let find = |command: &clap::Command, key: &str| {
        command.get_arguments().find(|a| a.get_long() == Some(key)).map(|a| (a.get_id().clone(), kind_of(a)))
    };
    let on_command_line = |key: &str| {
        let argument = find(command, key).or_else(|| find(&grammar, key));
        argument.is_some_and(|(id, _)| {
            let sources =
                [given, matches].map(|m| m.try_contains_id(id.as_str()).ok().and_then(|_| m.value_source(id.as_str())));
            sources.contains(&Some(ValueSource::CommandLine))
        })
    };
    let mut extra: Vec<OsString> = Vec::new();
    for (key, value) in &table {
        let key = key.replace('_', "-");
        let silenced = on_command_line(&key) || excluding(Commands::named(name), &key).into_iter().any(on_command_line);
        match find(command, &key).or_else(|| find(&grammar, &key)) {
            Some(_) if silenced => {}
            Some((_, Kind::Several)) => match value {
                Value::Array(all) => {
                    let each = all.iter().map(|value| argument(&key, value, Kind::Several));
                    extra.extend(each.collect::<Result<Vec<_>, _>>().map_err(&wrong)?.into_iter().flatten());
                }
                one => extra.extend(argument(&key, one, Kind::Several).map_err(&wrong)?),
            },
            Some((_, kind)) => extra.extend(argument(&key, value, kind).map_err(&wrong)?),
            None if grammar.get_subcommands().any(|s| find(s, &key).is_some()) => {}
            None => return Err(wrong(format!("has the unknown key '{key}', expected long flag names without dashes"))),
        }
    }
    Ok(extra)
}

/// Kind of a flag, by the number of its values.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// A flag without a value.
    Switch,
    /// A flag with one value.
    Valued,
    /// A flag that may be repeated, with one value each time.
    Several,
    /// A flag whose value is optional.
    OptionalValue,
}

fn kind_of(argument: &clap::Arg) -> Kind {
    let may_stand_alone = argument.get_num_args().is_some_and(|count| count.min_values() == 0);
    let is_repeated = matches!(argument.get_action(), clap::ArgAction::Append);
    match argument.get_action().takes_values() {
        false => Kind::Switch,
        true if is_repeated && argument.get_value_delimiter().is_none() => Kind::Several,
        true if may_stand_alone && argument.get_possible_values().is_empty() => Kind::OptionalValue,
        true => Kind::Valued,
    }
}

fn argument(key: &str, value: &Value, kind: Kind) -> Result<Option<OsString>, String> {
    let is_switch = kind == Kind::Switch;
    let scalar = |value: &Value| match value {
        Value::String(s) => Some(s.clone()),
        Value::Integer(i) => Some(i.to_string()),
        Value::Float(f) => Some(f.to_string()),
        _ => None,
    };
    let wrong = || format!("has {key} = {value}, expected {}", if is_switch { "true or false" } else { "its value" });
    let text = match value {
        Value::Boolean(on) if matches!(kind, Kind::Switch | Kind::OptionalValue) => {
            return Ok(on.then(|| format!("--{key}").into()));
        }
        Value::Boolean(on) => (if *on { "on" } else { "off" }).to_owned(),
        _ if is_switch => return Err(wrong()),
        Value::Array(values) => {
            let parts: Option<Vec<String>> = values.iter().map(scalar).collect();
            parts.ok_or_else(wrong)?.join(",")
        }
        value => scalar(value).ok_or_else(wrong)?,
    };
    Ok(Some(format!("--{key}={text}").into()))
}
