//! Cameras, lights, materials, scenes, and the scene file that describes them.

use crate::{Mesh, ModelError, Settings, SplatCloud, Up};
use glam::{DAffine3, DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// Largest image side, in pixels.
pub const MAX_IMAGE_SIDE: u32 = 65_536;
/// Largest number of pixels that one render allocates (the image, or its region).
pub const MAX_IMAGE_PIXELS: u64 = 1 << 28;

/// A camera as in the scene file. World space, world units, degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position of the eye.
    pub eye: [f64; 3],
    /// The point looked at; differs from `eye`.
    pub target: [f64; 3],
    /// A direction that appears upward; not parallel to the view.
    #[serde(default = "default_up")]
    pub up: [f64; 3],
    /// Projection.
    pub projection: Projection,
    /// Planar depth before which nothing is drawn, greater than 0.
    #[serde(default = "default_near")]
    pub near: f64,
    /// Planar depth beyond which an orthographic view draws nothing. Perspective has no far plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub far: Option<f64>,
    /// Image width and height in pixels.
    pub size: [u32; 2],
}

fn default_up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

fn default_near() -> f64 {
    0.01
}

/// Projections (rendering model §1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Projection {
    /// Centred perspective with square pixels.
    Perspective {
        /// Vertical field of view, degrees, in (0, 180).
        fov_y_deg: f64,
    },
    /// Perspective by a calibrated camera, in pixels.
    Intrinsics {
        /// Focal length along x.
        fx: f64,
        /// Focal length along y.
        fy: f64,
        /// Principal point, x.
        cx: f64,
        /// Principal point, y.
        cy: f64,
    },
    /// Parallel projection.
    Orthographic {
        /// Height of the view in world units.
        height: f64,
    },
}

fn finite(field: &str, values: &[f64]) -> Result<(), ModelError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(ModelError::range(field, v, "finite numbers")),
        None => Ok(()),
    }
}

fn positive(field: &str, value: f64) -> Result<(), ModelError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(ModelError::range(field, value, "a finite number greater than 0"))
}

impl Camera {
    /// Checks every number and that the camera has a direction.
    ///
    /// # Errors
    /// [`ModelError`] naming the field as it is called in the scene file.
    pub fn validate(&self) -> Result<(), ModelError> {
        finite("camera.eye", &self.eye)?;
        finite("camera.target", &self.target)?;
        finite("camera.up", &self.up)?;
        positive("camera.near", self.near)?;
        let (eye, target, up) = (DVec3::from(self.eye), DVec3::from(self.target), DVec3::from(self.up));
        let forward = target - eye;
        if forward == DVec3::ZERO || !forward.is_finite() {
            return Err(ModelError::Conflict(
                "camera.eye and camera.target are the same point: the camera has no direction".into(),
            ));
        }
        if up == DVec3::ZERO {
            return Err(ModelError::range("camera.up", up, "a direction that is not zero"));
        }
        let (f, u) = (surfel_math::basis::unit(forward), surfel_math::basis::unit(up));
        if f.cross(u).length() < 1e-9 {
            return Err(ModelError::Conflict("camera.up is parallel to the view direction: choose another up".into()));
        }
        let [w, h] = self.size;
        if w == 0 || h == 0 || w > MAX_IMAGE_SIDE || h > MAX_IMAGE_SIDE {
            return Err(ModelError::range("camera.size", format!("{w}x{h}"), "1 to 65536 pixels a side"));
        }
        match self.projection {
            Projection::Perspective { fov_y_deg } => {
                if !(fov_y_deg > 0.0 && fov_y_deg < 180.0) {
                    return Err(ModelError::range(
                        "camera.projection.perspective.fov_y_deg",
                        fov_y_deg,
                        "degrees in (0, 180)",
                    ));
                }
            }
            Projection::Intrinsics { fx, fy, cx, cy } => {
                positive("camera.projection.intrinsics.fx", fx)?;
                positive("camera.projection.intrinsics.fy", fy)?;
                finite("camera.projection.intrinsics", &[cx, cy])?;
            }
            Projection::Orthographic { height } => {
                positive("camera.projection.orthographic.height", height)?;
                let Some(far) = self.far else {
                    return Err(ModelError::Conflict("an orthographic camera needs camera.far".into()));
                };
                if !(far > self.near && far.is_finite()) {
                    return Err(ModelError::range("camera.far", far, "a finite number greater than camera.near"));
                }
            }
        }
        Ok(())
    }
}

