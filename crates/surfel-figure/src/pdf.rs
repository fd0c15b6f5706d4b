//! PDF output of drawings, with words as text in the embedded font.

use crate::drawing::{Drawing, Item, Picture, Rgb, Text};
use crate::font::{self, Segment};
use crate::raster;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str};
use std::collections::BTreeMap;
use std::io::Write as _;

const CATALOG: Ref = Ref::new(1);
const PAGES: Ref = Ref::new(2);
const PAGE: Ref = Ref::new(3);
const CONTENT: Ref = Ref::new(4);
const FONT: Ref = Ref::new(5);
const CID_FONT: Ref = Ref::new(6);
const DESCRIPTOR: Ref = Ref::new(7);
const FONT_FILE: Ref = Ref::new(8);
const TO_UNICODE: Ref = Ref::new(9);
/// PDF object number of the first image. Each image takes two numbers, for its colours and its alpha.
const FIRST_IMAGE: i32 = 10;

/// Name of the graphics state with the opacity of the background.
const BACKGROUND_STATE: Name<'static> = Name(b"B");
const FONT_NAME: Name<'static> = Name(b"SURFEL+Inter-Regular");
const SYSTEM: SystemInfo<'static> = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };
/// Number of PDF units (points) per inch.
const POINTS: f64 = 72.0;

impl Drawing {
    /// Converts the drawing to a PDF file with one page, at `dpi` pixels per inch.
    pub fn pdf(&self, dpi: f64) -> Vec<u8> {
        let scale = POINTS / dpi;
        let [width, height] = self.size.map(|side| (f64::from(side) * scale) as f32);
        let mut pdf = Pdf::new();
        pdf.catalog(CATALOG).pages(PAGES);
        pdf.pages(PAGES).kids([PAGE]).count(1);
        let pictures: Vec<&Picture> = self.pictures().collect();
        let references = |i: usize| {
            let first = FIRST_IMAGE + 2 * i as i32;
            (Ref::new(first), Ref::new(first + 1))
        };
        let mut page = pdf.page(PAGE);
        page.parent(PAGES).media_box(Rect::new(0.0, 0.0, width, height)).contents(CONTENT);
        let mut resources = page.resources();
        resources.fonts().pair(Name(b"F"), FONT);
        let mut objects = resources.x_objects();
        for i in 0..pictures.len() {
            objects.pair(Name(image_name(i).as_bytes()), references(i).0);
        }
        objects.finish();
        let background_state = self.has_translucent_background().then(|| references(pictures.len()).0);
        if let Some(state) = background_state {
            resources.ext_g_states().pair(BACKGROUND_STATE, state);
        }
        resources.finish();
        page.finish();
        let content = self.content(scale);
        pdf.stream(CONTENT, &deflated(&content)).filter(Filter::FlateDecode);
        for (i, picture) in pictures.iter().enumerate() {
            put_image(&mut pdf, picture, references(i));
        }
        if let Some(state) = background_state {
            pdf.ext_graphics(state).non_stroking_alpha(f32::from(self.background[3]) / 255.0);
        }
        self.put_font(&mut pdf);
        pdf.finish()
    }

    /// True if the background has an opacity between 0 and 1.
    fn has_translucent_background(&self) -> bool {
        (1..255).contains(&self.background[3])
    }

