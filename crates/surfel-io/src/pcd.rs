//! Reader of PCD, the file format of the Point Cloud Library: text, binary, and binary compressed by LZF.

use crate::ascii::{Lines, each_line, number, number_f32, words};
use crate::bytes::Bytes;
use crate::content::Content;
use crate::context::Context;
use crate::depth_image;
use crate::error::{Fault, Location, Problem, list, quote, unwritable};
use crate::point_columns::{self, Named, Roles, Source};
use crate::strided::{NumberType, Strided};
use glam::DVec3;
use std::io::{self, Read, Write};
use surfel_model::Up;

/// Maximum length of a header, in bytes; a longer one is refused.
const MAX_HEADER_BYTES: usize = 1 << 20;
/// Maximum factor by which LZF expands data. A reference of 3 bytes copies 7 + 255 + 2 bytes.
const LZF_EXPANSION: usize = 88;
/// Largest number of values per point of a field that is read. Feature histograms have more values and aren't used.
const MAX_FIELD_COUNT: usize = 64;

/// A field of each point: `count` numbers of one type.
struct Field<'a> {
    name: &'a str,
    kind: NumberType,
    count: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Text,
    Binary,
    Compressed,
}

struct Header<'a> {
    fields: Vec<Field<'a>>,
    points: usize,
    /// Numbers of columns and rows, if the points are stored as an image of more than one row.
    image: Option<[usize; 2]>,
    viewpoint: Option<&'a str>,
    encoding: Encoding,
    /// Number of bytes of a point in binary data.
    point_bytes: usize,
    /// Number of header lines.
    line: usize,
    /// Byte offset of the data, after the header.
    start: usize,
}

/// True if `head`, the start of a file, is that of a PCD file. The comment in the first line is optional.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    head.starts_with(b"# .PCD") || head.starts_with(b"VERSION") && head.windows(6).any(|w| w == b"FIELDS")
}

pub(crate) fn read(bytes: Bytes<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let head = bytes.at_most(0, MAX_HEADER_BYTES);
    let header = parse_header(&head)?;
    let mut unpacked = Vec::new();
    let data = match unpack(&header, bytes, &mut unpacked)? {
        true => Bytes::Memory(&unpacked),
        false => rows_in(&header, bytes)?,
    };
    let (columns, roles) = columns(&header, data, context)?;
    let (comments, upright_sensor) = sensor(&header, context);
    let mut content = point_columns::build(columns, &roles, Source::Typed, comments, context)?;
    if let Some(image) = header.image {
        depth_image::recognise(&mut content, image, context);
    }
    if let (Content::Points(points), Some(_)) = (&mut content, upright_sensor) {
        (points.up, points.viewpoint) = (Some(Up::MinusY), upright_sensor);
    }
    Ok(content)
}

/// Header of a PCD file whose points are read block by block.
#[cfg(feature = "laz")]
pub(crate) struct Table<'a>(Header<'a>);

#[cfg(feature = "laz")]
impl<'a> Table<'a> {
    /// Number of bytes at the start of a file that surely contain the header.
    pub(crate) const HEAD_BYTES: usize = MAX_HEADER_BYTES;

    pub(crate) fn of(head: &'a [u8]) -> Result<Self, Fault> {
        parse_header(head).map(Self)
    }

    pub(crate) fn points(&self) -> usize {
        self.0.points
    }

    pub(crate) fn has(&self, field: &str) -> bool {
        self.0.fields.iter().any(|f| f.name == field)
    }

    /// Returns the minimum number of bytes that the points take in the file, by which a damaged header is recognised.
    pub(crate) fn least_bytes(&self) -> usize {
        let point = match self.0.encoding {
            // A digit and a separator.
            Encoding::Text => {
                self.0.fields.iter().fold(0, |sum, field| field.count.saturating_mul(2).saturating_add(sum))
            }
            Encoding::Binary => self.0.point_bytes,
            Encoding::Compressed => self.0.point_bytes / LZF_EXPANSION,
        };
        self.0.points.saturating_mul(point)
    }

