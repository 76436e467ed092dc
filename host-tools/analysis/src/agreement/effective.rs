//! The effective sample size: how many independent values a series of dependent values is worth.
//!
//! The mean of n values with the autocorrelations r_k has the variance s^2 / n_eff, with
//!
//! ```text
//! n_eff = n / (1 + 2 sum over k of (n_k / n) r_k)
//! ```
//!
//! (Bartlett 1946), where n_k is the number of pairs of values that are k apart: n - k in a single
//! run, fewer in several runs, which are independent of each other. Since r_k is the mean of the
//! n_k products divided by the variance, each term is the sum of those products over the sum of
//! squares.
//!
//! Beyond some k the estimated r_k are only noise. The sum therefore ends where the terms 2m and
//! 2m + 1 together are no longer positive, because r_2m + r_2m+1 is positive for every reversible
//! process (Geyer 1992, Statistical Science 7:473, initial positive sequence). No shape, such as a
//! single exponential, is assumed: differences between two systems are white noise on top of slow
//! drifts.

use realfft::RealFftPlanner;

/// A smaller number cannot be told apart from zero: confidence intervals are then as wide as they
/// get.
const EFFECTIVE_MIN: f64 = 3.0;

/// The effective number of values in runs of equally spaced values from one process: between 3 and
/// the number of values. Deviations are taken from the mean of all runs.
///
/// If the values do not differ, or if r_k alternate so that the mean is better than n independent
/// values would make it, the result is n. Costs O(n log n).
#[must_use]
pub fn effective_samples(runs: &[Vec<f64>]) -> f64 {
    let all = || runs.iter().flatten();
    let n = all().count() as f64;
    let mean = all().sum::<f64>() / n;
    let deviations: Vec<Vec<f64>> =
        runs.iter().map(|run| run.iter().map(|it| it - mean).collect()).collect();
    let sums = sums_of_products(&deviations);
    let Some(&squares) = sums.first().filter(|it| **it > 0.0) else { return n };
    let pairs = sums.chunks(2).map(|pair| pair.iter().sum::<f64>() / squares);
    let sum = 2.0 * pairs.take_while(|pair| *pair > 0.0).sum::<f64>() - 1.0;
    (n / sum.max(1.0)).clamp(EFFECTIVE_MIN.min(n), n)
}

