//! The program is killed while it adds, and the disk is full.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use plumbline_test_support::{Absent, command, skip};

use super::{add, plumb, record, trials};

/// At so many moments of an addition.
const KILLED: u32 = 12;

fn setting() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("trials")).unwrap();
    for at in 0..16 {
        let name = format!("P{at:02}");
        record(&folder.path().join("trials").join(&name), &name, "calm", 3, at);
    }
    folder
}

#[test]
fn killed_at_any_moment_an_addition_is_there_as_a_whole_or_not_at_all() {
    let folder = setting();
    let begun = Instant::now();
    assert_eq!(add(folder.path(), &[]).code, Some(0));
    let whole = begun.elapsed();
    let names = trials(folder.path());
    let mut outcomes = [0; 2];
    for moment in 0..KILLED {
        std::fs::remove_dir_all(folder.path().join("cohort")).unwrap();
        let mut adding = command(env!("CARGO_BIN_EXE_plumb"));
        adding.current_dir(folder.path()).args(["cohort", "add", "--to", "cohort"]).args(&names);
        adding.stdout(Stdio::null()).stderr(Stdio::null());
        let mut adding = adding.spawn().unwrap();
        std::thread::sleep(whole * moment / KILLED);
        // SIGKILL. It may have ended before.
        let _ = adding.kill();
        adding.wait().unwrap();
        if folder.path().join("cohort/cohort.toml").exists() {
            let list = plumb(folder.path(), &["cohort", "list", "cohort"]);
            let all = list.stdout.contains("16 trials of 16 participants");
            assert!(all || list.stdout.contains("0 trials of 0 participants"), "{}", list.stdout);
            outcomes[usize::from(all)] += 1;
            let check = plumb(folder.path(), &["cohort", "check", "cohort"]);
            assert_eq!(check.code, Some(0), "{}", check.stderr);
        } else {
            outcomes[0] += 1;
            std::fs::create_dir_all(folder.path().join("cohort")).unwrap();
        }
        let finished = add(folder.path(), &[]);
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
        let check = plumb(folder.path(), &["cohort", "check", "cohort"]);
        assert_eq!((check.code, &*check.stdout), (Some(0), "cohort: 16 trials, all is there\n"));
        let hidden = [".adding", ".added"].map(|it| folder.path().join("cohort").join(it).exists());
        assert_eq!(hidden, [false; 2]);
    }
    println!("killed {KILLED} times: {} of nothing, {} of the whole", outcomes[0], outcomes[1]);
    assert!(outcomes[0] > 0, "it was always too late");
}

/// A disk with room for a part of the cohort: in a mount namespace of its own.
#[test]
fn a_full_disk_leaves_the_cohort_as_it_was() {
    let folder = setting();
    let plumb = env!("CARGO_BIN_EXE_plumb");
    let script = format!(
        "mkdir disk && mount -t tmpfs -o size=4m none disk || exit 77\n\
         {plumb} cohort add trials/P00 trials/P01 --to disk/cohort || exit 1\n\
         free=$(df --output=avail disk | tail -1)\n\
         head -c $((free - 64))k /dev/zero > disk/fill\n\
         {plumb} cohort add trials/* --to disk/cohort 2> full.txt && exit 2\n\
         ls -A disk/cohort > left.txt\n\
         {plumb} cohort check disk/cohort > check.txt && {plumb} cohort list disk/cohort > list.txt\n"
    );
    let mut unshare = Command::new("unshare");
    unshare.args(["--map-root-user", "--mount", "sh", "-c", &script]).current_dir(folder.path());
    let Ok(mut child) = unshare.stdout(Stdio::null()).stderr(Stdio::null()).spawn() else {
        return skip(Absent::Machine, "there is no unshare to mount a small disk with");
    };
    let give_up = Instant::now() + Duration::from_secs(240);
    let status = loop {
        match child.try_wait().unwrap() {
            Some(status) => break status,
            None if Instant::now() > give_up => {
                let _ = child.kill();
                panic!("it never ended");
            }
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    let text = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap_or_default();
    if text("full.txt").is_empty() && status.code() != Some(0) && status.code() != Some(2) {
        return skip(Absent::Machine, "no disk can be mounted here");
    }
    assert_eq!(status.code(), Some(0), "{}", text("full.txt"));
    let full = text("full.txt");
    assert!(
        full.contains("no space left on device; make room on the disk")
            || full.contains("has room"),
        "{full}"
    );
    assert!(!text("left.txt").contains(".add"), "{}", text("left.txt"));
    assert!(text("check.txt").contains("2 trials, all is there"), "{}", text("check.txt"));
    assert!(text("list.txt").contains("2 trials of 2 participants"), "{}", text("list.txt"));
}
