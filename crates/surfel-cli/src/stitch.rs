//! `surfel stitch`: merges the tiles of an image. The result and its metadata equal those of the image drawn at once.

use crate::args::StitchArgs;
use crate::console::Console;
use crate::failure::Failure;
use crate::output::{Format, Output};
use crate::stdin::is_stdin;
use serde_json::{Map, Value};
use std::path::{Component, Path, PathBuf};
use surfel_app::metadata::{self, Content, DRAWN_KEY, INPUTS_KEY, Input, SCENE_KEY, VERSION_KEY};
use surfel_app::values;
use surfel_io::ShowPath as _;
use surfel_io::{BitDepth, Samples, Tile};
use surfel_load::paths;
use surfel_model::SceneFile;
use surfel_render::Region;

pub(crate) fn run(args: &StitchArgs, console: &Console) -> Result<(), Failure> {
    // A TIFF has the samples of PNG tiles.
    let extension = args.output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let is_tiff = matches!(extension.as_deref(), Some("tif" | "tiff"));
    let output = if is_tiff { args.output.with_extension("png") } else { args.output.clone() };
    let output = Output::still(&output, args.force, false, false)?;
    if output.is_stdout() {
        return Err(Failure::usage("-o -: a whole image goes to a file, expected a name in .png, .tif or .exr"));
    }
    output.check(Some(&args.output))?;
    let said: Vec<TileMetadata> = args.tiles.iter().map(|path| TileMetadata::of(path)).collect::<Result<_, _>>()?;
    let Some(first) = said.first() else { return Err(Failure::usage("no tiles are given")) };
    for other in &said {
        if let Some(what) = first.differs(other) {
            return Err(Failure::input(format!(
                "{}: is no tile of the image that {} is one of: {what} differs\n  expected: tiles that the same \
                 command drew but for --tile, --region and -o",
                other.tile.path.shown(),
                first.tile.path.shown()
            )));
        }
    }
    let format = match first.tile.header.samples {
        Samples::Png(depth) => Format::Png { sixteen: depth == BitDepth::Sixteen },
        Samples::Exr(_) => Format::Exr { f32_color: true },
    };
    if std::mem::discriminant(&format) != std::mem::discriminant(&output.format) {
        let kind = if matches!(format, Format::Png { .. }) { "PNG" } else { "EXR" };
        return Err(Failure::usage(format!(
            "-o {}: the tiles are {kind}s, expected a name in .{}: no sample is changed",
            args.output.shown(),
            kind.to_lowercase()
        )));
    }
    let size = first.file.camera.size;
    if is_tiff {
        console.detail(&format!("{}: keeps nothing of the scene: surfel again needs a PNG", args.output.shown()));
    }
    let metadata = first.whole_image_metadata(Output::folder(Some(&args.output)), format)?;
    let tiles: Vec<Tile> = said.iter().map(|said| said.tile.clone()).collect();
    surfel_io::stitch(&args.output, args.force, size, &tiles, &metadata)?;
    console.detail(&format!("{}: {}x{} pixels of {} tiles", args.output.shown(), size[0], size[1], tiles.len()));
    Ok(())
}

/// A tile of an image, with the metadata from its file about the image that it belongs to.
struct TileMetadata {
    tile: Tile,
    file: SceneFile,
    version: String,
    /// Drawing options of the image, by name, without the tile's region.
    drawn: Map<String, Value>,
    inputs: Value,
}

impl TileMetadata {
    fn of(path: &Path) -> Result<Self, Failure> {
        let header = surfel_io::read_image_header(path)?;
        let name = path.shown();
        let text = |key: &str| {
            let found = header.metadata.iter().find(|(k, _)| k == key).map(|(_, text)| text.clone());
            found.ok_or_else(|| {
                Failure::input(format!(
                    "{name}: doesn't say what it is a tile of (it has no {key})\n  expected: a PNG or EXR that surfel \
                     drew by --tile or --region, without --no-metadata"
                ))
            })
        };
        let json = |key: &str| {
            let damaged = |e| Failure::input(format!("{name}: {key} is damaged: {e}"));
            serde_json::from_str::<Value>(&text(key)?).map_err(damaged)
        };
        let (file, _) = surfel_load::scene::parse_scene_file(text(SCENE_KEY)?.as_bytes(), path)?;
        let mut drawn = json(DRAWN_KEY)?.as_object().cloned().unwrap_or_default();
        let [width, height] = file.camera.size;
        let region = match drawn.remove("region") {
            None => Region { x: 0, y: 0, width, height },
            Some(text) => text
                .as_str()
                .and_then(|text| values::region(text).ok())
                .ok_or_else(|| Failure::input(format!("{name}: {DRAWN_KEY} is damaged: its region is {text}")))?,
        };
        if (region.width, region.height) != (header.width, header.height) {
            return Err(Failure::input(format!(
                "{name}: has {}x{} pixels, but says that it is a region of {}x{}: programs that edit images may do so",
                header.width, header.height, region.width, region.height
            )));
        }
        let (version, inputs) = (text(VERSION_KEY)?, json(INPUTS_KEY)?);
        let tile = Tile { path: path.to_path_buf(), x: region.x, y: region.y, header };
        Ok(Self { tile, file, version, drawn, inputs })
    }

