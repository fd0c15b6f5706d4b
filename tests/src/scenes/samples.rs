//! Scenes whose edges are antialiased by samples. They have every kind of depth step, in front of and behind every kind
//! of surface.

use super::{
    Case, ball_aside, ball_over_floor, beyond_its_filter, clipped_glass, clipped_near, closed_sphere, fading_pane,
    half_mesh_wall, hidden_steps, mesh_ball, mesh_through_sphere, near_crossing, octree, orthographic,
    pane_through_sphere, panes, single_pixel, sphere_before_mesh, sphere_before_plane, textured_floor, three_materials,
};
use super::{Parts, sun};
use surfel_model::{EdgeAa, Filter, Mapping, Shader, Transparency};

pub(super) fn sample_cases() -> Vec<Case> {
    let peel = |layers| Transparency::Peel { layers, drop_last: false };
    let abuffer = Transparency::ABuffer { layers: 6 };
    let crossing = mesh_through_sphere();
    vec![
        // Splats over the background and over splats, with every filter, and without a filter, which leaves splats
        // between pixel centres.
        closed_sphere().sampled(),
        sphere_before_plane().sampled(),
        beyond_its_filter().sampled(),
        sphere_before_plane().with("none", |s| s.filter = Filter::None).sampled(),
        sphere_before_plane().with("adjust", |s| s.filter = Filter::Adjust).sampled(),
        sphere_before_plane().with("clamp", |s| s.filter = Filter::Clamp).sampled(),
        orthographic().sampled(),
        orthographic().with("affine", |s| s.mapping = Mapping::Affine).sampled(),
        near_crossing().sampled(),
        single_pixel().sampled(),
        clipped_near().sampled(),
        // Polygons over the background, behind splats, beside them and through them.
        mesh_ball().sampled(),
        mesh_ball().with("orthographic", |_| ()).in_orthographic(2.6, 8.0).sampled(),
        sphere_before_mesh().sampled(),
        half_mesh_wall().sampled(),
        textured_floor().sampled(),
        octree().sampled(),
        crossing.sampled(),
        // Transparent layers in front of, behind and through opaque surfaces.
        crossing.with("peel-3", |s| s.transparency = peel(3)).sampled(),
        panes().with("peel-4", |s| s.transparency = peel(4)).sampled(),
        panes().with("abuffer-6", |s| s.transparency = abuffer).sampled(),
        pane_through_sphere().with("peel-1", |s| s.transparency = peel(1)).sampled(),
        fading_pane().sampled(),
        clipped_glass().with("peel-2", |s| s.transparency = peel(2)).sampled(),
        // Lighting, shadows, and shaders that read neighbours.
        ball_over_floor(Parts::SplatsOverMesh, sun()).sampled(),
        ball_aside().sampled(),
        three_materials().with("toon", |s| s.shader = Shader::Toon).sampled(),
        crossing.with("toon", |s| s.shader = Shader::Toon).sampled(),
        crossing.with("edl", |s| (s.shader, s.transparency) = (Shader::Edl, peel(2))).sampled(),
        hidden_steps().sampled(),
    ]
}

impl Case {
    /// Returns the case with edge antialiasing by samples.
    #[must_use]
    pub fn sampled(&self) -> Self {
        self.with("samples", |s| s.edge_aa = EdgeAa::Samples)
    }
}