    /// Returns −y as the up axis if the sensor's pose shows it.
    pub(crate) fn up(&self, context: &mut Context<'_>) -> Option<Up> {
        sensor(&self.0, context).1.map(|_| Up::MinusY)
    }

    /// Writes the points as binary numbers to `out`: point by point, or field by field if the file compresses them.
    /// Writes nothing and returns false if the file's points are binary already.
    pub(crate) fn unpack(&self, bytes: Bytes<'_>, out: &mut dyn Write) -> Result<bool, Fault> {
        unpack(&self.0, bytes, out)
    }

    /// Returns the columns of the points and their roles. `bytes` is what [`Self::unpack`] wrote, if `is_unpacked`,
    /// else the file.
    pub(crate) fn columns<'b>(
        &self,
        bytes: Bytes<'b>,
        is_unpacked: bool,
        context: &mut Context<'_>,
    ) -> Result<(Vec<Named<'b>>, Roles), Fault> {
        columns(&self.0, if is_unpacked { bytes } else { rows_in(&self.0, bytes)? }, context)
    }
}

fn incomplete(what: String) -> Problem {
    Problem::new(what).help("copy or export the file again: it is incomplete, or its header counts too many")
}

fn too_large(header: &Header<'_>) -> Problem {
    incomplete(format!("its header counts {} points, more than there can be", header.points))
}

/// Returns the number of bytes of all points in binary form; returns an error if there are none.
fn size(header: &Header<'_>) -> Result<usize, Fault> {
    if header.points == 0 {
        return Err(Problem::new("holds no point").expected("POINTS of at least 1").into());
    }
    Ok(header.points.checked_mul(header.point_bytes).ok_or_else(|| too_large(header))?)
}

/// Writes text or compressed points as binary numbers to `out`: text point by point, compressed points field by field.
/// Writes nothing and returns false if the points are binary already.
fn unpack(header: &Header<'_>, bytes: Bytes<'_>, out: &mut dyn Write) -> Result<bool, Fault> {
    let size = size(header)?;
    match header.encoding {
        Encoding::Text => {
            let body = bytes.part(header.start..bytes.len()).unwrap_or(Bytes::Memory(&[]));
            read_text(header, body, out)?;
        }
        Encoding::Binary => return Ok(false),
        Encoding::Compressed => decompress(header, bytes, size, out)?,
    }
    Ok(true)
}

/// Returns the part of the file with its points, which are binary.
fn rows_in<'a>(header: &Header<'_>, bytes: Bytes<'a>) -> Result<Bytes<'a>, Fault> {
    let end = header.start.checked_add(size(header)?);
    Ok(end.and_then(|end| bytes.part(header.start..end)).ok_or_else(|| {
        let whole = (bytes.len() - header.start) / header.point_bytes;
        incomplete(format!("the file ends within point {whole} of {}", header.points)).at(Location::Byte(bytes.len()))
    })?)
}

/// Returns the columns of binary points, which are in `data`, and the columns' roles.
fn columns<'a>(
    header: &Header<'_>,
    data: Bytes<'a>,
    context: &mut Context<'_>,
) -> Result<(Vec<Named<'a>>, Roles), Fault> {
    let by_field = header.encoding == Encoding::Compressed;
    let mut columns = Vec::new();
    let (mut offset, mut left_out) = (0, Vec::new());
    for field in &header.fields {
        let n = field.kind.bytes();
        // Compressed points are stored field by field, others point by point.
        let (start, stride) =
            if by_field { (offset * header.points, n * field.count) } else { (offset, header.point_bytes) };
        offset += n * field.count;
        if field.name == "_" || field.count == 0 {
            continue;
        }
        if field.count > MAX_FIELD_COUNT {
            left_out.push(field.name);
            continue;
        }
        for i in 0..field.count {
            let name = if field.count == 1 { field.name.to_owned() } else { format!("{}_{i}", field.name) };
            let values = Strided::new(data, start + i * n, stride, header.points, field.kind, false);
            columns.push(Named { name, values: values.ok_or_else(|| too_large(header))? });
        }
    }
    if !left_out.is_empty() {
        let what = list(&left_out);
        context.note(format!("left out the fields {what}: they have more than {MAX_FIELD_COUNT} numbers a point"));
    }
    let roles = Roles::by_name(columns.iter().map(|c| c.name.as_str())).ok_or_else(|| {
        let names: Vec<&str> = header.fields.iter().map(|f| f.name).collect();
        Problem::new(format!("its points have no position: the fields are {}", list(&names))).expected("fields x y z")
    })?;
    Ok((columns, roles))
}

