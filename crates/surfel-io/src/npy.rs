//! NumPy arrays: one in a `.npy` file, several named ones in an `.npz` file.
//!
//! In a plain array, the last axis contains a point's numbers. Record arrays, and arrays in an `.npz` file, are
//! interpreted by name.

use crate::bytes::Bytes;
use crate::column_roles::{self, Matrix};
use crate::content::Content;
use crate::context::Context;
use crate::depth_image;
use crate::error::{Fault, Location, Problem, list, quote};
use crate::files::pour;
use crate::point_columns::{self, Named, Roles, Source};
use crate::raw_rows;
use crate::strided::{NumberType, Strided, combined};
use crate::zip::{Archive, Content as Member};
use glam::Vec3;
use std::io::Write;
use surfel_model::{Mesh, TableColumn, TableColumns};

/// First bytes of a `.npy` file.
pub(crate) const SIGNATURE: &[u8] = b"\x93NUMPY";
/// Largest number of rows of an array that is recognised as transposed: its rows are coordinates, and its columns are
/// points.
const WIDEST_POINT: usize = 16;
/// Largest number of columns that an array of points may have; wider ones are refused. Of a field of a record, at most
/// this many numbers are read.
const MAX_COLUMNS: usize = 64;
/// Maximum nesting depth of the Python literal in an array's header.
const MAX_DEPTH: usize = 8;
/// Names of the array with positions in an `.npz` file, in order of priority; letter case is ignored.
const POSITIONS: [&str; 20] = [
    "points",
    "positions",
    "position",
    "xyz",
    "vertices",
    "verts",
    "coords",
    "coord",
    "pos",
    "pts",
    "point_cloud",
    "pc",
    "pcd",
    "means",
    "means3d",
    "means_3d",
    "xyzs",
    "points3d",
    "locations",
    "arr_0",
];
const TRIANGLES: [&str; 4] = ["faces", "triangles", "face", "tri"];

/// True if an array of this name contains a mesh's triangles.
fn is_triangles(name: &str) -> bool {
    TRIANGLES.iter().any(|t| name.eq_ignore_ascii_case(t))
}

/// A field of an array's elements, with one or several numbers of one type.
struct Field {
    name: String,
    offset: usize,
    kind: NumberType,
    big_endian: bool,
    count: usize,
}

struct Array<'a> {
    fields: Vec<Field>,
    /// True if the elements are plain numbers, not records. Then `fields` has one field without a name.
    plain: bool,
    item_bytes: usize,
    shape: Vec<usize>,
    fortran: bool,
    data: Bytes<'a>,
    /// Names of fields that aren't read, because their types aren't numeric.
    left_out: Vec<String>,
}

impl Array<'_> {
    /// Returns the number of bytes of all elements, or `None` on overflow.
    fn bytes(&self) -> Option<usize> {
        // Empty axes would hide an overflow of the others.
        self.shape.iter().try_fold(1_usize, |n, &axis| n.checked_mul(axis.max(1)))?;
        self.shape.iter().try_fold(self.item_bytes, |n, &axis| n.checked_mul(axis))
    }
}

/// Reads a `.npy` file.
pub(crate) fn read(bytes: Bytes<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let array = parse(bytes)?;
    let (columns, roles) = columns(&array, context)?;
    let mut content = point_columns::build(columns, &roles, Source::Typed, Vec::new(), context)?;
    if let ([rows, columns, _], false) = (&array.shape[..], array.fortran) {
        depth_image::recognise(&mut content, [*columns, *rows], context);
    }
    Ok(content)
}

/// Returns the columns of the points in an array, and their roles.
fn columns<'a>(array: &Array<'a>, context: &mut Context<'_>) -> Result<(Vec<Named<'a>>, Roles), Fault> {
    note_left_out(&array.left_out, context);
    let mut columns = Vec::new();
    let by_axis = columns_of("", array, &mut columns)?;
    if columns.first().is_none_or(|c| c.values.len() == 0) {
        return Err(Problem::new("holds no point").expected("an array of N×3 numbers or more").into());
    }
    if let Some(names) = context.options.columns.clone() {
        return renamed(columns, &names);
    }
    let roles = if by_axis {
        guess(&mut columns, array, context)?
    } else {
        Roles::by_name(columns.iter().map(|c| c.name.as_str())).ok_or_else(|| no_position(&columns))?
    };
    Ok((columns, roles))
}

