//! `targets.toml`: the printed targets.
//!
//! ```toml
//! [[target]]
//! name = "lumbar"
//! role = "lower"                     # "lower", "upper" or "scene"
//! columns = 6                        # INNER corners
//! rows = 5
//! pitch_mm = 12.0
//! origin = "center"                  # or "first_corner"
//! virtual_point_mm = [0.0, 0.0, 100.0]
//! ```
//!
//! Instead of `pitch_mm` and `origin`, `points_mm` may list the measured corner
//! positions `[x, y, z]`, row by row.

use std::path::Path;

use plumbline::config::is_visible;
use plumbline::limits::{NAME_BYTES_MAX, TARGET_CORNERS_MAX, TARGETS_MAX};
use plumbline::target::{Origin, Role, TargetError, TargetGeometry};
use serde::{Deserialize, Serialize};

use crate::BadInput;
use crate::counting::counted;
use crate::{from_toml, read_text, write_text};

const REMEDY: &str = "a target has name, role (upper, lower or scene), columns, rows, pitch_mm, and optionally origin, virtual_point_mm, points_mm";

/// One target as its file describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetDescription {
    /// Its name in every output.
    pub name: String,
    /// Its role in the measurement.
    #[serde(with = "RoleName")]
    pub role: Role,
    /// Inner corners along x.
    pub columns: u8,
    /// Inner corners along y.
    pub rows: u8,
    /// Distance of neighbouring corners; absent when `points_mm` are given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_mm: Option<f64>,
    /// Which point of the grid is the origin; the centre unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<OriginName>,
    /// The point of the body that it measures, in the target frame; the origin unless given.
    #[serde(default)]
    pub virtual_point_mm: [f64; 3],
    /// Measured corner positions, row by row, in the target frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points_mm: Option<Vec<[f64; 3]>>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Role", rename_all = "snake_case")]
enum RoleName {
    Upper,
    Lower,
    Scene,
}

/// The words for [`Origin`] in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OriginName {
    /// The middle of the grid.
    Center,
    /// The inner corner at the top left.
    FirstCorner,
}

impl From<OriginName> for Origin {
    fn from(name: OriginName) -> Self {
        match name {
            OriginName::Center => Self::Center,
            OriginName::FirstCorner => Self::FirstCorner,
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    target: Vec<TargetDescription>,
}

/// A target that can be tracked, and its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedTarget {
    /// Its name in every output.
    pub name: String,
    /// Grid, corner positions, role and virtual point.
    pub geometry: TargetGeometry,
}

/// The targets of one file, in its order, at least one and at most [`TARGETS_MAX`].
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// The targets.
    pub targets: Vec<NamedTarget>,
    /// Warnings about targets that are accepted; one line each.
    pub warnings: Vec<String>,
}

/// Parses a grid as command lines give it: COLUMNSxROWS.
///
/// # Errors
/// What to give instead.
pub fn grid_size(text: &str) -> Result<[u8; 2], String> {
    let sides = text.split_once(['x', 'X']).map(|(columns, rows)| [columns, rows]);
    let Some([Ok(columns), Ok(rows)]) = sides.map(|sides| sides.map(|side| side.trim().parse()))
    else {
        return Err("give the numbers of INNER corners as COLUMNSxROWS, such as 6x5".into());
    };
    Ok([columns, rows])
}

/// The pitch of the standard pair, mm.
pub const STANDARD_PITCH_MM: f64 = 12.0;

/// The pitch of the standard board, mm.
pub const BOARD_PITCH_MM: f64 = 20.0;

/// The standard pair of a measurement: lumbar 6 x 5 and shoulder 5 x 4, 12 mm.
#[must_use]
pub fn standard_pair() -> Vec<TargetDescription> {
    let target = |name: &str, role, columns, rows, virtual_point_mm| TargetDescription {
        name: name.to_owned(),
        role,
        columns,
        rows,
        pitch_mm: Some(STANDARD_PITCH_MM),
        origin: Some(OriginName::Center),
        virtual_point_mm,
        points_mm: None,
    };
    vec![
        target("lumbar", Role::Lower, 6, 5, [0.0, 0.0, 100.0]),
        target("shoulder", Role::Upper, 5, 4, [0.0; 3]),
    ]
}