    /// Returns the content stream of the page. Coordinates are pixels with y down; the first operator maps them to PDF
    /// points.
    fn content(&self, scale: f64) -> Vec<u8> {
        let mut content = Content::new();
        let (s, height) = (scale as f32, f64::from(self.size[1]) * scale);
        content.transform([s, 0.0, 0.0, -s, 0.0, height as f32]);
        // Line ends are square, and joins are mitred.
        content.set_line_cap(pdf_writer::types::LineCapStyle::ProjectingSquareCap);
        content.set_line_join(pdf_writer::types::LineJoinStyle::MiterJoin);
        let [r, g, b, a] = self.background;
        if a > 0 {
            if self.has_translucent_background() {
                content.save_state().set_parameters(BACKGROUND_STATE);
            }
            fill_color(&mut content, [r, g, b]);
            content.rect(0.0, 0.0, self.size[0] as f32, self.size[1] as f32).fill_nonzero();
            if self.has_translucent_background() {
                content.restore_state();
            }
        }
        let mut images = 0;
        for item in &self.items {
            match item {
                Item::Picture(rect, _) => {
                    let ([x, y], [w, h]) = (rect.at.map(|c| c as f32), rect.size.map(|c| c as f32));
                    content.save_state().transform([w, 0.0, 0.0, -h, x, y + h]);
                    content.x_object(Name(image_name(images).as_bytes())).restore_state();
                    images += 1;
                }
                Item::Polygon(points, color) => {
                    fill_color(&mut content, *color);
                    path(&mut content, points);
                    content.close_path().fill_nonzero();
                }
                Item::Line { points, width, color } => {
                    stroke_color(&mut content, *color);
                    content.set_line_width(*width as f32);
                    path(&mut content, points);
                    content.stroke();
                }
                Item::Text(text) => put_text(&mut content, text),
            }
        }
        content.finish().to_vec()
    }

    fn put_font(&self, pdf: &mut Pdf) {
        // Glyphs that the drawing uses, each with the first character that it shows.
        let mut used: BTreeMap<u16, char> = BTreeMap::new();
        for text in self.texts() {
            for c in text.text.chars() {
                used.entry(font::glyph(c).0).or_insert(c);
            }
        }
        pdf.type0_font(FONT)
            .base_font(FONT_NAME)
            .encoding_predefined(Name(b"Identity-H"))
            .descendant_font(CID_FONT)
            .to_unicode(TO_UNICODE);
        let mut cid = pdf.cid_font(CID_FONT);
        cid.subtype(CidFontType::Type2).base_font(FONT_NAME).system_info(SYSTEM).font_descriptor(DESCRIPTOR);
        cid.cid_to_gid_map_predefined(Name(b"Identity"));
        let mut widths = cid.widths();
        for glyph in used.keys() {
            let width = 1000.0 * font::advance(ttf_parser::GlyphId(*glyph));
            widths.consecutive(*glyph, [width as f32]);
        }
        widths.finish();
        cid.finish();
        let em = |units: i16| (1000.0 * f64::from(units) / font::units_per_em()) as f32;
        let mut descriptor = pdf.font_descriptor(DESCRIPTOR);
        descriptor.name(FONT_NAME).flags(FontFlags::NON_SYMBOLIC).italic_angle(0.0).stem_v(80.0);
        descriptor.cap_height((1000.0 * font::CAP_HEIGHT) as f32);
        if let Some(face) = font::face() {
            let bounds = face.global_bounding_box();
            descriptor.bbox(Rect::new(em(bounds.x_min), em(bounds.y_min), em(bounds.x_max), em(bounds.y_max)));
            descriptor.ascent(em(face.ascender())).descent(em(face.descender()));
        }
        descriptor.font_file2(FONT_FILE);
        descriptor.finish();
        pdf.stream(FONT_FILE, &deflated(font::FILE))
            .filter(Filter::FlateDecode)
            .pair(Name(b"Length1"), font::FILE.len() as i32);
        let mut map = UnicodeCmap::new(Name(b"Surfel"), SYSTEM);
        used.iter().for_each(|(glyph, c)| map.pair(*glyph, *c));
        pdf.cmap(TO_UNICODE, &map.finish());
    }
}

fn image_name(i: usize) -> String {
    format!("I{i}")
}

