//! Supersampling for ground truth: N×N samples per pixel without a pre-filter, averaged with equal weights.

use surfel_render::{Frame, Planes};

/// Averages `factor`×`factor` blocks of `fine` into `frame`. Colour and weight are plain means; depth and normals are
/// means over the samples that hit something. Numbers of fragments are summed; other planes aren't filled.
pub(crate) fn average(fine: &Frame, factor: u32, planes: Planes, frame: &mut Frame) {
    let (width, height) = (fine.width() / factor, fine.height() / factor);
    frame.reset(width, height, planes);
    let samples = f64::from(factor * factor);
    for y in 0..height {
        for x in 0..width {
            let at = (y * width + x) as usize;
            let block = (0..factor).flat_map(|dy| {
                (0..factor).map(move |dx| ((y * factor + dy) * fine.width() + x * factor + dx) as usize)
            });
            if planes.color {
                let mut sum = [0.0f64; 4];
                for i in block.clone() {
                    for (s, c) in sum.iter_mut().zip(fine.color()[i]) {
                        *s += f64::from(c);
                    }
                }
                frame.color_mut()[at] = sum.map(|s| (s / samples) as f32);
            }
            if planes.weight {
                frame.weight_mut()[at] =
                    (block.clone().map(|i| f64::from(fine.weight()[i])).sum::<f64>() / samples) as f32;
            }
            if planes.depth {
                let hits = block.clone().map(|i| f64::from(fine.depth()[i])).filter(|z| z.is_finite());
                let (sum, count) = hits.fold((0.0, 0u32), |(s, n), z| (s + z, n + 1));
                frame.depth_mut()[at] = if count > 0 { (sum / f64::from(count)) as f32 } else { f32::INFINITY };
            }
            if planes.normal {
                let sum = block.clone().map(|i| glam::Vec3::from(fine.normal()[i]).as_dvec3()).sum::<glam::DVec3>();
                frame.normal_mut()[at] = surfel_math::basis::unit(sum).as_vec3().to_array();
            }
            if planes.fragments {
                frame.fragments_mut()[at] = block.map(|i| fine.fragments()[i]).sum();
            }
        }
    }
}