/// The standard board, with which cameras are calibrated and scenes measured: 9 x 6, 20 mm.
#[must_use]
pub fn standard_board() -> TargetDescription {
    TargetDescription {
        name: "board".to_owned(),
        role: Role::Scene,
        columns: 9,
        rows: 6,
        pitch_mm: Some(BOARD_PITCH_MM),
        origin: Some(OriginName::Center),
        virtual_point_mm: [0.0; 3],
        points_mm: None,
    }
}

/// The targets of a file.
///
/// # Errors
/// When the file cannot be read, a field is missing, unknown or out of range,
/// or two targets share a name, a role or a shape.
pub fn read(path: &Path) -> Result<Targets, BadInput> {
    parse(&read_text(path)?, &path.display().to_string())
}

/// The targets of a text; `place` names it in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, place: &str) -> Result<Targets, BadInput> {
    let fields: Fields = from_toml(text, place, REMEDY)?;
    check(&fields.target, place)
}

/// The trackable form of descriptions; `place` names them in errors.
///
/// # Errors
/// As [`read`].
pub fn check(descriptions: &[TargetDescription], place: &str) -> Result<Targets, BadInput> {
    if descriptions.is_empty() || descriptions.len() > TARGETS_MAX {
        return Err(BadInput::new(
            place,
            "[[target]]",
            counted(descriptions.len(), "target"),
            format!("describe 1 to {TARGETS_MAX} targets, each under its own [[target]]"),
        ));
    }
    let mut targets = Targets { targets: Vec::new(), warnings: Vec::new() };
    for (index, description) in descriptions.iter().enumerate() {
        let name = &description.name;
        if name.is_empty() || name.len() > NAME_BYTES_MAX || !name.chars().all(is_visible) {
            return Err(BadInput::new(
                place,
                format!("name of target {}", index + 1),
                format!("{name:?}"),
                format!(
                    "give a name of 1 to {NAME_BYTES_MAX} bytes, all of whose characters can be seen"
                ),
            ));
        }
        let geometry = geometry(description, place)?;
        for (other, other_target) in descriptions[..index].iter().zip(&targets.targets) {
            refuse_twins(description, other, place)?;
            // Turned by a quarter, a 6 x 5 board is a 5 x 6 one.
            let sides = |target: &TargetGeometry| {
                let (columns, rows) = (target.columns(), target.rows());
                (columns.max(rows), columns.min(rows))
            };
            if sides(&geometry) == sides(&other_target.geometry) {
                return Err(BadInput::new(
                    place,
                    format!("columns, rows of target {name:?}"),
                    format!(
                        "{} x {}, the shape of target {:?}",
                        description.columns, description.rows, other.name
                    ),
                    "targets are told apart by their numbers of inner corners: print one of them with another number of columns or rows",
                ));
            }
        }
        if geometry.is_symmetric() {
            targets.warnings.push(format!(
                "{place}: target {name:?}: {} x {} inner corners look the same after half a turn; the orientation whose x axis points most to the image's right is taken. A grid whose columns + rows is odd has only one orientation",
                description.columns, description.rows
            ));
        }
        targets.targets.push(NamedTarget { name: name.clone(), geometry });
    }
    Ok(targets)
}

fn refuse_twins(
    target: &TargetDescription,
    other: &TargetDescription,
    place: &str,
) -> Result<(), BadInput> {
    if target.name == other.name {
        return Err(BadInput::new(
            place,
            "name",
            format!("two targets are called {:?}", target.name),
            "give each target a name of its own",
        ));
    }
    if target.role == other.role {
        return Err(BadInput::new(
            place,
            format!("role of target {:?}", target.name),
            format!("the role of target {:?} too", other.name),
            "give at most one target each of the roles upper, lower and scene",
        ));
    }
    Ok(())
}

