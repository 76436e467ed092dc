//! How the USB camera describes itself: the tables of the standards, byte by byte.
//!
//! The camera is a device with two interfaces, one that controls (a sensor and its output) and one
//! that streams (one format of one size and one rate, over a bulk endpoint). The tables are those
//! of USB 2.0, chapter 9, of USB Video Class 1.0, chapter 3, and of its payload formats.

use anyhow::{Result, bail};

use crate::camera::{HEIGHT_PX, WIDTH_PX};
use crate::usb_camera::{INTERVAL, RATE_HZ};

const DEVICE: u8 = 1;
const CONFIGURATION: u8 = 2;
const STRING: u8 = 3;
const INTERFACE: u8 = 4;
const ENDPOINT: u8 = 5;
const ASSOCIATION: u8 = 11;
/// A table of the class.
const CLASS: u8 = 0x24;
/// The class itself, and its two kinds of interfaces.
const VIDEO: u8 = 14;
const CONTROLS: u8 = 1;
const STREAMS: u8 = 2;

const ENDPOINT_IN: u8 = 0x81;

/// A packet of the bulk endpoint, at high speed.
const PACKET_BYTES: u16 = 512;

/// For testing only, of a list for projects that have no number of their own (pid.codes).
const MAKER_AND_PRODUCT: [u16; 2] = [0x1209, 0x0001];

/// The end of a format's identifier, where its beginning is the kernel's code.
const AFTER_CODE: [u8; 12] = [0, 0, 0x10, 0, 0x80, 0, 0, 0xAA, 0, 0x38, 0x9B, 0x71];

/// The identifier of BGR.
const BGR: [u8; 16] =
    [0x7D, 0xEB, 0x36, 0xE4, 0x4F, 0x52, 0xCE, 0x11, 0x9F, 0x53, 0, 0x20, 0xAF, 0x0B, 0xA7, 0x70];

/// What a camera sends.
pub struct Format {
    /// The size of a frame, or of the largest where they are compressed.
    pub frame_bytes_max: u32,
    /// The identifier, and the size of a pixel; `None` for Motion JPEG.
    pixels: Option<([u8; 16], u8)>,
}

impl Format {
    /// That of the kernel's code.
    ///
    /// # Errors
    /// When it is none that is played here.
    pub fn of(code: &str) -> Result<Self> {
        let (pixels, pixel_bytes) = match code {
            "MJPG" => (None, 1),
            "BGR3" => (Some((BGR, 24)), 3),
            "BA81" => {
                let mut identifier = [0; 16];
                identifier[..4].copy_from_slice(code.as_bytes());
                identifier[4..].copy_from_slice(&AFTER_CODE);
                (Some((identifier, 8)), 1)
            }
            _ => bail!("the format {code} is not played here"),
        };
        Ok(Self { frame_bytes_max: pixel_bytes * WIDTH_PX * HEIGHT_PX, pixels })
    }
}

/// All tables.
pub struct Descriptors {
    device: Vec<u8>,
    configuration: Vec<u8>,
}

impl Descriptors {
    /// Those of a camera with this format.
    pub fn new(format: &Format) -> Self {
        Self { device: device(), configuration: configuration(format) }
    }

    /// The table of a kind, and of an index where there are several.
    pub fn get(&self, kind: u8, index: u8) -> Option<Vec<u8>> {
        match (kind, index) {
            (DEVICE, _) => Some(self.device.clone()),
            (CONFIGURATION, _) => Some(self.configuration.clone()),
            // The one language is American English.
            (STRING, 0) => Some(table(STRING, &[&[0x09, 0x04]])),
            (STRING, 1) => {
                let text: Vec<u8> =
                    "Played camera".encode_utf16().flat_map(u16::to_le_bytes).collect();
                Some(table(STRING, &[&text]))
            }
            _ => None,
        }
    }
}

