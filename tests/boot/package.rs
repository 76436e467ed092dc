//! The Debian package, with Debian's own tools.

use plumbline_test_support::{Absent, skip};

use crate::machine::image;
use crate::scene::run;

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