/// Returns the sensor's pose as a comment, if it isn't the default. Also returns the sensor's position, if the pose
/// shows that −y is up.
fn sensor(header: &Header<'_>, context: &mut Context<'_>) -> (Vec<String>, Option<DVec3>) {
    let (mut comments, mut upright_sensor) = (Vec::new(), None);
    if let Some(viewpoint) = header.viewpoint {
        let pose: Vec<Option<f64>> = viewpoint.split_ascii_whitespace().map(|w| number(w.as_bytes())).collect();
        if pose != [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0].map(Some) && pose.len() == 7 {
            comments.push(format!("VIEWPOINT {viewpoint}"));
            if let [Some(x), Some(y), Some(z), _, Some(half_turn_about_x), ..] = pose[..] {
                let place = DVec3::new(x, y, z);
                upright_sensor = (half_turn_about_x.abs() > 0.999 && place.is_finite()).then_some(place);
            }
            let taken = if upright_sensor.is_some() { "it turns -y up" } else { "it moves nothing" };
            context.note(format!(
                "left the points where they are stored, whatever the sensor's pose (VIEWPOINT {viewpoint}): {taken}"
            ));
        }
    }
    (comments, upright_sensor)
}

/// Parses the header in `bytes`, the start of a file.
fn parse_header(bytes: &[u8]) -> Result<Header<'_>, Fault> {
    let (mut names, mut sizes, mut types, mut counts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut width, mut height, mut points, mut viewpoint) = (None, None, None, None);
    let mut lines = Lines::new(bytes);
    let (encoding, line, start) = loop {
        let Some((line, raw)) = lines.next() else {
            let problem = Problem::new("the PCD header has no DATA line");
            return Err(problem.expected("'DATA ascii', 'DATA binary' or 'DATA binary_compressed'").into());
        };
        let at = Location::Line(line);
        let text = std::str::from_utf8(raw)
            .map_err(|_| Problem::new(format!("the PCD header has a line that is not text: {}", quote(raw))).at(at))?;
        let mut words = text.split_ascii_whitespace();
        let keyword = words.next().unwrap_or("#");
        if keyword.starts_with('#') {
            continue;
        }
        let words: Vec<&str> = words.collect();
        let whole = |word: Option<&&str>| {
            let word = word.copied().unwrap_or("");
            word.parse::<usize>().map_err(|_| {
                let what = format!("the PCD header has {} as its {keyword}", quote(word));
                Problem::new(what).at(at).expected("a whole number")
            })
        };
        match keyword {
            "VERSION" => {}
            "FIELDS" | "COLUMNS" => names = words,
            "SIZE" => sizes = words.iter().map(|w| whole(Some(w))).collect::<Result<_, _>>()?,
            "TYPE" => types = words,
            "COUNT" => counts = words.iter().map(|w| whole(Some(w))).collect::<Result<_, _>>()?,
            "WIDTH" => width = Some(whole(words.first())?),
            "HEIGHT" => height = Some(whole(words.first())?),
            "POINTS" => points = Some(whole(words.first())?),
            "VIEWPOINT" => viewpoint = Some(text.trim_ascii().trim_start_matches("VIEWPOINT").trim_ascii()),
            "DATA" => {
                let encoding = match words.first().copied().unwrap_or("") {
                    "ascii" => Encoding::Text,
                    "binary" => Encoding::Binary,
                    "binary_compressed" => Encoding::Compressed,
                    other => {
                        let problem = Problem::new(format!("the PCD data are {}", quote(other))).at(at);
                        return Err(problem.expected("ascii, binary or binary_compressed").into());
                    }
                };
                break (encoding, line, bytes.len() - lines.rest().len());
            }
            other => {
                let problem = Problem::new(format!("the PCD header has an unknown line {}", quote(other))).at(at);
                return Err(problem
                    .expected("FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS, DATA")
                    .into());
            }
        }
    };
    if names.is_empty() {
        return Err(Problem::new("the PCD header has no FIELDS").expected("'FIELDS x y z' and their like").into());
    }
    let mut fields = Vec::with_capacity(names.len());
    for (i, &name) in names.iter().enumerate() {
        let (size, kind) = (sizes.get(i).copied().unwrap_or(4), types.get(i).copied().unwrap_or("F"));
        let kind = match (kind, size) {
            ("F", 4) => NumberType::F32,
            ("F", 8) => NumberType::F64,
            ("U", 1) => NumberType::U8,
            ("U", 2) => NumberType::U16,
            ("U", 4) => NumberType::U32,
            ("U", 8) => NumberType::U64,
            ("I", 1) => NumberType::I8,
            ("I", 2) => NumberType::I16,
            ("I", 4) => NumberType::I32,
            ("I", 8) => NumberType::I64,
            _ => {
                let what = format!("the PCD field {} has the type {} of {size} bytes", quote(name), quote(kind));
                return Err(Problem::new(what).expected("F of 4 or 8, U or I of 1, 2, 4 or 8").into());
            }
        };
        fields.push(Field { name, kind, count: counts.get(i).copied().unwrap_or(1) });
    }
    let product = width.unwrap_or(0).saturating_mul(height.unwrap_or(1));
    let points = points.unwrap_or(product);
    let point_bytes = fields.iter().map(|f| f.kind.bytes().saturating_mul(f.count)).fold(0, usize::saturating_add);
    if point_bytes == 0 {
        return Err(Problem::new("the PCD header gives its points no numbers").expected("a COUNT of 1").into());
    }
    let image = width.zip(height).filter(|(_, rows)| *rows > 1 && points == product).map(<[usize; 2]>::from);
    Ok(Header { fields, points, image, viewpoint, encoding, point_bytes, line, start })
}

