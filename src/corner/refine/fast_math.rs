//! Single-precision exponential and error function for whole rows of pixels.
//!
//! `libm`'s are branchy and scalar; these have neither branch, table nor call,
//! so that the compiler turns a loop over lanes into vector code on any target
//! (on x86 with nothing above SSE2).

/// The natural exponential of a number from -30 to 80; below, and for a NaN, the
/// value at -30 (9e-14).
///
/// Not to go further down is what keeps it fast: the squares of what it gives
/// stay clear of the subnormal numbers, which cost a hundred cycles each.
///
/// Largest relative error: 2.5e-7 + 1.2e-7 |x|, the second part from rounding
/// `x` to the base of 2.
#[inline(always)]
pub(super) fn exp(x: f32) -> f32 {
    // Adding this moves the binary point to the lowest bit: it rounds to an
    // integer and leaves that integer in the low bits of the word.
    const ROUNDER: f32 = 12_582_912.0;
    const LOWEST: f32 = -30.0;
    // A comparison, not f32::max: that one costs extra instructions for NaN.
    let x = if x > LOWEST { x } else { LOWEST };
    let scaled = x * core::f32::consts::LOG2_E;
    let rounded = scaled + ROUNDER;
    let fraction = scaled - (rounded - ROUNDER);
    // Minimax polynomial of 2^fraction on [-1/2, 1/2], relative error 7.5e-8.
    let mut power = 0.001_327_647_1;
    power = power * fraction + 0.009_675_541;
    power = power * fraction + 0.055_507_13;
    power = power * fraction + 0.240_221_2;
    power = power * fraction + 0.693_146_94;
    power = power * fraction + 1.000_000_1;
    // The integer part goes straight into the exponent's bits.
    f32::from_bits(power.to_bits().wrapping_add(rounded.to_bits() << 23))
}

/// The integral of the standard normal density from -x to x, which is
/// erf(x / sqrt 2), with the exponential exp(-x^2 / 2) that both it and its
/// derivative need: the derivative is `SLOPE_AT_ZERO * exponential`.
///
/// Abramowitz and Stegun 7.1.26; largest absolute error 5e-7.
#[inline(always)]
pub(super) fn normal_between(x: f32) -> (f32, f32) {
    let exponential = exp(-0.5 * x * x);
    // Their p = 0.3275911 acts on x / sqrt 2.
    let t = 1.0 / (1.0 + 0.231_641_89 * x.abs());
    let mut tail = 1.061_405_4;
    tail = tail * t - 1.453_152;
    tail = tail * t + 1.421_413_7;
    tail = tail * t - 0.284_496_74;
    tail = tail * t + 0.254_829_6;
    let value = 1.0 - tail * t * exponential;
    (value.copysign(x), exponential)
}

/// The derivative of [`normal_between`] at 0, 2 / sqrt(2 pi).
pub(super) const SLOPE_AT_ZERO: f32 = 0.797_884_6;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_is_within_its_stated_error() {
        for step in 0..=30_000 {
            let x = -(step as f32) * 1e-3;
            let exact = libm::exp(f64::from(x));
            let error = (f64::from(exp(x)) / exact - 1.0).abs();
            assert!(error < 2.5e-7 + 1.2e-7 * f64::from(x.abs()), "{error:e} at {x}");
        }
        assert!(exp(-1e30) > 9e-14 && exp(-1e30) < 1e-13);
        assert!(exp(f32::NAN) < 1e-13);
    }

    #[test]
    fn error_function_and_its_slope_are_within_their_stated_error() {
        for step in -60_000..=60_000 {
            let x = step as f32 * 1e-4;
            let (value, exponential) = normal_between(x);
            let exact = libm::erf(f64::from(x) / core::f64::consts::SQRT_2);
            assert!((f64::from(value) - exact).abs() < 5e-7, "{x}");
            let density = libm::exp(-0.5 * f64::from(x) * f64::from(x));
            assert!((f64::from(exponential) - density).abs() < 5e-7, "{x}");
        }
    }
}
