//! Setting up a box over its link: a configuration in parts, and set-up mode.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use crate::common::pictures::{of_jpeg, of_png};
use crate::common::{
    Board, Host, PATIENCE, SIZE_PX, config, config_with_camera, folder, recording, write_config,
    write_key,
};
use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::packet::{
    Action, Document, Health, Message, PART_BYTES_MAX, Part, Picture, Refusal, ReplyOutcome, View,
    document_crc,
};

/// A running box, and a host that listens to it.
struct Bench {
    board: Board,
    host: Host,
    config: PathBuf,
    _folder: tempfile::TempDir,
}

impl Bench {
    fn start(frames: usize, more: &[&str]) -> Self {
        let folder = folder();
        let mut host = Host::udp();
        let address = host.address();
        let trial = folder.path().join("trial.y4m");
        std::fs::write(&trial, recording(frames)).unwrap();
        let config = write_config(&folder, &config());
        write_key(&config);
        let arguments = ["--replay", trial.to_str().unwrap(), "--udp", &address];
        let board = Board::start(&config, &[&arguments[..], more].concat());
        host.join();
        Self { board, host, config, _folder: folder }
    }

    fn wait_for<T>(&mut self, find: impl Fn(&Message) -> Option<T>) -> T {
        self.host.wait_for(find)
    }

    fn ask(&mut self, action: Action) -> ReplyOutcome {
        self.host.ask(action)
    }

    fn refusal(&mut self, action: Action) -> Refusal {
        match self.ask(action) {
            ReplyOutcome::Refused { refusal, .. } => refusal,
            other => panic!("{action:?} is answered {other:?}"),
        }
    }

    fn health(&mut self) -> Health {
        self.host.health()
    }

    fn fetch(&mut self, document: Document, bytes: usize) -> Vec<u8> {
        let before = self.host.heard.len();
        self.ask(Action::SendParts { document, offset: 0, bytes: bytes as u32 });
        let file = |host: &Host| {
            let mut file = vec![0; bytes];
            let mut there = 0;
            for (_, message) in &host.heard[before..] {
                if let Message::Part(part) = message
                    && part.document == document
                {
                    file[part.offset as usize..][..part.bytes.len()].copy_from_slice(&part.bytes);
                    there += part.bytes.len();
                }
            }
            (there >= bytes).then_some(file)
        };
        self.host.turn_until("the document", file)
    }

    fn send_config(&mut self, blob: &[u8]) {
        for (index, bytes) in blob.chunks(PART_BYTES_MAX).enumerate() {
            let offset = (index * PART_BYTES_MAX) as u32;
            let bytes = bytes.iter().copied().collect();
            self.host.send(&Message::Part(Part { document: Document::Config, offset, bytes }));
        }
    }
}

fn blob(config: &Config) -> Vec<u8> {
    config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().to_vec()
}

/// The configuration of a box with another name.
fn another_config() -> Config {
    Config { device: "another".try_into().unwrap(), ..config_with_camera() }
}

#[test]
fn a_configuration_is_stored_and_read_back_and_used_at_the_next_start() {
    let mut bench = Bench::start(1000, &["--supervised"]);
    let now = blob(&config());
    let answer = bench.ask(Action::QueryConfig);
    let (crc, bytes) = (config().crc(), now.len() as u32);
    assert_eq!(answer, ReplyOutcome::Config { crc, bytes, next_crc: crc });
    assert_eq!(bench.fetch(Document::Config, now.len()), now);

    // One that no box can run with: the replay's own, which names no camera.
    bench.send_config(&now);
    assert_eq!(bench.refusal(Action::StoreConfig { bytes, crc }), Refusal::Unusable);
    assert_eq!(std::fs::read(&bench.config).unwrap(), now);

    let next = another_config();
    let (bytes, crc) = (blob(&next).len() as u32, next.crc());
    bench.send_config(&blob(&next));
    let stored = bench.ask(Action::StoreConfig { bytes, crc });
    assert_eq!(stored, ReplyOutcome::Stored { crc });
    assert_eq!(std::fs::read(&bench.config).unwrap(), blob(&next));
    // Until the next start it keeps its current configuration.
    let (in_use, bytes) = (config().crc(), now.len() as u32);
    let answer = bench.ask(Action::QueryConfig);
    assert_eq!(answer, ReplyOutcome::Config { crc: in_use, bytes, next_crc: crc });
    assert_eq!(bench.ask(Action::Reboot), ReplyOutcome::Accepted);
    assert!(bench.board.wait().status.success());
}