/// Converts points from text to binary numbers, and writes them to `out`.
fn read_text(header: &Header<'_>, body: Bytes<'_>, out: &mut dyn Write) -> Result<(), Fault> {
    let (mut rows, mut data) = (0, Vec::new());
    each_line(body, |line, text| {
        let mut words = words(text).peekable();
        if rows == header.points || words.peek().is_none_or(|w| w.starts_with(b"#")) {
            return Ok(());
        }
        let at = Location::Line(header.line + line);
        data.clear();
        for field in &header.fields {
            for _ in 0..field.count {
                let Some(word) = words.next() else {
                    let problem = Problem::new(format!("point {rows} has too few numbers")).at(at);
                    return Err(problem.expected("as many as the header's FIELDS and COUNT say").into());
                };
                push_word(&mut data, field, word).ok_or_else(|| {
                    Problem::new(format!("found {} as {}", quote(word), quote(field.name)))
                        .at(at)
                        .expected("a number of the header's TYPE")
                })?;
            }
        }
        if words.next().is_some() {
            let problem = Problem::new(format!("point {rows} has too many numbers")).at(at);
            return Err(problem.expected("as many as the header's FIELDS and COUNT say").into());
        }
        rows += 1;
        Ok(out.write_all(&data).map_err(unwritable)?)
    })?;
    if rows < header.points {
        let problem = Problem::new(format!("the file ends after {rows} of {} points", header.points));
        return Err(problem.help("copy or export the file again: it is incomplete").into());
    }
    Ok(())
}

