//! Tracks the standard recording and prints its poses, with every digit. `cargo xtask test arm`
//! runs this here and in an emulator, and compares.

use std::fmt;

use plumbline_bare_metal::{write_header, write_rows};
use plumbline_test_support::STANDARD_FRAMES;
use recorded::{FRAME_NS, Recorded};

fn main() -> fmt::Result {
    let recorded = Recorded::read(STANDARD_FRAMES);
    let mut pipeline = recorded.pipeline();
    let mut table = String::new();
    write_header(&mut table)?;
    for (number, pixels) in (0..).zip(&recorded.frames) {
        let report = pipeline.step(&recorded.view(pixels), u64::from(number) * FRAME_NS);
        write_rows(&mut table, number, &recorded.config, &report)?;
    }
    print!("{table}");
    Ok(())
}
