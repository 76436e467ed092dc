//! A screen at the computer's HDMI socket: the kernel's frame buffer `/dev/fb0`.
//!
//! It is there if a screen was on when the power was switched on. Its rows are written as to
//! a file. The kernel's own console, which would write over the picture, is taken off it.

use std::fs::File;
use std::io::Result;
use std::os::unix::fs::FileExt;

use super::files::Root;
use super::picture::{CANVAS_HEIGHT_MAX, CANVAS_WIDTH_MAX, Canvas, Ink, Shown};

/// Smaller ones have no room for letters.
const WIDTH_MIN: usize = 160;
const HEIGHT_MIN: usize = 120;

/// No screen is larger than this, either way.
const SIDE_MAX: usize = 8192;

/// Of a pixel.
const BYTES_MAX: usize = 4;

/// The consoles that a kernel may have: on the frame buffer, on a card, on nothing.
const CONSOLES: u32 = 16;

/// The screen, as soon as there is one.
pub struct Screen<'a> {
    root: Root<'a>,
    open: Option<FrameBuffer>,
    canvas: Canvas,
    /// One row of the frame buffer.
    row: Vec<u8>,
    /// What it shows.
    shown: Option<Shown>,
    /// That it is of no use has been said.
    is_refused: bool,
}

struct FrameBuffer {
    device: File,
    geometry: Geometry,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Geometry {
    width: usize,
    height: usize,
    bits_per_pixel: usize,
    stride_bytes: usize,
}

impl Geometry {
    fn read(root: Root<'_>) -> Option<Self> {
        let value = |name: &str| root.read(format_args!("/sys/class/graphics/fb0/{name}"));
        let size = value("virtual_size")?;
        let (width, height) = size.split_once(',')?;
        Some(Self {
            width: width.parse().ok()?,
            height: height.parse().ok()?,
            bits_per_pixel: value("bits_per_pixel")?.parse().ok()?,
            stride_bytes: value("stride")?.parse().ok()?,
        })
    }

    fn is_usable(&self) -> bool {
        (WIDTH_MIN..=SIDE_MAX).contains(&self.width)
            && (HEIGHT_MIN..=SIDE_MAX).contains(&self.height)
            && matches!(self.bits_per_pixel, 16 | 32)
            && (self.width * self.bits_per_pixel / 8..=2 * SIDE_MAX * BYTES_MAX)
                .contains(&self.stride_bytes)
    }

    /// How many times a pixel of the canvas is enlarged.
    fn factor(&self) -> usize {
        self.width.div_ceil(CANVAS_WIDTH_MAX).max(self.height.div_ceil(CANVAS_HEIGHT_MAX))
    }

    /// Appends a pixel to a row.
    fn push(&self, row: &mut Vec<u8>, ink: Ink) {
        let [red, green, blue] = ink.rgb();
        if self.bits_per_pixel == 16 {
            let (red, green, blue) = (u16::from(red), u16::from(green), u16::from(blue));
            row.extend_from_slice(&(red >> 3 << 11 | green >> 2 << 5 | blue >> 3).to_le_bytes());
        } else {
            // The last byte is the opacity, which some screens' firmware honours.
            row.extend_from_slice(&[blue, green, red, 255]);
        }
    }
}

impl<'a> Screen<'a> {
    pub fn new(root: Root<'a>) -> Self {
        Self {
            root,
            open: None,
            canvas: Canvas::new(),
            row: Vec::with_capacity(SIDE_MAX * BYTES_MAX),
            shown: None,
            is_refused: false,
        }
    }

    /// Takes the screen, if it is not taken yet and one has appeared.
    pub fn look(&mut self) {
        if self.open.is_some() {
            return;
        }
        let Some(geometry) = Geometry::read(self.root) else { return };
        if !geometry.is_usable() {
            if !std::mem::replace(&mut self.is_refused, true) {
                let Geometry { width, height, bits_per_pixel, stride_bytes } = geometry;
                log::info!(
                    "the screen stays as it is: it has {width} x {height} pixels of \
                     {bits_per_pixel} bits in rows of {stride_bytes} bytes, and \
                     {WIDTH_MIN} x {HEIGHT_MIN} to {SIDE_MAX} x {SIDE_MAX} of 16 or 32 can be used"
                );
            }
            return;
        }
        let Ok(device) = self.root.open_to_write(format_args!("/dev/fb0")) else { return };
        take_console_off(self.root);
        let factor = geometry.factor();
        self.canvas.resize(geometry.width / factor, geometry.height / factor);
        self.open = Some(FrameBuffer { device, geometry });
        self.shown = None;
    }

    /// Draws the picture, unless it is there already.
    pub fn show(&mut self, shown: &Shown) {
        if self.shown.as_ref() == Some(shown) {
            return;
        }
        let Some(FrameBuffer { device, geometry }) = &self.open else { return };
        self.canvas.draw(shown);
        if write(device, geometry, &self.canvas, &mut self.row).is_ok() {
            self.shown = Some(shown.clone());
        } else {
            self.open = None;
        }
    }
}

/// Writes the canvas, enlarged, and black where it does not reach.
fn write(device: &File, geometry: &Geometry, canvas: &Canvas, row: &mut Vec<u8>) -> Result<()> {
    let factor = geometry.factor();
    let mut below = 0..geometry.height;
    for inks in canvas.rows() {
        fill(row, geometry, inks.iter().flat_map(|&ink| std::iter::repeat_n(ink, factor)));
        for y in below.by_ref().take(factor) {
            device.write_all_at(row, (y * geometry.stride_bytes) as u64)?;
        }
    }
    fill(row, geometry, std::iter::empty());
    below.try_for_each(|y| device.write_all_at(row, (y * geometry.stride_bytes) as u64))
}

/// Makes a whole row, black at its end. It stays within the memory that the row has.
fn fill(row: &mut Vec<u8>, geometry: &Geometry, inks: impl Iterator<Item = Ink>) {
    row.clear();
    for ink in inks.chain(std::iter::repeat(Ink::Paper)).take(geometry.width) {
        geometry.push(row, ink);
    }
}

fn take_console_off(root: Root<'_>) {
    for number in 0..CONSOLES {
        let folder = format_args!("/sys/class/vtconsole/vtcon{number}/");
        let name = root.read(format_args!("{folder}name"));
        if name.is_some_and(|name| name.contains("frame buffer device")) {
            // One that does not let go writes over the picture, which is still seen.
            let _ = root.write(format_args!("{folder}bind"), "0");
        }
    }
}
