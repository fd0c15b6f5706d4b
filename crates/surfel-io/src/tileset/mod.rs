//! 3D Tiles 1.0 and 1.1 (OGC 18-053r2, 22-025r4): the points of a tileset's finest tiles as one cloud. Tiles are glTF
//! or `pnts`; tiles without points, such as those of triangles, are dropped.

mod earth;
mod pnts;

use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem, quote};
use crate::gathered_points::{GatheredPoints, PointsPart};
use crate::gltf::{self, uri};
use crate::scene_file::json_problem;
use glam::{DAffine3, DMat3, DMat4, DVec3};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// Maximum depth to which tilesets may refer to one another; a deeper reference is an error.
const MAX_DEPTH: usize = 32;
/// Maximum number of tiles that are read; more are an error.
const MAX_TILES: usize = 1 << 20;
/// Maximum number of points of all tiles together; more are an error.
const MAX_POINTS: usize = 1 << 30;

/// The parts of a tileset's JSON that are read.
#[derive(Deserialize)]
struct Tileset {
    asset: Asset,
    root: Tile,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Asset {
    /// Up axis of glTF tiles, "X", "Y" or "Z", in files from before 3D Tiles 1.0.
    gltf_up_axis: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Tile {
    bounding_volume: Option<BoundingVolume>,
    transform: Option<[f64; 16]>,
    refine: Option<String>,
    content: Option<Reference>,
    #[serde(default)]
    contents: Vec<Reference>,
    #[serde(default)]
    children: Vec<Tile>,
    implicit_tiling: Option<IgnoredAny>,
}

#[derive(Deserialize)]
struct BoundingVolume {
    /// Centre of a box and its three half-axes, each as x, y and z.
    #[serde(rename = "box")]
    cuboid: Option<[f64; 12]>,
}

#[derive(Deserialize)]
struct Reference {
    /// URI of a tile's content, called `url` before 3D Tiles 1.0.
    #[serde(alias = "url")]
    uri: String,
}

/// Properties that every tileset has, by which a tileset is recognised.
#[derive(Deserialize)]
struct TilesetProbe {
    #[serde(rename = "asset")]
    _asset: IgnoredAny,
    #[serde(rename = "geometricError")]
    _geometric_error: IgnoredAny,
    #[serde(rename = "root")]
    _root: IgnoredAny,
}

/// True if the bytes are the JSON of a tileset.
pub(crate) fn looks_like(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"{") && serde_json::from_slice::<TilesetProbe>(bytes).is_ok()
}

/// Reads the points of a tileset's finest tiles, and of the coarser tiles to which they are added. Takes all glTF tiles
/// as z-up, with a note, if more of their points are then inside their tiles' boxes than with y up.
pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut walk = Walk {
        context,
        parts: Vec::new(),
        points: 0,
        tiles: 0,
        inside_as_stored: 0,
        inside_turned: 0,
        skipped: Skipped::default(),
    };
    walk.tileset(bytes, &Place::default(), 0)?;
    let z_up = walk.inside_as_stored > walk.inside_turned;
    let Walk { parts, tiles, skipped, .. } = walk;
    skipped.tell(tiles, context);
    if z_up {
        context.note("took glTF tiles as z-up, since only so they lie within their bounding boxes".into());
    }
    let mut points = GatheredPoints::default();
    for (mut part, world_from_gltf) in parts {
        if let Some(world_from_tile) = world_from_gltf {
            part.place(if z_up { world_from_tile } else { world_from_tile * z_up_from_y_up() });
        }
        points.add(part);
    }
    finish(points, context)
}

/// Reads a file that is a single `pnts` tile.
pub(crate) fn read_pnts(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mut points = GatheredPoints::default();
    points.add(pnts::read(bytes, DAffine3::IDENTITY)?);
    finish(points, context)
}

fn finish(mut points: GatheredPoints, context: &mut Context<'_>) -> Result<Content, Fault> {
    if points.positions.is_empty() {
        let problem = Problem::new("holds no points").expected("tiles of points, as glTF or pnts");
        return Err(problem.help("open its tiles of triangles (GLB) one by one").into());
    }
    points.note_rounding(context);
    if let Some(earth) = earth::Horizon::of(&points.positions) {
        points.turn(earth.center, earth.local_from_earth);
        context.note(earth.to_string());
    }
    points.finish(context)
}

