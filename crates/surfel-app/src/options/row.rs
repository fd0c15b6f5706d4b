//! Rows of the options table.

use super::Options;
use crate::values::switch;
use std::ffi::OsStr;
use std::path::PathBuf;
use surfel_load::effects::{self, Inputs};

/// Set of commands, one bit for each command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Commands(u16);

impl Commands {
    /// No command.
    pub const NONE: Self = Self(0);
    /// `surfel render`, and `surfel.render` in Python.
    pub const RENDER: Self = Self(1);
    /// `surfel convert`.
    pub const CONVERT: Self = Self(2);
    /// `surfel ortho`.
    pub const ORTHO: Self = Self(4);
    /// `surfel serve`.
    pub const SERVE: Self = Self(8);
    /// `surfel again`.
    pub const AGAIN: Self = Self(16);
    /// `surfel info`.
    pub const INFO: Self = Self(32);
    /// `surfel figure`.
    pub const FIGURE: Self = Self(64);
    /// `surfel view`.
    pub const VIEW: Self = Self(128);
    /// Set of all commands, including commands without rows in the table.
    pub const ALL: Self = Self(u16::MAX);
    /// Commands that write images of a scene: `render` and `serve`.
    pub const IMAGE_FILES: Self = Self::RENDER.and(Self::SERVE);
    /// Commands that draw images of a scene: `render`, `serve` and `view`.
    pub const IMAGES: Self = Self::IMAGE_FILES.and(Self::VIEW);
    /// Commands that draw a scene from a camera: `render`, `serve`, `view` and `figure`.
    pub const DRAWN: Self = Self::IMAGES.and(Self::FIGURE);
    /// Commands that make splats: `render`, `serve`, `view`, `figure`, `convert` and `ortho`.
    pub const SPLATS: Self = Self::DRAWN.and(Self::CONVERT).and(Self::ORTHO);
    /// All commands of the table, with their names.
    pub const NAMED: [(&'static str, Self); 8] = [
        ("render", Self::RENDER),
        ("convert", Self::CONVERT),
        ("ortho", Self::ORTHO),
        ("serve", Self::SERVE),
        ("again", Self::AGAIN),
        ("info", Self::INFO),
        ("figure", Self::FIGURE),
        ("view", Self::VIEW),
    ];

    /// Returns the union of both sets.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns the commands of this set that `other` lacks.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Returns the intersection of both sets.
    #[must_use]
    pub const fn common(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// True if both sets have a command in common.
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Returns the command with this name, or [`Self::NONE`] if the table doesn't have it.
    pub fn named(name: &str) -> Self {
        Self::NAMED.iter().find(|(known, _)| *known == name).map_or(Self::NONE, |(_, command)| *command)
    }

    /// Returns the names of the commands.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMED.into_iter().filter(move |(_, command)| self.has(*command)).map(|(name, _)| name)
    }
}

/// Group of options with a common task. Help lists the groups in the order of the variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// Images and files that are written.
    Output,
    /// Panels of a figure, with their titles and marks.
    Figure,
    /// Pixel grid of an orthoimage.
    Grid,
    /// Camera: its position, direction and projection.
    Camera,
    /// Shading, light and background of an image.
    Appearance,
    /// Colours of points, meshes and values.
    Colors,
    /// Selection of points.
    Points,
    /// Conversion to splats.
    Splats,
    /// Reading of input files.
    Files,
    /// Several images of a scene: turntables, camera paths and sequences.
    Series,
    /// Division of a job into shards for several machines.
    Jobs,
    /// Selection of the rendering backend and its device.
    Backend,
    /// Behaviour of the program itself, such as its messages.
    Program,
}

impl Group {
    /// All groups in the order of help.
    pub const ALL: [Self; 13] = [
        Self::Output,
        Self::Figure,
        Self::Grid,
        Self::Camera,
        Self::Appearance,
        Self::Colors,
        Self::Points,
        Self::Splats,
        Self::Files,
        Self::Series,
        Self::Jobs,
        Self::Backend,
        Self::Program,
    ];

