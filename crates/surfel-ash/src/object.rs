//! Vulkan objects that destroy themselves when dropped.

use crate::device::Device;
use ash::vk;
use std::sync::Arc;

/// Vulkan object of a device, destroyed when this value is dropped.
pub(crate) struct Owned<H: Copy> {
    pub raw: H,
    device: Arc<Device>,
    destroy: fn(&ash::Device, H),
}

impl<H: Copy + vk::Handle> Owned<H> {
    /// Takes ownership of an object that was just created, and names it. `destroy` is called once, when the value is
    /// dropped.
    pub(crate) fn new(device: &Arc<Device>, raw: H, name: &str, destroy: fn(&ash::Device, H)) -> Self {
        device.name(raw, name);
        Self { raw, device: device.clone(), destroy }
    }
}

impl<H: Copy> Owned<H> {
    /// Drops this value without destroying the object. The caller becomes responsible for it.
    pub(crate) fn keep(mut self) {
        self.destroy = |_, _| ();
    }
}

impl<H: Copy> Drop for Owned<H> {
    fn drop(&mut self) {
        (self.destroy)(&self.device.raw, self.raw);
    }
}

/// Expands to the function that destroys one kind of object, for [`Owned::new`].
macro_rules! destroy {
    ($method:ident) => {
        |device, raw| {
            // SAFETY: `Owned` has the only copy of the handle that outlives a submission, made of this device, and
            // calls this once; every submission is waited for before what it uses is dropped.
            unsafe { device.$method(raw, None) }
        }
    };
}
pub(crate) use destroy;
