//! Coordinate reference systems, as files state them: EPSG codes, well-known text, GeoTIFF keys.

#![cfg_attr(not(feature = "geotiff"), allow(dead_code))]

use crate::wkt::{self, Keys};
use glam::DVec3;

/// Comment that Surfel adds to point clouds whose x and y are degrees, judging from the columns' names or steps. It
/// replaces a coordinate reference system that the file doesn't state.
pub const IN_DEGREES: &str = "coordinates longitude latitude";

/// A coordinate reference system, as a file states it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Crs {
    /// The system as OGC well-known text (WKT).
    pub(crate) wkt: Option<String>,
    /// The system's EPSG code, if the file states it outside of WKT and GeoTIFF keys.
    pub(crate) code: Option<u32>,
    /// The system as GeoTIFF keys.
    pub(crate) geotiff: Option<GeoKeys>,
}

/// A coordinate reference system as GeoTIFF keys, in the form of three GeoTIFF tags.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct GeoKeys {
    /// GeoKeyDirectoryTag: a header of four numbers, then four numbers per key.
    pub(crate) directory: Vec<u16>,
    /// GeoDoubleParamsTag: the floating-point values that keys refer to.
    pub(crate) doubles: Vec<f64>,
    /// GeoAsciiParamsTag: the text values that keys refer to.
    pub(crate) text: String,
}

impl Crs {
    /// Creates a coordinate reference system from its EPSG code.
    pub fn of_epsg(code: u16) -> Self {
        Self { code: Some(code.into()), ..Self::default() }
    }

    /// Parses a coordinate reference system from a file's comments, in the form that docs/format.md defines. Returns
    /// `None` if they state none.
    pub fn of_comments(comments: &[String]) -> Option<Self> {
        fn numbers<T: std::str::FromStr>(text: &str) -> Vec<T> {
            text.split_ascii_whitespace().map_while(|word| word.parse().ok()).collect()
        }
        let after = |key: &str| comments.iter().find_map(|comment| comment.strip_prefix(key));
        let directory: Vec<u16> = after("crs_geotiff_keys ").map(numbers).unwrap_or_default();
        let crs = Self {
            wkt: after("crs_wkt ").map(str::to_owned),
            code: after("crs EPSG:").and_then(|code| code.trim().parse().ok()),
            geotiff: (directory.len() >= 8).then(|| {
                let doubles = after("crs_geotiff_doubles ").map(numbers).unwrap_or_default();
                let text = after("crs_geotiff_text ").unwrap_or_default().to_owned();
                GeoKeys { directory, doubles, text }
            }),
        };
        (crs != Self::default()).then_some(crs)
    }

    /// Returns the system's EPSG code, also if it is stated within WKT or GeoTIFF keys; `None` if the file states none.
    pub fn epsg(&self) -> Option<u32> {
        let of_wkt = self.wkt.as_deref().and_then(epsg_of_wkt);
        of_wkt.or(self.code).or_else(|| {
            // A projected system has priority over its geographic base. 32767 means user-defined.
            let key = |key| self.key(key).filter(|code| !matches!(code, 0 | 32_767));
            if self.key(3072).is_some() { key(3072) } else { key(2048) }.map(u32::from)
        })
    }

    /// Returns the value of a GeoTIFF key that stores a whole number in the directory itself; `None` if there is no
    /// such key.
    fn key(&self, key: u16) -> Option<u16> {
        let directory = &self.geotiff.as_ref()?.directory;
        directory.get(4..)?.chunks_exact(4).find(|e| e[0] == key && e[1] == 0).map(|e| e[3])
    }

    fn name(&self) -> Option<String> {
        if let Some(wkt) = &self.wkt {
            return wkt.split('"').nth(1).map(str::to_owned);
        }
        let text = &self.geotiff.as_ref()?.text;
        text.split('|').map(str::trim).find(|text| !text.is_empty()).map(str::to_owned)
    }

