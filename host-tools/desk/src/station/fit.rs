//! A camera is fitted to photographs, beside whatever is done with the box.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};

use plumbline_bedside::calibration::{self, Calibrated};
use plumbline_calibration::Choice;
use plumbline_calibration::models::MODELS;
use plumbline_files::{BadInput, camera};

use super::Worker;
use super::orders::Refusal;
use crate::wire::{CalibrationState, Job, Problem};
use crate::words::on_page;

/// The camera's file, beside its photographs.
const CAMERA: &str = "camera.toml";

/// The picture of where each corner was.
pub const PLOT: &str = "calibration.svg";

/// A fit that goes on.
pub struct Fitting {
    /// `None` once it was joined.
    thread: Option<JoinHandle<Result<Calibrated, BadInput>>>,
    done: Arc<AtomicUsize>,
    steps: usize,
}

impl Drop for Fitting {
    fn drop(&mut self) {
        // It cannot be interrupted, and takes seconds.
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Fits a camera, and keeps it beside its photographs.
fn fit(
    files: &[PathBuf],
    (board, pitch_mm): ([u8; 2], f64),
    folder: &std::path::Path,
    done: &AtomicUsize,
) -> Result<Calibrated, BadInput> {
    let board = calibration::board(board, pitch_mm)?;
    let pictures = calibration::read(files)?;
    let today = jiff::Zoned::now().date();
    let step = || {
        done.fetch_add(1, Ordering::Relaxed);
    };
    let calibrated = calibration::camera_from(&pictures, &board, Choice::Supported, today, step)?;
    let plot = plumbline_report::calibration::svg(&calibrated.calibration, &calibrated.places)?;
    let outputs = vec![
        (folder.join(CAMERA), camera::to_toml(&calibrated.camera).into_bytes()),
        (folder.join(PLOT), plot.into_bytes()),
    ];
    plumbline_files::write_all(&outputs, true)?;
    Ok(calibrated)
}

impl Worker {
    pub(super) fn begin_fit(&mut self) -> Result<(), Refusal> {
        let Some(set) = &self.photographs else { return Ok(()) };
        let (files, board) = (set.files(), (set.board, set.pitch_mm));
        let folder = set.folder.clone();
        let steps = files.len() + MODELS.len();
        let done = Arc::<AtomicUsize>::default();
        let count = Arc::clone(&done);
        let thread = thread::Builder::new()
            .name("a calibration".to_owned())
            .spawn(move || fit(&files, board, &folder, &count))
            .map_err(|error| BadInput::io("a thread for the calibration", &error))?;
        self.fitting = Some(Fitting { thread: Some(thread), done, steps });
        let since_at_ms = self.shared.hub.now_ms();
        self.shared.update(|state| {
            state.failed = None;
            let words = "fitting a camera to the photographs".to_owned();
            state.job = Some(Job { words, since_at_ms, share: Some(0.0) });
        });
        Ok(())
    }

    /// Looks whether a fit is over.
    pub(super) fn poll_fit(&mut self) {
        let Some(fitting) = &mut self.fitting else { return };
        let share = fitting.done.load(Ordering::Relaxed) as f64 / fitting.steps as f64;
        let is_over = fitting.thread.as_ref().is_none_or(JoinHandle::is_finished);
        if !is_over {
            let share = (20.0 * share).floor() / 20.0;
            self.shared.update(|state| {
                if let Some(job) = &mut state.job {
                    job.share = Some(share.min(1.0));
                }
            });
            return;
        }
        let thread = fitting.thread.take();
        self.fitting = None;
        let result = thread.map(JoinHandle::join);
        self.shared.update(|state| state.job = None);
        match result {
            Some(Ok(Ok(calibrated))) => self.fitted(calibrated),
            Some(Ok(Err(error))) => self.shared.update(|state| state.failed = Some(error.into())),
            Some(Err(_)) | None => {
                let problem = Problem::new(
                    "the calibration",
                    "it has failed without a word",
                    "try again with other photographs, and report it",
                );
                self.shared.update(|state| state.failed = Some(problem));
            }
        }
        self.show_can();
    }

    /// Shows the camera that was fitted.
    fn fitted(&mut self, calibrated: Calibrated) {
        let Calibrated { calibration, places, concerns, .. } = &calibrated;
        let used = calibration.outcomes.iter().filter(|it| it.used().is_some()).count();
        let errors: Vec<(String, Option<f64>)> = places
            .iter()
            .zip(&calibration.outcomes)
            .map(|(place, outcome)| (place.clone(), outcome.used().map(|it| it.rms_px)))
            .collect();
        let lens = &calibration.lens;
        let numbers = [
            ("fx", lens.fx_px),
            ("fy", lens.fy_px),
            ("cx", lens.cx_px),
            ("cy", lens.cy_px),
            ("skew", lens.skew_px),
        ];
        let in_words = numbers.iter().zip(&calibration.sd);
        let in_words =
            in_words.map(|((name, value), sd)| format!("{name} {value:.2} ± {sd:.2} px"));
        let names = lens.distortion.names();
        let bends = names.iter().zip(lens.distortion.coefficients()).zip(&calibration.sd[5..]);
        let bends = bends.map(|((name, value), sd)| format!("{name} {value:.5} ± {sd:.5}"));
        let file = self.photographs.as_ref().map(|set| set.folder.join(CAMERA));
        let shown = CalibrationState {
            is_good: concerns.is_empty(),
            concerns: concerns.iter().map(|it| on_page(&it.to_string())).collect(),
            error_px: calibration.rms_px,
            used,
            photographs: places.len(),
            model: lens.distortion.name().to_owned(),
            numbers: in_words.chain(bends).collect(),
            file: file.map(|it| it.display().to_string()).unwrap_or_default(),
            is_delivered: false,
        };
        if let Some(set) = &mut self.photographs {
            set.set_errors(|file| {
                let of = errors.iter().find(|(place, _)| place.ends_with(file));
                of.and_then(|(_, error_px)| *error_px)
            });
        }
        self.shared.update(|state| state.calibration = Some(shown));
        self.calibrated = Some(calibrated);
        self.show_photographs(None);
    }
}
