//! Views of a scene relative to its up axis, as names, angles and camera axes.

use glam::DVec3;
use std::fmt;
use surfel_math::basis::unit;
use surfel_model::{Camera, Up};

/// Named view, relative to the scene's up axis. `Front` looks along −z if the up axis is +y, +x or −x, and along +z if
/// it is −y. It looks along +y if the up axis is +z, and along −y if it is −z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NamedView {
    /// View from 30° to the right of the front and 20° above the horizon.
    #[default]
    Iso,
    /// Front view.
    Front,
    /// Back view.
    Back,
    /// View from the left-hand side, as it appears in the front view.
    Left,
    /// View from the right-hand side, as it appears in the front view.
    Right,
    /// View from above.
    Top,
    /// View from below.
    Bottom,
}

/// Direction from which a scene is viewed, as two angles. Both are 0 for [`NamedView::Front`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewAngles {
    /// Azimuth about the up axis in degrees from −360 to 360, toward the right of the front view. 90 is
    /// [`NamedView::Right`].
    pub azimuth_deg: f64,
    /// Elevation above the horizon in degrees from −90 to 90. 90 is [`NamedView::Top`].
    pub elevation_deg: f64,
}

impl ViewAngles {
    /// Angles of [`NamedView::Iso`], which are also used if a scene has too few splats for an automatic choice.
    pub const ISO: Self = Self { azimuth_deg: 30.0, elevation_deg: 20.0 };
}

impl fmt::Display for ViewAngles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{}", self.azimuth_deg, self.elevation_deg)
    }
}

/// Reason for the automatic choice of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ViewReason {
    /// The view shows the most detail: positions, directions, colours and curvature.
    Details,
    /// The scene's semantic front faces the viewer.
    Front,
    /// The scene is open on the side of the viewer, so that its inside is visible.
    Opening,
    /// Nearly all surfaces face the viewer, as in the capture of a depth camera or in a relief.
    Camera,
    /// The scene has too few splats for a choice, so that the default view is used.
    Convention,
}

impl fmt::Display for ViewReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Details => "it shows most",
            Self::Front => "the front is there",
            Self::Opening => "that side is open",
            Self::Camera => "all faces that way",
            Self::Convention => "the usual view",
        })
    }
}

/// View, with the reason for which it was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenView {
    /// Direction from which the scene is viewed.
    pub angles: ViewAngles,
    /// Criterion that contributed most to the choice of the view.
    pub reason: ViewReason,
}

/// Choice of the direction from which a scene is viewed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum ViewChoice {
    /// The best view among a ring of candidates ([`crate::best_view`]).
    #[default]
    Auto,
    /// A named view.
    Named(NamedView),
    /// A view that the user gives by its angles.
    From(ViewAngles),
}

/// Camera axes of a view: unit vectors in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewAxes {
    /// Direction toward the right edge of the image.
    pub right: DVec3,
    /// Direction toward the upper edge of the image.
    pub up: DVec3,
    /// Viewing direction, into the image.
    pub forward: DVec3,
}

impl ViewAxes {
    /// Returns the axes of a camera.
    pub fn of(camera: &Camera) -> Self {
        let forward = unit(DVec3::from(camera.target) - DVec3::from(camera.eye));
        let right = unit(forward.cross(unit(DVec3::from(camera.up))));
        Self { right, up: right.cross(forward), forward }
    }

    fn looking(forward: DVec3, up: DVec3) -> Self {
        let right = unit(forward.cross(up));
        Self { right, up: right.cross(forward), forward: unit(forward) }
    }

    /// Returns the axes of a view given by angles. In a view straight from above, the front is at the lower edge of the
    /// image, as in [`NamedView::Top`]. In a view straight from below, it is at the upper edge.
    pub fn turned(angles: ViewAngles, up: Up) -> Self {
        let u = up.vector();
        let front = front(up);
        let right = front.cross(u);
        let (azimuth, elevation) = (angles.azimuth_deg.to_radians(), angles.elevation_deg.to_radians());
        let level = front * azimuth.cos() - right * azimuth.sin();
        let upward = u * elevation.cos() + level * elevation.sin();
        Self::looking(level * elevation.cos() - u * elevation.sin(), upward)
    }

    /// Returns the axes of a named view.
    pub fn named(view: NamedView, up: Up) -> Self {
        let u = up.vector();
        let front = front(up);
        let right = front.cross(u);
        let looking = Self::looking;
        match view {
            NamedView::Front => looking(front, u),
            NamedView::Back => looking(-front, u),
            NamedView::Left => looking(right, u),
            NamedView::Right => looking(-right, u),
            NamedView::Top => looking(-u, front),
            NamedView::Bottom => looking(u, -front),
            NamedView::Iso => {
                let ViewAngles { azimuth_deg, elevation_deg } = ViewAngles::ISO;
                let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
                let level = front * azimuth.cos() - right * azimuth.sin();
                looking(level * elevation.cos() - u * elevation.sin(), u)
            }
        }
    }
}

/// Returns the viewing direction of the front view for an up axis, opposite to the direction in which a model's front
/// faces. A y-up model faces +z, and a z-up model faces −y. Gaussian splats (−y up) face −z, since their cameras look
/// along +z with y down.
fn front(up: Up) -> DVec3 {
    match up {
        Up::PlusX | Up::MinusX | Up::PlusY => DVec3::NEG_Z,
        Up::MinusY => DVec3::Z,
        Up::PlusZ => DVec3::Y,
        Up::MinusZ => DVec3::NEG_Y,
    }
}