/// Parses a number in text, and appends it as a binary number of the field's type. Returns `None` if the word isn't a
/// number.
fn push_word(data: &mut Vec<u8>, field: &Field<'_>, word: &[u8]) -> Option<()> {
    // Packed colours have the type float, but many programs print their bits as a whole number.
    let packed =
        || std::str::from_utf8(word).ok()?.parse::<u32>().ok().filter(|_| matches!(field.name, "rgb" | "rgba"));
    match field.kind {
        NumberType::F32 => match packed() {
            Some(bits) => data.extend(bits.to_le_bytes()),
            None => data.extend(number_f32(word)?.to_le_bytes()),
        },
        NumberType::F64 => data.extend(number(word)?.to_le_bytes()),
        kind => {
            let value = match std::str::from_utf8(word).ok()?.parse::<i128>() {
                Ok(value) => value,
                // Whole numbers such as 255.0, and nan for missing values.
                Err(_) => number(word)? as i128,
            };
            let bytes = (value as i64).to_le_bytes();
            data.extend(&bytes[..kind.bytes()]);
        }
    }
    Some(())
}

/// Unpacks points that are compressed by LZF to `out`. In the file, the packed and the unpacked size precede the
/// stream. The unpacked size must be `size`, in bytes.
fn decompress(header: &Header<'_>, bytes: Bytes<'_>, size: usize, out: &mut dyn Write) -> Result<(), Fault> {
    let wrong = |what: String| {
        Problem::new(what).at(Location::Byte(header.start)).help("copy or export the file again: it is damaged")
    };
    let sizes = bytes.at_most(header.start, 8);
    let [packed, whole] = sizes.as_chunks::<4>().0 else {
        return Err(wrong("the file ends within the sizes of its compressed points".into()).into());
    };
    let [packed, whole] = [packed, whole].map(|n| u32::from_le_bytes(*n) as usize);
    let start = header.start + 8;
    let there = bytes.len() - start;
    let stream = bytes.part(start..start.saturating_add(packed)).ok_or_else(|| {
        wrong(format!("the file ends {} bytes before the end of its compressed points", packed - there))
    })?;
    if whole != size || size > stream.len().saturating_mul(LZF_EXPANSION) {
        let what = format!("{packed} bytes of compressed points can't become {} points, {size} bytes", header.points);
        return Err(wrong(what).into());
    }
    let damaged = || Fault::from(wrong("its compressed points are damaged".into()));
    lzf(stream.reader(), size, out).map_err(unwritable)?.ok_or_else(damaged)
}

/// Unpacks an LZF stream to exactly `size` bytes; returns `None` if the stream is damaged. The caller has checked
/// `size` against the stream's length.
///
/// A byte n below 32 announces n + 1 literals. Other bytes begin a reference: 3 bits of length, or 7 and another byte
/// of length, and 13 bits of distance.
fn lzf(mut stream: impl Read, size: usize, sink: &mut dyn Write) -> io::Result<Option<()>> {
    const FARTHEST: usize = 1 << 13;
    let mut out = Vec::with_capacity(size.min(64 * FARTHEST));
    let (mut byte, mut written) = ([0], 0);
    while stream.read(&mut byte)? == 1 {
        let control = usize::from(byte[0]);
        if out.len() > 32 * FARTHEST {
            // References reach no farther back.
            let done = out.len() - FARTHEST;
            sink.write_all(&out[..done])?;
            out.drain(..done);
            written += done;
        }
        let (start, left) = (out.len(), size - written - out.len());
        if control < 32 {
            if control + 1 > left {
                return Ok(None);
            }
            out.resize(start + control + 1, 0);
            if stream.read_exact(&mut out[start..]).is_err() {
                return Ok(None);
            }
        } else {
            let mut next = || stream.read_exact(&mut byte).ok().map(|()| usize::from(byte[0]));
            let more = if control >> 5 == 7 { next() } else { Some(0) };
            let (Some(more), Some(last)) = (more, next()) else { return Ok(None) };
            let (length, distance) = (2 + (control >> 5) + more, 1 + ((control & 31) << 8 | last));
            let from = start.checked_sub(distance).filter(|_| length <= left);
            let Some(from) = from else { return Ok(None) };
            if distance >= length {
                out.extend_from_within(from..from + length);
            } else {
                // The source and the destination may overlap.
                for i in from..from + length {
                    out.push(out[i]);
                }
            }
        }
    }
    sink.write_all(&out)?;
    Ok((written + out.len() == size).then_some(()))
}
