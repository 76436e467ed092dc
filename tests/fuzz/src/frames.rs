//! Frames through the pipeline: an input says what a small camera sees, in a few frames one after the
//! other. Pieces of checkerboards are drawn, of any size, turn, contrast and place; patches that hide
//! something; noise; and the time from each frame to the next is any.
//!
//! Laws:
//! - Poses are finite, before the camera, with rotations that are rotations and variances that are not
//!   negative; what has no pose has a reason. A frame of another size gives no pose.
//! - The packet of a report fits a packet, and is decoded to itself.
//! - The same frames give the same report, whatever lies in the padding of their rows.
//!
//! Work is bounded by the time limit of the runs: see `fuzz.rs` in `tests/support`.

use nalgebra::Matrix3;
use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::packet::{
    MarkedInstant, Message, PACKET_BYTES_MAX, PosePacket, Start, decode_datagram, encode_datagram,
};
use plumbline::pipeline::Pipeline;
use plumbline::report::Report;
use plumbline_stream::fixture;

use crate::input::Input;

/// Columns and rows of the camera's frames.
const SIZE_PX: [usize; 2] = [128, 96];

const FRAMES_MAX: usize = 5;
const BOARDS_MAX: usize = 4;
const PATCHES_MAX: usize = 3;

/// Bytes behind each row.
const PADDING: usize = 13;

/// One in so many inputs is tried with padding as well, as its noise has it.
const PADDED_EVERY: u32 = 5;

/// Samples of a pixel along each side.
const SAMPLES: usize = 2;

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    let config = config();
    let new = || {
        let mut pipeline = Box::new(Pipeline::new());
        pipeline.configure(&config).expect("a sound configuration");
        pipeline
    };
    let mut scene = Scene::read(&mut input);
    let mut one = new();
    // Most of the time is the pipeline's: not every input is given to two of them.
    let mut other = scene.state.is_multiple_of(PADDED_EVERY).then(new);
    let mut time_ns = 0_u64;
    for _ in 0..FRAMES_MAX {
        let pixels = scene.draw();
        let [width, height] = SIZE_PX;
        let frame = GreyImage::new(&pixels, width, height, width).expect("a whole frame");
        let report = one.step(&frame, time_ns);
        sound(&report, config.targets.len());
        if let Some(other) = &mut other {
            let padded = padded(&pixels, width);
            let stride = width + PADDING;
            let frame = GreyImage::new(&padded, width, height, stride).expect("a whole frame");
            assert_eq!(other.step(&frame, time_ns), report, "padding makes a difference");
        }
        if input.is_empty() {
            break;
        }
        // Mostly the time of a camera, and sometimes any.
        time_ns = match input.byte() {
            0 => input.long(),
            ms => time_ns.wrapping_add(u64::from(ms) * 1_000_000),
        };
        scene.go_on(&mut input);
    }
    let [width, height] = [SIZE_PX[0] - 1, SIZE_PX[1]];
    let pixels = vec![90_u8; width * height];
    let frame = GreyImage::new(&pixels, width, height, width).expect("a whole frame");
    let report = one.step(&frame, time_ns);
    assert!(report.targets.iter().all(|target| target.measurement.is_err()), "another size");
}

/// The pixels with something else behind each row.
fn padded(pixels: &[u8], width: usize) -> Vec<u8> {
    let padding = || (0..PADDING).map(|at| (at as u8).wrapping_mul(97));
    pixels.chunks(width).flat_map(|row| row.iter().copied().chain(padding())).collect()
}

/// The standard targets before a small camera, whose squares of 12 mm have 8 px at 150 mm.
fn config() -> Config {
    let mut config = fixture::config();
    let [width, height] = SIZE_PX.map(|side| side as u16);
    config.lens = plumbline_files::camera::stand_in(width, height);
    config
}

fn sound(report: &Report, targets: usize) {
    assert_eq!(report.targets.len(), targets);
    for target in &report.targets {
        let Ok(found) = &target.measurement else { continue };
        let pose = &found.cam_from_target;
        let numbers = pose.rotation.iter().chain(&pose.translation_mm);
        assert!(numbers.copied().all(f64::is_finite), "{found:?}");
        let unit = pose.rotation.transpose() * pose.rotation;
        assert!((unit - Matrix3::identity()).norm() < 1e-9, "{found:?}");
        assert!(pose.rotation.determinant() > 0.0, "{found:?}");
        assert!(pose.translation_mm.z > 0.0, "{found:?}");
        assert!(found.covariance.iter().all(|it| it.is_finite()), "{found:?}");
        assert!(found.covariance.diagonal().iter().all(|it| *it >= 0.0), "{found:?}");
        assert!(found.rms_px.is_finite() && found.rms_px >= 0.0, "{found:?}");
        assert!((1..=found.corners_total).contains(&found.corners), "{found:?}");
    }
    let is_seen = report.targets.iter().any(|target| target.measurement.is_ok());
    for point in [report.upper_trunk, report.lower_trunk].into_iter().flatten() {
        assert!(is_seen, "a point of the trunk without a target");
        let packed = plumbline::packet::AnatomicalPoint::from(&point);
        assert!([packed.ap_mm, packed.ml_mm, packed.si_mm].into_iter().all(f32::is_finite));
    }
    let packet = PosePacket::from_report(report, MarkedInstant::FrameArrival, 1000);
    let message = Message::Pose(packet);
    let mut buffer = [0; PACKET_BYTES_MAX];
    let bytes = encode_datagram(Start::new(1), &message, &mut buffer).expect("it fits a packet");
    let again = decode_datagram(bytes).expect("a box sends what a host takes");
    let mut buffer = [0; PACKET_BYTES_MAX];
    let twice = encode_datagram(again.start, &again.message, &mut buffer);
    assert_eq!(twice, Ok(bytes), "it is decoded to something else");
}

