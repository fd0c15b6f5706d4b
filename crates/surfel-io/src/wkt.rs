//! Parser of WKT, version 1 (OGC 01-009) and 2 (ISO 19162), and conversion to GeoTIFF keys if these can express the
//! same system.

#![cfg_attr(not(feature = "geotiff"), allow(dead_code))]

/// An element of WKT: a keyword, followed by values and further elements in brackets.
struct Node<'a> {
    keyword: &'a str,
    /// The element's own strings, numbers and words, in order.
    values: Vec<&'a str>,
    parts: Vec<Node<'a>>,
}

impl<'a> Node<'a> {
    /// Parses a complete WKT text; returns `None` if it isn't valid.
    fn parse(text: &'a str) -> Option<Self> {
        // Ordinary texts are nested about ten deep.
        const MAX_DEPTH: usize = 32;
        let mut open: Vec<Self> = Vec::new();
        let mut rest = text;
        loop {
            rest = rest.trim_start_matches(|c: char| c.is_whitespace() || c == ',');
            if let Some(quoted) = rest.strip_prefix('"') {
                let end = quoted.find('"')?;
                open.last_mut()?.values.push(&quoted[..end]);
                rest = &quoted[end + 1..];
            } else if rest.starts_with([']', ')']) {
                let node = open.pop()?;
                match open.last_mut() {
                    Some(parent) => parent.parts.push(node),
                    None => return Some(node),
                }
                rest = &rest[1..];
            } else {
                let end = rest.find(['[', '(', ']', ')', ',', '"'])?;
                let word = rest[..end].trim();
                if rest[end..].starts_with(['[', '(']) {
                    if open.len() == MAX_DEPTH {
                        return None;
                    }
                    open.push(Self { keyword: word, values: Vec::new(), parts: Vec::new() });
                    rest = &rest[end + 1..];
                } else {
                    open.last_mut()?.values.push(word);
                    rest = &rest[end..];
                }
            }
        }
    }

    fn is(&self, keywords: &[&str]) -> bool {
        keywords.iter().any(|k| self.keyword.eq_ignore_ascii_case(k))
    }

    /// Returns the first child element with one of the keywords.
    fn part(&self, keywords: &[&str]) -> Option<&Self> {
        self.parts.iter().find(|part| part.is(keywords))
    }

    /// Returns the first element with one of the keywords: this element itself or a descendant.
    fn find(&self, keywords: &[&str]) -> Option<&Self> {
        if self.is(keywords) { Some(self) } else { self.parts.iter().find_map(|part| part.find(keywords)) }
    }

    fn name(&self) -> &'a str {
        self.values.first().copied().unwrap_or_default()
    }

    fn number(&self, index: usize) -> Option<f64> {
        self.values.get(index)?.parse().ok().filter(|v: &f64| v.is_finite())
    }

    /// Returns the EPSG code that the element states for itself.
    fn code(&self) -> Option<u16> {
        let id = self.part(&["ID", "AUTHORITY"]).filter(|id| id.name().eq_ignore_ascii_case("EPSG"))?;
        id.values.get(1)?.parse().ok().filter(|code| (1..32_767).contains(code))
    }

    /// Returns the size of the element's unit, in metres or radians. `keywords` are those of the unit's element.
    fn unit(&self, keywords: &[&str]) -> Option<f64> {
        self.part(keywords)?.number(1).filter(|unit| *unit > 0.0)
    }
}

/// Converts a text to what GeoTIFF allows: one line of ASCII. Tabs and line breaks become blanks. Other control
/// characters and non-ASCII characters become question marks, since a NUL would end the text.
pub(crate) fn printable(text: &str) -> String {
    let of_char = |c: char| match c {
        ' '..='~' => c,
        '\t' | '\n' | '\r' => ' ',
        _ => '?',
    };
    text.chars().map(of_char).collect()
}

