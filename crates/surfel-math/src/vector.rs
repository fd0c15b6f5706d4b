//! Small vectors over [`Real`]; glam has none over SIMD lanes.

use crate::Real;
use std::ops::{Add, Mul, Neg, Sub};

/// A vector of two coordinates; on the screen: x right, y down, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "coordinates")]
pub struct V2<R> {
    pub x: R,
    pub y: R,
}

/// A vector of three coordinates; in view space: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "coordinates")]
pub struct V3<R> {
    pub x: R,
    pub y: R,
    pub z: R,
}

impl<R: Real> V2<R> {
    /// Creates a vector from its coordinates.
    #[inline(always)]
    pub fn new(x: R, y: R) -> Self {
        Self { x, y }
    }

    /// Returns the scalar product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> R {
        R::sum_of_products(self.x, o.x, self.y, o.y)
    }

    /// Returns the cross product self.x·o.y − self.y·o.x.
    #[inline(always)]
    pub fn cross(self, o: Self) -> R {
        R::difference_of_products(self.x, o.y, self.y, o.x)
    }

    /// Returns the length.
    #[inline(always)]
    pub fn length(self) -> R {
        self.dot(self).sqrt()
    }

    /// Returns the product coordinate by coordinate.
    #[inline(always)]
    pub fn scale_by(self, o: Self) -> Self {
        Self::new(self.x * o.x, self.y * o.y)
    }

    /// Returns `a` in lanes where the mask is set, else `b`.
    #[inline(always)]
    pub fn select(mask: R::Mask, a: Self, b: Self) -> Self {
        Self::new(R::select(mask, a.x, b.x), R::select(mask, a.y, b.y))
    }
}

impl<R: Real> V3<R> {
    /// Creates a vector from its coordinates.
    #[inline(always)]
    pub fn new(x: R, y: R, z: R) -> Self {
        Self { x, y, z }
    }

    /// Returns the scalar product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> R {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }

    /// Returns the vector product, each coordinate within 1.5 ulp.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self::new(
            R::difference_of_products(self.y, o.z, self.z, o.y),
            R::difference_of_products(self.z, o.x, self.x, o.z),
            R::difference_of_products(self.x, o.y, self.y, o.x),
        )
    }

    /// Returns the length.
    #[inline(always)]
    pub fn length(self) -> R {
        self.dot(self).sqrt()
    }

    /// Returns the largest of the coordinates' absolute values.
    #[inline(always)]
    pub fn max_abs(self) -> R {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }

    /// Returns the first two coordinates.
    #[inline(always)]
    pub fn xy(self) -> V2<R> {
        V2::new(self.x, self.y)
    }

    /// Returns `a` in lanes where the mask is set, else `b`.
    #[inline(always)]
    pub fn select(mask: R::Mask, a: Self, b: Self) -> Self {
        Self::new(R::select(mask, a.x, b.x), R::select(mask, a.y, b.y), R::select(mask, a.z, b.z))
    }
}

macro_rules! vector_ops {
    ($v:ident, $($c:ident),+) => {
        impl<R: Real> Add for $v<R> {
            type Output = Self;
            #[inline(always)]
            fn add(self, o: Self) -> Self {
                Self { $($c: self.$c + o.$c),+ }
            }
        }
        impl<R: Real> Sub for $v<R> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, o: Self) -> Self {
                Self { $($c: self.$c - o.$c),+ }
            }
        }
        impl<R: Real> Neg for $v<R> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self { $($c: -self.$c),+ }
            }
        }
        impl<R: Real> Mul<R> for $v<R> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, k: R) -> Self {
                Self { $($c: self.$c * k),+ }
            }
        }
    };
}

vector_ops!(V2, x, y);
vector_ops!(V3, x, y, z);

impl From<glam::DVec3> for V3<f64> {
    fn from(v: glam::DVec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}