/// A piece of a checkerboard.
struct Board {
    /// Its middle.
    at_px: [f64; 2],
    /// From one square to the next, in the frame: the board's x and y.
    steps_px: [[f64; 2]; 2],
    /// How much nearer, and so larger, squares become with each step along x and y.
    nearer: [f64; 2],
    squares: [i32; 2],
    light: f64,
    dark: f64,
    begins_dark: bool,
}

/// Something that hides what is behind it.
struct Patch {
    from_px: [usize; 2],
    to_px: [usize; 2],
    level: u8,
}

struct Scene {
    level: f64,
    /// How much brighter it becomes from left to right.
    gradient: f64,
    boards: Vec<Board>,
    patches: Vec<Patch>,
    noise: u8,
    state: u32,
}

impl Scene {
    fn read(input: &mut Input<'_>) -> Self {
        let boards = input.below(BOARDS_MAX + 1);
        let patches = input.below(PATCHES_MAX + 1);
        let (level, noise) = (f64::from(input.byte()), input.byte() % 64);
        let gradient = 100.0 * input.fraction();
        let state = input.number() | 1;
        let boards = (0..boards).map(|_| Board::read(input)).collect();
        let patches = (0..patches).map(|_| Patch::read(input)).collect();
        Self { level, gradient, boards, patches, noise, state }
    }

    /// Boards move, and everything may become brighter.
    fn go_on(&mut self, input: &mut Input<'_>) {
        for board in &mut self.boards {
            for at_px in &mut board.at_px {
                *at_px += f64::from(input.byte().cast_signed()) / 16.0;
            }
        }
        let brighter = f64::from(input.byte().cast_signed());
        self.level += brighter;
        for board in &mut self.boards {
            (board.light, board.dark) = (board.light + brighter, board.dark + brighter);
        }
    }

    fn draw(&mut self) -> Vec<u8> {
        let [width, height] = SIZE_PX;
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let mut sum = 0.0;
                for sample in 0..SAMPLES * SAMPLES {
                    let place = |at: usize| (at as f64 + 0.5) / SAMPLES as f64 - 0.5;
                    let at =
                        [x as f64 + place(sample % SAMPLES), y as f64 + place(sample / SAMPLES)];
                    sum += self.level_at(at);
                }
                let level = sum / (SAMPLES * SAMPLES) as f64 + self.next_noise();
                pixels.push(level.round().clamp(0.0, 255.0) as u8);
            }
        }
        for patch in &self.patches {
            for y in patch.from_px[1]..patch.to_px[1] {
                pixels[y * width..][patch.from_px[0]..patch.to_px[0]].fill(patch.level);
            }
        }
        pixels
    }

    fn level_at(&self, at: [f64; 2]) -> f64 {
        let on_board = self.boards.iter().rev().find_map(|board| board.level_at(at));
        let light = self.gradient * (at[0] / SIZE_PX[0] as f64 - 0.5);
        on_board.unwrap_or(self.level) + light
    }

    /// Marsaglia's xorshift.
    fn next_noise(&mut self) -> f64 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 17;
        self.state ^= self.state << 5;
        f64::from(self.noise) * (f64::from(self.state) / f64::from(u32::MAX) - 0.5)
    }
}

impl Board {
    fn read(input: &mut Input<'_>) -> Self {
        let squares = [2 + input.below(8) as i32, 2 + input.below(8) as i32];
        let size_px = 2.0 + 14.0 * f64::from(input.byte()) / 255.0;
        let turn_rad = std::f64::consts::PI * input.fraction();
        let (flat, shear) = (input.fraction(), input.fraction());
        let (sin, cos) = turn_rad.sin_cos();
        let x = [size_px * cos, size_px * sin];
        let y = [size_px * (shear * cos - flat * sin), size_px * (shear * sin + flat * cos)];
        let [width, height] = SIZE_PX.map(|side| side as f64);
        let at_px = [width * (0.5 + input.fraction()), height * (0.5 + input.fraction())];
        let nearer = [0.05 * input.fraction(), 0.05 * input.fraction()];
        let (light, dark) = (input.byte().into(), input.byte().into());
        let begins_dark = input.byte().is_multiple_of(2);
        Self { at_px, steps_px: [x, y], nearer, squares, light, dark, begins_dark }
    }

