//! Which parts of the volume in front of the camera were visited, and where to go next.
//!
//! The volume reaches over the whole picture, and from the nearest to the farthest depth. It is
//! divided into three layers of depth, and each of them into three by three parts of the picture:
//! 27 zones. A zone is visited when one end of the measured length was in it. A length is also
//! wanted in three directions: across the picture, up and down in it, and into the depth, since
//! lens, scale and depth err differently.

use nalgebra::Vector3;
use plumbline::lens::Lens;
use serde::Serialize;

/// Parts along each axis.
pub const PARTS: usize = 3;

/// A volume is at least this deep, farthest over nearest: a board that stayed at one depth shows
/// nothing about depth.
const DEPTH_RATIO_MIN: f64 = 1.25;

/// Lengths wanted in each direction.
pub const PER_DIRECTION: usize = 3;

/// Sine of the angle to the picture's plane from which a length counts as going into the depth: 20
/// degrees.
const DEPTH_SINE: f64 = 0.342;

/// The volume that is to be visited.
#[derive(Debug, Clone, Copy)]
pub struct Volume {
    /// The camera.
    pub lens: Lens,
    /// The depths between which it lies.
    pub depth_mm: [f64; 2],
}

/// The direction of a length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Left to right.
    Across,
    /// Up and down.
    Upright,
    /// Tilted by 20 degrees or more towards or away from the camera.
    IntoDepth,
}

impl Direction {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Across, Self::Upright, Self::IntoDepth];

    /// The direction between two points of the camera's frame.
    #[must_use]
    pub fn of(ends_mm: &[Vector3<f64>; 2]) -> Self {
        let along = (ends_mm[1] - ends_mm[0]).normalize();
        if along.z.abs() >= DEPTH_SINE {
            Self::IntoDepth
        } else if along.x.abs() >= along.y.abs() {
            Self::Across
        } else {
            Self::Upright
        }
    }
}

/// One of the 27 parts of the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Zone {
    /// 0 is nearest.
    pub layer: usize,
    /// 0 is at the top of the picture.
    pub row: usize,
    /// 0 is at the left of the picture.
    pub column: usize,
}

/// What was visited.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// The depths between which the volume lies.
    pub depth_mm: [f64; 2],
    /// How often each zone was visited, by layer, row and column.
    pub visits: [[[usize; PARTS]; PARTS]; PARTS],
    /// Lengths by direction, in the order of [`Direction::ALL`].
    pub directions: [usize; 3],
}

/// Where to go next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// To a zone, in which the depth is this.
    Visit(Zone, f64),
    /// To a length in this direction.
    Turn(Direction),
}

impl Volume {
    /// The volume between the depths at which ends were seen, or a deeper one about their middle.
    ///
    /// # Panics
    /// When there are no ends: a caller's bug.
    #[must_use]
    pub fn around(lens: Lens, ends_mm: &[[Vector3<f64>; 2]]) -> Self {
        assert!(!ends_mm.is_empty(), "a volume needs points");
        let depths = || ends_mm.iter().flatten().map(|it| it.z);
        let (near, far) = (depths().fold(f64::INFINITY, f64::min), depths().fold(0.0, f64::max));
        let middle = (near * far).sqrt();
        let half = DEPTH_RATIO_MIN.sqrt();
        Self { lens, depth_mm: [near.min(middle / half), far.max(middle * half)] }
    }

    /// The zone of a point; `None` outside of the picture. Nearer or farther points count for the
    /// nearest or the farthest layer.
    #[must_use]
    pub fn zone(&self, point_mm: &Vector3<f64>) -> Option<Zone> {
        let pixel = self.lens.project(point_mm)?;
        let part = |px: f64, side: u16| {
            let share = (px + 0.5) / f64::from(side);
            (0.0..1.0).contains(&share).then_some((share * PARTS as f64) as usize)
        };
        let [near, far] = self.depth_mm;
        let share = ((point_mm.z - near) / (far - near)).clamp(0.0, 1.0);
        Some(Zone {
            layer: ((share * PARTS as f64) as usize).min(PARTS - 1),
            row: part(pixel.y, self.lens.height_px)?,
            column: part(pixel.x, self.lens.width_px)?,
        })
    }

    /// What these lengths, each given by its ends, have visited.
    #[must_use]
    pub fn coverage(&self, ends_mm: &[[Vector3<f64>; 2]]) -> Coverage {
        let mut coverage = Coverage {
            depth_mm: self.depth_mm,
            visits: [[[0; PARTS]; PARTS]; PARTS],
            directions: [0; 3],
        };
        for ends_mm in ends_mm {
            for zone in ends_mm.iter().filter_map(|end_mm| self.zone(end_mm)) {
                coverage.visits[zone.layer][zone.row][zone.column] += 1;
            }
            coverage.directions[Direction::of(ends_mm) as usize] += 1;
        }
        coverage
    }
}

impl Coverage {
    /// The number of zones that were visited.
    #[must_use]
    pub fn visited(&self) -> usize {
        self.visits.iter().flatten().flatten().filter(|visits| **visits > 0).count()
    }

    /// The number of zones.
    pub const ZONES: usize = PARTS * PARTS * PARTS;