    /// Returns the heading above the group's options.
    pub const fn heading(self) -> &'static str {
        match self {
            Self::Output => "Output",
            Self::Figure => "Figure",
            Self::Grid => "Grid",
            Self::Camera => "Camera",
            Self::Appearance => "Appearance",
            Self::Colors => "Colours",
            Self::Points => "Selection of points",
            Self::Splats => "Conversion to splats",
            Self::Files => "Reading files",
            Self::Series => "Several images",
            Self::Jobs => "Shards of a job",
            Self::Backend => "Backend",
            Self::Program => "Program",
        }
    }
}

/// Group of users for whom an option is meant; it decides where help lists the option.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Audience {
    /// All users: `-h` lists the option.
    Everyday,
    /// Users who read the whole list: `--help` lists the option.
    All,
    /// Experts: `--help` lists the option last.
    Expert,
}

/// Heading of the section with the experts' options.
pub const EXPERT: &str = "For experts";

/// Function that stores an option's value, by the form of the value on the command line.
#[derive(Clone, Copy, Debug)]
pub enum Setter {
    /// Function for a switch, which has no value. The argument is true if the switch is on.
    Switch(fn(&mut Options, bool)),
    /// Function that parses a value from text.
    Text(fn(&mut Options, &str) -> Result<(), String>),
    /// Function for a value that is a path. An empty path is accepted only if [`Row::missing`] is empty text.
    Path(fn(&mut Options, PathBuf) -> Result<(), String>),
}

/// An option, with all data that the command line, scene files, Python and the documentation need about it.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Row {
    /// Long name without dashes. Two rows have the same name only for different commands.
    pub name: &'static str,
    /// Letter of the short form, such as `o` for `-o`.
    pub short: Option<char>,
    /// Placeholder for the value in help, such as `WxH`; empty for switches.
    pub value: &'static str,
    /// Function that parses the value and stores it in [`Options`].
    pub set: Setter,
    /// Default value as help shows it; `None` if the default isn't a fixed text.
    pub default: Option<&'static str>,
    /// Value that is used if the option is given without one; `None` if a value is required.
    pub missing: Option<&'static str>,
    /// Function that returns the names that are valid values; `None` if the value isn't a name.
    pub names: Option<fn() -> Vec<&'static str>>,
    /// True if values other than those in [`Self::names`] are valid, too.
    pub is_open: bool,
    /// True if the option may be given several times.
    pub is_repeated: bool,
    /// True if the value is a list of names separated by commas.
    pub is_list: bool,
    /// True if the value may begin with a minus sign.
    pub is_signed: bool,
    /// Purpose of the option in one sentence, for help.
    pub help: &'static str,
    /// Details that follow the purpose in the long help; empty if there are none.
    pub more: &'static str,
    /// Group of options, by task, under which help lists the option.
    pub group: Group,
    /// Users for whom the option is meant.
    pub audience: Audience,
    /// Commands that have the option.
    pub commands: Commands,
    /// Python functions with this keyword (`open`, `render` and the like count as [`Commands::RENDER`]).
    pub keyword: Commands,
    /// Type in Python's stubs, such as `float`. If empty, the type is derived: `bool` for switches, a `Literal` for
    /// names, otherwise `str`.
    pub python: &'static str,
    /// Separator with which the values of a Python sequence are joined to form the option's text.
    pub separator: &'static str,
    /// True if the option is part of [`crate::request::RenderOptions`], the options of an image.
    pub is_image: bool,
    /// True if an image's metadata store the value in addition to the scene, so that `surfel again` can restore it.
    pub is_drawn: bool,
    /// Key in a scene file, such as `settings.cutoff` or `convert.crop`; `None` if scene files don't store the option.
    pub scene: Option<&'static str>,
    /// Valid value other than the default, for tests and the documentation. Empty for switches, and if one of the names
    /// serves.
    pub example: &'static str,
    /// Options that can't be given together with this one.
    pub conflicts: &'static [&'static str],
    /// Options that must be given together with this one.
    pub requires: &'static [&'static str],
    /// True if the option must be given, except together with one of [`Self::unless`].
    pub is_required: bool,
    /// Options whose presence makes a required option unnecessary.
    pub unless: &'static [&'static str],
    /// Names that other programs use for similar options; suggestions for unknown names use them.
    pub synonyms: &'static [&'static str],
    /// True if the Cargo feature that the option needs is enabled.
    pub is_built: bool,
}

