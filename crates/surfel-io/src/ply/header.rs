//! Parser of PLY headers: elements, properties and comments, without any data.

use super::encoding::PlyEncoding;
use super::names;
use crate::error::{Fault, Location, Problem, quote};
use std::collections::HashSet;

/// Maximum length of a PLY header, in bytes, which also limits the number of properties.
pub(crate) const MAX_HEADER_BYTES: usize = 1 << 20;
/// Maximum length of a line of a PLY header, in bytes.
pub(crate) const MAX_LINE_BYTES: usize = 1 << 16;

/// A parsed PLY header.
#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) encoding: PlyEncoding,
    pub(crate) comments: Vec<String>,
    pub(crate) elements: Vec<ElementDef>,
    /// Byte offset of the data, after the header.
    pub(crate) body: usize,
}

/// An element of a PLY file, which is a table: its name, number of rows and properties.
#[derive(Debug)]
pub(crate) struct ElementDef {
    /// Name by which readers find the element: `vertex` or `face` if the file uses a synonym, else the name in the
    /// file.
    pub(crate) name: String,
    /// Name of the element in the file, for messages.
    pub(crate) in_file: String,
    /// Number of rows that the header states. Hostile files state too many, so allocations must not rely on this number
    /// alone.
    pub(crate) count: u64,
    pub(crate) properties: Vec<PropertyDef>,
}

impl ElementDef {
    /// True if all rows have the same length in a binary file, because the element has no lists.
    pub(crate) fn is_fixed(&self) -> bool {
        self.properties.iter().all(|p| matches!(p.kind, Kind::Scalar(_)))
    }
}

#[derive(Debug)]
pub(crate) struct PropertyDef {
    /// Name by which readers find the property: a canonical one such as `nx` if the file uses a synonym, else the name
    /// in the file.
    pub(crate) name: String,
    /// Name of the property in the file, for messages.
    pub(crate) in_file: String,
    pub(crate) kind: Kind,
}

impl PropertyDef {
    fn new(name: &str, kind: Kind) -> Self {
        Self { name: name.into(), in_file: name.into(), kind }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Scalar(ScalarType),
    List { count: ScalarType, item: ScalarType },
}

/// The eight scalar types of PLY.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl ScalarType {
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(crate) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// Parses the PLY header at the start of `bytes`.
pub(crate) fn parse(bytes: &[u8]) -> Result<Header, Fault> {
    let mut lines = HeaderLines::new(bytes)?;
    let (mut encoding, mut known) = (None, HashSet::new());
    let mut header = Header { encoding: PlyEncoding::Ascii, comments: Vec::new(), elements: Vec::new(), body: 0 };
    loop {
        let (number, raw) = lines.next_line()?;
        let at = Location::Line(number);
        let first = raw.split(u8::is_ascii_whitespace).find(|w| !w.is_empty()).unwrap_or(b"");
        // Comments may contain any bytes, so they are handled before the line must be UTF-8.
        if first == b"comment" || first == b"obj_info" {
            if first == b"comment" {
                let text = String::from_utf8_lossy(raw);
                let text = text.trim_start().strip_prefix("comment").unwrap_or_default();
                let text = text.strip_prefix([' ', '\t']).unwrap_or(text).trim_end();
                header.comments.push(text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect());
            }
            continue;
        }
        let Ok(line) = std::str::from_utf8(raw) else {
            let problem = Problem::new(format!("the PLY header has a line that is not text: {}", quote(raw)));
            return Err(problem.at(at).expected("a keyword such as 'property float x'").into());
        };
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            // Blender 2.4 writes its name without the word comment.
            [] | ["Created", "by", ..] => {}
            ["end_header"] => break,
            ["format", name, version] => encoding = Some(parse_format(name, version).map_err(|p| p.at(at))?),
            ["element", name, count] => {
                if !known.insert(name.to_owned()) {
                    return Err(Problem::new(format!("the PLY element {} is declared twice", quote(name)))
                        .at(at)
                        .into());
                }
                let count = count.parse().map_err(|_| {
                    let what = format!("the number of {} elements is {}", quote(name), quote(count));
                    Problem::new(what).at(at).expected("a whole number, at least 0")
                })?;
                header.elements.push(ElementDef {
                    name: name.into(),
                    in_file: name.into(),
                    count,
                    properties: Vec::new(),
                });
            }
            ["property", ref rest @ ..] => {
                let property = parse_property(rest).map_err(|p| p.at(at))?;
                let Some(element) = header.elements.last_mut() else {
                    let what = format!("the property {} comes before any element", quote(&property.name));
                    return Err(Problem::new(what).at(at).expected("a line such as 'element vertex 100' first").into());
                };
                element.properties.push(property);
            }
            _ => {
                let problem = Problem::new(format!("the PLY header has an unknown line {}", quote(line))).at(at);
                return Err(problem
                    .expected("format, comment, element NAME COUNT, property TYPE NAME, end_header")
                    .into());
            }
        }
    }
    header.encoding = encoding.ok_or_else(|| {
        Problem::new("the PLY header has no format line")
            .expected("'format ascii 1.0', 'format binary_little_endian 1.0' or 'format binary_big_endian 1.0'")
    })?;
    for element in &header.elements {
        let mut names: Vec<&str> = element.properties.iter().map(|p| p.name.as_str()).collect();
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|w| w[0] == w[1]) {
            let what = format!("the element {} has two properties named {}", quote(&element.name), quote(pair[0]));
            return Err(Problem::new(what).expected("a different name for each").into());
        }
    }
    names::make_canonical(&mut header.elements);
    header.body = lines.position;
    Ok(header)
}