    /// True if x and y of the system are degrees. A system of which only the EPSG code is stated is recognised if the
    /// code is in common use.
    pub fn is_geographic(&self) -> bool {
        let of_code = |code: u32| GEOGRAPHIC.iter().any(|[lo, hi]| (*lo..=*hi).contains(&code));
        match (&self.wkt, &self.geotiff) {
            (Some(wkt), _) => is_geographic_wkt(wkt),
            // Without a model type, a geographic key means degrees, unless there is a projected key, too.
            (None, Some(_)) => match (self.key(MODEL_TYPE), self.key(3072)) {
                (Some(model), _) if model != 0 => model == 2,
                (_, projected) => self.key(2048).is_some() && projected.is_none(),
            },
            (None, None) => self.code.is_some_and(of_code),
        }
    }

    /// Returns the EPSG code of the UTM zone (WGS 84) at a position: `longitude` from −180 to 180 degrees east,
    /// `latitude` from −90 to 90 degrees north.
    pub fn utm_at(longitude: f64, latitude: f64) -> u32 {
        let zone = ((longitude + 180.0).rem_euclid(360.0) / 6.0).floor() as u32 + 1;
        let first = if latitude < 0.0 { 32_700 } else { 32_600 };
        first + zone.min(60)
    }

    /// Returns advice for points whose x and y are degrees: either the system states this, or there is no system and
    /// the numbers suggest it. Returns `None` for other points, and for coordinates outside the range of degrees. `lo`
    /// and `hi` are the points' bounds, and `step` is the value that all coordinates are multiples of. Extents of 5° or
    /// more give no note: files of local coordinates often claim to be in degrees.
    #[cfg_attr(not(feature = "las"), allow(dead_code))]
    pub(crate) fn degrees_note(&self, (lo, hi): (DVec3, DVec3), step: Option<DVec3>) -> Option<String> {
        let extent = hi - lo;
        let on_earth = lo.x >= -180.0 && hi.x <= 360.0 && lo.y >= -90.0 && hi.y <= 90.0;
        if !on_earth || extent.x.max(extent.y) >= 5.0 {
            return None;
        }
        // Steps of lengths are similar on all axes; steps of x and y in degrees are about 10⁵ times smaller than that
        // of z.
        let looks_so = |step: DVec3| step.x.max(step.y) <= 1e-6 && step.z >= 100.0 * step.x;
        let (found, from) = match (self.is_geographic(), *self == Self::default() && step.is_some_and(looks_so)) {
            (true, _) => ("x and y are degrees", ""),
            (false, true) => ("x and y look like degrees", " --filters.reprojection.in_srs=EPSG:4326"),
            _ => return None,
        };
        let middle = 0.5 * (lo + hi);
        let utm = Self::utm_at(middle.x, middle.y);
        Some(format!(
            "{found}: it is drawn as if they were as long as z's units; project it first, as by pdal translate IN OUT \
             reprojection{from} --filters.reprojection.out_srs=EPSG:{utm} (UTM)"
        ))
    }

    /// Returns the system as GeoTIFF 1.1 keys for an image whose pixels are areas. An EPSG code in WKT has priority,
    /// then come the file's own keys. WKT alone without a code is converted to its parameters if the system is
    /// projected. If that fails, the WKT is stored as text, as Esri's programs do. WKT of 60,000 bytes or more gives no
    /// keys for the system.
    pub(crate) fn image_keys(&self) -> GeoKeys {
        let code = |value: Option<u32>| value.and_then(|code| u16::try_from(code).ok()).filter(|code| *code < 32_767);
        let stated = match (&self.wkt, &self.geotiff) {
            (Some(wkt), _) => code(code_of_wkt(wkt, &SYSTEMS)),
            (None, Some(_)) => None,
            (None, None) => code(self.code),
        };
        if let (None, Some(whole)) = (stated, &self.geotiff) {
            return pixel_is_area(whole);
        }
        let mut made = Keys::default();
        if let Some(stated) = stated {
            let (model, key) = if self.is_geographic() { (2, 2048) } else { (1, 3072) };
            made.code(MODEL_TYPE, model);
            made.code(key, stated);
        } else if let Some(wkt) = self.wkt.as_ref().filter(|wkt| wkt.len() < 60_000) {
            made = wkt::projected_keys(wkt).or_else(|| as_text(wkt)).unwrap_or_default();
        }
        if let Some(wkt) = self.wkt.as_ref().filter(|_| !made.keys.is_empty()) {
            wkt::add_vertical(&mut made, wkt);
        }
        made.code(RASTER_TYPE, 1);
        made.keys.sort_unstable();
        let mut directory = vec![1, 1, 0, made.keys.len() as u16];
        directory.extend(made.keys.iter().flatten());
        GeoKeys { directory, doubles: made.doubles, text: made.text }
    }

