//! What the formats of surveyors share: reading a file bit by bit, columns that cost nothing while they say nothing,
//! colours of 8 or 16 bits, and coordinate reference systems.

use crate::color::{exact_8_bit, linear_of_8_bit, linear_of_16_bit};
use std::io::{Read, Seek};
use surfel_model::{ExtraColumn, ExtraValues};

/// A file or bytes that are read here and there, so that the points are in memory and the file isn't.
pub(crate) trait Source: Read + Seek + Send + Sync {}

impl<T: Read + Seek + Send + Sync> Source for T {}

/// A type that extra columns hold.
pub(crate) trait Scalar: Copy + Default + PartialEq + Send + Sync {
    fn column(values: Vec<Self>) -> ExtraValues;
}

macro_rules! scalars {
    ($($t:ty => $variant:ident),*) => {
        $(impl Scalar for $t {
            fn column(values: Vec<Self>) -> ExtraValues {
                ExtraValues::$variant(values)
            }
        })*
    };
}

scalars!(i8 => I8, u8 => U8, i16 => I16, u16 => U16, i32 => I32, u32 => U32, f32 => F32, f64 => F64);

/// A column that takes no memory as long as all its values are zero.
#[derive(Debug, Default)]
pub(crate) struct SparseColumn<T> {
    zeros: usize,
    values: Vec<T>,
}

impl<T: Scalar> SparseColumn<T> {
    /// Appends `count` values; `expected` is how many there will be at least, for certain.
    pub(crate) fn append(&mut self, count: usize, expected: usize, values: impl Iterator<Item = T> + Clone) {
        if self.values.is_empty() {
            if values.clone().all(|v| v == T::default()) {
                self.zeros += count;
                return;
            }
            self.values.reserve_exact(expected.max(self.zeros + count));
            self.values.resize(self.zeros, T::default());
        }
        self.values.extend(values);
    }

    /// The column, unless all values are zero.
    pub(crate) fn finish(self, name: String) -> Option<ExtraColumn> {
        let mut values = self.values;
        values.shrink_to_fit();
        (!values.is_empty()).then(|| ExtraColumn { name, values: T::column(values) })
    }
}

/// sRGB-encoded colours that count to 65535, or, as many programs write them, to 255 only.
#[derive(Debug, Default)]
pub(crate) struct WideColors {
    linear: Vec<[f32; 3]>,
    /// A level above 255 has come.
    wide: bool,
    /// A level above 0 has come.
    any: bool,
}

impl WideColors {
    pub(crate) fn append(&mut self, expected: usize, levels: impl Iterator<Item = [u16; 3]> + Clone) {
        let largest = levels.clone().flatten().max().unwrap_or(0);
        self.any |= largest > 0;
        if largest > 255 && !self.wide {
            self.wide = true;
            let table = linear_of_16_bit();
            for c in self.linear.iter_mut().flatten() {
                *c = table[usize::from(exact_8_bit(*c).unwrap_or(0))];
            }
        }
        if self.linear.is_empty() {
            self.linear.reserve_exact(expected);
        }
        if self.wide {
            let table = linear_of_16_bit();
            self.linear.extend(levels.map(|rgb| rgb.map(|c| table[usize::from(c)])));
        } else {
            let table = linear_of_8_bit();
            self.linear.extend(levels.map(|rgb| rgb.map(|c| table[usize::from(c)])));
        }
    }

    /// The colours as linear RGB, unless all are black; and whether they count to 255 only.
    pub(crate) fn finish(self) -> Option<(Vec<[f32; 3]>, bool)> {
        self.any.then_some((self.linear, !self.wide))
    }
}

/// A coordinate reference system, as a file states it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Crs {
    /// OGC well-known text.
    pub(crate) wkt: Option<String>,
    /// An EPSG code, where the file states nothing else.
    pub(crate) code: Option<u32>,
    /// GeoTIFF: the key directory, then the doubles and texts that it refers to.
    pub(crate) geotiff: Option<(Vec<u16>, Vec<f64>, String)>,
}

impl Crs {
    /// Its EPSG code, where the text or the keys give one.
    pub(crate) fn epsg(&self) -> Option<u32> {
        let of_wkt = self.wkt.as_deref().and_then(epsg_of_wkt);
        of_wkt.or(self.code).or_else(|| {
            // A projected system wins over the geographic one that it is made of. 32767 stands for user-defined.
            let key = |key| self.key(key).filter(|code| !matches!(code, 0 | 32_767));
            key(3072).or_else(|| key(2048)).map(u32::from)
        })
    }

    /// The value of a GeoTIFF key that stands in the directory itself.
    fn key(&self, key: u16) -> Option<u16> {
        let (directory, ..) = self.geotiff.as_ref()?;
        directory.get(4..)?.chunks_exact(4).find(|e| e[0] == key && e[1] == 0).map(|e| e[3])
    }

