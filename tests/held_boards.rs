//! Boards as people hold them before a phone or a webcam: large squares, defocus, and a frame that
//! cuts the squares around the corners.

use nalgebra::Vector2;
use plumbline::image::GreyImage;
use plumbline::lens::{Distortion, Lens};
use plumbline::pose::Pose;
use plumbline::target::{GridShape, Origin, Role, TargetGeometry};
use plumbline_calibration::{Found, Search};
use plumbline_render::simulate::render::{Board, Ink, Picture, PlacedBoard, render_targets};
use plumbline_render::simulate::sensor::Sensor;

const SIZE: [u16; 2] = [1080, 1440];
const FOCAL_PX: f64 = 1400.0;
const PITCH_MM: f64 = 30.0;

fn lens() -> Lens {
    let [width_px, height_px] = SIZE;
    let [cx_px, cy_px] = SIZE.map(|side| f64::from(side - 1) / 2.0);
    Lens {
        width_px,
        height_px,
        fx_px: FOCAL_PX,
        fy_px: FOCAL_PX,
        cx_px,
        cy_px,
        skew_px: 0.0,
        distortion: Distortion::Radial2([-0.05, 0.0]),
    }
}

/// A board, how large its squares are, and where its middle is from that of the frame.
struct Held {
    columns: u8,
    rows: u8,
    square_px: f64,
    middle_px: [f64; 2],
    blur_px: f64,
}

impl Held {
    fn geometry(&self) -> TargetGeometry {
        let [columns, rows] = [self.columns, self.rows];
        TargetGeometry::checker(columns, rows, PITCH_MM, Origin::Center, Role::Scene, [0.0; 3])
            .expect("a board")
    }

    /// The photograph, and where its corners are.
    fn photograph(&self) -> (Vec<u8>, Vec<Vector2<f64>>) {
        let geometry = self.geometry();
        let print = Board::new(&geometry, 20.0, Ink { black: 30.0, white: 210.0 });
        let z_mm = FOCAL_PX * PITCH_MM / self.square_px;
        let [x_mm, y_mm] = self.middle_px.map(|px| px / FOCAL_PX * z_mm);
        let cam_from_target = Pose::from_theta([0.06, 0.15, -0.1, x_mm, y_mm, z_mm]);
        let [width, height] = SIZE.map(usize::from);
        let mut picture = Picture::uniform(width, height, 110.0);
        let placed = PlacedBoard { board: &print, cam_from_target };
        // Half as light on one side of the frame as on the other.
        let light = |x: f64, _: f64| 0.6 + 0.5 * x / f64::from(SIZE[0]);
        render_targets(&lens(), self.blur_px, &[placed], &light, &mut picture);
        let mut samples = vec![0_u8; width * height];
        Sensor { noise_levels: 3.0, bits: 8 }.expose(&picture, 1, 0, &mut samples);
        let corners_px = (0..geometry.corner_count())
            .map(|corner| cam_from_target.transform(&geometry.corner_mm(corner)))
            .map(|point| lens().project(&point).expect("in front of the camera"))
            .collect();
        (samples, corners_px)
    }
}

fn find(samples: &[u8], columns: u8, rows: u8) -> Result<Found, String> {
    let [width, height] = SIZE.map(usize::from);
    let image = GreyImage::new(samples, width, height, width).expect("a photograph");
    let wanted = GridShape { columns, rows };
    Search::new().find(&image, &[wanted]).remove(0).map_err(|why| why.to_string())
}

/// Finds the board, each corner within a fiftieth of a square or a pixel of the true one, and no
/// board of other columns or rows.
#[track_caller]
fn assert_found(held: &Held) {
    let (samples, corners_px) = held.photograph();
    let &Held { columns, rows, square_px, .. } = held;
    let found = find(&samples, columns, rows).unwrap_or_else(|why| panic!("{square_px} px: {why}"));
    // A symmetric board may be numbered from either end: its x axis points to the right here.
    for (corner, true_px) in corners_px.iter().enumerate() {
        let index = found.grid.corners[corner].expect("each corner is seen");
        let [x, y] = found.corners[usize::from(index)].position_px.map(f64::from);
        let off_px = (Vector2::new(x, y) - true_px).norm();
        assert!(off_px < (square_px / 50.0).max(1.0), "{square_px} px: {off_px} px off");
    }
    for (columns, rows) in
        [(columns - 1, rows), (columns, rows - 1), (columns + 1, rows), (columns, rows + 1)]
    {
        assert!(find(&samples, columns, rows).is_err(), "{columns} x {rows} of {square_px} px");
    }
}

#[test]
fn squares_of_all_sizes_are_found_sharp_and_blurred() {
    // Odd sums, so that corner 0 is certain.
    let boards: [(f64, u8, u8); 6] =
        [(10.0, 9, 6), (24.0, 9, 6), (60.0, 7, 4), (100.0, 7, 4), (170.0, 4, 5), (240.0, 3, 4)];
    for (square_px, columns, rows) in boards {
        for blur_px in [0.6, (square_px / 8.0_f64).min(3.0)] {
            let middle_px = [3.0, -5.0];
            assert_found(&Held { columns, rows, square_px, middle_px, blur_px });
        }
    }
}

#[test]
fn a_frame_may_cut_the_squares_around_the_corners() {
    // Corners at 25 px or more from the frame's border, and squares of 80 px.
    for middle_px in [[-280.0, 0.0], [280.0, 0.0], [0.0, -535.0], [0.0, 535.0], [280.0, 535.0]] {
        assert_found(&Held { columns: 7, rows: 4, square_px: 78.0, middle_px, blur_px: 1.0 });
    }
}

#[test]
fn a_board_with_hidden_corners_is_no_smaller_board_if_the_frame_shows_so() {
    // A column of corners is outside, and squares beyond those asked for are inside.
    let held =
        Held { columns: 7, rows: 4, square_px: 78.0, middle_px: [-340.0, 0.0], blur_px: 1.0 };
    let (samples, _) = held.photograph();
    for (columns, rows) in [(7, 4), (5, 4), (4, 3), (5, 3), (6, 3)] {
        assert!(find(&samples, columns, rows).is_err(), "{columns} x {rows}");
    }
}