/// Returns a name for comparisons: its ASCII letters and digits, in lower case.
fn plain(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

const PROJECTED: [&str; 3] = ["PROJCRS", "PROJECTEDCRS", "PROJCS"];
const LENGTH: [&str; 2] = ["LENGTHUNIT", "UNIT"];
const ANGLE: [&str; 2] = ["ANGLEUNIT", "UNIT"];
const DEGREE: f64 = std::f64::consts::PI / 180.0;
/// GeoTIFF code that states that a value is user-defined rather than one with an EPSG code.
const USER_DEFINED: u16 = 32_767;

/// GeoTIFF keys, and the numbers and text to which they refer.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Keys {
    pub(crate) keys: Vec<[u16; 4]>,
    pub(crate) doubles: Vec<f64>,
    pub(crate) text: String,
}

impl Keys {
    pub(crate) fn code(&mut self, key: u16, code: u16) {
        self.keys.push([key, 0, 1, code]);
    }

    fn double(&mut self, key: u16, value: f64) {
        self.keys.push([key, 34_736, 1, self.doubles.len() as u16]);
        self.doubles.push(value);
    }

    fn text(&mut self, key: u16, text: &str) {
        // In GeoTIFF a bar ends a text.
        let text: String = printable(text).replace('|', "?").chars().take(1000).collect();
        self.keys.push([key, 34_737, text.len() as u16 + 1, self.text.len() as u16]);
        self.text += &text;
        self.text.push('|');
    }
}

/// WKT names of the five usual parameters of projections, in both versions of WKT: natural origin, scale and false
/// coordinates.
const NATURAL: [&[&str]; 5] = [
    &["latitudeofnaturalorigin", "latitudeoforigin", "latitudeofcenter"],
    &["longitudeofnaturalorigin", "centralmeridian", "longitudeofcenter"],
    &["scalefactoratnaturalorigin", "scalefactor"],
    &["falseeasting", "eastingatfalseorigin"],
    &["falsenorthing", "northingatfalseorigin"],
];
/// WKT names of the false origin of conic projections, in both versions of WKT.
const FALSE_ORIGIN: [&[&str]; 2] = [
    &["latitudeoffalseorigin", "latitudeoforigin", "latitudeofcenter"],
    &["longitudeoffalseorigin", "centralmeridian", "longitudeofcenter"],
];
/// WKT names of the two standard parallels, in both versions of WKT.
const PARALLELS: [&[&str]; 2] =
    [&["latitudeof1ststandardparallel", "standardparallel1"], &["latitudeof2ndstandardparallel", "standardparallel2"]];
/// WKT names of the standard parallel and origin of polar projections, in both versions of WKT.
const POLAR: [&[&str]; 2] = [
    &["latitudeofstandardparallel", "latitudeoforigin", "latitudeofnaturalorigin", "standardparallel1"],
    &["longitudeoforigin", "centralmeridian", "longitudeofnaturalorigin"],
];

/// Kind of a projection's parameter, which decides the unit in which GeoTIFF stores it.
#[derive(Clone, Copy, PartialEq)]
enum Quantity {
    Angle,
    Length,
    Ratio,
}

/// A projection's parameter: its GeoTIFF key, its kind, and its names in WKT.
type Parameter = (u16, Quantity, &'static [&'static str]);

