//! Materials, objects, scenes, and the scene file.

use crate::range::{finite, positive};
use crate::{
    Camera, Color, ConvertOptions, GaussianCloud, Ground, Light, Matcap, Mesh, ModelError, Octree, Settings, Sky,
    SplatCloud, Up,
};
use glam::{DAffine3, DMat4};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// Choice of an object's splats that are culled, and not drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum Cull {
    /// No splats are culled.
    #[default]
    None,
    /// Splats that face away from the eye are culled. This suits watertight objects, whose inside is never visible.
    Back,
}

/// Shading factors of an object, and further rules for drawing its splats.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields, default))]
pub struct Material {
    /// Ambient factor k_a of the shaders `phong` and `toon` (rendering model §5); finite.
    pub ambient: f64,
    /// Diffuse factor k_d of the shaders `phong` and `toon`; finite.
    pub diffuse: f64,
    /// Specular factor k_s of the shaders `phong` and `toon`; finite.
    pub specular: f64,
    /// Specular exponent, at least 0.
    pub shininess: f64,
    /// Culling of splats.
    pub cull: Cull,
    /// True if back-facing splats are shaded with their shading normal reversed.
    pub two_sided: bool,
    /// Interior weight: the typical sum of kernel weights at cutoff 2 inside the object's surface, greater than 0
    /// (rendering model §5). It overrides the cloud's own value; `None` uses that value.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub interior_weight: Option<f64>,
    /// True if the normals of all splats point to the outside of the same surface (rendering model §5). It overrides
    /// the cloud's own value; `None` uses that value.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub oriented: Option<bool>,
    /// Colour of the whole object, which replaces the colours of its file; `None` shows the file's colours.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub color: Option<Color>,
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
            oriented: None,
            color: None,
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

    /// True if a cloud with this material is oriented, so that its front and back faces are blended separately.
    pub fn is_oriented(&self, cloud: &SplatCloud) -> bool {
        self.oriented.unwrap_or(cloud.data().oriented)
    }

    /// Returns the four shading factors (ambient, diffuse, specular, shininess), which are averaged where objects are
    /// blended.
    pub fn factors(&self) -> [f64; 4] {
        [self.ambient, self.diffuse, self.specular, self.shininess]
    }
}

/// Geometry of an object. It is shared, so that instances need no memory.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// Cloud of splats.
    Splats(Arc<SplatCloud>),
    /// Triangle mesh, drawn as polygons.
    Mesh(Arc<Mesh>),
    /// Splats of several sizes and polygons, from which each view selects the level of detail that it needs.
    Octree(Arc<Octree>),
    /// Trained Gaussians, blended one over another instead of as a surface. A scene with Gaussians has no other
    /// geometry.
    Gaussians(Arc<GaussianCloud>),
}

/// Object of a scene: geometry with a placement and a material.
#[derive(Clone, Debug)]
pub struct Object {
    /// Geometry of the object.
    pub geometry: Geometry,
    /// Placement of the object: any invertible affine map from object to world space.
    pub world_from_object: DAffine3,
    /// Material of the object.
    pub material: Material,
}

/// A scene, ready to be uploaded to a renderer.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Up axis, if known.
    pub up: Option<Up>,
    /// Background colour: linear RGB, and straight alpha in [0, 1].
    pub background: [f64; 4],
    /// Linear RGB of the ambient light.
    pub ambient: [f64; 3],
    /// Lights; `None` means one white directional light along the view.
    pub lights: Option<Vec<Light>>,
    /// Light from all around, which replaces the lights. It must be stored in the splats before a backend can draw the
    /// scene. The package `surfel-light` stores it; the facade's `Backend` calls that package.
    pub sky: Option<Sky>,
    /// Ground that receives the shadows of the sky.
    pub ground: Option<Ground>,
    /// Image for the shader `matcap`; `None` means the built-in one.
    pub matcap: Option<Arc<Matcap>>,
    /// Objects in drawing order. The order affects only rounding.
    pub objects: Vec<Object>,
}

