//! Rendered frames as Y4M.

use std::fs::File;
use std::io::{self, Write};

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline::lens::Lens;
use plumbline_files::BadInput;
use plumbline_render::simulate::recorded::{Form, frame_rate};

/// A video that is to be rendered and written.
pub(super) struct Video {
    /// Width and height.
    size_px: [usize; 2],
    rate_hz: f64,
    form: Form,
    frames: u64,
}

impl Video {
    /// A video by this camera.
    pub(super) fn of(lens: &Lens, rate_hz: f64, form: Form, frames: u64) -> Self {
        let size_px = [lens.width_px, lens.height_px].map(usize::from);
        Self { size_px, rate_hz, form, frames }
    }

    /// Renders and writes; `render` overwrites the bytes of a frame's luma with those of the frame
    /// of this number, and `each` sees every frame before it is written.
    ///
    /// A reader that closes a pipe early (the box stopping, `head`) ends the run without an error.
    pub(super) fn write(
        &self,
        mut render: impl FnMut(u64, &mut Vec<u8>) -> anyhow::Result<()> + Send,
        sink: impl Write + Send,
        place: &str,
        mut each: impl FnMut(u64, &[u8]) -> anyhow::Result<()> + Send,
    ) -> anyhow::Result<()> {
        let &Self { size_px: [width, height], rate_hz, form, frames } = self;
        let encoder =
            y4m::encode(width, height, frame_rate(rate_hz)).with_colorspace(form.colorspace());
        let mut encoder = match encoder.write_header(sink) {
            Err(error) => return finished_or(error, place),
            Ok(encoder) => encoder,
        };
        let progress = ProgressBar::new(frames).with_style(
            ProgressStyle::with_template("rendering {bar:30} {pos}/{len} frames, {eta} left")
                .expect("a constant template"),
        );
        let chroma = form.chroma(width, height);
        let (mut now, mut next) = (Vec::new(), Vec::new());
        render(0, &mut now)?;
        for frame in 0..frames {
            each(frame, &now)?;
            // The next frame is rendered while this one is written.
            let (written, rendered) = rayon::join(
                || encoder.write_frame(&y4m::Frame::new([&now, &chroma, &chroma], None)),
                || if frame + 1 < frames { render(frame + 1, &mut next) } else { Ok(()) },
            );
            rendered?;
            if let Err(error) = written {
                progress.abandon();
                return finished_or(error, place);
            }
            std::mem::swap(&mut now, &mut next);
            progress.inc(1);
        }
        progress.finish_and_clear();
        Ok(())
    }
}

/// Standard output without the standard library's line buffer: a frame is passed on whole, at once.
pub(super) fn standard_output() -> anyhow::Result<File> {
    #[cfg(unix)]
    let stdout = std::os::fd::AsFd::as_fd(&io::stdout()).try_clone_to_owned();
    #[cfg(windows)]
    let stdout = std::os::windows::io::AsHandle::as_handle(&io::stdout()).try_clone_to_owned();
    Ok(File::from(stdout.context("standard output")?))
}

/// Nothing wrong when the reader of a pipe has had enough.
fn finished_or(error: y4m::Error, place: &str) -> anyhow::Result<()> {
    match error {
        y4m::Error::IoError(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        y4m::Error::IoError(error) => Err(BadInput::io(place, &error).into()),
        error => Err(anyhow::Error::new(error).context(format!("{place}: cannot be written"))),
    }
}
