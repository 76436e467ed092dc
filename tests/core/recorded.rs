//! The standard recording: frames of a rendered person with known poses.
//!
//! It is a file, so that frames are rendered once and never in an emulator.

use std::fs;

use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::pipeline::Pipeline;
use plumbline::pose::{Cam, Pose, Target};
use plumbline_test_support::{CONFIG_FILE, FRAMES_FILE, STANDARD, TRUTH_FILE, recording};

/// Time from one frame to the next.
pub const FRAME_NS: u64 = 16_666_667;

/// Frames that show both targets whole, at the start of the recording.
pub const CLEAN: usize = 40;

/// The first frames of the standard recording, and their ground truth.
pub struct Recorded {
    /// The configuration that they are tracked with.
    pub config: Config,
    /// The frames' pixels, row by row.
    pub frames: Vec<Vec<u8>>,
    /// The true pose of each target, per frame.
    truth: Vec<Vec<Pose<Cam, Target>>>,
}

impl Recorded {
    /// Reads the first `count` frames.
    ///
    /// # Panics
    /// When there is no such recording.
    pub fn read(count: usize) -> Self {
        let folder = recording(STANDARD);
        let file = |name: &str| {
            let path = folder.join(name);
            fs::File::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        };
        let blob = fs::read(folder.join(CONFIG_FILE)).expect("the recording's configuration");
        let config = Config::decode(&blob).expect("a sound configuration");
        let size = [config.lens.width_px, config.lens.height_px].map(usize::from);
        let frames = frames(file(FRAMES_FILE), size, count);
        let text = std::io::read_to_string(file(TRUTH_FILE)).expect("a table");
        let truth = truth(&text, config.targets.len());
        assert!(truth.len() >= count, "the recording is too short");
        Self { config, frames, truth }
    }

    /// A pipeline for it, on the heap: tests have one, though the pipeline does not need it.
    pub fn pipeline(&self) -> Box<Pipeline> {
        let mut pipeline = Box::new(Pipeline::new());
        pipeline.configure(&self.config).expect("the recording's own scene");
        pipeline
    }

    /// Width and height of a frame.
    pub fn size_px(&self) -> [usize; 2] {
        [self.config.lens.width_px, self.config.lens.height_px].map(usize::from)
    }

    /// The view of a whole frame.
    pub fn view<'a>(&self, pixels: &'a [u8]) -> GreyImage<'a> {
        let [width, height] = self.size_px();
        GreyImage::new(pixels, width, height, width).expect("a whole frame")
    }

    /// Where a target is in a frame.
    pub fn truth(&self, frame: usize, target: usize) -> &Pose<Cam, Target> {
        &self.truth[frame][target]
    }

    /// Paints a grey patch over a target and its margin, or over the left half of both.
    pub fn cover(&self, frame: usize, target: usize, half: bool, pixels: &mut [u8]) {
        let geometry = &self.config.targets[target].geometry;
        let [mut low, mut high] = [[f64::INFINITY; 2], [0.0_f64; 2]];
        for index in 0..geometry.corner_count() {
            let point_mm = self.truth(frame, target).transform(&geometry.corner_mm(index));
            let px = self.config.lens.project(&point_mm).expect("in front of the camera");
            for axis in 0..2 {
                low[axis] = low[axis].min(px[axis]);
                high[axis] = high[axis].max(px[axis]);
            }
        }
        // Beyond the outermost corners lie one square and a paper margin as wide.
        let margin_px = 50.0;
        let right_px = if half { (low[0] + high[0]) / 2.0 } else { high[0] + margin_px };
        let [width, _] = self.size_px();
        for y in (low[1] - margin_px) as usize..(high[1] + margin_px) as usize {
            pixels[y * width..][(low[0] - margin_px) as usize..right_px as usize].fill(110);
        }
    }
}

/// The frame to show at a step, when the first `distinct` ones are played forwards and backwards:
/// the motion has no jump.
pub fn place(step: usize, distinct: usize) -> usize {
    let turn = step % (2 * distinct - 2);
    turn.min(2 * distinct - 2 - turn)
}

/// The first frames of a grey Y4M file.
fn frames(file: fs::File, [width, height]: [usize; 2], count: usize) -> Vec<Vec<u8>> {
    use std::io::{BufRead, BufReader, Read};
    let mut file = BufReader::new(file);
    let mut line = String::new();
    file.read_line(&mut line).expect("a header");
    assert!(line.starts_with(&format!("YUV4MPEG2 W{width} H{height} ")), "{line}");
    assert!(line.contains(" Cmono"), "{line}");
    let mut frame = || {
        line.clear();
        file.read_line(&mut line).expect("a frame");
        assert_eq!(line, "FRAME\n");
        let mut pixels = vec![0; width * height];
        file.read_exact(&mut pixels).expect("a whole frame");
        pixels
    };
    (0..count).map(|_| frame()).collect()
}

/// The poses in a table with a row per frame and target.
fn truth(table: &str, targets: usize) -> Vec<Vec<Pose<Cam, Target>>> {
    let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().expect("a header");
    let columns = ["theta1_rad", "theta2_rad", "theta3_rad", "x_mm", "y_mm", "z_mm"]
        .map(|name| header.iter().position(|it| *it == name).expect(name));
    let pose =
        |row: Vec<&str>| Pose::from_theta(columns.map(|at| row[at].parse().expect("a number")));
    let poses: Vec<_> = rows.map(pose).collect();
    poses.chunks(targets).map(<[_]>::to_vec).collect()
}
