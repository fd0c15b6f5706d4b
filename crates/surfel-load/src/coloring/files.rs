//! Files that users supply for colouring: colour maps, and names of categories.

use super::short;
use std::path::Path;
use std::sync::Arc;
use surfel_io::IoError;
use surfel_model::Color;

/// Largest accepted size, in bytes, of a file with a colour map or with names of categories.
const MAX_BYTES: u64 = 1 << 20;
/// Number of evenly spaced colours of a colour map from a file, after interpolation between the file's colours.
const LEVELS: usize = 256;

/// Colour map that was read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct FileColors {
    /// Name of the file, for display.
    pub name: String,
    /// Colours as 8-bit sRGB levels, for values from the minimum to the maximum.
    pub levels: Vec<[u8; 3]>,
}

/// Names and colours of categories, read from a file that the user supplies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labels {
    /// Value, name and optional colour (8-bit sRGB levels) of each category, in ascending order of values.
    entries: Vec<(f64, Arc<str>, Option<[u8; 3]>)>,
}

/// Returns the lines of a text file with their numbers, without empty lines.
fn lines(path: &Path) -> Result<Vec<(usize, String)>, IoError> {
    let bytes = surfel_io::input::read(path, MAX_BYTES)?;
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim().to_owned()));
    Ok(numbered.filter(|(_, line)| !line.is_empty()).collect())
}

fn wrong(path: &Path, line: usize, found: &str, expected: &str) -> crate::Error {
    let found: String = found.escape_debug().take(60).collect();
    let problem = format!("line {line}: found '{found}', expected {expected}");
    crate::Error::Unsuitable { path: path.to_path_buf(), problem }
}

/// Splits a line at spaces, tabs, commas and semicolons.
fn words(line: &str) -> Vec<&str> {
    line.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty()).collect()
}

impl FileColors {
    /// Reads a colour map. Each line has one colour: `#rrggbb`, a CSS name, or three numbers r g b. The numbers are
    /// from 0 to 255, or from 0 to 1 if no number of the file is larger. Lines that begin with `#` and aren't colours
    /// are comments.
    ///
    /// # Errors
    /// [`crate::Error::Io`] for a file that can't be read, [`crate::Error::Unsuitable`] for other lines and fewer than
    /// two colours.
    pub(crate) fn read(path: &Path) -> Result<Self, crate::Error> {
        let expected = "a colour: #rrggbb, a name of CSS, or three numbers r g b from 0 to 255 or from 0 to 1";
        let mut colors: Vec<[f64; 3]> = Vec::new();
        let mut numbers: Vec<usize> = Vec::new();
        for (number, line) in lines(path)? {
            if let Ok(Color(levels)) = line.parse() {
                colors.push(levels.map(f64::from));
                continue;
            }
            if line.starts_with('#') {
                continue;
            }
            let parts: Option<Vec<f64>> = words(&line).iter().map(|word| word.parse().ok()).collect();
            let is_level = |value: &f64| (0.0..=255.0).contains(value);
            match parts.as_deref() {
                Some([r, g, b]) if [r, g, b].into_iter().all(is_level) => {
                    numbers.push(colors.len());
                    colors.push([*r, *g, *b]);
                }
                _ => return Err(wrong(path, number, &line, expected)),
            }
        }
        if numbers.iter().all(|i| colors[*i].iter().all(|value| *value <= 1.0)) {
            numbers.iter().for_each(|i| colors[*i] = colors[*i].map(|value| value * 255.0));
        }
        if colors.len() < 2 {
            let problem = format!("has {} colours, expected at least two lines, each with {expected}", colors.len());
            return Err(crate::Error::Unsuitable { path: path.to_path_buf(), problem });
        }
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(Self { name, levels: interpolated(&colors) })
    }
}

/// Returns [`LEVELS`] colours at even intervals from the first to the last of `colors`, by linear interpolation.
fn interpolated(colors: &[[f64; 3]]) -> Vec<[u8; 3]> {
    let last = colors.len() - 1;
    let at = |i: usize| {
        let place = i as f64 / (LEVELS - 1) as f64 * last as f64;
        let (before, share) = ((place.floor() as usize).min(last - 1), place);
        let share = share - before as f64;
        [0, 1, 2].map(|k| (colors[before][k] * (1.0 - share) + colors[before + 1][k] * share).round() as u8)
    };
    (0..LEVELS).map(at).collect()
}

