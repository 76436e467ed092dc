//! What whoever holds the board, or stands before the camera, sees and hears from afar.

use crate::camera::Shown;
use crate::stage::{Stage, nothing_is_asked};

#[test]
fn the_picture_fills_the_screen_and_each_tone_is_heard_when_it_is_due() {
    let Some(stage) = Stage::new() else { return };
    let _the_box = stage.start_box(Shown::Standing);
    let desk = stage.desk();
    stage.browse("heard.py", &[&desk.url], nothing_is_asked);
}