    /// Returns a short description of the system for notes: "CRS 'NAD83 / UTM zone 10N' (EPSG:26910)", "no CRS".
    pub fn words(&self) -> String {
        let name = self.name().map(|name| crate::error::quote(name.as_bytes()));
        match (name, self.epsg()) {
            (Some(name), Some(code)) => format!("CRS {name} (EPSG:{code})"),
            (Some(name), None) => format!("CRS {name}"),
            (None, Some(code)) => format!("CRS EPSG:{code}"),
            (None, None) if self.geotiff.is_some() => "a CRS without a name".into(),
            (None, None) => "no CRS".into(),
        }
    }

    /// Returns comments that state the system in a file, in the form that docs/format.md defines.
    pub fn comments(&self) -> Vec<String> {
        let join = |values: Vec<String>| values.join(" ");
        let mut comments = Vec::new();
        if let Some(code) = self.epsg() {
            comments.push(format!("crs EPSG:{code}"));
        }
        if let Some(wkt) = &self.wkt {
            comments.push(format!("crs_wkt {wkt}"));
        }
        if let Some(GeoKeys { directory, doubles, text }) = &self.geotiff {
            comments.push(format!("crs_geotiff_keys {}", join(directory.iter().map(u16::to_string).collect())));
            if !doubles.is_empty() {
                comments.push(format!("crs_geotiff_doubles {}", join(doubles.iter().map(f64::to_string).collect())));
            }
            if !text.is_empty() {
                comments.push(format!("crs_geotiff_text {text}"));
            }
        }
        comments
    }
}

/// WKT keywords of coordinate reference systems that contain another one, such as compound systems.
const COMPOUNDS: [&str; 4] = ["COMPD_CS", "COMPOUNDCRS", "BOUNDCRS", "SOURCECRS"];
/// WKT keywords of single coordinate reference systems: projected, geographic or geocentric.
const SYSTEMS: [&str; 9] =
    ["PROJCS", "PROJCRS", "PROJECTEDCRS", "GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEOCCS", "GEODETICCRS"];

/// GeoTIFF key that states the kind of x and y: projected, geographic or geocentric.
const MODEL_TYPE: u16 = 1024;
/// GeoTIFF key that states what a pixel is: an area or a point.
const RASTER_TYPE: u16 = 1025;
/// Ranges, first to last, of EPSG codes that contain only geographic systems, in degrees. The ranges follow version 12
/// of the EPSG dataset, and cover the systems in common use.
const GEOGRAPHIC: [[u32; 2]; 20] = [
    [4001, 4025],
    [4120, 4216],
    [4218, 4327],
    [4490, 4490],
    [4600, 4646],
    [4657, 4765],
    [4937, 4937],
    [4979, 4979],
    [6318, 6319],
    [6667, 6668],
    [6782, 6783],
    [7843, 7844],
    [7901, 7912],
    [8899, 8902],
    [8988, 9000],
    [9053, 9069],
    // Geographic systems with heights.
    [5498, 5499],
    [6349, 6349],
    [9518, 9518],
    [9705, 9707],
];