fn geometry(description: &TargetDescription, place: &str) -> Result<TargetGeometry, BadInput> {
    let of = |field: &str| format!("{field} of target {:?}", description.name);
    let &TargetDescription { columns, rows, role, virtual_point_mm, .. } = description;
    let made = match (&description.points_mm, description.pitch_mm) {
        (Some(_), Some(_)) => {
            return Err(BadInput::new(
                place,
                of("pitch_mm"),
                "points_mm are given too",
                "keep one of them: pitch_mm for an exact grid, points_mm for measured corners",
            ));
        }
        (None, None) => {
            return Err(BadInput::new(
                place,
                of("pitch_mm"),
                "missing",
                "give the distance of neighbouring corners in millimetres, measured on the print",
            ));
        }
        (Some(_), None) if description.origin.is_some() => {
            return Err(BadInput::new(
                place,
                of("origin"),
                "points_mm are given too",
                "leave origin out: measured points carry their own origin",
            ));
        }
        (Some(points_mm), None) => TargetGeometry::from_points(
            columns,
            rows,
            points_mm.iter().copied(),
            role,
            virtual_point_mm,
        ),
        (None, Some(pitch_mm)) => {
            let origin = description.origin.unwrap_or(OriginName::Center).into();
            TargetGeometry::checker(columns, rows, pitch_mm, origin, role, virtual_point_mm)
        }
    };
    made.map_err(|error| {
        let (field, found) = match error {
            TargetError::GridSize => (of("columns, rows"), format!("{columns} x {rows}")),
            TargetError::Pitch => {
                (of("pitch_mm"), format!("{}", description.pitch_mm.unwrap_or_default()))
            }
            TargetError::PointCount => (
                of("points_mm"),
                format!(
                    "{} for {columns} x {rows} corners",
                    counted(description.points_mm.as_ref().map_or(0, Vec::len), "point")
                ),
            ),
            TargetError::PointValue => {
                (of("points_mm, virtual_point_mm"), "a value out of range".to_owned())
            }
        };
        let remedy = match error {
            TargetError::GridSize => format!(
                "count INNER corners, where four squares meet: at least 3 x 3, at most {TARGET_CORNERS_MAX} in all"
            ),
            other => other.to_string(),
        };
        BadInput::new(place, field, found, remedy)
    })
}

/// The description of a target, from which exactly the same geometry is made again: with the pitch
/// where it is constant, else with every corner.
#[must_use]
pub fn description(name: &str, geometry: &TargetGeometry) -> TargetDescription {
    let corner = |index| -> [f64; 3] { geometry.corner_mm(index).into() };
    let whole = TargetDescription {
        name: name.to_owned(),
        role: geometry.role(),
        columns: geometry.columns() as u8,
        rows: geometry.rows() as u8,
        pitch_mm: None,
        origin: None,
        virtual_point_mm: geometry.virtual_point_mm().into(),
        points_mm: Some((0..geometry.corner_count()).map(corner).collect()),
    };
    // The difference of two corners, and what was meant before it was rounded.
    let apart_mm = corner(1)[0] - corner(0)[0];
    let pitches_mm = [apart_mm, (apart_mm * 1e9).round() / 1e9];
    let mut regular = pitches_mm.iter().flat_map(|&pitch_mm| {
        [OriginName::Center, OriginName::FirstCorner].map(|origin| TargetDescription {
            pitch_mm: Some(pitch_mm),
            origin: Some(origin),
            points_mm: None,
            ..whole.clone()
        })
    });
    let is_the_same = |regular: &TargetDescription| {
        self::geometry(regular, "").is_ok_and(|made| made == *geometry)
    };
    regular.find(is_the_same).unwrap_or(whole)
}

/// Writes a targets file.
///
/// # Errors
/// When the operating system refuses.
pub fn write(path: &Path, descriptions: &[TargetDescription]) -> Result<(), BadInput> {
    write_text(path, &to_toml(descriptions))
}

