//! Messages and exit codes when an input or a device is at fault.

use plumbline::config::{BLOB_BYTES_MAX, CaptureDriver, Config};
use plumbline::seal::Key;

use crate::common::{
    Board, Finished, config, config_with_camera, folder, messages, poses, write_config,
    write_recording,
};

/// Exit code 2, the expected words, and no trace of a panic.
fn assert_refused(finished: &Finished, words: &[&str]) {
    assert_eq!(finished.status.code(), Some(2), "{}", finished.stderr);
    for word in words {
        assert!(finished.stderr.contains(word), "{word:?} is not in: {}", finished.stderr);
    }
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
}

#[test]
fn a_truncated_recording_is_tracked_as_far_as_it_goes() {
    let folder = folder();
    let trial = write_recording(&folder, 8);
    let bytes = std::fs::read(&trial).unwrap();
    std::fs::write(&trial, &bytes[..bytes.len() - 10]).unwrap();
    let file = folder.path().join("packets.bin");
    let finished = Board::start(
        &write_config(&folder, &config()),
        &["--replay", trial.to_str().unwrap(), "--unpaced", "--record", file.to_str().unwrap()],
    )
    .wait();
    assert_refused(&finished, &["trial.y4m", "frame 7"]);
    assert!(finished.stdout.contains("frames       7"), "{}", finished.stdout);
    assert_eq!(poses(&messages(&std::fs::read(&file).unwrap())).len(), 7);
}

#[test]
fn bad_input_is_named_with_a_remedy() {
    let folder = folder();
    let good = write_config(&folder, &config());
    let trial = write_recording(&folder, 2);
    let trial = trial.to_str().unwrap();
    let udp = ["--udp", "127.0.0.1:9"];
    let run = |config: &std::path::Path, arguments: &[&str]| Board::start(config, arguments).wait();

    let absent = folder.path().join("absent.plb");
    assert_refused(&run(&absent, &["--replay", trial]), &["absent.plb", "cannot be read"]);

    let mut blob = std::fs::read(&good).unwrap();
    *blob.last_mut().unwrap() ^= 1;
    let damaged = folder.path().join("damaged.plb");
    std::fs::write(&damaged, blob).unwrap();
    assert_refused(&run(&damaged, &["--replay", trial]), &["damaged.plb", "plumb provision"]);
    assert_refused(&run(trial.as_ref(), &["--replay", trial]), &["trial.y4m", "plumb provision"]);

    assert_refused(&run(&good, &["--replay", trial]), &["nowhere to go", "--udp"]);
    let missing = [&["--replay", "/no/such.y4m"][..], &udp].concat();
    assert_refused(&run(&good, &missing), &["/no/such.y4m", "No such file"]);

    let host = ["--replay", trial, "--udp", "no-such-host.invalid:4711"];
    assert_refused(&run(&good, &host), &["no-such-host.invalid", "HOST:PORT"]);
    let port = ["--replay", trial, "--udp", "127.0.0.1"];
    assert_refused(&run(&good, &port), &["127.0.0.1", "HOST:PORT"]);

    let device = ["--replay", trial, "--serial", "/dev/no-such-line"];
    assert_refused(&run(&good, &device), &["/dev/no-such-line", "dialout"]);
    let no_line = ["--replay", trial, "--serial", trial];
    assert_refused(&run(&good, &no_line), &["trial.y4m", "serial"]);
    let baud = ["--replay", trial, "--serial", "/dev/null", "--baud", "1"];
    assert_refused(&run(&good, &baud), &["1 baud", "115200"]);

    let record = ["--replay", trial, "--record", "/no/such/packets.bin"];
    assert_refused(&run(&good, &record), &["/no/such/packets.bin"]);

    let recording = std::fs::read(trial).unwrap();
    assert_refused(
        &run(&good, &["--replay", trial, "--record", trial]),
        &["trial.y4m", "--record"],
    );
    assert_eq!(std::fs::read(trial).unwrap(), recording, "nothing was appended to the recording");
    let blob = std::fs::read(&good).unwrap();
    let onto_config = ["--replay", trial, "--record", good.to_str().unwrap()];
    assert_refused(&run(&good, &onto_config), &["--record", "another name"]);
    assert_eq!(std::fs::read(&good).unwrap(), blob, "nothing was appended to the configuration");

    let idle_baud = [&["--replay", trial, "--baud", "9600"][..], &udp].concat();
    assert_refused(&run(&good, &idle_baud), &["--baud", "--serial"]);
    let idle_listen = ["--replay", trial, "--record", "/dev/null", "--listen", "4211"];
    assert_refused(&run(&good, &idle_listen), &["--listen", "--udp"]);
    let taken = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let taken_port = [&["--replay", trial, "--listen", &port][..], &udp].concat();
    assert_refused(&run(&good, &taken_port), &["--listen", &port]);
    let port_0 = ["--replay", trial, "--udp", "127.0.0.1:0"];
    assert_refused(&run(&good, &port_0), &["127.0.0.1:0", "port"]);

    let mut other = config();
    other.lens.width_px = 320;
    let other_folder = crate::common::folder();
    let other = write_config(&other_folder, &other);
    let size = [&["--replay", trial][..], &udp].concat();
    assert_refused(&run(&other, &size), &["80x64", "320x64", "trial.y4m"]);

    let count = folder.path().join("boots");
    std::fs::write(&count, "many").unwrap();
    let boots = [&["--replay", trial, "--boot-count-file", count.to_str().unwrap()][..], &udp];
    assert_refused(&run(&good, &boots.concat()), &["boots", "delete it"]);

    let fps = [&["--replay", trial, "--fps", "0"][..], &udp].concat();
    assert_refused(&run(&good, &fps), &["--fps", "60000/1001"]);
}

