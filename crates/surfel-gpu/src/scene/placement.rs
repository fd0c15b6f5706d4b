//! Objects whose splats the embedding application places on the device, frame by frame. "Host" in names of this module
//! means the application, not the CPU.

use crate::scene::segment::{Segment, UploadedScene};
use crate::struct_writer::StructWriter;
use glam::DVec3;
use std::sync::Arc;
use surfel_model::Storage;
use surfel_shaders::layout;

/// Bounding sphere of the splats of an object that the application places. The CPU has no other data about the
/// positions of these splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedBounds {
    /// Centre in object space.
    pub center: DVec3,
    /// Radius in object units. The sphere contains the splats, not only their centres.
    pub radius: f64,
}

/// Attribute of a splat in the application's buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostAttribute {
    /// Offset within a splat, in bytes.
    pub offset: u32,
    /// Format of the attribute.
    pub format: HostFormat,
}

/// Format of a normal or colour in the application's buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum HostFormat {
    /// Three f32 numbers, 12 bytes.
    F32x3,
    /// Four bytes, of which the last is ignored. A byte b of a linear colour is b/255, and one of a normal 2b/255 − 1.
    Unorm8x4,
    /// Four bytes of an sRGB-encoded colour, of which the last is ignored. Normals can't have this format.
    Srgb8x4,
}

impl HostFormat {
    /// Returns the size of the attribute in bytes.
    pub fn bytes(self) -> u32 {
        if self == Self::F32x3 { 12 } else { 4 }
    }

    /// Returns the shaders' number of the format.
    fn code(self) -> u32 {
        match self {
            Self::F32x3 => layout::HOST_F32X3,
            Self::Unorm8x4 => layout::HOST_UNORM8X4,
            Self::Srgb8x4 => layout::HOST_SRGB8X4,
        }
    }
}

/// Layout of splats in the application's buffer, and the box that contains their centres. Offsets are relative to the
/// beginning of a splat.
///
/// Splat i of the object begins at byte i × `stride`. The stride and all offsets are multiples of four bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostLayout {
    /// Number of splats in the buffer, at most that of the object. The object's splats from this index on aren't drawn.
    pub count: u32,
    /// Distance from one splat to the next, in bytes.
    pub stride: u32,
    /// Offset of the centre, in bytes: three f32 numbers in object space.
    pub position: u32,
    /// Normal in object space, of any length; `None` if the splats keep their normals.
    pub normal: Option<HostAttribute>,
    /// Albedo; `None` if the splats keep their colours.
    pub color: Option<HostAttribute>,
    /// Least and greatest corner of a box that contains the centres, in object space. Splats whose centre is outside
    /// aren't drawn.
    pub bounds: [[f32; 3]; 2],
}

impl HostLayout {
    /// Checks the layout against the size of the buffer, in bytes.
    ///
    /// # Errors
    /// A message with what is wrong and what is expected.
    pub fn check(&self, buffer_bytes: u64) -> Result<(), String> {
        let position = HostAttribute { offset: self.position, format: HostFormat::F32x3 };
        let named = [("position", Some(position)), ("normal", self.normal), ("color", self.color)];
        if !self.stride.is_multiple_of(4) {
            return Err(format!("the stride is {} bytes, expected a multiple of 4", self.stride));
        }
        for (name, attribute) in named {
            let Some(HostAttribute { offset, format }) = attribute else { continue };
            if !offset.is_multiple_of(4) {
                return Err(format!("the offset of the {name} is {offset} bytes, expected a multiple of 4"));
            }
            let end = u64::from(offset) + u64::from(format.bytes());
            if end > u64::from(self.stride) {
                let stride = self.stride;
                return Err(format!("the {name} ends at byte {end} of a splat, expected at most the stride {stride}"));
            }
        }
        if self.normal.is_some_and(|normal| normal.format == HostFormat::Srgb8x4) {
            return Err("the format of the normal is Srgb8x4, expected F32x3 or Unorm8x4".to_owned());
        }
        let needed = u64::from(self.count) * u64::from(self.stride);
        if needed > buffer_bytes {
            let count = self.count;
            return Err(format!("{count} splats need {needed} bytes, but the buffer has {buffer_bytes}"));
        }
        let [low, high] = self.bounds;
        let is_ordered = low.iter().zip(&high).all(|(low, high)| low.is_finite() && high.is_finite() && low <= high);
        if !is_ordered {
            return Err(format!("the box is {low:?} to {high:?}, expected finite corners, the least one first"));
        }
        Ok(())
    }

