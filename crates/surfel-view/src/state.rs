//! State of the page: a JSON object of options by their long names, and its export as a command or Python program.

use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use surfel_app::options::{Audience, Commands, Options, Row, Setter, table};

/// State of a page: options by their long names.
pub(crate) type State = Map<String, Value>;

/// Names of the options that a client may not set, because they open files, or lift limits that the server's owner set.
const OWNER_ONLY_OPTIONS: [&str; 8] =
    ["memory", "storage", "adapter", "no-metadata", "planes", "label", "columns", "allow-outside"];

/// Inputs and options of a page that its clients can't change.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fixed {
    /// Paths of the input files, as given.
    pub(crate) inputs: Vec<PathBuf>,
    /// Names of the input files as shown on the page and in copied commands.
    pub(crate) names: Vec<PathBuf>,
    /// Long names and texts of the options that pages can't change.
    pub(crate) flags: Vec<(String, String)>,
}

/// True if clients may set an option.
pub(crate) fn is_for_clients(row: &Row) -> bool {
    (row.is_image || row.name == "backend") && !OWNER_ONLY_OPTIONS.contains(&row.name) && row.name != "size"
}

/// Returns the table's entry of an option, if clients may set the option to this value. Values that name a file of the
/// server are refused.
fn row_for(name: &str, value: &str) -> Result<&'static Row, String> {
    let row = table().find(Commands::VIEW, name).filter(|row| is_for_clients(row));
    let row = row.ok_or_else(|| format!("{name}: there is no such option of the page"))?;
    let is_builtin = row.name == "matcap" && value == "builtin";
    if matches!(row.set, Setter::Path(_)) && !row.has_name(value) && !is_builtin {
        return Err(format!("{name}: files are given on the command line only"));
    }
    Ok(row)
}

/// Returns the option texts that a JSON value of the state stands for: one, or several for an option that may be
/// repeated.
fn text_of(value: &Value) -> Result<Vec<String>, String> {
    let single = |value: &Value| match value {
        Value::String(text) => Ok(text.clone()),
        Value::Bool(on) => Ok(if *on { "on" } else { "off" }.to_owned()),
        Value::Number(number) => Ok(number.to_string()),
        _ => Err(format!("expected text, a number, true or false, found {value}")),
    };
    match value {
        Value::Array(list) => list.iter().map(single).collect(),
        value => single(value).map(|text| vec![text]),
    }
}

/// Returns the fixed options and then those of a state, each with the text of its value. Fixed options that the state
/// replaces are left out, but values of an option that may be repeated are joined. Returns an error for an option that
/// pages can't set, or for options that exclude each other.
fn flags(fixed: &Fixed, state: &State) -> Result<Vec<(&'static Row, String)>, String> {
    let mut flags = Vec::new();
    let replaces_camera = ["view", "eye", "target"].iter().any(|name| state.contains_key(*name));
    for (name, text) in &fixed.flags {
        // A value of the page replaces the value of the command line.
        if name == "camera" && replaces_camera {
            continue;
        }
        let row = table().find(Commands::VIEW, name).ok_or_else(|| format!("there is no option {name}"))?;
        if row.is_repeated || !state.contains_key(name) {
            flags.push((row, text.clone()));
        }
    }
    // The page's eye and target replace the camera of a view. Of the options for perspective and orthographic
    // projection, only those of the current projection are used.
    let has = |name: &str| state.contains_key(name);
    let is_replaced = |name: &str| {
        name == "view" && (has("eye") || has("target"))
            || name == "fov-y" && has("ortho")
            || name == "ortho-height" && !has("ortho")
    };
    for (name, value) in state.iter().filter(|(name, _)| !is_replaced(name)) {
        let texts = text_of(value).map_err(|e| format!("{name}: {e}"))?;
        for text in &texts {
            let row = row_for(name, text)?;
            if texts.len() > 1 && !row.is_repeated {
                return Err(format!("{name}: expected one value, found {}", texts.len()));
            }
            if text.chars().any(char::is_control) {
                return Err(format!("{name}: expected text without control characters"));
            }
            flags.push((row, text.clone()));
        }
    }
    let is_given = |name: &str| flags.iter().any(|(row, _)| row.name == name);
    for (row, _) in &flags {
        if let Some(other) = row.conflicts.iter().find(|other| is_given(other)) {
            return Err(format!("{} and {other} exclude each other", row.name));
        }
    }
    Ok(flags)
}

/// Returns the options for an image of this state, with a size in pixels.
///
/// # Errors
/// A message for the page, which names the option and its problem.
pub(crate) fn options(fixed: &Fixed, state: &State, size: [u32; 2]) -> Result<Options, String> {
    let mut options = Options::default();
    options.inputs.clone_from(&fixed.inputs);
    options.render.size = Some(size);
    for (row, text) in flags(fixed, state)? {
        row.set(&mut options, text.as_ref()).map_err(|e| format!("--{} {text}: {e}", row.name))?;
    }
    Ok(options)
}

