//! A hostile page in the same browser gets nothing and starts nothing.

use crate::camera::Shown;
use crate::stage::{Stage, nothing_is_asked};

#[test]
fn a_hostile_page_gets_nothing_and_starts_nothing_and_words_stay_words() {
    let Some(stage) = Stage::new() else { return };
    let _the_box = stage.start_box(Shown::Person);
    let desk = stage.desk();
    stage.browse("hostile.py", &[&desk.url], nothing_is_asked);
}
