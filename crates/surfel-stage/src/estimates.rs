//! Estimates about loaded objects that are computed once for all images of a session.

use crate::brightness::BrightnessStats;
use crate::lights::Lighting;
use glam::DVec3;
use std::sync::{Mutex, OnceLock, PoisonError};
use surfel_framing::strays::Sphere;
use surfel_framing::{FrameOptions, Samples};
use surfel_load::LoadedObjects;
use surfel_model::{Camera, Scene, Up};

/// Cache of estimates about loaded objects, which are computed when first needed. All requests that share a cache must
/// have the same loaded objects.
#[derive(Debug, Default)]
pub struct Estimates {
    framed: OnceLock<LoadedObjects>,
    samples: OnceLock<Samples>,
    kept: OnceLock<Option<Sphere>>,
    center: OnceLock<Option<DVec3>>,
    brightness: OnceLock<BrightnessStats>,
    watertight: OnceLock<Vec<bool>>,
    lighting: Mutex<Option<(Up, Lighting)>>,
    camera: Mutex<Option<(FrameOptions, Option<Camera>)>>,
}

/// Returns the value for a key from a cache of one entry. The value is computed again only if the key differs from the
/// cached one.
fn last<K: PartialEq, V: Clone>(known: &Mutex<Option<(K, V)>>, key: K, compute: impl FnOnce(&K) -> V) -> V {
    let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
    match &*known {
        Some((of, value)) if *of == key => value.clone(),
        _ => {
            let value = compute(&key);
            *known = Some((key, value.clone()));
            value
        }
    }
}

impl Estimates {
    /// Returns the objects with only those splats that influence the camera ([`LoadedObjects::framed`]), and with
    /// unchanged facts.
    pub fn framed(&self, loaded: &LoadedObjects) -> LoadedObjects {
        let framed = self.framed.get_or_init(|| loaded.framed()).clone();
        LoadedObjects { facts: loaded.facts.clone(), ..framed }
    }

    /// Returns the samples of the surfaces of the framed objects ([`Estimates::framed`]).
    pub fn samples(&self, framed: &LoadedObjects) -> &Samples {
        self.samples.get_or_init(|| Samples::new(&framed.objects))
    }

    /// Returns a sphere around the scene without its stray points, for [`surfel_framing::frame_within`]. Returns `None`
    /// if all points are framed: there are no stray points, or the options select all classes.
    pub fn kept(&self, loaded: &LoadedObjects, scene: &Scene) -> Option<Sphere> {
        let find = || if loaded.frames_all() { None } else { surfel_framing::without_strays_of(scene) };
        *self.kept.get_or_init(find)
    }

    /// Returns the centre, in world space, of the framed part of the scene ([`surfel_framing::center_within`]); `None`
    /// if there is no geometry.
    pub fn center(&self, loaded: &LoadedObjects, scene: &Scene) -> Option<DVec3> {
        *self.center.get_or_init(|| surfel_framing::center_within(scene, self.kept(loaded, scene)))
    }

    pub(crate) fn brightness(&self, loaded: &LoadedObjects) -> &BrightnessStats {
        self.brightness.get_or_init(|| BrightnessStats::of(self.samples(loaded).all()))
    }

    /// Returns one flag per object, true if the object is watertight, so that its back faces are never visible. The
    /// first call computes the flags with `estimate`; later calls return the same flags.
    pub fn watertight(&self, estimate: impl FnOnce() -> Vec<bool>) -> &[bool] {
        self.watertight.get_or_init(estimate)
    }

    /// Returns the properties of the objects that determine their lights, for an up axis. The value for the last up
    /// axis is cached.
    pub fn lighting(&self, loaded: &LoadedObjects, up: Up) -> Lighting {
        last(&self.lighting, up, |up| Lighting::of(loaded, self.samples(loaded), *up))
    }

    /// Returns the camera that frames the scene without its stray points ([`surfel_framing::frame_within`]); `None` if
    /// there is no geometry. The camera for the last options is cached.
    pub fn camera(&self, loaded: &LoadedObjects, scene: &Scene, options: FrameOptions) -> Option<Camera> {
        last(&self.camera, options, |options| surfel_framing::frame_within(scene, self.kept(loaded, scene), options))
    }
}
