//! The pictures that the camera shows: rendered once, and shown again and again.

use std::io::Read as _;
use std::path::Path;

use plumbline::config::{Capture, CaptureDriver, Config, PixelFormat};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_render::simulate::layout::LensChoice;
use plumbline_render::simulate::photographs::BoardPhotographs;
use plumbline_render::simulate::render::Picture;
use plumbline_render::simulate::sensor::Sensor;
use plumbline_render::simulate::{Simulation, SimulationSettings};

/// A small camera: a frame costs the box little.
pub const SIZE_PX: (usize, usize) = (640, 480);

pub const RATE_HZ: u64 = 60;

/// Frames with a lens cap on. They differ by their noise.
const DARK: usize = 8;

/// Inner corners of the boards that are not the box's.
const STRANGE_BOARDS: [(u8, u8); 3] = [(8, 7), (7, 6), (4, 3)];

/// Frames of each of them.
const HELD: usize = 8;

/// The numbers of the pictures of each kind; they lie in this order.
#[derive(Debug, Clone, Copy)]
pub struct Kinds {
    pub person: usize,
    pub dark: usize,
    pub strange: usize,
}

/// The pictures.
pub struct Show {
    pub kinds: Kinds,
    pictures: Vec<Vec<u8>>,
}

impl Show {
    pub fn picture(&self, number: usize) -> &[u8] {
        &self.pictures[number]
    }

    /// Writes all pictures into one file, one after the other.
    pub fn write(&self, path: &Path) {
        std::fs::write(path, self.pictures.concat()).expect("there is room");
    }

    /// Reads what [`Self::write`] has written.
    pub fn read(path: &Path, kinds: Kinds) -> Self {
        let mut file = std::fs::File::open(path).expect("the pictures are there");
        let mut picture = || {
            let mut pixels = vec![0; SIZE_PX.0 * SIZE_PX.1];
            file.read_exact(&mut pixels).expect("a whole picture");
            pixels
        };
        let count = kinds.person + kinds.dark + kinds.strange;
        Self { kinds, pictures: (0..count).map(|_| picture()).collect() }
    }
}

/// The pictures, and what is known of them.
pub struct Scene {
    pub show: Show,
    /// Per target and frame of the person.
    pub truth: [Vec<Pose<Cam, Target>>; 2],
    pub config: Config,
}

impl Scene {
    /// With this number of frames of the person.
    pub fn new(person: usize) -> Self {
        let settings = SimulationSettings {
            frame_rate_hz: RATE_HZ as f64,
            lens: LensChoice::Vga,
            ..SimulationSettings::default()
        };
        let simulation = Simulation::new(&settings).expect("settings that can be simulated");
        let mut pictures: Vec<Vec<u8>> = Vec::new();
        for frame in 0..person as u64 {
            let mut pixels = Vec::new();
            simulation.render(frame, &mut pixels);
            pictures.push(pixels);
        }
        let sensor = Sensor { noise_levels: settings.noise_levels as f32, bits: 8 };
        // Some light comes in at the side.
        let cap = Picture::uniform(SIZE_PX.0, SIZE_PX.1, 4.0);
        for frame in 0..DARK as u64 {
            let mut pixels = vec![0; SIZE_PX.0 * SIZE_PX.1];
            sensor.expose(&cap, settings.seed, frame, &mut pixels);
            pictures.push(pixels);
        }
        for (columns, rows) in STRANGE_BOARDS {
            let geometry =
                TargetGeometry::checker(columns, rows, 12.0, Origin::Center, Role::Scene, [0.0; 3])
                    .expect("a board within the limits");
            let photographs = BoardPhotographs::new(&settings, &geometry, HELD)
                .expect("a board that can be held before this camera");
            for number in 0..HELD {
                let mut pixels = Vec::new();
                photographs.expose(&photographs.photograph(number), number as u64, &mut pixels);
                pictures.push(pixels);
            }
        }
        let truth = [0, 1].map(|target| {
            let truths = (0..person as u64).map(|frame| simulation.truth(frame));
            truths.map(|it| it.targets[target].cam_from_target).collect()
        });
        let mut config = simulation.config();
        config.device = "endurance".try_into().expect("a short name");
        config.capture = Some(Capture {
            driver: CaptureDriver::V4l2,
            device: heapless::String::new(),
            pixel_format: PixelFormat::Grey,
            rate_hz: RATE_HZ as f32,
            exposure_us: None,
            gain: None,
        });
        let kinds = Kinds { person, dark: DARK, strange: STRANGE_BOARDS.len() * HELD };
        Self { show: Show { kinds, pictures }, truth, config }
    }
}
