//! Recordings of motion capture: markers over time, from TRC or C3D.

use std::path::Path;

use plumbline_analysis::agreement::axes::Axes;
use plumbline_analysis::series::Series;
use plumbline_files::{BadInput, room};

use super::positions::Unit;

mod c3d;
mod trc;

/// No recording has more values: an hour of 200 markers at 200 Hz.
const VALUES_MAX: usize = 3 * 200 * 200 * 3600;

/// The number of markers that a message names.
const NAMED_MAX: usize = 100;

/// A recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Markers {
    /// The file.
    pub place: String,
    /// Frames per second.
    pub rate_hz: f64,
    /// Time of the first frame; 0 if the file has no times.
    pub first_s: f64,
    /// The unit, if the file states it.
    pub unit: Option<Unit>,
    /// The markers, in the file's order.
    pub markers: Vec<Marker>,
}

/// One marker.
#[derive(Debug, Clone, PartialEq)]
pub struct Marker {
    /// Its name.
    pub name: String,
    /// X, Y, Z in each frame, in the file's unit; `None` where it was not seen.
    pub position: Vec<Option<[f64; 3]>>,
}

impl Markers {
    /// Reads a file by the extension of its name, .trc or .c3d, which .gz may follow.
    ///
    /// # Errors
    /// When it cannot be read or understood.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        match kind(path).as_deref() {
            Some("trc") => trc::read(path),
            Some("c3d") => c3d::read(path),
            _ => Err(BadInput::whole(
                path.display(),
                "its name ends neither with .trc nor with .c3d",
                "give such a file, or a table with --columns",
            )),
        }
    }

    /// Whether a file's name is that of such a recording.
    #[must_use]
    pub fn is_one(path: &Path) -> bool {
        matches!(kind(path).as_deref(), Some("trc" | "c3d"))
    }

    /// The mean of these markers along the body's axes. Frames in which one of them was not seen
    /// are left out. Without names, the file must have one marker, which is taken.
    ///
    /// # Errors
    /// When there is no such marker, the unit is unknown or contradicts the file's, or too few
    /// frames have all of them.
    pub fn series(
        &self,
        names: &[String],
        unit: Option<Unit>,
        axes: &Axes,
    ) -> Result<Series, BadInput> {
        let unit = self.unit(unit)?;
        let markers = self.named(names)?;
        let frames = markers.iter().map(|it| it.position.len()).min().unwrap_or_default();
        let mut time_s = Vec::new();
        let mut columns: [Vec<f64>; 3] = Default::default();
        for frame in 0..frames {
            let seen: Option<Vec<[f64; 3]>> =
                markers.iter().map(|marker| marker.position[frame]).collect();
            let Some(seen) = seen else { continue };
            time_s.push(self.first_s + frame as f64 / self.rate_hz);
            for (axis, column) in columns.iter_mut().enumerate() {
                for (marker, position) in markers.iter().zip(&seen) {
                    let field = format_args!("{} (frame {})", marker.name, frame + 1);
                    room::check_mm(&self.place, field, position[axis] * unit.mm())?;
                }
                let sum: f64 = seen.iter().map(|it| it[axis]).sum();
                column.push(sum / seen.len() as f64 * unit.mm());
            }
        }
        let found = time_s.len();
        Series::new(time_s, axes.apply(columns.each_ref().map(Vec::as_slice))).map_err(|error| {
            let names: Vec<&str> = markers.iter().map(|it| it.name.as_str()).collect();
            BadInput::new(
                &self.place,
                names.join(", "),
                format!("{error}: seen together in {found} of {frames} frames"),
                "give other markers, or a longer recording",
            )
        })
    }

    fn unit(&self, given: Option<Unit>) -> Result<Unit, BadInput> {
        match (self.unit, given) {
            (Some(own), Some(given)) if own != given => Err(BadInput::new(
                &self.place,
                "unit",
                format!("the file says {}, and --unit says {}", own.word(), given.word()),
                format!("leave --unit out, or give --unit {}", own.word()),
            )),
            (Some(unit), _) | (None, Some(unit)) => Ok(unit),
            (None, None) => Err(BadInput::new(
                &self.place,
                "unit",
                "the file does not say it",
                "give --unit mm, cm or m",
            )),
        }
    }

    fn named(&self, names: &[String]) -> Result<Vec<&Marker>, BadInput> {
        if names.is_empty() && self.markers.len() == 1 {
            return Ok(self.markers.iter().collect());
        }
        let find = |name: &String| self.markers.iter().find(|marker| marker.name == *name);
        let absent: Vec<&str> =
            names.iter().filter(|it| find(it).is_none()).map(String::as_str).collect();
        if names.is_empty() || !absent.is_empty() {
            let mut there: Vec<&str> =
                self.markers.iter().take(NAMED_MAX).map(|it| it.name.as_str()).collect();
            if self.markers.len() > NAMED_MAX {
                there.push("...");
            }
            let found = if names.is_empty() { "no marker is named" } else { "no such marker" };
            return Err(BadInput::new(
                &self.place,
                absent.join(", "),
                format!("{found}; there are {}", there.join(", ")),
                "name one or more of them with --marker",
            ));
        }
        Ok(names.iter().filter_map(find).collect())
    }
}

