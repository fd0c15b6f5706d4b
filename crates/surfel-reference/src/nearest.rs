//! Search for the nearest splat or polygon in each pixel, for the planes `index`, `object` and `label` (rendering model
//! §5, planes).

use crate::ball::{self, BallLayer};
use crate::frame::OpaqueImage;
use crate::front::{Front, MeshLayer};
use crate::pixels::center_in;
use crate::raster::{Bands, DepthLimits, Run};
use crate::scene::{ResidentObject, ResidentScene};
use crate::shade::Lighting;
use crate::splat::ScreenSplat;
use surfel_model::NO_LABEL;
use surfel_render::{Identity, Region};

/// Fragment that may be the nearest of its pixel, with the splat or polygon to which it belongs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub z: f64,
    /// Index of the splat among all splats of the scene, or [`POLYGON`].
    splat: u32,
    /// Index of the splat's or polygon's object in the scene.
    object: u32,
    row: u32,
}

/// Value of [`Candidate::splat`] for a polygon.
const POLYGON: u32 = u32::MAX;

impl Candidate {
    /// Creates the candidate for a splat at depth `z`; `splat` is the index among all splats of the scene.
    fn of_splat(scene: &ResidentScene, splat: u32, z: f64) -> Self {
        let object = scene.objects.iter().rfind(|object| object.first_splat <= splat);
        let row = |object: &ResidentObject| {
            let i = splat - object.first_splat;
            object.cloud.data().rows.as_ref().map_or(i, |rows| rows[i as usize])
        };
        let source = object.map_or(NO_LABEL, |object| object.source as u32);
        Self { z, splat, object: source, row: object.map_or(NO_LABEL, row) }
    }

    /// Compares candidates by depth. Equal depths are ordered by object and then by row, with polygons last.
    fn order(&self, other: &Self) -> std::cmp::Ordering {
        let key = |c: &Self| (c.splat == POLYGON, c.object, c.row);
        self.z.total_cmp(&other.z).then(key(self).cmp(&key(other)))
    }

    /// Returns the candidate's row, object and label, which the planes show.
    fn identity(&self, scene: &ResidentScene) -> Identity {
        let object = scene.objects.iter().rfind(|object| self.splat != POLYGON && object.first_splat <= self.splat);
        let labels = object.and_then(|object| Some((object, object.cloud.data().labels.as_ref()?)));
        let label = labels.map_or(NO_LABEL, |(object, labels)| labels[(self.splat - object.first_splat) as usize]);
        Identity { row: self.row, object: self.object, label }
    }
}

/// Returns the candidates of each pixel of `rect`, nearest first. Their depths exceed the nearest by at most the
/// fraction `relative`. Empty pixels have none.
pub(crate) fn candidates(
    scene: &ResidentScene,
    front: &Front<'_>,
    lighting: &Lighting,
    rect: Region,
    relative: f64,
) -> Vec<Vec<Candidate>> {
    let image = OpaqueImage::new(lighting, rect, scene.background, front);
    let mut pixels = front.contributing(scene, lighting);
    let layers = front.contributing_layers(scene, lighting, rect);
    for (at, pixel) in pixels.iter_mut().enumerate() {
        if front.layers.get(at).is_some_and(|layers| layers.nearest.is_some()) {
            pixel.clone_from(&layers[at]);
        } else if let Some(polygon) = front.meshes.as_ref().and_then(|meshes| polygon_of(scene, meshes, at)) {
            pixel.push(polygon);
        }
        let balls = BallLayer::of(front.balls.as_ref(), at);
        if ball::shown(balls).is_some_and(|ball| ball.z < image.shown_depth(at, &front.layers)) {
            let solid = balls.iter().filter(|f| f.is_solid);
            *pixel = solid.map(|f| Candidate::of_splat(scene, f.splat, f.z)).collect();
        }
        pixel.sort_by(Candidate::order);
        let farthest = pixel.first().map_or(0.0, |first| first.z * (1.0 + relative));
        pixel.retain(|candidate| candidate.z <= farthest);
    }
    pixels
}

fn polygon_of(scene: &ResidentScene, meshes: &MeshLayer<'_>, at: usize) -> Option<Candidate> {
    let z = meshes.depth[at];
    let source = scene.meshes[meshes.polygons.mesh_of(&meshes.hits[at])?].source;
    z.is_finite().then_some(Candidate { z, splat: POLYGON, object: source as u32, row: NO_LABEL })
}

/// Returns the identity of the nearest fragment of each pixel.
pub(crate) fn identities(scene: &ResidentScene, front: &Front<'_>, lighting: &Lighting, rect: Region) -> Vec<Identity> {
    let first = |pixel: &Vec<Candidate>| pixel.first().map_or(Identity::NOTHING, |found| found.identity(scene));
    candidates(scene, front, lighting, rect, 0.0).iter().map(first).collect()
}

/// Converts the candidates of each pixel to identities.
pub(crate) fn all(scene: &ResidentScene, pixels: &[Vec<Candidate>]) -> Vec<Vec<Identity>> {
    pixels.iter().map(|pixel| pixel.iter().map(|candidate| candidate.identity(scene)).collect()).collect()
}

impl Front<'_> {
    /// Returns the opaque fragments of each pixel whose attributes the attribute pass sums.
    fn contributing(&self, scene: &ResidentScene, lighting: &Lighting) -> Vec<Vec<Candidate>> {
        let polygon = self.meshes.as_ref().map(|meshes| meshes.depth.as_slice());
        let limits = DepthLimits { polygon, ..DepthLimits::default() };
        let run = Run { limits, ..Run::new(&self.opaque, &self.bands, lighting.view, lighting.plan) };
        gather(scene, &run, |at, splat, z| {
            let threshold = &self.passes.thresholds[at];
            threshold.shows(splat.facing) && z <= threshold.depth && limits.reach_polygon(at, z, splat.epsilon)
        })
    }

    /// Returns the transparent fragments of each pixel in front of the opaque surface.
    fn contributing_layers(&self, scene: &ResidentScene, lighting: &Lighting, rect: Region) -> Vec<Vec<Candidate>> {
        if self.transparent.is_empty() {
            return Vec::new();
        }
        let (bands, opaque_depth) = (Bands::new(&self.transparent, rect), self.opaque_depth());
        let run = Run::new(&self.transparent, &bands, lighting.view, lighting.plan);
        gather(scene, &run, |at, _, z| z <= opaque_depth[at])
    }
}

/// Returns the fragments of each pixel that are inside their filtered footprints and for which `counts(pixel, splat,
/// z)` is true.
fn gather(
    scene: &ResidentScene,
    run: &Run<'_>,
    counts: impl Fn(usize, &ScreenSplat, f64) -> bool,
) -> Vec<Vec<Candidate>> {
    let rect = run.bands.rect;
    let mut pixels = run.fragments();
    let candidate = |at: usize, fragment: crate::raster::Fragment| {
        let splat = &run.splats[fragment.splat as usize];
        let inside = splat.rho_squared_at(center_in(rect, at)).is_some();
        if !inside || !counts(at, splat, fragment.z) {
            return None;
        }
        Some(Candidate::of_splat(scene, splat.index, fragment.z))
    };
    let of_pixel = |(at, fragments): (usize, &mut Vec<crate::raster::Fragment>)| {
        std::mem::take(fragments).into_iter().filter_map(|fragment| candidate(at, fragment)).collect()
    };
    pixels.iter_mut().enumerate().map(of_pixel).collect()
}