impl Scene {
    /// Validates every number of the scene except those of its geometry, and that a ground has a sky.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] naming the field as in the scene file, [`ModelError::Conflict`] for a ground without
    /// a sky.
    pub fn validate(&self) -> Result<(), ModelError> {
        finite("background", &self.background)?;
        if !(0.0..=1.0).contains(&self.background[3]) {
            return Err(ModelError::range("background alpha", self.background[3], "a number in [0, 1]"));
        }
        finite("ambient", &self.ambient)?;
        for (i, light) in self.lights.iter().flatten().enumerate() {
            light.validate(i)?;
        }
        validate_sky(self.sky.as_ref(), self.ground.as_ref())?;
        for (i, object) in self.objects.iter().enumerate() {
            object.material.validate(i)?;
            let m = object.world_from_object;
            // Relative to the columns' own lengths, so that a tiny scale isn't mistaken for a singular matrix.
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

fn validate_sky(sky: Option<&Sky>, ground: Option<&Ground>) -> Result<(), ModelError> {
    sky.map_or(Ok(()), Sky::validate)?;
    ground.map_or(Ok(()), Ground::validate)?;
    if ground.is_some() && sky.is_none() {
        return Err(ModelError::Conflict("the scene has a ground and no sky, whose shadows fall on it".into()));
    }
    Ok(())
}

impl Scene {
    /// Numbers the splats of all clouds without rows ([`SplatCloud::number_rows`]), so that the planes `index` and
    /// `label` can be rendered. Must be called before the scene is uploaded.
    pub fn number_rows(&mut self) {
        for object in &mut self.objects {
            if let Geometry::Splats(cloud) = &mut object.geometry
                && cloud.data().rows.is_none()
            {
                Arc::make_mut(cloud).number_rows();
            }
        }
    }
}

impl From<SplatCloud> for Geometry {
    fn from(cloud: SplatCloud) -> Self {
        Self::Splats(Arc::new(cloud))
    }
}

impl From<Mesh> for Geometry {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(Arc::new(mesh))
    }
}

impl From<Octree> for Geometry {
    fn from(octree: Octree) -> Self {
        Self::Octree(Arc::new(octree))
    }
}

impl From<GaussianCloud> for Geometry {
    fn from(gaussians: GaussianCloud) -> Self {
        Self::Gaussians(Arc::new(gaussians))
    }
}

/// Creates an object at its geometry's own position, with the default material.
impl<G: Into<Geometry>> From<G> for Object {
    fn from(geometry: G) -> Self {
        Self { geometry: geometry.into(), world_from_object: DAffine3::IDENTITY, material: Material::default() }
    }
}

/// Creates a scene of one object: an [`Object`], or a geometry such as a [`SplatCloud`] or a [`Mesh`]. Ambient light
/// and lights are the defaults of scene files: a dim ambient light, and one white directional light along the view.
impl<O: Into<Object>> From<O> for Scene {
    fn from(object: O) -> Self {
        Self { ambient: DEFAULT_AMBIENT, objects: vec![object.into()], ..Self::default() }
    }
}

/// Default ambient light of a scene file.
pub(crate) const DEFAULT_AMBIENT: [f64; 3] = [0.1; 3];

/// Scene file (`.json`). Unknown keys are errors; paths are relative to the file.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct SceneFile {
    /// Up axis of the scene; `None` if the file doesn't state it.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub up: Option<Up>,
    /// Camera from which the scene is drawn.
    pub camera: Camera,
    /// Background colour: linear RGB, and straight alpha in [0, 1]; transparent black by default. Scene files may also
    /// use `"transparent"`.
    #[cfg_attr(feature = "serde", serde(default, deserialize_with = "background"))]
    pub background: [f64; 4],
    /// Linear RGB of the ambient light.
    #[cfg_attr(feature = "serde", serde(default = "default_ambient"))]
    pub ambient: [f64; 3],
    /// Lights; one white directional light along the view by default.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub lights: Option<Vec<Light>>,
    /// Light from all around, which replaces the lights.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub sky: Option<Sky>,
    /// Ground that receives the shadows of the sky.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub ground: Option<Ground>,
    /// Image of a lit sphere for the shader `matcap`; a built-in one by default.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub matcap: Option<PathBuf>,
    /// Objects to draw.
    pub objects: Vec<ObjectFile>,
    /// Settings of the renderer, such as filter and shader.
    #[cfg_attr(feature = "serde", serde(default))]
    pub settings: Settings,
}

#[cfg(feature = "serde")]
#[derive(Deserialize)]
#[serde(untagged, expecting = "[R, G, B, A] (linear numbers, A from 0 to 1), [R, G, B] or \"transparent\"")]
enum BackgroundKey {
    Rgba([f64; 4]),
    Rgb([f64; 3]),
    Word(Transparent),
}

#[cfg(feature = "serde")]
#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Transparent {
    Transparent,
}

#[cfg(feature = "serde")]
fn background<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<[f64; 4], D::Error> {
    Ok(match BackgroundKey::deserialize(deserializer)? {
        BackgroundKey::Rgba(rgba) => rgba,
        BackgroundKey::Rgb([r, g, b]) => [r, g, b, 1.0],
        BackgroundKey::Word(Transparent::Transparent) => [0.0; 4],
    })
}

#[cfg(feature = "serde")]
fn default_ambient() -> [f64; 3] {
    DEFAULT_AMBIENT
}

/// Object of the scene file, with exactly one of `splats` and `mesh`.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct ObjectFile {
    /// Path of a file of splats, points or a mesh, which is drawn as splats.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub splats: Option<PathBuf>,
    /// Path of a mesh file, which is drawn as polygons.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub mesh: Option<PathBuf>,
    /// Placement `world_from_object`, column-major; the last row is 0 0 0 1.
    #[cfg_attr(feature = "serde", serde(default = "identity"))]
    pub matrix: [f64; 16],
    /// Material of the object, with which its splats or polygons are shaded.
    #[cfg_attr(feature = "serde", serde(default))]
    pub material: Material,
    /// Options of the file's conversion to splats.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "ConvertOptions::is_default"))]
    pub convert: ConvertOptions,
}

#[cfg(feature = "serde")]
fn identity() -> [f64; 16] {
    DMat4::IDENTITY.to_cols_array()
}

impl ObjectFile {
    /// Returns the placement as an affine map.
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

#[cfg(all(test, feature = "serde"))]
mod tests {
    use super::*;

    const MINIMAL: &str = r#"{"camera": {"eye": [0,0,5], "target": [0,0,0],
        "projection": {"perspective": {"fov_y_deg": 45}}, "size": [8, 8]}, "objects": [{"splats": "a.ply"}]}"#;

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
    fn backgrounds_are_written_as_on_the_command_line_too() {
        let read = |value: &str| {
            let text = MINIMAL.replacen("\"objects\"", &format!("\"background\": {value}, \"objects\""), 1);
            serde_json::from_str::<SceneFile>(&text).map(|file| file.background).map_err(|e| e.to_string())
        };
        assert_eq!(read("[0.5, 0.25, 1, 0.5]"), Ok([0.5, 0.25, 1.0, 0.5]));
        assert_eq!(read("[0.5, 0.25, 1]"), Ok([0.5, 0.25, 1.0, 1.0]));
        assert_eq!(read("\"transparent\""), Ok([0.0; 4]));
        for bad in ["\"white\"", "[1, 2]", "1"] {
            assert!(read(bad).unwrap_err().contains("or \"transparent\""), "{bad}");
        }
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
}
