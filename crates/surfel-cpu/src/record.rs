//! What a splat is on the screen, as the tile loops read it.

/// A splat's footprint and attributes. All forms are about the anchor: base + fraction, in pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Record {
    /// Whole part of the anchor.
    pub base: [i32; 2],
    /// What remains of it, in [0, 1).
    pub fraction: [f32; 2],
    /// Gradients of the unfiltered (u·w', v·w').
    pub visible_u: [f32; 2],
    pub visible_v: [f32; 2],
    /// Gradients of the filtered (u·w', v·w', w').
    pub u: [f32; 2],
    pub v: [f32; 2],
    pub w: [f32; 2],
    /// Gradient of the plane's depth: of p_z/z (reciprocal), or of z.
    pub depth: [f32; 2],
    /// Depth at the anchor.
    pub z: f32,
    /// Range of the depth form over the disk: of p_z/z, or of z.
    pub range: [f32; 2],
    /// ε.
    pub epsilon: f32,
    /// Factor of the weight.
    pub weight_scale: f32,
    /// Linear albedo.
    pub color: [f32; 3],
    /// World shading normal, turned to the eye where the material is two-sided.
    pub normal: [f32; 3],
    /// Index of the object, for its material.
    pub object: u32,
    /// Pixels that either footprint may touch: first column, first row, end column, end row.
    pub pixels: [i32; 4],
}
