use std::io::Write;

use super::*;

/// `frames` mono frames of 64 x 64 px, frame n filled with n.
fn y4m(frames: u8, header: &str) -> Vec<u8> {
    let mut bytes = format!("YUV4MPEG2 {header}\n").into_bytes();
    for frame in 0..frames {
        bytes.extend(b"FRAME\n");
        bytes.extend([frame; 64 * 64]);
    }
    bytes
}

fn file(directory: &tempfile::TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = directory.path().join(name);
    File::create(&path).unwrap().write_all(bytes).unwrap();
    path
}

/// Every sample of a 16-bit frame has this value.
fn assert_all(frame: Frame<'_>, value: u16) {
    let Pixels::Grey16(samples) = frame.pixels else { panic!("an 8-bit frame") };
    assert_eq!(samples.len(), frame.width * frame.height);
    assert_eq!(samples.iter().find(|&&sample| sample != value), None);
}

/// All frames' first samples and times, and how the source ended.
fn drain(inputs: &[PathBuf], rate_hz: Option<f64>) -> (Vec<(u16, u64)>, Result<(), BadInput>) {
    let mut frames = Vec::new();
    let mut source = match FrameSource::open(inputs, rate_hz) {
        Ok(source) => source,
        Err(error) => return (frames, Err(error)),
    };
    loop {
        match source.next_frame() {
            Ok(Some(frame)) => {
                let (first, count) = match frame.pixels {
                    Pixels::Grey8(samples) => (u16::from(samples[0]), samples.len()),
                    Pixels::Grey16(samples) => (samples[0], samples.len()),
                };
                assert_eq!(count, frame.width * frame.height);
                frames.push((first, frame.capture_time_ns));
            }
            Ok(None) => return (frames, Ok(())),
            Err(error) => return (frames, Err(error)),
        }
    }
}

const MONO: &str = "W64 H64 F50:1 Cmono";

#[test]
fn videos_follow_each_other_at_the_headers_rate() {
    let directory = tempfile::tempdir().unwrap();
    let one = file(&directory, "1.y4m", &y4m(2, MONO));
    let two = file(&directory, "2.y4m", &y4m(1, MONO));
    let (frames, end) = drain(&[one.clone(), two], None);
    assert_eq!(frames, [(0, 0), (1, 20_000_000), (0, 40_000_000)]);
    assert_eq!(end, Ok(()));
    assert_eq!(drain(std::slice::from_ref(&one), Some(100.0)).0[1].1, 10_000_000);
    assert_eq!(FrameSource::open(&[one], None).unwrap().count_hint(), Some(2));
}

#[test]
fn colour_gives_its_luma_and_deep_samples_keep_their_bits() {
    let directory = tempfile::tempdir().unwrap();
    let mut colour = b"YUV4MPEG2 W64 H66 F30:1 C420jpeg\n".to_vec();
    for luma in [7, 9] {
        colour.extend(b"FRAME Ip\n");
        colour.extend([luma; 64 * 66]);
        colour.extend([128; 32 * 33 * 2]);
    }
    let path = file(&directory, "colour.y4m", &colour);
    let (frames, end) = drain(&[path], None);
    assert_eq!((frames.len(), frames[1].0, end), (2, 9, Ok(())));

    let mut deep = b"YUV4MPEG2 W64 H64 F30:1 C420p10\nFRAME\n".to_vec();
    deep.extend([0x34, 0x02].repeat(64 * 64 + 2 * 32 * 32));
    let path = file(&directory, "deep.y4m", &deep);
    let mut source = FrameSource::open(&[path], None).unwrap();
    let frame = source.next_frame().unwrap().unwrap();
    assert_eq!(frame.white_level, 1023);
    assert_all(frame, 0x234);
}

#[test]
fn a_truncated_video_gives_its_complete_frames_and_then_the_place_of_the_cut() {
    let directory = tempfile::tempdir().unwrap();
    let whole = y4m(3, MONO);
    for cut in [1, 100, 64 * 64, 64 * 64 + 5] {
        let path = file(&directory, "cut.y4m", &whole[..whole.len() - cut]);
        let (frames, end) = drain(&[path], None);
        assert_eq!(frames.len(), 2, "{cut}");
        let error = end.unwrap_err();
        assert_eq!(error.field, "frame 2");
        let got = 64 * 64 + 6 - cut;
        assert_eq!(error.found, format!("the file ends {got} bytes into this frame of 4102 bytes"));
    }
    let path = file(&directory, "none.y4m", &y4m(0, MONO));
    assert!(drain(&[path], None).1.unwrap_err().found.contains("not one frame"));
    let mut broken = whole.clone();
    let second_frame = whole.len() - 2 * (64 * 64 + 6);
    broken[second_frame] = b'X';
    let path = file(&directory, "broken.y4m", &broken);
    let (frames, end) = drain(&[path], None);
    assert_eq!((frames.len(), end.unwrap_err().field.as_str()), (1, "frame 1"));
}

