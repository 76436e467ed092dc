//! Whatever happens to the page, the trial is whole.

use plumbline::packet::{Message, PosePacket, decode_datagram};
use plumbline_stream::transport::Raw;
use plumbline_trial::journal::{Content, Reader};
use plumbline_trial::{Trial, names};

use crate::camera::Shown;
use crate::stage::{Stage, nothing_is_asked};
use crate::stand::lasted_s;

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
    let poses = poses_of(&folder);
    // A box that shares a busy computer has a pace of its own.
    let lasted_s = lasted_s(&folder);
    assert!(lasted_s >= f64::from(SECONDS), "{lasted_s} s, {} poses", poses.len());
    let missing = poses.windows(2).filter(|pair| pair[1].sequence != pair[0].sequence + 1).count();
    assert_eq!(missing, 0, "of {} poses", poses.len());
    println!("{} poses, none missing", poses.len());
}

/// The desk is killed in the middle of a trial and started again, as its computer may be.
#[test]
fn a_session_goes_on_where_it_was_when_its_desk_was_killed() {
    let Some(stage) = Stage::new() else { return };
    let _the_box = stage.start_box(Shown::Person);
    let mut desk = Some(stage.desk());
    let url = desk.as_ref().unwrap().url.clone();
    let mut port = 0;
    stage.browse("restarted.py", &[&url], |asked| match asked {
        "kill the desk" => {
            port = desk.take().unwrap().port();
            "killed".to_owned()
        }
        "start the desk" => desk.insert(stage.desk_at(port)).url.clone(),
        _ => panic!("nobody can {asked}"),
    });
    let folder = stage.path("short/sessions/P01-1/01-eyes-open");
    let poses = poses_of(&folder);
    let missing = poses.windows(2).filter(|pair| pair[1].sequence != pair[0].sequence + 1).count();
    assert!(missing == 0 && !poses.is_empty(), "{missing} gaps, {} poses", poses.len());
}

/// The poses of a trial, in their order.
fn poses_of(trial: &std::path::Path) -> Vec<PosePacket> {
    let mut reader = Reader::open(&trial.join(names::JOURNAL)).unwrap();
    let mut poses = Vec::new();
    while let Some(entry) = reader.next_entry().unwrap() {
        let Content::Raw(Raw::Datagram(bytes)) = entry.content else { continue };
        if let Ok(Message::Pose(pose)) = decode_datagram(&bytes).map(|it| it.message) {
            poses.push(pose);
        }
    }
    poses.sort_by_key(|pose| pose.sequence);
    poses.dedup_by_key(|pose| pose.sequence);
    poses
}
