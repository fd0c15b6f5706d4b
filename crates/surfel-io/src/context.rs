//! The context that every reader gets: options, access to other files, and collected notes. It also validates all
//! splats, points and meshes.

use crate::columns::rounding_note;
use crate::content::{Content, LoadOptions};
use crate::error::ShowPath as _;
use crate::error::{Fault, Problem};
use crate::files::{self, Siblings};
use crate::texture::TextureDecoder;
use crate::words::counted;
use glam::Vec3;
use std::collections::HashSet;
use std::sync::Arc;
use surfel_model::{CloudData, Mesh, OnInvalid, PointCloud, SplatCloud};

/// Note for the user that alphas were ignored because all of them are 0.
pub(crate) const ZERO_ALPHAS: &str = "took everything as opaque: its alphas are all 0";

/// Note for the user that colours were ignored because all of them are black.
const ALL_BLACK: &str = "took it as without colours: they are all black";

/// Maximum number of notes per file. Notes beyond it are only counted.
const MAX_NOTES: usize = 1000;

/// State that readers share while a file is loaded.
pub(crate) struct Context<'a> {
    pub(crate) options: &'a LoadOptions,
    /// Access to other files that the loaded file refers to.
    pub(crate) siblings: Siblings,
    /// Notes for the user so far, as sentences without a full stop.
    pub(crate) notes: Vec<String>,
    /// Notes that [`Self::note`] has added, as a set, to find duplicates.
    note_set: HashSet<String>,
    /// Number of notes dropped because there were more than [`MAX_NOTES`].
    dropped_notes: usize,
    /// Texture decoder, with limits for the whole file.
    pub(crate) textures: TextureDecoder,
    /// True if the file contains trained Gaussians, also if they were converted to splats.
    pub(crate) gaussian: bool,
}

impl<'a> Context<'a> {
    pub(crate) fn new(options: &'a LoadOptions, siblings: Siblings) -> Self {
        let textures = TextureDecoder::new(options.max_texture);
        Self {
            options,
            siblings,
            notes: Vec::new(),
            note_set: HashSet::new(),
            dropped_notes: 0,
            textures,
            gaussian: false,
        }
    }

    /// Adds a note for the user, unless it exists already.
    pub(crate) fn note(&mut self, note: String) {
        if self.note_set.contains(&note) {
            return;
        }
        if self.notes.len() < MAX_NOTES {
            self.note_set.insert(note.clone());
            self.notes.push(note);
        } else {
            self.dropped_notes += 1;
        }
    }

    /// Removes and returns all notes; the last one counts the notes beyond the maximum.
    pub(crate) fn take_notes(&mut self) -> Vec<String> {
        let mut notes = std::mem::take(&mut self.notes);
        if self.dropped_notes > 0 {
            notes.push(format!("… and {} more notes", std::mem::take(&mut self.dropped_notes)));
        }
        notes
    }

    /// Adds a note if positions, which are 32-bit floats in the file, are so far from the origin that rounding is
    /// noticeable.
    pub(crate) fn note_rounding(&mut self, positions: &[Vec3]) {
        let finite = positions.iter().filter(|p| p.is_finite());
        let ends = finite.fold(None, |ends: Option<(Vec3, Vec3)>, p| {
            ends.map_or(Some((*p, *p)), |(lo, hi)| Some((lo.min(*p), hi.max(*p))))
        });
        let note = ends.and_then(|(lo, hi)| rounding_note(lo.as_dvec3(), hi.as_dvec3()));
        note.into_iter().for_each(|note| self.note(note));
    }

    /// Removes a column of alphas that are all 0. Some tools write 0 for an unset alpha, and no file is meant to be
    /// invisible.
    fn drop_zero_alphas(&mut self, alphas: &mut Option<Vec<f32>>) {
        if alphas.as_ref().is_some_and(|all| !all.is_empty() && all.iter().all(|a| *a == 0.0)) {
            *alphas = None;
            self.note(ZERO_ALPHAS.into());
        }
    }

    /// Removes a column of colours that are all black. Some tools write 0 for an unset colour, and black hides every
    /// shape.
    pub(crate) fn drop_black_colors(&mut self, colors: &mut Option<Vec<[f32; 3]>>) {
        if colors.as_ref().is_some_and(|all| !all.is_empty() && all.iter().all(|color| *color == [0.0; 3])) {
            *colors = None;
            self.note(ALL_BLACK.into());
        }
    }

    /// Validates splats and returns them as content. If `repair` is requested, invalid splats are dropped with a note
    /// instead of failing. Alphas that are all 0 are removed with a note.
    pub(crate) fn splats(&mut self, mut data: CloudData) -> Result<Content, Fault> {
        let on_invalid = if self.options.repair { OnInvalid::Drop } else { OnInvalid::Refuse };
        self.drop_zero_alphas(&mut data.alphas);
        let (cloud, repaired) = SplatCloud::new(data, on_invalid)?;
        if let Some((index, problem)) = repaired.first {
            self.note(format!("dropped {} invalid splats; the first was splat {index}: {problem}", repaired.dropped));
        }
        Ok(Content::Splats(cloud))
    }

    /// Validates points and returns them as content. Points whose position isn't finite are dropped, alphas that are
    /// all 0 removed, and colours that are all black removed, each with a note.
    pub(crate) fn points(&mut self, mut points: PointCloud) -> Result<Content, Fault> {
        points.check_columns()?;
        self.drop_zero_alphas(&mut points.alphas);
        self.drop_black_colors(&mut points.colors);
        let dropped = points.drop_non_finite();
        if dropped > 0 {
            self.note(format!("dropped {} whose coordinates are not finite", counted(dropped as u64, "points")));
        }
        Ok(Content::Points(points))
    }

    /// Validates a mesh and returns it as content. A mesh with texture coordinates but no texture gets the texture of
    /// the options. Alphas that are all 0 are removed with a note.
    pub(crate) fn mesh(&mut self, mut mesh: Mesh) -> Result<Content, Fault> {
        self.drop_zero_alphas(&mut mesh.alphas);
        mesh.validate()?;
        let untextured = mesh.uvs.is_some() && mesh.textures().next().is_none();
        if let Some(path) = self.options.texture.as_ref().filter(|_| untextured) {
            let texture = files::read(path, 1 << 30).map_err(|e| e.to_string());
            let texture = texture.and_then(|bytes| self.textures.decode(&bytes, &path.to_string_lossy()));
            let texture =
                texture.map_err(|why| Problem::new(format!("can't use the texture {}: {why}", path.shown())))?;
            let texture = Arc::new(texture);
            let materials = mesh.materials.iter_mut().flat_map(|all| &mut all.materials);
            materials.for_each(|material| material.texture = Some(texture.clone()));
            mesh.texture = Some(texture);
        }
        Ok(Content::Mesh(mesh))
    }
}
