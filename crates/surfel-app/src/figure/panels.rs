//! Panels of a figure: their grid, their sizes, and their images.

use super::{ErrorColors, FigureRequest, Length, PANEL, Subject, errors, marks, values};
use crate::camera::resized;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use surfel_backend::Backend;
use surfel_figure::{Figure, Key, Panel, Picture, Row, Style};
use surfel_load::Error;
use surfel_math::srgb;
use surfel_model::{Camera, Scene};
use surfel_model::{MAX_IMAGE_SIDE, Settings};
use surfel_render::{Frame, Planes, View};

/// Default font size, in points, of figures whose width is a length on paper.
const FONT_PT: f64 = 8.0;
/// Default font size of figures whose width is in pixels, as a fraction of the figure's width.
const FONT_OF_WIDTH: f64 = 1.0 / 46.0;
/// Default font size of figures without a fixed width, as a fraction of a panel's shorter side.
const FONT_OF_PANEL: f64 = 0.032;
/// Smallest default font size, in pixels. Font sizes that the options state may be smaller.
const MIN_FONT: f64 = 9.0;
/// Fraction of a figure's fixed width that panels are assumed to fill, before the layout is computed.
const PANELS_SHARE: f64 = 0.85;
/// Smallest accepted width of a panel in pixels. If less is left beside words and margins, an error is reported.
const MIN_WIDTH: f64 = 16.0;
/// Number of typographic points per inch.
const POINTS: f64 = 72.0;
/// Margin above and below the content of cropped panels, in ems.
const CROP_MARGIN: f64 = 0.4;

/// Panel of a figure: its position in the grid, and the file that it shows.
pub(super) struct Cell {
    /// Row and column in the figure.
    place: [usize; 2],
    subject: usize,
    /// Index, within its subject (a group of files), of the file that the panel shows.
    member: usize,
    is_error: bool,
}

/// Figure whose panels are being drawn, with the file and the grid position of each panel.
pub(super) struct Panels<'a> {
    request: &'a FigureRequest<'a>,
    pub(super) figure: Figure,
    pub(super) cells: Vec<Cell>,
    size: [u32; 2],
}

/// Returns the width of the whole figure in pixels, if the options state it.
fn fixed_width(request: &FigureRequest<'_>) -> Option<f64> {
    Some(match request.figure.width? {
        Length::Pixels(pixels) => pixels,
        Length::Inches(inches) => inches * request.dpi(),
    })
}

/// Returns the size of a panel in pixels, before the layout is computed. `given` is the size in the options.
pub(super) fn first_size(request: &FigureRequest<'_>, given: Option<[u32; 2]>) -> [u32; 2] {
    let [width, height] = given.unwrap_or(PANEL);
    let Some(whole) = fixed_width(request) else { return [width, height] };
    let columns = request.columns() + usize::from(request.has_errors_beside());
    let own = (PANELS_SHARE * whole / columns as f64).max(MIN_WIDTH);
    sized(own, [width, height])
}

/// Returns a size of the given width, in pixels, with the aspect ratio of another size.
fn sized(width: f64, [w, h]: [u32; 2]) -> [u32; 2] {
    let height = width * f64::from(h) / f64::from(w);
    [width, height].map(|side| side.round().clamp(1.0, f64::from(MAX_IMAGE_SIDE)) as u32)
}

