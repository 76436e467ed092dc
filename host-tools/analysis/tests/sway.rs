//! Movements whose figures are known, and the figures of short, broken or odd trials.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix3, Rotation3, Vector3};
use plumbline_analysis::filter::{Design, Unsuitable};
use plumbline_analysis::series::{Axis, Series};
use plumbline_analysis::sway::figure::{Absent, ByAxis, Figure, Figures};
use plumbline_analysis::sway::noise::{Noise, NoiseError};
use plumbline_analysis::sway::{
    PathNoises, Prepared, Settings, Sway, SwayError, SwayFigures, analyze,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const RATE_HZ: f64 = 60.0;

/// The number of samples in a minute at 60 Hz.
const MINUTE: usize = 3600;

fn series(samples: usize, position_mm: impl Fn(f64) -> [f64; 3]) -> Series {
    let time_s: Vec<f64> = (0..samples).map(|frame| frame as f64 / RATE_HZ).collect();
    let along = |axis: usize| time_s.iter().map(|time| position_mm(*time)[axis]).collect();
    Series::new(time_s.clone(), [0, 1, 2].map(along)).unwrap()
}

fn unfiltered() -> Settings {
    Settings { filter: Design::None, ..Default::default() }
}

fn sway(series: &Series) -> Sway {
    analyze(series, None, &unfiltered()).unwrap()
}

fn value(figure: &Figure) -> f64 {
    figure.value().unwrap_or_else(|| panic!("{figure:?}"))
}

/// Why there is no figure.
fn reason(figure: &Figure) -> String {
    match figure {
        Figure::Absent { absent } => absent.to_string(),
        Figure::Known { value, .. } => panic!("{value}"),
    }
}

/// Asserts that a figure is within a relative bound.
fn close(figure: &Figure, expected: f64, relative: f64) {
    let value = value(figure);
    assert!((value - expected).abs() <= relative * expected.abs(), "{value} {expected}");
}

/// The same noise for every sample.
fn same_noise(series: &Series, covariance_mm2: Matrix3<f64>) -> Result<Noise, NoiseError> {
    Noise::per_sample(series, &vec![covariance_mm2; series.samples()])
}

/// The same noise for every sample, independent along the axes.
fn independent_noise(series: &Series, sd_mm: [f64; 3]) -> Noise {
    let variances = Vector3::from(sd_mm).map(|sd| sd * sd);
    same_noise(series, Matrix3::from_diagonal(&variances)).unwrap()
}

fn normals(seed: u64) -> impl FnMut() -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    move || StandardNormal.sample(&mut random)
}

#[test]
fn a_circle_has_its_chords_its_radius_and_its_frequency() {
    // In the transverse plane, a revolution in 4 s: 240 chords.
    let (radius_mm, turn_s) = (10.0, 4.0);
    let circle = series(MINUTE, |time| {
        let angle = TAU * time / turn_s;
        [radius_mm * angle.cos(), radius_mm * angle.sin(), 0.0]
    });
    let Sway { figures, samples, gaps, .. } = sway(&circle);
    assert_eq!((samples, gaps), (MINUTE, 0));
    let chord_mm = 2.0 * radius_mm * (PI / 240.0).sin();
    close(&figures.path.length_mm.planes.transverse, 3599.0 * chord_mm, 1e-12);
    // From -R to R and back, as steps: every turning point is a sample.
    close(&figures.bins[0].length_mm.axes.ap, 5.0 * 4.0 * radius_mm, 1e-12);
    for bin in &figures.bins[..2] {
        assert_eq!((bin.samples, bin.covered), (1200, 1.0));
        close(&bin.length_mm.planes.transverse, 1200.0 * chord_mm, 1e-12);
        close(&bin.mean_velocity_mm_s.planes.transverse, 60.0 * chord_mm, 1e-12);
    }
    // The last sample is at 59.983 s, and no step starts at it.
    assert!((figures.bins[2].covered - 1199.0 / 1200.0).abs() < 1e-12);
    let bins: f64 = figures.bins.iter().map(|bin| value(&bin.length_mm.planes.transverse)).sum();
    close(&figures.path.length_mm.planes.transverse, bins, 1e-12);
    // A point that does not move has zero length, with certainty.
    close(&figures.path.length_mm.axes.si, 0.0, 0.0);
    close(&figures.path.length_mm.planes.sagittal, value(&figures.path.length_mm.axes.ap), 1e-14);

    close(&figures.extent.rms_mm.axes.ml, radius_mm / 2.0_f64.sqrt(), 1e-12);
    close(&figures.extent.rms_mm.planes.transverse, radius_mm, 1e-12);
    close(&figures.extent.range_mm.ap, 2.0 * radius_mm, 1e-12);
    // Both variances are R^2 / 2 x N / (N - 1), from which the definition's factors give this.
    let count = MINUTE as f64;
    let quantile = 0.05_f64.powf(-2.0 / (count - 2.0)) - 1.0;
    let semi_axis_mm = radius_mm * ((count + 1.0) / 2.0 * quantile).sqrt();
    close(&figures.ellipse.transverse.major_mm, semi_axis_mm, 1e-12);
    close(&figures.ellipse.transverse.area_mm2, PI * semi_axis_mm * semi_axis_mm, 1e-12);
    assert_eq!(figures.spectrum.axes.si.mean_hz.value(), None);

    // Fifteen revolutions: all power in one bin of 1/60 Hz, under a triangle one bin wide on each
    // side.
    let spectrum = &figures.spectrum.axes.ap;
    for figure in [&spectrum.mean_hz, &spectrum.centroidal_hz, &spectrum.median_hz] {
        close(figure, 0.25, 1e-10);
    }
    close(&spectrum.f95_hz, 0.25 + 0.9 / 60.0, 1e-10);
}

