//! The frames: rendered on all cores, written in order.

use std::io::{ErrorKind, Write};

use anyhow::{Context, Result};
use plumbline_render::simulate::Simulation;
use plumbline_render::simulate::recorded::frame_rate;
use rayon::prelude::*;

/// Frames rendered at a time, per core: enough to keep every core busy, few
/// enough that the box gets frames in a steady stream.
const BATCH_PER_CORE: usize = 2;

/// Writes the person's frames as Y4M. A reader that has gone away ends it
/// without an error: whoever waits for the reader knows more.
pub fn feed(simulation: &Simulation, frames: u64, sink: impl Write) -> Result<()> {
    match write_frames(simulation, frames, sink) {
        Err(y4m::Error::IoError(error)) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        result => result.context("the frames cannot be handed to the box"),
    }
}

fn write_frames(simulation: &Simulation, frames: u64, sink: impl Write) -> Result<(), y4m::Error> {
    let camera = simulation.camera();
    let rate = frame_rate(simulation.settings().frame_rate_hz);
    let mut encoder =
        y4m::encode(usize::from(camera.width_px), usize::from(camera.height_px), rate)
            .with_colorspace(y4m::Colorspace::Cmono)
            .write_header(sink)?;
    let batch = BATCH_PER_CORE * rayon::current_num_threads();
    let mut pictures = vec![Vec::<u8>::new(); batch];
    for first in (0..frames).step_by(batch) {
        let count = (frames - first).min(batch as u64) as usize;
        pictures[..count]
            .par_iter_mut()
            .enumerate()
            .for_each(|(index, picture)| simulation.render(first + index as u64, picture));
        for picture in &pictures[..count] {
            encoder.write_frame(&y4m::Frame::new([picture, &[], &[]], None))?;
        }
    }
    Ok(())
}