/// Returns the shell command that writes the image of a state, with `width` × `height` pixels.
pub(crate) fn command(fixed: &Fixed, state: &State, [width, height]: [u32; 2]) -> Result<String, String> {
    let mut words = vec!["surfel".to_owned(), "render".to_owned()];
    for path in &fixed.names {
        let path = path.to_string_lossy();
        // A name that begins with a hyphen would be a flag; a hyphen alone is stdin.
        let folder = if path.len() > 1 && path.starts_with('-') { "./" } else { "" };
        words.push(quoted(&format!("{folder}{path}")));
    }
    for (row, text) in flags(fixed, state)? {
        match (row.is_switch(), text.as_str()) {
            (true, "on") => words.push(format!("--{}", row.name)),
            (true, _) => {}
            (false, text) if row.missing.is_some() || text.starts_with('-') => {
                words.push(format!("--{}={}", row.name, quoted(text)));
            }
            (false, text) => words.extend([format!("--{}", row.name), quoted(text)]),
        }
    }
    words.extend([format!("--size {width}x{height}"), "-o view.png".to_owned()]);
    Ok(words.join(" "))
}

/// Quotes a word for a POSIX shell if it needs quotes.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:+=@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// Returns the Python program that writes the image of a state, with `width` × `height` pixels.
pub(crate) fn python(fixed: &Fixed, state: &State, [width, height]: [u32; 2]) -> Result<String, String> {
    let inputs: Vec<String> = fixed.names.iter().map(|path| json!(path.to_string_lossy()).to_string()).collect();
    let mut keywords: Vec<(&'static str, Vec<String>)> = Vec::new();
    for (row, text) in flags(fixed, state)? {
        if !row.keyword.has(Commands::RENDER) || row.is_switch() && text != "on" {
            continue;
        }
        match keywords.iter_mut().find(|(name, _)| *name == row.name) {
            Some((_, values)) => values.push(literal(row, &text)),
            None => keywords.push((row.name, vec![literal(row, &text)])),
        }
    }
    let keywords = keywords.into_iter().map(|(name, values)| match &values[..] {
        [single] => format!("    {}={single},\n", name.replace('-', "_")),
        several => format!("    {}=[{}],\n", name.replace('-', "_"), several.join(", ")),
    });
    let keywords: String = keywords.collect();
    let inputs = inputs.join(", ");
    Ok(format!(
        "import surfel\n\nimage = surfel.open({inputs}).render(\n    size=({width}, {height}),\n{keywords})\n\
         image.save(\"view.png\")\n"
    ))
}

/// Returns an option's value as a Python literal of the type of its keyword argument.
fn literal(row: &Row, text: &str) -> String {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let is_plain = |c: char| c.is_ascii_digit() || "-+.eE, ".contains(c);
    // Python has no numbers with leading zeros, such as 01.
    let is_padded = |part: &str| {
        let digits = part.trim().trim_start_matches(['-', '+']).as_bytes();
        digits.first() == Some(&b'0') && digits.get(1).is_some_and(u8::is_ascii_digit)
    };
    match numbers.filter(|_| text.chars().all(is_plain) && !text.split(',').any(is_padded)) {
        _ if row.is_switch() => "True".to_owned(),
        Some(numbers) if numbers.len() > 1 => format!("({text})"),
        Some(_) if row.python.contains("float") || row.python.contains("int") => text.to_owned(),
        _ => json!(text).to_string(),
    }
}

/// Returns the first message to a page: the options that the page can set, and the initial state.
pub(crate) fn welcome(fixed: &Fixed, initial: &State) -> Value {
    let rows = table().of(Commands::VIEW).filter(|row| is_for_clients(row) && row.is_built);
    let row = |row: &Row| {
        json!({
            "name": row.name, "value": row.value, "names": row.names.map(|names| names()), "open": row.is_open,
            "help": row.help, "group": row.group.heading(), "expert": row.audience == Audience::Expert,
            "switch": row.is_switch(), "default": row.default,
        })
    };
    let inputs: Vec<String> = fixed.names.iter().map(|path| name_of(path)).collect();
    let rows: Vec<Value> = rows.map(row).collect();
    let version = surfel_app::metadata::VERSION;
    json!({ "do": "welcome", "version": version, "inputs": inputs, "rows": rows, "state": initial })
}

/// Returns a file's name without its folder.
pub(crate) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(value: &Value) -> State {
        value.as_object().unwrap().clone()
    }

    fn fixed() -> Fixed {
        Fixed { inputs: vec![], names: vec!["a b.ply".into()], flags: vec![("memory".into(), "1G".into())] }
    }

    #[test]
    fn states_become_options_commands_and_python() {
        let state = state(&json!({
            "eye": "1,2,-3", "target": "0,0,0", "view": "top", "shadows": true, "edge-aa": "on", "cutoff": 2.5,
            "where": ["z<5", "intensity>3"], "color-by": "height", "ortho": false,
        }));
        let options = options(&fixed(), &state, [64, 48]).unwrap();
        assert_eq!((options.render.eye, options.render.view), (Some([1.0, 2.0, -3.0]), None));
        assert!(options.render.shadows && options.render.check().is_ok());
        let command = command(&fixed(), &state, [64, 48]).unwrap();
        let expected = "surfel render 'a b.ply' --memory 1G --color-by height --cutoff 2.5 --edge-aa=on --eye 1,2,-3 \
                        --shadows --target 0,0,0 --where 'z<5' --where 'intensity>3' --size 64x48 -o view.png";
        assert_eq!(command, expected);
        let python = python(&fixed(), &state, [64, 48]).unwrap();
        for line in [
            "surfel.open(\"a b.ply\").render(",
            "eye=(1,2,-3),",
            "shadows=True,",
            "cutoff=2.5,",
            "where=[\"z<5\", \"intensity>3\"],",
            "color_by=\"height\",",
        ] {
            assert!(python.contains(line), "{line}: {python}");
        }
        assert!(!python.contains("view=") && !python.contains("ortho="));
    }

    #[test]
    fn clients_can_name_no_file_and_no_other_option() {
        for bad in [
            json!({ "matcap": "/etc/passwd" }),
            json!({ "matcap": "../a.png" }),
            json!({ "texture": "a.png" }),
            json!({ "camera": "a.json" }),
            json!({ "colorbar": "a.png" }),
            json!({ "output": "a.png" }),
            json!({ "memory": "100G" }),
            json!({ "config": "a.toml" }),
            json!({ "cameras": "a.json" }),
            json!({ "columns": "x,y,z" }),
            json!({ "size": "9x9" }),
            json!({ "unknown": "1" }),
            json!({ "eye": { "x": 1 } }),
            json!({ "eye": "1,2" }),
            json!({ "shader": "none" }),
        ] {
            assert!(options(&fixed(), &state(&bad), [9, 9]).is_err(), "{bad}");
        }
        for good in [json!({ "matcap": "builtin" }), json!({ "texture": "fit" }), json!({ "backend": "cpu" })] {
            assert!(options(&fixed(), &state(&good), [9, 9]).is_ok(), "{good}");
        }
    }

    #[test]
    fn every_path_option_is_refused_for_clients() {
        for row in table().of(Commands::VIEW).filter(|row| matches!(row.set, Setter::Path(_))) {
            let state = state(&json!({ row.name: "../secret.png" }));
            assert!(options(&fixed(), &state, [9, 9]).is_err(), "{}", row.name);
            let builtin = state_of_builtin(row.name);
            assert_eq!(options(&fixed(), &builtin, [9, 9]).is_ok(), row.name == "matcap", "{}", row.name);
        }
    }

    fn state_of_builtin(name: &str) -> State {
        state(&json!({ name: "builtin" }))
    }

    #[test]
    fn states_that_no_command_has_are_refused() {
        for bad in [
            json!({ "shadows": ["on", "off"] }),
            json!({ "color": "red", "color-by": "z" }),
            json!({ "color-by": "a\u{3}b" }),
            json!({ "color-by": "a\nb" }),
            json!({ "allow-outside": "on" }),
        ] {
            assert!(command(&fixed(), &state(&bad), [9, 9]).is_err(), "{bad}");
        }
        assert!(options(&fixed(), &state(&json!({ "where": ["z>1", "z<2"] })), [9, 9]).is_ok());
    }

    #[test]
    fn commands_have_one_value_and_no_word_that_looks_like_a_flag() {
        let fixed = Fixed {
            inputs: Vec::new(),
            names: vec!["-x.ply".into()],
            flags: vec![("colormap".into(), "my.txt".into()), ("camera".into(), "c.json".into())],
        };
        let copied = command(&fixed, &state(&json!({ "colormap": "turbo", "view": "top", "color-by": "-z" })), [9, 9]);
        let copied = copied.unwrap();
        assert!(copied.starts_with("surfel render ./-x.ply ") && copied.contains(" --color-by=-z "), "{copied}");
        assert!(copied.contains("--colormap turbo") && !copied.contains("my.txt"), "{copied}");
        assert!(!copied.contains("c.json"), "{copied}");
    }
}