/// Returns the GeoTIFF code and the parameters of a projection, by its WKT name. Keys and names follow GDAL
/// (`gt_wkt_srs.cpp`, `geo_normalize.c`).
fn method(name: &str) -> Option<(u16, Vec<Parameter>)> {
    use Quantity::{Angle, Length, Ratio};
    let [lat, lon, scale, east, north] = NATURAL;
    let at = |lat_key, lon_key| vec![(lat_key, Angle, lat), (lon_key, Angle, lon)];
    let shift = [(3082, Length, east), (3083, Length, north)];
    let parallels = [(3078, Angle, PARALLELS[0]), (3079, Angle, PARALLELS[1])];
    let with_scale = |code| (code, [at(3081, 3080), vec![(3092, Ratio, scale)], shift.to_vec()].concat());
    let [false_lat, false_lon] = FALSE_ORIGIN;
    Some(match plain(name).as_str() {
        "transversemercator" | "gausskruger" => with_scale(1),
        "mercatorvarianta" | "mercator1sp" => with_scale(7),
        "lambertconicconformal1sp" | "lambertconformalconic1sp" => with_scale(9),
        "obliquestereographic" | "doublestereographic" => with_scale(16),
        "cassinisoldner" => (18, [at(3081, 3080), shift.to_vec()].concat()),
        "lambertconicconformal2sp" | "lambertconformalconic2sp" | "lambertconformalconic" => {
            let origin = vec![(3085, Angle, false_lat), (3084, Angle, false_lon)];
            let shift = vec![(3086, Length, east), (3087, Length, north)];
            (8, [origin, parallels.to_vec(), shift].concat())
        }
        "albersequalarea" | "albersconicequalarea" | "albers" => {
            let origin = vec![(3081, Angle, false_lat), (3080, Angle, false_lon)];
            (11, [origin, parallels.to_vec(), shift.to_vec()].concat())
        }
        "lambertazimuthalequalarea" => (10, [at(3089, 3088), shift.to_vec()].concat()),
        "polarstereographicvarianta" | "polarstereographicvariantb" | "polarstereographic" => {
            let pole = vec![(3081, Angle, POLAR[0]), (3095, Angle, POLAR[1]), (3092, Ratio, scale)];
            (15, [pole, shift.to_vec()].concat())
        }
        _ => return None,
    })
}

/// EPSG codes of geographic systems in common use, by the names of their datums in the form of [`plain`].
const DATUMS: [(&[&str], u16); 6] = [
    (&["worldgeodeticsystem1984", "worldgeodeticsystem1984ensemble", "wgs1984", "dwgs1984", "wgs84"], 4326),
    (&["northamericandatum1983", "northamerican1983", "dnorthamerican1983"], 4269),
    (&["northamericandatum1927", "dnorthamerican1927"], 4267),
    (&["nad83nationalspatialreferencesystem2011", "dnad19832011"], 6318),
    (&["europeanterrestrialreferencesystem1989", "europeanterrestrialreferencesystem1989ensemble", "detrs1989"], 4258),
    (&["geocentricdatumofaustralia2020", "dgda2020"], 7844),
];

/// Returns GeoTIFF keys for a projected system that states no EPSG code. Returns `None` for other systems, and if
/// GeoTIFF lacks the projection or one of its parameters.
pub(crate) fn projected_keys(wkt: &str) -> Option<Keys> {
    let whole = Node::parse(wkt)?;
    let system = whole.find(&PROJECTED)?;
    let geographic = system.part(&["BASEGEOGCRS", "BASEGEODCRS", "GEOGCS"])?;
    let conversion = system.part(&["CONVERSION"]).unwrap_or(system);
    let (code, wanted) = method(conversion.part(&["METHOD", "PROJECTION"])?.name())?;
    let axis = || system.part(&["AXIS"])?.unit(&LENGTH);
    let unit = system.unit(&LENGTH).or_else(axis)?;
    let angle = geographic.unit(&ANGLE).unwrap_or(DEGREE);
    let degrees =
        |value: f64, unit: f64| if (unit / DEGREE - 1.0).abs() < 1e-9 { value } else { value * unit / DEGREE };

    let mut keys = Keys::default();
    keys.code(1024, 1);
    add_geographic(&mut keys, geographic, degrees)?;
    keys.code(3072, USER_DEFINED);
    keys.text(3073, system.name());
    keys.code(3074, USER_DEFINED);
    keys.code(3075, code);
    match unit_code(unit) {
        Some(code) => keys.code(3076, code),
        None => {
            keys.code(3076, USER_DEFINED);
            keys.double(3077, unit);
        }
    }
    let parameters = || conversion.parts.iter().filter(|part| part.is(&["PARAMETER"]));
    let mut taken = 0;
    for (key, quantity, names) in wanted {
        let named = |name: &&&str| parameters().find(|p| plain(p.name()) == **name);
        let Some(parameter) = names.iter().find_map(|name| named(&name)) else {
            // A missing parameter is 0, or 1 if it is a ratio.
            keys.double(key, if quantity == Quantity::Ratio { 1.0 } else { 0.0 });
            continue;
        };
        let value = parameter.number(1)?;
        keys.double(
            key,
            match quantity {
                Quantity::Angle => degrees(value, parameter.unit(&ANGLE).unwrap_or(angle)),
                Quantity::Length => match parameter.unit(&LENGTH) {
                    Some(of) if (of / unit - 1.0).abs() >= 1e-9 => value * of / unit,
                    _ => value,
                },
                Quantity::Ratio => value,
            },
        );
        taken += 1;
    }
    // A parameter that the keys can't store would change the projection.
    (taken == parameters().count()).then_some(keys)
}