fn parse_format(name: &str, version: &str) -> Result<PlyEncoding, Problem> {
    let encoding = match name {
        "ascii" => PlyEncoding::Ascii,
        "binary_little_endian" => PlyEncoding::BinaryLittleEndian,
        "binary_big_endian" => PlyEncoding::BinaryBigEndian,
        _ => {
            return Err(Problem::new(format!("the PLY format is {}", quote(name)))
                .expected("ascii, binary_little_endian or binary_big_endian"));
        }
    };
    match version {
        "1.0" => Ok(encoding),
        _ => Err(Problem::new(format!("the PLY version is {}", quote(version))).expected("1.0")),
    }
}

fn parse_property(words: &[&str]) -> Result<PropertyDef, Problem> {
    let types = "char uchar short ushort int uint float double (or int8 … float64)";
    let scalar = |word: &str| {
        ScalarType::parse(word).ok_or_else(|| Problem::new(format!("unknown type {}", quote(word))).expected(types))
    };
    match words {
        ["list", count, item, name] => {
            let count = scalar(count)?;
            if !count.is_integer() {
                return Err(Problem::new(format!("the list {} is counted by a float", quote(name)))
                    .expected("an integer type, such as uchar"));
            }
            Ok(PropertyDef::new(name, Kind::List { count, item: scalar(item)? }))
        }
        [kind, name] => Ok(PropertyDef::new(name, Kind::Scalar(scalar(kind)?))),
        _ => Err(Problem::new(format!("the property line has {} words", words.len() + 1))
            .expected("'property TYPE NAME' or 'property list TYPE TYPE NAME'")),
    }
}

/// Reader of header lines, whose line ending is that of the first line: LF, CRLF or CR. The data after the header can
/// begin with any byte, so the ending can't be guessed line by line.
struct HeaderLines<'a> {
    bytes: &'a [u8],
    end: u8,
    position: usize,
    number: usize,
}

impl<'a> HeaderLines<'a> {
    fn new(bytes: &'a [u8]) -> Result<Self, Fault> {
        // Some programs write blanks after 'ply'.
        let rest = bytes.strip_prefix(b"ply").unwrap_or_default();
        let blanks = rest.iter().take_while(|&&byte| byte == b' ').count();
        let (end, position) = match &rest[blanks..] {
            [b'\r', b'\n', ..] => (b'\n', blanks + 5),
            [b'\n', ..] => (b'\n', blanks + 4),
            [b'\r', ..] => (b'\r', blanks + 4),
            _ => {
                let found = quote(&bytes[..bytes.len().min(12)]);
                let problem = Problem::new(format!("is not a PLY file: it starts with {found}"));
                return Err(problem.expected("a first line 'ply'").at(Location::Byte(0)).into());
            }
        };
        Ok(Self { bytes, end, position, number: 1 })
    }