    /// Where to go next; `None` when everything was visited. Directions come first: most zones are
    /// visited on the way.
    #[must_use]
    pub fn next(&self) -> Option<Next> {
        let [near, far] = self.depth_mm;
        let direction =
            Direction::ALL.into_iter().find(|it| self.directions[*it as usize] < PER_DIRECTION);
        let zones = (0..Self::ZONES).map(|at| Zone {
            layer: at / (PARTS * PARTS),
            row: at / PARTS % PARTS,
            column: at % PARTS,
        });
        let missed = || zones.clone().find(|it| self.visits[it.layer][it.row][it.column] == 0);
        let depth_mm = |zone: Zone| near + (far - near) * (zone.layer as f64 + 0.5) / PARTS as f64;
        direction.map(Next::Turn).or_else(|| missed().map(|it| Next::Visit(it, depth_mm(it))))
    }
}

impl Next {
    /// What to do, in one sentence.
    #[must_use]
    pub fn words(&self) -> String {
        match *self {
            Self::Turn(Direction::Across) => {
                "turn the plate so that one board is left of the other".to_owned()
            }
            Self::Turn(Direction::Upright) => {
                "turn the plate so that one board is above the other".to_owned()
            }
            Self::Turn(Direction::IntoDepth) => {
                "tilt the plate by 20 to 40 degrees so that one board is nearer to the camera than \
                 the other"
                    .to_owned()
            }
            Self::Visit(zone, depth_mm) => {
                format!("bring a board to the {}, {depth_mm:.0} mm from the camera", zone.words())
            }
        }
    }
}

impl Zone {
    /// Where it is in the picture.
    #[must_use]
    pub fn words(&self) -> String {
        let row = ["upper", "middle", "lower"][self.row];
        let column = ["left", "middle", "right"][self.column];
        match (self.row, self.column) {
            (1, 1) => "middle of the picture".to_owned(),
            (1, _) => format!("{column} side of the picture"),
            (_, 1) => format!("{row} edge of the picture"),
            _ => format!("{row} {column} corner of the picture"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lens;

    fn length(x_mm: f64, y_mm: f64, z_mm: f64, along: Vector3<f64>) -> [Vector3<f64>; 2] {
        let middle = Vector3::new(x_mm, y_mm, z_mm);
        [middle - 30.0 * along, middle + 30.0 * along]
    }

    #[test]
    fn zones_and_directions_are_those_of_the_picture() {
        let volume = Volume { lens: lens(), depth_mm: [600.0, 1200.0] };
        let zone = |x, y, z| volume.zone(&Vector3::new(x, y, z));
        // The picture is 640 x 480 and f 800: at 700 mm its left third ends at x = -93.3 mm.
        let expected = |layer, row, column| Some(Zone { layer, row, column });
        assert_eq!(zone(-94.0, -71.0, 700.0), expected(0, 0, 0));
        assert_eq!(zone(-92.0, -69.0, 700.0), expected(0, 1, 1));
        assert_eq!(zone(300.0, 0.0, 1100.0), expected(2, 1, 2));
        assert_eq!(zone(0.0, 0.0, 100.0), expected(0, 1, 1));
        assert_eq!(zone(0.0, 0.0, 2000.0), expected(2, 1, 1));
        assert_eq!(zone(400.0, 0.0, 700.0), None);
        let [x, y, z] = [Vector3::x(), Vector3::y(), (Vector3::x() + Vector3::z()).normalize()];
        for (along, direction) in
            [(x, Direction::Across), (y, Direction::Upright), (z, Direction::IntoDepth)]
        {
            assert_eq!(Direction::of(&length(0.0, 0.0, 800.0, along)), direction);
        }
    }

    /// Whoever does what is said is done after as many lengths as there are zones and directions.
    #[test]
    fn the_instructions_lead_through_the_whole_volume() {
        let volume = Volume { lens: lens(), depth_mm: [600.0, 1200.0] };
        let mut ends_mm = Vec::new();
        let mut said = Vec::new();
        while let Some(next) = volume.coverage(&ends_mm).next() {
            said.push(next.words());
            assert!(said.len() <= Coverage::ZONES + 9, "{said:?}");
            ends_mm.push(match next {
                Next::Turn(Direction::Across) => length(0.0, 0.0, 900.0, Vector3::x()),
                Next::Turn(Direction::Upright) => length(0.0, 0.0, 900.0, Vector3::y()),
                Next::Turn(Direction::IntoDepth) => {
                    length(0.0, 0.0, 900.0, Vector3::new(0.8, 0.0, 0.6))
                }
                Next::Visit(zone, depth_mm) => {
                    let [x, y] = [(zone.column, 640.0), (zone.row, 480.0)]
                        .map(|(at, side)| (at as f64 - 1.0) / 3.0 * side / 800.0 * depth_mm);
                    length(x, y, depth_mm, Vector3::x())
                }
            });
        }
        assert_eq!(volume.coverage(&ends_mm).visited(), Coverage::ZONES);
        assert!(
            said.contains(
                &"bring a board to the upper left corner of the picture, 700 mm from the camera"
                    .to_owned()
            ),
            "{said:?}"
        );
        assert!(said.contains(
            &"bring a board to the right side of the picture, 1100 mm from the camera".to_owned()
        ));
    }

    #[test]
    fn a_volume_is_as_deep_as_what_was_seen_and_no_flatter_than_a_quarter() {
        let at = |z| length(0.0, 0.0, z, Vector3::x());
        assert_eq!(Volume::around(lens(), &[at(500.0), at(1000.0)]).depth_mm, [500.0, 1000.0]);
        let [near, far] = Volume::around(lens(), &[at(900.0)]).depth_mm;
        assert!((far / near - 1.25).abs() < 1e-12 && (near * far - 810_000.0).abs() < 1e-6);
        // Whoever stays at one depth is sent nearer.
        let coverage = Volume::around(lens(), &[at(900.0)]).coverage(&[at(900.0)]);
        assert_eq!(coverage.visits[0], [[0; 3]; 3]);
    }
}
