//! The configuration that a box is given.
//!
//! The first byte chooses whether the rest is a blob, or the body of one, around which the law puts a
//! right head and checksum.
//!
//! Laws: what is decoded is sound; it is encoded to the same bytes or, if a number was written in more
//! bytes than it needs, to the bytes of the same configuration; a pipeline takes it, and answers a frame,
//! unless its lens cannot be tabulated, which only the table tells; the box decides whether it can use it
//! without a panic, and takes none that its pipeline refuses.

use plumbline::config::{BLOB_BYTES_MAX, Config, ConfigError, FORMAT_VERSION};
use plumbline::image::GreyImage;
use plumbline::lens::LensError;
use plumbline::packet::document_crc;
use plumbline::pipeline::Pipeline;
use plumbline_board::equipment::Equipment;
use plumbline_stream::fixture;

/// Magic, version and length.
const HEADER_BYTES: usize = 10;

/// A frame of at most this many pixels is given to the pipeline as well.
const PIXELS_MAX: usize = 160 * 120;

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let Some((way, rest)) = bytes.split_first() else { return };
    if way % 2 == 0 {
        decoded(rest);
    } else {
        decoded(&around(rest));
    }
}

/// A blob with a right head and checksum.
fn around(body: &[u8]) -> Vec<u8> {
    let mut blob = good(&fixture::config())[..4].to_vec();
    blob.extend(FORMAT_VERSION.to_le_bytes());
    blob.extend((body.len() as u32).to_le_bytes());
    blob.extend(body);
    blob.extend(document_crc(&blob).to_le_bytes());
    blob
}

fn good(config: &Config) -> Vec<u8> {
    let mut buffer = vec![0; BLOB_BYTES_MAX];
    config.encode(&mut buffer).expect("a sound configuration").to_vec()
}

fn decoded(blob: &[u8]) {
    let Ok(config) = Config::decode(blob) else { return };
    config.check().expect("what is decoded is sound");
    let again = good(&config);
    assert!(again.len() <= blob.len(), "{} bytes became {}", blob.len(), again.len());
    if again.len() == blob.len() {
        assert_eq!(again, blob, "it is encoded to other bytes");
        assert_eq!(config.crc().to_le_bytes(), blob[blob.len() - 4..], "it has another checksum");
    }
    assert_eq!(Config::decode(&again).as_ref(), Ok(&config), "it is decoded to something else");
    let equipment = Equipment::of(&config);
    let mut pipeline = Box::new(Pipeline::new());
    if let Err(error) = pipeline.configure(&config) {
        let of_table = ConfigError::Lens(LensError::Table);
        assert!(error == of_table || error == ConfigError::Lens(LensError::Folds), "{error}");
        assert!(equipment.is_err(), "a box takes what its pipeline refuses: {error}");
        return;
    }
    let [width, height] = [config.lens.width_px, config.lens.height_px].map(usize::from);
    if width * height <= PIXELS_MAX {
        let pixels = vec![90_u8; width * height];
        let frame = GreyImage::new(&pixels, width, height, width).expect("its own size");
        let report = pipeline.step(&frame, 0);
        assert_eq!(report.targets.len(), config.targets.len());
        assert!(report.targets.iter().all(|target| target.measurement.is_err()), "a grey wall");
    }
}

/// The standard configuration, and others with everything that one can have.
pub fn seeds() -> Vec<Vec<u8>> {
    use plumbline::config::{Edges, Marked, Network, TriggerInput, TriggerLines, TriggerOutput};
    let plain = fixture::config();
    let mut full = plain.clone();
    full.device = "ward 3".try_into().expect("it is short");
    full.machine.realtime_priority = Some(50);
    full.machine.network =
        Network::Static { address: [10, 0, 0, 2].into(), prefix_bits: 24, gateway: None };
    full.trigger = Some(TriggerLines {
        chip: "gpiochip0".try_into().expect("it is short"),
        input: Some(TriggerInput { line: 17, edges: Edges::Both, debounce_us: 100 }),
        output: Some(TriggerOutput { line: 27, marks: Marked::Exposures }),
    });
    let mut small = plain.clone();
    small.capture = None;
    small.cam_from_scene_theta = None;
    small.lens = plumbline_files::camera::stand_in(128, 96);
    let mut seeds = Vec::new();
    for config in [plain, full, small] {
        let Ok(()) = config.check() else { continue };
        let blob = good(&config);
        seeds.push([&[0], &blob[..]].concat());
        seeds.push([&[1], &blob[HEADER_BYTES..blob.len() - 4]].concat());
    }
    seeds
}
