//! Coordinate reference system of an image.

use super::source::Source;
use std::path::PathBuf;
use surfel_io::Crs;
use surfel_io::ShowPath as _;
use surfel_load::Error;
use surfel_model::ModelError;

/// Returns the coordinate reference system with the given EPSG code, or else the system that all files share; `None` if
/// no file states one. Adds notes about files without a usable system. Returns an error if files state different
/// systems, or if the EPSG code's coordinates are degrees.
pub(super) fn crs_of(
    sources: &[Source],
    epsg: Option<u16>,
    notes: &mut Vec<(Option<PathBuf>, String)>,
) -> Result<Option<Crs>, Error> {
    if let Some(code) = epsg {
        let crs = Crs::of_epsg(code);
        if crs.is_geographic() {
            let (field, found) = ("crs".into(), format!("EPSG:{code}, whose coordinates are degrees"));
            return Err(ModelError::OutOfRange { field, found, expected: "a projected system" }.into());
        }
        return Ok(Some(crs));
    }
    let mut first: Option<(&Source, &Crs)> = None;
    for source in sources {
        let Some(crs) = &source.crs else { continue };
        let unsuitable = |problem: String| Error::Unsuitable { path: source.path.clone(), problem };
        if crs.is_geographic() {
            let note = format!("says that its x and y are degrees ({}), which they can't be: ignored", crs.words());
            notes.push((Some(source.path.clone()), note));
            continue;
        }
        match first {
            None => first = Some((source, crs)),
            Some((_, known)) if known == crs || (known.epsg().is_some() && known.epsg() == crs.epsg()) => {}
            Some((other, known)) => {
                let (other, known) = (other.path.shown(), known.words());
                return Err(unsuitable(format!(
                    "has {}, but {other} has {known}: project one of them, or give `crs` if they are the same",
                    crs.words()
                )));
            }
        }
    }
    match first {
        None => notes.push((None, "no coordinate reference system is known: `crs=EPSG:N` gives one".into())),
        Some((known, crs)) => {
            for source in sources.iter().filter(|source| source.crs.is_none()) {
                let note = format!("has no CRS: taken to be as in {}, {}", known.path.shown(), crs.words());
                notes.push((Some(source.path.clone()), note));
            }
        }
    }
    Ok(first.map(|(_, crs)| crs.clone()))
}
