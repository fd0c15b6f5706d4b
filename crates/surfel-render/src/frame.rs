//! Frames: the result of a render as linear f32 planes.

use crate::View;
use crate::background::Background;
use crate::color_plane::ColorPlane;
use surfel_math::srgb::encode_rgba8;
use surfel_model::NO_LABEL;

/// Selection of a frame's planes. Planes that aren't requested are neither computed nor stored.
///
/// Set them by `Planes::COLOR.with_depth(true)` or field by field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Planes {
    /// True for linear colours: premultiplied RGBA.
    pub color: bool,
    /// True for colours in the form of an 8-bit PNG: sRGB-encoded RGBA with straight alpha.
    pub rgba8: bool,
    /// True for planar view-space depths, in world units.
    pub depth: bool,
    /// True for unit normals in world space; for Gaussians, their weighted sum.
    pub normal: bool,
    /// True for Σw, the sum of the splats' weights in each pixel.
    pub weight: bool,
    /// True for the number of fragments that contributed to each pixel.
    pub fragments: bool,
    /// True for the row of the nearest splat in its input file, and its object, in each pixel. Every cloud must have
    /// rows ([`surfel_model::Scene::number_rows`]).
    pub index: bool,
    /// True for the label, such as a class number, of the nearest splat in each pixel; implies `index`.
    pub label: bool,
    /// True for the world positions of the visible points; implies `depth`.
    pub position: bool,
    /// True for the sum of the weights of a pixel's Gaussians, Σw: their accumulated opacity.
    pub alpha: bool,
    /// True for the planar depth in world units at which a pixel's Gaussians have absorbed half of the light.
    pub median_depth: bool,
    /// True for the distortion of 2DGS: the spread of the depths of a pixel's Gaussians.
    pub distortion: bool,
    /// True to mark the pixels that other backends may draw differently: a comparison, such as *inside the splat*, is
    /// within the tolerated margin of flipping. Only the reference backend computes this plane.
    pub margin: bool,
}

impl Planes {
    /// Selection of the linear colour plane alone.
    pub const COLOR: Self = Self {
        color: true,
        rgba8: false,
        depth: false,
        normal: false,
        weight: false,
        fragments: false,
        index: false,
        label: false,
        position: false,
        alpha: false,
        median_depth: false,
        distortion: false,
        margin: false,
    };
    /// Colour, depth, normal and weight. The other planes are requested one by one.
    pub const ALL: Self = Self { depth: true, normal: true, weight: true, ..Self::COLOR };
    /// Colours for a display or an 8-bit PNG: a quarter of the bytes of [`Self::COLOR`].
    pub const RGBA8: Self = Self { color: false, rgba8: true, ..Self::COLOR };

    surfel_model::setters! {
        with_color color: bool,
        with_rgba8 rgba8: bool,
        with_depth depth: bool,
        with_normal normal: bool,
        with_weight weight: bool,
        with_fragments fragments: bool,
        with_index index: bool,
        with_label label: bool,
        with_position position: bool,
        with_alpha alpha: bool,
        with_median_depth median_depth: bool,
        with_distortion distortion: bool,
        with_margin margin: bool,
    }

    /// Returns the requested planes together with the planes that they are computed from.
    #[must_use]
    pub(crate) fn complete(self) -> Self {
        let (index, depth, color) = (self.index || self.label, self.depth || self.position, self.shows_color());
        self.with_index(index).with_depth(depth).with_color(color)
    }

    /// True if pixels are shaded, for linear or for 8-bit colours.
    pub fn shows_color(self) -> bool {
        self.color || self.rgba8
    }
}