impl<'a> Panels<'a> {
    /// Creates a figure with empty panels. Their size follows from the figure's width if that is fixed.
    pub(super) fn new(request: &'a FigureRequest<'a>, subjects: &[Subject<'_>], keys: Vec<Key>) -> Result<Self, Error> {
        let size = subjects.first().map_or(PANEL, |subject| subject.resolved.file.camera.size);
        let [r, g, b, a] = subjects.first().map_or([1.0; 4], |subject| subject.resolved.file.background);
        let level = |value: f64| (255.0 * value.clamp(0.0, 1.0)).round() as u8;
        let [r, g, b] = [r, g, b].map(|c| level(srgb::encode(c.clamp(0.0, 1.0))));
        let style = Style { font: font(request, size), background: [r, g, b, level(a)], width: None };
        let title = request.figure.title.clone();
        let mut figure = Figure { title, keys, style, ..Figure::default() };
        if subjects.len() > 1 && request.figure.titles.len() == request.columns() {
            figure.headings.clone_from(&request.figure.titles);
        }
        let mut panels = Self { request, figure, cells: Vec::new(), size };
        subjects.iter().enumerate().for_each(|(i, subject)| panels.add(i, subject, subjects.len()));
        panels.fit()?;
        Ok(panels)
    }

    /// Adds the rows of panels of a subject, a group of files. `subject` is its index, `content` its files and options,
    /// and `subjects` the number of all subjects.
    fn add(&mut self, subject: usize, content: &Subject<'_>, subjects: usize) {
        let (columns, options) = (self.request.columns(), self.request.figure);
        let count = content.panels();
        for first in (0..count).step_by(columns) {
            let members = first..count.min(first + columns);
            let row_title = options.row_titles.get(subject * count.div_ceil(columns) + first / columns).cloned();
            let row = self.figure.rows.len();
            let panels = members.clone().map(|member| {
                let index = subject * count + member;
                let of_file = || content.paths.get(member).filter(|_| count > 1 || subjects > 1).map(|path| stem(path));
                let caption = match options.titles.len() {
                    0 => of_file(),
                    n if n == count && subjects > 1 => None,
                    _ => options.titles.get(index).cloned(),
                };
                Some(Panel { caption: caption.filter(|text| !text.is_empty()), ..Panel::empty(self.size) })
            });
            let mut panels: Vec<Option<Panel>> = panels.collect();
            let cell = |member: usize, place: [usize; 2], is_error: bool| Cell { place, subject, member, is_error };
            self.cells.extend(members.clone().map(|member| cell(member, [row, member - first], false)));
            if self.request.has_errors_beside() {
                let caption = content.errors.first().map(|errors| errors.caption(options.unit.as_deref()));
                panels.push(Some(Panel { caption, ..Panel::empty(self.size) }));
                self.cells.push(cell(1, [row, 2], true));
            }
            self.figure.rows.push(Row { label: row_title, panels });
            if content.errors.is_empty() || self.request.has_errors_beside() {
                continue;
            }
            // The reference file has no error, so that its panel in the error row is empty.
            let panels = members.clone().map(|member| {
                let caption = content.errors.get(member.checked_sub(1)?)?.caption(options.unit.as_deref());
                Some(Panel { caption: Some(caption), ..Panel::empty(self.size) })
            });
            self.figure.rows.push(Row { label: None, panels: panels.collect() });
            let errors = members.filter(|member| *member > 0);
            self.cells.extend(errors.map(|member| cell(member, [row + 1, member - first], true)));
        }
    }

    /// Scales the panels so that the figure has its fixed width, if any.
    fn fit(&mut self) -> Result<(), Error> {
        let Some(whole) = fixed_width(self.request) else { return Ok(()) };
        let proportions = self.size;
        let columns = self.figure.rows.iter().map(|row| row.panels.len()).max().unwrap_or(1).max(1);
        let mut width = f64::from(self.size[0]);
        // The layout of the words depends slightly on the size of the panels, so that this takes several steps.
        for _ in 0..4 {
            let excess = f64::from(self.figure.layout().size[0]) - whole;
            width = (width - (excess / columns as f64)).floor();
            if width < MIN_WIDTH {
                let found = whole.round();
                return Err(Error::Usage(format!(
                    "--width leaves no room for {columns} panels: found {found} pixels, expected a larger width, or \
                     fewer columns (--wrap), a smaller --font-size or --no-legend"
                )));
            }
            self.resize(sized(width, proportions));
        }
        self.figure.style.width = Some(whole.round() as u32);
        Ok(())
    }

    fn resize(&mut self, size: [u32; 2]) {
        self.size = size;
        self.figure.rows.iter_mut().flat_map(|row| &mut row.panels).flatten().for_each(|panel| panel.size = size);
    }

    /// Crops the panels of each subject to the rows of pixels in which at least one panel of the subject shows
    /// something, plus a margin. Objects of different proportions then don't leave white bands between the figure's
    /// rows. Does nothing for a single subject.
    pub(super) fn crop(&mut self, subjects: usize) {
        if subjects < 2 {
            return;
        }
        let background = self.figure.style.background;
        let margin = (CROP_MARGIN * self.figure.style.font).round() as u32;
        for subject in 0..subjects {
            let places: Vec<[usize; 2]> =
                self.cells.iter().filter(|cell| cell.subject == subject).map(|cell| cell.place).collect();
            let panel = |[row, column]: &[usize; 2]| self.figure.rows[*row].panels[*column].as_ref();
            let shown = places.iter().filter_map(panel).filter_map(|panel| panel.rows_unlike(background));
            let union = |a: Range<u32>, b: Range<u32>| a.start.min(b.start)..a.end.max(b.end);
            let Some(rows) = shown.reduce(union) else { continue };
            let rows = rows.start.saturating_sub(margin)..(rows.end + margin).min(self.size[1]);
            for [row, column] in places {
                if let Some(panel) = &mut self.figure.rows[row].panels[column] {
                    panel.crop_rows(rows.clone());
                }
            }
        }
    }

    /// Draws the image of the panel `cells[at]`, and stores it in the figure. `errors` is the colour scale of the error
    /// row. `has_values` is true if panels are coloured by values. `frusta` are cameras that are drawn over the panel
    /// as pyramids.
    pub(super) fn draw(
        &mut self,
        at: usize,
        subjects: &[Subject<'_>],
        (errors, has_values): (Option<&ErrorColors>, bool),
        frusta: &[Camera],
        backend: &mut Backend,
    ) -> Result<(), Error> {
        let cell = &self.cells[at];
        let subject = &subjects[cell.subject];
        let resolved = &subject.resolved;
        let mut camera = resized(&resolved.file.camera, self.size);
        if subject.is_framed {
            camera = marks::including(&camera, frusta);
        }
        let view = crate::camera::view(&camera, self.request.render)?;
        let mut settings = resolved.file.settings;
        let mut scene = resolved.scene.clone();
        if subject.is_split {
            scene.objects = vec![resolved.scene.objects[cell.member].clone()];
        }
        let distances = errors.filter(|_| cell.is_error && subject.is_split);
        let distances = distances.map(|colors| (colors, &subject.errors[cell.member - 1].distances));
        let blended = match distances {
            Some((colors, distances)) => values::split(&scene, distances, colors.end)?,
            None => None,
        };
        match (&blended, distances) {
            (Some(panel), _) => scene = panel.white.clone(),
            (None, Some((colors, distances))) => {
                scene.objects = vec![errors::painted(&scene.objects[0], distances, &colors.map, colors.end)?];
            }
            (None, None) => {}
        }
        if cell.is_error || has_values {
            errors::make_readable(&mut scene, &mut settings, &view);
        }
        let planes = Planes::COLOR.with_depth(!frusta.is_empty());
        let mut frame = self.frame(&scene, &view, &settings, planes, backend)?;
        if let (Some(panel), Some((colors, _))) = (blended, distances) {
            let settings = values::of_values(&settings);
            let drawn = self.frame(&panel.values, &view, &settings, Planes::COLOR, backend)?;
            values::color(frame.color_mut(), drawn.color(), &colors.map, resolved.scene.background);
        }
        let marks = marks::of_panel(&camera, &view, self.request.figure, frusta, frame.depth());
        let rgba = surfel_io::to_srgb8(frame.color());
        let [row, column] = cell.place;
        let place = self.figure.rows.get_mut(row).and_then(|row| row.panels.get_mut(column));
        if let Some(panel) = place.and_then(Option::as_mut) {
            (panel.picture, panel.marks) = (Some(Arc::new(Picture { size: self.size, rgba })), marks);
        }
        Ok(())
    }

    fn frame(
        &self,
        scene: &Scene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        backend: &mut Backend,
    ) -> Result<Frame, Error> {
        let mut frame = Frame::default();
        let resident = backend.upload(scene)?;
        backend.render_sampled(&resident, view, settings, planes, self.request.render.samples, &mut frame)?;
        Ok(frame)
    }
}

/// Returns the font size of a figure's words in pixels. `[width, height]` is the size of a panel.
fn font(request: &FigureRequest<'_>, [width, height]: [u32; 2]) -> f64 {
    let is_on_paper = matches!(request.figure.width, Some(Length::Inches(_)));
    let points = request.figure.font_pt.or(is_on_paper.then_some(FONT_PT));
    let of_panel = FONT_OF_PANEL * f64::from(width.min(height));
    let own = fixed_width(request).map_or(of_panel, |whole| FONT_OF_WIDTH * whole);
    points.map_or(own.max(MIN_FONT), |points| points * request.dpi() / POINTS)
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Projection;

    #[test]
    fn intrinsics_are_scaled_with_the_image() {
        let mut camera = Camera::perspective([0.0; 3], [0.0, 0.0, 1.0], 45.0, [100, 50]);
        camera.projection = Projection::Intrinsics { fx: 80.0, fy: 80.0, cx: 50.0, cy: 25.0 };
        let Projection::Intrinsics { fx, cy, .. } = resized(&camera, [200, 100]).projection else { panic!() };
        assert_eq!((fx, cy), (160.0, 50.0));
    }
}
