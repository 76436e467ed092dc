//! A calibration board as a careful person shows it to the camera: held at every place of the frame
//! and tilted about both axes, and standing upright where the person who is measured will stand.
//!
//! Camera, room, light and noise are those of a [`Simulation`](super::Simulation) with the same
//! settings, and the board stands where that one's scene is. So what is calibrated with these
//! pictures fits that one's frames.

use nalgebra::{Vector2, Vector3};
use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Scene, Target};
use plumbline::target::TargetGeometry;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::background::empty_room;
use super::layout;
use super::render::{Board, Ink, Picture, PlacedBoard, render_targets};
use super::sensor::Sensor;
use super::{SettingsError, SimulationSettings};

/// How a board is held.
struct Hold {
    /// Where it is in the frame, along x and y: -1 and 1 are as near to the border as it goes.
    place: [f64; 2],
    /// Turns about its y axis and about its x axis.
    tilt_deg: [f64; 2],
    roll_deg: f64,
    /// The part of the frame's width or height that it fills.
    fill: f64,
}

/// One after the other, and then from the beginning. The tilts are those that calibration asks for:
/// 20 to 40 degrees about both axes. In the corners it is tilted less: a board that is tilted away
/// from the camera does not reach into them.
const HOLDS: [Hold; 15] = [
    hold([0.0, 0.0], [0.0, 0.0], 0.0, 0.75),
    hold([0.0, 0.0], [30.0, 0.0], 0.0, 0.65),
    hold([0.0, 0.0], [-30.0, 0.0], 0.0, 0.65),
    hold([0.0, 0.0], [0.0, 30.0], 0.0, 0.65),
    hold([0.0, 0.0], [0.0, -30.0], 0.0, 0.65),
    hold([-1.0, -1.0], [10.0, 10.0], 0.0, 0.55),
    hold([1.0, -1.0], [-10.0, 10.0], 0.0, 0.55),
    hold([1.0, 1.0], [-10.0, -10.0], 0.0, 0.55),
    hold([-1.0, 1.0], [10.0, -10.0], 0.0, 0.55),
    hold([-1.0, 0.0], [25.0, 20.0], 5.0, 0.6),
    hold([1.0, 0.0], [-25.0, 20.0], -5.0, 0.6),
    hold([0.0, -1.0], [20.0, 25.0], -5.0, 0.6),
    hold([0.0, 1.0], [20.0, -25.0], 5.0, 0.6),
    hold([0.0, 0.0], [25.0, 25.0], 20.0, 0.6),
    hold([0.0, 0.0], [-25.0, 25.0], -20.0, 0.6),
];

const fn hold(place: [f64; 2], tilt_deg: [f64; 2], roll_deg: f64, fill: f64) -> Hold {
    Hold { place, tilt_deg, roll_deg, fill }
}

/// Nobody holds a board exactly: turns differ by up to this, and places and sizes by this part.
const UNSTEADY_DEG: f64 = 3.0;
const UNSTEADY: f64 = 0.05;

/// From the squares to the frame's border, as a part of the frame's height.
const BORDER: f64 = 0.02;

/// More photographs than anybody takes.
const PHOTOGRAPHS_MAX: usize = 500;

/// A board, a camera and a room, determined by the settings.
pub struct BoardPhotographs {
    settings: SimulationSettings,
    camera: Lens,
    board: Board,
    room: Picture,
    cam_from_scene: Pose<Cam, Scene>,
    held: Vec<Pose<Cam, Target>>,
}

impl BoardPhotographs {
    /// Prepares this many photographs.
    ///
    /// # Errors
    /// [`SettingsError`] names the first setting that cannot be simulated.
    pub fn new(
        settings: &SimulationSettings,
        geometry: &TargetGeometry,
        count: usize,
    ) -> Result<Self, SettingsError> {
        settings.check()?;
        if !(1..=PHOTOGRAPHS_MAX).contains(&count) {
            return Err(SettingsError(format!(
                "photographs: {count}; give a number from 1 to {PHOTOGRAPHS_MAX}"
            )));
        }
        let camera = settings.lens.lens();
        let size_px = [usize::from(camera.width_px), usize::from(camera.height_px)];
        let mut random = ChaCha8Rng::seed_from_u64(settings.seed);
        random.set_stream(2);
        let outline = outline_mm(geometry);
        let held = HOLDS.iter().cycle().take(count);
        let held = held.map(|hold| held_at(&camera, &outline, hold, &mut random));
        let held: Option<Vec<_>> = held.collect();
        let held = held.ok_or_else(|| {
            SettingsError("board: its outline cannot be placed in the frame of this lens".into())
        })?;
        let ink = Ink { black: settings.black, white: settings.white };
        let distance_mm = settings.distance_mm.unwrap_or(settings.lens.distance_mm());
        Ok(Self {
            camera,
            board: Board::new(geometry, geometry.pitch_mm(), ink),
            room: empty_room(size_px, settings.psf_sigma_px, settings.seed),
            cam_from_scene: layout::cam_from_scene(distance_mm),
            held,
            settings: settings.clone(),
        })
    }