    fn name(&self) -> Option<String> {
        if let Some(wkt) = &self.wkt {
            return wkt.split('"').nth(1).map(str::to_owned);
        }
        let (_, _, texts) = self.geotiff.as_ref()?;
        texts.split('|').map(str::trim).find(|text| !text.is_empty()).map(str::to_owned)
    }

    /// True of coordinates that are degrees.
    #[cfg(feature = "las")]
    pub(crate) fn is_geographic(&self) -> bool {
        let of_wkt = |wkt: &String| ["GEOGCS[", "GEOGCRS["].iter().any(|root| wkt.starts_with(root));
        self.wkt.as_ref().map_or_else(|| self.key(1024) == Some(2), of_wkt)
    }

    /// In a few words: "CRS 'NAD83 / UTM zone 10N' (EPSG:26910)", "no CRS".
    pub(crate) fn words(&self) -> String {
        let name = self.name().map(|name| crate::error::quote(name.as_bytes()));
        match (name, self.epsg()) {
            (Some(name), Some(code)) => format!("CRS {name} (EPSG:{code})"),
            (Some(name), None) => format!("CRS {name}"),
            (None, Some(code)) => format!("CRS EPSG:{code}"),
            (None, None) if self.geotiff.is_some() => "a CRS without a name".into(),
            (None, None) => "no CRS".into(),
        }
    }

    /// The comments that carry it, as docs/format.md says.
    pub(crate) fn comments(&self) -> Vec<String> {
        let join = |values: Vec<String>| values.join(" ");
        let mut comments = Vec::new();
        if let Some(code) = self.epsg() {
            comments.push(format!("crs EPSG:{code}"));
        }
        if let Some(wkt) = &self.wkt {
            comments.push(format!("crs_wkt {wkt}"));
        }
        if let Some((directory, doubles, texts)) = &self.geotiff {
            comments.push(format!("crs_geotiff_keys {}", join(directory.iter().map(u16::to_string).collect())));
            if !doubles.is_empty() {
                comments.push(format!("crs_geotiff_doubles {}", join(doubles.iter().map(f64::to_string).collect())));
            }
            if !texts.is_empty() {
                comments.push(format!("crs_geotiff_text {texts}"));
            }
        }
        comments
    }
}

