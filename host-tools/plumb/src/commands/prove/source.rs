//! Where a proof's poses come from: recorded frames that the core tracks here, the trials of a box,
//! or a box that is watched now.

use std::path::{Path, PathBuf};
use std::time::Duration;

use plumbline_bedside::setup::Descriptions;
use plumbline_evidence::sighting::Sighting;
use plumbline_files::BadInput;
use plumbline_files::frames::FrameSource;
use plumbline_tracking::Tracker;
use plumbline_trial::poses;

use super::live::{self, Advice};
use super::recording::Recording;
use crate::arguments::{LinkArguments, seconds};
use crate::ui::progress::Progress;
use crate::ui::waiting;

/// What a proof is made from.
#[derive(Debug, clap::Args)]
pub struct Input {
    /// With frames: camera.toml, OpenCV (YAML or JSON), or ROS camera_info (YAML).
    #[arg(long, value_name = "FILE", requires = "inputs")]
    camera: Option<PathBuf>,
    /// With frames: the targets file, which describes the boards.
    #[arg(long, value_name = "FILE", requires = "inputs")]
    targets: Option<PathBuf>,
    /// With frames: their rate; otherwise from the Y4M header, and 30 for images.
    #[arg(long, value_name = "RATE", requires = "inputs")]
    fps: Option<f64>,
    /// With frames: search every image afresh, for photographs that do not follow each other.
    #[arg(long, requires = "inputs")]
    independent: bool,
    /// Without INPUT: where the box is heard.
    #[command(flatten)]
    link: LinkArguments,
    /// Without INPUT: how long the box is watched at most; Ctrl-C ends it earlier.
    #[arg(
        long,
        value_name = "SECONDS",
        value_parser = seconds,
        default_value = "60",
        conflicts_with = "inputs"
    )]
    seconds: Duration,
    /// Folders of trials, as `plumb receive --out` makes them; or Y4M videos, each of which is a
    /// recording; or images, which are one recording together. Without any, a box is watched.
    #[arg(value_name = "INPUT", conflicts_with_all = ["udp", "serial"])]
    inputs: Vec<PathBuf>,
}

impl Input {
    /// Whether each frame stands for itself.
    pub fn is_independent(&self) -> bool {
        self.independent
    }

    /// The files that are read, for outputs that must not overwrite them.
    pub fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.inputs.iter().chain(&self.camera).chain(&self.targets)
    }

    /// Whether a box is watched, and nothing is left of what it showed.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.inputs.is_empty()
    }

    /// Reads all recordings; or makes one of a box that is watched now, during which `advise` is
    /// asked every second for what the user is to do next.
    ///
    /// # Errors
    /// When one cannot be read or holds no frames, their cameras differ, or `advise` says that
    /// nothing can come of it.
    pub fn read(
        &self,
        advise: impl FnMut(&Recording) -> Result<Advice, BadInput>,
    ) -> Result<Vec<Recording>, BadInput> {
        if self.is_live() {
            return Ok(vec![live::watch(&self.link, self.seconds, advise)?]);
        }
        let mut recordings = Vec::new();
        for inputs in self.recordings() {
            let recording = match inputs {
                [folder] if folder.is_dir() => of_trial(folder)?,
                files => self.of_files(files)?,
            };
            if recording.frames == 0 {
                let remedy = "record again, and check with `plumb doctor` that frames come";
                return Err(BadInput::whole(&recording.place, "there are no frames in it", remedy));
            }
            recordings.push(recording);
        }
        let first = &recordings[0];
        if let Some(other) = recordings.iter().find(|it| it.lens != first.lens) {
            let found = format!("its camera is not that of {}", first.place);
            let remedy = "give recordings of one camera with one calibration";
            return Err(BadInput::whole(&other.place, found, remedy));
        }
        Ok(recordings)
    }

    /// The inputs of each recording: a folder, a video, or images that follow each other.
    fn recordings(&self) -> impl Iterator<Item = &[PathBuf]> {
        let is_image = |path: &Path| {
            let extension = path.extension().map(|it| it.to_ascii_lowercase());
            !path.is_dir() && extension.is_some_and(|it| it != "y4m")
        };
        self.inputs.chunk_by(move |a, b| is_image(a) && is_image(b))
    }

    fn of_files(&self, files: &[PathBuf]) -> Result<Recording, BadInput> {
        let (Some(camera), Some(targets)) = (&self.camera, &self.targets) else {
            return Err(BadInput::whole(
                files[0].display(),
                "frames need --camera and --targets",
                "give both files; or give the folder of a trial, which has them",
            ));
        };
        let descriptions = Descriptions::of(camera, targets, None);
        let (camera, targets, _) = descriptions.read(&mut waiting::shown())?;
        let mut source = FrameSource::open(files, self.fps)?;
        let places = descriptions.places();
        let (config, mut tracker) =
            Tracker::of_source(&source, self.independent, (&camera, &targets, None), &places)?;
        let mut recording = Recording::new(files[0].display(), &config);
        let progress = Progress::new(source.count_hint(), true);
        while let Some(frame) = source.next_frame()? {
            let report = tracker.step(&frame);
            let frame_ns = report.capture_time_ns;
            for (board, found) in recording.boards.iter_mut().zip(&report.targets) {
                board.take(found.measurement.map(|it| {
                    // Photographs do not follow each other: nothing moved between their rows.
                    let own_ns = if self.independent { frame_ns } else { it.own_time_ns(frame_ns) };
                    Sighting {
                        time_s: 1e-9 * own_ns as f64,
                        cam_from_board: it.cam_from_target,
                        covariance: it.covariance,
                    }
                }));
            }
            recording.frames += 1;
            progress.advance();
        }
        progress.finish();
        Ok(recording)
    }
}

/// The poses that a box has sent.
fn of_trial(folder: &Path) -> Result<Recording, BadInput> {
    let trial = poses::read(folder)?;
    let mut recording = Recording::new(folder.display(), &trial.config);
    for (frame_time_s, packet) in &trial.frames {
        recording.take(*frame_time_s, packet);
    }
    Ok(recording)
}
