//! The reference with a deliberate fault, which every comparison of images must find.

use glam::{DAffine3, DVec3};
use surfel_conformance::scenes;
use surfel_model::{
    CloudData, Column3, Cull, DepthTolerance, EdgeAa, Geometry, Light, Mesh, Octree, OnInvalid, Scene, Settings,
    Shader, Shape, SplatCloud, Transparency,
};
use surfel_reference::{Renderer as Reference, ResidentScene};
use surfel_render::{Frame, Planes, RenderError, Renderer, RendererInfo, Selection, Stats, View, select};

type ChangeView = fn(&mut View);
type ChangeSettings = fn(&mut Settings);
type ChangeFrame = fn(&mut Frame);
/// A function that introduces a fault.
pub(crate) type Fault = fn(&mut Faulty);

/// The reference with a deliberate fault.
pub(crate) struct Faulty {
    inner: Reference,
    pub(crate) scene: fn(&mut Scene),
    pub(crate) view: ChangeView,
    pub(crate) settings: ChangeSettings,
    pub(crate) frame: ChangeFrame,
}

impl Faulty {
    /// Creates the renderer without a fault.
    pub(crate) fn new() -> Self {
        Self {
            inner: Reference::new(Default::default()).unwrap(),
            scene: |_| (),
            view: |_| (),
            settings: |_| (),
            frame: |_| (),
        }
    }
}

impl Renderer for Faulty {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        self.inner.info()
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        let mut scene = scene.clone();
        (self.scene)(&mut scene);
        self.inner.upload(&scene)
    }

    fn render_into(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let (mut view, mut settings) = (view.clone(), *settings);
        (self.view)(&mut view);
        (self.settings)(&mut settings);
        let stats = self.inner.render_into(scene, &view, &settings, planes, frame)?;
        (self.frame)(frame);
        Ok(stats)
    }
}

fn toon_to_phong(shader: Shader) -> Shader {
    if shader == Shader::Toon { Shader::Phong } else { shader }
}

fn edl_to_unlit(shader: Shader) -> Shader {
    if shader == Shader::Edl { Shader::Unlit } else { shader }
}

fn each_cloud(scene: &mut Scene, change: fn(&mut CloudData)) {
    for object in &mut scene.objects {
        let Geometry::Splats(cloud) = &object.geometry else { continue };
        let mut data = cloud.data().clone();
        change(&mut data);
        object.geometry = Geometry::Splats(SplatCloud::new(data, OnInvalid::Drop).unwrap().0.into());
    }
}

fn each_mesh(scene: &mut Scene, change: fn(&mut Mesh)) {
    for object in &mut scene.objects {
        if let Geometry::Mesh(mesh) = &mut object.geometry {
            change(std::sync::Arc::make_mut(mesh));
        }
    }
}

fn swap_axes(data: &mut CloudData) {
    if let Shape::Ellipses { s, t } = &mut data.shape {
        std::mem::swap(s, t);
    }
}

/// Makes every hundredth splat non-finite, so that it is dropped.
fn drop_each_hundredth(data: &mut CloudData) {
    let center = |i| if i % 100 == 50 { DVec3::NAN } else { data.centers.get(i) };
    data.centers = Column3::from_f64(&(0..data.centers.len()).map(center).collect::<Vec<_>>());
}

fn swap_uv(mesh: &mut Mesh) {
    mesh.uvs.iter_mut().flatten().for_each(|uv| uv.swap(0, 1));
}

fn stretch_texture(mesh: &mut Mesh) {
    mesh.uvs.iter_mut().flatten().for_each(|uv| *uv = uv.map(|c| c * 1.001));
}

/// Encodes linear colours, which the PNG writer will encode again.
fn encode_again(frame: &mut Frame) {
    for [r, g, b, _] in frame.color_mut() {
        for channel in [r, g, b] {
            *channel = if *channel <= 0.003_130_8 { 12.92 * *channel } else { 1.055 * channel.powf(1.0 / 2.4) - 0.055 };
        }
    }
}