/// A table: its length, its kind, its fields.
fn table(kind: u8, fields: &[&[u8]]) -> Vec<u8> {
    let fields = fields.concat();
    [&[2 + fields.len() as u8, kind], &fields[..]].concat()
}

fn device() -> Vec<u8> {
    let [maker, product] = MAKER_AND_PRODUCT.map(u16::to_le_bytes);
    table(
        DEVICE,
        &[
            // USB 2.0; interfaces that belong together say so; packets of 64 bytes for control.
            &[0x00, 0x02, 0xEF, 2, 1, 64],
            &maker,
            &product,
            // Version 1.0; no maker's name, the product's name, no number; one configuration.
            &[0x00, 0x01, 0, 1, 0, 1],
        ],
    )
}

fn configuration(format: &Format) -> Vec<u8> {
    let association = table(ASSOCIATION, &[&[0, 2, VIDEO, 3, 0, 0]]);
    let interfaces = [association, controls(), streams(format)].concat();
    let length = (9 + interfaces.len() as u16).to_le_bytes();
    // Two interfaces, number 1, no name, powered by the bus with 100 mA.
    let head = table(CONFIGURATION, &[&length, &[2, 1, 0, 0x80, 50]]);
    [head, interfaces].concat()
}

/// The interface that controls: a sensor (number 1), whose picture goes to an output (number 2).
fn controls() -> Vec<u8> {
    let interface = table(INTERFACE, &[&[0, 0, 0, VIDEO, CONTROLS, 0, 0]]);
    // Type 0x0201, no lens data, three bytes of controls, none of which is there.
    let sensor = table(CLASS, &[&[2, 1, 0x01, 0x02, 0, 0], &[0; 6], &[3, 0, 0, 0]]);
    // Type 0x0101, fed by the sensor.
    let output = table(CLASS, &[&[3, 2, 0x01, 0x01, 0, 1, 0]]);
    let length = (13 + sensor.len() as u16 + output.len() as u16).to_le_bytes();
    // Class 1.0; a clock of 1 MHz; one interface that streams, number 1.
    let clock = 1_000_000_u32.to_le_bytes();
    let head = table(CLASS, &[&[1, 0x00, 0x01], &length, &clock, &[1, 1]]);
    [interface, head, sensor, output].concat()
}

/// The interface that streams.
fn streams(of: &Format) -> Vec<u8> {
    let interface = table(INTERFACE, &[&[1, 0, 1, VIDEO, STREAMS, 0, 0]]);
    // Its one size is the default, and all frames have it.
    let (format, size_kind) = match &of.pixels {
        None => (table(CLASS, &[&[6, 1, 1, 1, 1, 0, 0, 0, 0]]), 7),
        Some((identifier, bits)) => {
            (table(CLASS, &[&[4, 1, 1], identifier, &[*bits, 1, 0, 0, 0, 0]]), 5)
        }
    };
    let bits_per_second = (8 * of.frame_bytes_max * RATE_HZ).to_le_bytes();
    let size = table(
        CLASS,
        &[
            &[size_kind, 1, 0],
            &(WIDTH_PX as u16).to_le_bytes(),
            &(HEIGHT_PX as u16).to_le_bytes(),
            // The lowest and the highest.
            &bits_per_second,
            &bits_per_second,
            &of.frame_bytes_max.to_le_bytes(),
            // The default interval, and the one that there is.
            &INTERVAL.to_le_bytes(),
            &[1],
            &INTERVAL.to_le_bytes(),
        ],
    );
    let length = (14 + format.len() as u16 + size.len() as u16).to_le_bytes();
    // One format; linked to the output; no still pictures; no controls of the format's own.
    let head = table(CLASS, &[&[1, 1], &length, &[ENDPOINT_IN, 0, 2, 0, 0, 0, 1, 0]]);
    let endpoint = table(ENDPOINT, &[&[ENDPOINT_IN, 2], &PACKET_BYTES.to_le_bytes(), &[0]]);
    [interface, head, format, size, endpoint].concat()
}