#[test]
fn an_ellipse_lies_as_it_was_drawn() {
    for angle_rad in [-1.2, -0.3, 0.0, 0.7, FRAC_PI_2] {
        let (sin, cos) = f64::sin_cos(angle_rad);
        let tilted = series(MINUTE, |time| {
            let (major, minor) = (6.0 * (TAU * time / 4.0).cos(), 2.0 * (TAU * time / 4.0).sin());
            [cos * major - sin * minor, 0.0, sin * major + cos * minor]
        });
        let ellipse = sway(&tilted).figures.ellipse.sagittal;
        assert!((value(&ellipse.angle_rad) - angle_rad).abs() < 1e-12, "{angle_rad} {ellipse:?}");
        close(&ellipse.major_mm, 3.0 * value(&ellipse.minor_mm), 1e-12);
    }
}

#[test]
fn velocities_and_frequencies_are_those_of_the_trial_also_at_whole_milliseconds() {
    for rate_hz in [60.0, 120.0, 150.0] {
        let of = |time_s: &dyn Fn(f64) -> f64| {
            let exact_s: Vec<f64> = (0..3600).map(|frame| f64::from(frame) / rate_hz).collect();
            let ap = exact_s.iter().map(|it| (TAU * 0.5 * it).sin()).collect();
            let time_s = exact_s.iter().map(|it| time_s(*it)).collect();
            sway(&Series::new(time_s, [ap, Vec::new(), Vec::new()]).unwrap()).figures
        };
        let exact = of(&|time_s| time_s);
        let rounded = of(&|time_s| (time_s * 1e3).round() / 1e3);
        // The first time is 0 in both; the last is off by at most half a millisecond.
        let bound = 0.5e-3 / (3599.0 / rate_hz - 0.5e-3);
        let velocity = |it: &SwayFigures| value(&it.path.mean_velocity_mm_s.axes.ap);
        close(&rounded.path.mean_velocity_mm_s.axes.ap, velocity(&exact), bound);
        close(&rounded.spectrum.axes.ap.mean_hz, value(&exact.spectrum.axes.ap.mean_hz), bound);
    }
}