    /// Returns the name of the first property in which two tiles differ, although tiles of one image share it; `None`
    /// if there is none. Paths of inputs may differ, but not their content.
    fn differs(&self, other: &Self) -> Option<&'static str> {
        let scene = |said: &Self| {
            let mut file = said.file.clone();
            // Every path has a file name; a path without one is left unchanged.
            let _ = paths::for_each(&mut file, |path| {
                *path = path.file_name().map_or_else(|| path.clone(), PathBuf::from);
                Ok(())
            });
            file
        };
        let inputs = |said: &Self| {
            let mut inputs = said.inputs.clone();
            for input in inputs.as_array_mut().into_iter().flatten() {
                if let Some(path) = input.get_mut("path") {
                    let name = path.as_str().and_then(|path| Path::new(path).file_name()?.to_str());
                    *path = name.map(Value::from).unwrap_or_default();
                }
            }
            // Inputs are ordered by path in the metadata, so they are sorted by content here.
            let mut texts: Vec<String> = inputs.as_array().into_iter().flatten().map(Value::to_string).collect();
            texts.sort();
            texts
        };
        let (a, b) = (scene(self), scene(other));
        if self.version != other.version {
            Some("surfel's version")
        } else if a.camera != b.camera {
            Some("the camera")
        } else if a.settings != b.settings {
            Some("a setting")
        } else if a != b {
            Some("the scene")
        } else if inputs(self) != inputs(other) {
            Some("an input's content")
        } else if self.drawn != other.drawn {
            Some("how it was drawn (backend, adapter, storage or samples)")
        } else {
            None
        }
    }

    /// Returns the metadata of the whole image in `folder`, as if the image had been drawn there at once.
    fn whole_image_metadata(&self, folder: &Path, format: Format) -> Result<Vec<(String, String)>, Failure> {
        let here = Output::folder(Some(&self.tile.path));
        let here = std::fs::canonicalize(here).unwrap_or_else(|_| here.to_path_buf());
        let absolute = |path: &Path| clean(&here.join(path));
        let mut file = self.file.clone();
        paths::for_each(&mut file, |path| {
            *path = absolute(path);
            Ok(())
        })?;
        let inputs: Option<Vec<Input>> = self.inputs.as_array().map(|inputs| {
            let input = |input: &Value| {
                let path = Path::new(input["path"].as_str().unwrap_or_default());
                let content = match (input["bytes"].as_u64(), input["sha256"].as_str()) {
                    (Some(bytes), Some(hash)) => Content::Known { bytes, sha256: hash.to_owned() },
                    _ if input["missing"] == true => Content::Missing,
                    _ => Content::Unknown,
                };
                Input { path: if is_stdin(path) { path.to_path_buf() } else { absolute(path) }, content }
            };
            inputs.iter().map(input).collect()
        });
        let is_exr = matches!(format, Format::Exr { .. });
        let entries = metadata::entries(folder, &file, &inputs.unwrap_or_default(), &self.drawn, is_exr)?;
        let mut entries = entries.unwrap_or_default();
        for (key, text) in &mut entries {
            if key == VERSION_KEY {
                text.clone_from(&self.version);
            }
        }
        Ok(entries)
    }
}

/// Removes `..` from an absolute path. The folders before `..` must not be links.
fn clean(path: &Path) -> PathBuf {
    let mut clean = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                clean.pop();
            }
            Component::CurDir => {}
            part => clean.push(part),
        }
    }
    clean
}