/// Replaces the octree's scene by another selection of its parts. Other scenes don't change.
fn choose_again(scene: &mut Scene, choose: fn(&Octree, &View) -> Selection) {
    if scene.background == scenes::OCTREE_BACKGROUND {
        scene.objects = scenes::octree_by(choose).scene.objects;
    }
}

/// Returns the nodes that are selected with `share` times the right threshold; with 1, the selection is right.
fn chosen(octree: &Octree, view: &View, share: f64) -> Selection {
    select(octree, &DAffine3::IDENTITY, Cull::Back, view, share * scenes::OCTREE_ERROR_PX)
}

fn transitions_twice(octree: &Octree, view: &View) -> Selection {
    let mut selection = chosen(octree, view, 1.0);
    let others = scenes::without_transitions(octree, selection.clone());
    let twice: Vec<_> = selection.splats.iter().filter(|range| !others.splats.contains(range)).cloned().collect();
    selection.splats.extend(twice);
    selection
}

/// Removes lines: black becomes the colour of the nearest pixel to the left, or above, that isn't black.
fn without_lines(frame: &mut Frame) {
    let width = frame.width() as usize;
    for at in 0..frame.color().len() {
        let is_black = |c: &[f32; 4]| c[..3] == [0.0; 3];
        if is_black(&frame.color()[at]) {
            let beside = (at % width > 0).then(|| frame.color()[at - 1]);
            let above = (at >= width).then(|| frame.color()[at - width]);
            if let Some(color) = [beside, above].into_iter().flatten().find(|c| !is_black(c)) {
                frame.color_mut()[at] = color;
            }
        }
    }
}

/// A fault, and a scene that shows it.
#[derive(Clone, Copy)]
pub(crate) struct KnownFault {
    pub(crate) name: &'static str,
    pub(crate) make: Fault,
    pub(crate) scene: &'static str,
}

const fn fault(name: &'static str, make: Fault, scene: &'static str) -> KnownFault {
    KnownFault { name, make, scene }
}