#[test]
fn nothing_is_counted_over_a_gap() {
    // 1 mm per frame; frames 1000 to 1199 are missing, on either side of 16.7 and 20 s.
    let frames: Vec<f64> = (0..1000).chain(1200..3601).map(f64::from).collect();
    let time_s: Vec<f64> = frames.iter().map(|frame| frame / RATE_HZ).collect();
    let line = Series::new(time_s, [frames.clone(), frames.clone(), Vec::new()]).unwrap();
    let sway = analyze(&line, None, &Settings { covered_min: 0.8, ..unfiltered() }).unwrap();
    assert_eq!((sway.gaps, sway.samples), (1, 3401));
    assert!((sway.gaps_s - 201.0 / RATE_HZ).abs() < 1e-12);
    let [first, second, third] = &sway.figures.bins[..] else { panic!("three bins") };
    close(&first.length_mm.axes.ap, 999.0, 1e-14);
    close(&first.mean_velocity_mm_s.axes.ap, 999.0 * 0.06, 1e-12);
    assert!((first.covered - 999.0 / 1200.0).abs() < 1e-12, "{first:?}");
    close(&second.length_mm.planes.transverse, 1200.0 * 2.0_f64.sqrt(), 1e-14);
    assert_eq!((second.covered, third.covered), (1.0, 1.0));
    close(&sway.figures.path.length_mm.axes.ap, 999.0 + 2400.0, 1e-14);
    assert!((sway.figures.path.covered - 3399.0 / 3600.0).abs() < 1e-12);
    assert!((sway.figures.spectrum.from_s - 20.0).abs() < 1e-12);

    // The filter leaves a straight line unchanged, from end to end of each part.
    let smooth = analyze(&line, None, &Settings::default()).unwrap();
    close(&smooth.figures.path.length_mm.axes.ap, 999.0 + 2400.0, 1e-12);
    assert_eq!(smooth.filter.left_out_samples, 0);
}

#[test]
fn a_bin_with_too_little_says_how_much_it_has_and_needs() {
    // A mark came 5.5 s late: the last bin ends with the recording at 55.1 s.
    let wave = series(3307, |time| [time.sin(), time.cos(), 0.0]);
    let bins = |covered_min: f64| {
        analyze(&wave, None, &Settings { covered_min, ..unfiltered() }).unwrap().figures.bins
    };
    let [_, second, third] = &bins(0.9)[..] else { panic!("three bins") };
    assert!(second.length_mm.axes.ap.value().is_some());
    let expected = "40 to 60 s: 15.1 of 20 s measured (75 %); at least 90 % are needed";
    for figure in [&third.length_mm.axes.ap, &third.mean_velocity_mm_s.planes.coronal] {
        assert_eq!(reason(figure), expected);
    }
    // The bound itself is enough.
    let covered = third.covered;
    assert!(bins(covered)[2].length_mm.axes.ap.value().is_some());
    assert!(bins(covered + 1e-6)[2].length_mm.axes.ap.value().is_none());
    // The share is rounded down: it never reads like the bound that it misses.
    assert!(reason(&bins(0.76)[2].length_mm.axes.ml).contains("(75 %); at least 76 %"));
    // 57 hundredths of a hundred are 56.99999999999999 without care.
    let absent = Absent::TooLittleMeasured { from_s: 0.0, to_s: 5.0, covered: 0.5, needed: 0.57 };
    let expected = "0 to 5 s: 2.5 of 5 s measured (50 %); at least 57 % are needed";
    assert_eq!(absent.to_string(), expected);
    assert_eq!(plumbline_analysis::sway::path::COVERED_MIN, Settings::default().covered_min);
}

#[test]
fn a_span_without_an_end_reaches_to_the_last_sample() {
    let wave = series(MINUTE, |time| [time.sin(), 0.0, time]);
    let settings = Settings { span_s: Some(10.0..f64::INFINITY), ..unfiltered() };
    let open = analyze(&wave, None, &settings).unwrap();
    let last_s = 3599.0 / RATE_HZ;
    assert_eq!((open.from_s, open.to_s, open.samples), (10.0, last_s, 3000));
    assert!((open.measured_s - (last_s - 10.0)).abs() < 1e-9, "{}", open.measured_s);
    close(&open.figures.path.length_mm.axes.si, last_s - 10.0, 1e-12);
    // Where nothing is left there are no figures.
    let late = Settings { span_s: Some(last_s..f64::INFINITY), ..settings };
    assert_eq!(analyze(&wave, None, &late), Err(SwayError::EmptySpan));
}

#[test]
fn the_span_cuts_after_the_filter() {
    let wave = series(MINUTE, |time| [(TAU * time).sin(), 0.0, time]);
    let settings = Settings { span_s: Some(10.0..40.0), ..Default::default() };
    let sway = analyze(&wave, None, &settings).unwrap();
    let whole = analyze(&wave, None, &Settings::default()).unwrap();
    assert_eq!(sway.samples, 1800);
    close(&sway.figures.path.length_mm.axes.si, 30.0, 1e-12);
    // Bin ends inside the series are not ends of the filter: half of the middle bin's 20 s plus 10.
    let bin = value(&whole.figures.bins[1].length_mm.axes.ap);
    close(&sway.figures.path.length_mm.axes.ap, 1.5 * bin, 1e-12);
}