/// Planes of a rendered region, row by row from the top: pixel (x, y) is at `y * width + x`. Planes that weren't
/// requested are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    width: u32,
    height: u32,
    color: ColorPlane,
    rgba8: Vec<[u8; 4]>,
    depth: Vec<f32>,
    normal: Vec<[f32; 3]>,
    weight: Vec<f32>,
    fragments: Vec<u32>,
    index: Vec<u32>,
    object: Vec<u32>,
    label: Vec<u32>,
    position: Vec<[f64; 3]>,
    alpha: Vec<f32>,
    median_depth: Vec<f32>,
    distortion: Vec<f32>,
    margin: Vec<f32>,
    /// Record of the squares that contain only background, for backends that skip them in the next image.
    background: Background,
}

/// Identity of the nearest surface in a pixel: its object and, for a splat, its row and label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Row of the splat in its input file; [`NO_LABEL`] for a polygon.
    pub row: u32,
    /// Index of the object in the scene; [`NO_LABEL`] for none.
    pub object: u32,
    /// Label of the splat; [`NO_LABEL`] if it has none.
    pub label: u32,
}

impl Identity {
    /// Identity of a pixel without a surface.
    pub const NOTHING: Self = Self { row: NO_LABEL, object: NO_LABEL, label: NO_LABEL };
}

/// Planes of a [`Frame`] as owned vectors, for callers that need them without the frame. Absent planes are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FramePlanes {
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Linear RGBA, premultiplied, with a few unused values before and after it.
    pub color: Vec<[f32; 4]>,
    /// Index in `color` of the first pixel.
    pub first: usize,
    /// sRGB-encoded RGBA of 8 bits, straight alpha.
    pub rgba8: Vec<[u8; 4]>,
    /// Planar view-space depth in world units; +∞ where nothing is visible.
    pub depth: Vec<f32>,
    /// Unit normals in world space, or for Gaussians their weighted sum Σw·n; zero where nothing is visible.
    pub normal: Vec<[f32; 3]>,
    /// Sum of the splats' weights in each pixel, Σw; 0 where nothing is visible.
    pub weight: Vec<f32>,
    /// Number of fragments that contributed to each pixel.
    pub fragments: Vec<u32>,
    /// Row of the nearest splat in its input file, per pixel; [`NO_LABEL`] for none.
    pub index: Vec<u32>,
    /// Index in the scene of the nearest object, per pixel; [`NO_LABEL`] for none.
    pub object: Vec<u32>,
    /// Label of the nearest splat, per pixel; [`NO_LABEL`] for none.
    pub label: Vec<u32>,
    /// Positions in world space; +∞ where nothing is visible.
    pub position: Vec<[f64; 3]>,
    /// Sum of the weights of a pixel's Gaussians, Σw: their accumulated opacity.
    pub alpha: Vec<f32>,
    /// Planar depth in world units at which a pixel's Gaussians have absorbed half of the light; +∞ where nothing is
    /// visible.
    pub median_depth: Vec<f32>,
    /// Distortion of 2DGS: the spread of the depths of a pixel's Gaussians; 0 where nothing is visible.
    pub distortion: Vec<f32>,
    /// 1 in pixels that other backends may draw differently, because a comparison is within the tolerated margin of
    /// flipping; else 0.
    pub margin: Vec<f32>,
}

/// All planes of a [`Frame`], borrowed for writing together; absent planes are empty.
#[derive(Debug)]
pub struct PlanesMut<'a> {
    /// Linear RGBA, premultiplied.
    pub color: &'a mut [[f32; 4]],
    /// sRGB-encoded RGBA of 8 bits, straight alpha.
    pub rgba8: &'a mut [[u8; 4]],
    /// Planar view-space depth in world units; +∞ where nothing is visible.
    pub depth: &'a mut [f32],
    /// Unit normals in world space, or for Gaussians their weighted sum Σw·n; zero where nothing is visible.
    pub normal: &'a mut [[f32; 3]],
    /// Sum of the splats' weights in each pixel, Σw; 0 where nothing is visible.
    pub weight: &'a mut [f32],
    /// Number of fragments that contributed to each pixel.
    pub fragments: &'a mut [u32],
    /// Nearest splat of each pixel, as a number of the backend's choice, which [`Frame::finish`] replaces by the
    /// splat's row.
    pub index: &'a mut [u32],
    /// Sum of the weights of a pixel's Gaussians, Σw: their accumulated opacity.
    pub alpha: &'a mut [f32],
    /// Planar depth in world units at which a pixel's Gaussians have absorbed half of the light; +∞ where nothing is
    /// visible.
    pub median_depth: &'a mut [f32],
    /// Distortion of 2DGS: the spread of the depths of a pixel's Gaussians; 0 where nothing is visible.
    pub distortion: &'a mut [f32],
    /// 1 in pixels that other backends may draw differently, because a comparison is within the tolerated margin of
    /// flipping; else 0.
    pub margin: &'a mut [f32],
}

