//! From the paper and a new box to a study's report.

use std::path::Path;

use plumbline_trial::Trial;

use crate::camera::{Shown, TheBox};
use crate::stage::Stage;

/// Has the camera show what a script asks for.
pub fn show(the_box: &TheBox, asked: &str) -> String {
    let shown = match asked.split_whitespace().collect::<Vec<_>>()[..] {
        ["show", "standing"] => Shown::Standing,
        ["show", "person"] => Shown::Person,
        ["show", "photograph", number] => Shown::Photograph(number.parse().unwrap()),
        _ => panic!("nobody can {asked}"),
    };
    the_box.show(shown);
    "shown".to_owned()
}

#[track_caller]
fn go_by(hands: &str) {
    let Some(stage) = Stage::without_box() else { return };
    let desk = stage.desk();
    let mut the_box = None;
    stage.browse("whole_way.py", &[&desk.url, hands], |asked| match asked.strip_prefix("start ") {
        Some(card) => {
            stage.put_in(Path::new(card));
            the_box = Some(stage.start_box(Shown::Photograph(0)));
            "started".to_owned()
        }
        None => show(the_box.as_ref().expect("a box that was started"), asked),
    });
    drop(desk);
    let session = stage.path("quiet-standing/sessions/P01-1");
    let trials = std::fs::read_dir(session).unwrap().map(|it| it.unwrap().path());
    let trials: Vec<_> = trials.filter(|it| it.is_dir()).collect();
    assert_eq!(trials.len(), 2, "{trials:?}");
    for folder in trials {
        let trial = Trial::open(&folder).unwrap();
        assert_eq!(trial.warnings, Vec::<String>::new());
    }
}

#[test]
fn by_mouse() {
    go_by("mouse");
}

#[test]
fn by_keyboard_alone() {
    go_by("keyboard");
}
