//! Reduction of a failing scene to a small one that still fails.

use crate::scenes::Case;
use glam::DVec3;
use std::sync::Arc;
use surfel_model::{CloudData, Column3, Geometry, Material, OnInvalid, Settings, SplatCloud};

/// Maximum number of scenes that are drawn to shrink one failing scene.
const MAX_TRIES: usize = 400;

/// Returns the smallest case found for which `fails` is true. It must be true for `case`.
pub fn shrink(case: &Case, mut fails: impl FnMut(&Case) -> bool) -> Case {
    let (mut smallest, mut tries) = (case.clone(), 0);
    'again: loop {
        for simpler in simpler(&smallest) {
            tries += 1;
            if tries > MAX_TRIES {
                return smallest;
            }
            if fails(&simpler) {
                smallest = simpler;
                continue 'again;
            }
        }
        return smallest;
    }
}

/// Returns simpler variants of a case, those with much less content first.
fn simpler(case: &Case) -> Vec<Case> {
    let mut cases = Vec::new();
    let mut with = |change: &dyn Fn(&mut Case) -> bool| {
        let mut simpler = case.clone();
        if change(&mut simpler) {
            cases.push(simpler);
        }
    };
    for i in 0..case.scene.objects.len() {
        with(&|c| {
            c.scene.objects.remove(i);
            !c.scene.objects.is_empty()
        });
    }
    // Halves, quarters, … of each cloud are removed.
    for i in 0..case.scene.objects.len() {
        let Geometry::Splats(cloud) = &case.scene.objects[i].geometry else { continue };
        let mut length = cloud.len().div_ceil(2);
        while length > 0 && cloud.len() > 1 {
            for start in (0..cloud.len()).step_by(length) {
                let keeps = |k: usize| !(start..start + length).contains(&k);
                with(&|c| {
                    c.scene.objects[i].geometry = Geometry::Splats(Arc::new(part(cloud, keeps)));
                    true
                });
            }
            length /= 2;
        }
    }
    let usual = Settings::default();
    let settings: [&dyn Fn(&mut Settings); 9] = [
        &|s| s.edge_aa = usual.edge_aa,
        &|s| s.transparency = usual.transparency,
        &|s| s.shader = usual.shader,
        &|s| s.clip = surfel_model::ClipPolicy::Off,
        &|s| s.filter = surfel_model::Filter::None,
        &|s| s.mapping = usual.mapping,
        &|s| s.cutoff = usual.cutoff,
        &|s| s.prefilter_radius_px = usual.prefilter_radius_px,
        &|s| s.depth_tolerance = usual.depth_tolerance,
    ];
    for change in settings {
        with(&|c| {
            change(&mut c.settings);
            c.settings != case.settings
        });
    }
    with(&|c| c.region.take().is_some());
    with(&|c| c.scene.lights.as_mut().is_some_and(|lights| lights.pop().is_some()));
    with(&|c| {
        for object in &mut c.scene.objects {
            object.material = Material { interior_weight: object.material.interior_weight, ..Material::default() };
        }
        c.scene.objects.iter().zip(&case.scene.objects).any(|(a, b)| a.material != b.material)
    });
    let columns: [&dyn Fn(&mut CloudData) -> bool; 4] = [
        &|d| d.alphas.take().is_some(),
        &|d| d.shading_normals.take().is_some(),
        &|d| d.clips.take().is_some(),
        &|d| d.colors.take().is_some(),
    ];
    for change in columns {
        with(&|c| {
            let mut changed = false;
            for object in &mut c.scene.objects {
                if let Geometry::Splats(cloud) = &mut object.geometry {
                    let mut data = cloud.data().clone();
                    changed |= change(&mut data);
                    *cloud = Arc::new(valid(data));
                }
            }
            changed
        });
    }
    cases
}

/// Returns the splats for whose indices `keeps` is true.
fn part(cloud: &SplatCloud, keeps: impl Fn(usize) -> bool) -> SplatCloud {
    let mut data = cloud.data().clone();
    let center = |i: usize| if keeps(i) { data.centers.get(i) } else { DVec3::NAN };
    data.centers = Column3::from_f64(&(0..cloud.len()).map(center).collect::<Vec<_>>());
    valid(data)
}

/// Returns a cloud of the valid splats; empty if none is valid.
fn valid(data: CloudData) -> SplatCloud {
    SplatCloud::new(data, OnInvalid::Drop).map_or_else(|_| crate::build::cloud(&[]), |(cloud, _)| cloud)
}