/// Properties that a tile inherits from its ancestors: transform, folder, refinement rule and up axis.
#[derive(Clone, Default)]
struct Place {
    world_from_tile: DAffine3,
    /// Folder of the tileset that contains the tile, relative to that of the first tileset; empty, or with a slash at
    /// its end.
    folder: String,
    /// True if a tile's children are drawn in addition to it instead of replacing it.
    adds: bool,
    /// True if the glTF tiles of this tileset have z up, as the tileset states.
    z_up: bool,
}

/// Numbers of tiles that were skipped, for notes.
#[derive(Default)]
struct Skipped {
    triangles: usize,
    missing: usize,
    first_missing: Option<String>,
}

impl Skipped {
    fn tell(self, tiles: usize, context: &mut Context<'_>) {
        context.note(format!("read the {tiles} finest tiles"));
        if self.triangles > 0 {
            context.note(format!("left out {} tiles that hold no points", self.triangles));
        }
        if let Some(first) = self.first_missing {
            context.note(format!("left out {} tiles that can't be read; the first was {first}", self.missing));
        }
    }
}

struct Walk<'a, 'b> {
    context: &'a mut Context<'b>,
    /// Points of the tiles read so far. Points of glTF tiles stay in glTF coordinates until their up axis is known;
    /// their world-from-tile transform is stored beside them. It is `None` for points that are in world space already.
    parts: Vec<(PointsPart, Option<DAffine3>)>,
    points: usize,
    tiles: usize,
    /// Number of points of glTF tiles that are inside their tile's box as stored.
    inside_as_stored: usize,
    /// Number of points of glTF tiles that are inside their tile's box after rotation from y-up to z-up.
    inside_turned: usize,
    skipped: Skipped,
}

impl Walk<'_, '_> {
    fn tileset(&mut self, bytes: &[u8], place: &Place, depth: usize) -> Result<(), Fault> {
        if depth > MAX_DEPTH {
            let what = format!("more than {MAX_DEPTH} tilesets lie within one another");
            return Err(Problem::new(what).expected("no tileset within itself").into());
        }
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let tileset: Tileset = serde_json::from_slice(bytes).map_err(|e| json_problem(&e))?;
        let z_up = tileset.asset.gltf_up_axis.is_some_and(|axis| axis.eq_ignore_ascii_case("z"));
        self.tile(&tileset.root, &Place { z_up, ..place.clone() }, depth).map(|_| ())
    }

    /// Reads the finest tiles of a tile's subtree, and the coarser ones to which they are added. Returns false if the
    /// subtree has no content.
    fn tile(&mut self, tile: &Tile, parent: &Place, depth: usize) -> Result<bool, Fault> {
        if tile.implicit_tiling.is_some() {
            let problem = Problem::new("has implicit tiling, which is not read");
            return Err(problem.expected("tiles that are listed one by one").into());
        }
        let parent_from_tile =
            tile.transform.map_or(DAffine3::IDENTITY, |m| DAffine3::from_mat4(DMat4::from_cols_array(&m)));
        let place = Place {
            world_from_tile: parent.world_from_tile * parent_from_tile,
            adds: tile.refine.as_ref().map_or(parent.adds, |refine| refine.eq_ignore_ascii_case("add")),
            ..parent.clone()
        };
        let mut any = false;
        for child in &tile.children {
            any |= self.tile(child, &place, depth)?;
        }
        if any && !place.adds {
            return Ok(true);
        }
        for reference in tile.content.iter().chain(&tile.contents) {
            let cuboid = tile.bounding_volume.as_ref().and_then(|volume| volume.cuboid);
            self.content(&reference.uri, cuboid, &place, depth)?;
            any = true;
        }
        Ok(any)
    }

    fn content(&mut self, uri: &str, cuboid: Option<[f64; 12]>, place: &Place, depth: usize) -> Result<(), Fault> {
        self.tiles += 1;
        if self.tiles > MAX_TILES {
            return Err(Problem::new(format!("has more than {MAX_TILES} tiles")).into());
        }
        let path = format!("{}{}", place.folder, uri.split(['?', '#']).next().unwrap_or(uri));
        let read = uri::read(&path, &self.context.siblings).map_err(|why| {
            let help = "keep its tiles where they are; `repair` leaves out what is missing";
            Fault::from(Problem::new(format!("can't read the tile {}: {why}", quote(&path))).help(help))
        });
        let result =
            read.and_then(|bytes| self.bytes(&bytes, &path, cuboid, place, depth).map_err(|f| f.within(&path)));
        match result {
            Err(_) if self.context.options.repair => {
                self.skipped.missing += 1;
                self.skipped.first_missing.get_or_insert_with(|| quote(&path));
                self.tiles -= 1;
                Ok(())
            }
            other => other,
        }
    }