#[test]
fn lengths_alone_are_those_among_all_figures() {
    // Its ellipse lies along AP, so that the copies' angles are on both sides of where they wrap.
    let series =
        series(400, |time_s| [3.0 * (2.0 * time_s).sin(), 0.2 * (5.0 * time_s).cos(), 900.0]);
    let noise = independent_noise(&series, [0.02, 0.01, 0.01]);
    let settings = Settings { span_s: Some(1.0..5.0), ..Default::default() };
    let all = analyze(&series, Some(&noise), &settings).unwrap();
    let prepared = Prepared::of(&series, &settings).unwrap();
    let (alone, copies) = prepared.lengths(Some(&noise)).unwrap();
    let effect = prepared.path_errors(&noise).unwrap().noise;
    assert_eq!((&alone.path, &alone.extent), (&all.figures.path, &all.figures.extent));
    assert_eq!(alone.ellipse, all.figures.ellipse);
    let noises = all.noise.unwrap();
    assert_eq!((effect, copies), (noises.total, noises.copies));
    let wrong = Settings { covered_min: -1.0, ..settings.clone() };
    let error = Prepared::of(&series, &wrong).err();
    assert_eq!(error, Some(SwayError::Setting("share of a bin")));
}

#[test]
fn white_noise_does_not_diffuse_and_a_random_walk_has_exponent_one_half() {
    let mut normal = normals(1);
    let noise: Vec<f64> = (0..MINUTE).map(|_| normal()).collect();
    let mut position = 0.0;
    // 2 D tau = 2 x 6 mm²/s / 60 Hz = 0.2 mm² per step.
    let mut walk = || -> Vec<f64> {
        let step = |_| {
            position += 0.2_f64.sqrt() * normal();
            position
        };
        (0..60 * MINUTE).map(step).collect()
    };
    let [ap, ml] = [walk(), walk()];
    let time_s = |samples: usize| (0..samples).map(|frame| frame as f64 / RATE_HZ).collect();
    let noise = Series::new(time_s(noise.len()), [noise.clone(), Vec::new(), Vec::new()]).unwrap();
    let flat = sway(&noise).figures.diffusion.axes.ap;
    // 2 mm² at all lags. Up to 10 of 60 s at either end are left out of the mean, so it wanders by
    // 2 sqrt(1200) / 3600 = 0.02 mm² over 10 s: 0.001 mm²/s; the bound is five times that.
    assert!(value(&flat.long_mm2_s).abs() < 0.005, "{flat:?}");
    assert!(value(&flat.hurst_long).abs() < 0.02, "{flat:?}");

    let walks = Series::new(time_s(ap.len()), [ap, ml, Vec::new()]).unwrap();
    let diffusion = sway(&walks).figures.diffusion;
    for plot in [&diffusion.axes.ap, &diffusion.axes.ml] {
        // The mean square displacement at a lag of k of n steps has a relative sampling error of
        // sqrt(4 k / 3 n): 0.03 at 2.5 s, 0.06 at 10 s. The bound is four times that.
        close(&plot.short_mm2_s, 6.0, 0.12);
        close(&plot.hurst_short, 0.5, 0.06);
        close(&plot.hurst_long, 0.5, 0.2);
    }
    close(&diffusion.transverse.short_mm2_s, 12.0, 0.09);
}

/// Positions with noise of these standard deviations.
fn noisy(
    samples: usize,
    sd_mm: [f64; 3],
    seed: u64,
    position_mm: impl Fn(f64) -> [f64; 3],
) -> Series {
    let exact = series(samples, position_mm);
    let mut normal = normals(seed);
    let along = Axis::ALL.map(|axis| {
        let sd_mm = sd_mm[axis as usize];
        exact.along(axis).unwrap().iter().map(|it| it + sd_mm * normal()).collect()
    });
    exact.with_positions(along).unwrap()
}

