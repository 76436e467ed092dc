//! A screen at the computer's HDMI socket: the kernel's frame buffer `/dev/fb0`.
//!
//! A Raspberry Pi's firmware creates it before the kernel starts, with `hdmi_force_hotplug=1` in
//! `config.txt` also for a screen that is plugged in later. Its rows are written like a file.
//! The kernel's own console, which would write over the picture, is detached from it.

use std::fs::File;
use std::io::Result;
use std::os::unix::fs::FileExt;

use super::files::Root;
use super::picture::{CANVAS_HEIGHT_MAX, CANVAS_WIDTH_MAX, Canvas, Ink, Shown};

/// Smaller screens have no room for the text.
const WIDTH_MIN: usize = 160;
const HEIGHT_MIN: usize = 120;

/// No screen is wider or higher than this.
const SIDE_MAX: usize = 8192;

/// Bytes of a pixel, at most.
const BYTES_MAX: usize = 4;

/// The largest number of consoles that a kernel may have: on the frame buffer, on a card, on
/// nothing.
const CONSOLES: u32 = 16;

/// The screen, as soon as there is one.
pub struct Screen<'a> {
    root: Root<'a>,
    open: Option<FrameBuffer>,
    canvas: Canvas,
    /// One row of the frame buffer.
    row: Vec<u8>,
    /// What it shows now.
    shown: Option<Shown>,
    /// It cannot be used, and that has been logged.
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

    /// Opens the screen, if one has appeared and none is open yet.
    pub fn look(&mut self) {
        if self.open.is_some() {
            return;
        }
        let Some(geometry) = Geometry::read(self.root) else { return };
        if !geometry.is_usable() {
            if !std::mem::replace(&mut self.is_refused, true) {
                let Geometry { width, height, bits_per_pixel, stride_bytes } = geometry;
                log::info!(
                    "the screen cannot be used: it has {width} x {height} pixels of \
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

    /// Draws the picture, unless it is shown already.
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

/// Writes the enlarged canvas, and black around it.
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

/// Fills a whole row, black at its end. It stays within the row's capacity.
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
            // One that cannot be detached writes over the picture, which can still be seen.
            let _ = root.write(format_args!("{folder}bind"), "0");
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::status::Status;

    /// What a frame buffer holds before anything is drawn.
    const OLD: u8 = 0x55;

    /// A computer with a screen and its console; `padding` bytes follow each row's pixels.
    fn computer(width: usize, height: usize, bits: usize, padding: usize) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let stride = width * bits / 8 + padding;
        for (path, text) in [
            ("sys/class/graphics/fb0/virtual_size", format!("{width},{height}\n")),
            ("sys/class/graphics/fb0/bits_per_pixel", format!("{bits}\n")),
            ("sys/class/graphics/fb0/stride", format!("{stride}\n")),
            ("sys/class/vtconsole/vtcon0/name", "(S) dummy device\n".into()),
            ("sys/class/vtconsole/vtcon0/bind", "1".into()),
            ("sys/class/vtconsole/vtcon1/name", "(M) frame buffer device\n".into()),
            ("sys/class/vtconsole/vtcon1/bind", "1".into()),
            ("dev/fb0", String::from_utf8(vec![OLD; stride * height.min(2000)]).unwrap()),
        ] {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        folder
    }

    fn screen(folder: &tempfile::TempDir) -> Screen<'_> {
        let mut screen = Screen::new(Root::new(folder.path().to_str().unwrap()));
        screen.look();
        screen
    }

    fn pixels(folder: &Path) -> Vec<u8> {
        std::fs::read(folder.join("dev/fb0")).unwrap()
    }

    fn tracking() -> Shown {
        Shown::new("ward 3", "network: eth0", Status::Tracking, "")
    }

    const BLACK_16: [u8; 2] = [0, 0];
    const WHITE_16: [u8; 2] = [0xff, 0xff];
    /// (64, 255, 64): 01000 111111 01000.
    const GREEN_16: [u8; 2] = [0xe8, 0x47];

    /// The picture of [`tracking`] on the smallest screen, where no pixel is enlarged.
    fn small() -> Vec<[u8; 2]> {
        let folder = computer(160, 120, 16, 0);
        screen(&folder).show(&tracking());
        pixels(folder.path()).as_chunks().0.to_vec()
    }

    #[test]
    fn the_words_stand_where_they_belong_in_their_colours() {
        let picture = small();
        let part = |left: usize, top: usize, width: usize, height: usize| -> Vec<String> {
            let row = |y: usize| &picture[160 * y + left..][..width];
            let letter = |pixel: &[u8; 2]| match *pixel {
                BLACK_16 => '.',
                WHITE_16 => 'w',
                GREEN_16 => 'g',
                _ => '?',
            };
            (top..top + height).map(|y| row(y).iter().map(letter).collect()).collect()
        };
        // The first letters of `tracking`, below one line of name and one of network.
        let expected = [
            "...gg...............",
            "...gg...............",
            "...gg...............",
            ".gggggg....gg.gggg..",
            "...gg.......ggg..gg.",
            "...gg.......gg......",
            "...gg.......gg......",
            "...gg.......gg......",
            "...gg.......gg......",
            "...gg..gg...gg......",
            "....gggg....gg......",
        ];
        assert_eq!(part(5, 64, 20, 11), expected);
        // Both lines above are white, and below there is the bar alone.
        let above = part(0, 0, 160, 59);
        assert!(above.iter().all(|row| !row.contains(['g', '?'])), "{above:#?}");
        assert!(above[..30].concat().contains('w') && above[30..].concat().contains('w'));
        let bar = format!(".....{}.....", "g".repeat(150));
        assert_eq!(part(0, 81, 160, 5), [bar.as_str(); 5]);
        assert!(part(0, 86, 160, 34).concat().chars().all(|letter| letter == '.'));
    }

    #[test]
    fn pixels_are_enlarged_and_of_the_screens_depth() {
        let small = small();
        // Twice 200 x 150, and a column and a row that no pixel of the canvas fills.
        let (width, height, padding) = (401, 301, 8);
        let folder = computer(width, height, 32, padding);
        screen(&folder).show(&tracking());
        let bytes = pixels(folder.path());
        let pixel = |x: usize, y: usize| &bytes[y * (4 * width + padding) + 4 * x..][..4];
        // The bar is longer here; the words are the same.
        for (x, y) in (0..150).flat_map(|x| (0..80).map(move |y| (x, y))) {
            let expected: &[u8] = match small[160 * y + x] {
                WHITE_16 => &[255, 255, 255, 255],
                GREEN_16 => &[64, 255, 64, 255],
                _ => &[0, 0, 0, 255],
            };
            for (right, down) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                assert_eq!(pixel(2 * x + right, 2 * y + down), expected, "{x} {y}");
            }
        }
        for y in 0..height {
            assert_eq!(pixel(width - 1, y), [0, 0, 0, 255]);
            assert_eq!(bytes[y * (4 * width + padding) + 4 * width..][..padding], [OLD; 8]);
        }
        assert!((0..width).all(|x| pixel(x, height - 1) == [0, 0, 0, 255]));
    }

    #[test]
    fn nothing_is_written_while_nothing_changes() {
        let folder = computer(320, 240, 16, 0);
        let mut screen = screen(&folder);
        let device = folder.path().join("dev/fb0");
        let drawn = |screen: &mut Screen<'_>, shown: &Shown| {
            std::fs::write(&device, vec![OLD; 320 * 240 * 2]).unwrap();
            screen.look();
            screen.show(shown);
            pixels(folder.path()).iter().any(|&byte| byte != OLD)
        };
        assert!(drawn(&mut screen, &tracking()));
        assert!(!drawn(&mut screen, &tracking()));
        let lost = Shown::new("ward 3", "network: eth0", Status::Searching, "");
        assert!(drawn(&mut screen, &lost));
        assert!(drawn(&mut screen, &tracking()));
    }

    #[test]
    fn the_kernels_console_is_taken_off_the_screen_and_no_other() {
        let folder = computer(320, 240, 16, 0);
        let _ = screen(&folder);
        let bound = |name: &str| {
            let path = folder.path().join("sys/class/vtconsole").join(name).join("bind");
            std::fs::read_to_string(path).unwrap()
        };
        assert_eq!((bound("vtcon0"), bound("vtcon1")), ("1".into(), "0".into()));
    }

    #[test]
    fn a_screen_of_no_use_is_left_alone_with_its_console() {
        for (width, height, bits) in
            [(159, 120, 16), (160, 119, 16), (320, 240, 24), (320, 240, 8), (8193, 120, 32)]
        {
            let folder = computer(width, height, bits, 0);
            screen(&folder).show(&tracking());
            assert!(pixels(folder.path()).iter().all(|&byte| byte == OLD), "{width} {height}");
            let console = folder.path().join("sys/class/vtconsole/vtcon1/bind");
            assert_eq!(std::fs::read_to_string(console).unwrap(), "1");
        }
    }

    #[test]
    fn a_screen_may_appear_later() {
        let folder = computer(320, 240, 16, 0);
        let device = folder.path().join("dev/fb0");
        std::fs::remove_file(&device).unwrap();
        let mut screen = screen(&folder);
        screen.show(&tracking());
        assert!(!device.exists());
        std::fs::write(&device, [OLD]).unwrap();
        screen.look();
        screen.show(&tracking());
        assert_eq!(pixels(folder.path()).len(), 320 * 240 * 2);
    }
}
