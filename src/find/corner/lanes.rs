//! Numbers that are processed together, as many as a vector register of x86 or ARM holds.
//!
//! They are plain arrays: the compiler makes one instruction of most operations on them. It does so
//! only as long as no number is used apart from the others of its vector.

use core::hint::black_box;
use core::ops::{Add, AddAssign, Div, Mul, Sub};

use crate::model::image::Pixel;

pub(super) const LANES: usize = 4;

/// One number for each lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lanes(pub(super) [f32; LANES]);

impl Lanes {
    pub(super) const ZERO: Self = Self::all(0.0);

    /// The same number in all lanes.
    pub(super) const fn all(value: f32) -> Self {
        Self([value; LANES])
    }

    /// The brightness of neighbouring pixels.
    #[inline(always)]
    pub(super) fn of<P: Pixel>(pixels: &[P; LANES]) -> Self {
        Self(pixels.map(Into::into))
    }

    #[inline(always)]
    fn each(self, other: Self, operation: impl Fn(f32, f32) -> f32) -> Self {
        Self(core::array::from_fn(|n| operation(self.0[n], other.0[n])))
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }

    /// The square roots. [`black_box`] makes the compiler compute what they are of in lanes, although
    /// it takes the roots one at a time.
    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self(black_box(self).0.map(libm::sqrtf))
    }

    /// The smaller ones, where none is NaN.
    #[inline(always)]
    pub(super) fn min(self, other: Self) -> Self {
        self.each(other, |a, b| if a < b { a } else { b })
    }

    /// The larger ones, where none is NaN.
    #[inline(always)]
    pub(super) fn max(self, other: Self) -> Self {
        self.each(other, |a, b| if a > b { a } else { b })
    }

    /// These numbers where `a` is less than `b`, and 0 elsewhere.
    #[inline(always)]
    pub(super) fn where_less(self, a: Self, b: Self) -> Self {
        Self(core::array::from_fn(|n| if a.0[n] < b.0[n] { self.0[n] } else { 0.0 }))
    }
}

/// The sums over the lanes.
///
/// Never inlined: the compiler would otherwise combine numbers of different vectors that are added
/// here, and shuffle lanes in the loops before.
#[inline(never)]
pub(super) fn totals<const N: usize>(lanes: &[Lanes; N]) -> [f32; N] {
    core::array::from_fn(|n| {
        let [a, b, c, d] = lanes[n].0;
        (a + b) + (c + d)
    })
}

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.each(other, |a, b| a + b)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Sub for Lanes {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.each(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.each(other, |a, b| a * b)
    }
}

impl Mul<f32> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        self * Self::all(factor)
    }
}

impl Div for Lanes {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.each(other, |a, b| a / b)
    }
}