/// Returns columns and roles like [`columns`], for a file that is read block by block.
#[cfg(feature = "laz")]
pub(crate) fn columns_in<'a>(bytes: Bytes<'a>, context: &mut Context<'_>) -> Result<(Vec<Named<'a>>, Roles), Fault> {
    columns(&parse(bytes)?, context)
}

/// Size and columns of the points of an array or an archive, read from the start of its file.
#[cfg(feature = "laz")]
pub(crate) struct Surveyed {
    pub(crate) points: u64,
    /// Number of bytes of the array's data, by which a damaged file is recognised; 0 for an archive.
    pub(crate) bytes: u64,
    pub(crate) has_normals: bool,
    /// True if there are enough columns for positions and colours, in addition to normals if there are any.
    pub(crate) has_colors: bool,
}

#[cfg(feature = "laz")]
impl Surveyed {
    fn new<'a>(points: usize, bytes: u64, names: impl Iterator<Item = &'a str> + Clone) -> Self {
        let has_normals = names.clone().any(|name| name == "nx");
        // Three columns are positions; with normals, three more aren't colours.
        let has_colors = names.count() >= if has_normals { 9 } else { 6 };
        Self { points: points as u64, bytes, has_normals, has_colors }
    }
}

/// Reads size and columns of the points of an array from the start of its file. Returns `None` for splats and for other
/// content.
#[cfg(feature = "laz")]
pub(crate) fn survey(head: Bytes<'_>) -> Option<Surveyed> {
    let array = header_of(head).ok()?;
    let (parts, by_axis) = parts("", &array).ok()?;
    let roles = Roles::by_name(parts.iter().map(|part| part.name.as_str()));
    let are_points = by_axis || roles.is_some_and(|roles| !roles.are_splats());
    let names = parts.iter().map(|part| part.name.as_str());
    Some(Surveyed::new(parts.first()?.rows, array.bytes()? as u64, names)).filter(|_| are_points)
}

/// The arrays of an `.npz` archive, with their names.
pub(crate) struct Members<'a>(Vec<(String, Member<'a>)>);

impl<'a> Members<'a> {
    pub(crate) fn of(bytes: Bytes<'a>) -> Result<Self, Fault> {
        let mut archive = Archive::of(bytes)?;
        let names: Vec<_> = archive.names().collect();
        let arrays = names.iter().enumerate().filter_map(|(i, name)| Some((i, name.strip_suffix(".npy")?)));
        let opened = arrays.map(|(index, name)| Ok((name.to_owned(), archive.open(index)?)));
        Ok(Self(opened.collect::<Result<_, Fault>>()?))
    }

    /// Writes the unpacked arrays one after another to `out`. Writes nothing and returns false if all of them are
    /// uncompressed and can be read in place.
    pub(crate) fn unpack(&self, out: &mut dyn Write) -> Result<bool, Fault> {
        if self.0.iter().all(|(_, content)| matches!(content, Member::Stored(_))) {
            return Ok(false);
        }
        for (_, content) in &self.0 {
            match content {
                Member::Stored(bytes) => drop(pour(bytes.reader(), u64::MAX, out)?),
                Member::Deflated(packed) => packed.unpack(out)?,
            }
        }
        Ok(true)
    }