impl Labels {
    /// Reads names of categories, one per line: `VALUE NAME` or `VALUE NAME COLOUR`, with a colour as `#rrggbb`. A
    /// comma, a semicolon, a colon or an equals sign may also separate value and name. Lines that begin with `#` are
    /// comments.
    ///
    /// # Errors
    /// [`crate::Error::Io`] for a file that can't be read, [`crate::Error::Unsuitable`] for lines of another form, a
    /// value that occurs twice, and a file without categories.
    pub(crate) fn read(path: &Path) -> Result<Self, crate::Error> {
        let expected = "VALUE NAME or VALUE NAME #rrggbb, such as 2 ground #aa7733";
        let separators = [' ', '\t', ',', ';', ':', '='];
        let mut entries: Vec<(f64, Arc<str>, Option<[u8; 3]>)> = Vec::new();
        for (number, line) in lines(path)?.into_iter().filter(|(_, line)| !line.starts_with('#')) {
            let parts = line.split_once(separators);
            let parts = parts.and_then(|(value, rest)| Some((value.parse::<f64>().ok()?, rest)));
            let Some((value, rest)) = parts.filter(|(value, _)| value.is_finite()) else {
                return Err(wrong(path, number, &line, expected));
            };
            let rest = rest.trim_matches(separators);
            let (name, color) = match rest.rsplit_once('#') {
                Some((name, color)) => match format!("#{color}").parse::<Color>() {
                    Ok(Color(levels)) => (name.trim_matches(separators), Some(levels)),
                    Err(_) => (rest, None),
                },
                None => (rest, None),
            };
            let name = name.trim_matches('"');
            if name.is_empty() {
                return Err(wrong(path, number, &line, expected));
            }
            // Adding zero turns −0 into 0.
            let value = value + 0.0;
            match entries.binary_search_by(|(known, ..)| known.total_cmp(&value)) {
                Ok(_) => {
                    let problem = format!("line {number}: names {} twice, expected one line per value", short(value));
                    return Err(crate::Error::Unsuitable { path: path.to_path_buf(), problem });
                }
                Err(at) => entries.insert(at, (value, name.into(), color)),
            }
        }
        if entries.is_empty() {
            let problem = format!("names no category, expected lines {expected}");
            return Err(crate::Error::Unsuitable { path: path.to_path_buf(), problem });
        }
        Ok(Self { entries })
    }

    /// Returns the name and the colour of the category with this value; `None` if the file doesn't have the category.
    pub(crate) fn of(&self, value: f64) -> Option<(Arc<str>, Option<[u8; 3]>)> {
        let at = self.entries.binary_search_by(|(known, ..)| known.total_cmp(&value)).ok()?;
        self.entries.get(at).map(|(_, name, color)| (name.clone(), *color))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with<T>(text: &str, read: impl FnOnce(&Path) -> T) -> T {
        use std::sync::atomic::{AtomicU32, Ordering};
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("surfel-colors-{}-{number}.txt", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let result = read(&path);
        std::fs::remove_file(&path).unwrap();
        result
    }

    #[test]
    fn colour_maps_of_files_are_interpolated() {
        let of = |text: &str| with(text, FileColors::read).map(|map| map.levels).map_err(|e| e.to_string());
        let bytes = of("# a comment line\n0 0 0\n255, 128, 0\n").unwrap();
        assert_eq!((bytes.len(), bytes[0], bytes[255]), (256, [0; 3], [255, 128, 0]));
        assert_eq!(bytes[51], [51, 26, 0], "a fifth of the way");
        assert_eq!(of("0 0 0\n1.0 0.5 0\n").unwrap()[255], [255, 128, 0]);
        assert_eq!(of("#000000\nwhite\n#f00").unwrap()[127..129], [[254, 254, 254], [255, 254, 254]]);
        for (text, problem) in
            [("", "has 0 colours"), ("red", "has 1 colours"), ("red\n1 2", "line 2"), ("red\n0 0 256", "line 2")]
        {
            assert!(of(text).unwrap_err().contains(problem), "{text}");
        }
    }

    #[test]
    fn labels_have_values_names_and_colours() {
        let labels = with("# classes\n2 bare ground #aa7733\n6,building\n-1: \"not known\"\n9=C# code\n", Labels::read);
        let labels = labels.unwrap();
        let of = |value: f64| labels.of(value).map(|(name, color)| (name.to_string(), color));
        assert_eq!(of(2.0), Some(("bare ground".to_owned(), Some([0xaa, 0x77, 0x33]))));
        assert_eq!((of(6.0), of(-1.0)), (Some(("building".into(), None)), Some(("not known".into(), None))));
        assert_eq!((of(9.0), of(3.0)), (Some(("C# code".into(), None)), None));
        for (text, problem) in
            [("", "names no"), ("2", "line 1"), ("a b", "line 1"), ("2 a\n2.0 b", "twice"), ("2 #fff", "line 1")]
        {
            let error = with(text, Labels::read).unwrap_err().to_string();
            assert!(error.contains(problem), "{text}: {error}");
        }
    }
}
