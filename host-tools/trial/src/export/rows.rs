//! A trial as evenly spaced rows, from which every format is made.

use plumbline_analysis::series::{Axis, usual_period_s};
use plumbline_files::BadInput;

use crate::points::{Point, Points};

/// Ten hours at 200 Hz.
const ROWS_MAX: f64 = 7.2e6;

/// Formats without times take rows as evenly spaced. Where times differ from that by more than this
/// many periods, there is a warning.
const UNEVEN_PERIODS: f64 = 0.1;

/// One row per frame, including frames that never arrived.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    /// Rows per second on average.
    pub rate_hz: f64,
    /// When each frame was taken, from t = 0. A frame that never arrived has its place evenly
    /// between its neighbours.
    pub time_s: Vec<f64>,
    /// The points.
    pub points: Vec<Track>,
}

/// One point in all rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// `lower` or `upper`.
    pub name: String,
    /// AP, ML, SI; `None` where it was not seen.
    pub position_mm: Vec<Option<[f64; 3]>>,
}

impl Rows {
    /// The rows of a trial's points.
    ///
    /// # Errors
    /// When there are fewer than two frames, or a gap is so long that its rows would fill the
    /// memory.
    pub fn of(points: &Points) -> Result<Self, BadInput> {
        let mut seen_s: Vec<f64> =
            points.points.iter().flat_map(|point| point.series.time_s()).copied().collect();
        seen_s.sort_by(f64::total_cmp);
        // Points of one frame have the very same time.
        seen_s.dedup();
        let usual_s = usual_period_s(&seen_s).ok_or_else(|| {
            BadInput::whole(&points.place, "fewer than two frames", "export a longer trial")
        })?;
        let spans = || seen_s.windows(2).map(|pair| ((pair[1] - pair[0]) / usual_s).round());
        if spans().sum::<f64>() > ROWS_MAX {
            return Err(BadInput::whole(
                &points.place,
                format!("more than {ROWS_MAX} rows, most of them in gaps"),
                "export a trial without such a pause",
            ));
        }
        let mut time_s = Vec::with_capacity(seen_s.len());
        for (pair, span) in seen_s.windows(2).zip(spans()) {
            let span = span.max(1.0);
            let step_s = (pair[1] - pair[0]) / span;
            time_s.extend((0..span as usize).map(|at| pair[0] + at as f64 * step_s));
        }
        time_s.extend(seen_s.last());
        let tracks = points.points.iter().map(|point| track(point, &time_s)).collect();
        let length_s = time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first);
        Ok(Self { rate_hz: (time_s.len() - 1) as f64 / length_s, time_s, points: tracks })
    }

    /// The time of the first row.
    pub fn first_s(&self) -> f64 {
        self.time_s.first().copied().unwrap_or_default()
    }

    /// A warning where the times are not evenly spaced.
    pub fn unevenness(&self) -> Option<String> {
        let first_s = self.first_s();
        let off = |(row, time_s): (usize, &f64)| (time_s - first_s) * self.rate_hz - row as f64;
        let most = self.time_s.iter().enumerate().map(|it| off(it).abs()).fold(0.0, f64::max);
        (most > UNEVEN_PERIODS).then(|| {
            format!(
                "frames are up to {:.1} ms from the even spacing that the file format assumes",
                1e3 * most / self.rate_hz
            )
        })
    }
}

fn track(point: &Point, time_s: &[f64]) -> Track {
    let series = &point.series;
    let [ap, ml, si] = Axis::ALL.map(|axis| series.along(axis).unwrap_or_default());
    let samples = series.time_s().iter().zip(ap).zip(ml).zip(si);
    let mut samples = samples.map(|(((time_s, ap), ml), si)| (*time_s, [*ap, *ml, *si])).peekable();
    let position_mm =
        time_s.iter().map(|now_s| Some(samples.next_if(|(at_s, _)| at_s == now_s)?.1)).collect();
    Track { name: point.name.clone(), position_mm }
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::series::Series;

    use super::*;

    fn points(tracks: &[&[f64]]) -> Points {
        let point = |time_s: &&[f64]| {
            let along = |factor: f64| time_s.iter().map(|it| factor * it).collect();
            let series = Series::new(time_s.to_vec(), [along(1.0), along(2.0), along(3.0)]);
            Point { name: "lower".to_owned(), series: series.unwrap(), noise: None }
        };
        Points {
            place: "trial".to_owned(),
            points: tracks.iter().map(point).collect(),
            zero: String::new(),
            zero_utc_s: None,
            events: Vec::new(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_frame_that_never_came_is_an_empty_row() {
        // At 10 Hz, with jitter. At 0.1 only the second point is seen, at 0.3 and 0.4 none.
        let rows = Rows::of(&points(&[&[0.0, 0.2, 0.51, 0.6], &[0.0, 0.1, 0.2, 0.51, 0.6]]));
        let rows = rows.unwrap();
        assert_eq!(rows.time_s.len(), 7);
        for (found, wanted) in rows.time_s.iter().zip([0.0, 0.1, 0.2, 0.303_33, 0.406_67, 0.51]) {
            assert!((found - wanted).abs() < 1e-5, "{found} {wanted}");
        }
        let seen = |point: usize| -> Vec<bool> {
            rows.points[point].position_mm.iter().map(Option::is_some).collect()
        };
        assert_eq!(seen(0), [true, false, true, false, false, true, true]);
        assert_eq!(seen(1), [true, true, true, false, false, true, true]);
        assert_eq!(rows.points[1].position_mm[5], Some([0.51, 1.02, 1.53]));
        assert!((rows.rate_hz - 10.0).abs() < 1e-9);
        assert!(rows.unevenness().is_none(), "{:?}", rows.unevenness());
    }

    #[test]
    fn times_that_a_format_drops_are_told_and_a_long_pause_is_refused() {
        let uneven = Rows::of(&points(&[&[0.0, 0.1, 0.2, 0.325, 0.4]])).unwrap();
        assert!(uneven.unevenness().unwrap().contains("25.0 ms"));
        let error = Rows::of(&points(&[&[0.0, 0.1, 0.2, 1e6]])).unwrap_err().to_string();
        assert!(error.contains("most of them in gaps"), "{error}");
    }
}