impl Row {
    const fn new(name: &'static str, value: &'static str, set: Setter) -> Self {
        Self {
            name,
            short: None,
            value,
            set,
            default: None,
            missing: None,
            names: None,
            is_open: false,
            is_repeated: false,
            is_list: false,
            is_signed: false,
            help: "",
            more: "",
            group: Group::Output,
            audience: Audience::All,
            commands: Commands::RENDER,
            keyword: Commands::NONE,
            python: "",
            separator: ",",
            is_image: false,
            is_drawn: false,
            scene: None,
            example: "",
            conflicts: &[],
            requires: &[],
            is_required: false,
            unless: &[],
            synonyms: &[],
            is_built: true,
        }
    }

    /// Creates an option whose value is text.
    pub const fn text(
        name: &'static str,
        value: &'static str,
        set: fn(&mut Options, &str) -> Result<(), String>,
    ) -> Self {
        Self::new(name, value, Setter::Text(set))
    }

    /// Creates an option whose value is a path.
    pub const fn path(
        name: &'static str,
        value: &'static str,
        set: fn(&mut Options, PathBuf) -> Result<(), String>,
    ) -> Self {
        Self::new(name, value, Setter::Path(set))
    }

    /// Creates a switch.
    pub const fn switch(name: &'static str, set: fn(&mut Options, bool)) -> Self {
        Self::new(name, "", Setter::Switch(set))
    }

    /// Sets the purpose and its details.
    #[must_use]
    pub const fn help(self, help: &'static str, more: &'static str) -> Self {
        Self { help, more, ..self }
    }

    /// Sets the group under which help lists the option, and the commands that have the option.
    #[must_use]
    pub const fn of(self, group: Group, commands: Commands) -> Self {
        Self { group, commands, ..self }
    }

    /// Marks the option as part of [`crate::request::RenderOptions`], and as a keyword of its commands' Python
    /// functions.
    #[must_use]
    pub const fn image(self) -> Self {
        let functions = Commands::RENDER.and(Commands::CONVERT).and(Commands::ORTHO).and(Commands::FIGURE);
        Self { is_image: true, keyword: self.commands.common(functions), ..self }
    }

    /// Lists the option in `-h`.
    #[must_use]
    pub const fn everyday(self) -> Self {
        Self { audience: Audience::Everyday, ..self }
    }

    /// Lists the option last in `--help`.
    #[must_use]
    pub const fn expert(self) -> Self {
        Self { audience: Audience::Expert, ..self }
    }

    /// Restricts the value to the given names.
    #[must_use]
    pub const fn names(self, names: fn() -> Vec<&'static str>) -> Self {
        Self { names: Some(names), ..self }
    }

    /// Sets names that are valid values, in addition to values of another form.
    #[must_use]
    pub const fn names_or_other(self, names: fn() -> Vec<&'static str>) -> Self {
        Self { names: Some(names), is_open: true, ..self }
    }

    /// Allows values that begin with a minus sign.
    #[must_use]
    pub const fn signed(self) -> Self {
        Self { is_signed: true, ..self }
    }

    /// Sets the type in Python's stubs.
    #[must_use]
    pub const fn python(self, python: &'static str) -> Self {
        Self { python, ..self }
    }

    /// Sets the Python functions with this keyword.
    #[must_use]
    pub const fn keyword(self, keyword: Commands) -> Self {
        Self { keyword, ..self }
    }

    /// Sets the key in a scene file.
    #[must_use]
    pub const fn scene(self, key: &'static str) -> Self {
        Self { scene: Some(key), ..self }
    }

    /// Sets a valid value other than the default.
    #[must_use]
    pub const fn example(self, example: &'static str) -> Self {
        Self { example, ..self }
    }