    fn bytes(
        &mut self,
        bytes: &[u8],
        path: &str,
        cuboid: Option<[f64; 12]>,
        place: &Place,
        depth: usize,
    ) -> Result<(), Fault> {
        let folder = path.rfind('/').map_or("", |slash| &path[..=slash]);
        let part = if bytes.starts_with(b"pnts") {
            (pnts::read(bytes, place.world_from_tile)?, None)
        } else if bytes.starts_with(b"glTF") || (path.ends_with(".gltf") && !looks_like(bytes)) {
            match gltf::read_points(bytes, folder, self.context)? {
                Some(mut part) if place.z_up => {
                    part.place(place.world_from_tile);
                    (part, None)
                }
                Some(part) => {
                    self.compare(&part, cuboid);
                    (part, Some(place.world_from_tile))
                }
                None => {
                    self.leave_out();
                    return Ok(());
                }
            }
        } else if looks_like(bytes) {
            self.tiles -= 1;
            return self.tileset(bytes, &Place { folder: folder.to_owned(), ..place.clone() }, depth + 1);
        } else {
            self.leave_out();
            return Ok(());
        };
        self.points = self.points.saturating_add(part.0.positions.len());
        if self.points > MAX_POINTS {
            return Err(Problem::new(format!("has more than {MAX_POINTS} points")).into());
        }
        self.parts.push(part);
        Ok(())
    }

    fn leave_out(&mut self) {
        self.tiles -= 1;
        self.skipped.triangles += 1;
    }

    /// Counts the points that are inside their tile's box (`cuboid`), as stored and after rotation from y-up to z-up.
    /// glTF is y-up and tilesets are z-up, so tiles must be rotated (3D Tiles 1.1, "glTF transforms"). Some programs
    /// write tiles that are already z-up, which the counts reveal.
    fn compare(&mut self, part: &PointsPart, cuboid: Option<[f64; 12]>) {
        let Some(cuboid) = cuboid else { return };
        let turn = z_up_from_y_up();
        for &p in &part.positions {
            self.inside_as_stored += usize::from(within(&cuboid, p));
            self.inside_turned += usize::from(within(&cuboid, turn.transform_point3(p)));
        }
    }
}

/// Returns the quarter turn about the x axis that rotates glTF's y-up to z-up.
fn z_up_from_y_up() -> DAffine3 {
    DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y))
}

/// True if a point is inside a tile's box. The box is enlarged on each side by a hundredth of its half-diagonal,
/// because boxes are rounded. It is unlimited along half-axes of length 0.
fn within(cuboid: &[f64; 12], point: DVec3) -> bool {
    let axis = |i: usize| DVec3::from_slice(&cuboid[3 * i..]);
    let to = point - axis(0);
    let slack = (axis(1) + axis(2) + axis(3)).length() * 0.01;
    (1..4).all(|i| {
        let half = axis(i).length();
        half == 0.0 || (to.dot(axis(i)) / half).abs() <= half + slack
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tileset_is_told_from_scene_and_gltf() {
        assert!(looks_like(br#" {"root":{"x":[1,{"y":2}]},"asset":{"version":"1.1"},"geometricError":3}"#));
        for other in [&br#"{"asset":{"version":"2.0"},"scenes":[]}"#[..], b"{\"objects\":[]}", b"{", b"", b"[]"] {
            assert!(!looks_like(other), "{other:?}");
        }
    }

    #[test]
    fn box_holds_what_is_within() {
        let cuboid = [10.0, 0.0, 0.0, 0.0, 2.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert!(within(&cuboid, DVec3::new(10.9, 1.9, 5.0)));
        assert!(!within(&cuboid, DVec3::new(11.2, 0.0, 0.0)));
        assert!(!within(&cuboid, DVec3::new(f64::NAN, 0.0, 0.0)));
    }
}
