//! Whatever happens to the page, the trial is whole.

use plumbline::packet::PosePacket;
use plumbline_trial::Trial;

use crate::camera::Shown;
use crate::stage::{Stage, nothing_is_asked};
use crate::stand::{lasted_s, packets_of};

/// Long enough for all that is done meanwhile, on a busy computer too.
const SECONDS: u32 = 16;

#[test]
fn a_trial_is_whole_whatever_happens_to_its_page() {
    let Some(stage) = Stage::new() else { return };
    let the_box = stage.start_box(Shown::Person);
    let desk = stage.desk();
    stage.browse("disturbed.py", &[&desk.url, &SECONDS.to_string()], nothing_is_asked);
    drop((desk, the_box));
    let folder = stage.path("short/sessions/P01-1/01-eyes-open");
    let trial = Trial::open(&folder).unwrap();
    assert_eq!(trial.warnings, Vec::<String>::new());
    let poses = packets_of(&folder);
    // A box that shares a busy computer has a pace of its own.
    let lasted_s = lasted_s(&folder);
    assert!(lasted_s >= f64::from(SECONDS), "{lasted_s} s, {} poses", poses.len());
    let follows = |pair: &[(u64, PosePacket)]| pair[1].1.sequence == pair[0].1.sequence + 1;
    assert!(poses.windows(2).all(follows), "poses are missing, of {}", poses.len());
    println!("{} poses, none missing", poses.len());
}

/// The page while its desk is killed in the middle of a trial and started again, as its computer may be.
/// (What is left of the trial is seen without a browser.)
#[test]
fn a_page_comes_back_to_its_session_when_its_desk_was_killed() {
    let Some(stage) = Stage::new() else { return };
    let _the_box = stage.start_box(Shown::Person);
    let mut desk = Some(stage.desk());
    let url = desk.as_ref().unwrap().url.clone();
    let mut port = 0;
    stage.browse("restarted.py", &[&url], |asked| match asked {
        "kill the desk" => {
            port = desk.as_ref().unwrap().port();
            desk.take().unwrap().kill();
            "killed".to_owned()
        }
        "start the desk" => desk.insert(stage.desk_at(port)).url.clone(),
        _ => panic!("nobody can {asked}"),
    });
}