/// The extension of a file's name in small letters, without .gz.
fn kind(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().to_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    Some(name.rsplit_once('.')?.1.to_owned())
}

/// The unit with this name.
fn unit_of(word: &str) -> Option<Unit> {
    match word.trim().to_lowercase().as_str() {
        "mm" | "millimeters" | "millimetres" => Some(Unit::Mm),
        "cm" | "centimeters" | "centimetres" => Some(Unit::Cm),
        "m" | "meters" | "metres" => Some(Unit::M),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use plumbline_test_support::mutations;

    use super::*;
    use crate::c3d::{Header, Parameters, Value, encode};

    /// A number of 1e160 would make every figure infinite.
    #[test]
    fn what_is_beyond_any_room_is_refused() {
        let axes = Axes::parse("ap=X").unwrap();
        let series = |x: f64, unit| {
            let position = vec![Some([1.0, 2.0, 3.0]), Some([x, 2.0, 3.0])];
            let marker = Marker { name: "A".to_owned(), position };
            let markers = Markers {
                place: "a.trc".to_owned(),
                rate_hz: 100.0,
                first_s: 0.0,
                unit: Some(unit),
                markers: vec![marker],
            };
            markers.series(&[], None, &axes).map(|_| ()).map_err(|error| error.to_string())
        };
        let error = series(-1e160, Unit::Mm).unwrap_err();
        assert!(error.starts_with("a.trc: A (frame 2): a position of -1e160 mm"), "{error}");
        assert!(series(101.0, Unit::M).is_err());
        assert_eq!(series(99.0, Unit::M), Ok(()));
    }

    /// What is read has one position for each marker and frame, and gives a series or an error.
    fn check(name: &str, good: &[u8]) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let axes = Axes::parse("ap=X,ml=-Y,si=Z").unwrap();
        let mut read = 0;
        for bytes in mutations(good, 1500) {
            std::fs::write(&path, bytes).unwrap();
            let Ok(found) = Markers::read(&path) else { continue };
            read += 1;
            let frames = found.markers[0].position.len();
            for marker in &found.markers {
                assert_eq!(marker.position.len(), frames);
                let names = [marker.name.clone()];
                if let Ok(series) = found.series(&names, None, &axes) {
                    assert!(series.time_s().iter().all(|it| it.is_finite()));
                    assert!(series.rate_hz().is_finite());
                }
            }
        }
        // Otherwise nothing of this has been tried.
        assert!(read > 100, "{read} of 1500 were read");
    }

    #[test]
    fn no_trc_makes_the_reader_panic() {
        let mut text = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\t\
            NumMarkers\tUnits\n100\t100\t9\t2\tmm\nFrame#\tTime\tA\t\t\tB\t\t\n\t\tX1\tY1\tZ1\tX2\t\
            Y2\tZ2\n\n"
            .to_owned();
        for frame in 1..=9 {
            text += &format!("{frame}\t0.0{}\t1\t2\t3.5\t{frame}\tNaN\t6\n", frame - 1);
        }
        check("a.trc", text.as_bytes());
    }

    #[test]
    fn no_c3d_makes_the_reader_panic() {
        let header = Header {
            points: 2,
            analog: 1,
            first_frame: 1,
            last_frame: 9,
            scale: -1.0,
            rate_hz: 50.0,
        };
        let mut parameters = Parameters::default();
        let labels = ["A", "B"].map(str::to_owned).to_vec();
        parameters.set("POINT", "LABELS", Value::Texts(labels));
        parameters.set("POINT", "UNITS", Value::Text("mm".to_owned()));
        parameters.set("TRIAL", "ACTUAL_START_FIELD", Value::Integers(vec![1, 0]));
        parameters.set("TRIAL", "ACTUAL_END_FIELD", Value::Integers(vec![9, 0]));
        let frames: Vec<u8> = (0..81).flat_map(|it| (it as f32).to_le_bytes()).collect();
        check("a.c3d", &encode(&header, parameters, &frames));
    }
}
