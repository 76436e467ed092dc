//! Recordings as a source: their frames, and the messages about bad recordings.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use plumbline_board::source::rate::Rate;
use plumbline_board::source::replay::{Input, Pace, Replay};
use plumbline_board::source::{Frame, FrameSource, Next, Pixels};
use tempfile::TempDir;

/// Nothing here takes longer; a test that waits this long has failed.
const PATIENCE: Duration = Duration::from_secs(20);

const SIZE_PX: (usize, usize) = (80, 64);

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

/// Every pixel of frame `index` has the value `index`; chroma, if there is any, is 255.
fn recording(folder: &TempDir, name: &str, space: y4m::Colorspace, frames: u8) -> PathBuf {
    let path = folder.path().join(name);
    let file = std::fs::File::create(&path).unwrap();
    let mut encoder = y4m::encode(SIZE_PX.0, SIZE_PX.1, y4m::Ratio::new(100, 1))
        .with_colorspace(space)
        .write_header(file)
        .unwrap();
    let chroma = match space {
        y4m::Colorspace::Cmono => vec![],
        _ => vec![255; SIZE_PX.0 * SIZE_PX.1 / 4],
    };
    for index in 0..frames {
        let luma = vec![index; SIZE_PX.0 * SIZE_PX.1];
        encoder.write_frame(&y4m::Frame::new([&luma, &chroma, &chroma], None)).unwrap();
    }
    path
}

fn open(path: &Path, pace: Pace) -> anyhow::Result<Replay> {
    let stop = AtomicBool::new(false);
    Replay::open(&Input::from(path), pace, None, &stop).map(|replay| replay.expect("not stopped"))
}

struct Seen {
    value: u8,
    time_ns: u64,
    ready_at: Instant,
    late: bool,
}

/// The one grey value of the whole frame.
fn value(frame: &Frame<'_>) -> u8 {
    let Pixels::Grey8(image) = frame.pixels else { panic!("{frame:?}") };
    assert_eq!((image.width(), image.height()), SIZE_PX);
    let value = image.row(0)[0];
    assert!((0..image.height()).all(|y| image.row(y).iter().all(|other| *other == value)));
    value
}

/// All frames, and the message if the source failed.
fn replay_all(
    replay: &mut Replay,
    mut after_each: impl FnMut(usize),
) -> (Vec<Seen>, Option<String>) {
    let give_up = Instant::now() + PATIENCE;
    let mut seen = Vec::new();
    loop {
        assert!(Instant::now() < give_up, "the recording never ended");
        match replay.next(Instant::now() + Duration::from_millis(100)) {
            Next::Frame(frame) => {
                seen.push(Seen {
                    value: value(&frame),
                    time_ns: frame.capture_time_ns,
                    ready_at: frame.ready_at,
                    late: frame.late,
                });
                after_each(seen.len());
            }
            Next::Quiet => {}
            Next::End => return (seen, None),
            Next::Broken(message) => return (seen, Some(message)),
        }
    }
}

