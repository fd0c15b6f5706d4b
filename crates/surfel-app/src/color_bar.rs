//! Colour bars and legends.

use std::path::Path;
use surfel_figure::{Drawing, Figure, Key, Style};
use surfel_io::IoError;
use surfel_load::coloring::{ColorScale, Coloring};

/// Font size of the image of a colour bar or legend, in pixels.
const FONT_PX: f64 = 18.0;

/// Returns the colour bar or legend of a colouring, for figures. Returns `None` if the colours don't represent values.
/// `title` replaces the attribute's name.
pub(crate) fn key(coloring: &Coloring, title: Option<&str>) -> Option<Key> {
    let title = title.unwrap_or(&coloring.attribute);
    match &coloring.scale {
        ColorScale::Direct => None,
        ColorScale::Range { map, range } => Some(Key::bar(title, map.levels(), *range)),
        ColorScale::Categories(all) => {
            let present = all.iter().filter(|category| category.count > 0);
            Some(Key::legend(title, present.map(|category| (category.label(), category.color)).collect()))
        }
    }
}

fn draw(coloring: &Coloring) -> Option<Drawing> {
    let keys = vec![key(coloring, None)?];
    Some(Figure { keys, style: Style::new(FONT_PX), ..Figure::default() }.layout())
}

/// Writes an image of a colour bar with round numbers, or of a legend with a labelled square for each of up to 256
/// categories. Returns false and writes nothing if the colours don't represent values.
///
/// # Errors
/// [`IoError`] if the file can't be written, or if another file exists and `overwrite` is false. An identical file is
/// no error, since several shards of a job may write the same colour bar.
pub fn save_color_bar(path: &Path, overwrite: bool, coloring: &Coloring) -> Result<bool, IoError> {
    let Some(drawing) = draw(coloring) else { return Ok(false) };
    let bytes = drawing.png(None);
    match surfel_io::atomic::write(path, overwrite, |out| out.write_all(&bytes)) {
        Err(IoError::Exists { .. }) if std::fs::read(path).is_ok_and(|known| known == bytes) => Ok(true),
        written => written.map(|()| true),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_load::coloring::Category;
    use surfel_model::Colormap;

    #[test]
    fn bars_have_the_colours_of_their_values() {
        let of = |scale| draw(&Coloring { attribute: "a".into(), scale });
        let map = Colormap::Turbo.into();
        let bar = of(ColorScale::Range { map, range: [0.0, 1.0] }).unwrap();
        let words: Vec<&str> = bar.texts().map(|text| text.text.as_str()).collect();
        assert!(words.contains(&"a") && words.contains(&"0.5"), "{words:?}");
        let colors = &bar.pictures().next().unwrap().rgba;
        // The largest value is at the top.
        assert_eq!((colors.len(), colors[0], colors[255]), (256, [122, 4, 3, 255], [48, 18, 59, 255]));
        let category = |value, count| Category { value, name: Some("road".into()), color: [255, 0, 0], count };
        let legend = of(ColorScale::Categories(vec![category(1.0, 4), category(2.0, 0)])).unwrap();
        let words: Vec<&str> = legend.texts().map(|text| text.text.as_str()).collect();
        assert_eq!(words, ["a", "road"], "absent categories have no entry");
        assert!(of(ColorScale::Direct).is_none());
    }

    #[test]
    fn bars_that_are_the_same_may_be_written_twice() {
        let path = std::env::temp_dir().join(format!("surfel-bar-{}.png", std::process::id()));
        let bar = |hi: f64| {
            let scale = ColorScale::Range { map: Colormap::Viridis.into(), range: [0.0, hi] };
            save_color_bar(&path, false, &Coloring { attribute: "a".into(), scale })
        };
        let written = [bar(1.0), bar(1.0)].map(Result::ok);
        let refused = bar(2.0);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(written, [Some(true); 2]);
        assert!(matches!(refused, Err(IoError::Exists { .. })));
    }
}