    /// Its level at a point of the frame; `None` beside it.
    fn level_at(&self, at: [f64; 2]) -> Option<f64> {
        let [[xx, xy], [yx, yy]] = self.steps_px;
        let determinant = xx * yy - xy * yx;
        if determinant.abs() < 1.0 {
            return None;
        }
        let [dx, dy] = [at[0] - self.at_px[0], at[1] - self.at_px[1]];
        let [u, v] = [(yy * dx - yx * dy) / determinant, (xx * dy - xy * dx) / determinant];
        let scale = 1.0 - self.nearer[0] * u - self.nearer[1] * v;
        if scale < 0.2 {
            return None;
        }
        let [columns, rows] = self.squares.map(f64::from);
        let [u, v] = [u / scale + columns / 2.0, v / scale + rows / 2.0];
        // White paper as wide as a square around it.
        if u < -1.0 || v < -1.0 || u >= columns + 1.0 || v >= rows + 1.0 {
            return None;
        }
        if u < 0.0 || v < 0.0 || u >= columns || v >= rows {
            return Some(self.light);
        }
        let is_even = (u as i32 + v as i32) % 2 == 0;
        Some(if is_even == self.begins_dark { self.dark } else { self.light })
    }
}

impl Patch {
    fn read(input: &mut Input<'_>) -> Self {
        let mut side = |end: usize| {
            let [a, b] = [input.below(256) * end / 255, input.below(256) * end / 255];
            [a.min(b), a.max(b)]
        };
        let [x, y] = SIZE_PX.map(&mut side);
        Self { from_px: [x[0], y[0]], to_px: [x[1], y[1]], level: input.byte() }
    }
}

/// One target, both targets, one that is partly hidden, and others that are none.
pub fn seeds() -> Vec<Vec<u8>> {
    let fraction = |value: f64| ((value * f64::from(i16::MAX)) as i16).to_le_bytes();
    let board = |squares: [u8; 2], size: u8, turn: f64, at: [f64; 2]| -> Vec<u8> {
        let mut bytes = vec![squares[0] - 2, squares[1] - 2, size];
        for value in [turn, 1.0, 0.0, at[0], at[1], 0.0, 0.0] {
            bytes.extend(fraction(value));
        }
        bytes.extend([220, 30, 0]);
        bytes
    };
    // Boards, patches, level, noise, gradient, the noise's state: one that takes padding, and others.
    let head = |boards: u8, patches: u8, noise: u8| {
        [boards, patches, 110, noise, 0, 0, if patches > 0 { 5 } else { 7 }, 0, 0, 0]
    };
    let motion = |boards: usize| {
        let step = [&[17][..], &vec![4; 2 * boards], &[0]].concat();
        step.repeat(FRAMES_MAX - 1)
    };
    let lower = board([7, 6], 120, 0.02, [-0.1, 0.0]);
    let upper = board([6, 5], 90, -0.05, [0.24, -0.2]);
    let small = board([7, 6], 90, 0.02, [-0.22, 0.1]);
    vec![
        [&head(1, 0, 3)[..], &lower, &motion(1)].concat(),
        [&head(2, 0, 3)[..], &small, &upper, &motion(2)].concat(),
        [&head(1, 1, 3)[..], &lower, &[100, 150, 60, 250, 110], &motion(1)].concat(),
        [&head(1, 0, 20)[..], &board([9, 9], 60, 0.3, [0.0, 0.0]), &motion(1)].concat(),
        [&head(1, 0, 3)[..], &lower, &[0, 255, 255, 255, 255, 255, 255, 255, 255, 9, 9, 60]]
            .concat(),
        vec![0, 0, 90, 63],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Otherwise nothing is tried but the search for what is not there.
    #[test]
    fn targets_are_found_in_what_is_drawn() {
        let seen = |seed: &[u8]| -> usize {
            let mut pipeline = Box::new(Pipeline::new());
            pipeline.configure(&config()).unwrap();
            let mut scene = Scene::read(&mut Input::new(seed));
            let [width, height] = SIZE_PX;
            let pixels = scene.draw();
            let frame = GreyImage::new(&pixels, width, height, width).unwrap();
            let report = pipeline.step(&frame, 0);
            report.targets.iter().filter(|target| target.measurement.is_ok()).count()
        };
        let seen: Vec<usize> = seeds().iter().map(|seed| seen(seed)).collect();
        assert_eq!((seen[0], seen[1]), (1, 2), "{seen:?}");
    }
}