    /// Returns names and bytes of the arrays: in `unpacked`, where [`Self::unpack`] wrote them, or else in the archive.
    fn files<'s, 'b>(&'s self, unpacked: Option<Bytes<'b>>) -> Vec<(&'s str, Bytes<'b>)>
    where
        'a: 'b,
    {
        let mut at = 0;
        let file = |(name, content): &'s (String, Member<'a>)| {
            let start = at;
            at += content.len();
            let stored = if let Member::Stored(bytes) = content { Some(*bytes) } else { None };
            let bytes = unpacked.map_or(stored, |unpacked| unpacked.part(start..at));
            Some((name.as_str(), bytes?))
        };
        self.0.iter().filter_map(file).collect()
    }

    /// Returns the columns of the points and their roles; `None` for a mesh. `unpacked` is what [`Self::unpack`] wrote,
    /// if it did.
    #[cfg(feature = "laz")]
    pub(crate) fn columns<'b>(
        &self,
        unpacked: Option<Bytes<'b>>,
        context: &mut Context<'_>,
    ) -> Result<Option<(Vec<Named<'b>>, Roles)>, Fault>
    where
        'a: 'b,
    {
        let (columns, roles, triangles) = archive_columns(&self.files(unpacked), context)?;
        Ok(triangles.is_none().then_some((columns, roles)))
    }

    /// Reads size and columns of the points of an archive from the starts of its arrays. Returns `None` for splats and
    /// meshes, for more than 1000 arrays, and if no array is recognised as positions.
    #[cfg(feature = "laz")]
    pub(crate) fn survey(&self) -> Option<Surveyed> {
        const HEAD_BYTES: usize = 1 << 12;
        const MAX_ARRAYS: usize = 1000;
        if self.0.len() > MAX_ARRAYS {
            return None;
        }
        let head = |content: &Member<'a>| match content {
            Member::Stored(bytes) => bytes.at_most(0, HEAD_BYTES).into_owned(),
            Member::Deflated(packed) => packed.head(HEAD_BYTES),
        };
        let heads: Vec<Vec<u8>> = self.0.iter().map(|(_, content)| head(content)).collect();
        let mut arrays = Vec::new();
        for ((name, content), head) in self.0.iter().zip(&heads) {
            let array = header_of(Bytes::Memory(head)).ok();
            arrays.extend(array.filter(|a| a.bytes().is_some_and(|n| n <= content.len())).map(|a| (name.as_str(), a)));
        }
        let (name, array) = &arrays[main_array(&arrays)?];
        let (main, _) = parts(if array.shape.len() > 1 { "" } else { name }, array).ok()?;
        let others = arrays.iter().filter_map(|(name, array)| Some(parts(name, array).ok()?.0)).flatten();
        let names: Vec<String> = ["x", "y", "z"].map(str::to_owned).into_iter().chain(others.map(|p| p.name)).collect();
        let are_splats = Roles::by_name(names.iter().map(String::as_str)).is_some_and(|roles| roles.are_splats());
        let is_mesh = arrays.iter().any(|(name, _)| is_triangles(name));
        // The first three names are those of the positions, which are among the arrays, too.
        let surveyed = Surveyed::new(main.first()?.rows, 0, names[3..].iter().map(String::as_str));
        Some(surveyed).filter(|_| !are_splats && !is_mesh)
    }
}

/// Reads an `.npz` archive.
pub(crate) fn read_archive(bytes: Bytes<'_>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let (members, mut unpacked) = (Members::of(bytes)?, Vec::new());
    let is_unpacked = members.unpack(&mut unpacked)?;
    let files = members.files(is_unpacked.then_some(Bytes::Memory(&unpacked)));
    let (columns, roles, triangles) = archive_columns(&files, context)?;
    match triangles {
        Some(array) => mesh(columns, &roles, &array, context),
        None => point_columns::build(columns, &roles, Source::Typed, Vec::new(), context),
    }
}

