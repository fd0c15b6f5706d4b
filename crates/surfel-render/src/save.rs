//! Writing of frames to files.

use crate::Frame;
use std::path::Path;
use surfel_files::IoError;
use surfel_images::{PlanesView, PngOptions};

impl Frame {
    /// Writes the colours as PNG: sRGB-encoded, 8 bits, straight alpha. An existing file is overwritten; the file
    /// appears whole or not at all. [`surfel_images::save_png`] also writes 16 bits and metadata.
    ///
    /// # Errors
    /// [`IoError::System`] if there is no colour plane or the file can't be written.
    pub fn save_png(&self, path: impl AsRef<Path>) -> Result<(), IoError> {
        surfel_images::save_png(path.as_ref(), true, &self.planes(), &PngOptions::default())
    }

    /// Writes the planes of the frame, except `rgba8`, `fragments` and `margin`, as OpenEXR: linear premultiplied
    /// colour in 16 bits, and the other planes in 32 bits. An existing file is overwritten; the file appears whole or
    /// not at all. [`surfel_images::save_exr`] also writes metadata, and colour in 32 bits.
    ///
    /// # Errors
    /// [`IoError::System`] if the frame has no plane or the file can't be written.
    #[cfg(feature = "exr")]
    pub fn save_exr(&self, path: impl AsRef<Path>) -> Result<(), IoError> {
        surfel_images::save_exr(path.as_ref(), true, &self.planes(), &surfel_images::ExrOptions::default())
    }

    /// Borrows the frame's planes, except `fragments` and `margin`, in the form that [`surfel_images`] writes.
    pub fn planes(&self) -> PlanesView<'_> {
        fn there<T>(plane: &[T]) -> Option<&[T]> {
            (!plane.is_empty()).then_some(plane)
        }
        let whole = [("index", self.index()), ("object", self.object()), ("label", self.label())];
        let whole = whole.into_iter().filter(|(_, plane)| !plane.is_empty()).collect();
        let other = [("alpha", self.alpha()), ("median_depth", self.median_depth()), ("distortion", self.distortion())];
        let other = other.into_iter().filter(|(_, plane)| !plane.is_empty()).collect();
        PlanesView {
            width: self.width(),
            height: self.height(),
            color: there(self.color()),
            rgba8: there(self.rgba8()),
            depth: there(self.depth()),
            normal: there(self.normal()),
            weight: there(self.weight()),
            position: there(self.position()),
            other,
            whole,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Planes;

    #[test]
    fn frames_are_saved_with_the_planes_they_have() {
        let folder = std::env::temp_dir().join(format!("surfel-frame-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let [png, exr] = ["a.png", "a.exr"].map(|name| folder.join(name));
        let mut frame = Frame::default();
        frame.reset(3, 2, Planes::COLOR.with_depth(true));
        frame.color_mut()[4] = [1.0, 0.0, 1.0, 1.0];
        frame.depth_mut()[4] = 2.5;
        // The second write overwrites the first.
        for _ in 0..2 {
            frame.save_png(&png).unwrap();
            #[cfg(feature = "exr")]
            frame.save_exr(&exr).unwrap();
        }
        let flat = surfel_images::read_image(&png).unwrap();
        assert_eq!((flat.width, flat.height, flat.color.unwrap()[4]), (3, 2, [1.0, 0.0, 1.0, 1.0]));
        if cfg!(feature = "exr") {
            let whole = surfel_images::read_image(&exr).unwrap();
            assert_eq!((whole.depth.unwrap()[4], whole.normal), (2.5, None));
        }
        frame.reset(3, 2, Planes::COLOR.with_color(false));
        assert!(frame.save_png(&png).is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