#[test]
fn luma_comes_out_in_order_with_exact_times() {
    let folder = folder();
    for (name, space) in [("mono.y4m", y4m::Colorspace::Cmono), ("420.y4m", y4m::Colorspace::C420)]
    {
        let path = recording(&folder, name, space, 7);
        let mut replay = open(&path, Pace::Unpaced).unwrap();
        assert_eq!(replay.size_px(), SIZE_PX);
        let (seen, broken) = replay_all(&mut replay, |_| {});
        assert_eq!(broken, None);
        assert_eq!(seen.iter().map(|frame| frame.value).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
        assert!(
            seen.iter()
                .enumerate()
                .all(|(index, frame)| frame.time_ns == index as u64 * 10_000_000)
        );
    }
}

#[test]
fn a_given_rate_replaces_the_headers() {
    let folder = folder();
    let path = recording(&folder, "a.y4m", y4m::Colorspace::Cmono, 3);
    let stop = AtomicBool::new(false);
    let rate = Rate::new(25, 1);
    let mut replay =
        Replay::open(&Input::from(path.as_path()), Pace::Unpaced, rate, &stop).unwrap().unwrap();
    let (seen, _) = replay_all(&mut replay, |_| {});
    assert_eq!(seen[2].time_ns, 80_000_000);
}

#[test]
fn a_paced_replay_keeps_to_its_deadlines_and_skips_nothing() {
    let folder = folder();
    let path = recording(&folder, "a.y4m", y4m::Colorspace::Cmono, 20);
    let mut replay = open(&path, Pace::Recorded).unwrap();
    // The first frame's work takes four periods: deadlines 1 to 3 pass meanwhile.
    let (seen, _) = replay_all(&mut replay, |count| {
        if count == 1 {
            std::thread::sleep(Duration::from_millis(45));
        }
    });
    assert_eq!(seen.len(), 20);
    // Frames 1 and 2 were due at 10 and 20 ms, their successors at 20 and 30 ms.
    assert!(seen[1].late && seen[2].late);
    // The deadlines are absolute: if those 45 ms were added, no later frame would be due at
    // a multiple of 10 ms. (On a busy machine single frames may arrive after theirs.)
    let on_time = |index: usize| {
        seen[index].ready_at - seen[0].ready_at == Duration::from_millis(10) * index as u32
    };
    assert!((10..20).any(on_time), "every frame is owed late");
}

#[test]
fn an_impatient_caller_gets_its_time_back() {
    let folder = folder();
    let path = recording(&folder, "a.y4m", y4m::Colorspace::Cmono, 2);
    let stop = AtomicBool::new(false);
    // One frame in 100 s: the second is not due within this test.
    let rate = Rate::new(1, 100);
    let mut replay =
        Replay::open(&Input::from(path.as_path()), Pace::Recorded, rate, &stop).unwrap().unwrap();
    let first =
        (0..100).find_map(|_| match replay.next(Instant::now() + Duration::from_millis(50)) {
            Next::Frame(frame) => Some(value(&frame)),
            _ => None,
        });
    assert_eq!(first, Some(0));
    let asked = Instant::now();
    assert!(matches!(replay.next(asked + Duration::from_millis(20)), Next::Quiet));
    assert!(asked.elapsed() < PATIENCE);
}

#[test]
fn a_truncated_recording_gives_all_that_is_whole_and_then_says_where_it_breaks_off() {
    let folder = folder();
    let path = recording(&folder, "short.y4m", y4m::Colorspace::Cmono, 4);
    let whole = std::fs::read(&path).unwrap();
    let frame_bytes = SIZE_PX.0 * SIZE_PX.1;
    // Within frame 3's pixels; within its FRAME line; after the line; one byte short.
    for missing in [100, frame_bytes + 3, frame_bytes, 1] {
        std::fs::write(&path, &whole[..whole.len() - missing]).unwrap();
        let (seen, broken) = replay_all(&mut open(&path, Pace::Unpaced).unwrap(), |_| {});
        assert_eq!(seen.len(), 3, "{missing} bytes missing");
        let message = broken.expect("a broken recording");
        assert!(message.contains("short.y4m") && message.contains("frame 3"), "{message}");
    }
    // Whole frames only: an end, not a fault.
    std::fs::write(&path, &whole[..whole.len() - frame_bytes - 6]).unwrap();
    let (seen, broken) = replay_all(&mut open(&path, Pace::Unpaced).unwrap(), |_| {});
    assert_eq!((seen.len(), broken), (3, None));
    // Damage in the middle.
    let mut damaged = whole.clone();
    let second = whole.len() - 3 * (frame_bytes + 6);
    damaged[second] = b'X';
    std::fs::write(&path, damaged).unwrap();
    let (seen, broken) = replay_all(&mut open(&path, Pace::Unpaced).unwrap(), |_| {});
    assert_eq!(seen.len(), 1);
    assert!(broken.unwrap().contains("frame 1"));
}

#[test]
fn what_is_no_recording_is_refused_with_a_reason() {
    let folder = folder();
    let path = folder.path().join("bad.y4m");
    let cases: &[(&[u8], &str)] = &[
        (b"", "empty"),
        (b"YUV4", "does not begin"),
        (b"\x89PNG\r\n\x1a\n and so on", "does not begin"),
        (b"YUV4MPEG2 H64 F30:1 Cmono\n", "width (W)"),
        (b"YUV4MPEG2 W64 F30:1 Cmono\n", "height (H)"),
        (b"YUV4MPEG2 W99999999999 H99999999999 F30:1 Cmono\n", "W99999999999"),
        (b"YUV4MPEG2 W63 H64 F30:1 Cmono\n", "W63"),
        (b"YUV4MPEG2 W-64 H64 F30:1 Cmono\n", "W-64"),
        (b"YUV4MPEG2 W64 H64 F30 Cmono\n", "header cannot be read"),
        (b"YUV4MPEG2 W64 H64 F0:0 Cmono\n", "--fps"),
        (b"YUV4MPEG2 W64 H64 F30:1 Crgb\n", "colour space"),
        (b"YUV4MPEG2 W64 H64 F30:1 C420p10\n", "10 bits"),
        (b"YUV4MPEG2 W64 H64 F30:1 C\xff\xfe\n", "plain text"),
    ];
    for (bytes, expected) in cases {
        std::fs::write(&path, bytes).unwrap();
        let message = format!("{:#}", open(&path, Pace::Unpaced).map(|_| ()).unwrap_err());
        assert!(message.contains(expected) && message.contains("bad.y4m"), "{message}");
    }
    let endless = vec![b' '; 1 << 20];
    std::fs::write(&path, [b"YUV4MPEG2 ", endless.as_slice()].concat()).unwrap();
    assert!(open(&path, Pace::Unpaced).is_err());
    let absent = folder.path().join("absent.y4m");
    let message = format!("{:#}", open(&absent, Pace::Unpaced).map(|_| ()).unwrap_err());
    assert!(message.contains("absent.y4m"), "{message}");
    let message = format!("{:#}", open(folder.path(), Pace::Unpaced).map(|_| ()).unwrap_err());
    assert!(message.contains(folder.path().to_str().unwrap()), "{message}");
}