/// A light, in world space. Colours are linear RGB; nothing falls off with distance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Light {
    /// Parallel light.
    Directional {
        /// Where the light travels; not zero.
        direction: [f64; 3],
        /// Linear RGB.
        #[serde(default = "white")]
        color: [f64; 3],
        /// Casts shadows.
        #[serde(default)]
        shadow: bool,
    },
    /// Light from a point in all directions.
    Point {
        /// Where it is.
        position: [f64; 3],
        /// Linear RGB.
        #[serde(default = "white")]
        color: [f64; 3],
    },
    /// Light from a point into a cone.
    Spot {
        /// Where it is.
        position: [f64; 3],
        /// The cone's axis, where the light travels; not zero.
        direction: [f64; 3],
        /// Linear RGB.
        #[serde(default = "white")]
        color: [f64; 3],
        /// Half-angle within which it is at its full strength, degrees.
        inner_deg: f64,
        /// Half-angle at which it has faded to nothing, degrees; at least `inner_deg`.
        outer_deg: f64,
        /// Casts shadows.
        #[serde(default)]
        shadow: bool,
    },
}

fn white() -> [f64; 3] {
    [1.0; 3]
}

impl Light {
    fn validate(&self, i: usize) -> Result<(), ModelError> {
        let direction_ok = |d: &[f64; 3]| {
            finite(&format!("lights[{i}].direction"), d)?;
            if *d == [0.0; 3] {
                return Err(ModelError::range(
                    format!("lights[{i}].direction"),
                    "zero",
                    "a direction that is not zero",
                ));
            }
            Ok(())
        };
        let color = match self {
            Self::Directional { direction, color, .. } => {
                direction_ok(direction)?;
                color
            }
            Self::Point { position, color } => {
                finite(&format!("lights[{i}].position"), position)?;
                color
            }
            Self::Spot { position, direction, color, inner_deg, outer_deg, .. } => {
                finite(&format!("lights[{i}].position"), position)?;
                direction_ok(direction)?;
                if !(*inner_deg >= 0.0 && inner_deg <= outer_deg && *outer_deg <= 180.0) {
                    let found = format!("{inner_deg}, {outer_deg}");
                    let expected = "0 <= inner_deg <= outer_deg <= 180";
                    return Err(ModelError::range(format!("lights[{i}].inner_deg, outer_deg"), found, expected));
                }
                color
            }
        };
        finite(&format!("lights[{i}].color"), color)
    }

    /// True if the light asks for a shadow map.
    pub fn casts_shadow(&self) -> bool {
        matches!(self, Self::Directional { shadow: true, .. } | Self::Spot { shadow: true, .. })
    }
}

/// Which splats of an object are left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cull {
    /// None.
    #[default]
    None,
    /// Those that face away from the eye.
    Back,
}

/// How an object reflects light, and how its splats are taken.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Material {
    /// Ambient factor k_a.
    pub ambient: f64,
    /// Diffuse factor k_d.
    pub diffuse: f64,
    /// Specular factor k_s.
    pub specular: f64,
    /// Specular exponent, at least 0.
    pub shininess: f64,
    /// Which splats are left out.
    pub cull: Cull,
    /// Back-facing splats show the reverse of their shading normal.
    pub two_sided: bool,
    /// Σw inside the object's surface at cutoff 2; wins over the cloud's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interior_weight: Option<f64>,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            ambient: 1.0,
            diffuse: 1.0,
            specular: 0.2,
            shininess: 32.0,
            cull: Cull::None,
            two_sided: true,
            interior_weight: None,
        }
    }
}

impl Material {
    fn validate(&self, i: usize) -> Result<(), ModelError> {
        finite(&format!("objects[{i}].material"), &[self.ambient, self.diffuse, self.specular])?;
        if !(self.shininess >= 0.0 && self.shininess.is_finite()) {
            return Err(ModelError::range(
                format!("objects[{i}].material.shininess"),
                self.shininess,
                "a finite number, at least 0",
            ));
        }
        match self.interior_weight {
            Some(w) => positive(&format!("objects[{i}].material.interior_weight"), w),
            None => Ok(()),
        }
    }

