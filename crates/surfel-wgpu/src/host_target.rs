//! A host's render target, into which a scene is composed.

/// What a host's depth buffer holds for a planar depth z, and which of two depths is nearer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HostDepth {
    /// In a perspective projection it holds `offset` + `scale`/z, in an orthographic one `offset` + `scale`·z.
    pub offset: f32,
    /// See `offset`.
    pub scale: f32,
    /// Whether a new depth replaces the one that is there.
    pub compare: wgpu::CompareFunction,
}

impl HostDepth {
    /// Reversed depth without a far plane, z_near/z: 1 at z_near, 0 infinitely far.
    pub fn reversed(near: f32) -> Self {
        Self { offset: 0.0, scale: near, compare: wgpu::CompareFunction::Greater }
    }

    /// The usual depth of a perspective projection: 0 at `near`, 1 at `far`.
    pub fn usual(near: f32, far: f32) -> Self {
        let offset = far / (far - near);
        Self { offset, scale: -near * offset, compare: wgpu::CompareFunction::Less }
    }
}

/// A host's render target: a colour texture and a depth buffer of the size of the view's region.
#[derive(Clone, Copy, Debug)]
pub struct HostTarget<'a> {
    /// Gets linear colours; a format that ends in `Srgb` encodes them.
    pub color: &'a wgpu::TextureView,
    /// Format of `color`.
    pub color_format: wgpu::TextureFormat,
    /// Is tested and written. If it is of one sample, has the usage `TEXTURE_BINDING` and a format without stencil, it
    /// is read, too, and transparent splats are drawn before and occluded behind the host's own geometry.
    pub depth: &'a wgpu::TextureView,
    /// Format of `depth`.
    pub depth_format: wgpu::TextureFormat,
    /// What `depth` holds.
    pub mapping: HostDepth,
}