#[test]
fn a_point_at_rest_moves_by_its_noise() {
    let sd_mm = [0.05, 0.02, 0.03];
    let still = noisy(20 * MINUTE, sd_mm, 2, |_| [0.0; 3]);
    let noise = independent_noise(&still, sd_mm);
    // The mean length of n independent steps varies by 0.755 / sqrt(n). Unfiltered steps are nearly
    // independent; of filtered ones about every tenth is: 0.0028 and 0.009, times four.
    for (filter, bound) in [(Design::None, 0.011), (Design::PAPER, 0.035)] {
        let settings = Settings { filter, bins_s: Vec::new(), ..Default::default() };
        let sway = analyze(&still, Some(&noise), &settings).unwrap();
        let path = sway.noise.unwrap().total;
        let measured = &sway.figures.path.length_mm;
        let (axes, planes) = (&path.alone_mm.axes, &path.alone_mm.planes);
        close(&axes.ap, value(&measured.axes.ap), bound);
        close(&axes.si, value(&measured.axes.si), bound);
        close(&planes.transverse, value(&measured.planes.transverse), bound);
        close(&planes.coronal, value(&measured.planes.coronal), bound);
        // A path longer than that of noise by the fraction d has a remainder of sqrt(2 d).
        let inflation = value(&path.inflation_mm.planes.transverse);
        assert!(
            inflation > (1.0 - (2.0 * bound).sqrt()) * value(&measured.planes.transverse),
            "{inflation} {measured:?}"
        );
    }
}

#[test]
fn inflation_is_what_noise_added() {
    // Random movement, 0.1 mm per frame along AP and half as much along ML, with equal noise.
    let mut normal = normals(3);
    let steps: Vec<[f64; 2]> = (0..MINUTE).map(|_| [0.1 * normal(), 0.05 * normal()]).collect();
    let positions = |axis: usize| -> Vec<f64> {
        steps
            .iter()
            .scan(0.0, |sum, step| {
                *sum += step[axis];
                Some(*sum)
            })
            .collect()
    };
    let (ap, ml) = (positions(0), positions(1));
    let frame = |time: f64| (time * RATE_HZ).round() as usize;
    let sd_mm = [0.07, 0.07, 0.0];
    let exact = series(MINUTE, |time| [ap[frame(time)], ml[frame(time)], 0.0]);
    let moved = noisy(MINUTE, sd_mm, 4, |time| [ap[frame(time)], ml[frame(time)], 0.0]);
    let noise = independent_noise(&moved, sd_mm);
    let measured = analyze(&moved, Some(&noise), &unfiltered()).unwrap();
    let inflation = measured.noise.unwrap().total.inflation_mm;
    let truth = sway(&exact).figures.path.length_mm;
    let measured = measured.figures.path.length_mm;
    // The sampling error of the path itself is 0.755 / sqrt(3600) = 1.3 % of its 290 mm along AP,
    // and the inflation, 41 % of the true path, amplifies that about twice.
    let added = |measured: &Figure, truth: &Figure| value(measured) - value(truth);
    close(&inflation.axes.ap, added(&measured.axes.ap, &truth.axes.ap), 0.1);
    close(
        &inflation.planes.transverse,
        added(&measured.planes.transverse, &truth.planes.transverse),
        0.1,
    );
}

#[test]
fn uncertainties_are_those_that_can_be_derived() {
    // A line at 60 mm/s: its path runs from its first to its last sample, and so does its range.
    let sd_mm = [0.1, 0.05, 0.02];
    let line = series(MINUTE, |time| [60.0 * time, 0.0, (TAU * time / 4.0).sin()]);
    let noise = independent_noise(&line, sd_mm);
    let sway = analyze(&line, Some(&noise), &unfiltered()).unwrap();
    assert_eq!(sway.noise.unwrap().copies, 40);
    let figures = sway.figures;
    // A standard deviation from 40 copies has a relative error of 1 / sqrt(78); three times that.
    let near = |figure: &Figure, expected: f64| {
        let sd = figure.noise_sd().unwrap();
        assert!((sd / expected - 1.0).abs() < 0.34, "{sd} {expected}");
    };
    near(&figures.path.length_mm.axes.ap, 2.0_f64.sqrt() * 0.1);
    near(&figures.extent.range_mm.ap, 2.0_f64.sqrt() * 0.1);
    // d RMS / d x_i = (x_i - mean) / (N RMS).
    near(&figures.extent.rms_mm.axes.si, 0.02 / (MINUTE as f64).sqrt());
    near(&figures.extent.rms_mm.axes.ap, 0.1 / (MINUTE as f64).sqrt());
    // Filtered, the error of an end is what the parabola of 31 samples leaves there: of the
    // variance, 3 (3 n^2 - 3 n + 2) / (n (n + 1) (n + 2)) = 0.256.
    let filtered = analyze(&line, Some(&noise), &Settings::default()).unwrap().figures;
    near(&filtered.path.length_mm.axes.ap, (2.0 * 0.256_f64).sqrt() * 0.1);
    // Every known figure has an uncertainty, and without noise none has.
    let mut figures = figures;
    figures.each(&mut |it| assert_eq!(it.noise_sd().is_some(), it.value().is_some()));
    let mut without = self::sway(&line).figures;
    without.each(&mut |it| assert_eq!(it.noise_sd(), None));
}