#[test]
fn pictures_leave_the_box_in_set_up_mode_only_and_it_ends_by_itself() {
    let mut bench = Bench::start(3000, &[]);
    assert_eq!(bench.refusal(Action::TakePicture { reduction: 1 }), Refusal::NotAiming);
    let exposure = Action::Expose { exposure_us: Some(5000), gain: None };
    assert_eq!(bench.refusal(exposure), Refusal::NotAiming);
    let parts = Action::SendParts { document: Document::Picture(1), offset: 0, bytes: 10 };
    assert_eq!(bench.refusal(parts), Refusal::NotAiming);
    assert_eq!(bench.health().aiming_s, 0);

    // Longer than all that follows takes, in an emulator beside other work too.
    assert_eq!(bench.ask(Action::Aim { seconds: 60 }), ReplyOutcome::Accepted);
    assert!((1..=60).contains(&bench.health().aiming_s));
    // The exposure of a recording cannot be changed.
    assert_eq!(bench.refusal(exposure), Refusal::NotSupported);
    for reduction in [1, 2] {
        assert_eq!(bench.ask(Action::TakePicture { reduction }), ReplyOutcome::Accepted);
        let picture: Picture = bench.wait_for(|message| match message {
            Message::Picture(picture) => Some(*picture),
            _ => None,
        });
        let document = Document::Picture(picture.number);
        let file = bench.fetch(document, picture.bytes as usize);
        assert_eq!(document_crc(&file), picture.crc);
        let (samples, size) = if reduction == 1 { of_png(&file) } else { of_jpeg(&file) };
        let side = |side_px: u16| usize::from(side_px) / usize::from(reduction);
        assert_eq!(size, [side(SIZE_PX.0), side(SIZE_PX.1)]);
        // The recording's grey, which JPEG reproduces to within one level.
        assert_eq!(samples.len(), size[0] * size[1]);
        assert!(samples.iter().all(|level| level.abs_diff(90) < 2));
    }
    // The previous picture is deleted, and one that was never taken does not exist.
    assert_eq!(bench.refusal(parts), Refusal::Unusable);

    // A host that asks for one more second has that second, and no picture after it.
    let asked = Instant::now();
    assert_eq!(bench.ask(Action::Aim { seconds: 1 }), ReplyOutcome::Accepted);
    while bench.health().aiming_s > 0 {
        assert!(asked.elapsed() < PATIENCE, "it never ends");
    }
    let lasted = asked.elapsed();
    assert!(lasted >= Duration::from_secs(1), "{lasted:?}");
    assert_eq!(bench.refusal(Action::TakePicture { reduction: 1 }), Refusal::NotAiming);
    // The allocations for pictures do not count as the tracking's.
    assert_eq!(bench.health().heap_allocations, Some(0));
}

#[test]
fn a_view_tells_of_the_frame_in_numbers_in_any_mode() {
    let mut bench = Bench::start(1000, &[]);
    assert_eq!(bench.ask(Action::SendView), ReplyOutcome::Accepted);
    let view: View = bench.wait_for(|message| match message {
        Message::View(view) => Some(view.clone()),
        _ => None,
    });
    // A grey wall: no edge, no target.
    assert!((view.frame.level - 90.0 / 255.0).abs() < 1e-4, "{view:?}");
    assert_eq!((view.frame.saturated, view.frame.blur_px), (0.0, None));
    assert!(view.targets.is_empty() && view.exposure_us.is_none());
}