#[test]
fn absurd_headers_are_refused_without_allocating() {
    let directory = tempfile::tempdir().unwrap();
    let cases = [
        ("W99999999999 H99999999999 F30:1 Cmono", "header, W and H"),
        ("W18446744073709551615 H2 F30:1 Cmono", "header, W and H"),
        ("W99999999999999999999 H64 F30:1", "header, W"),
        ("W5000 H64 F30:1", "header, W and H"),
        ("W0 H0 F30:1", "header, W and H"),
        ("W-3 H64 F30:1", "header, W"),
        ("H64 F30:1", "header, W"),
        ("W64 H64 F30:0 Cmono", "header, F"),
        ("W64 H64 F0:0 Cmono", "header, F"),
        ("W64 H64 Fxx Cmono", "header"),
        ("W64 H64 F30:1 C411", "header, C"),
    ];
    for (header, field) in cases {
        let path = file(&directory, "h.y4m", &y4m(1, header));
        assert_eq!(drain(&[path], None).1.unwrap_err().field, field, "{header}");
    }
    let path = file(&directory, "h.y4m", &y4m(1, "W64 H64 F30:0 Cmono"));
    assert_eq!(drain(&[path], Some(60.0)).1, Ok(()));
    let mut endless = b"YUV4MPEG2 W64 ".to_vec();
    endless.extend([b'X'; 5000]);
    let path = file(&directory, "h.y4m", &endless);
    assert_eq!(drain(&[path], None).1.unwrap_err().field, "header");
}

#[test]
fn images_are_read_in_order_and_as_deep_as_they_are() {
    let directory = tempfile::tempdir().unwrap();
    let mut paths = Vec::new();
    for (name, value) in [("b.png", 10_u8), ("a.pgm", 20)] {
        let path = directory.path().join(name);
        image::GrayImage::from_pixel(80, 64, image::Luma([value])).save(&path).unwrap();
        paths.push(path);
    }
    let (frames, end) = drain(&paths, Some(10.0));
    assert_eq!(frames, [(10, 0), (20, 100_000_000)]);
    assert_eq!(end, Ok(()));

    let path = directory.path().join("deep.png");
    let deep = image::ImageBuffer::from_pixel(80, 64, image::Luma([40_000_u16]));
    deep.save(&path).unwrap();
    let mut source = FrameSource::open(&[path], None).unwrap();
    let frame = source.next_frame().unwrap().unwrap();
    assert_eq!(frame.white_level, 65_535);
    assert_all(frame, 40_000);

    let mut ten_bits = b"P5 64 64 1023\n".to_vec();
    ten_bits.extend([0x02, 0x34].repeat(64 * 64));
    let path = file(&directory, "ten.pgm", &ten_bits);
    let mut source = FrameSource::open(&[path], None).unwrap();
    let frame = source.next_frame().unwrap().unwrap();
    // The decoder stretches what a PGM's header calls white to the full range.
    assert_eq!(frame.white_level, 65_535);
    assert_all(frame, 36_131);
}

#[test]
fn inputs_that_cannot_be_frames_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let found = |inputs: &[PathBuf]| drain(inputs, None).1.unwrap_err().found;
    assert_eq!(found(&[]), "no input was given");
    assert_eq!(found(&[directory.path().to_owned()]), "a directory");
    assert!(found(&[directory.path().join("missing.png")]).contains("no such file"));
    assert!(found(&[file(&directory, "empty.png", b"")]).starts_with("empty"));
    assert!(found(&[file(&directory, "text.png", b"hello")]).starts_with("neither"));
    let png = directory.path().join("whole.png");
    image::GrayImage::new(80, 64).save(&png).unwrap();
    let bytes = std::fs::read(&png).unwrap();
    let cut = file(&directory, "cut.png", &bytes[..bytes.len() / 2]);
    assert!(found(&[cut]).starts_with("cannot be decoded"));
    let large = file(&directory, "large.pgm", b"P5 60000 60000 255\n");
    assert_eq!(found(&[large]), "60000 x 60000 px");
    let other = directory.path().join("other.png");
    image::GrayImage::new(64, 80).save(&other).unwrap();
    let (frames, end) = drain(&[png, other], None);
    assert_eq!(frames.len(), 1);
    let error = end.unwrap_err();
    assert_eq!(error.field, "frame size");
    assert!(error.found.contains("64 x 80") && error.found.contains("80 x 64"), "{error}");
    let rate = drain(&[directory.path().join("whole.png")], Some(0.0)).1.unwrap_err();
    assert_eq!(rate.place, "--fps");
    // Several commands have this option.
    assert!(!rate.to_string().contains("plumb track"), "{rate}");
}