/// True if WKT describes a geographic system, in degrees, alone or combined with heights. A projected system isn't one,
/// although it contains a geographic base system.
fn is_geographic_wkt(wkt: &str) -> bool {
    let mut quoted = false;
    let mut start = None;
    for (at, c) in wkt.char_indices() {
        match c {
            '"' => (quoted, start) = (!quoted, None),
            _ if quoted => {}
            'A'..='Z' | 'a'..='z' | '0'..='9' | '_' => start = start.or(Some(at)),
            ' ' => {}
            '[' | '(' => {
                let word = start.take().map_or("", |from| wkt[from..at].trim_end()).to_ascii_uppercase();
                match word.as_str() {
                    "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS" => return true,
                    // A geodetic system has either angles on an ellipsoid or Cartesian coordinates as axes.
                    "GEODCRS" | "GEODETICCRS" => return wkt.to_ascii_lowercase().contains("cs[ellipsoidal"),
                    _ if SYSTEMS.contains(&word.as_str()) => return false,
                    _ => {}
                }
            }
            _ => start = None,
        }
    }
    false
}

/// Returns GeoTIFF keys that store the WKT of a projected or compound system as text, as Esri's programs do. Returns
/// `None` for other systems, or if the WKT contains a bar (`|`), which would end the text.
fn as_text(wkt: &str) -> Option<Keys> {
    let roots = ["PROJCS[", "PROJCRS[", "PROJECTEDCRS[", "COMPD_CS[", "COMPOUNDCRS["];
    let is_projected = !wkt.contains('|') && roots.iter().any(|root| wkt.starts_with(root));
    is_projected.then(|| {
        let text = format!("ESRI PE String = {}|", wkt::printable(wkt));
        // GDAL expects separate keys for a projected system.
        let keys = vec![[MODEL_TYPE, 0, 1, 32_767], [3072, 0, 1, 32_767], [3073, 34_737, text.len() as u16, 0]];
        Keys { keys, text, ..Keys::default() }
    })
}

/// Returns GeoTIFF keys for an image whose pixels are areas: those of `whole`, with this raster type. Keys that refer
/// to missing values are dropped.
fn pixel_is_area(whole: &GeoKeys) -> GeoKeys {
    let GeoKeys { directory, doubles, text } = whole;
    let text = wkt::printable(text);
    let fits = |key: &[u16; 4]| {
        let end = usize::from(key[3]) + usize::from(key[2]);
        match key[1] {
            0 => key[2] == 1,
            34_736 => end <= doubles.len(),
            34_737 => end <= text.len(),
            _ => false,
        }
    };
    let keys = directory.get(4..).unwrap_or_default().chunks_exact(4).map(|key| [key[0], key[1], key[2], key[3]]);
    let mut keys: Vec<[u16; 4]> = keys.filter(|key| key[0] != RASTER_TYPE && fits(key)).collect();
    keys.push([RASTER_TYPE, 0, 1, 1]);
    keys.sort_unstable();
    keys.dedup_by_key(|key| key[0]);
    let mut made = vec![1, 1, 0, keys.len() as u16];
    made.extend(keys.iter().flatten());
    GeoKeys { directory: made, doubles: doubles.clone(), text }
}

/// Returns the EPSG code that WKT states: `AUTHORITY["EPSG","26910"]` or `ID["EPSG",26910]`. The code of the whole
/// system has priority over that of its first horizontal part. Codes of datums, units and base systems don't count.
fn epsg_of_wkt(wkt: &str) -> Option<u32> {
    let whole: Vec<&str> = SYSTEMS.into_iter().chain(COMPOUNDS).collect();
    code_of_wkt(wkt, &whole)
}