fn put_image(pdf: &mut Pdf, picture: &Picture, (colors, alpha): (Ref, Ref)) {
    let [width, height] = picture.size.map(|side| side as i32);
    let opaque = picture.is_opaque();
    let data = deflated(&raster::bytes_of(picture, true));
    let mut image = pdf.image_xobject(colors, &data);
    image.filter(Filter::FlateDecode);
    image.width(width).height(height).bits_per_component(8);
    image.color_space().device_rgb();
    if !opaque {
        image.s_mask(alpha);
    }
    image.finish();
    if !opaque {
        let data = deflated(&picture.rgba.iter().map(|pixel| pixel[3]).collect::<Vec<_>>());
        let mut mask = pdf.image_xobject(alpha, &data);
        mask.filter(Filter::FlateDecode);
        mask.width(width).height(height).bits_per_component(8);
        mask.color_space().device_gray();
    }
}

fn put_text(content: &mut Content, text: &Text) {
    let glyphs: Vec<u8> = text.text.chars().flat_map(|c| font::glyph(c).0.to_be_bytes()).collect();
    let (lead, [x, y]) = (text.lead(), text.at);
    // In the font, y points up, so the matrix mirrors it.
    let matrix = if text.is_turned { [0.0, -1.0, -1.0, 0.0, x, y + lead] } else { [1.0, 0.0, 0.0, -1.0, x - lead, y] };
    if let Some(halo) = text.halo {
        // The halo is drawn as outlines, so that the words are in the file only once.
        stroke_color(content, halo);
        content.set_line_width((2.0 * raster::HALO) as f32);
        content.save_state().transform(halo_matrix(text));
        outline(content, &font::outlines(&text.text));
        content.stroke().restore_state();
    }
    fill_color(content, text.color);
    content.begin_text().set_font(Name(b"F"), text.size as f32);
    content.set_text_matrix(matrix.map(|c| c as f32)).show(Str(&glyphs)).end_text();
}

/// Returns the matrix that maps the outlines of a text, in ems, to pixels.
fn halo_matrix(text: &Text) -> [f32; 6] {
    let (s, lead, [x, y]) = (text.size, text.lead(), text.at);
    let matrix = if text.is_turned { [0.0, -s, s, 0.0, x, y + lead] } else { [s, 0.0, 0.0, s, x - lead, y] };
    matrix.map(|c| c as f32)
}

/// Adds the outlines of glyphs to the current path.
fn outline(content: &mut Content, segments: &[Segment]) {
    let mut at = [f64::NAN; 2];
    let point = |[x, y]: [f64; 2]| (x as f32, y as f32);
    for segment in segments {
        let (Segment::Line(from, to) | Segment::Curve(from, _, to)) = *segment;
        if from != at {
            let (x, y) = point(from);
            content.move_to(x, y);
        }
        let (x, y) = point(to);
        match *segment {
            Segment::Line(..) => content.line_to(x, y),
            Segment::Curve(_, middle, _) => {
                // The quadratic curve is written as a cubic one.
                let toward = |end: [f64; 2]| point([0, 1].map(|k| end[k] + 2.0 / 3.0 * (middle[k] - end[k])));
                let ((x1, y1), (x2, y2)) = (toward(from), toward(to));
                content.cubic_to(x1, y1, x2, y2, x, y)
            }
        };
        at = to;
    }
}

fn path(content: &mut Content, points: &[[f64; 2]]) {
    for (i, [x, y]) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if i == 0 {
            content.move_to(x, y);
        } else {
            content.line_to(x, y);
        }
    }
}

fn levels(color: Rgb) -> [f32; 3] {
    color.map(|level| f32::from(level) / 255.0)
}

fn fill_color(content: &mut Content, color: Rgb) {
    let [r, g, b] = levels(color);
    content.set_fill_rgb(r, g, b);
}

fn stroke_color(content: &mut Content, color: Rgb) {
    let [r, g, b] = levels(color);
    content.set_stroke_rgb(r, g, b);
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    // Writing to memory doesn't fail.
    let written = encoder.write_all(bytes).and_then(|()| encoder.finish());
    written.unwrap_or_default()
}
