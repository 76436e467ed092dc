//! The geometry of one printed target: the paper's matrix G (n x 3).
//!
//! A target is a checker grid of `columns x rows` INNER corners at a constant
//! pitch, or the same grid with measured corner positions (a print that shrank,
//! a plate that is bent). Corners are numbered row by row from the one at the
//! top left; see the crate's front page for the axes.

use heapless::Vec;
use nalgebra::Vector3;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::limits::TARGET_CORNERS_MAX;

/// What a target is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Role {
    /// On the shoulder: its origin is the upper trunk point.
    Upper,
    /// On the lower back: its virtual point, deep in the body, is the lower trunk point.
    Lower,
    /// A board that stands in the scene and defines the anatomical axes.
    Scene,
}

/// Inner corners along x and along y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridShape {
    /// Along x.
    pub columns: u8,
    /// Along y.
    pub rows: u8,
}

/// Which point of the grid is the target's origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Origin {
    /// The middle of the grid.
    Center,
    /// The inner corner at the top left, number 0.
    FirstCorner,
}

/// Why a target cannot be tracked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TargetError {
    /// Fewer than 3 columns or rows, or more corners than [`TARGET_CORNERS_MAX`].
    GridSize,
    /// The pitch is not between 0.5 mm and 500 mm.
    Pitch,
    /// The number of measured points is not columns x rows.
    PointCount,
    /// A point is not finite, or 10 m or more from the origin.
    PointValue,
}

impl core::fmt::Display for TargetError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::GridSize => write!(
                formatter,
                "a grid needs at least 3 columns and 3 rows of inner corners, \
                 and at most {TARGET_CORNERS_MAX} corners"
            ),
            Self::Pitch => formatter.write_str("the pitch must lie between 0.5 mm and 500 mm"),
            Self::PointCount => {
                formatter.write_str("the number of measured points must be columns x rows")
            }
            Self::PointValue => {
                formatter.write_str("a point must be finite and within 10 m of the origin")
            }
        }
    }
}

impl core::error::Error for TargetError {}

/// One target: grid, geometry in the target frame, role and virtual point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct TargetGeometry {
    columns: u8,
    rows: u8,
    role: Role,
    virtual_point_mm: [f64; 3],
    points_mm: Vec<[f64; 3], TARGET_CORNERS_MAX>,
}

/// A geometry as it comes from outside: the fields of [`TargetGeometry`], in their order, before it
/// has been checked that they agree.
#[derive(Deserialize)]
struct Unchecked {
    columns: u8,
    rows: u8,
    role: Role,
    virtual_point_mm: [f64; 3],
    points_mm: Vec<[f64; 3], TARGET_CORNERS_MAX>,
}

impl TryFrom<Unchecked> for TargetGeometry {
    type Error = TargetError;

    fn try_from(from: Unchecked) -> Result<Self, TargetError> {
        Self::from_points(from.columns, from.rows, from.points_mm, from.role, from.virtual_point_mm)
    }
}

impl TargetGeometry {
    /// A flat checker grid of constant pitch.
    ///
    /// `virtual_point_mm` is the body's point in the target frame; the paper's
    /// lower trunk point is `[0, 0, 100]`.
    ///
    /// # Errors
    /// [`TargetError`] when the grid, the pitch or the virtual point is out of range.
    pub fn checker(
        columns: u8,
        rows: u8,
        pitch_mm: f64,
        origin: Origin,
        role: Role,
        virtual_point_mm: [f64; 3],
    ) -> Result<Self, TargetError> {
        if !(0.5..=500.0).contains(&pitch_mm) {
            return Err(TargetError::Pitch);
        }
        let (x0, y0) = match origin {
            Origin::Center => {
                (f64::from(columns.max(1) - 1) / 2.0, f64::from(rows.max(1) - 1) / 2.0)
            }
            Origin::FirstCorner => (0.0, 0.0),
        };
        let points_mm = (0..rows).flat_map(|row| {
            (0..columns).map(move |column| {
                [(f64::from(column) - x0) * pitch_mm, (f64::from(row) - y0) * pitch_mm, 0.0]
            })
        });
        Self::from_points(columns, rows, points_mm, role, virtual_point_mm)
    }