    /// The camera.
    #[must_use]
    pub fn camera(&self) -> &Lens {
        &self.camera
    }

    /// The pose of the scene: where the board stands upright.
    #[must_use]
    pub fn cam_from_scene(&self) -> Pose<Cam, Scene> {
        self.cam_from_scene
    }

    /// The board's pose in each photograph.
    #[must_use]
    pub fn held(&self) -> &[Pose<Cam, Target>] {
        &self.held
    }

    /// A photograph of the held board, before noise: see [`expose`](Self::expose).
    ///
    /// # Panics
    /// When there is no photograph of this number.
    #[must_use]
    pub fn photograph(&self, number: usize) -> Picture {
        self.picture(self.held[number])
    }

    /// The board standing upright in the scene, before noise.
    #[must_use]
    pub fn standing(&self) -> Picture {
        let Pose { rotation, translation_mm, .. } = self.cam_from_scene;
        self.picture(Pose::new(rotation, translation_mm))
    }

    fn picture(&self, cam_from_target: Pose<Cam, Target>) -> Picture {
        let (gradient, width) = (self.settings.gradient, self.room.width);
        let gain = |x: f64, _y: f64| 1.0 + gradient * (x / width as f64 - 0.5);
        let mut picture = self.room.clone();
        for row in picture.grey.chunks_mut(width) {
            for (x, grey) in row.iter_mut().enumerate() {
                *grey *= gain(x as f64, 0.0) as f32;
            }
        }
        let placed = PlacedBoard { board: &self.board, cam_from_target };
        render_targets(&self.camera, self.settings.psf_sigma_px, &[placed], &gain, &mut picture);
        picture
    }

    /// A picture as the sensor delivers it with 8 bits; each number has noise of its own.
    pub fn expose(&self, picture: &Picture, number: u64, samples: &mut Vec<u8>) {
        samples.resize(picture.grey.len(), 0);
        let sensor = Sensor { noise_levels: self.settings.noise_levels as f32, bits: 8 };
        sensor.expose(picture, self.settings.seed, number, samples);
    }
}

/// The outline of the squares, from one corner of the board to the opposite one: a point for each
/// square that lies on it, so that a lens that bends its sides is followed.
fn outline_mm(geometry: &TargetGeometry) -> Vec<Vector3<f64>> {
    let [columns, rows] = [geometry.columns(), geometry.rows()].map(|count| count as i32);
    let first = geometry.corner_mm(0);
    let pitch_mm = geometry.pitch_mm();
    let border =
        |column: i32, row: i32| column == -1 || column == columns || row == -1 || row == rows;
    (-1..=rows)
        .flat_map(|row| (-1..=columns).map(move |column| (column, row)))
        .filter(|&(column, row)| border(column, row))
        .map(|(column, row)| {
            first + Vector3::new(f64::from(column), f64::from(row), 0.0) * pitch_mm
        })
        .collect()
}