/// For each lag up to the length of the longest run, the sum of the products of values that are
/// this far apart within one run. Computed by FFT, with zeros after each run so that its end does
/// not wrap around to its start.
fn sums_of_products(runs: &[Vec<f64>]) -> Vec<f64> {
    let mut planner = RealFftPlanner::<f64>::new();
    let mut sums = vec![0.0; runs.iter().map(Vec::len).max().unwrap_or_default()];
    for run in runs {
        let length = (2 * run.len()).next_power_of_two();
        let (forward, inverse) =
            (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
        let (mut values, mut spectrum) = (forward.make_input_vec(), forward.make_output_vec());
        values[..run.len()].copy_from_slice(run);
        forward.process(&mut values, &mut spectrum).expect("the plan's lengths");
        spectrum.iter_mut().for_each(|it| *it = it.norm_sqr().into());
        inverse.process(&mut spectrum, &mut values).expect("the plan's lengths, and real ends");
        for (sum, products) in sums.iter_mut().zip(&values[..run.len()]) {
            *sum += products / length as f64;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// A first-order autoregressive process.
    fn process(seed: u64, count: usize, phi: f64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut value = 0.0;
        let mut next = || {
            let drawn: f64 = StandardNormal.sample(&mut random);
            value = phi * value + (1.0 - phi * phi).sqrt() * drawn;
            value
        };
        // Drops the start-up, before the process is stationary.
        (0..200 + count).map(|_| next()).skip(200).collect()
    }

    /// For this process n_eff is n (1 - phi) / (1 + phi). At phi = 0.9 the estimate itself varies
    /// by 6 % between runs of 20,000 values, and the mean of 20 such runs is within 4 %.
    #[test]
    fn it_is_what_theory_says_of_a_first_order_process() {
        for (phi, share) in [(0.0, 1.0), (0.5, 1.0 / 3.0), (0.9, 0.1 / 1.9)] {
            let found = |seed| effective_samples(&[process(seed, 20_000, phi)]) / 20_000.0;
            let mean = (0..20).map(found).sum::<f64>() / 20.0;
            assert!((mean / share - 1.0).abs() < 0.04, "{phi}: {mean} instead of {share}");
        }
    }

    /// The definition: the variance of means is s^2 / n_eff. 400 means determine it to 7 %.
    #[test]
    fn it_predicts_how_means_spread() {
        let runs = |trial: u64| -> Vec<Vec<f64>> {
            (0..3).map(|run| process(1000 + 3 * trial + run, 700, 0.8)).collect()
        };
        let mean = |runs: &[Vec<f64>]| runs.iter().flatten().sum::<f64>() / 2100.0;
        let all: Vec<Vec<Vec<f64>>> = (0..400).map(runs).collect();
        let variance = all.iter().map(|it| mean(it).powi(2)).sum::<f64>() / 400.0;
        let predicted = all.iter().map(|it| effective_samples(it).recip()).sum::<f64>() / 400.0;
        assert!((predicted / variance - 1.0).abs() < 0.2, "{predicted} {variance}");
    }

    /// Short runs, whose ends cut off most products, follow the theory as a long run does: with
    /// independent runs of m values, n / n_eff is 1 + 2 sum over k of (1 - k / m) phi^k.
    #[test]
    fn it_is_what_theory_says_of_short_runs() {
        let (count, length) = (100_u64, 20_i32);
        for phi in [0.5_f64, 0.8, 0.9] {
            let share = |lag: i32| (1.0 - f64::from(lag) / f64::from(length)) * phi.powi(lag);
            let expected = 1.0 + 2.0 * (1..length).map(share).sum::<f64>();
            let found = |trial: u64| {
                let runs: Vec<Vec<f64>> = (0..count)
                    .map(|run| process(count * trial + run, length as usize, phi))
                    .collect();
                2000.0 / effective_samples(&runs)
            };
            let mean = (0..100).map(found).sum::<f64>() / 100.0;
            // Each varies by 9 %, their mean by 0.9 %; the sum is up to 3 % too large because it
            // continues for as long as noise keeps its terms positive.
            assert!((mean / expected - 1.0).abs() < 0.05, "{phi}: {mean} instead of {expected}");
        }
    }

    #[test]
    fn sums_by_fft_are_the_direct_ones() {
        let runs = [1, 2, 3, 64, 65, 700, 0].map(|count| process(count as u64, count, 0.9));
        let sums = sums_of_products(&runs);
        assert_eq!(sums.len(), 700);
        for (lag, found) in sums.iter().enumerate() {
            let products = |run: &Vec<f64>| -> f64 {
                run.iter().zip(run.iter().skip(lag)).map(|(a, b)| a * b).sum()
            };
            let expected = runs.iter().map(products).sum::<f64>();
            // Each of about ten transform stages rounds by 1e-16 of the sum of squares.
            assert!((found - expected).abs() < 1e-14 * sums[0], "{lag}: {found} {expected}");
        }
    }

    #[test]
    fn edges_have_a_number() {
        assert_eq!(effective_samples(&[vec![2.0; 10]]), 10.0);
        assert_eq!(effective_samples(&[vec![1.0, 2.0]]), 2.0);
        // A drift is worth next to nothing; alternating signs are worth no more than n.
        let drift: Vec<f64> = (0..100).map(f64::from).collect();
        assert!((3.0..6.0).contains(&effective_samples(&[drift])));
        let alternating: Vec<f64> = (0..100).map(|it| f64::from(it % 2)).collect();
        assert_eq!(effective_samples(&[alternating]), 100.0);
        // Single values, as in a recording broken into pieces, have no autocorrelation.
        assert_eq!(effective_samples(&[vec![1.0], vec![2.0], vec![4.0], vec![1.0]]), 4.0);
    }
}
