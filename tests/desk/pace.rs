//! From exposure to screen, and what that costs.

use crate::camera::{RATE_HZ, Shown};
use crate::stage::Stage;

/// From exposure to the screen, at the median.
const SCREEN_MS_MAX: f64 = 100.0;

/// What a page's memory may differ by between two looks.
const HEAP_KB_MAX: f64 = 2_000.0;

/// What the server's may grow by once what it keeps of the frames is full: the allocator's own.
const RESIDENT_KB_MAX: u64 = 6_000;

/// The figures of a line that begins with this word.
fn figures(said: &str, word: &str) -> Vec<f64> {
    let line = said.lines().find_map(|line| line.strip_prefix(word)).expect(word);
    line.split_whitespace().map(|it| it.parse().unwrap()).collect()
}

/// What the script says of a page that watches a person for this time, and what the desk holds once its
/// buffers are full and at the end, in kilobytes.
fn watched_for(seconds: u32, rate_hz: usize) -> Option<(String, [u64; 2])> {
    let stage = Stage::new()?;
    let _the_box = stage.start_box_at(Shown::Person, rate_hz);
    let desk = stage.desk();
    let mut filled_kb = None;
    let said = stage.browse("pace.py", &[&desk.url, &seconds.to_string()], |asked| {
        assert_eq!(asked, "look at the memory");
        filled_kb = Some(desk.resident_kb());
        "seen".to_owned()
    });
    let (filled_kb, end_kb) = (filled_kb.expect("it asks once"), desk.resident_kb());
    println!("the desk held {filled_kb} kB when its buffers were full, {end_kb} at the end");
    let heap_kb = figures(&said, "heap_kb ");
    assert!(heap_kb[2] - heap_kb[0] < HEAP_KB_MAX, "{said}");
    Some((said, [filled_kb, end_kb]))
}

/// How soon depends on what else the computer does: see the next test.
#[test]
fn it_is_said_how_soon_a_movement_is_on_the_screen() {
    let Some((said, _)) = watched_for(10, RATE_HZ) else { return };
    assert!(figures(&said, "screen_ms ")[0] > 0.0, "{said}");
}

/// Says for how many seconds a fast box is watched, instead of ten minutes.
const SECONDS: &str = "PLUMBLINE_DESK_SECONDS";

/// The pace of the fast box, which it must have kept for the figures to mean anything: a program that
/// was built for tests does not.
const FAST_HZ: usize = 200;

#[test]
#[ignore = "takes ten minutes, alone on a quiet computer: `cargo xtask test long`"]
fn ten_minutes_at_200_hz_are_on_the_screen_in_time_and_take_no_memory() {
    let seconds = std::env::var(SECONDS).map_or(600, |it| it.parse().unwrap());
    let Some((said, [filled_kb, end_kb])) = watched_for(seconds, FAST_HZ) else { return };
    assert!(figures(&said, "rate_hz ")[0] > 0.99 * FAST_HZ as f64, "{said}");
    assert!(figures(&said, "screen_ms ")[0] <= SCREEN_MS_MAX, "{said}");
    assert!(end_kb < filled_kb + RESIDENT_KB_MAX, "{filled_kb} kB when its buffers were full");
}