/// The pose of a board that is held in this way; `None` where the lens does not show it.
fn held_at(
    camera: &Lens,
    outline_mm: &[Vector3<f64>],
    hold: &Hold,
    random: &mut ChaCha8Rng,
) -> Option<Pose<Cam, Target>> {
    let mut unsteady = |by: f64| random.random_range(-by..by);
    let [roll, yaw, pitch] = [hold.roll_deg, hold.tilt_deg[0], hold.tilt_deg[1]]
        .map(|deg| (deg + unsteady(UNSTEADY_DEG)).to_radians());
    let place = hold.place.map(|place| (place + unsteady(UNSTEADY)).clamp(-1.0, 1.0));
    let fill = hold.fill * (1.0 + unsteady(UNSTEADY));
    let frame_px = Vector2::new(f64::from(camera.width_px), f64::from(camera.height_px));
    let focal_px = Vector2::new(camera.fx_px, camera.fy_px);
    let size_mm = (outline_mm[outline_mm.len() - 1] - outline_mm[0]).xy();
    // The distance at which the board fills that part of the frame.
    let z_mm = (focal_px.component_mul(&size_mm)).component_div(&(fill * frame_px)).max();
    let mut pose = Pose::<Cam, Target>::from_theta([roll, yaw, pitch, 0.0, 0.0, z_mm]);
    let border_px = BORDER * frame_px.y;
    // A shift in the room moves the outline by nearly as much in the frame, up to perspective and
    // distortion: each round leaves less than a third of the error.
    for _ in 0..20 {
        let mut least = Vector2::repeat(f64::MAX);
        let mut most = Vector2::repeat(f64::MIN);
        for point in outline_mm {
            let px = camera.project(&pose.transform(point))?;
            (least, most) = (least.inf(&px), most.sup(&px));
        }
        let room_px = frame_px - Vector2::repeat(1.0 + 2.0 * border_px) - (most - least);
        let wanted_px = Vector2::from_fn(|axis, _| {
            border_px + 0.5 * (place[axis] + 1.0) * room_px[axis].max(0.0)
        });
        let shift = (wanted_px - least).component_div(&focal_px) * pose.translation_mm.z;
        pose.translation_mm += shift.push(0.0);
    }
    Some(pose)
}

#[cfg(test)]
mod tests {
    use plumbline::target::{Origin, Role};

    use super::super::layout::LensChoice;
    use super::*;

    fn board(columns: u8, rows: u8, pitch_mm: f64) -> TargetGeometry {
        TargetGeometry::checker(columns, rows, pitch_mm, Origin::Center, Role::Scene, [0.0; 3])
            .unwrap()
    }

    #[test]
    fn every_photograph_shows_the_whole_board_and_together_they_reach_every_border() {
        for lens in [LensChoice::None, LensChoice::Mild, LensChoice::Wide, LensChoice::Vga] {
            for (geometry, seed) in [(board(9, 6, 20.0), 1), (board(7, 8, 30.0), 2)] {
                let settings = SimulationSettings { lens, seed, ..SimulationSettings::default() };
                let photographs = BoardPhotographs::new(&settings, &geometry, 15).unwrap();
                let camera = photographs.camera();
                let [width, height] = [camera.width_px, camera.height_px].map(f64::from);
                let (mut least, mut most) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
                for pose in photographs.held() {
                    for point in outline_mm(&geometry) {
                        let px = camera.project(&pose.transform(&point)).unwrap();
                        (least, most) = (least.inf(&px), most.sup(&px));
                    }
                }
                // Within 1 to 3 % of the height on all sides.
                let gaps = [least.x, least.y, width - 1.0 - most.x, height - 1.0 - most.y];
                for gap in gaps {
                    assert!((0.01 * height..0.03 * height).contains(&gap), "{lens:?} {gaps:?}");
                }
            }
        }
    }

    #[test]
    fn the_board_stands_where_the_person_is_measured_in_the_same_room() {
        let settings = SimulationSettings { noise_levels: 0.0, ..SimulationSettings::default() };
        let photographs = BoardPhotographs::new(&settings, &board(9, 6, 20.0), 1).unwrap();
        let simulation = super::super::Simulation::new(&settings).unwrap();
        assert_eq!(photographs.cam_from_scene(), simulation.cam_from_scene());
        assert_eq!(photographs.camera(), simulation.camera());
        let (mut person, mut standing) = (Vec::<u8>::new(), Vec::<u8>::new());
        simulation.render(0, &mut person);
        photographs.expose(&photographs.standing(), 0, &mut standing);
        // The room is to the left and to the right of the person and of the board.
        for y in [10, 500, 1000] {
            for x in [5..200, 1300..1450] {
                let row = |samples: &[u8]| samples[y * 1456..][x.clone()].to_vec();
                assert_eq!(row(&person), row(&standing), "row {y}");
            }
        }
    }

    #[test]
    fn impossible_numbers_are_named() {
        let of = |count| {
            let settings = SimulationSettings::default();
            BoardPhotographs::new(&settings, &board(9, 6, 20.0), count).map(|_| ())
        };
        for count in [0, 501] {
            assert!(of(count).unwrap_err().to_string().contains("photographs"));
        }
    }
}
