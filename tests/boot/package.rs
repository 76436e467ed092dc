//! The Debian package, with Debian's own tools; and installed in a Debian that boots.

use std::path::Path;

use plumbline::config::{Edges, Marked, TriggerInput, TriggerLines, TriggerOutput};
use plumbline::packet::TriggerState;
use plumbline_test_support::{Absent, skip};

use crate::machine::{HOST, Host, Machine, Parts, healths, image, is_measured, poses, read};
use crate::scene::{self, SCENE, archive, run};

#[test]
fn the_package_has_the_program_the_unit_and_their_needs() {
    let package = image("plumbline-board.deb");
    let package = package.to_str().unwrap();
    let control = run("dpkg-deb", &["--info", package]);
    println!("{control}");
    for line in ["Package: plumbline-board", "Architecture: arm64"] {
        assert!(control.contains(line), "{control}");
    }
    let depends = control.lines().find(|line| line.contains("Depends:")).expect("dependencies");
    for needed in ["libcamera0.4", "libc6 (>= 2.", "libstdc++6"] {
        assert!(depends.contains(needed), "{depends}");
    }
    let contents = run("dpkg-deb", &["--contents", package]);
    for (mode, file) in [
        ("-rwxr-xr-x root/root", "./usr/bin/plumbline-board"),
        ("-rw-r--r-- root/root", "./usr/lib/systemd/system/plumbline-board.service"),
        ("-rw-r--r-- root/root", "./usr/lib/sysusers.d/plumbline-board.conf"),
        ("-rw-r--r-- root/root", "./usr/lib/udev/rules.d/60-plumbline-board.rules"),
        ("-rw-r--r-- root/root", "./usr/share/doc/plumbline-board/copyright"),
    ] {
        let is_it = |line: &&str| line.starts_with(mode) && line.ends_with(file);
        assert!(contents.lines().any(|line| is_it(&line)), "no {file} in\n{contents}");
    }
    // Scripts that a shell can read, and a program for the box's processor.
    let directory = tempfile::tempdir().unwrap();
    let unpacked = directory.path().to_str().unwrap();
    run("dpkg-deb", &["--raw-extract", package, unpacked]);
    for script in ["postinst", "prerm", "postrm"] {
        run("sh", &["-n", &format!("{unpacked}/DEBIAN/{script}")]);
    }
    let program = std::fs::read(directory.path().join("usr/bin/plumbline-board")).unwrap();
    // ELF, 64 bits, little endian; machine 183 is AArch64.
    assert_eq!((&program[..6], program[18]), (&b"\x7fELF\x02\x01"[..], 183));
    let unit = directory.path().join("usr/lib/systemd/system/plumbline-board.service");
    // systemd's own opinion, where it is installed: 0 is safe, 10 is not.
    if std::process::Command::new("systemd-analyze").arg("--version").output().is_ok() {
        let unit = unit.to_str().unwrap();
        run("systemd-analyze", &["security", "--offline=true", "--threshold=30", unit]);
    } else {
        skip(Absent::Machine, "there is no systemd-analyze to judge the unit");
    }
}

/// As many show that it tracks.
const POSES: usize = 8;

/// What starts, and what is said on the console.
const UNITS: [(&str, &str); 2] = [
    (
        "test.target",
        "[Unit]\nRequires=basic.target\nAfter=basic.target\n\
         Wants=systemd-sysusers.service systemd-udevd.service systemd-udev-trigger.service\n\
         Wants=install.service\n",
    ),
    (
        "install.service",
        "[Unit]\nAfter=systemd-udevd.service systemd-udev-trigger.service\n\
         [Service]\nType=oneshot\nExecStart=/bin/sh -e /test/install\nStandardOutput=tty\n\
         StandardError=tty\nTimeoutStartSec=infinity\n",
    ),
];

/// The package is unpacked, and a device comes at this very moment; then its own script runs, and its
/// service starts.
const INSTALL: &str = "\
udevadm settle
cp -r /test/package/usr/bin /test/package/usr/lib /usr/
echo \"test: before $(ls -ln /dev/gpiochip0)\"
udevadm trigger --action=add --subsystem-match=gpio
udevadm settle
sh /test/postinst configure
udevadm settle
echo \"test: after $(ls -ln /dev/gpiochip0)\"
echo \"test: group $(grep ^gpio: /etc/group)\"
systemctl start plumbline-board.service
sleep 3
pid=$(systemctl show --property MainPID --value plumbline-board.service)
echo \"test: service $(grep ^Uid /proc/$pid/status)\"
";

