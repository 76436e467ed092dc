//! The normal distribution in one and two dimensions, and Gauss-Legendre
//! quadrature: the mathematics under the renderer.

use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::LazyLock;

/// Beyond this many standard deviations an edge has no visible effect: the CDF is within 3e-7 of 0
/// or 1, a thirty-thousandth of a grey level.
pub(super) const REACH_SD: f64 = 5.0;

/// Table nodes per standard deviation.
const NODES_PER_SD: f64 = 64.0;

/// The table spans +-7 standard deviations, a little more than [`REACH_SD`].
const TABLE_END_SD: f64 = 7.0;

/// The CDF and its slope (the density, per node distance) at each node. The error of cubic Hermite
/// interpolation between them is at most (1/64)^4 / 384 x 1.4 (the largest third derivative of the
/// density), 2e-10.
static TABLE: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let last = (2.0 * TABLE_END_SD * NODES_PER_SD) as usize;
    (0..=last)
        .map(|node| {
            let x = node as f64 / NODES_PER_SD - TABLE_END_SD;
            let density = (-0.5 * x * x).exp() / (2.0 * PI).sqrt();
            [0.5 * libm::erfc(-x * FRAC_1_SQRT_2), density / NODES_PER_SD]
        })
        .collect()
});

/// Gives access to the table, so that its lazy initialisation is checked once and not per pixel.
#[derive(Clone, Copy)]
pub(super) struct NormalCdf(&'static [[f64; 2]]);

impl NormalCdf {
    pub(super) fn new() -> Self {
        Self(&TABLE)
    }

    /// P(N(0, 1) < x), to 2e-10.
    #[inline]
    pub(super) fn at(self, x: f64) -> f64 {
        if x <= -TABLE_END_SD {
            return 0.0;
        }
        if x >= TABLE_END_SD {
            return 1.0;
        }
        let position = (x + TABLE_END_SD) * NODES_PER_SD;
        let node = position as usize;
        let Some([[start, start_slope], [end, end_slope]]) =
            self.0.get(node..node + 2).and_then(|pair| <[_; 2]>::try_from(pair).ok())
        else {
            return 1.0;
        };
        let t = position - node as f64;
        let rise = end - start;
        // The Hermite cubic in Horner's form.
        let square = 3.0 * rise - 2.0 * start_slope - end_slope;
        let cube = start_slope + end_slope - 2.0 * rise;
        start + t * (start_slope + t * (square + t * cube))
    }
}

/// Nodes and weights on [-1, 1].
#[derive(Debug, Clone)]
pub(super) struct GaussLegendre(pub(super) Vec<[f64; 2]>);

impl GaussLegendre {
    /// The rule of `count` points, exact for polynomials of degree 2 count - 1.
    pub(super) fn new(count: usize) -> Self {
        let degree = count as f64;
        let nodes = (0..count).map(|index| {
            // Newton's method on the Legendre polynomial from Chebyshev's guess.
            let mut x = (PI * (index as f64 + 0.75) / (degree + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut value, mut before) = (x, 1.0);
                for n in 2..=count {
                    let n = n as f64;
                    (value, before) =
                        (((2.0 * n - 1.0) * x * value - (n - 1.0) * before) / n, value);
                }
                slope = degree * (x * value - before) / (x * x - 1.0);
                let step = value / slope;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            [x, 2.0 / ((1.0 - x * x) * slope * slope)]
        });
        Self(nodes.collect())
    }
}

/// The term that correlation adds to the product of two normal CDFs: P(X < h, Y < k) - P(X < h) P(Y
/// < k) for unit normals of correlation rho.
///
/// By Plackett's identity, the derivative of the bivariate CDF with respect to rho is the bivariate
/// density; with rho = sin t the integrand is smooth up to the ends (Drezner and Wesolowsky 1990;
/// Genz 2004). 1, 2, 3, 8 and 20 points give 1e-7 below |rho| = 0.02, 0.19, 0.3, 0.75 and 0.925: a
/// hundred-thousandth of a grey level.
pub(super) struct Correlation {
    /// [sin t, 1 / (2 cos^2 t), weight / 2 pi]
    nodes: Vec<[f64; 3]>,
}

impl Correlation {
    /// The number of rules.
    pub(super) const RULES: usize = 5;

    pub(super) fn rules() -> [GaussLegendre; Self::RULES] {
        [1, 2, 3, 8, 20].map(GaussLegendre::new)
    }

    /// Prepares for one correlation; `rules` are those of [`rules`](Self::rules).
    pub(super) fn prepare(&mut self, rho: f64, rules: &[GaussLegendre; Self::RULES]) {
        self.nodes.clear();
        // A correlation of 1e-7 changes no value by more than 2e-8.
        if rho.abs() < 1e-7 {
            return;
        }
        let rule = match rho.abs() {
            size if size < 0.02 => &rules[0],
            size if size < 0.19 => &rules[1],
            size if size < 0.3 => &rules[2],
            size if size < 0.75 => &rules[3],
            _ => &rules[4],
        };
        let half = rho.asin() * 0.5;
        self.nodes.extend(rule.0.iter().map(|[node, weight]| {
            let (sin, cos) = (half * (node + 1.0)).sin_cos();
            [sin, 0.5 / (cos * cos), weight * half / (2.0 * PI)]
        }));
    }

    pub(super) fn none() -> Self {
        Self { nodes: Vec::new() }
    }

    #[inline]
    pub(super) fn added(&self, h: f64, k: f64) -> f64 {
        let (squares, product) = (h * h + k * k, 2.0 * h * k);
        self.nodes
            .iter()
            .map(|[sin, scale, weight]| weight * (-(squares - product * sin) * scale).exp())
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_error_function() {
        let cdf = NormalCdf::new();
        let worst = (-80_000..=80_000)
            .map(|step| f64::from(step) * 1e-4)
            .map(|x| (cdf.at(x) - 0.5 * libm::erfc(-x * FRAC_1_SQRT_2)).abs())
            .fold(0.0, f64::max);
        assert!(worst < 3e-10, "{worst:e}");
        assert_eq!(cdf.at(f64::INFINITY), 1.0);
        assert_eq!(cdf.at(f64::NEG_INFINITY), 0.0);
    }

    #[test]
    fn quadrature_is_exact_up_to_its_degree_and_not_beyond() {
        for count in [2_usize, 3, 6, 20] {
            let rule = GaussLegendre::new(count);
            let integral = |power: i32| -> f64 {
                rule.0.iter().map(|[x, weight]| weight * x.powi(power)).sum()
            };
            let last_exact = 2 * count as i32 - 2;
            let exact = |power: i32| 2.0 / f64::from(power + 1);
            assert!((integral(last_exact) - exact(last_exact)).abs() < 1e-14);
            assert!((integral(last_exact + 2) - exact(last_exact + 2)).abs() > 1e-14);
        }
    }

    #[test]
    fn the_bivariate_cdf_has_its_closed_form_at_the_centre() {
        // P(X < 0, Y < 0) = 1/4 + asin(rho) / 2 pi (Sheppard).
        let rules = Correlation::rules();
        let mut correlation = Correlation::none();
        for rho in [0.0_f64, 0.05, -0.25, 0.6, -0.74, 0.9] {
            correlation.prepare(rho, &rules);
            assert!((correlation.added(0.0, 0.0) - rho.asin() / (2.0 * PI)).abs() < 1e-7);
        }
    }

    #[test]
    fn the_bivariate_cdf_integrates_the_conditional_one() {
        // P(X < h, Y < k) is also the integral over x < h of density(x) CDF((k - rho x) / s).
        let rules = Correlation::rules();
        let cdf = |x: f64| 0.5 * libm::erfc(-x * FRAC_1_SQRT_2);
        let fine = GaussLegendre::new(200);
        let mut correlation = Correlation::none();
        let arguments = [(0.3, -0.8), (-1.1, 0.4), (1.5, 1.2), (2.4, 2.5), (-2.0, 2.2)];
        let rhos = [0.019, -0.18, 0.2, -0.29, -0.55, 0.74, 0.85, -0.92];
        for ((h, k), rho) in arguments.into_iter().flat_map(|at| rhos.map(|rho| (at, rho))) {
            correlation.prepare(rho, &rules);
            let conditional = |x: f64| {
                let density = (-0.5 * x * x).exp() / (2.0 * PI).sqrt();
                density * cdf((k - rho * x) / (1.0 - rho * rho).sqrt())
            };
            let half = (h + 9.0) * 0.5;
            let integral: f64 =
                fine.0.iter().map(|[x, w]| w * half * conditional(half * (x + 1.0) - 9.0)).sum();
            let found = cdf(h) * cdf(k) + correlation.added(h, k);
            assert!((found - integral).abs() < 1e-7, "{h} {k} {rho}: {:e}", found - integral);
        }
    }
}
