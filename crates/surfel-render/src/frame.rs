//! What a render gives back: linear f32 planes.

use crate::View;
use crate::background::Background;
use crate::color_plane::ColorPlane;
use surfel_math::srgb::encode_rgba8;
use surfel_model::NO_LABEL;

/// Which planes are wanted. A plane nobody asked for is neither computed nor stored.
///
/// `Planes::COLOR.with_depth(true)`, or the fields one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Planes {
    /// Premultiplied linear RGBA.
    pub color: bool,
    /// The same as a PNG of 8 bits holds it.
    pub rgba8: bool,
    /// Planar view-space depth.
    pub depth: bool,
    /// World normals.
    pub normal: bool,
    /// Σw.
    pub weight: bool,
    /// Fragments that contributed to each pixel.
    pub fragments: bool,
    /// Which splat is nearest in each pixel, by its row, and its object. Every cloud must have rows
    /// ([`surfel_model::Scene::number_rows`]).
    pub index: bool,
    /// The nearest splat's label; `index` comes with it.
    pub label: bool,
    /// World positions; `depth` comes with them.
    pub position: bool,
    /// Σw of Gaussians: what they cover.
    pub alpha: bool,
    /// Depth at which half of the light of Gaussians is gone.
    pub median_depth: bool,
    /// How far the depths of a pixel's Gaussians are spread.
    pub distortion: bool,
    /// Pixels whose result hangs on a decision within its margin (reference backend only).
    pub margin: bool,
}

impl Planes {
    /// Colour alone.
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
    /// Everything an EXR file holds that asks for no more.
    pub const ALL: Self = Self { depth: true, normal: true, weight: true, ..Self::COLOR };
    /// What a display or a PNG of 8 bits shows: a quarter of the bytes of [`Self::COLOR`].
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

    /// With the planes that those asked for come from.
    #[must_use]
    pub(crate) fn complete(self) -> Self {
        let (index, depth, color) = (self.index || self.label, self.depth || self.position, self.shows_color());
        self.with_index(index).with_depth(depth).with_color(color)
    }

    /// True if pixels are shaded, whether their colours are kept as they are or in 8 bits.
    pub fn shows_color(self) -> bool {
        self.color || self.rgba8
    }
}

/// Planes of a rendered region, row by row from the top: pixel (x, y) is at `y * width + x`. A plane that wasn't asked
/// for is empty.
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
    background: Background,
}

/// What is nearest in a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Row of the splat in its input; [`NO_LABEL`] for a polygon.
    pub row: u32,
    /// Index of the scene's object.
    pub object: u32,
    /// The splat's label, [`NO_LABEL`] where it has none.
    pub label: u32,
}

impl Identity {
    /// Where nothing is.
    pub const NOTHING: Self = Self { row: NO_LABEL, object: NO_LABEL, label: NO_LABEL };
}

/// The planes of a [`Frame`], given up by it; those that it didn't have are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FramePlanes {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear RGBA, premultiplied, and a few values around it that mean nothing.
    pub color: Vec<[f32; 4]>,
    /// Where in `color` the first pixel is.
    pub first: usize,
    /// sRGB-encoded RGBA of 8 bits, straight alpha.
    pub rgba8: Vec<[u8; 4]>,
    /// Planar view-space depth.
    pub depth: Vec<f32>,
    /// World normals.
    pub normal: Vec<[f32; 3]>,
    /// Σw.
    pub weight: Vec<f32>,
    /// Rows of the nearest splats.
    pub index: Vec<u32>,
    /// Objects that are nearest.
    pub object: Vec<u32>,
    /// Labels of the nearest splats.
    pub label: Vec<u32>,
    /// World positions.
    pub position: Vec<[f64; 3]>,
    /// What Gaussians cover.
    pub alpha: Vec<f32>,
    /// Median depths of Gaussians.
    pub median_depth: Vec<f32>,
    /// Spread of their depths.
    pub distortion: Vec<f32>,
}