    /// Returns the words of the shaders' `HostSplats`.
    pub fn words(&self) -> Vec<u32> {
        use layout::host_splats as at;
        let mut words = StructWriter::new(at::SIZE);
        let [low, high] = self.bounds.map(|corner| corner.map(f64::from));
        words.f64s(at::BOX_LOW, low).f64s(at::BOX_HIGH, high);
        words.u32(at::STRIDE, self.stride / 4).u32(at::COUNT, self.count).u32(at::POSITION_AT, self.position / 4);
        let offset = |attribute: Option<HostAttribute>| attribute.map_or(layout::ABSENT, |a| a.offset / 4);
        let format = |attribute: Option<HostAttribute>| attribute.map_or(0, |a| a.format.code());
        words.u32(at::NORMAL_AT, offset(self.normal)).u32(at::NORMAL_FORMAT, format(self.normal));
        words.u32(at::COLOR_AT, offset(self.color)).u32(at::COLOR_FORMAT, format(self.color));
        words.into_words()
    }
}

impl UploadedScene {
    /// Marks the splats of object number `source` of the scene as placed by the application, within the layout's box.
    /// Returns the indices of the object's segments. The words of these segments' `uniform`s may have changed.
    ///
    /// # Errors
    /// A message with what is wrong and what is expected.
    pub fn place(&mut self, source: usize, host: &HostLayout) -> Result<Vec<usize>, String> {
        let is_of_source = |of: u32| of as usize == source;
        let Some(object) = self.objects.iter().position(|object| is_of_source(object.source)) else {
            return Err(self.without_splats(source));
        };
        let Some(uploaded) = self.objects.get(object) else { return Err(self.without_splats(source)) };
        if uploaded.octree.is_some() {
            return Err(format!("object {source} is an octree, expected a cloud of splats"));
        }
        if self.storage != Storage::F32 {
            return Err("splats are stored in 16 bits, and a host places f32 ones: open the renderer with \
                        `Storage::F32`"
                .to_owned());
        }
        let splats = uploaded.cloud.len();
        if host.count as usize > splats {
            return Err(format!(
                "the buffer has {} splats, expected at most the {splats} of object {source}",
                host.count
            ));
        }
        let own = |segment: &Segment| segment.object as usize == object;
        let word = |segment: &Segment, at: usize| segment.uniform.get(at / 4).copied();
        for segment in self.segments.iter().filter(|segment| own(segment)) {
            if host.normal.is_some() && word(segment, layout::segment::IS_DISK) != Some(1) {
                return Err(format!("object {source} consists of ellipses, which keep their normals, expected disks"));
            }
            if host.color.is_some() && word(segment, layout::segment::COLOR_AT) == Some(layout::ABSENT) {
                return Err(format!("object {source} was uploaded without colours, expected some colour per splat"));
            }
        }
        let [low, high] = host.bounds.map(|corner| DVec3::from(corner.map(f64::from)));
        let mut placed = Vec::new();
        for (index, segment) in self.segments.iter_mut().enumerate().filter(|(_, segment)| own(segment)) {
            let largest = match segment.placed {
                Some(placed) => placed.largest_radius,
                None => segment.chunks.iter().map(|chunk| chunk.largest_radius).fold(0.0, f64::max),
            };
            let bounds = PlacedBounds { center: 0.5 * (low + high), radius: 0.5 * (high - low).length() + largest };
            segment.placed = Some(Placed { bounds, largest_radius: largest });
            if let Some(word) = segment.uniform.get_mut(layout::segment::IS_PLACED / 4) {
                *word = 1;
            }
            placed.push(index);
        }
        self.cast_shadows_from_placed();
        // Shadow maps show the splats where they were.
        self.identity = Arc::new(());
        Ok(placed)
    }

    /// Returns the message for an object that has no splats.
    fn without_splats(&self, source: usize) -> String {
        let is_own = |of: u32| of as usize == source;
        let what = if self.balls.iter().any(|object| is_own(object.source)) {
            "balls"
        } else if self.meshes.iter().any(|object| is_own(object.source)) {
            "polygons"
        } else if self.gaussians.iter().any(|object| is_own(object.source)) {
            "trained Gaussians"
        } else {
            return format!("the scene has no splats of object {source}");
        };
        format!("object {source} consists of {what}, expected splats")
    }

    /// Sets the scene's bounds for shadow maps to those of the uploaded scene, extended by the bounds of the splats
    /// that the application places.
    pub(crate) fn cast_shadows_from_placed(&mut self) {
        self.summary.shadows.clone_from(&self.uploaded_shadows);
        let Some(shadows) = &mut self.summary.shadows else { return };
        for segment in &self.segments {
            let (Some(placed), Some(object)) = (segment.placed, self.objects.get(segment.object as usize)) else {
                continue;
            };
            let m = &object.world_from_object;
            // The Frobenius norm bounds the largest singular value.
            let stretch = m.matrix3.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
            shadows.include(m.transform_point3(placed.bounds.center), placed.bounds.radius * stretch);
        }
    }
}

