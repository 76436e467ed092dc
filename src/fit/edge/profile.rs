//! A step seen through a Gaussian blur, and its slope.
//!
//! E(x) = erf(x / sqrt 2), the integral of the normal density from -x to x, as an odd polynomial up
//! to |x| = 3.2 and constant beyond. There is no branch, table, division or call, so that a loop
//! over lanes is vectorised on any processor. The slope is exactly that of the polynomial.

/// From here outwards the profile is constant.
const REACH: f32 = 3.2;

/// Minimax polynomial for E, constrained to zero slope at [`REACH`]. Its largest error is 1.6e-4 of
/// the step's half height inside, 1.4e-3 (and constant) beyond: below the noise of any sensor, and
/// odd, so that it cannot move an edge.
const COEFFICIENTS: [f32; 6] =
    [0.797_244_1, -0.131_062_15, 0.018_275_095, -0.001_722_625, 9.539_856_7e-5, -2.297_245e-6];

/// E at `x`, and dE/dx.
#[inline(always)]
pub(super) fn blurred_step(x: f32) -> (f32, f32) {
    let x = if x > REACH { REACH } else { x };
    let x = if x < -REACH { -REACH } else { x };
    let z = x * x;
    let [c0, c1, c2, c3, c4, c5] = COEFFICIENTS;
    let value = c0 + z * (c1 + z * (c2 + z * (c3 + z * (c4 + z * c5))));
    let slope =
        c0 + z * (3.0 * c1 + z * (5.0 * c2 + z * (7.0 * c3 + z * (9.0 * c4 + z * (11.0 * c5)))));
    (x * value, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_and_its_slope_are_within_their_stated_error() {
        for step in -50_000..=50_000 {
            let x = step as f32 * 1e-4;
            let (value, slope) = blurred_step(x);
            let exact = libm::erf(f64::from(x) / core::f64::consts::SQRT_2);
            let density =
                2.0 * libm::exp(-0.5 * f64::from(x * x)) / libm::sqrt(core::f64::consts::TAU);
            let bound = if x.abs() <= REACH { 1.6e-4 } else { 1.4e-3 };
            assert!((f64::from(value) - exact).abs() < bound, "{x}");
            assert!((f64::from(slope) - density).abs() < 5e-3, "{x}");
        }
        // Constant beyond its reach, for any number.
        assert_eq!(blurred_step(1e30), blurred_step(REACH));
        let slope = blurred_step(REACH).1;
        // Rounding: half a dozen terms of up to 6.
        assert!(slope.abs() < 6e-6, "{slope}");
    }

    #[test]
    fn the_slope_is_that_of_the_polynomial() {
        for step in -300..=300 {
            let x = step as f32 * 0.01;
            let difference = (blurred_step(x + 0.01).0 - blurred_step(x - 0.01).0) / 0.02;
            // The difference's own error: 0.01^2 / 6 times a third derivative of up to 0.8.
            assert!((blurred_step(x).1 - difference).abs() < 1e-4, "{x}");
        }
    }
}
