//! Names, and optionally types, of the columns of a table of points: the value of `--columns`.

use crate::ModelError;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Largest accepted number of columns of a table.
const MAX_COLUMNS: usize = 128;

/// Type of a column's numbers in a file without a header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NumberFormat {
    /// Kind of number: `f` for floating-point numbers, `i` and `u` for whole numbers with and without a sign.
    pub letter: char,
    /// Size of a number in bytes: 1, 2, 4 or 8, and at least 2 for `f`.
    pub bytes: u8,
    /// True if the most significant byte comes first.
    pub big_endian: bool,
}

impl FromStr for NumberFormat {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let (big_endian, text) = match text.as_bytes().first() {
            Some(b'>') => (true, &text[1..]),
            Some(b'<') => (false, &text[1..]),
            _ => (false, text),
        };
        let [letter, size] = text.as_bytes() else { return Err(()) };
        let bytes = size.wrapping_sub(b'0');
        match (letter, bytes) {
            (b'f', 2 | 4 | 8) | (b'i' | b'u', 1 | 2 | 4 | 8) => {
                Ok(Self { letter: char::from(*letter), bytes, big_endian })
            }
            _ => Err(()),
        }
    }
}

impl fmt::Display for NumberFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}{}", if self.big_endian { ">" } else { "" }, self.letter, self.bytes)
    }
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TableColumn {
    /// Name of the column; `None` for a column that is skipped.
    pub name: Option<String>,
    /// Type of the column's numbers; `None` in tables whose files state the type.
    pub format: Option<NumberFormat>,
}

/// Columns of a table of points, in order: `x,y,z,_,r,g,b` (`_` skips a column), or with types `f4:x,y,z,intensity`. A
/// type applies until the next one.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "String", into = "String"))]
pub struct TableColumns(Vec<TableColumn>);

impl TableColumns {
    /// Returns the columns. At least three of them have names, and either all have a type or none.
    pub fn columns(&self) -> &[TableColumn] {
        &self.0
    }

    /// True if the columns have types, so that they describe a file without a header.
    pub fn is_typed(&self) -> bool {
        self.0.iter().all(|column| column.format.is_some())
    }

    /// Returns the size of a row in bytes; 0 for columns without types.
    pub fn row_bytes(&self) -> usize {
        self.0.iter().filter_map(|column| column.format).map(|format| usize::from(format.bytes)).sum()
    }
}

impl FromStr for TableColumns {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const EXPECTED: &str = "names such as x,y,z,_,r,g,b, or f4:x,y,z,intensity with types";
        let mut columns: Vec<TableColumn> = Vec::new();
        let mut format = None;
        for (i, word) in text.split(',').enumerate() {
            let mut name = word.trim();
            if let Some((before, after)) = name.split_once(':')
                && let Ok(found) = before.trim().parse::<NumberFormat>()
            {
                if i > 0 && format.is_none() {
                    return Err(format!("has a type from column {} on: expected it before the first column", i + 1));
                }
                (format, name) = (Some(found), after.trim());
            } else if let Some((before, _)) = name.split_once(':')
                && format.is_some() | (before.len() <= 3)
            {
                let types = "f2, f4, f8, i1, i2, i4, i8, u1, u2, u4 or u8, after > if big-endian";
                return Err(format!("has the type '{}', expected {types}", before.escape_debug()));
            }
            if name.is_empty() {
                return Err(format!("has no name for column {}, expected {EXPECTED}; _ leaves a column out", i + 1));
            }
            let name = (name != "_").then(|| name.to_owned());
            if name.is_some() && columns.iter().any(|other| other.name == name) {
                return Err(format!("names two columns {}", name.unwrap_or_default().escape_debug()));
            }
            columns.push(TableColumn { name, format });
        }
        if columns.len() > MAX_COLUMNS {
            return Err(format!("names {} columns, expected at most {MAX_COLUMNS}", columns.len()));
        }
        if columns.iter().filter(|column| column.name.is_some()).count() < 3 {
            return Err(format!("names too few columns, expected {EXPECTED}"));
        }
        Ok(Self(columns))
    }
}

impl fmt::Display for TableColumns {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut before = None;
        for (i, column) in self.0.iter().enumerate() {
            if i > 0 {
                f.write_str(",")?;
            }
            if let Some(format) = column.format.filter(|format| before != Some(*format)) {
                write!(f, "{format}:")?;
                before = Some(format);
            }
            f.write_str(column.name.as_deref().unwrap_or("_"))?;
        }
        Ok(())
    }
}

impl TryFrom<String> for TableColumns {
    type Error = ModelError;

    fn try_from(text: String) -> Result<Self, ModelError> {
        text.parse().map_err(|problem| ModelError::Conflict(format!("columns {problem}")))
    }
}

impl From<TableColumns> for String {
    fn from(columns: TableColumns) -> Self {
        columns.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_hold_until_the_next_and_text_is_written_as_it_was_read() {
        for (text, bytes, again) in [
            ("x,y,z,_,r,g,b", 0, "x,y,z,_,r,g,b"),
            ("f4:x,y,z,intensity", 16, "f4:x,y,z,intensity"),
            ("f4:x,y,z,u1:r,g,b,_", 16, "f4:x,y,z,u1:r,g,b,_"),
            (" <f8: x, f8:y ,z , >u2:_", 26, "f8:x,y,z,>u2:_"),
            ("x,y,z,Points:0", 0, "x,y,z,Points:0"),
        ] {
            let columns: TableColumns = text.parse().unwrap();
            assert_eq!((columns.is_typed(), columns.row_bytes()), (bytes > 0, bytes), "{text}");
            assert_eq!(columns.to_string(), again);
            assert_eq!(again.parse::<TableColumns>().unwrap(), columns);
        }
    }

    #[test]
    fn wrong_columns_are_errors_that_say_what_is_expected() {
        for (text, says) in [
            ("", "no name for column 1"),
            ("x,y", "too few columns"),
            ("x,_,_,_", "too few columns"),
            ("x,,z", "no name for column 2"),
            ("x,y,z,x", "two columns x"),
            ("x,f4:y,z", "before the first column"),
            ("f3:x,y,z", "the type 'f3'"),
            ("f4:x,y,i9:z", "the type 'i9'"),
            ("f4:x,y,z,f4:", "no name for column 4"),
        ] {
            let problem = text.parse::<TableColumns>().unwrap_err();
            assert!(problem.contains(says), "{text}: {problem}");
        }
        let many = vec!["_"; 200].join(",") + ",x,y,z";
        assert!(many.parse::<TableColumns>().unwrap_err().contains("at most 128"));
    }
}
