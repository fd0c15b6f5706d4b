//! Cameras of random scenes.

use super::MAX_SIDE_PX;
use crate::random::Random;
use glam::DVec3;
use surfel_model::{Camera, Projection};

/// Returns a camera near, inside or far from the unit ball.
pub(super) fn camera(random: &mut Random) -> Camera {
    let size = size(random);
    let [width, height] = size.map(f64::from);
    let inside = random.chance(0.15);
    let distance = match () {
        () if inside => random.range(0.0, 0.9),
        () if random.chance(0.15) => random.factor(8.0, 300.0),
        () => random.factor(1.2, 6.0),
    };
    let eye = random.direction() * distance;
    // The target is off the ball's centre. For an eye inside the ball, it is in any direction.
    let target = if inside { eye + random.direction() } else { random.direction() * random.range(0.0, 0.6) };
    let forward = (target - eye).normalize();
    let up = loop {
        let up = random.direction();
        if up.cross(forward).length() > 0.1 {
            break up;
        }
    };
    // Half of the view's height at the centre of the ball.
    let half = if inside { random.range(0.3, 3.0) } else { random.factor(0.15, 2.0) };
    let ahead = if inside { 1.0 } else { forward.dot(-eye).max(0.1) };
    let projection = match random.below(10) {
        0..=5 => Projection::Perspective { fov_y_deg: (2.0 * (half / ahead).atan()).to_degrees().clamp(0.1, 165.0) },
        6..=7 => {
            let f = 0.5 * height * ahead / half;
            let center = |random: &mut Random, side: f64| side * random.range(-0.3, 1.3);
            Projection::Intrinsics {
                fx: f * random.range(0.5, 2.0),
                fy: f,
                cx: center(random, width),
                cy: center(random, height),
            }
        }
        _ => Projection::Orthographic { height: 2.0 * half },
    };
    let near = match random.below(4) {
        // The near plane is in the ball, or behind a part of it.
        0 => (ahead + random.range(-1.0, 0.5)).max(0.05),
        1 => random.factor(1e-4, 0.1),
        _ => 0.01 * ahead.max(1.0),
    };
    let far = match projection {
        Projection::Orthographic { .. } => Some(near + random.range(0.05, 1.0) * (ahead + 2.0)),
        // The far plane has no effect.
        _ => random.chance(0.1).then_some(ahead),
    };
    let [eye, target, up] = [eye, target, up * random.factor(0.1, 10.0)].map(|v: DVec3| v.to_array());
    Camera { eye, target, up, projection, near, far, size }
}

fn size(random: &mut Random) -> [u32; 2] {
    let mut side = |low: f64| random.factor(low, f64::from(MAX_SIDE_PX) + 0.99) as u32;
    let usual = [side(16.0), side(16.0)];
    let any = [side(1.0), side(1.0)];
    if random.chance(0.1) { any } else { usual }
}
