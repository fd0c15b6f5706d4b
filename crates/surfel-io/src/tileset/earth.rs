//! Conversion of Earth-centred coordinates (EPSG:4978), which most tilesets use, to east, north and up.

use glam::{DMat3, DVec3};
use std::fmt;

/// Equatorial radius of the Earth in metres (WGS 84).
const EQUATOR: f64 = 6_378_137.0;
/// Square of the eccentricity of the Earth's ellipsoid (WGS 84).
const ECCENTRICITY_2: f64 = 6.694_379_990_141_316_5e-3;
/// Range of distances from the Earth's centre, in metres, at which points count as on Earth. It begins 10 km below the
/// polar radius and ends 20 km above the equatorial radius.
const ON_EARTH: std::ops::RangeInclusive<f64> = 6_346_752.0..=6_398_137.0;

/// Local axes at a place on Earth: east, north and up.
pub(super) struct Horizon {
    /// Origin of the local axes, in Earth-centred coordinates.
    pub(super) center: DVec3,
    /// Rotation to the local axes; its rows are east, north and up in Earth-centred coordinates.
    pub(super) local_from_earth: DMat3,
    latitude: f64,
    longitude: f64,
    height: f64,
}

impl Horizon {
    /// Returns the local axes at the middle of the points' bounding box. Returns `None` if the middle isn't on Earth or
    /// the box's diagonal exceeds 500 km.
    pub(super) fn of(points: &[DVec3]) -> Option<Self> {
        let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let finite = points.iter().filter(|p| p.is_finite());
        let (min, max) = finite.fold(start, |(min, max), &p| (min.min(p), max.max(p)));
        let center = (min + max) / 2.0;
        if !ON_EARTH.contains(&center.length()) || (max - min).length() > 5e5 {
            return None;
        }
        Some(Self::at(center))
    }

    /// Computes the local axes at `center`. Its geodetic latitude is found by Bowring's method (Survey Review 28,
    /// 1985); two iterations reduce the error below a micrometre.
    fn at(center: DVec3) -> Self {
        let axis = center.truncate().length();
        let polar = EQUATOR * (1.0 - ECCENTRICITY_2).sqrt();
        let second = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2);
        let mut reduced = (center.z * EQUATOR).atan2(axis * polar);
        let mut latitude = 0.0;
        for _ in 0..2 {
            let (sin, cos) = reduced.sin_cos();
            let above = center.z + second * polar * sin.powi(3);
            latitude = above.atan2(axis - ECCENTRICITY_2 * EQUATOR * cos.powi(3));
            reduced = (polar * latitude.sin()).atan2(EQUATOR * latitude.cos());
        }
        let longitude = center.y.atan2(center.x);
        let ((sin, cos), (sin_lon, cos_lon)) = (latitude.sin_cos(), longitude.sin_cos());
        let height = axis * cos + center.z * sin - EQUATOR * (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
        let east = DVec3::new(-sin_lon, cos_lon, 0.0);
        let up = DVec3::new(cos * cos_lon, cos * sin_lon, sin);
        let local_from_earth = DMat3::from_cols(east, up.cross(east), up).transpose();
        Self { center, local_from_earth, latitude: latitude.to_degrees(), longitude: longitude.to_degrees(), height }
    }
}

impl fmt::Display for Horizon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { latitude, longitude, height, .. } = self;
        write!(
            f,
            "turned from coordinates about the Earth's centre (EPSG:4978) to metres east, north and up of latitude \
             {latitude:.9}°, longitude {longitude:.9}°, height {height:.4} m"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes Earth-centred coordinates from the definition of latitude, longitude and height.
    fn earth_centred(latitude: f64, longitude: f64, height: f64) -> DVec3 {
        let ((sin, cos), (sin_lon, cos_lon)) = (latitude.to_radians().sin_cos(), longitude.to_radians().sin_cos());
        let normal = EQUATOR / (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
        let around = (normal + height) * cos;
        DVec3::new(around * cos_lon, around * sin_lon, (normal * (1.0 - ECCENTRICITY_2) + height) * sin)
    }

    #[test]
    fn places_on_earth_are_found_again() {
        for latitude in [-90.0, -89.999_99, -33.9, 0.0, 1e-9, 48.137, 89.9, 90.0] {
            for longitude in [-180.0, -70.0, 0.0, 11.575, 179.999] {
                for height in [-9000.0, 0.0, 512.3, 8849.0] {
                    let horizon = Horizon::at(earth_centred(latitude, longitude, height));
                    assert!((horizon.latitude - latitude).abs() < 1e-10, "{latitude} {}", horizon.latitude);
                    assert!((horizon.height - height).abs() < 1e-6, "{height} {}", horizon.height);
                    let turned = (horizon.longitude - longitude + 540.0).rem_euclid(360.0) - 180.0;
                    assert!(latitude.abs() > 89.99 || turned.abs() < 1e-10, "{longitude} {}", horizon.longitude);
                    let axes = horizon.local_from_earth;
                    assert!(
                        (axes * axes.transpose() - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-14)
                    );
                    assert!((axes.determinant() - 1.0).abs() < 1e-14);
                    let up = earth_centred(latitude, longitude, height + 1.0) - horizon.center;
                    assert!((axes * up - DVec3::Z).length() < 1e-8, "{latitude} {longitude}");
                }
            }
        }
    }

    #[test]
    fn only_places_on_earth_are_turned() {
        let here = earth_centred(48.0, 11.0, 500.0);
        assert!(Horizon::of(&[here, here + DVec3::ONE]).is_some());
        assert!(Horizon::of(&[here * 1.1, here * 1.1 + DVec3::ONE]).is_none());
        assert!(Horizon::of(&[here - 4e5, here + 4e5]).is_none());
        assert!(Horizon::of(&[]).is_none());
        assert!(Horizon::of(&[DVec3::NAN]).is_none());
        let utm = DVec3::new(691_000.0, 5_335_000.0, 520.0);
        assert!(Horizon::of(&[utm, utm + 100.0]).is_none());
    }
}