    fn next_line(&mut self) -> Result<(usize, &'a [u8]), Fault> {
        self.number += 1;
        let rest = &self.bytes[self.position..];
        let window = &rest[..rest.len().min(MAX_LINE_BYTES)];
        let Some(length) = window.iter().position(|&b| b == self.end).filter(|_| self.position < MAX_HEADER_BYTES)
        else {
            let what = if self.position >= MAX_HEADER_BYTES {
                format!("the PLY header is longer than {MAX_HEADER_BYTES} bytes")
            } else if window.len() == MAX_LINE_BYTES {
                format!("a line of the PLY header is longer than {MAX_LINE_BYTES} bytes")
            } else {
                "the PLY header does not end".into()
            };
            return Err(Problem::new(what).at(Location::Line(self.number)).expected("a line 'end_header'").into());
        };
        self.position += length + 1;
        Ok((self.number, rest[..length].strip_suffix(b"\r").unwrap_or(&rest[..length])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(bytes: &[u8]) -> String {
        match parse(bytes) {
            Err(Fault::Problem(p)) => p.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn header_line_endings_of_all_three_kinds() {
        for end in ["\n", "\r\n", "\r"] {
            let text = "ply\nformat ascii 1.0\ncomment  a b \nelement vertex 2\nproperty float x\nend_header\n1 2";
            for blanks in ["", " ", "   "] {
                let bytes = text.replacen('\n', &format!("{blanks}\n"), 1).replace('\n', end);
                let header = parse(bytes.as_bytes()).unwrap();
                assert_eq!(&bytes[header.body..], "1 2");
                assert_eq!(header.comments, [" a b"]);
                assert_eq!(header.elements[0].count, 2);
            }
        }
    }

    fn named(element: &str, names: &[&str]) -> Vec<String> {
        let properties: String = names.iter().map(|name| format!("property uchar {name}\n")).collect();
        let text = format!("ply\nformat ascii 1.0\nelement {element} 2\n{properties}end_header\n");
        let header = parse(text.as_bytes()).unwrap();
        assert!(header.elements[0].properties.iter().zip(names).all(|(p, name)| p.in_file == *name));
        header.elements[0].properties.iter().map(|p| p.name.clone()).collect()
    }

    #[test]
    fn other_names_of_properties_are_those_of_the_profile_where_it_lacks_them() {
        let named = |names: &[&str]| named("vertex", names);
        let diffuse = ["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_x"];
        assert_eq!(named(&diffuse), ["red", "green", "blue", "diffuse_x"]);
        assert_eq!(named(&diffuse[1..]), diffuse[1..]);
        let both = ["red", "diffuse_red", "diffuse_green", "diffuse_blue"];
        assert_eq!(named(&both), both);
        let short = ["x", "y", "z", "r", "g", "b", "a", "label"];
        assert_eq!(named(&short), ["x", "y", "z", "red", "green", "blue", "alpha", "label"]);
        let large = ["X", "Y", "Z", "NX", "NY", "NZ", "Red", "Green", "Blue", "Alpha", "Radius"];
        let small = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha", "radius"];
        assert_eq!(named(&large), small);
        for normal in
            [["normal_x", "normal_y", "normal_z"], ["normalx", "normaly", "normalz"], ["NormalX", "NormalY", "NormalZ"]]
        {
            assert_eq!(named(&normal), ["nx", "ny", "nz"]);
        }
        // These names stay unchanged: an alpha without colours, an incomplete set, properties of Gaussians, and
        // degrees.
        for others in [vec!["a", "b"], vec!["nx", "normal_x"], vec!["scale_0", "rot_0"], vec!["lon", "lat", "z"]] {
            assert_eq!(named(&others), others);
        }
    }

    #[test]
    fn other_names_of_elements_are_vertex_and_face() {
        for (element, expected) in [
            ("point", "vertex"),
            ("Points", "vertex"),
            ("VERTEX", "vertex"),
            ("vertices", "vertex"),
            ("faces", "face"),
            ("edge", "edge"),
        ] {
            let text = format!("ply\nformat ascii 1.0\nelement {element} 2\nproperty int x\nend_header\n");
            let header = parse(text.as_bytes()).unwrap();
            assert_eq!((header.elements[0].name.as_str(), header.elements[0].in_file.as_str()), (expected, element));
        }
        let text = "ply\nformat ascii 1.0\nelement point 2\nproperty int x\nelement vertex 2\nend_header\n";
        let names: Vec<String> = parse(text.as_bytes()).unwrap().elements.into_iter().map(|e| e.name).collect();
        assert_eq!(names, ["point", "vertex"]);
    }

    #[test]
    fn blender_names_itself_without_the_word_comment() {
        let header = parse(b"ply\nformat ascii 1.0\nCreated by Blender3D 247\nelement vertex 2\nend_header\n").unwrap();
        assert_eq!(header.elements[0].count, 2);
    }

    #[test]
    fn header_faults_name_the_line_and_what_was_expected() {
        for (text, expected) in [
            ("nope", "it starts with 'nope'"),
            ("ply\nformat ascii 1.0\n", "does not end (line 3)"),
            ("ply\nformat ascii 2.0\nend_header\n", "the PLY version is '2.0' (line 2)"),
            ("ply\nend_header\n", "no format line"),
            ("ply\nformat ascii 1.0\nproperty float x\n", "'x' comes before any element (line 3)"),
            ("ply\nformat ascii 1.0\nelement vertex -1\n", "'vertex' elements is '-1' (line 3)"),
            ("ply\nformat ascii 1.0\nelement v 1\nproperty quad x\n", "unknown type 'quad' (line 4)"),
            ("ply\nformat ascii 1.0\nelement v 1\nproperty list float int x\n", "counted by a float"),
            (
                "ply\nformat ascii 1.0\nelement v 1\nproperty int x\nproperty int x\nend_header\n",
                "two properties named 'x'",
            ),
            ("ply\nformat ascii 1.0\nelement v 1\nelement v 1\n", "declared twice"),
            ("ply\nhello\n", "unknown line 'hello' (line 2)"),
        ] {
            let found = message(text.as_bytes());
            assert!(found.contains(expected), "{text:?}: {found}");
        }
        assert!(message(b"ply\nformat \xff 1.0\n").contains("not text"));
        assert!(message(format!("ply\n{}", "a".repeat(100_000)).as_bytes()).contains("longer than 65536"));
        assert!(message(format!("ply\n{}", "comment a\n".repeat(200_000)).as_bytes()).contains("longer than 1048576"));
    }

    #[test]
    fn comment_of_any_bytes_is_kept() {
        let header = parse(b"ply\ncomment caf\xe9\nformat ascii 1.0\nend_header\n").unwrap();
        assert_eq!(header.comments, ["caf\u{fffd}"]);
    }
}