macro_rules! planes {
    ($($(#[$doc:meta])* $plane:ident, $plane_mut:ident: $value:ty;)*) => {
        $(
            $(#[$doc])*
            pub fn $plane(&self) -> &[$value] {
                &self.$plane
            }

            #[doc = concat!("[`Frame::", stringify!($plane), "`], to be written.")]
            pub fn $plane_mut(&mut self) -> &mut [$value] {
                self.background.forget();
                &mut self.$plane
            }
        )*
    };
}

impl Frame {
    /// Returns the number of columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    planes! {
        /// Returns linear RGBA, premultiplied.
        color, color_mut: [f32; 4];
        /// Returns sRGB-encoded RGBA of 8 bits with straight alpha, as stored in a PNG: [`encode_rgba8`] of the
        /// colours.
        rgba8, rgba8_mut: [u8; 4];
        /// Returns planar view-space depth Z = Σwz/Σw, in world units; +∞ where nothing is visible.
        depth, depth_mut: f32;
        /// Returns unit normals in world space; zero where nothing is visible. For Gaussians, returns the weighted sum
        /// Σw·n, whose length is at most their accumulated opacity.
        normal, normal_mut: [f32; 3];
        /// Returns the sum of the splats' weights in each pixel, Σw; 0 where nothing is visible.
        weight, weight_mut: f32;
        /// Returns the number of fragments that contributed to each pixel.
        fragments, fragments_mut: u32;
        /// Returns the row of the nearest splat in its input file, the lowest of equally near ones; 4294967295 if there
        /// is none.
        index, index_mut: u32;
        /// Returns the index of the nearest object of the scene; 4294967295 where nothing is visible.
        object, object_mut: u32;
        /// Returns the label of the nearest splat; 4294967295 if there is none.
        label, label_mut: u32;
        /// Returns the world position of the visible point, at depth Z; +∞ where nothing is visible.
        position, position_mut: [f64; 3];
        /// Returns the accumulated opacity of a pixel's Gaussians: the sum of their weights, Σw, in [0, 1].
        alpha, alpha_mut: f32;
        /// Returns the planar depth, in world units, of the last Gaussian in front of which more than half of the light
        /// remains; +∞ where nothing is visible.
        median_depth, median_depth_mut: f32;
        /// Returns the distortion of 2DGS; 0 where nothing is visible. The distortion is the sum, over pairs of
        /// Gaussians, of their weights times the squared difference of their depths.
        distortion, distortion_mut: f32;
        /// Returns 1 in pixels that other backends may draw differently, because a comparison is within the tolerated
        /// margin of flipping; else 0.
        margin, margin_mut: f32;
    }

    /// Returns the planes as owned vectors, without a copy.
    pub fn into_planes(self) -> FramePlanes {
        let (color, first) = self.color.into_memory();
        FramePlanes {
            width: self.width,
            height: self.height,
            color,
            first,
            rgba8: self.rgba8,
            depth: self.depth,
            normal: self.normal,
            weight: self.weight,
            fragments: self.fragments,
            index: self.index,
            object: self.object,
            label: self.label,
            position: self.position,
            alpha: self.alpha,
            median_depth: self.median_depth,
            distortion: self.distortion,
            margin: self.margin,
        }
    }

    /// Returns the selection of planes that the frame contains.
    fn which_planes(&self) -> Planes {
        Planes {
            color: !self.color.is_empty(),
            rgba8: !self.rgba8.is_empty(),
            depth: !self.depth.is_empty(),
            normal: !self.normal.is_empty(),
            weight: !self.weight.is_empty(),
            fragments: !self.fragments.is_empty(),
            index: !self.index.is_empty(),
            label: !self.label.is_empty(),
            position: !self.position.is_empty(),
            alpha: !self.alpha.is_empty(),
            median_depth: !self.median_depth.is_empty(),
            distortion: !self.distortion.is_empty(),
            margin: !self.margin.is_empty(),
        }
    }

    /// Returns all planes for writing.
    pub fn planes_mut(&mut self) -> PlanesMut<'_> {
        self.background.forget();
        self.planes_and_background().0
    }

    /// Returns all planes for writing, and the record of squares that contain only background. For backends that update
    /// both consistently.
    pub fn planes_and_background(&mut self) -> (PlanesMut<'_>, &mut Background) {
        let planes = PlanesMut {
            color: &mut self.color,
            rgba8: &mut self.rgba8,
            depth: &mut self.depth,
            normal: &mut self.normal,
            weight: &mut self.weight,
            fragments: &mut self.fragments,
            index: &mut self.index,
            alpha: &mut self.alpha,
            median_depth: &mut self.median_depth,
            distortion: &mut self.distortion,
            margin: &mut self.margin,
        };
        (planes, &mut self.background)
    }

    /// Sets the frame's size and planes, and fills the planes with the values of an empty image.
    pub fn reset(&mut self, width: u32, height: u32, planes: Planes) {
        let pixels = width as usize * height as usize;
        let count = |wanted: bool| if wanted { pixels } else { 0 };
        self.background.forget();
        (self.width, self.height) = (width, height);
        self.color.resize(count(planes.color));
        self.color.fill([0.0; 4]);
        refill(&mut self.rgba8, count(planes.rgba8), [0; 4]);
        refill(&mut self.depth, count(planes.depth), f32::INFINITY);
        refill(&mut self.normal, count(planes.normal), [0.0; 3]);
        refill(&mut self.weight, count(planes.weight), 0.0);
        refill(&mut self.fragments, count(planes.fragments), 0);
        refill(&mut self.index, count(planes.index), NO_LABEL);
        refill(&mut self.object, count(planes.index), NO_LABEL);
        refill(&mut self.label, count(planes.label), NO_LABEL);
        refill(&mut self.position, count(planes.position), [f64::INFINITY; 3]);
        refill(&mut self.alpha, count(planes.alpha), 0.0);
        refill(&mut self.median_depth, count(planes.median_depth), f32::INFINITY);
        refill(&mut self.distortion, count(planes.distortion), 0.0);
        refill(&mut self.margin, count(planes.margin), 0.0);
    }

    /// Sets the frame's size and planes, for backends that write every pixel. If size or planes change, the contents
    /// are unspecified; otherwise they remain.
    pub fn resize(&mut self, width: u32, height: u32, planes: Planes) {
        let pixels = width as usize * height as usize;
        if [self.width, self.height] != [width, height] || self.which_planes() != planes {
            self.background.forget();
        }
        let count = |wanted: bool| if wanted { pixels } else { 0 };
        (self.width, self.height) = (width, height);
        self.color.resize(count(planes.color));
        resize(&mut self.rgba8, count(planes.rgba8), [0; 4]);
        resize(&mut self.depth, count(planes.depth), 0.0);
        resize(&mut self.normal, count(planes.normal), [0.0; 3]);
        resize(&mut self.weight, count(planes.weight), 0.0);
        resize(&mut self.fragments, count(planes.fragments), 0);
        resize(&mut self.index, count(planes.index), 0);
        resize(&mut self.object, count(planes.index), 0);
        resize(&mut self.label, count(planes.label), 0);
        resize(&mut self.position, count(planes.position), [0.0; 3]);
        resize(&mut self.alpha, count(planes.alpha), 0.0);
        resize(&mut self.median_depth, count(planes.median_depth), 0.0);
        resize(&mut self.distortion, count(planes.distortion), 0.0);
        resize(&mut self.margin, count(planes.margin), 0.0);
    }
}

impl Frame {
    /// Computes the planes that derive from others: `index`, `object`, `label` and `position`. Backends call this after
    /// all other planes are written. `identity` converts the backend's numbers in the plane `index` to identities.
    /// Without that plane, `identity` isn't called.
    pub fn finish(&mut self, view: &View, identity: impl Fn(u32) -> Identity) {
        for at in 0..self.index.len() {
            self.put_identity(at, identity(self.index[at]));
        }
        self.locate(view);
    }

    /// Fills the plane `rgba8` from the linear colours if `planes` has `rgba8`; drops the linear colours unless
    /// `planes` has `color`, too. Called by backends that don't encode colours while drawing.
    pub fn encode(&mut self, planes: Planes) {
        if planes.rgba8 {
            for (encoded, color) in self.rgba8.iter_mut().zip(&*self.color) {
                *encoded = encode_rgba8(*color);
            }
            self.drop_color(planes);
        }
    }

    /// Drops the linear colours unless `planes` has `color`: they were needed only for the plane `rgba8`. Called by
    /// backends.
    pub fn drop_color(&mut self, planes: Planes) {
        if !planes.color {
            self.color.resize(0);
        }
    }

    /// Writes the identity of the nearest surface to the pixel with index `at`, in those of the planes `index`,
    /// `object` and `label` that the frame has. Called by backends.
    pub fn put_identity(&mut self, at: usize, found: Identity) {
        let planes = [(&mut self.index, found.row), (&mut self.object, found.object), (&mut self.label, found.label)];
        for (plane, value) in planes {
            if let Some(pixel) = plane.get_mut(at) {
                *pixel = value;
            }
        }
    }

    /// Computes the plane of world positions from depths, if the frame has that plane; called by backends.
    pub fn locate(&mut self, view: &View) {
        let width = (self.width as usize).max(1);
        for (at, (position, z)) in self.position.iter_mut().zip(&self.depth).enumerate() {
            let pixel = [view.region.x as usize + at % width, view.region.y as usize + at / width];
            *position = view.world_position(pixel.map(|i| i as f64 + 0.5), f64::from(*z));
        }
    }
}

/// Resizes a plane. New memory is zeroed by the system on first access, so that all threads share the cost when they
/// write the pixels.
fn resize<T: Clone>(plane: &mut Vec<T>, count: usize, zero: T) {
    if plane.capacity() < count {
        // The old memory is freed first, so that both never exist at once.
        *plane = Vec::new();
        *plane = vec![zero; count];
    } else {
        plane.resize(count, zero);
    }
}

fn refill<T: Clone>(plane: &mut Vec<T>, count: usize, value: T) {
    plane.clear();
    plane.resize(count, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn owned_planes_are_those_of_the_frame() {
        let planes = Planes {
            color: true,
            rgba8: true,
            depth: true,
            normal: true,
            weight: true,
            fragments: true,
            index: true,
            label: true,
            position: true,
            alpha: true,
            median_depth: true,
            distortion: true,
            margin: true,
        };
        let mut frame = Frame::default();
        frame.reset(3, 2, planes);
        let owned = frame.into_planes();
        let lengths = [
            owned.rgba8.len(),
            owned.depth.len(),
            owned.normal.len(),
            owned.weight.len(),
            owned.fragments.len(),
            owned.index.len(),
            owned.object.len(),
            owned.label.len(),
            owned.position.len(),
            owned.alpha.len(),
            owned.median_depth.len(),
            owned.distortion.len(),
            owned.margin.len(),
        ];
        assert_eq!((owned.width, owned.height, lengths), (3, 2, [6; 13]));
        assert!(owned.color.len() >= owned.first + 6, "{} {}", owned.color.len(), owned.first);
    }
}