/// Returns the EPSG code of a unit of length by its size in metres; `None` for units other than the metre, the foot and
/// the survey foot.
fn unit_code(metres: f64) -> Option<u16> {
    // Files print the survey foot with 9 to 15 digits.
    let known = [(1.0, 9001), (0.3048, 9002), (1200.0 / 3937.0, 9003)];
    known.iter().find(|(size, _)| (metres / size - 1.0).abs() < 1e-9).map(|(_, code)| *code)
}

/// Adds keys for the vertical system that a WKT states, if any: its EPSG code, or else its name and unit. Adds nothing
/// if these are missing or the unit has no code.
pub(crate) fn add_vertical(keys: &mut Keys, wkt: &str) {
    let root = Node::parse(wkt);
    let Some(system) = root.as_ref().and_then(|root| root.find(&["VERTCRS", "VERTICALCRS", "VERT_CS"])) else { return };
    if let Some(code) = system.code() {
        return keys.code(4096, code);
    }
    // In version 2, the unit may be that of the axis.
    let unit = system.find(&LENGTH).and_then(|unit| unit_code(unit.number(1)?));
    if let (Some(unit), false) = (unit, system.name().is_empty()) {
        keys.code(4096, USER_DEFINED);
        keys.text(4097, system.name());
        keys.code(4099, unit);
    }
}

