//! The paper's Table II, and simulated subjects with its means and errors.

use nalgebra::{DMatrix, Vector2};

/// The paper's Table II: total path length in mm. Axes and time, then for lower and upper trunk
/// mean and SEM of control and of hyperventilation, and Cohen's d.
const TABLE_2: &str = "\
AP   T1 147.1 5.9 177.8 11.1  0.92 191.2 8.3 232.9 14.7  0.93
AP   T2  99.0 4.8 114.3  4.9  0.84 129.0 7.5 147.7  4.5  0.81
AP   T3  96.1 4.3  97.4  3.4  0.09 126.6 6.4 131.3  5.1  0.22
ML   T1  80.9 3.6  94.2  8.5  0.55  90.3 3.1  98.6  9.0  0.33
ML   T2  50.5 3.4  59.9  2.8  0.81  53.9 3.5  63.3  2.8  0.8
ML   T3  47.2 4.4  48.3  1.8  0.09  51.1 5.0  52.3  1.9  0.08
SI   T1  67.4 3.3  82.1  6.3  0.78  41.1 3.0  57.7 10.9  0.55
SI   T2  44.5 2.3  50.4  2.3  0.67  29.9 2.7  31.2  2.3  0.14
SI   T3  41.5 2.2  43.6  1.8  0.28  29.1 1.8  26.7  3.6 -0.22
APML T1 183.3 7.1 221.1 14.3  0.89 227.9 8.8 272.7 18.1  0.84
APML T2 120.8 5.8 141.0  5.6  0.94 149.6 8.2 172.8 5.11  0.91
APML T3 116.2 6.7 118.5  3.7  0.12 145.5 8.8 150.9  4.9  0.2
APSI T1 165.0 6.8 200.3 13.1  0.91 202.5 9.2 252.7 20.0  0.86
APSI T2 110.8 5.4 127.3  5.5  0.82 137.2 8.1 155.9  5.0  0.74
APSI T3 106.9 4.8 108.8  3.9  0.12 134.6 6.5 138.0  6.3  0.14
MLSI T1 116.6 4.9 139.4 10.7  0.73 106.3 4.3 128.2 13.4  0.59
MLSI T2  74.7 4.1  86.8  3.7  0.83  66.5 4.1  76.4  3.6  0.68
MLSI T3  69.7 5.2  72.3  2.5  0.17  63.8 5.1  63.4  3.9 -0.02";

pub const SUBJECTS: usize = 14;
pub const CONDITIONS: [&str; 2] = ["control", "hyperventilation"];

/// The rows of the table: the direction, and the numbers.
pub fn rows() -> Vec<(&'static str, Vec<f64>)> {
    let row = |line: &'static str| {
        let mut words = line.split_whitespace();
        let direction = words.next().unwrap();
        (direction, words.skip(1).map(|it| it.parse().unwrap()).collect())
    };
    TABLE_2.lines().map(row).collect()
}

/// Values of the paper's fourteen subjects with these Cousineau-Morey means and errors.
///
/// The deviations from the means are u v: two orthogonal columns u of unit variance and zero mean,
/// and for each cell a vector v in the plane, as long as the cell's spread. The vectors form a
/// closed polygon, so that every subject's deviations sum to zero and normalisation leaves them
/// unchanged; such a polygon exists unless one error exceeds the sum of the others. Each subject's
/// own level, which normalisation removes, is added.
pub fn study(means: &[f64], sems: &[f64]) -> DMatrix<f64> {
    let cells = means.len() as f64;
    let to_spread = (SUBJECTS as f64 * (cells - 1.0) / cells).sqrt();
    let sides = closed_polygon(&sems.iter().map(|sem| sem * to_spread).collect::<Vec<_>>());
    // Waves of whole periods are orthogonal and of zero mean; their mean square is one half.
    let scale = (2.0 * (SUBJECTS - 1) as f64 / SUBJECTS as f64).sqrt();
    DMatrix::from_fn(SUBJECTS, means.len(), |subject, cell| {
        let (sin, cos) = (std::f64::consts::TAU * subject as f64 / SUBJECTS as f64).sin_cos();
        let level = 3.0 * (subject as f64 - 0.5 * (SUBJECTS - 1) as f64);
        means[cell] + scale * sides[cell].dot(&Vector2::new(sin, cos)) + level
    })
}

/// Vectors of these lengths that sum to zero: three groups, each along one side of a triangle.
fn closed_polygon(lengths: &[f64]) -> Vec<Vector2<f64>> {
    let mut order: Vec<usize> = (0..lengths.len()).collect();
    order.sort_by(|&left, &right| lengths[right].total_cmp(&lengths[left]));
    let (mut group, mut sides) = (vec![0; lengths.len()], [0.0_f64; 3]);
    for index in order {
        let shortest = (0..3).min_by(|&left, &right| sides[left].total_cmp(&sides[right]));
        group[index] = shortest.unwrap();
        sides[group[index]] += lengths[index];
    }
    let [a, b, c] = sides;
    // Turns the second side so that the way back is as long as the third.
    let x = (c * c - a * a - b * b) / (2.0 * a);
    let second = Vector2::new(x, (b * b - x * x).sqrt());
    let third = -Vector2::new(a, 0.0) - second;
    let directions = [Vector2::x(), second / b, third / c];
    lengths.iter().zip(group).map(|(length, group)| directions[group] * *length).collect()
}
