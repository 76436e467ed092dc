//! A camera that may disappear and come back.
//!
//! ```text
//!             opened                 a frame
//!   Absent ───────────▶ Waiting ───────────────▶ Giving
//!    ▲  ▲                  │                        │
//!    │  └──────────────────┘ silent for a second    │
//!    └──────────────────────────────────────────────┘
//!                            error, or silent for a second
//! ```
//!
//! Opening an absent camera is retried again and again, for as long as it takes: see [`PAUSE`].
//! Opening allocates; giving frames does not, unless they are compressed.

use std::time::{Duration, Instant};

use anyhow::Result;
use plumbline::config::Capture;
use plumbline::packet::CameraState;

use super::{Condition, Exposure, Frame, FrameSource, Next};
use crate::logger;

/// An open camera that is silent for this long is closed and reopened.
const SILENCE_MAX: Duration = Duration::from_secs(1);

/// The pause before an attempt to open a camera, the same however long it has been absent: somebody
/// who plugs it in again waits for less than a second, most of which its driver and its first frame
/// take. Without a camera the box has nothing else to do.
const PAUSE: Duration = Duration::from_millis(100);

/// How often a fault is repeated to the hosts, as one may have started listening
/// only now.
const REPORT_AGAIN: Duration = Duration::from_secs(5);

/// An open camera of one kind.
pub trait Device: Sized {
    /// Opens the camera, sets it up as asked and starts it.
    ///
    /// # Errors
    /// When there is none, or it cannot be set up as asked; the message names the
    /// setting and the remedy.
    fn open(capture: &Capture, size_px: (usize, usize)) -> Result<Self>;

    /// Waits for a frame, but not beyond `until`. The frame of the previous wait
    /// goes back to the camera. If several frames are there, all but the newest
    /// two are skipped and counted.
    fn wait(&mut self, until: Instant) -> Waited;

    /// The frame that the last [`wait`](Self::wait) found.
    fn frame(&self) -> Frame<'_>;

    /// The frames skipped and missed since it was opened.
    fn counts(&self) -> Counts;
}

/// The result of waiting for a frame.
#[derive(Debug)]
pub enum Waited {
    /// [`Device::frame`] has one.
    Ready,
    /// No frame by the instant named.
    Quiet,
    /// The camera is gone or broken; the text says what it reported.
    Lost(String),
}

/// Counts of the frames that were not given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Frames that arrived when newer ones were already there.
    pub dropped: u64,
    /// Frames that never arrived, or arrived damaged.
    pub missed: u64,
}

/// A source of frames from a camera, whatever happens to it.
#[derive(Debug)]
pub struct Camera<D> {
    configured: Capture,
    /// The same, with the exposure that was asked for.
    capture: Capture,
    size_px: (usize, usize),
    /// As in the configuration.
    readout_ns: i32,
    state: State<D>,
    reported: CameraState,
    /// The counts of earlier openings.
    earlier: Counts,
    losses: u32,
    /// The last fault, so that the console shows it once, and when it was last reported.
    last_fault: String,
    fault_reported_at: Instant,
}

#[derive(Debug)]
enum State<D> {
    Absent { again_at: Instant },
    Waiting { device: D, since: Instant },
    Giving { device: D, last_frame: Instant },
}

impl<D: Device> Camera<D> {
    /// A camera that is opened when the first frame is asked for.
    #[must_use]
    pub fn new(capture: Capture, size_px: (usize, usize), readout_ns: i32) -> Self {
        Self {
            configured: capture.clone(),
            capture,
            size_px,
            readout_ns,
            state: State::Absent { again_at: Instant::now() },
            reported: CameraState::Starting,
            earlier: Counts::default(),
            losses: 0,
            last_fault: String::new(),
            fault_reported_at: Instant::now(),
        }
    }

    /// Opens the camera if it is time to; otherwise sleeps, at most until `until`.
    fn open(&mut self, again_at: Instant, until: Instant) {
        let now = Instant::now();
        if now < again_at {
            std::thread::sleep(again_at.min(until).saturating_duration_since(now));
            return;
        }
        match D::open(&self.capture, self.size_px) {
            Ok(device) => self.state = State::Waiting { device, since: Instant::now() },
            Err(error) => {
                if self.capture != self.configured {
                    // The camera may have refused an exposure that is being tried out.
                    self.capture = self.configured.clone();
                }
                self.report(format!("{error:#}"));
                self.reported = CameraState::Lost;
                self.state = State::Absent { again_at: Instant::now() + PAUSE };
            }
        }
    }

