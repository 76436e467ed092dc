//! The program is killed while it adds or removes, and the disk is full.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use plumbline_test_support::{Absent, command, skip};

use super::{add, plumb, record, trials};

/// At so many moments of an addition, and of a removal.
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

#[test]
fn killed_at_any_moment_a_removal_is_made_as_a_whole_or_not_at_all() {
    let folder = setting();
    let names = trials(folder.path());
    // In several tables, of which some go, some stay, and one is replaced.
    for some in names.chunks(3) {
        let trials: Vec<&str> = some.iter().map(String::as_str).collect();
        let added =
            plumb(folder.path(), &[&["cohort", "add", "--to", "kept"], &trials[..]].concat());
        assert_eq!(added.code, Some(0), "{}", added.stderr);
    }
    let copy = || {
        let mut copying = Command::new("cp");
        copying.args(["-R", "kept", "cohort"]).current_dir(folder.path());
        assert!(copying.status().unwrap().success());
    };
    let gone: Vec<String> = (0..10).map(|at| format!("P{at:02}/1/calm/1")).collect();
    let mut arguments = vec!["cohort", "remove", "cohort", "--yes"];
    arguments.extend(gone.iter().map(String::as_str));
    copy();
    // Without --yes, nothing.
    let listed = plumb(folder.path(), &[&arguments[..3], &arguments[4..]].concat());
    assert_eq!(listed.code, Some(0), "{}", listed.stderr);
    assert!(listed.stdout.contains("10 trials of 10 participants"), "{}", listed.stdout);
    assert!(listed.stderr.contains("nothing was removed: add --yes to remove them from cohort"));
    let begun = Instant::now();
    let removed = plumb(folder.path(), &arguments);
    let whole = begun.elapsed();
    let done = "cohort: 10 trials removed, 6 trials left\n";
    assert_eq!((removed.code, &*removed.stdout), (Some(0), done), "{}", removed.stderr);
    let mut outcomes = [0; 2];
    for moment in 0..KILLED {
        std::fs::remove_dir_all(folder.path().join("cohort")).unwrap();
        copy();
        let mut removing = command(env!("CARGO_BIN_EXE_plumb"));
        removing.current_dir(folder.path()).args(&arguments);
        removing.stdout(Stdio::null()).stderr(Stdio::null());
        let mut removing = removing.spawn().unwrap();
        std::thread::sleep(whole * moment / KILLED);
        // SIGKILL. It may have ended before.
        let _ = removing.kill();
        removing.wait().unwrap();
        let check = plumb(folder.path(), &["cohort", "check", "cohort"]);
        assert_eq!(check.code, Some(0), "{}", check.stderr);
        let all = check.stdout.contains("cohort: 6 trials, ");
        assert!(all || check.stdout.contains("cohort: 16 trials, "), "{}", check.stdout);
        outcomes[usize::from(all)] += 1;
        if !all {
            let removed = plumb(folder.path(), &arguments);
            assert_eq!((removed.code, &*removed.stdout), (Some(0), done), "{}", removed.stderr);
        }
        let hidden = [".removing", ".removed"];
        assert_eq!(hidden.map(|it| folder.path().join("cohort").join(it).exists()), [false; 2]);
        assert!(!folder.path().join("cohort/points/participant=P09").exists());
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