#[test]
fn an_ellipses_angle_is_as_uncertain_along_one_axis_as_along_another() {
    // Along the second axis, where the angle jumps from pi/2 to -pi/2, and elsewhere.
    for angle_rad in [FRAC_PI_2, -FRAC_PI_2 + 1e-4, 0.3] {
        let (sin, cos) = f64::sin_cos(angle_rad);
        let tilted = series(MINUTE, |time| {
            let (major, minor) = (6.0 * (TAU * time / 4.0).cos(), 2.0 * (TAU * time / 4.0).sin());
            [cos * major - sin * minor, sin * major + cos * minor, 0.0]
        });
        let sd_mm = 0.5;
        let noise = independent_noise(&tilted, [sd_mm; 3]);
        let sway = analyze(&tilted, Some(&noise), &unfiltered()).unwrap();
        // Noise of equal size along both axes has no direction, so the result holds in the
        // ellipse's own axes: d angle = d covariance / (difference of the variances), and the
        // covariance has the variance sd^2 (sum of the variances) / N.
        let (major, minor) = (6.0 * 6.0 / 2.0, 2.0 * 2.0 / 2.0);
        let expected = sd_mm * f64::sqrt((major + minor) / MINUTE as f64) / (major - minor);
        let sd = sway.figures.ellipse.transverse.angle_rad.noise_sd().unwrap();
        // From 40 copies: three times 1 / sqrt(78).
        assert!((sd / expected - 1.0).abs() < 0.34, "{angle_rad}: {sd} {expected}");
    }
}

#[test]
fn noise_may_be_correlated_and_differ_from_sample_to_sample() {
    let wave = series(MINUTE, |time| [time.sin(), (1.1 * time).cos(), 0.0]);
    let alone = |noise: &Noise, settings: &Settings| {
        analyze(&wave, Some(noise), settings).unwrap().noise.unwrap().total.alone_mm
    };
    let filtered = Settings::default();
    // Turning the noise about the SI axis does not change the length in the transverse plane.
    let diagonal = Matrix3::from_diagonal(&Vector3::new(0.01, 0.0025, 0.0001));
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.6);
    let turned = turn * diagonal * turn.transpose();
    let straight = alone(&same_noise(&wave, diagonal).unwrap(), &filtered);
    let constant = alone(&same_noise(&wave, turned).unwrap(), &filtered);
    close(&constant.planes.transverse, value(&straight.planes.transverse), 1e-12);
    let (sin, cos) = 0.6_f64.sin_cos();
    let ap = (0.01 * cos * cos + 0.0025 * sin * sin).sqrt();
    close(&constant.axes.ap, value(&straight.axes.ap) * ap / 0.1, 1e-12);

    // Every other sample has no noise: half the variance of each step without a filter.
    let halved = |frame: usize| if frame.is_multiple_of(2) { turned } else { Matrix3::zeros() };
    let halved: Vec<Matrix3<f64>> = (0..MINUTE).map(halved).collect();
    let halved = alone(&Noise::per_sample(&wave, &halved).unwrap(), &unfiltered());
    let whole = alone(&same_noise(&wave, turned).unwrap(), &unfiltered());
    close(&halved.planes.transverse, value(&whole.planes.transverse) / 2.0_f64.sqrt(), 1e-12);
}

#[test]
fn samples_that_are_left_out_take_their_noise_with_them() {
    // A fragment of 20 samples, too short for the filter, and a part that is long enough.
    let frames: Vec<f64> = (0..20).chain(30..1030).map(f64::from).collect();
    let time_s: Vec<f64> = frames.iter().map(|frame| frame / RATE_HZ).collect();
    let series = Series::new(time_s, [frames.clone(), frames, Vec::new()]).unwrap();
    let covariance =
        |frame| if frame < 20 { Matrix3::identity() } else { Matrix3::identity() * 0.01 };
    let covariances: Vec<Matrix3<f64>> = (0..1020).map(covariance).collect();
    let each = Noise::per_sample(&series, &covariances).unwrap();
    let constant = independent_noise(&series, [0.1; 3]);
    let [each, constant] =
        [each, constant].map(|noise| analyze(&series, Some(&noise), &Settings::default()).unwrap());
    assert_eq!((each.samples, each.filter.left_out_samples), (1000, 20));
    let alone = |noise: Option<PathNoises>| noise.unwrap().total.alone_mm.planes.transverse;
    close(&alone(each.noise), value(&alone(constant.noise)), 1e-9);
}