    /// A grid whose corner positions were measured, row by row.
    ///
    /// # Errors
    /// [`TargetError`] when the number of points or a value is out of range.
    pub fn from_points(
        columns: u8,
        rows: u8,
        points_mm: impl IntoIterator<Item = [f64; 3]>,
        role: Role,
        virtual_point_mm: [f64; 3],
    ) -> Result<Self, TargetError> {
        let count = usize::from(columns) * usize::from(rows);
        if columns < 3 || rows < 3 || count > TARGET_CORNERS_MAX {
            return Err(TargetError::GridSize);
        }
        let mut points = Vec::new();
        for point_mm in points_mm {
            points.push(point_mm).map_err(|_| TargetError::PointCount)?;
        }
        if points.len() != count {
            return Err(TargetError::PointCount);
        }
        let near = |point: &[f64; 3]| point.iter().all(|value| value.abs() < 10_000.0);
        if !points.iter().all(near) || !near(&virtual_point_mm) {
            return Err(TargetError::PointValue);
        }
        Ok(Self { columns, rows, role, virtual_point_mm, points_mm: points })
    }

    /// Inner corners along x.
    #[must_use]
    pub fn columns(&self) -> usize {
        usize::from(self.columns)
    }

    /// Inner corners along y.
    #[must_use]
    pub fn rows(&self) -> usize {
        usize::from(self.rows)
    }

    /// Distance between the first two corners: the size of a square.
    #[must_use]
    pub fn pitch_mm(&self) -> f64 {
        (self.corner_mm(1) - self.corner_mm(0)).norm()
    }

    /// What the search looks for.
    #[must_use]
    pub fn shape(&self) -> GridShape {
        GridShape { columns: self.columns, rows: self.rows }
    }

    /// What the target is for.
    #[must_use]
    pub fn role(&self) -> Role {
        self.role
    }

    /// Number of corners, columns x rows.
    #[must_use]
    pub fn corner_count(&self) -> usize {
        self.points_mm.len()
    }

    /// Corner `index`, in the target frame.
    ///
    /// # Panics
    /// When there is no such corner: a caller's bug.
    #[must_use]
    pub fn corner_mm(&self, index: usize) -> Vector3<f64> {
        Vector3::from(self.points_mm[index])
    }

    /// The middle of the grid, in the target frame: its row tells when the target was seen.
    #[must_use]
    pub fn middle_mm(&self) -> Vector3<f64> {
        (self.corner_mm(0) + self.corner_mm(self.corner_count() - 1)) * 0.5
    }

    /// The body's point in the target frame.
    #[must_use]
    pub fn virtual_point_mm(&self) -> Vector3<f64> {
        Vector3::from(self.virtual_point_mm)
    }