    /// Closes a camera that is silent or broken.
    fn close(&mut self, reported: CameraState, what: String) {
        let absent = State::Absent { again_at: Instant::now() + PAUSE };
        match std::mem::replace(&mut self.state, absent) {
            State::Absent { .. } => {}
            State::Waiting { device, .. } => self.add_counts(&device),
            State::Giving { device, .. } => {
                self.add_counts(&device);
                self.losses = self.losses.saturating_add(1);
            }
        }
        self.report(what);
        self.reported = reported;
    }

    fn add_counts(&mut self, device: &D) {
        let counts = device.counts();
        self.earlier.dropped += counts.dropped;
        self.earlier.missed += counts.missed;
    }

    fn report(&mut self, what: String) {
        if what != self.last_fault {
            log::error!("camera: {what}");
            self.last_fault = what;
        } else if self.fault_reported_at.elapsed() >= REPORT_AGAIN {
            logger::tell_hosts(
                &log::Record::builder()
                    .level(log::Level::Error)
                    .target(module_path!())
                    .args(format_args!("camera: {what}"))
                    .build(),
            );
        } else {
            return;
        }
        self.fault_reported_at = Instant::now();
    }
}

impl<D: Device> FrameSource for Camera<D> {
    fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    fn next(&mut self, until: Instant) -> Next<'_> {
        if let State::Absent { again_at } = self.state {
            self.open(again_at, until);
        }
        let (waited, silent_since) = match &mut self.state {
            State::Absent { .. } => return Next::Quiet,
            State::Waiting { device, since } => (device.wait(until), *since),
            State::Giving { device, last_frame } => (device.wait(until), *last_frame),
        };
        match waited {
            Waited::Quiet if silent_since.elapsed() < SILENCE_MAX => return Next::Quiet,
            Waited::Quiet => {
                self.close(CameraState::Stalled, "no frame for a second: reopening it".into());
                return Next::Quiet;
            }
            Waited::Lost(what) => {
                self.close(CameraState::Lost, what);
                return Next::Quiet;
            }
            Waited::Ready => {}
        }
        let absent = State::Absent { again_at: until };
        self.state = match std::mem::replace(&mut self.state, absent) {
            State::Waiting { device, .. } | State::Giving { device, .. } => {
                State::Giving { device, last_frame: Instant::now() }
            }
            State::Absent { again_at } => State::Absent { again_at },
        };
        if !self.last_fault.is_empty() {
            log::info!("camera: frames are arriving again");
            self.last_fault.clear();
        }
        self.reported = CameraState::Running;
        match &self.state {
            State::Giving { device, .. } => {
                let exposure_us = self.capture.exposure_us;
                Next::Frame(device.frame().at_mid_exposure(exposure_us, self.readout_ns))
            }
            _ => Next::Quiet,
        }
    }

    /// Reopens the camera, which works with every driver.
    fn expose(&mut self, exposure: Exposure) -> bool {
        let mut capture = self.configured.clone();
        capture.exposure_us = exposure.exposure_us.or(capture.exposure_us);
        capture.gain = exposure.gain.or(capture.gain);
        if capture == self.capture {
            return true;
        }
        self.capture = capture;
        let absent = State::Absent { again_at: Instant::now() };
        if let State::Waiting { device, .. } | State::Giving { device, .. } =
            std::mem::replace(&mut self.state, absent)
        {
            self.add_counts(&device);
        }
        true
    }

    fn exposure(&self) -> Exposure {
        Exposure { exposure_us: self.capture.exposure_us, gain: self.capture.gain }
    }

    fn condition(&self) -> Condition {
        let counts = match &self.state {
            State::Absent { .. } => Counts::default(),
            State::Waiting { device, .. } | State::Giving { device, .. } => device.counts(),
        };
        Condition {
            camera: self.reported,
            frames_dropped: self.earlier.dropped + counts.dropped,
            frames_missed: self.earlier.missed + counts.missed,
            camera_losses: self.losses,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::VecDeque;

    use plumbline::image::GreyImage;
    use plumbline::packet::MarkedInstant;

    use super::super::Pixels;
    use super::*;
    use crate::test_config;

    thread_local! {
        /// What the fake camera of this test does next: its openings and its waits.
        static SCRIPT: RefCell<VecDeque<Step>> = const { RefCell::new(VecDeque::new()) };
    }

    enum Step {
        Opens,
        Fails(&'static str),
        Gives,
        Silent,
        Breaks,
    }

    /// A camera that fails on command, as no real one does.
    #[derive(Debug)]
    struct Fake;

    static BLACK: [u8; 64 * 64] = [0; 64 * 64];

    fn next_step() -> Step {
        SCRIPT.with_borrow_mut(VecDeque::pop_front).expect("the script says what happens")
    }

    impl Device for Fake {
        fn open(_: &Capture, _: (usize, usize)) -> Result<Self> {
            match next_step() {
                Step::Opens => Ok(Self),
                Step::Fails(why) => anyhow::bail!(why),
                _ => panic!("nothing to open"),
            }
        }

        fn wait(&mut self, until: Instant) -> Waited {
            match next_step() {
                Step::Gives => Waited::Ready,
                Step::Silent => {
                    std::thread::sleep(until.saturating_duration_since(Instant::now()));
                    Waited::Quiet
                }
                Step::Breaks => Waited::Lost("it broke".into()),
                _ => panic!("nothing to wait for"),
            }
        }

        fn frame(&self) -> Frame<'_> {
            Frame {
                pixels: Pixels::Grey8(GreyImage::new(&BLACK, 64, 64, 64).unwrap()),
                capture_time_ns: 1,
                instant: MarkedInstant::ExposureEnd,
                ready_at: Instant::now(),
                late: false,
            }
        }

        fn counts(&self) -> Counts {
            Counts { dropped: 2, missed: 3 }
        }
    }

    fn camera(script: impl IntoIterator<Item = Step>) -> Camera<Fake> {
        SCRIPT.with_borrow_mut(|steps| steps.extend(script));
        let capture = test_config::config().capture.unwrap();
        Camera::new(capture, (64, 64), 0)
    }

    /// Asks for frames until one comes.
    fn frame_within(camera: &mut Camera<Fake>, turns: usize) -> bool {
        (0..turns).any(|_| {
            let until = Instant::now() + Duration::from_millis(300);
            matches!(camera.next(until), Next::Frame(_))
        })
    }

    #[test]
    fn opening_an_absent_camera_is_retried() {
        let mut camera = camera([Step::Fails("a"), Step::Fails("a"), Step::Opens, Step::Gives]);
        assert_eq!(camera.condition().camera, CameraState::Starting);
        assert!(!frame_within(&mut camera, 1));
        assert_eq!(camera.condition().camera, CameraState::Lost);
        assert!(frame_within(&mut camera, 20));
        let condition = camera.condition();
        assert_eq!(condition.camera, CameraState::Running);
        // It was never there before, so it was not lost.
        assert_eq!(condition.camera_losses, 0);
    }

    #[test]
    fn a_camera_that_breaks_comes_back_and_its_counts_go_on() {
        let script = [
            Step::Opens,
            Step::Gives,
            Step::Breaks,
            Step::Fails("gone"),
            Step::Opens,
            Step::Gives,
            Step::Gives,
        ];
        let mut camera = camera(script);
        assert!(frame_within(&mut camera, 1));
        assert!(!frame_within(&mut camera, 1));
        assert_eq!(camera.condition().camera, CameraState::Lost);
        assert!(frame_within(&mut camera, 20));
        let expected = Condition {
            camera: CameraState::Running,
            frames_dropped: 4,
            frames_missed: 6,
            camera_losses: 1,
        };
        assert_eq!(camera.condition(), expected);
    }

    #[test]
    fn a_silent_camera_is_reported_and_reopened() {
        let silence = std::iter::repeat_with(|| Step::Silent).take(4);
        let script = [Step::Opens, Step::Gives].into_iter().chain(silence);
        let mut camera = camera(script.chain([Step::Opens, Step::Gives]));
        assert!(frame_within(&mut camera, 1));
        // Four waits of 0.3 s are longer than the permitted silence.
        assert!(!frame_within(&mut camera, 4));
        assert_eq!(camera.condition().camera, CameraState::Stalled);
        assert!(frame_within(&mut camera, 5));
        assert_eq!(camera.condition().camera_losses, 1);
    }

    #[test]
    fn an_absent_camera_is_reported_to_the_hosts_repeatedly() {
        let mut camera = camera([Step::Fails("far"), Step::Fails("far"), Step::Fails("far")]);
        let mut open = || {
            camera.state = State::Absent { again_at: Instant::now() };
            let _ = camera.next(Instant::now());
            camera.fault_reported_at -= REPORT_AGAIN;
            let logs = std::iter::from_fn(|| logger::take(Instant::now()));
            logs.filter(|log| log.text == "camera: far").count()
        };
        // Logged by the program's logger, which the tests do not install.
        assert_eq!(open(), 0);
        assert_eq!((open(), open()), (1, 1));
    }

    #[test]
    fn a_camera_that_was_absent_for_long_is_found_as_soon_as_any() {
        const ATTEMPTS: usize = 12;
        let absent = (0..ATTEMPTS).map(|_| Step::Fails("absent"));
        let mut camera = camera(absent.chain([Step::Opens, Step::Gives]));
        // One turn for each attempt, and one for the pause before it.
        assert!(frame_within(&mut camera, 2 * ATTEMPTS + 2));
    }
}