/// A name without case, blanks and punctuation.
pub(crate) fn plain_name(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

/// What the three columns of a normal are called, in this form.
pub(crate) const NORMAL_NAMES: [&str; 3] = ["normalx", "normaly", "normalz"];

/// Normals out of columns that are named so. One that is zero everywhere isn't there.
#[cfg(feature = "las")]
pub(crate) fn take_normals(extras: &mut Vec<ExtraColumn>) -> Option<surfel_model::Column3> {
    let mut found: [Option<Vec<f32>>; 3] = [None, None, None];
    extras.retain_mut(|extra| match NORMAL_NAMES.iter().position(|name| plain_name(&extra.name) == *name) {
        Some(k) => {
            found[k] = Some(crate::columns::to_f32(std::mem::replace(&mut extra.values, ExtraValues::U8(Vec::new()))));
            false
        }
        None => true,
    });
    let count = found.iter().flatten().map(Vec::len).max()?;
    let at = |k: usize, i: usize| found[k].as_ref().and_then(|v: &Vec<f32>| v.get(i)).copied().unwrap_or(0.0);
    let vectors = (0..count).map(|i| glam::Vec3::new(at(0, i), at(1, i), at(2, i)));
    Some(surfel_model::Column3::from_f32(vectors.collect()))
}

/// Text on one line, without control characters and without blanks at its ends.
pub(crate) fn one_line(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    let text = String::from_utf8_lossy(&bytes[..end]);
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>().trim().to_owned()
}

/// What a compound system and its like are called in well-known text, in whose parts the system itself can be.
const COMPOUNDS: [&str; 4] = ["COMPD_CS", "COMPOUNDCRS", "BOUNDCRS", "SOURCECRS"];
/// What systems are called there.
const SYSTEMS: [&str; 8] =
    ["PROJCS", "PROJCRS", "PROJECTEDCRS", "GEOGCS", "GEOGCRS", "GEODCRS", "GEOCCS", "GEODETICCRS"];

/// The EPSG code of well-known text: `AUTHORITY["EPSG","26910"]` or `ID["EPSG",26910]` of the whole, else of the first
/// of its parts that is a horizontal system. Those of datums, units and base systems are others.
fn epsg_of_wkt(wkt: &str) -> Option<u32> {
    let (mut stack, mut best, mut quoted): (Vec<&str>, Option<(usize, u32)>, bool) = (Vec::new(), None, false);
    let is_one_of = |word: &str, names: &[&str]| names.iter().any(|name| word.eq_ignore_ascii_case(name));
    for (at, c) in wkt.char_indices() {
        match c {
            '"' => quoted = !quoted,
            _ if quoted => {}
            '[' | '(' => {
                let word = wkt[..at].rsplit(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap_or("");
                let parents = stack.split_last().is_some_and(|(parent, above)| {
                    let parent_fits = is_one_of(parent, &SYSTEMS) || is_one_of(parent, &COMPOUNDS);
                    parent_fits && above.iter().all(|word| is_one_of(word, &COMPOUNDS))
                });
                if parents && is_one_of(word, &["AUTHORITY", "ID"]) && best.is_none_or(|(d, _)| stack.len() < d) {
                    let rest = &wkt[at + 1..];
                    let end = rest.find([']', ')']).unwrap_or(rest.len());
                    let mut fields = rest[..end].split(',').map(|f| f.trim().trim_matches('"'));
                    let is_epsg = fields.next().is_some_and(|name| name.eq_ignore_ascii_case("EPSG"));
                    if let Some(code) = fields.next().and_then(|f| f.parse().ok()).filter(|_| is_epsg) {
                        best = Some((stack.len(), code));
                    }
                }
                // Real texts are some ten deep.
                if stack.len() > 64 {
                    return best.map(|(_, code)| code);
                }
                stack.push(word);
            }
            ']' | ')' => drop(stack.pop()),
            _ => {}
        }
    }
    best.map(|(_, code)| code)
}

/// An extent as "W x D x H", to four digits or whole units.
pub(crate) fn extent_words(extent: glam::DVec3) -> String {
    let one = |v: f64| {
        let digits = if v > 0.0 && v.is_finite() { (3 - v.log10().floor() as i32).clamp(0, 9) } else { 0 };
        format!("{v:.*}", digits as usize)
    };
    format!("{} x {} x {}", one(extent.x), one(extent.y), one(extent.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_of_well_known_text_is_the_outermost() {
        let wkt =
            r#"PROJCS["NAD83 / UTM zone 10N",GEOGCS["NAD83",AUTHORITY["EPSG","4269"]],AUTHORITY["EPSG","26910"]]"#;
        assert_eq!(epsg_of_wkt(wkt), Some(26_910));
        let compound = concat!(
            r#"COMPD_CS["a [b",PROJCS["p",GEOGCS["g",AUTHORITY["EPSG","1"]],"#,
            r#"AUTHORITY["EPSG","2"]],VERT_CS["v",AUTHORITY["EPSG","3"]]]"#
        );
        assert_eq!(epsg_of_wkt(compound), Some(2));
        let without = concat!(
            r#"PROJCS["p",GEOGCS["g",DATUM["d",AUTHORITY["EPSG","6326"]],"#,
            r#"AUTHORITY["EPSG","4326"]],UNIT["m",1,AUTHORITY["EPSG","9001"]]]"#
        );
        assert_eq!(epsg_of_wkt(without), None);
        assert_eq!(epsg_of_wkt(r#"PROJCRS["x",BASEGEOGCRS["y",ID["EPSG",4326]],ID["EPSG",32631]]"#), Some(32_631));
        assert_eq!(epsg_of_wkt(r#"LOCAL_CS["AUTHORITY[\"EPSG\",\"5\"]"]]]"#), None);
    }

    #[test]
    fn keys_name_the_projected_system() {
        let keys = vec![1, 1, 0, 3, 1024, 0, 1, 1, 2048, 0, 1, 4269, 3072, 0, 1, 26_915];
        let crs = Crs { code: None, wkt: None, geotiff: Some((keys, vec![], "NAD83 / UTM 15|".into())) };
        assert_eq!((crs.epsg(), crs.words().as_str()), (Some(26_915), "CRS 'NAD83 / UTM 15' (EPSG:26915)"));
        assert_eq!(Crs::default().words(), "no CRS");
    }

    #[test]
    fn column_of_zeros_takes_no_memory_and_a_late_value_keeps_its_place() {
        let mut column = SparseColumn::default();
        column.append(3, 5, [0_u16; 3].into_iter());
        assert_eq!(column.values.capacity(), 0);
        column.append(2, 5, [0, 7].into_iter());
        let made = column.finish("a".into()).unwrap();
        assert_eq!(made.values, ExtraValues::U16(vec![0, 0, 0, 0, 7]));
        assert_eq!(SparseColumn::<u8>::default().finish("b".into()), None);
    }

    #[test]
    fn colours_that_count_to_255_are_told_from_dark_ones_even_if_bright_ones_come_last() {
        let mut narrow = WideColors::default();
        narrow.append(2, [[0, 128, 255], [1, 2, 3]].into_iter());
        let (colors, eight) = narrow.finish().unwrap();
        assert!(eight && colors[0] == [0.0, linear_of_8_bit()[128], 1.0]);
        let mut wide = WideColors::default();
        wide.append(3, [[0, 128, 255], [1, 2, 3]].into_iter());
        wide.append(3, [[256, 65_535, 4]].into_iter());
        let (colors, eight) = wide.finish().unwrap();
        let table = linear_of_16_bit();
        assert!(!eight && colors[0] == [0.0, table[128], table[255]] && colors[2] == [table[256], 1.0, table[4]]);
    }
}