#[test]
fn a_record_that_cannot_be_written_is_told_and_disturbs_no_tracking() {
    let folder = folder();
    let trial = write_recording(&folder, 30);
    let arguments = ["--replay", trial.to_str().unwrap(), "--unpaced", "--record", "/dev/full"];
    let finished = Board::start(&write_config(&folder, &config()), &arguments).wait();
    assert_refused(&finished, &["/dev/full cannot be written: No space left", "--record"]);
    // Logged when it happens and at the end, but not for each packet.
    assert_eq!(finished.stderr.matches("/dev/full").count(), 2, "{}", finished.stderr);
    assert!(finished.stdout.contains("frames       30 "), "{}", finished.stdout);
}

#[test]
fn a_configuration_is_checked_as_a_box_does() {
    let check = |blob: &[u8]| {
        let folder = folder();
        let path = folder.path().join("box.plb");
        std::fs::write(&path, blob).unwrap();
        Board::start(&path, &["--check"]).wait()
    };
    let blob = |change: &dyn Fn(&mut Config)| {
        let mut config = config_with_camera();
        change(&mut config);
        config.encode(&mut vec![0; BLOB_BYTES_MAX]).unwrap().to_vec()
    };
    let sound = blob(&|_| ());
    let finished = check(&sound);
    assert!(finished.status.success(), "{}", finished.stderr);
    assert_eq!(finished.stderr, "");

    let mut flipped = sound.clone();
    flipped[sound.len() / 2] ^= 1;
    assert_refused(&check(&flipped), &["box.plb", "checksum", "plumb provision"]);
    assert_refused(&check(b"[capture]\n"), &["box.plb", "not a Plumbline configuration"]);
    let no_camera = blob(&|config| config.capture = None);
    assert_refused(&check(&no_camera), &["box.plb", "capture: ", "names no camera"]);
    let no_link = blob(&|config| config.links.udp = None);
    assert_refused(&check(&no_link), &["box.plb", "links: neither udp nor serial"]);
    #[cfg(not(feature = "libcamera"))]
    {
        let set = |config: &mut Config| {
            config.capture.as_mut().unwrap().driver = CaptureDriver::Libcamera;
        };
        assert_refused(&check(&blob(&set)), &["box.plb", "capture.driver: ", "\"v4l2\""]);
    }
}

#[test]
fn starts_are_counted() {
    let folder = folder();
    let (config, trial) = (write_config(&folder, &config()), write_recording(&folder, 1));
    let count = folder.path().join("boots");
    for start in 1..=2_u32 {
        let file = folder.path().join(format!("{start}.bin"));
        let finished = Board::start(
            &config,
            &[
                "--replay",
                trial.to_str().unwrap(),
                "--unpaced",
                "--record",
                file.to_str().unwrap(),
                "--boot-count-file",
                count.to_str().unwrap(),
            ],
        )
        .wait();
        assert!(finished.status.success(), "{}", finished.stderr);
        let all = messages(&std::fs::read(&file).unwrap());
        let plumbline::packet::Message::Hello(hello) = &all[0] else { panic!("{:?}", all[0]) };
        assert_eq!(hello.boot_count, Some(start));
    }
}

#[test]
fn the_key_is_beside_the_configuration_and_a_damaged_one_is_not_taken_for_none() {
    let folder = folder();
    let (config, trial) = (write_config(&folder, &config()), write_recording(&folder, 1));
    let [beside, elsewhere, packets] =
        ["box.key", "ward-3.key", "packets.bin"].map(|name| folder.path().join(name));
    let run = |more: &[&str]| {
        let replay = ["--replay", trial.to_str().unwrap(), "--unpaced", "--record"];
        Board::start(&config, &[&replay[..], more].concat()).wait()
    };
    let packets = packets.to_str().unwrap();
    let done = |more: &[&str]| {
        let finished = run(&[&[packets], more].concat());
        assert!(finished.status.success(), "{}", finished.stderr);
        finished.stderr
    };
    assert!(!done(&[]).contains("key"));
    let [one, other] = [1, 2].map(|seed| Key::new([seed; 32]).unwrap());
    std::fs::write(&beside, one.text().as_str()).unwrap();
    std::fs::write(&elsewhere, other.text().as_str()).unwrap();
    assert!(done(&[]).contains(&one.id().to_string()));
    assert!(done(&["--key", elsewhere.to_str().unwrap()]).contains(&other.id().to_string()));
    // Packets are appended, which would spoil it.
    assert_refused(&run(&[beside.to_str().unwrap()]), &["--record", "box.key"]);
    std::fs::write(&beside, &one.text().as_str()[..80]).unwrap();
    let said = done(&[]);
    for part in ["the box's key cannot be used", "box.key", "80 characters", "plumb keys export"] {
        assert!(said.contains(part), "{said}: {part}");
    }
    assert!(!said.contains(&one.text().as_str()[16..40]), "{said}");
}
