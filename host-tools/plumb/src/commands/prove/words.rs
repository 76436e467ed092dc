//! Numbers with their uncertainty, as people write them.

use plumbline_evidence::uncertainty::{Estimate, Spread, Verdict};

/// More decimals are never of use: a hundredth of a micrometre.
const DECIMALS_MAX: i32 = 5;

/// The decimals that leave a value two significant digits.
fn decimals(value: f64) -> usize {
    let first = value.abs().max(f64::MIN_POSITIVE).log10().floor() as i32;
    (1 - first).clamp(0, DECIMALS_MAX) as usize
}

/// A number with two significant digits.
pub fn rounded(value: f64) -> String {
    if value.abs() < 0.5 * 10_f64.powi(-DECIMALS_MAX) {
        return "0".to_owned();
    }
    format!("{value:.*}", decimals(value))
}

/// "+0.123 ± 0.012": a value that may have either sign, and U.
pub fn signed(estimate: &Estimate) -> String {
    let decimals = decimals(estimate.expanded());
    // A value that rounds to 0 has no sign.
    let scale = 10_f64.powi(decimals as i32);
    let value = (estimate.value * scale).round() / scale + 0.0;
    format!("{value:+.decimals$} ± {:.decimals$}", estimate.expanded())
}

/// "0.123 ± 0.012": a value and U.
pub fn with_u(estimate: &Estimate) -> String {
    let decimals = decimals(estimate.expanded());
    format!("{:.decimals$} ± {:.decimals$}", estimate.value, estimate.expanded())
}

/// "0.0213 (0.0207–0.0219)": a standard deviation and its 95 % interval. One unit of the last digit is
/// at most a quarter of the interval's width.
pub fn spread(spread: &Spread) -> String {
    let [low, high] = spread.interval_95;
    let decimals = decimals(0.25 * (high - low)).saturating_sub(1).max(decimals(spread.sd));
    format!("{:.decimals$} ({low:.decimals$}–{high:.decimals$})", spread.sd)
}

/// What a verdict says of an error and a limit.
pub fn verdict(verdict: Verdict, limit_mm: f64) -> String {
    match verdict {
        Verdict::Within => format!("within the limit of {limit_mm} mm"),
        Verdict::Exceeds => format!("beyond the limit of {limit_mm} mm"),
        Verdict::Undecided => {
            format!(
                "not shown to be within the limit of {limit_mm} mm: the uncertainty is too large"
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_their_uncertainty_leaves() {
        assert_eq!(signed(&Estimate::new(0.123_456, 0.000_61)), "+0.1235 ± 0.0012");
        assert_eq!(signed(&Estimate::new(-0.004, 0.11)), "+0.00 ± 0.22");
        assert_eq!(with_u(&Estimate::new(109.0, 0.058)), "109.00 ± 0.12");
        assert_eq!(with_u(&Estimate::new(1234.5, 60.0)), "1234 ± 120");
        assert_eq!([0.0213, 12.3, 0.0].map(rounded), ["0.021", "12", "0"]);
        let it = Spread { sd: 0.0213, interval_95: [0.0207, 0.0219] };
        assert_eq!(spread(&it), "0.0213 (0.0207–0.0219)");
        let it = Spread { sd: 0.993, interval_95: [0.898, 1.112] };
        assert_eq!(spread(&it), "0.99 (0.90–1.11)");
        let it = Spread { sd: 1.003, interval_95: [0.951, 1.062] };
        assert_eq!(spread(&it), "1.00 (0.95–1.06)");
    }
}
