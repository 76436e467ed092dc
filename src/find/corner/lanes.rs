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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_lane_is_computed_by_itself() {
        let a = Lanes([1.0, -4.0, 9.0, 0.25]);
        let b = Lanes([2.0, 2.0, -3.0, 0.25]);
        assert_eq!(a + b, Lanes([3.0, -2.0, 6.0, 0.5]));
        assert_eq!(a - b, Lanes([-1.0, -6.0, 12.0, 0.0]));
        assert_eq!(a * b, Lanes([2.0, -8.0, -27.0, 0.0625]));
        assert_eq!(a / b, Lanes([0.5, -2.0, -3.0, 1.0]));
        assert_eq!(a * 2.0, Lanes([2.0, -8.0, 18.0, 0.5]));
        assert_eq!(a.min(b), Lanes([1.0, -4.0, -3.0, 0.25]));
        assert_eq!(a.max(b), Lanes([2.0, 2.0, 9.0, 0.25]));
        assert_eq!(a.abs(), Lanes([1.0, 4.0, 9.0, 0.25]));
        assert_eq!(a.abs().sqrt(), Lanes([1.0, 2.0, 3.0, 0.5]));
        // What is equal is not less.
        assert_eq!(a.where_less(a, b), Lanes([1.0, -4.0, 0.0, 0.0]));
        let mut sum = a;
        sum += b;
        assert_eq!(sum, a + b);
        assert_eq!(totals(&[a, b]), [6.25, 1.25]);
        assert_eq!(Lanes::of(&[0_u8, 1, 128, 255]), Lanes([0.0, 1.0, 128.0, 255.0]));
        assert_eq!(Lanes::all(7.0), Lanes([7.0; LANES]));
    }
}