/// The package's files, and the configuration of a box on a serial line, with both wires.
fn installed(directory: &Path) -> Vec<u8> {
    let package = image("plumbline-board.deb");
    let unpacked = directory.join("package");
    run("dpkg-deb", &["--raw-extract", package.to_str().unwrap(), unpacked.to_str().unwrap()]);
    let mut files: Vec<(String, Vec<u8>)> = [
        "usr/bin/plumbline-board",
        "usr/lib/systemd/system/plumbline-board.service",
        "usr/lib/sysusers.d/plumbline-board.conf",
        "usr/lib/udev/rules.d/60-plumbline-board.rules",
    ]
    .map(|name| (format!("test/package/{name}"), read(&unpacked.join(name))))
    .into();
    let mut config = scene::config((HOST, 4210).into());
    config.links.udp = None;
    config.machine.watchdog_s = None;
    config.trigger = Some(TriggerLines {
        chip: "9030000.pl061".try_into().unwrap(),
        input: Some(TriggerInput { line: 0, edges: Edges::Both, debounce_us: 0 }),
        output: Some(TriggerOutput { line: 1, marks: Marked::Exposures }),
    });
    files.extend([
        ("test/postinst".to_owned(), read(&unpacked.join("DEBIAN/postinst"))),
        ("test/install".to_owned(), INSTALL.into()),
        ("var/lib/plumbline/config.plb".to_owned(), scene::blob(&config)),
        ("var/lib/plumbline/box.key".to_owned(), scene::key_file(&scene::key())),
    ]);
    // The directories that every Debian has.
    files.extend(
        ["tmp", "var/tmp", "run", "root", "home"].map(|it| (format!("{it}/.kept"), vec![])),
    );
    files.extend(UNITS.map(|(name, text)| (format!("etc/systemd/system/{name}"), text.into())));
    archive(files)
}

/// The service runs as a user of its own, and still reaches the camera, the serial line and the wires.
#[test]
fn the_packaged_service_reaches_its_devices_as_its_own_user() {
    let directory = tempfile::tempdir().unwrap();
    let package = directory.path().join("package.cpio");
    std::fs::write(&package, installed(directory.path())).unwrap();
    let frames = directory.path().join("frames.cpio");
    std::fs::write(&frames, SCENE.archive()).unwrap();
    let disk = scene::empty_disk(directory.path());
    let parts = Parts {
        kernel: image("vmlinuz"),
        initramfs: vec![image("debian.cpio"), image("overlay.cpio"), package, frames],
        command_line: "rdinit=/test/start systemd.unit=test.target systemd.show_status=true",
        boot_disk: &disk,
        boot_disk_options: "",
        frames_disk: None,
        device_tree: None,
    };
    let machine = Machine::start(&parts, &Host::new());
    let health = machine.wait_for("poses, and a Health after them", |seen| {
        let has_poses = poses(&seen.serial).filter(|pose| is_measured(pose)).count() >= POSES;
        let is_over = seen.console.contains("test: service Uid");
        let health = healths(&seen.serial).last();
        health.filter(|it| has_poses && is_over && it.frames >= POSES as u32).cloned()
    });
    let console = machine.look(|seen| seen.console.clone());
    drop(machine);
    let lines = health.trigger;
    assert_eq!((lines.input, lines.output), (TriggerState::Ready, TriggerState::Ready));
    assert!(lines.pulses > 0, "{lines:?}");

    let said = |what: &str| {
        let head = format!("test: {what} ");
        let found = console.lines().find_map(|line| line.trim().strip_prefix(&head));
        found.unwrap_or_else(|| panic!("the guest has not said {head:?}: {console}")).to_owned()
    };
    let (before, after, group) = (said("before"), said("after"), said("group"));
    println!("{before}\n{after}\n{group}");
    assert!(before.starts_with("crw-------") && before.contains(" 0 "), "{before}");
    let number = group.split(':').nth(2).expect("a group's number").to_owned();
    let owner: Vec<&str> = after.split_whitespace().take(4).collect();
    assert_eq!(owner[0], "crw-rw----", "{after}");
    assert_eq!((owner[2], owner[3]), ("0", &*number), "{after}");
    let user = said("service");
    println!("{user}");
    let user = user.split_whitespace().nth(1).and_then(|it| it.parse::<u32>().ok());
    assert!(user.is_some_and(|it| it != 0), "not a user of its own");
}