    /// The four factors that vary the shading, as they are averaged between objects.
    pub fn factors(&self) -> [f64; 4] {
        [self.ambient, self.diffuse, self.specular, self.shininess]
    }
}

/// What an object is made of. Shared, so that instances cost nothing.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// Splats.
    Splats(Arc<SplatCloud>),
    /// Polygons.
    Mesh(Arc<Mesh>),
}

/// Something in the scene.
#[derive(Clone, Debug)]
pub struct Object {
    /// What it is made of.
    pub geometry: Geometry,
    /// Placement: any invertible affine map.
    pub world_from_object: DAffine3,
    /// Its material.
    pub material: Material,
}

/// A scene, ready to be uploaded to a renderer.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Which axis is up, where that is known.
    pub up: Option<Up>,
    /// Linear RGB and straight alpha.
    pub background: [f64; 4],
    /// Linear RGB of the ambient light.
    pub ambient: [f64; 3],
    /// Lights; `None`: one white directional light along the view.
    pub lights: Option<Vec<Light>>,
    /// Objects in drawing order (which changes nothing but float rounding).
    pub objects: Vec<Object>,
}

impl Scene {
    /// A scene of one splat cloud with default material, ambient light and headlight.
    pub fn of_cloud(cloud: SplatCloud) -> Self {
        Self {
            ambient: DEFAULT_AMBIENT,
            objects: vec![Object {
                geometry: Geometry::Splats(Arc::new(cloud)),
                world_from_object: DAffine3::IDENTITY,
                material: Material::default(),
            }],
            ..Self::default()
        }
    }

    /// Checks every number of the scene.
    ///
    /// # Errors
    /// [`ModelError`] naming the field as it is called in the scene file.
    pub fn validate(&self) -> Result<(), ModelError> {
        finite("background", &self.background)?;
        if !(0.0..=1.0).contains(&self.background[3]) {
            return Err(ModelError::range("background alpha", self.background[3], "a number in [0, 1]"));
        }
        finite("ambient", &self.ambient)?;
        for (i, light) in self.lights.iter().flatten().enumerate() {
            light.validate(i)?;
        }
        for (i, object) in self.objects.iter().enumerate() {
            object.material.validate(i)?;
            let m = object.world_from_object;
            // Compared with the columns' own lengths, so that a tiny scale isn't taken for a singular one.
            let [x, y, z] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(surfel_math::basis::unit);
            if !m.is_finite() || x.cross(y).dot(z).abs() < 1e-12 {
                return Err(ModelError::range(
                    format!("objects[{i}].matrix"),
                    format!("{:?}", DMat4::from(m).to_cols_array()),
                    "an invertible affine map (column-major, last row 0 0 0 1)",
                ));
            }
        }
        Ok(())
    }
}

/// Ambient light of a scene file that doesn't say.
pub(crate) const DEFAULT_AMBIENT: [f64; 3] = [0.1; 3];

/// The scene file (`.json`). Unknown keys are errors; paths are relative to the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Which axis is up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<Up>,
    /// The camera.
    pub camera: Camera,
    /// Linear RGB and straight alpha; transparent black by default.
    #[serde(default)]
    pub background: [f64; 4],
    /// Linear RGB of the ambient light.
    #[serde(default = "default_ambient")]
    pub ambient: [f64; 3],
    /// Lights; one white directional light along the view by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lights: Option<Vec<Light>>,
    /// What is drawn.
    pub objects: Vec<ObjectFile>,
    /// Settings.
    #[serde(default)]
    pub settings: Settings,
}

fn default_ambient() -> [f64; 3] {
    DEFAULT_AMBIENT
}

/// An object of the scene file: exactly one of `splats` and `mesh`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectFile {
    /// A file drawn as splats: splats, points or a mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub splats: Option<PathBuf>,
    /// A file drawn as polygons.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<PathBuf>,
    /// Column-major `world_from_object`; last row 0 0 0 1.
    #[serde(default = "identity")]
    pub matrix: [f64; 16],
    /// Material.
    #[serde(default)]
    pub material: Material,
}