/// All faults that are tested.
pub(crate) const FAULTS: [KnownFault; 35] = [
    fault("half a pixel off", |f| f.view = |v| v.projection.principal_px[0] += 0.5, "orientation"),
    fault("a hundredth of a pixel off", |f| f.view = |v| v.projection.principal_px[1] += 0.01, "confetti"),
    fault("cutoff", |f| f.settings = |s| s.cutoff *= 1.01, "facing-splat"),
    fault("filter radius", |f| f.settings = |s| s.prefilter_radius_px *= 1.02, "grid/principal"),
    fault("no filter", |f| f.settings = |s| s.prefilter_radius_px = 0.0, "grid/ewa"),
    fault("affine for exact", |f| f.settings = |s| s.mapping = surfel_model::Mapping::Affine, "tilted-splat"),
    fault(
        "tolerance ignored",
        |f| f.settings = |s| s.depth_tolerance = DepthTolerance::Relative(0.0),
        "sphere/principal",
    ),
    fault(
        "occlusion ignored",
        |f| f.settings = |s| s.depth_tolerance = DepthTolerance::Relative(1e9),
        "sphere/principal",
    ),
    fault("sRGB twice", |f| f.frame = encode_again, "orientation"),
    fault("1 % of splats dropped", |f| f.scene = |s| each_cloud(s, drop_each_hundredth), "confetti"),
    fault("u and v of textures swapped", |f| f.scene = |s| each_mesh(s, swap_uv), "textured-floor"),
    fault(
        "tolerance",
        |f| {
            f.settings = |s| s.depth_tolerance = DepthTolerance::Relative(1.1);
        },
        "occluded-pair",
    ),
    fault("near", |f| f.view = |v| v.projection.near *= 1.05, "near-crossing"),
    fault(
        "one material for all",
        |f| {
            f.scene = |s| {
                if let Some(first) = s.objects.first().map(|o| o.material) {
                    s.objects.iter_mut().for_each(|o| o.material = first);
                }
            };
        },
        "three-materials/lit",
    ),
    fault("no lights", |f| f.scene = |s| s.lights = Some(Vec::new()), "spot-light/lit"),
    fault("u and v swapped", |f| f.scene = |s| each_cloud(s, swap_axes), "mirrored-object/lit"),
    fault("opaque", |f| f.settings = |s| s.transparency = Transparency::Off, "pane-through-sphere/peel-2"),
    fault(
        "a layer less",
        |f| {
            f.settings = |s| {
                if let Transparency::Peel { layers, .. } = &mut s.transparency {
                    *layers = (*layers - 1).max(1);
                }
            };
        },
        "panes/lit/peel-3",
    ),
    fault(
        "last layer kept",
        |f| {
            f.settings = |s| {
                if let Transparency::Peel { drop_last, .. } = &mut s.transparency {
                    *drop_last = false;
                }
            };
        },
        "panes/lit/peel-3-drop",
    ),
    fault(
        "peeled instead of gathered",
        |f| {
            f.settings = |s| {
                if let Transparency::ABuffer { .. } = s.transparency {
                    s.transparency = Transparency::Peel { layers: 64, drop_last: true };
                }
            };
        },
        "glass-spheres/lit/abuffer-6",
    ),
    fault(
        "no polygons",
        |f| f.scene = |s| s.objects.retain(|o| matches!(o.geometry, Geometry::Splats(_))),
        "mesh-through-sphere/lit",
    ),
    fault(
        "rough hand-over",
        |f| f.scene = |s| s.objects.iter_mut().for_each(|o| o.material.interior_weight = Some(1e-6)),
        "half-mesh-wall/lit",
    ),
    fault("texture stretched", |f| f.scene = |s| each_mesh(s, stretch_texture), "textured-floor"),
    fault(
        "no shadows",
        |f| {
            f.scene = |s| {
                for light in s.lights.iter_mut().flatten() {
                    if let Light::Directional { shadow, .. } | Light::Spot { shadow, .. } = light {
                        *shadow = false;
                    }
                }
            };
        },
        "ball-over-floor/lit/wide-spot",
    ),
    fault(
        "splats cast no shadow",
        |f| {
            f.scene = |s| {
                let glass = surfel_conformance::build::with_alpha;
                for object in &mut s.objects {
                    let Geometry::Splats(cloud) = &object.geometry else { continue };
                    object.geometry = Geometry::Splats(glass((**cloud).clone(), |_| 0.999).into());
                }
            };
        },
        "glass-ball-over-floor/lit/peel-3",
    ),
    fault(
        "transitions left out",
        |f| {
            f.scene = |s| {
                choose_again(s, |octree, view| scenes::without_transitions(octree, chosen(octree, view, 1.0)));
            };
        },
        "octree/lit",
    ),
    fault("transitions drawn for either leaf", |f| f.scene = |s| choose_again(s, transitions_twice), "octree/lit"),
    fault(
        "splats twice as large",
        |f| f.scene = |s| choose_again(s, |octree, view| chosen(octree, view, 2.0)),
        "octree/lit",
    ),
    fault(
        "polygons where splats do",
        |f| f.scene = |s| choose_again(s, |octree, view| chosen(octree, view, 1e-6)),
        "octree/lit/edge-aa",
    ),
    fault("no outlines", |f| f.frame = without_lines, "three-materials/lit/toon"),
    fault("phong for toon", |f| f.settings = |s| s.shader = toon_to_phong(s.shader), "three-materials/lit/toon"),
    fault("another ball", |f| f.scene = |s| s.matcap = None, "ball-aside/matcap"),
    fault("depth ignored", |f| f.settings = |s| s.shader = edl_to_unlit(s.shader), "hidden-steps/edl"),
    fault(
        "both sides blended",
        |f| f.scene = |s| s.objects.iter_mut().for_each(|o| o.material.oriented = Some(false)),
        "thin-shell/lit",
    ),
    fault("no edge antialiasing", |f| f.settings = |s| s.edge_aa = EdgeAa::Off, "sphere-before-plane/edge-aa"),
];
