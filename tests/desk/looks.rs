//! How the page looks, and whether everybody can use it.

use crate::camera::Shown;
use crate::stage::Stage;
use crate::whole_way::show;

#[test]
fn every_step_is_whole_and_accessible_at_three_sizes_light_and_dark() {
    let Some(stage) = Stage::new() else { return };
    let the_box = stage.start_box(Shown::Person);
    let desk = stage.desk();
    stage.browse("looks.py", &[&desk.url], |asked| show(&the_box, asked));
}