/// Bounds and sizes of the splats of a segment that the application places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Bounds of all the segment's splats.
    pub bounds: PlacedBounds,
    /// Larger semi-axis of the largest splat, in object units.
    pub(crate) largest_radius: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Limits, Upload};
    use surfel_model::{Geometry, Mesh, Object, Scene, SplatCloud};

    const HOST: HostLayout = HostLayout {
        count: 2,
        stride: 28,
        position: 0,
        normal: Some(HostAttribute { offset: 12, format: HostFormat::F32x3 }),
        color: Some(HostAttribute { offset: 24, format: HostFormat::Srgb8x4 }),
        bounds: [[-1.0, -2.0, -3.0], [3.0, 2.0, 3.0]],
    };

    fn uploaded(scene: &Scene, storage: Storage) -> UploadedScene {
        let mut upload = Upload::new(scene, storage, Limits::default(), "test").unwrap();
        while upload.next_segment().is_some() {}
        upload.finish()
    }

    fn cloud() -> SplatCloud {
        let cloud = SplatCloud::disks(&[[0.0; 3], [1.0; 3]], &[[0.0, 0.0, 1.0]; 2], &[0.5, 0.25]).unwrap();
        cloud.with_colors(&[[0.5; 3]; 2]).unwrap()
    }

    #[test]
    fn layout_is_checked_before_the_device_sees_it() {
        assert_eq!(HOST.check(56), Ok(()));
        let wrong = |layout: HostLayout, words: &str| {
            let message = layout.check(56).unwrap_err();
            assert!(message.contains(words), "{message}");
        };
        let at = |offset, format| Some(HostAttribute { offset, format });
        wrong(HostLayout { count: 3, ..HOST }, "3 splats need 84 bytes, but the buffer has 56");
        wrong(HostLayout { stride: 26, ..HOST }, "stride is 26 bytes, expected a multiple of 4");
        wrong(HostLayout { position: 2, ..HOST }, "offset of the position is 2 bytes, expected a multiple of 4");
        wrong(
            HostLayout { position: 20, ..HOST },
            "the position ends at byte 32 of a splat, expected at most the stride 28",
        );
        wrong(HostLayout { position: u32::MAX - 3, ..HOST }, "the position ends at byte 4294967304");
        wrong(HostLayout { normal: at(12, HostFormat::Srgb8x4), ..HOST }, "the normal is Srgb8x4, expected F32x3");
        wrong(HostLayout { color: at(28, HostFormat::Unorm8x4), ..HOST }, "the color ends at byte 32");
        wrong(HostLayout { bounds: [[1.0; 3], [0.0; 3]], ..HOST }, "expected finite corners, the least one first");
        wrong(HostLayout { bounds: [[f32::NAN; 3], [0.0; 3]], ..HOST }, "expected finite corners");
    }

    #[test]
    fn object_that_a_host_places_has_the_host_s_bounds_and_its_own_radii() {
        let mut scene = uploaded(&Scene::from(cloud()), Storage::F32);
        let identity = scene.identity.clone();
        assert_eq!(scene.place(0, &HOST), Ok(vec![0]));
        let placed = scene.segments[0].placed.unwrap().bounds;
        assert_eq!(placed.center, DVec3::new(1.0, 0.0, 0.0));
        // Half the diagonal of a box of 4×4×6, and the largest radius, which chunks round up by 1e-4.
        assert!((placed.radius - (17f64.sqrt() + 0.5)).abs() < 1e-3, "{placed:?}");
        assert_eq!(scene.segments[0].uniform[layout::segment::IS_PLACED / 4], 1);
        assert!(!Arc::ptr_eq(&identity, &scene.identity), "shadow maps of the old places are reused");
    }

    #[test]
    fn object_that_a_host_can_t_place_is_refused() {
        let refused = |scene: Scene, storage, object, layout: HostLayout, words: &str| {
            let message = uploaded(&scene, storage).place(object, &layout).unwrap_err();
            assert!(message.contains(words), "{message}");
        };
        let colorless = SplatCloud::disks(&[[0.0; 3]; 2], &[[0.0, 0.0, 1.0]; 2], &[0.5; 2]).unwrap();
        let ellipses = SplatCloud::ellipses(&[[0.0; 3]; 2], &[[0.5, 0.0, 0.0]; 2], &[[0.0, 0.2, 0.0]; 2]).unwrap();
        refused(Scene::from(cloud()), Storage::F32, 1, HOST, "the scene has no splats of object 1");
        refused(Scene::from(cloud()), Storage::Quantised, 0, HOST, "stored in 16 bits");
        refused(Scene::from(cloud()), Storage::F32, 0, HostLayout { count: 3, ..HOST }, "at most the 2 of object 0");
        refused(Scene::from(colorless), Storage::F32, 0, HOST, "uploaded without colours");
        refused(Scene::from(ellipses), Storage::F32, 0, HostLayout { color: None, ..HOST }, "ellipses");
        let mut mesh = Scene::from(cloud());
        mesh.objects.push(Object::from(Geometry::Mesh(Arc::new(Mesh::default()))));
        refused(mesh, Storage::F32, 1, HOST, "object 1 consists of polygons, expected splats");
    }
}
