//! Render target of the embedding application, into which a scene is composited.

/// Mapping from planar depth z (in world units) to the values in the application's depth buffer, and the comparison of
/// two values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostDepth {
    /// Constant of the mapping. In a perspective projection, a value of the depth buffer is `offset` + `scale`/z, in an
    /// orthographic one `offset` + `scale`·z.
    pub offset: f32,
    /// Factor of 1/z in a perspective projection, or of z in an orthographic one. `offset` states the formula.
    pub scale: f32,
    /// Comparison with which the application's depth test lets a new value replace the stored one.
    pub compare: wgpu::CompareFunction,
}

impl HostDepth {
    /// Returns the mapping of a reversed depth without a far plane, `near`/z in a perspective projection: 1 at `near`
    /// world units, 0 infinitely far.
    pub fn reversed(near: f32) -> Self {
        Self { offset: 0.0, scale: near, compare: wgpu::CompareFunction::Greater }
    }

    /// Returns the usual mapping of a perspective projection: 0 at `near`, 1 at `far`, both in world units.
    pub fn usual(near: f32, far: f32) -> Self {
        let offset = far / (far - near);
        Self { offset, scale: -near * offset, compare: wgpu::CompareFunction::Less }
    }
}

/// Render target of the application: a colour texture and a depth buffer of the size of the view's region.
#[derive(Clone, Copy, Debug)]
pub struct HostTarget<'a> {
    /// Texture for linear colours; a format that ends in `Srgb` encodes them.
    pub color: &'a wgpu::TextureView,
    /// Format of `color`.
    pub color_format: wgpu::TextureFormat,
    /// Depth buffer, which is tested and written. If it is single-sampled, has the usage `TEXTURE_BINDING` and a format
    /// without stencil, it is also read. Each transparent splat is then drawn where it lies in front of the
    /// application's geometry, and hidden where it lies behind.
    pub depth: &'a wgpu::TextureView,
    /// Format of `depth`.
    pub depth_format: wgpu::TextureFormat,
    /// Mapping from planar depth to the values in `depth`, and their comparison.
    pub mapping: HostDepth,
    /// Texture of format `Rg32Sint` for two numbers of the nearest splat, polygon or ball, which
    /// [`HostIndex::identity`](crate::HostIndex::identity) resolves; `None` if they aren't needed. Where the scene's
    /// surface fails the depth test, the texture doesn't change.
    pub index: Option<&'a wgpu::TextureView>,
}