/// Returns the EPSG code of the outermost element of WKT whose keyword is one of `parts` and whose enclosing elements
/// are all in [`COMPOUNDS`]. Returns `None` if there is no such code. Elements nested deeper than 64 end the search.
fn code_of_wkt(wkt: &str, parts: &[&str]) -> Option<u32> {
    let (mut stack, mut best, mut quoted): (Vec<&str>, Option<(usize, u32)>, bool) = (Vec::new(), None, false);
    let is_one_of = |word: &str, names: &[&str]| names.iter().any(|name| word.eq_ignore_ascii_case(name));
    for (at, c) in wkt.char_indices() {
        match c {
            '"' => quoted = !quoted,
            _ if quoted => {}
            '[' | '(' => {
                let word = wkt[..at].rsplit(|c: char| !c.is_ascii_alphanumeric() && c != '_').next().unwrap_or("");
                let parents = stack.split_last().is_some_and(|(parent, above)| {
                    is_one_of(parent, parts) && above.iter().all(|word| is_one_of(word, &COMPOUNDS))
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
                // Ordinary texts are nested about ten deep.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn geo_keys(directory: Vec<u16>, doubles: Vec<f64>, text: &str) -> GeoKeys {
        GeoKeys { directory, doubles, text: text.to_owned() }
    }

    #[test]
    fn degrees_are_told_with_where_to_project_them() {
        let bounds = |x: f64, y: f64, side: f64| (DVec3::new(x, y, 100.0), DVec3::new(x + side, y + side, 150.0));
        let (fine, even) = (Some(DVec3::new(1e-7, 1e-7, 1e-3)), Some(DVec3::splat(1e-3)));
        let said = |crs: &Crs, bounds, step| crs.degrees_note(bounds, step).unwrap_or_default();
        let (degrees, none) = (Crs::of_epsg(4326), Crs::default());
        // UTM zones: 3° W to 3° E are zones 30 and 31; Auckland is in 60 S. Longitudes may also range to 360.
        for (x, y, code) in [(-0.2, 51.5, 32_630), (0.1, 51.5, 32_631), (174.7, -36.9, 32_760), (-180.0, 10.0, 32_601)]
        {
            let note = said(&degrees, bounds(x, y, 0.01), even);
            assert!(
                note.starts_with("x and y are degrees") && note.contains(&format!("out_srs=EPSG:{code} ")),
                "{note}"
            );
            assert_eq!(said(&degrees, bounds(x.rem_euclid(360.0), y, 0.01), None), note);
            let note = said(&none, bounds(x, y, 0.01), fine);
            assert!(note.starts_with("x and y look like degrees") && note.contains("in_srs=EPSG:4326"), "{note}");
        }
        // No note: local coordinates, projected ones, and a system that states what the numbers are.
        for quiet in [
            degrees.degrees_note(bounds(0.0, 0.0, 40.0), fine),
            degrees.degrees_note(bounds(4e5, 5e6, 1.0), fine),
            none.degrees_note(bounds(1.0, 2.0, 0.5), even),
            none.degrees_note(bounds(1.0, 2.0, 0.5), None),
            Crs::of_epsg(25_832).degrees_note(bounds(1.0, 2.0, 0.5), fine),
        ] {
            assert_eq!(quiet, None);
        }
    }

    #[test]
    fn degrees_are_known_in_every_form_of_a_system() {
        let of_wkt = |text: &str| Crs { wkt: Some(text.into()), ..Crs::default() }.is_geographic();
        for text in [
            r#"GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]]]"#,
            r#" geogcs ["a",DATUM["b"]]"#,
            r#"COMPD_CS["WGS 84 + EGM2008",GEOGCS["WGS 84",DATUM["d"]],VERT_CS["v",VERT_DATUM["w",2005]]]"#,
            r#"COMPOUNDCRS["PROJCS[ in a name",GEOGCRS["WGS 84",ENSEMBLE["e"]],VERTCRS["v"]]"#,
            r#"GEODCRS["ETRS89",DATUM["d"],CS[ellipsoidal,2],AXIS["latitude",north]]"#,
            r#"BOUNDCRS[SOURCECRS[GEOGCRS["a",DATUM["b"]]],TARGETCRS[GEOGCRS["c"]]]"#,
        ] {
            assert!(of_wkt(text), "{text}");
        }
        for text in [
            r#"PROJCS["UTM",GEOGCS["WGS 84",DATUM["d"]],PROJECTION["Transverse_Mercator"]]"#,
            r#"COMPD_CS["c",PROJCS["p",GEOGCS["g"]],VERT_CS["v"]]"#,
            r#"BOUNDCRS[SOURCECRS[PROJCRS["p",BASEGEOGCRS["b"]]],TARGETCRS[GEOGCRS["c"]]]"#,
            r#"GEOCCS["WGS 84 (geocentric)",DATUM["d"]]"#,
            r#"GEODCRS["WGS 84",DATUM["d"],CS[Cartesian,3]]"#,
            r#"LOCAL_CS["site"]"#,
            "",
        ] {
            assert!(!of_wkt(text), "{text}");
        }
        let of_keys = |keys: &[[u16; 4]]| {
            let mut directory = vec![1, 1, 0, keys.len() as u16];
            directory.extend(keys.iter().flatten());
            Crs { geotiff: Some(geo_keys(directory, vec![], "")), ..Crs::default() }.is_geographic()
        };
        assert!(of_keys(&[[1024, 0, 1, 2]]) && of_keys(&[[2048, 0, 1, 4326]]));
        assert!(
            !of_keys(&[[1024, 0, 1, 1], [2048, 0, 1, 4269]]) && !of_keys(&[[2048, 0, 1, 4269], [3072, 0, 1, 26_915]])
        );
        assert!([4326, 4258, 4979, 7844, 9518, 5498].iter().all(|code| Crs::of_epsg(*code).is_geographic()));
        assert!([25_832, 2056, 3857, 7415, 5514].iter().all(|code| !Crs::of_epsg(*code).is_geographic()));
    }

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
        assert_eq!(epsg_of_wkt(r#"GEOGRAPHICCRS["y",ENSEMBLE["e"],ID["EPSG",4979]]"#), Some(4979));
        assert_eq!(epsg_of_wkt(r#"LOCAL_CS["AUTHORITY[\"EPSG\",\"5\"]"]]]"#), None);
    }

    #[test]
    fn texts_of_keys_are_printable_whatever_a_file_says() {
        // Found by a fuzzer: an image whose system has a NUL in its name was drawn, but could not be written.
        let named = r#"PROJCS["UTM 33",GEOGCS["g",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],
            PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],
            PARAMETER["central_meridian",15],UNIT["metre",1]]"#;
        let of_wkt = |text: String| Crs { wkt: Some(text), ..Crs::default() };
        let keys = vec![1, 1, 0, 1, 3073, 34_737, 6, 0];
        let of_keys = Crs { geotiff: Some(geo_keys(keys, vec![], "a\0\u{e9}\nb|")), ..Crs::default() };
        let parts = of_wkt(named.replace("UTM 33", "a\0\u{e9}\nb"));
        let whole = of_wkt(named.replace("UTM 33", "a\0\u{e9}\nb").replace("Transverse_Mercator", "Own"));
        for crs in [of_keys, parts, whole] {
            let GeoKeys { text, .. } = crs.image_keys();
            assert!(text.contains("a?? b") && text.chars().all(|c| matches!(c, ' '..='~')), "{text:?}");
        }
    }

    #[test]
    fn keys_name_the_projected_system() {
        let keys = vec![1, 1, 0, 3, 1024, 0, 1, 1, 2048, 0, 1, 4269, 3072, 0, 1, 26_915];
        let crs = Crs { code: None, wkt: None, geotiff: Some(geo_keys(keys, vec![], "NAD83 / UTM 15|")) };
        assert_eq!((crs.epsg(), crs.words().as_str()), (Some(26_915), "CRS 'NAD83 / UTM 15' (EPSG:26915)"));
        assert_eq!(Crs::default().words(), "no CRS");
        // A user-defined projection isn't its geographic base.
        let keys = vec![1, 1, 0, 3, 1024, 0, 1, 1, 2048, 0, 1, 4269, 3072, 0, 1, 32_767];
        assert_eq!(Crs { geotiff: Some(geo_keys(keys, vec![], "")), ..Crs::default() }.epsg(), None);
    }

    #[test]
    fn comments_carry_it_there_and_back() {
        let keys = vec![1, 1, 0, 1, 3072, 0, 1, 26_915];
        let all = Crs {
            wkt: Some(r#"PROJCS["a b",AUTHORITY["EPSG","26915"]]"#.into()),
            code: Some(26_915),
            geotiff: Some(geo_keys(keys, vec![0.1, 1e-300], "NAD83 / UTM 15|")),
        };
        assert_eq!(Crs::of_comments(&all.comments()), Some(all));
        assert_eq!(Crs::of_comments(&["crs EPSG:x".into(), "other".into()]), None);
    }

    #[test]
    fn keys_of_images_say_code_model_and_that_pixels_are_areas() {
        let projected = vec![1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 2056];
        assert_eq!(Crs::of_epsg(2056).image_keys(), geo_keys(projected, vec![], ""));
        let geographic = Crs::of_epsg(4326).image_keys().directory;
        assert_eq!(geographic[4..], [1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326]);
        // The code of the whole isn't that of a horizontal system, so the codes of its parts are written.
        let wkt = concat!(
            r#"COMPD_CS["c",PROJCS["p",GEOGCS["g",AUTHORITY["EPSG","1"]],AUTHORITY["EPSG","28992"]],"#,
            r#"VERT_CS["v",VERT_DATUM["d",2005,AUTHORITY["EPSG","7"]],AUTHORITY["EPSG","5709"]],"#,
            r#"AUTHORITY["EPSG","7415"]]"#
        );
        let crs = Crs { wkt: Some(wkt.into()), ..Crs::default() };
        assert_eq!(crs.epsg(), Some(7415));
        assert_eq!(crs.image_keys().directory[12..], [3072, 0, 1, 28_992, 4096, 0, 1, 5709]);
        // Without a code, the text itself is written.
        let crs = Crs { wkt: Some(r#"PROJCS["mine",GEOGCS["g"]]"#.into()), ..Crs::default() };
        let GeoKeys { directory: keys, text, .. } = crs.image_keys();
        assert_eq!(text, r#"ESRI PE String = PROJCS["mine",GEOGCS["g"]]|"#);
        assert_eq!(keys[4..8], [1024, 0, 1, 32_767]);
        assert_eq!(keys[12..], [3072, 0, 1, 32_767, 3073, 34_737, text.len() as u16, 0]);
        // Geocentric coordinates have no place in an image.
        let crs = Crs { wkt: Some(r#"GEOCCS["unnamed"]"#.into()), ..Crs::default() };
        assert_eq!(crs.image_keys(), geo_keys(vec![1, 1, 0, 1, 1025, 0, 1, 1], vec![], ""));
    }

    #[test]
    fn keys_of_a_file_are_kept_but_for_those_that_point_nowhere() {
        let keys =
            vec![1, 1, 0, 5, 1024, 0, 1, 1, 1025, 0, 1, 2, 3073, 34_737, 4, 0, 3075, 34_737, 9, 0, 3080, 34_736, 1, 0];
        let crs = Crs { geotiff: Some(geo_keys(keys, vec![500_000.0], "abc|")), ..Crs::default() };
        let expected = vec![1, 1, 0, 4, 1024, 0, 1, 1, 1025, 0, 1, 1, 3073, 34_737, 4, 0, 3080, 34_736, 1, 0];
        assert_eq!(crs.image_keys(), geo_keys(expected, vec![500_000.0], "abc|"));
    }
}