/// Returns the index of the array with the positions, or with their x coordinates, among the arrays of an archive.
/// Without a known name, the only array of N×3 to N×16 numbers counts as positions. Returns `None` if no array is
/// recognised as positions.
fn main_array(arrays: &[(&str, Array<'_>)]) -> Option<usize> {
    let find = |names: &[&str]| {
        names
            .iter()
            .find_map(|n| arrays.iter().position(|(name, a)| name.eq_ignore_ascii_case(n) && !a.shape.is_empty()))
    };
    let main = find(&POSITIONS).or_else(|| arrays.iter().position(|(n, _)| n.eq_ignore_ascii_case("x")));
    main.or_else(|| {
        let is_likely =
            |(name, array): &(&str, Array<'_>)| matches!(array.shape[..], [_, 3..=16]) && !is_triangles(name);
        let mut likely = (0..arrays.len()).filter(|&i| is_likely(&arrays[i]));
        likely.next().filter(|_| likely.next().is_none())
    })
}

/// Returns the columns of the points in an archive, their roles, and the triangles of a mesh if there is one.
fn archive_columns<'a>(
    files: &[(&str, Bytes<'a>)],
    context: &mut Context<'_>,
) -> Result<(Vec<Named<'a>>, Roles, Option<Array<'a>>), Fault> {
    let (mut arrays, mut ignored, mut first_fault) = (Vec::new(), Vec::new(), None);
    for (name, bytes) in files {
        match parse(*bytes) {
            Ok(array) => arrays.push((*name, array)),
            // Unreadable arrays are mostly text and Python objects; the other arrays are still useful.
            Err(fault) => {
                ignored.push(name.to_string());
                first_fault = first_fault.or(Some(fault));
            }
        }
    }
    let main = main_array(&arrays);
    let Some(main) = main else {
        if let Some(fault) = first_fault {
            return Err(fault);
        }
        let found = list(&files.iter().map(|f| f.0).collect::<Vec<_>>());
        let problem = Problem::new(format!("has no array of positions among {found}"));
        return Err(problem.expected("an array named points, positions or xyz, N×3; or x, y and z").into());
    };
    let mut columns = Vec::new();
    let (name, array) = &arrays[main];
    let by_axis = columns_of(if array.shape.len() > 1 { "" } else { name }, array, &mut columns)?;
    let rows = columns.first().map_or(0, |c| c.values.len());
    if rows == 0 {
        return Err(Problem::new("holds no point").expected("an array of N×3 numbers or more").into());
    }
    if let Some(names) = context.options.columns.clone() {
        columns = renamed(columns, &names)?.0;
    } else if by_axis {
        guess(&mut columns, &arrays[main].1, context)?;
    }
    let mut triangles = None;
    for (i, (name, array)) in arrays.iter().enumerate() {
        let first = columns.len();
        if i == main {
            continue;
        }
        if is_triangles(name) && matches!(array.shape[..], [_, 3]) && array.plain {
            triangles = Some(i);
            continue;
        }
        let per_point = columns_of(name, array, &mut columns).is_ok()
            && columns[first..].iter().all(|c| c.values.len() == rows && !c.name.is_empty());
        if !per_point {
            columns.truncate(first);
            ignored.push(name.to_string());
        }
        note_left_out(&array.left_out, context);
    }
    if !ignored.is_empty() {
        let what = list(&ignored);
        context.note(format!("ignored the arrays {what}: they don't hold numbers, as many as there are points"));
    }
    let roles = Roles::by_name(columns.iter().map(|c| c.name.as_str())).ok_or_else(|| no_position(&columns))?;
    Ok((columns, roles, triangles.map(|i| arrays.swap_remove(i).1)))
}

fn mesh(
    columns: Vec<Named<'_>>,
    roles: &Roles,
    triangles: &Array<'_>,
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let mut corners = Vec::new();
    columns_of("", triangles, &mut corners)?;
    let index = |i: f64| if i >= 0.0 && i.fract() == 0.0 && i < f64::from(u32::MAX) { i as u32 } else { u32::MAX };
    let triangles = combined([0, 1, 2].map(|corner| corners[corner].values), |row: [f64; 3]| row.map(index));
    let content = point_columns::build(columns, roles, Source::Typed, Vec::new(), context)?;
    let Content::Points(points) = content else { return Ok(content) };
    context.mesh(Mesh {
        origin: points.origin,
        positions: points.positions,
        triangles,
        normals: points.normals.map(|n| n.high().iter().map(Vec3::to_array).collect()),
        colors: points.colors,
        alphas: points.alphas,
        vertex_extras: points.extras,
        ..Mesh::default()
    })
}

fn note_left_out(names: &[String], context: &mut Context<'_>) {
    if !names.is_empty() {
        context.note(format!("left out the fields {}: they aren't numbers", list(names)));
    }
}

fn no_position(columns: &[Named<'_>]) -> Problem {
    let names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
    Problem::new(format!("its points have no position: they have {}", list(&names))).expected("fields x, y and z")
}

/// Renames columns to the names that the caller gives, and returns their roles.
fn renamed<'a>(columns: Vec<Named<'a>>, names: &TableColumns) -> Result<(Vec<Named<'a>>, Roles), Fault> {
    raw_rows::check(names)?;
    if names.is_typed() {
        let problem = Problem::new("states the types of its numbers, and `columns` gives types");
        return Err(problem.expected("names alone, such as x,y,z,intensity").into());
    }
    if names.columns().len() != columns.len() {
        return Err(raw_rows::wrong_count(columns.len(), names).into());
    }
    let named = columns.into_iter().zip(names.columns());
    let named = named.filter_map(|(column, TableColumn { name, .. })| {
        Some(Named { name: raw_rows::canonical_name(name.as_deref()?), ..column })
    });
    let columns: Vec<Named<'a>> = named.collect();
    let roles = Roles::by_name(columns.iter().map(|c| c.name.as_str())).ok_or_else(|| no_position(&columns))?;
    Ok((columns, roles))
}

/// Formats an array's shape for messages, as `100×3`.
fn shape_words(shape: &[usize]) -> String {
    shape.iter().map(usize::to_string).collect::<Vec<_>>().join("×")
}

/// Returns the problem of an array that isn't a table of points. `is` describes the array and follows its shape.
fn no_table(shape: &[usize], is: &str) -> Problem {
    let problem = Problem::new(format!("is an array of {} numbers{is}", shape_words(shape)));
    problem.expected("N×3, N×6 or their like: a row for each point")
}

/// Returns the problem of a transposed array, whose rows are coordinates instead of points.
fn transposed(shape: &[usize]) -> Problem {
    let help = "transpose it: numpy.save('points.npy', points.T)";
    no_table(shape, ", which is transposed: it has more columns than rows").help(help)
}

fn guess(columns: &mut [Named<'_>], array: &Array<'_>, context: &mut Context<'_>) -> Result<Roles, Fault> {
    let shape = &array.shape;
    if columns.len() < 3 || columns.len() > MAX_COLUMNS {
        return Err(no_table(shape, "").into());
    }
    let values: Vec<Strided<'_>> = columns.iter().map(|c| c.values).collect();
    if let Some(problem) = not_points(&values, array) {
        return Err(problem.into());
    }
    let (roles, reasons) = Roles::by_content(columns, &[])?;
    let has_unknown = columns.iter().any(|c| c.name.starts_with("column_"));
    if shape.len() == 2 && shape[0] == 3 && columns.len() > 3 && has_unknown {
        return Err(transposed(shape).into());
    }
    let names: Vec<&str> = columns.iter().map(|c| c.name.as_str()).collect();
    if columns.len() > 3 || shape.len() != 2 || shape[0] == columns.len() || !reasons.is_empty() {
        let what = format!("took the array of {} as points with the columns {}", shape_words(shape), list(&names));
        context.note(column_roles::as_note(&what, &reasons));
    }
    Ok(roles)
}

/// Returns the problem of an array that contains images or matrices instead of points, if it does.
fn not_points(columns: &[Strided<'_>], array: &Array<'_>) -> Option<Problem> {
    const SIDE: usize = 8;
    let shape = &array.shape[..];
    if let [.., height @ (3 | 4), _] = *shape
        && let Some(kind) = column_roles::matrix_kind(columns, height, array.fortran && shape.len() > 2)
    {
        return Some(match kind {
            Matrix::Poses => no_table(shape, ", which are camera poses")
                .help("the cameras' centres are points: numpy.save('points.npy', poses[..., :3, 3])"),
            Matrix::Intrinsics => no_table(shape, ", which are cameras' intrinsics"),
        });
    }
    let image = || no_table(shape, ", an image").help("surfel draws points, not images: unproject a depth image first");
    if let [.., height, width, 3 | 4] = *shape
        && height >= SIDE
        && width >= SIDE
        && (array.fields.iter().all(|field| matches!(field.kind, NumberType::U8 | NumberType::U16))
            || column_roles::are_image_colors(&columns[..3]))
    {
        return Some(image());
    }
    column_roles::is_image(columns).then(image)
}

/// Place of a column in an array's data: byte offset and stride, number of rows, and the field with its number type.
struct Part<'f> {
    name: String,
    offset: usize,
    stride: usize,
    rows: usize,
    field: &'f Field,
}

/// Appends the columns of an array to `columns`. Returns true if the columns have no names, so that their order states
/// their roles. Returns false if their names do.
fn columns_of<'a>(array_name: &str, array: &Array<'a>, columns: &mut Vec<Named<'a>>) -> Result<bool, Fault> {
    let (parts, by_axis) = parts(array_name, array)?;
    for Part { name, offset, stride, rows, field } in parts {
        let offset = if rows == 0 { 0 } else { offset };
        let values = Strided::new(array.data, offset, stride, rows, field.kind, field.big_endian);
        let values = values.ok_or_else(|| Problem::new("the array's numbers lie outside of the file"))?;
        columns.push(Named { name, values });
    }
    Ok(by_axis)
}

/// Returns the columns into which an array is split. Also returns true if the columns have no names, so that their
/// order states their roles; false if their names do.
fn parts<'f>(array_name: &str, array: &'f Array<'_>) -> Result<(Vec<Part<'f>>, bool), Fault> {
    let total: usize = array.shape.iter().product();
    let positions = POSITIONS.iter().any(|p| array_name.eq_ignore_ascii_case(p)) || array_name.is_empty();
    let field = match &array.fields[..] {
        [field] if array.plain => field,
        fields => {
            let part = |field: &'f Field, i: usize, name| {
                let offset = field.offset + i * field.kind.bytes();
                Part { name, offset, stride: array.item_bytes, rows: total, field }
            };
            let parts = |field: &'f Field| {
                let names = expanded(&field.name, field.count.min(MAX_COLUMNS));
                names.into_iter().enumerate().map(move |(i, name)| part(field, i, name))
            };
            return Ok((fields.iter().flat_map(parts).collect(), false));
        }
    };
    let n = field.kind.bytes();
    let (rows, width) = match array.shape[..] {
        [] | [_] => (total, 1),
        [.., few @ 3..=WIDEST_POINT, many] if positions && many > WIDEST_POINT.max(few) => {
            return Err(transposed(&array.shape).into());
        }
        [.., last] => (total.checked_div(last).unwrap_or(0), last),
    };
    if width > MAX_COLUMNS {
        return Err(no_table(&array.shape, "").into());
    }
    // In Fortran order, numbers along the first axis are consecutive.
    let together = !array.fortran;
    let unnamed = positions && (width > 1 || array_name.is_empty());
    let names = if unnamed { vec![String::new(); width] } else { expanded(array_name, width) };
    let part = |(i, name)| {
        let (offset, stride) = if together { (i * n, width * n) } else { (i * rows * n, n) };
        Part { name, offset, stride, rows, field }
    };
    Ok((names.into_iter().enumerate().map(part).collect(), unnamed))
}

/// Returns names for the `count` numbers of a field or array: `normals` of three become nx, ny and nz. Numbers of
/// unknown fields get the endings `_0`, `_1` and so on.
fn expanded(name: &str, count: usize) -> Vec<String> {
    let lower = name.to_ascii_lowercase();
    let known: &[&str] = match (lower.as_str(), count) {
        (_, 1) => return vec![name.to_owned()],
        (name, 3) if POSITIONS.contains(&name) => &["x", "y", "z"],
        ("normal" | "normals" | "n" | "nrm" | "nxyz", 3) => &["nx", "ny", "nz"],
        ("color" | "colors" | "colour" | "colours" | "rgb" | "rgba" | "vertex_colors", 3 | 4) => {
            &["red", "green", "blue", "alpha"][..count]
        }
        _ => return (0..count).map(|i| format!("{name}_{i}")).collect(),
    };
    known.iter().map(|&n| n.to_owned()).collect()
}

fn parse(bytes: Bytes<'_>) -> Result<Array<'_>, Fault> {
    let array = header_of(bytes)?;
    if array.bytes().is_none_or(|n| n > array.data.len()) {
        return Err(too_few_bytes(&array));
    }
    Ok(array)
}

fn too_few_bytes(array: &Array<'_>) -> Fault {
    let (found, shape, item) = (array.data.len(), shape_words(&array.shape), array.item_bytes);
    let what = format!("the file has {found} bytes for an array of {shape} elements of {item} bytes");
    Problem::new(what).help("copy or save the file again: it is incomplete").into()
}

/// Parses an array's header; doesn't check that the data are complete.
fn header_of(bytes: Bytes<'_>) -> Result<Array<'_>, Fault> {
    let wrong = |what: String| Problem::new(what).help("save it again by numpy.save");
    let cut = || wrong("the array's header ends too early".into());
    let head = bytes.at_most(0, SIGNATURE.len() + 6);
    let rest = head.strip_prefix(SIGNATURE).ok_or_else(|| wrong("is no array of NumPy".into()))?;
    let ([major, _], rest) = rest.split_first_chunk::<2>().ok_or_else(cut)?;
    let length = match major {
        1 => rest.first_chunk().map(|n| usize::from(u16::from_le_bytes(*n))),
        2 | 3 => rest.first_chunk().map(|n| u32::from_le_bytes(*n) as usize),
        _ => return Err(wrong(format!("is an array of NumPy's format {major}")).expected("1, 2 or 3").into()),
    }
    .ok_or_else(cut)?;
    let start = SIGNATURE.len() + if *major == 1 { 4 } else { 6 };
    let body = start.checked_add(length).filter(|end| *end <= bytes.len()).ok_or_else(cut)?;
    let header = bytes.at_most(start, length);
    let data = bytes.part(body..bytes.len()).ok_or_else(cut)?;
    let unreadable = || {
        let location = Location::Byte(start);
        Fault::from(wrong(format!("the array's header is {}", quote(header.trim_ascii()))).at(location))
    };
    let mut parser = Parser { text: &header, depth: 0 };
    let Some(Literal::Dict(entries)) = parser.literal() else { return Err(unreadable()) };
    let entry = |name: &str| entries.iter().find(|(key, _)| matches!(key, Literal::Text(t) if t == name)).map(|e| &e.1);
    let (Some(Literal::Bool(fortran)), Some(Literal::List(shape))) = (entry("fortran_order"), entry("shape")) else {
        return Err(unreadable());
    };
    let shape: Option<Vec<usize>> = shape.iter().map(Literal::size).collect();
    let shape = shape.ok_or_else(unreadable)?;
    let mut array =
        Array { fields: Vec::new(), plain: false, item_bytes: 0, shape, fortran: *fortran, data, left_out: Vec::new() };
    match entry("descr") {
        Some(Literal::Text(text)) => {
            let (kind, bytes, big_endian) = number_type(text).ok_or_else(unreadable)?;
            let Some(kind) = kind else {
                let problem = Problem::new(format!("is an array of NumPy's type {}", quote(text)));
                let help = "save numbers, such as points.astype('float32')";
                return Err(problem.expected("whole or real numbers").help(help).into());
            };
            array.plain = true;
            array.item_bytes = bytes;
            array.fields.push(Field { name: String::new(), offset: 0, kind, big_endian, count: 1 });
        }
        Some(Literal::List(fields)) => add_fields(&mut array, fields).ok_or_else(unreadable)?,
        _ => return Err(unreadable()),
    }
    if array.bytes().is_none() {
        return Err(too_few_bytes(&array));
    }
    Ok(array)
}

/// Appends the fields of a record type to `array`. In the header they are tuples of name, type and perhaps a shape.
/// Returns `None` if a field is invalid.
fn add_fields(array: &mut Array<'_>, fields: &[Literal]) -> Option<()> {
    for field in fields {
        let Literal::List(parts) = field else { return None };
        let (name, kind, shape) = match &parts[..] {
            [name, kind] => (name, kind, None),
            [name, kind, Literal::List(shape)] => (name, kind, Some(shape)),
            _ => return None,
        };
        let name = match name {
            Literal::Text(name) => name.clone(),
            // A title and a name.
            Literal::List(both) => match &both[..] {
                [_, Literal::Text(name)] => name.clone(),
                _ => return None,
            },
            _ => return None,
        };
        let count =
            shape.map_or(Some(1), |axes| axes.iter().try_fold(1_usize, |n, axis| n.checked_mul(axis.size()?)))?;
        let Literal::Text(kind) = kind else { return None };
        let (kind, bytes, big_endian) = number_type(kind)?;
        let offset = array.item_bytes;
        array.item_bytes = offset.checked_add(bytes.checked_mul(count)?)?;
        match kind {
            Some(kind) => array.fields.push(Field { name, offset, kind, big_endian, count }),
            // Padding has no name.
            None if name.is_empty() => {}
            None => array.left_out.push(name),
        }
    }
    Some(())
}

/// Parses NumPy's type string, such as `<f4`. Returns the type (`None` if it isn't numeric), its size in bytes, and
/// true if it is big endian. Returns `None` if the string is invalid.
fn number_type(text: &str) -> Option<(Option<NumberType>, usize, bool)> {
    let mut chars = text.chars();
    let order = chars.next()?;
    let (order, letter) = if "<>|=".contains(order) { (order, chars.next()?) } else { ('=', order) };
    let size: String = chars.take_while(char::is_ascii_digit).collect();
    let size: usize = if size.is_empty() { usize::from(letter == '?') } else { size.parse().ok()? };
    let kind = match (letter, size) {
        ('b', 1) | ('u', 1) | ('?', 1) => Some(NumberType::U8),
        ('i', 1) => Some(NumberType::I8),
        ('i', 2) => Some(NumberType::I16),
        ('u', 2) => Some(NumberType::U16),
        ('i', 4) => Some(NumberType::I32),
        ('u', 4) => Some(NumberType::U32),
        ('i', 8) => Some(NumberType::I64),
        ('u', 8) => Some(NumberType::U64),
        ('f', 2) => Some(NumberType::F16),
        ('f', 4) => Some(NumberType::F32),
        ('f', 8) => Some(NumberType::F64),
        _ => None,
    };
    // Characters take four bytes each, object references eight.
    let bytes = match letter {
        'U' => size.checked_mul(4)?,
        'O' => 8,
        _ => size,
    };
    Some((kind, bytes, order == '>'))
}

/// A Python literal in the header of an array.
enum Literal {
    Text(String),
    Size(usize),
    Bool(bool),
    None,
    /// A list or tuple.
    List(Vec<Literal>),
    Dict(Vec<(Literal, Literal)>),
}

impl Literal {
    fn size(&self) -> Option<usize> {
        if let Self::Size(n) = self { Some(*n) } else { None }
    }
}

struct Parser<'a> {
    text: &'a [u8],
    depth: usize,
}

impl Parser<'_> {
    fn peek(&mut self) -> Option<u8> {
        self.text = self.text.trim_ascii_start();
        self.text.first().copied()
    }

    fn take(&mut self, byte: u8) -> bool {
        let found = self.peek() == Some(byte);
        self.text = &self.text[usize::from(found)..];
        found
    }

    fn word(&mut self, word: &[u8]) -> bool {
        let rest = self.text.strip_prefix(word);
        self.text = rest.unwrap_or(self.text);
        rest.is_some()
    }

    fn literal(&mut self) -> Option<Literal> {
        match self.peek()? {
            quote @ (b'\'' | b'"') => {
                let end = 1 + self.text[1..].iter().position(|&b| b == quote)?;
                let text = String::from_utf8_lossy(&self.text[1..end]).into_owned();
                self.text = &self.text[end + 1..];
                Some(Literal::Text(text))
            }
            b'0'..=b'9' => {
                let end = self.text.iter().position(|b| !b.is_ascii_digit()).unwrap_or(self.text.len());
                let size = std::str::from_utf8(&self.text[..end]).ok()?.parse().ok()?;
                self.text = &self.text[end..];
                // Python 2 wrote long integers with this suffix.
                self.word(b"L");
                Some(Literal::Size(size))
            }
            b'T' => self.word(b"True").then_some(Literal::Bool(true)),
            b'F' => self.word(b"False").then_some(Literal::Bool(false)),
            b'N' => self.word(b"None").then_some(Literal::None),
            open @ (b'(' | b'[' | b'{') => {
                self.depth += 1;
                if self.depth > MAX_DEPTH {
                    return None;
                }
                let close = match open {
                    b'(' => b')',
                    b'[' => b']',
                    _ => b'}',
                };
                self.text = &self.text[1..];
                let (mut items, mut entries) = (Vec::new(), Vec::new());
                while !self.take(close) {
                    let item = self.literal()?;
                    if open == b'{' {
                        let value = if self.take(b':') { self.literal()? } else { return None };
                        entries.push((item, value));
                    } else {
                        items.push(item);
                    }
                    if !self.take(b',') && self.peek() != Some(close) {
                        return None;
                    }
                }
                self.depth -= 1;
                Some(if open == b'{' { Literal::Dict(entries) } else { Literal::List(items) })
            }
            _ => None,
        }
    }
}
