//! A trial as rows with one time each, from which every format is made.
//!
//! A camera with a rolling shutter sees each point at a time of its own, some milliseconds after
//! the frame's. The row has the mean of these times, and each point is moved there with the
//! velocity that its neighbours give, and turned with their angular velocity: by so little that its
//! noise stays as it is.

use std::ops::Range;

use plumbline_analysis::series::{Axis, Series, usual_period_s};
use plumbline_files::BadInput;

use super::orientation::Orientation;
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
    /// How far, at most, a point's own time is from its row's; 0 with a global shutter.
    pub moved_s: f64,
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
    /// How its target was turned; `None` where it was not seen, or the scene is not known.
    pub orientation: Vec<Option<Orientation>>,
}

impl Rows {
    /// The rows of a trial's points, and of the orientations in each point's samples.
    ///
    /// # Errors
    /// When there are fewer than two frames, or a gap is so long that its rows would fill the
    /// memory.
    pub fn of(points: &Points, turned: &[Vec<Option<Orientation>>]) -> Result<Self, BadInput> {
        let mut seen_s: Vec<f64> =
            points.points.iter().flat_map(|point| &point.frame_time_s).copied().collect();
        seen_s.sort_by(f64::total_cmp);
        // Points of one frame have the very same frame's time.
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
        let delays = || points.points.iter().flat_map(delays_s);
        let delay_s = delays().sum::<f64>() / delays().count() as f64;
        let moved_s = delays().map(|of_point_s| (of_point_s - delay_s).abs()).fold(0.0, f64::max);
        let turned = turned.iter().map(Vec::as_slice).chain(std::iter::repeat(&[][..]));
        let tracks = points.points.iter().zip(turned);
        let tracks = tracks.map(|(point, turned)| track(point, turned, &time_s, delay_s)).collect();
        time_s.iter_mut().for_each(|time_s| *time_s += delay_s);
        let length_s = time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first);
        Ok(Self { rate_hz: (time_s.len() - 1) as f64 / length_s, time_s, moved_s, points: tracks })
    }

    /// A sentence where points were moved to their rows' times, for files that have room for it.
    pub fn moved(&self) -> Option<String> {
        // Less is none in the digits given.
        (self.moved_s >= 0.05e-3).then(|| {
            format!(
                "the camera sees each point at its own time; a row has the mean of these times, \
                 and each point was moved to it, by up to {:.1} ms, with the velocity between its \
                 neighbours",
                1e3 * self.moved_s
            )
        })
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

/// How much later than its frame's time each sample of a point is.
fn delays_s(point: &Point) -> impl Iterator<Item = f64> {
    point.series.time_s().iter().zip(&point.frame_time_s).map(|(own_s, frame_s)| own_s - frame_s)
}

/// A point in the rows of these frames, each `delay_s` after its frame.
fn track(point: &Point, turned: &[Option<Orientation>], frames_s: &[f64], delay_s: f64) -> Track {
    let series = &point.series;
    let segments = series.segments();
    let samples = segments.flat_map(|segment| segment.clone().map(move |at| (at, segment.clone())));
    let mut samples = samples.peekable();
    let rows = frames_s.iter().map(|frame_s| {
        let sample = samples.next_if(|(at, _)| point.frame_time_s[*at] == *frame_s);
        let Some((at, segment)) = sample else { return (None, None) };
        let now_s = frame_s + delay_s;
        let orientation = orientation_at(series, turned, at, &segment, now_s);
        (position_at(series, at, &segment, now_s), orientation)
    });
    let (position_mm, orientation) = rows.unzip();
    Track { name: point.name.clone(), position_mm, orientation }
}

/// The samples beside one in its segment.
fn beside(at: usize, segment: &Range<usize>) -> (usize, usize) {
    (at.max(segment.start + 1) - 1, (at + 1).min(segment.end - 1))
}

/// The orientation at a time near a sample's, with the angular velocity between the samples beside
/// it in its segment.
fn orientation_at(
    series: &Series,
    turned: &[Option<Orientation>],
    at: usize,
    segment: &Range<usize>,
    now_s: f64,
) -> Option<Orientation> {
    let orientation = turned.get(at).copied().flatten()?;
    let (before, after) = beside(at, segment);
    let time_s = series.time_s();
    let span_s = time_s[after] - time_s[before];
    let near = |at: usize| turned.get(at).copied().flatten();
    let turn = near(before).zip(near(after)).filter(|_| span_s > 0.0);
    Some(turn.map_or(orientation, |(before, after)| {
        let part = (now_s - time_s[at]) / span_s;
        orientation * (before.inverse() * after).powf(part)
    }))
}

/// The position at a time near a sample's, with the velocity between the samples beside it in its
/// segment.
fn position_at(series: &Series, at: usize, segment: &Range<usize>, now_s: f64) -> Option<[f64; 3]> {
    let (before, after) = beside(at, segment);
    let time_s = series.time_s();
    let span_s = time_s[after] - time_s[before];
    let [ap, ml, si] = Axis::ALL.map(|axis| {
        let values = series.along(axis)?;
        let velocity = if span_s > 0.0 { (values[after] - values[before]) / span_s } else { 0.0 };
        Some(values[at] + velocity * (now_s - time_s[at]))
    });
    Some([ap?, ml?, si?])
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn points(tracks: &[&[f64]]) -> Points {
        let point = |time_s: &&[f64]| {
            let along = |factor: f64| time_s.iter().map(|it| factor * it).collect();
            let series = Series::new(time_s.to_vec(), [along(1.0), along(2.0), along(3.0)]);
            Point {
                name: "lower".to_owned(),
                series: series.unwrap(),
                frame_time_s: time_s.to_vec(),
                noise: None,
            }
        };
        Points {
            place: "trial".to_owned(),
            points: tracks.iter().map(point).collect(),
            zero: String::new(),
            zero_s: 0.0,
            is_zero_set: false,
            zero_utc_s: None,
            verdict: None,
            events: Vec::new(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_frame_that_never_came_is_an_empty_row() {
        // At 10 Hz, with jitter. At 0.1 only the second point is seen, at 0.3 and 0.4 none.
        let rows = Rows::of(&points(&[&[0.0, 0.2, 0.51, 0.6], &[0.0, 0.1, 0.2, 0.51, 0.6]]), &[]);
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
        let uneven = Rows::of(&points(&[&[0.0, 0.1, 0.2, 0.325, 0.4]]), &[]).unwrap();
        assert!(uneven.unevenness().unwrap().contains("25.0 ms"));
        let error = Rows::of(&points(&[&[0.0, 0.1, 0.2, 1e6]]), &[]).unwrap_err().to_string();
        assert!(error.contains("most of them in gaps"), "{error}");
    }

    #[test]
    fn points_of_a_rolling_shutter_come_to_one_time() {
        // At 50 Hz, 4 and 9 ms after the frames' times; a frame is missing, then a second.
        let frames_s: Vec<f64> = [0, 1, 2, 4, 5, 60, 61].map(|at| 0.02 * f64::from(at)).to_vec();
        let mut points = points(&[&frames_s, &frames_s]);
        for (point, delay_s) in points.points.iter_mut().zip([4e-3, 9e-3]) {
            let own_s: Vec<f64> = frames_s.iter().map(|time_s| time_s + delay_s).collect();
            // An accelerated motion.
            let along = |factor: f64| own_s.iter().map(|it| factor * it * it).collect();
            let series = Series::new(own_s.clone(), [along(100.0), along(20.0), along(3.0)]);
            point.series = series.unwrap();
        }
        // Turning ever faster about the vertical axis, as the motion is accelerated.
        let turned = points.points.iter().map(|point| {
            let angle = |time_s: &f64| Vector3::z() * (0.1 * time_s * time_s);
            let time_s = point.series.time_s().iter();
            time_s.map(|it| Some(Orientation::from_scaled_axis(angle(it)))).collect()
        });
        let turned: Vec<Vec<Option<Orientation>>> = turned.collect();
        let rows = Rows::of(&points, &turned).unwrap();
        assert!((rows.moved_s - 2.5e-3).abs() < 1e-12);
        assert!(rows.moved().unwrap().contains("2.5 ms"));
        assert!((rows.time_s[1] - 0.0265).abs() < 1e-12 && rows.time_s.len() == 62);
        for (row, time_s) in rows.time_s.iter().enumerate() {
            let found: Vec<_> = rows.points.iter().map(|point| point.position_mm[row]).collect();
            assert_eq!(found[0].is_some(), found[1].is_some());
            let Some([ap_mm, ..]) = found[0] else { continue };
            // Of 2.5 mm or less in that time. Beside a gap the velocity is one of 10 ms ago.
            assert!((ap_mm - 100.0 * time_s * time_s).abs() < 0.011, "{row}: {ap_mm}");
            assert!((found[1].unwrap()[0] - ap_mm).abs() < 0.011, "{row}: {found:?}");
            for point in &rows.points {
                let angle_rad = point.orientation[row].unwrap().angle();
                // A thousandth of the bound for the position, and of its acceleration.
                assert!((angle_rad - 0.1 * time_s * time_s).abs() < 1.1e-5, "{row}: {angle_rad}");
            }
        }
        assert!(rows.points[0].position_mm[3].is_none());
        assert!(rows.points[0].orientation[3].is_none());
        // A single point that hardly changes its row is where it was, to the digits given.
        let [_, lower] = &mut points.points[..] else { panic!("two points") };
        lower.frame_time_s = lower.series.time_s().iter().map(|own_s| own_s - 9e-3).collect();
        points.points.remove(0);
        assert_eq!(Rows::of(&points, &[]).unwrap().moved(), None);
        // With a global shutter nothing is moved.
        let global = Rows::of(&self::points(&[&frames_s]), &[]).unwrap();
        assert_eq!((global.moved_s, global.moved()), (0.0, None));
        assert_eq!(global.points[0].position_mm[1], Some([0.02, 0.04, 0.06]));
    }
}
