//! Named and hexadecimal colours.

#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// An opaque colour as 8-bit sRGB levels. Written as `#rrggbb`; also parsed from `#rgb` and from CSS names such as
/// `orange`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "String", into = "String"))]
pub struct Color(pub [u8; 3]);

/// Supported colour names with their CSS values, as 0xrrggbb.
const NAMES: [(&str, u32); 36] = [
    ("black", 0x00_0000),
    ("white", 0xff_ffff),
    ("grey", 0x80_8080),
    ("gray", 0x80_8080),
    ("silver", 0xc0_c0c0),
    ("lightgrey", 0xd3_d3d3),
    ("lightgray", 0xd3_d3d3),
    ("darkgrey", 0xa9_a9a9),
    ("darkgray", 0xa9_a9a9),
    ("red", 0xff_0000),
    ("darkred", 0x8b_0000),
    ("crimson", 0xdc_143c),
    ("tomato", 0xff_6347),
    ("coral", 0xff_7f50),
    ("salmon", 0xfa_8072),
    ("orange", 0xff_a500),
    ("gold", 0xff_d700),
    ("yellow", 0xff_ff00),
    ("khaki", 0xf0_e68c),
    ("olive", 0x80_8000),
    ("green", 0x00_8000),
    ("lime", 0x00_ff00),
    ("darkgreen", 0x00_6400),
    ("teal", 0x00_8080),
    ("turquoise", 0x40_e0d0),
    ("cyan", 0x00_ffff),
    ("skyblue", 0x87_ceeb),
    ("steelblue", 0x46_82b4),
    ("royalblue", 0x41_69e1),
    ("blue", 0x00_00ff),
    ("navy", 0x00_0080),
    ("purple", 0x80_0080),
    ("magenta", 0xff_00ff),
    ("pink", 0xff_c0cb),
    ("tan", 0xd2_b48c),
    ("brown", 0xa5_2a2a),
];

impl Color {
    /// Returns the supported colour names.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMES.iter().map(|(name, _)| *name)
    }
}

impl FromStr for Color {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let named = NAMES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)).map(|(_, value)| *value);
        let hex = || {
            let digits = text.strip_prefix('#').filter(|digits| digits.chars().all(|c| c.is_ascii_hexdigit()))?;
            match digits.len() {
                3 => u32::from_str_radix(&digits.chars().flat_map(|c| [c, c]).collect::<String>(), 16).ok(),
                6 => u32::from_str_radix(digits, 16).ok(),
                _ => None,
            }
        };
        let value = named.or_else(hex);
        let value = value.ok_or("expected a colour: #rrggbb, #rgb, or a name of CSS such as white or steelblue")?;
        let [_, r, g, b] = value.to_be_bytes();
        Ok(Self([r, g, b]))
    }
}

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.0;
        write!(f, "#{r:02x}{g:02x}{b:02x}")
    }
}

impl TryFrom<String> for Color {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse().map_err(|problem| format!("color is \"{text}\", {problem}"))
    }
}

impl From<Color> for String {
    fn from(color: Color) -> Self {
        color.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_names_or_hexadecimal() {
        let of = |text: &str| text.parse::<Color>().map(|color| color.0);
        assert_eq!(of("#1f77b4"), Ok([0x1f, 0x77, 0xb4]));
        assert_eq!((of("#fff"), of("White"), of("#F80")), (Ok([255; 3]), Ok([255; 3]), Ok([255, 136, 0])));
        for wrong in ["", "#", "#12", "#12345", "#gggggg", "#+12345", "blueish", "1,2,3", "#é1"] {
            assert!(of(wrong).is_err(), "{wrong}");
        }
        let all: Vec<Color> = Color::names().map(|name| name.parse().unwrap()).collect();
        assert!(all.iter().all(|color| color.to_string().parse() == Ok(*color)));
    }
}