/// The targets file's text.
#[must_use]
pub fn to_toml(descriptions: &[TargetDescription]) -> String {
    let fields = Fields { target: descriptions.to_vec() };
    toml::to_string(&fields).expect("numbers and texts are TOML")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_pair_comes_back() {
        let text = to_toml(&standard_pair());
        let targets = parse(&text, "targets.toml").unwrap();
        assert_eq!(targets.warnings, Vec::<String>::new());
        let names: Vec<_> = targets.targets.iter().map(|target| target.name.as_str()).collect();
        assert_eq!(names, ["lumbar", "shoulder"]);
        let lumbar = &targets.targets[0].geometry;
        assert_eq!((lumbar.columns(), lumbar.rows(), lumbar.role()), (6, 5, Role::Lower));
        assert_eq!(lumbar.corner_mm(0).x, -30.0);
        assert_eq!(lumbar.virtual_point_mm().z, 100.0);
    }

    #[test]
    fn measured_points_replace_pitch_and_origin() {
        let points: Vec<String> =
            (0..12).map(|index| format!("[{}.5, {}, 0.25]", index % 4, index / 4)).collect();
        let head = "[[target]]\nname = \"a\"\nrole = \"upper\"\ncolumns = 4\nrows = 3\n";
        let text = format!("{head}points_mm = [{}]\n", points.join(", "));
        let targets = parse(&text, "t.toml").unwrap();
        assert_eq!(targets.targets[0].geometry.corner_mm(5).as_slice(), [1.5, 1.0, 0.25]);
        let error = parse(&format!("{text}pitch_mm = 2.0\n"), "t.toml").unwrap_err();
        assert!(error.field.starts_with("pitch_mm"));
        let error = parse(&format!("{head}points_mm = [[0, 0, 0]]"), "t.toml").unwrap_err();
        assert_eq!(error.found, "1 point for 4 x 3 corners");
    }

    #[test]
    fn each_wrong_field_is_named() {
        let text = to_toml(&standard_pair());
        let cases = [
            ("rows = 4", "rows = 6", "columns, rows of target \"shoulder\"", "5 x 6"),
            ("columns = 5", "columns = 2", "columns, rows of target \"shoulder\"", "2 x 4"),
            ("columns = 5", "columns = 300", "columns", "300"),
            ("columns = 5", "columns = -5", "columns", "-5"),
            ("columns = 5", "columns = 5.5", "columns", "5.5"),
            ("name = \"shoulder\"", "name = \"lumbar\"", "name", "lumbar"),
            ("role = \"upper\"", "role = \"lower\"", "role of target \"shoulder\"", "lumbar"),
            ("role = \"upper\"", "role = \"head\"", "role", "head"),
            ("pitch_mm = 12.0", "pitch_mm = 0.0", "pitch_mm of target \"lumbar\"", "0"),
            ("pitch_mm = 12.0", "pitch_cm = 1.2", "pitch_cm", "unknown field"),
            ("pitch_mm = 12.0\n", "", "pitch_mm of target \"lumbar\"", "missing"),
            ("[[target]]", "[target", "", ""),
            ("name = \"shoulder\"", "name = \"a name that is too long\"", "name", "too long"),
        ];
        for (good, bad, field, found) in cases {
            let broken = text.replacen(good, bad, 1);
            assert_ne!(broken, text, "{good}");
            let error = parse(&broken, "t.toml").unwrap_err();
            assert!(error.field.starts_with(field), "{bad}: {error}");
            assert!(error.found.contains(found), "{bad}: {error}");
        }
    }

    #[test]
    fn a_symmetric_grid_is_accepted_with_a_warning() {
        let mut board = standard_pair().remove(0);
        (board.columns, board.rows) = (9, 7);
        let targets = check(&[board], "t.toml").unwrap();
        assert_eq!(targets.warnings.len(), 1);
        assert!(targets.warnings[0].contains("9 x 7"));
    }
}
