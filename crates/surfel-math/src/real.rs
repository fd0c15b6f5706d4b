//! The traits of numbers that formulas are written over.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// The result of a comparison of two [`Real`]s: one boolean per lane.
pub trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {}

impl<M: Copy + BitAnd<Output = M> + BitOr<Output = M> + Not<Output = M>> Mask for M {}

/// A real number, or several in SIMD lanes, so that one formula serves f64, f32 and SIMD code.
///
/// Formulas over `Real` have no branches on data: they compute both sides and [`Real::select`]. Every operation but
/// [`Real::scale_to_one`] and [`Real::inverse_sqrt`] is correctly rounded (IEEE 754), including the fused multiply-add.
/// A formula without these two therefore yields the same bits in f32 and in any lane of any SIMD level. With them, it
/// yields the same bits at any SIMD level, but not in f32.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Result of a comparison of two numbers, lane by lane.
    type Mask: Mask;

    /// Returns `value` rounded to this type, in as many lanes as `self` has.
    fn constant(self, value: f64) -> Self;
    /// Returns self·b + c, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// Returns the square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    fn abs(self) -> Self;
    /// Returns the lesser number; neither may be NaN.
    fn min(self, other: Self) -> Self;
    /// Returns the greater number; neither may be NaN.
    fn max(self, other: Self) -> Self;
    /// True in lanes where self < other; false where either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// True in lanes where self ≤ other; false where either is NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// Returns `a` in lanes where the mask is set, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;

    /// Returns a factor that scales a positive number to at most 1. For f32 and f64 it is the reciprocal; for SIMD
    /// lanes, a power of two that scales the number to (½, 1].
    #[inline(always)]
    fn scale_to_one(self) -> Self {
        self.one() / self
    }

    /// Returns 1/√self of a positive number, to an ulp or two.
    #[inline(always)]
    fn inverse_sqrt(self) -> Self {
        self.one() / self.sqrt()
    }

    /// Returns zero, in as many lanes as `self` has.
    #[inline(always)]
    fn zero(self) -> Self {
        self.constant(0.0)
    }

    /// Returns one, in as many lanes as `self` has.
    #[inline(always)]
    fn one(self) -> Self {
        self.constant(1.0)
    }

    /// Returns a·b − c·d with an error of at most 1.5 ulp of the result, however much cancels.
    ///
    /// Source: Kahan; bound by Jeannerod, Louvet and Muller 2013.
    #[inline(always)]
    fn difference_of_products(a: Self, b: Self, c: Self, d: Self) -> Self {
        let cd = c * d;
        let rounding = (-c).mul_add(d, cd);
        a.mul_add(b, -cd) + rounding
    }

    /// Returns a·b + c·d with an error of at most 1.5 ulp of the result.
    #[inline(always)]
    fn sum_of_products(a: Self, b: Self, c: Self, d: Self) -> Self {
        Self::difference_of_products(a, b, -c, d)
    }
}

macro_rules! scalar {
    ($t:ty) => {
        impl Real for $t {
            type Mask = bool;

            #[inline(always)]
            fn constant(self, value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                self.mul_add(b, c)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.abs()
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            fn select(mask: bool, a: Self, b: Self) -> Self {
                if mask { a } else { b }
            }
        }
    };
}

scalar!(f32);
scalar!(f64);
