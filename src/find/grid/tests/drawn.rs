//! Boards drawn without blur, whose squares begin and end with a pixel: what is seen of them can be
//! computed by hand.

extern crate std;

use core::ops::Range;
use std::boxed::Box;
use std::vec::Vec;

use super::super::lattice::{Bounds, Lattice, Least};
use super::super::view::View;
use crate::find::corner::Corner;
use crate::model::image::GreyImage;

const SIZE: [usize; 2] = [400, 320];

/// A lattice step along u, and along v. Odd, so that the middle of a square is that of a pixel.
pub(crate) const STEP_PX: [f64; 2] = [21.0, 17.0];

/// The pixel at which the square from the place (0, 0) begins.
const ORIGIN_PX: [f64; 2] = [120.0, 112.0];

/// The brightness of ink, of paper, and of what is around the board.
pub(crate) const DARK: u8 = 60;
pub(crate) const LIGHT: u8 = 180;
const AROUND: u8 = 110;

/// A picture and its corners.
pub(crate) struct Drawn {
    pub(crate) bytes: Vec<u8>,
    pub(crate) corners: Vec<Corner>,
}

/// The pixel of a place.
pub(crate) fn px([u, v]: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|axis| ORIGIN_PX[axis] + STEP_PX[axis] * [u, v][axis] - 0.5)
}

/// The corners of a board, row by row, at the positions that a function gives for each place. The
/// square from (0, 0) along u and v is dark.
pub(crate) fn corners_at(
    [columns, rows]: [i32; 2],
    position_px: impl Fn([f64; 2]) -> [f64; 2],
) -> Vec<Corner> {
    let cells = (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row]));
    let corner = |cell: [i32; 2]| {
        let [u, v] = cell.map(f64::from);
        let along = |[du, dv]: [f64; 2]| {
            let (from, to) = (position_px([u - du, v - dv]), position_px([u + du, v + dv]));
            let angle_rad = (to[1] - from[1]).atan2(to[0] - from[0]);
            angle_rad.rem_euclid(core::f64::consts::PI) as f32
        };
        let (u_rad, v_rad) = (along([0.01, 0.0]), along([0.0, 0.01]));
        let is_even = (cell[0] + cell[1]) % 2 == 0;
        Corner {
            position_px: position_px([u, v]).map(|value| value as f32),
            score: 0.2,
            edges_rad: if is_even { [u_rad, v_rad] } else { [v_rad, u_rad] },
        }
    };
    cells.map(corner).collect()
}

/// The lattice that grows from the first corner.
pub(crate) fn grown(corners: &[Corner], least: Least) -> (Box<Lattice>, Bounds) {
    let mut lattice = Box::new(Lattice::new());
    lattice.start(corners);
    let bounds = lattice.grow(corners, 0, least).expect("a lattice");
    (lattice, bounds)
}

impl Drawn {
    /// A board with its corners from the place (0, 0) on, the squares around them, and a margin as wide as
    /// a square.
    pub(crate) fn new([columns, rows]: [i32; 2]) -> Self {
        let mut drawn = Self {
            bytes: std::vec![AROUND; SIZE[0] * SIZE[1]],
            corners: corners_at([columns, rows], px),
        };
        let [last_u, last_v] = [columns, rows].map(f64::from);
        drawn.paint(-2.0..last_u + 1.0, -2.0..last_v + 1.0, LIGHT);
        drawn.print(-1..columns, -1..rows);
        drawn
    }

    /// Prints the dark squares among these.
    pub(crate) fn print(&mut self, columns: Range<i32>, rows: Range<i32>) {
        for row in rows {
            for column in columns.clone().filter(|column| (column + row) % 2 == 0) {
                let [u, v] = [column, row].map(f64::from);
                self.paint(u..u + 1.0, v..v + 1.0, DARK);
            }
        }
    }

    /// Paints a rectangle, whose sides are places along u and along v.
    pub(crate) fn paint(&mut self, u: Range<f64>, v: Range<f64>, level: u8) {
        let [columns, rows] = [(u, 0), (v, 1)].map(|(places, axis)| {
            let pixel = |place: f64| (ORIGIN_PX[axis] + STEP_PX[axis] * place).round() as usize;
            pixel(places.start)..pixel(places.end)
        });
        for row in rows {
            self.bytes[row * SIZE[0]..][columns.clone()].fill(level);
        }
    }

    /// Takes the corners at these places away. The first one remains.
    pub(crate) fn hide(&mut self, cells: &[[i32; 2]]) {
        self.corners.retain(|corner| {
            let is_at = |cell: &[i32; 2]| {
                let [x, y] = px(cell.map(f64::from));
                let [dx, dy] = [corner.position_px[0] - x as f32, corner.position_px[1] - y as f32];
                dx.abs() < 1.0 && dy.abs() < 1.0
            };
            !cells.iter().any(is_at)
        });
    }

    pub(crate) fn image(&self) -> GreyImage<'_, u8> {
        GreyImage::new(&self.bytes, SIZE[0], SIZE[1], SIZE[0]).unwrap()
    }

    /// What a function says of the lattice of at least 3 x 3 corners that is seen.
    pub(crate) fn seen<T>(&self, say: impl FnOnce(&View<'_, u8>, Bounds) -> T) -> T {
        let (lattice, bounds) = grown(&self.corners, Least::Target);
        let image = self.image();
        let view = View::new(&image, &lattice, &self.corners, bounds).expect("a plane");
        say(&view, bounds)
    }
}
