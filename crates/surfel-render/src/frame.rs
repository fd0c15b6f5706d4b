//! What a render gives back: linear f32 planes.

use crate::background::Background;
use crate::color_plane::ColorPlane;

/// Which planes are wanted. A plane nobody asked for is neither computed nor stored.
///
/// `Planes::COLOR.with_depth(true)`, or the fields one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Planes {
    /// Premultiplied linear RGBA.
    pub color: bool,
    /// Planar view-space depth.
    pub depth: bool,
    /// World normals.
    pub normal: bool,
    /// Σw.
    pub weight: bool,
    /// Fragments that contributed to each pixel.
    pub fragments: bool,
    /// Pixels whose result hangs on a decision within its margin (reference backend only).
    pub margin: bool,
}

impl Planes {
    /// Colour alone.
    pub const COLOR: Self =
        Self { color: true, depth: false, normal: false, weight: false, fragments: false, margin: false };
    /// Everything an EXR file holds.
    pub const ALL: Self =
        Self { color: true, depth: true, normal: true, weight: true, fragments: false, margin: false };

    surfel_model::setters! {
        with_color color: bool,
        with_depth depth: bool,
        with_normal normal: bool,
        with_weight weight: bool,
        with_fragments fragments: bool,
        with_margin margin: bool,
    }
}

/// Planes of a rendered region, row by row from the top: pixel (x, y) is at `y * width + x`. A plane that wasn't asked
/// for is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    width: u32,
    height: u32,
    color: ColorPlane,
    depth: Vec<f32>,
    normal: Vec<[f32; 3]>,
    weight: Vec<f32>,
    fragments: Vec<u32>,
    margin: Vec<f32>,
    background: Background,
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
    /// Planar view-space depth.
    pub depth: Vec<f32>,
    /// World normals.
    pub normal: Vec<[f32; 3]>,
    /// Σw.
    pub weight: Vec<f32>,
}

/// All planes of a [`Frame`], to be written at once; those that it doesn't have are empty.
#[derive(Debug)]
pub struct PlanesMut<'a> {
    /// Linear RGBA, premultiplied.
    pub color: &'a mut [[f32; 4]],
    /// Planar view-space depth.
    pub depth: &'a mut [f32],
    /// World normals.
    pub normal: &'a mut [[f32; 3]],
    /// Σw.
    pub weight: &'a mut [f32],
    /// Number of fragments.
    pub fragments: &'a mut [u32],
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
        /// Planar view-space depth Z = Σwz/Σw, world units; +∞ where nothing is.
        depth, depth_mut: f32;
        /// Unit world normals; zero where nothing is.
        normal, normal_mut: [f32; 3];
        /// Σw.
        weight, weight_mut: f32;
        /// Number of fragments that contributed.
        fragments, fragments_mut: u32;
        /// 1 where a decision is within its margin, else 0.
        margin, margin_mut: f32;
    }

    /// Gives the planes up, without a copy.
    pub fn into_planes(self) -> FramePlanes {
        let (color, first) = self.color.into_memory();
        let (depth, normal, weight) = (self.depth, self.normal, self.weight);
        FramePlanes { width: self.width, height: self.height, color, first, depth, normal, weight }
    }

    /// Which planes there are.
    fn which_planes(&self) -> Planes {
        Planes {
            color: !self.color.is_empty(),
            depth: !self.depth.is_empty(),
            normal: !self.normal.is_empty(),
            weight: !self.weight.is_empty(),
            fragments: !self.fragments.is_empty(),
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
            depth: &mut self.depth,
            normal: &mut self.normal,
            weight: &mut self.weight,
            fragments: &mut self.fragments,
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
        refill(&mut self.depth, count(planes.depth), f32::INFINITY);
        refill(&mut self.normal, count(planes.normal), [0.0; 3]);
        refill(&mut self.weight, count(planes.weight), 0.0);
        refill(&mut self.fragments, count(planes.fragments), 0);
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
        resize(&mut self.depth, count(planes.depth), 0.0);
        resize(&mut self.normal, count(planes.normal), [0.0; 3]);
        resize(&mut self.weight, count(planes.weight), 0.0);
        resize(&mut self.fragments, count(planes.fragments), 0);
        resize(&mut self.margin, count(planes.margin), 0.0);
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