/// Adds keys for a geographic system, or for the base of a projected one: its EPSG code, or else its parameters.
/// `degrees` converts an angle in a unit, whose size is in radians, to degrees. Returns `None` if the keys can't
/// express the system.
fn add_geographic(keys: &mut Keys, system: &Node<'_>, degrees: impl Fn(f64, f64) -> f64) -> Option<()> {
    let datum = system.part(&["DATUM", "GEODETICDATUM", "TRF", "ENSEMBLE"])?;
    let name = plain(datum.name());
    let meridian = system.part(&["PRIMEM", "PRIMEMERIDIAN"]);
    let longitude = meridian.and_then(|m| Some(degrees(m.number(1)?, m.unit(&ANGLE).unwrap_or(DEGREE)))).unwrap_or(0.0);
    let of_name = || DATUMS.iter().find(|(names, _)| names.contains(&name.as_str())).map(|known| known.1);
    let known = || of_name().filter(|_| longitude == 0.0);
    if let Some(code) = system.code().or_else(known) {
        keys.code(2048, code);
        keys.code(2054, 9102);
        return Some(());
    }
    let ellipsoid = datum.part(&["ELLIPSOID", "SPHEROID"])?;
    keys.code(2048, USER_DEFINED);
    keys.text(2049, system.name());
    keys.code(2050, datum.code().unwrap_or(USER_DEFINED));
    if longitude == 0.0 {
        keys.code(2051, 8901);
    } else {
        keys.code(2051, USER_DEFINED);
        keys.double(2061, longitude);
    }
    keys.code(2054, 9102);
    keys.code(2056, USER_DEFINED);
    keys.double(2057, ellipsoid.number(1)? * ellipsoid.unit(&LENGTH).unwrap_or(1.0));
    match ellipsoid.number(2)? {
        // An inverse flattening of 0 means a sphere.
        0.0 => keys.double(2058, ellipsoid.number(1)? * ellipsoid.unit(&LENGTH).unwrap_or(1.0)),
        inverse_flattening => keys.double(2059, inverse_flattening),
    }
    if let Some(shift) = datum.part(&["TOWGS84"]) {
        // A datum with an incomplete shift would be a different datum.
        let numbers = (0..shift.values.len().min(7)).map(|i| shift.number(i)).collect::<Option<Vec<_>>>()?;
        keys.keys.push([2062, 34_736, numbers.len() as u16, keys.doubles.len() as u16]);
        keys.doubles.extend(numbers);
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// PROJ's output, without the parts that don't matter here.
    const CONIC: &str = r#"COMPOUNDCRS["x",PROJCRS["mine | yours",BASEGEOGCRS["unknown",
        DATUM["Unknown based on GRS 1980 ellipsoid",
            ELLIPSOID["GRS 1980",6378137,298.257222101,LENGTHUNIT["metre",1],ID["EPSG",7019]]],
        PRIMEM["Greenwich",0,ANGLEUNIT["degree",0.0174532925199433],ID["EPSG",8901]]],
      CONVERSION["unknown",METHOD["Lambert Conic Conformal (2SP)",ID["EPSG",9802]],
        PARAMETER["Latitude of false origin",50,ANGLEUNIT["grad",0.0157079632679489],ID["EPSG",8821]],
        PARAMETER["Longitude of false origin",2.5,ANGLEUNIT["degree",0.0174532925199433],ID["EPSG",8822]],
        PARAMETER["Latitude of 1st standard parallel",44.5,ANGLEUNIT["degree",0.0174532925199433]],
        PARAMETER["Latitude of 2nd standard parallel",46.5,ANGLEUNIT["degree",0.0174532925199433]],
        PARAMETER["Easting at false origin",700000,LENGTHUNIT["metre",1]],
        PARAMETER["Northing at false origin",6600000,LENGTHUNIT["US survey foot",0.304800609601219]]],
      CS[Cartesian,2],
        AXIS["(E)",east,ORDER[1],LENGTHUNIT["US survey foot",0.304800609601219,ID["EPSG",9003]]],
        AXIS["(N)",north,ORDER[2],LENGTHUNIT["US survey foot",0.304800609601219,ID["EPSG",9003]]]]]"#;

    /// Returns a key's value: the double or text that it refers to, or the value in the key itself.
    fn value(keys: &Keys, key: u16) -> Option<String> {
        let [_, place, count, value] = *keys.keys.iter().find(|k| k[0] == key)?;
        let at = usize::from(value);
        Some(match place {
            34_736 => format!("{:?}", &keys.doubles[at..at + usize::from(count)]),
            34_737 => keys.text[at..at + usize::from(count)].to_owned(),
            _ => value.to_string(),
        })
    }

    #[test]
    fn projection_of_the_second_version_becomes_keys() {
        let keys = projected_keys(CONIC).unwrap();
        let metres_in_feet = format!("[{:?}]", 700_000.0 / 0.304_800_609_601_219);
        let expected = [
            (1024, "1"),
            (2048, "32767"),
            (2049, "unknown|"),
            (2050, "32767"),
            (2051, "8901"),
            (2056, "32767"),
            (2057, "[6378137.0]"),
            (2059, "[298.257222101]"),
            (3072, "32767"),
            (3073, "mine ? yours|"),
            (3074, "32767"),
            (3075, "8"),
            (3076, "9003"),
            (3078, "[44.5]"),
            (3079, "[46.5]"),
            (3084, "[2.5]"),
            (3086, metres_in_feet.as_str()),
            (3087, "[6600000.0]"),
        ];
        for (key, expected) in expected {
            assert_eq!(value(&keys, key).as_deref(), Some(expected), "{key}");
        }
        // 50 gon are 45°.
        let latitude: f64 = value(&keys, 3085).unwrap().trim_matches(['[', ']']).parse().unwrap();
        assert!((latitude - 45.0).abs() < 1e-12, "{latitude}");
        assert_eq!(keys.keys.len(), expected.len() + 2);
    }

    #[test]
    fn projection_of_the_first_version_becomes_keys() {
        let wkt = r#"PROJCS["UTM 33",GEOGCS["g",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],
            PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],
            PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",15],PARAMETER["scale_factor",0.9996],
            PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["yard",0.9144]]"#;
        let keys = projected_keys(wkt).unwrap();
        let found = [2048, 3075, 3076, 3077, 3080, 3081, 3092, 3082, 3083].map(|key| value(&keys, key).unwrap());
        assert_eq!(found, ["4326", "1", "32767", "[0.9144]", "[15.0]", "[0.0]", "[0.9996]", "[500000.0]", "[0.0]"]);
        // A user-defined datum with a shift, on a sphere and with another prime meridian.
        let own = wkt.replace("WGS_1984", "mine").replace("298.257223563", "0").replace("Greenwich\",0", "Paris\",2.5");
        let own = own.replace(",0]],", ",0],TOWGS84[1,2,3]],");
        let keys = projected_keys(&own).unwrap();
        let found = [2048, 2051, 2058, 2061, 2062].map(|key| value(&keys, key).unwrap());
        assert_eq!(found, ["32767", "32767", "[6378137.0]", "[2.5]", "[1.0, 2.0, 3.0]"]);
        assert!(projected_keys(&own.replace("[1,2,3]", "[1,two,3]")).is_none());
    }

    #[test]
    fn heights_are_named_where_they_have_no_code() {
        let vertical = |text: &str| {
            let mut keys = Keys::default();
            add_vertical(&mut keys, text);
            [4096, 4097, 4099].map(|key| value(&keys, key).unwrap_or_default())
        };
        // As PROJ writes a compound system whose code is that of the whole: its parts state no code.
        let second = r#"COMPOUNDCRS["A + NAP",PROJCRS["A",CS[Cartesian,2],LENGTHUNIT["metre",1]],
            VERTCRS["NAP height",VDATUM["Normaal"],CS[vertical,1],AXIS["(H)",up,LENGTHUNIT["foot",0.3048]]]]"#;
        assert_eq!(vertical(second), ["32767", "NAP height|", "9002"]);
        let first = r#"COMPD_CS["c",PROJCS["A"],VERT_CS["NAVD88",VERT_DATUM["d",2005],UNIT["metre",1],
            AXIS["Up",UP],AUTHORITY["EPSG","5703"]]]"#;
        assert_eq!(vertical(first), ["5703", "", ""]);
        let other = first.replace("EPSG", "ESRI");
        assert_eq!(vertical(&other), ["32767", "NAVD88|", "9001"]);
        let (rods, unnamed) = (other.replace("\"metre\",1", "\"rod\",5"), other.replace("NAVD88", ""));
        for none in [rods.as_str(), &unnamed, CONIC, "VERT_CS["] {
            assert_eq!(vertical(none), ["", "", ""]);
        }
    }

    #[test]
    fn what_keys_cannot_say_and_what_is_no_text_has_none() {
        // Unsupported projections and parameters, invalid numbers, and truncated texts.
        let changed = |from: &str, to: &str| {
            assert!(CONIC.contains(from));
            projected_keys(&CONIC.replace(from, to))
        };
        assert_eq!(changed("Lambert Conic Conformal (2SP)", "Krovak"), None);
        assert_eq!(changed("Latitude of 2nd standard parallel", "Scale factor at natural origin"), None);
        assert_eq!(changed(",44.5,", ",nan,"), None);
        assert_eq!(changed("PROJCRS[", "ENGCRS["), None);
        assert!(changed("Greenwich", "\u{416}").is_some());
        let ends: Vec<usize> = CONIC.char_indices().map(|(at, _)| at).collect();
        assert!(ends.iter().all(|&end| projected_keys(&CONIC[..end]).is_none()));
        for hostile in ["[".repeat(50_000), "]".into(), "\"".into(), "a[\"".into(), String::new(), ",,".into()] {
            assert_eq!(projected_keys(&hostile), None);
        }
    }
}