#[test]
fn what_is_no_covariance_is_refused() {
    let wave = series(40, |time| [time, time, time]);
    let mut lopsided = Matrix3::identity();
    lopsided[(0, 1)] = 0.5;
    let impossible = Matrix3::new(1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    let still = Matrix3::new(0.0, 0.5, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 1.0);
    for bad in [lopsided, impossible, still, Matrix3::repeat(f64::NAN), -Matrix3::identity()] {
        assert_eq!(same_noise(&wave, bad), Err(NoiseError::NoCovariance(0)), "{bad}");
    }
    let mut endless = vec![Matrix3::identity(); 40];
    endless[17][(1, 1)] = f64::INFINITY;
    assert_eq!(Noise::per_sample(&wave, &endless), Err(NoiseError::NoCovariance(17)));
    let singular = Matrix3::repeat(1.0);
    assert!(same_noise(&wave, singular).is_ok() && same_noise(&wave, Matrix3::zeros()).is_ok());
    assert_eq!(Noise::per_sample(&wave, &[singular; 39]), Err(NoiseError::Length));
    let other = series(41, |time| [time, time, time]);
    let noise = Noise::per_sample(&other, &[singular; 41]).unwrap();
    assert_eq!(analyze(&wave, Some(&noise), &unfiltered()), Err(SwayError::NoiseLength));
}

#[test]
fn what_is_not_measured_is_absent_and_says_so() {
    let time_s: Vec<f64> = (0..MINUTE).map(|frame| frame as f64 / RATE_HZ).collect();
    let along = |speed: f64| time_s.iter().map(|time| (speed * time).sin()).collect();
    let plate = Series::new(time_s.clone(), [along(1.0), along(1.7), Vec::new()]).unwrap();
    let noise = independent_noise(&plate, [0.1; 3]);
    let sway = analyze(&plate, Some(&noise), &Settings::default()).unwrap();
    let absent = Figure::Absent { absent: Absent::NotMeasured(Axis::Si) };
    let length = &sway.figures.path.length_mm;
    assert!(length.planes.transverse.value().is_some());
    for figure in [&length.axes.si, &length.planes.sagittal, &length.planes.coronal] {
        assert_eq!(figure, &absent);
    }
    assert_eq!(sway.figures.extent.range_mm.si, absent);
    assert_eq!(sway.figures.ellipse.coronal.area_mm2, absent);
    assert_eq!(sway.figures.spectrum.axes.si.median_hz, absent);
    assert_eq!(sway.figures.diffusion.axes.si.hurst_long, absent);
    assert_eq!(sway.noise.as_ref().unwrap().total.inflation_mm.axes.si, absent);

    let json = serde_json::to_value(&sway).unwrap();
    let reason = &json["path"]["length_mm"]["si"]["absent"];
    assert_eq!(reason, "SI was not measured");
    let ap = &json["bins"][0]["length_mm"]["ap"];
    assert!(ap["value"].as_f64().unwrap() > 0.0 && ap["noise_sd"].as_f64().unwrap() > 0.0);
    assert!(json["noise"]["bins"][2]["alone_mm"]["transverse"]["value"].is_f64());
}

#[test]
fn a_short_trial_has_the_figures_that_it_can_have() {
    let short = series(300, |time| [time.sin(), time.cos(), 0.0]);
    let sway = analyze(&short, None, &Settings::default()).unwrap();
    let figures = &sway.figures;
    assert!(figures.path.length_mm.axes.ap.value().is_some());
    assert!((figures.bins[0].covered - 299.0 / 1200.0).abs() < 1e-12);
    assert_eq!(
        reason(&figures.bins[1].length_mm.axes.ap),
        "20 to 40 s: 0.0 of 20 s measured (0 %); at least 90 % are needed"
    );
    let part = "the longest part without a gap is 5.0 s, but";
    assert_eq!(reason(&figures.spectrum.axes.ap.mean_hz), format!("{part} 10.0 s are needed"));
    assert_eq!(reason(&figures.density.peak_s), format!("{part} 10.0 s are needed"));
    assert_eq!(
        reason(&figures.diffusion.transverse.short_mm2_s),
        format!("{part} 20.0 s are needed")
    );
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let wave = series(MINUTE, |time| [time.sin(), time.cos(), 0.0]);
    let refused = |change: &dyn Fn(&mut Settings)| {
        let mut settings = Settings::default();
        change(&mut settings);
        analyze(&wave, None, &settings).unwrap_err()
    };
    for covered_min in [-0.1, 1.1, f64::NAN] {
        let error = refused(&|it| it.covered_min = covered_min);
        assert_eq!(error, SwayError::Setting("share of a bin"));
    }
    assert_eq!(refused(&|it| it.bins_s[1] = 20.0..20.0), SwayError::Setting("bins"));
    assert_eq!(refused(&|it| it.span_s = Some(0.0..f64::NAN)), SwayError::Setting("span"));
    assert_eq!(
        refused(&|it| it.density.radius_mm = 0.0),
        SwayError::Setting("sway density's radius")
    );
    let rate_hz = wave.rate_hz();
    for window_s in [-1.0, 0.05] {
        let error = refused(&|it| it.filter = Design::SavitzkyGolay { window_s });
        assert_eq!(error, SwayError::Filter(Unsuitable::Window { window_s, rate_hz }));
    }
    assert_eq!(refused(&|it| it.span_s = Some(70.0..80.0)), SwayError::EmptySpan);
    let fragments = series(30, |time| [time, time, time]);
    let error = analyze(&fragments, None, &Settings::default()).unwrap_err();
    assert_eq!(error, SwayError::OnlyFragments { needed: 31 });
}

#[test]
fn odd_series_give_finite_figures_or_none() {
    let waves = |size: f64| move |time: f64| [size * time.sin(), size * time.cos(), size * time];
    let all = [
        series(2, waves(1.0)),
        series(3, waves(1.0)),
        series(1500, |_| [0.1, 0.0, 1e6]),
        series(1500, waves(1e-200)),
        series(1500, waves(1e160)),
        series(1500, waves(1e300)),
        // A point that returns every five frames; a line; a step.
        series(1500, |time| {
            [(TAU * 12.0 * time).sin(), 0.1 * time, f64::from(u8::from(time > 9.0))]
        }),
        // Every sample between two gaps; a rate of 0.2 Hz; a rate of 20 kHz.
        Series::new(
            (0..40).map(|it| f64::from(it * it)).collect(),
            [(0..40).map(f64::from).collect(), vec![], vec![]],
        )
        .unwrap(),
        Series::new(
            (0..40).map(|it| f64::from(it) * 5.0).collect(),
            [vec![], vec![], (0..40).map(f64::from).collect()],
        )
        .unwrap(),
        Series::new((0..40_000).map(|it| f64::from(it) * 5e-5).collect(), [vec![], vec![], vec![]])
            .unwrap(),
    ];
    let mut known = 0;
    for (index, series) in all.iter().enumerate() {
        let noise = independent_noise(series, [0.1, 0.0, 1e-3]);
        let butterworth = Design::Butterworth { cutoff_hz: 5.0, order: 2 };
        for filter in [Design::None, Design::PAPER, butterworth] {
            let settings = Settings { filter, ..Default::default() };
            let Ok(mut sway) = analyze(series, Some(&noise), &settings) else {
                // Unsuitable filters; without a filter there is always a result.
                assert!(filter != Design::None, "{index}");
                continue;
            };
            sway.figures.each(&mut |figure| {
                if let Figure::Known { value, noise_sd } = figure {
                    assert!(value.is_finite() && noise_sd.is_none_or(f64::is_finite), "{index}");
                    known += 1;
                }
            });
        }
    }
    assert!(known > 500, "{known}");
    // A constant has no frequency and no diffusion, and rounding must not produce any.
    let ByAxis { ap, si, .. } = sway(&all[2]).figures.spectrum.axes;
    let still = Figure::Absent { absent: Absent::NoMovement };
    assert_eq!((ap.mean_hz, si.f95_hz), (still.clone(), still.clone()));
    assert_eq!(sway(&all[2]).figures.diffusion.axes.ap.long_mm2_s, still);
}