    /// Sets names of similar meaning in other programs.
    #[must_use]
    pub const fn synonyms(self, synonyms: &'static [&'static str]) -> Self {
        Self { synonyms, ..self }
    }

    /// Sets the options that conflict with this one.
    #[must_use]
    pub const fn conflicts(self, conflicts: &'static [&'static str]) -> Self {
        Self { conflicts, ..self }
    }

    /// Sets the options that must be given together with this one.
    #[must_use]
    pub const fn requires(self, requires: &'static [&'static str]) -> Self {
        Self { requires, ..self }
    }

    /// Sets the letter of the short form.
    #[must_use]
    pub const fn letter(self, letter: char) -> Self {
        Self { short: Some(letter), ..self }
    }

    /// Sets the default value.
    #[must_use]
    pub const fn default_value(self, value: &'static str) -> Self {
        Self { default: Some(value), ..self }
    }

    /// Sets the value that is used if the option is given without one.
    #[must_use]
    pub const fn missing(self, value: &'static str) -> Self {
        Self { missing: Some(value), ..self }
    }

    /// Allows the option to be given several times.
    #[must_use]
    pub const fn repeated(self) -> Self {
        Self { is_repeated: true, ..self }
    }

    /// Makes the value a list of names separated by commas.
    #[must_use]
    pub const fn list(self) -> Self {
        Self { is_list: true, ..self }
    }

    /// Stores the value in an image's metadata, in addition to the scene.
    #[must_use]
    pub const fn drawn(self) -> Self {
        Self { is_drawn: true, ..self }
    }

    /// Makes the option required, except together with one of the options in `unless`.
    #[must_use]
    pub const fn required(self, unless: &'static [&'static str]) -> Self {
        Self { is_required: true, unless, ..self }
    }

    /// Sets the separator with which a Python sequence's values are joined.
    #[must_use]
    pub const fn separator(self, separator: &'static str) -> Self {
        Self { separator, ..self }
    }

    /// Hides the option from help if `is_built` is false, because its Cargo feature is disabled.
    #[must_use]
    pub const fn built(self, is_built: bool) -> Self {
        Self { is_built, ..self }
    }

    /// Returns the option's key in the `convert` object of a scene file, if it has one.
    pub fn convert_key(&self) -> Option<&'static str> {
        self.scene.and_then(|key| key.strip_prefix("convert."))
    }

    /// Returns the kinds of files that the option affects; all kinds unless the option has a key in `convert`.
    pub fn inputs(&self) -> Inputs {
        self.convert_key().and_then(effects::of).map_or(Inputs::ALL, |effect| effect.inputs)
    }

    /// True if `value` is one of the option's names.
    pub fn has_name(&self, value: &str) -> bool {
        self.names.is_some_and(|names| names().contains(&value))
    }

    /// True if the option is a switch, without a value.
    pub fn is_switch(&self) -> bool {
        matches!(self.set, Setter::Switch(_))
    }

    /// Returns the purpose followed by the details.
    pub fn full_help(&self) -> String {
        if self.more.is_empty() { self.help.to_owned() } else { format!("{} {}", self.help, self.more) }
    }

    /// Returns a valid value other than the default; `on` for a switch.
    pub fn sample(&self) -> String {
        match (self.names, self.example) {
            _ if self.is_switch() => "on".to_owned(),
            (Some(names), "") => names().last().copied().unwrap_or_default().to_owned(),
            (_, example) => example.to_owned(),
        }
    }

    /// Returns the flag with its value as help shows it, such as `--size <WxH>`.
    pub fn usage(&self) -> String {
        match (self.value, self.missing) {
            ("", _) => format!("--{}", self.name),
            (value, Some(_)) => format!("--{}[=<{value}>]", self.name),
            (value, None) => format!("--{} <{value}>", self.name),
        }
    }

    /// Parses a value and stores it in `options`.
    ///
    /// # Errors
    /// A description of the expected value.
    pub fn set(&self, options: &mut Options, value: &OsStr) -> Result<(), String> {
        let text = || value.to_str().ok_or_else(|| "expected text in UTF-8".to_owned());
        match self.set {
            Setter::Switch(set) => switch(text()?).map(|on| set(options, on)),
            Setter::Text(set) => set(options, text()?),
            Setter::Path(_) if value.is_empty() && self.missing != Some("") => Err("expected a file's name".to_owned()),
            Setter::Path(set) => set(options, value.into()),
        }
    }
}

/// Stores a parsed value in `slot`, or returns the parser's error.
pub(super) fn put<T>(slot: &mut Option<T>, value: Result<T, String>) -> Result<(), String> {
    *slot = Some(value?);
    Ok(())
}

/// Stores a path in `slot`.
pub(super) fn put_path(slot: &mut Option<PathBuf>, path: PathBuf) -> Result<(), String> {
    *slot = Some(path);
    Ok(())
}

/// Returns the names from a list of named values.
pub(super) fn names_of<T>(named: &[(&'static str, T)]) -> Vec<&'static str> {
    named.iter().map(|(name, _)| *name).collect()
}