    /// True when the grid looks the same after half a turn, so that its colours
    /// cannot tell which end is up: columns + rows even.
    #[must_use]
    pub fn is_symmetric(&self) -> bool {
        (self.columns + self.rows).is_multiple_of(2)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString as _;

    use super::*;

    fn checker(columns: u8, rows: u8, pitch_mm: f64) -> Result<TargetGeometry, TargetError> {
        TargetGeometry::checker(columns, rows, pitch_mm, Origin::Center, Role::Upper, [0.0; 3])
    }

    #[test]
    fn a_checker_is_numbered_row_by_row_about_its_centre() {
        let lumbar = checker(6, 5, 12.0).unwrap();
        assert_eq!(lumbar.corner_count(), 30);
        assert_eq!(lumbar.corner_mm(0), Vector3::new(-30.0, -24.0, 0.0));
        assert_eq!(lumbar.corner_mm(7), Vector3::new(-18.0, -12.0, 0.0));
        assert_eq!(lumbar.corner_mm(29), Vector3::new(30.0, 24.0, 0.0));
    }

    #[test]
    fn a_checker_can_be_numbered_from_its_origin() {
        let origin = Origin::FirstCorner;
        let made = TargetGeometry::checker(6, 5, 12.0, origin, Role::Upper, [1.0, 2.0, 3.0]);
        let lumbar = made.unwrap();
        assert_eq!(lumbar.corner_mm(0), Vector3::zeros());
        assert_eq!(lumbar.corner_mm(7), Vector3::new(12.0, 12.0, 0.0));
        assert_eq!(lumbar.corner_mm(29), Vector3::new(60.0, 48.0, 0.0));
        assert_eq!(lumbar.middle_mm(), Vector3::new(30.0, 24.0, 0.0));
        assert_eq!(lumbar.pitch_mm(), 12.0);
        assert_eq!(lumbar.virtual_point_mm(), Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(lumbar.shape(), GridShape { columns: 6, rows: 5 });
    }

    #[test]
    fn only_odd_sums_have_one_orientation() {
        for (columns, rows) in [(6, 5), (5, 6)] {
            assert!(!checker(columns, rows, 12.0).unwrap().is_symmetric());
        }
        for (columns, rows) in [(7, 5), (5, 7), (6, 6)] {
            assert!(checker(columns, rows, 20.0).unwrap().is_symmetric());
        }
    }

    #[test]
    fn grids_that_cannot_be_tracked_are_refused() {
        assert_eq!(checker(2, 5, 12.0), Err(TargetError::GridSize));
        assert_eq!(checker(0, 0, 12.0), Err(TargetError::GridSize));
        assert_eq!(checker(255, 255, 12.0), Err(TargetError::GridSize));
        assert_eq!(checker(6, 5, f64::NAN), Err(TargetError::Pitch));
        let none = TargetGeometry::from_points(3, 3, [], Role::Upper, [0.0; 3]);
        assert_eq!(none, Err(TargetError::PointCount));
        let nan = TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Upper, [f64::NAN; 3]);
        assert_eq!(nan, Err(TargetError::PointValue));
    }

    #[test]
    fn the_smallest_and_the_largest_grid_are_tracked() {
        let longest = (TARGET_CORNERS_MAX / 3) as u8;
        for (columns, rows) in [(3, 3), (longest, 3), (3, longest)] {
            let target = checker(columns, rows, 12.0).unwrap();
            assert_eq!(target.corner_count(), target.columns() * target.rows());
            assert_eq!(checker(columns, 2, 12.0), Err(TargetError::GridSize));
            assert_eq!(checker(2, rows, 12.0), Err(TargetError::GridSize));
        }
        for (columns, rows) in [(longest + 1, 3), (3, longest + 1)] {
            assert_eq!(checker(columns, rows, 12.0), Err(TargetError::GridSize));
        }
    }

    #[test]
    fn the_pitch_and_the_points_have_bounds() {
        for (allowed_mm, refused_mm) in [(0.5, 0.5_f64.next_down()), (500.0, 500_f64.next_up())] {
            assert_eq!(checker(3, 3, allowed_mm).unwrap().pitch_mm(), allowed_mm);
            assert_eq!(checker(3, 3, refused_mm), Err(TargetError::Pitch));
        }
        let refused = Err(TargetError::PointValue);
        for far_mm in [10_000.0, -10_000.0, f64::NAN] {
            let [near, far] =
                [10_000_f64.next_down().copysign(far_mm), far_mm].map(|z_mm| [0.0, 0.0, z_mm]);
            let made = |point_mm: [f64; 3], virtual_point_mm: [f64; 3]| {
                let points_mm = core::iter::repeat_n(point_mm, 9);
                TargetGeometry::from_points(3, 3, points_mm, Role::Lower, virtual_point_mm)
                    .map(|target| (target.corner_mm(8), target.virtual_point_mm()))
            };
            assert_eq!(made(near, near), Ok((near.into(), near.into())));
            assert_eq!(made(far, near), refused);
            assert_eq!(made(near, far), refused);
        }
    }

    #[test]
    fn each_fault_is_told_in_words() {
        let corners = std::format!("at most {TARGET_CORNERS_MAX} corners");
        for (error, words) in [
            (TargetError::GridSize, "at least 3 columns and 3 rows"),
            (TargetError::GridSize, &corners),
            (TargetError::Pitch, "pitch must lie between 0.5 mm and 500 mm"),
            (TargetError::PointCount, "measured points must be columns x rows"),
            (TargetError::PointValue, "finite and within 10 m of the origin"),
        ] {
            assert!(error.to_string().contains(words), "{error}");
        }
    }
}