/// All planes of a [`Frame`], to be written at once; those that it doesn't have are empty.
#[derive(Debug)]
pub struct PlanesMut<'a> {
    /// Linear RGBA, premultiplied.
    pub color: &'a mut [[f32; 4]],
    /// sRGB-encoded, 8 bits, straight alpha.
    pub rgba8: &'a mut [[u8; 4]],
    /// Planar view-space depth.
    pub depth: &'a mut [f32],
    /// World normals.
    pub normal: &'a mut [[f32; 3]],
    /// Σw.
    pub weight: &'a mut [f32],
    /// Number of fragments.
    pub fragments: &'a mut [u32],
    /// What is nearest, by numbers of the backend's own until [`Frame::identify`].
    pub index: &'a mut [u32],
    /// What Gaussians cover.
    pub alpha: &'a mut [f32],
    /// Median depths of Gaussians.
    pub median_depth: &'a mut [f32],
    /// Spread of their depths.
    pub distortion: &'a mut [f32],
    /// Decisions within their margin.
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
    /// Columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    planes! {
        /// Linear RGBA, premultiplied.
        color, color_mut: [f32; 4];
        /// sRGB-encoded RGBA of 8 bits, straight alpha, as a PNG holds it: [`encode_rgba8`] of
        /// the colours.
        rgba8, rgba8_mut: [u8; 4];
        /// Planar view-space depth Z = Σwz/Σw, world units; +∞ where nothing is.
        depth, depth_mut: f32;
        /// Unit world normals; zero where nothing is. Of Gaussians Σw·n, which is as long as they cover.
        normal, normal_mut: [f32; 3];
        /// Σw.
        weight, weight_mut: f32;
        /// Number of fragments that contributed.
        fragments, fragments_mut: u32;
        /// Row of the nearest splat in its input, of equally near ones the lowest; 4294967295 where there is none.
        index, index_mut: u32;
        /// Index of the scene's object that is nearest; 4294967295 where nothing is.
        object, object_mut: u32;
        /// Label of the nearest splat; 4294967295 where there is none.
        label, label_mut: u32;
        /// World position of what is seen at Z; +∞ where nothing is.
        position, position_mut: [f64; 3];
        /// Σw of Gaussians, in [0, 1].
        alpha, alpha_mut: f32;
        /// Depth of the last Gaussian before which more than half of the light is left; +∞ where nothing is.
        median_depth, median_depth_mut: f32;
        /// Σ over pairs of Gaussians of their weights times the squared difference of their depths, in the measure of
        /// 2DGS; 0 where nothing is.
        distortion, distortion_mut: f32;
        /// 1 where a decision is within its margin, else 0.
        margin, margin_mut: f32;
    }

    /// Gives the planes up, without a copy.
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
            index: self.index,
            object: self.object,
            label: self.label,
            position: self.position,
            alpha: self.alpha,
            median_depth: self.median_depth,
            distortion: self.distortion,
        }
    }

    /// Which planes there are.
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

    /// All planes, to be written.
    pub fn planes_mut(&mut self) -> PlanesMut<'_> {
        self.background.forget();
        self.planes_and_background().0
    }

    /// All planes, to be written, and where they hold the background alone, for backends that keep both true to each
    /// other.
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

    /// Sets size and planes; contents are whatever an empty image has.
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

    /// Sets size and planes; what the pixels hold is left open, but stays if neither changes. For backends that write
    /// every pixel.
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
    /// For backends: finishes the planes that follow from others, when all of these are written. `identity` says what
    /// the numbers in the plane `index` stand for; it isn't called where that isn't there.
    pub fn finish(&mut self, view: &View, identity: impl Fn(u32) -> Identity) {
        for at in 0..self.index.len() {
            self.put_identity(at, identity(self.index[at]));
        }
        self.locate(view);
    }

    /// For backends that don't encode colours while they draw: encodes them, if that is asked for, and gives up those
    /// that aren't asked for.
    pub fn encode(&mut self, planes: Planes) {
        if planes.rgba8 {
            for (encoded, color) in self.rgba8.iter_mut().zip(&*self.color) {
                *encoded = encode_rgba8(*color);
            }
            self.drop_color(planes);
        }
    }

    /// For backends: gives up colours that only encoded ones were made of.
    pub fn drop_color(&mut self, planes: Planes) {
        if !planes.color {
            self.color.resize(0);
        }
    }

    /// For backends: says what is nearest in a pixel, if that is asked for.
    pub fn put_identity(&mut self, at: usize, found: Identity) {
        let planes = [(&mut self.index, found.row), (&mut self.object, found.object), (&mut self.label, found.label)];
        for (plane, value) in planes {
            if let Some(pixel) = plane.get_mut(at) {
                *pixel = value;
            }
        }
    }

    /// For backends: fills the plane of positions, if there is one, by depths.
    pub fn locate(&mut self, view: &View) {
        let width = (self.width as usize).max(1);
        for (at, (position, z)) in self.position.iter_mut().zip(&self.depth).enumerate() {
            let pixel = [view.region.x as usize + at % width, view.region.y as usize + at / width];
            *position = view.world_position(pixel.map(|i| i as f64 + 0.5), f64::from(*z));
        }
    }
}

/// Zeros that come from the system are written by nobody: whoever writes the pixels then meets fresh pages, on all
/// threads.
fn resize<T: Clone>(plane: &mut Vec<T>, count: usize, zero: T) {
    if plane.capacity() < count {
        // The old goes first.
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
