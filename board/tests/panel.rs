//! The LED and the screen of a box, with files in place of the kernel's. There is only one test,
//! because it counts the heap allocations of the whole process.

use std::fs;
use std::path::Path;
use std::time::Duration;

use plumbline_board::allocation::{CountingAllocator, apart};
use plumbline_board::boot::panel::Panel;
use plumbline_board::logger::Latest;
use plumbline_board::status::Status;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;

/// More than a row's pixels, as on some screens.
const STRIDE_BYTES: usize = WIDTH * 4 + 64;

const NOW: Duration = Duration::ZERO;

/// The files of a computer with an LED and a screen, for a number of bits per pixel.
struct Computer {
    folder: tempfile::TempDir,
    bytes_per_pixel: usize,
}

impl Computer {
    fn new(bits_per_pixel: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let computer = Self { folder, bytes_per_pixel: bits_per_pixel / 8 };
        computer.write("sys/class/leds/ACT/trigger", "xxxx");
        computer.write("sys/class/leds/ACT/brightness", "x");
        computer.write("sys/class/graphics/fb0/virtual_size", &format!("{WIDTH},{HEIGHT}\n"));
        computer.write("sys/class/graphics/fb0/bits_per_pixel", &format!("{bits_per_pixel}\n"));
        computer.write("sys/class/graphics/fb0/stride", &format!("{STRIDE_BYTES}\n"));
        computer.write("sys/class/vtconsole/vtcon0/name", "(S) dummy device\n");
        computer.write("sys/class/vtconsole/vtcon0/bind", "1");
        computer.write("sys/class/vtconsole/vtcon1/name", "(M) frame buffer device\n");
        computer.write("sys/class/vtconsole/vtcon1/bind", "1");
        computer.write("dev/fb0", "");
        computer
    }

    fn root(&self) -> &str {
        self.folder.path().to_str().unwrap()
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap_or(Path::new("/"))).unwrap();
        fs::write(path, text).unwrap();
    }

    fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.folder.path().join(name)).unwrap()
    }

    fn led(&self) -> Vec<u8> {
        self.read("sys/class/leds/ACT/brightness")
    }

    /// Red, green, blue of each pixel, from the bytes as a screen takes them.
    fn pixels(&self) -> Vec<[u8; 3]> {
        let bytes = self.read("dev/fb0");
        let rows = bytes.chunks(STRIDE_BYTES).map(|row| &row[..WIDTH * self.bytes_per_pixel]);
        let pixels: Vec<[u8; 3]> = rows
            .flat_map(|row| row.chunks(self.bytes_per_pixel))
            .map(|pixel| match *pixel {
                [blue, green, red, opacity] => {
                    assert_eq!(opacity, 255);
                    [red, green, blue]
                }
                [low, high] => {
                    let word = u16::from_le_bytes([low, high]);
                    [(word >> 11) as u8 * 8, (word >> 5 & 63) as u8 * 4, (word & 31) as u8 * 8]
                }
                _ => unreachable!("pixels have 16 or 32 bits"),
            })
            .collect();
        assert_eq!(pixels.len(), WIDTH * HEIGHT);
        pixels
    }
}

fn latest(network: &str, complaint: &str) -> Latest {
    Latest {
        network: network.try_into().unwrap(),
        complaint: complaint.try_into().unwrap(),
        complained_at: Some(std::time::Instant::now()),
    }
}

/// The colour of the status' words: the only pixels that are neither black nor white.
fn status_colour(pixels: &[[u8; 3]]) -> [u8; 3] {
    let is_grey =
        |[red, green, blue]: &[u8; 3]| red.abs_diff(*green) < 9 && green.abs_diff(*blue) < 9;
    let coloured: Vec<[u8; 3]> = pixels.iter().filter(|pixel| !is_grey(pixel)).copied().collect();
    assert!(coloured.len() > 200, "only {} pixels have a colour", coloured.len());
    assert!(coloured.iter().all(|pixel| *pixel == coloured[0]), "more than one colour");
    coloured[0]
}

#[test]
fn led_and_screen_show_the_status_and_take_no_heap() {
    for (bits, green, red) in [
        (32, [64, 255, 64], [255, 72, 72]),
        // As close as five and six bits allow.
        (16, [64, 252, 64], [248, 72, 72]),
    ] {
        let computer = Computer::new(bits);
        let mut panel = Panel::new(computer.root());
        let words = latest("network: eth0 has 10.0.2.15/24", "camera: unplugged");
        panel.tick((Status::Tracking, NOW), "ward 3 (PL-0001)", Some(&words));
        assert_eq!(computer.read("sys/class/leds/ACT/trigger"), b"none");
        assert_eq!(computer.led(), b"1");
        // The kernel's console is detached from the screen, and nothing else.
        assert_eq!(computer.read("sys/class/vtconsole/vtcon0/bind"), b"1");
        assert_eq!(computer.read("sys/class/vtconsole/vtcon1/bind"), b"0");
        assert_eq!(status_colour(&computer.pixels()), green);

        // What has not changed is not drawn again.
        computer.write("dev/fb0", "mark");
        let mut show = |status| {
            let ((), counted) = apart(|| {
                for _ in 0..20 {
                    panel.tick((status, NOW), "ward 3 (PL-0001)", Some(&words));
                }
            });
            counted.count
        };
        assert_eq!(show(Status::Tracking), 0, "heap allocations");
        assert_eq!(computer.read("dev/fb0"), b"mark");
        assert_eq!(show(Status::NoCamera), 0, "heap allocations");
        assert_eq!(status_colour(&computer.pixels()), red);
    }

    // Most boxes have no screen, and search for one as long as they run.
    let nothing = tempfile::tempdir().unwrap();
    let mut panel = Panel::new(nothing.path().to_str().unwrap());
    let ((), counted) = apart(|| {
        for _ in 0..40 {
            panel.tick((Status::Tracking, NOW), "ward 3 (PL-0001)", None);
        }
    });
    assert_eq!(counted.count, 0, "heap allocations");
}
