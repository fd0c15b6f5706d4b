//! What a render gives back: linear f32 planes.

use crate::color_plane::ColorPlane;

/// Which planes are wanted. A plane nobody asked for is neither computed nor stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
}

/// Planes of a rendered region, row by row from the top. A plane that wasn't asked for is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear RGBA, premultiplied.
    pub color: ColorPlane,
    /// Planar view-space depth Z = Σwz/Σw, world units; +∞ where nothing is.
    pub depth: Vec<f32>,
    /// Unit world normal; zero where nothing is.
    pub normal: Vec<[f32; 3]>,
    /// Σw.
    pub weight: Vec<f32>,
    /// Number of fragments that contributed.
    pub fragments: Vec<u32>,
    /// 1 where a decision is within its margin, else 0.
    pub margin: Vec<f32>,
}

impl Frame {
    /// Sets size and planes; contents are whatever an empty picture has.
    pub fn reset(&mut self, width: u32, height: u32, planes: Planes) {
        let pixels = width as usize * height as usize;
        let count = |wanted: bool| if wanted { pixels } else { 0 };
        (self.width, self.height) = (width, height);
        self.color.resize(count(planes.color));
        self.color.fill([0.0; 4]);
        refill(&mut self.depth, count(planes.depth), f32::INFINITY);
        refill(&mut self.normal, count(planes.normal), [0.0; 3]);
        refill(&mut self.weight, count(planes.weight), 0.0);
        refill(&mut self.fragments, count(planes.fragments), 0);
        refill(&mut self.margin, count(planes.margin), 0.0);
    }

    /// Sets size and planes; what the pixels hold is left open. For backends that write every pixel.
    pub fn resize(&mut self, width: u32, height: u32, planes: Planes) {
        let pixels = width as usize * height as usize;
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

/// Zeros that come from the system are written by nobody: whoever writes the pixels then meets fresh pages, on all threads.
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