fn identity() -> [f64; 16] {
    DMat4::IDENTITY.to_cols_array()
}

impl ObjectFile {
    /// The placement as an affine map.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] if the last row isn't 0 0 0 1 or a number isn't finite.
    pub fn world_from_object(&self) -> Result<DAffine3, ModelError> {
        let m = DMat4::from_cols_array(&self.matrix);
        if !m.is_finite() || m.row(3).to_array() != [0.0, 0.0, 0.0, 1.0] {
            let expected = "16 finite numbers, column-major, last row 0 0 0 1";
            return Err(ModelError::range("objects[].matrix", format!("{:?}", self.matrix), expected));
        }
        Ok(DAffine3::from_mat4(m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINIMAL: &str = r#"{"camera": {"eye": [0,0,5], "target": [0,0,0], "projection": {"perspective": {"fov_y_deg": 45}},
        "size": [8, 8]}, "objects": [{"splats": "a.ply"}]}"#;

    #[test]
    fn the_minimal_scene_file_has_the_interface_s_defaults() {
        let file: SceneFile = serde_json::from_str(MINIMAL).unwrap();
        assert_eq!(file.camera.near, 0.01);
        assert_eq!(file.background, [0.0; 4]);
        assert_eq!(file.ambient, [0.1; 3]);
        assert_eq!(file.lights, None);
        assert_eq!(file.objects[0].material, Material::default());
        assert_eq!(file.objects[0].world_from_object().unwrap(), DAffine3::IDENTITY);
        let settings = serde_json::to_value(file.settings).unwrap();
        assert_eq!(settings["filter"], "principal");
        assert_eq!(settings["depth_tolerance"]["relative"], 1.0);
        assert_eq!(settings["transparency"], "off");
        assert_eq!(settings["accumulate"], "f32");
    }

    #[test]
    fn a_scene_file_survives_a_round_trip() {
        let file: SceneFile = serde_json::from_str(MINIMAL).unwrap();
        let text = serde_json::to_string(&file).unwrap();
        assert_eq!(serde_json::from_str::<SceneFile>(&text).unwrap(), file);
    }

    #[test]
    fn unknown_keys_are_refused_at_every_level() {
        for (from, to) in [
            ("\"camera\"", "\"extra\": 1, \"camera\""),
            ("\"eye\"", "\"extra\": 1, \"eye\""),
            ("\"fov_y_deg\"", "\"extra\": 1, \"fov_y_deg\""),
            ("\"splats\"", "\"extra\": 1, \"splats\""),
            ("\"objects\"", "\"settings\": {\"extra\": 1}, \"objects\""),
            ("\"objects\"", "\"lights\": [{\"point\": {\"position\": [0,0,0], \"extra\": 1}}], \"objects\""),
        ] {
            let text = MINIMAL.replacen(from, to, 1);
            assert!(serde_json::from_str::<SceneFile>(&text).is_err(), "{text}");
        }
    }

    #[test]
    fn transparency_is_written_as_on_the_command_line() {
        for text in ["off", "peel:3", "peel:4:drop", "abuffer:2"] {
            let t: crate::Transparency = text.parse().unwrap();
            assert_eq!(t.to_string(), text);
        }
        for text in ["peel", "peel:0", "peel:-1", "peel:3:keep", "abuffer:", "on"] {
            assert!(text.parse::<crate::Transparency>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_camera_without_direction_or_with_its_up_along_the_view_is_refused() {
        let camera: Camera = serde_json::from_str::<SceneFile>(MINIMAL).unwrap().camera;
        assert!(camera.validate().is_ok());
        assert!(Camera { target: camera.eye, ..camera.clone() }.validate().is_err());
        assert!(Camera { up: [0.0, 0.0, 2.0], ..camera.clone() }.validate().is_err());
        assert!(Camera { size: [0, 4], ..camera.clone() }.validate().is_err());
        assert!(Camera { near: 0.0, ..camera.clone() }.validate().is_err());
        let ortho = Projection::Orthographic { height: 2.0 };
        assert!(Camera { projection: ortho, ..camera.clone() }.validate().is_err());
        assert!(Camera { projection: ortho, far: Some(9.0), ..camera }.validate().is_ok());
    }
}
