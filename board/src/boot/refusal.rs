//! A configuration that cannot be used is refused, and the box says so instead
//! of tracking: on the console once, to the hosts again and again.
//!
//! It stays so until the power is switched off: a new start would find the same
//! file. That is also why no watchdog runs.

use std::time::Instant;

use plumbline::config::Links;

use super::announce;

/// Says why, for ever.
pub fn stay(links: &Links, why: &str) -> ! {
    let text = format!("configuration refused: {why}");
    log::error!("{text}");
    log::error!("nothing is tracked; correct it, then switch the box off and on again");
    let started = Instant::now();
    loop {
        announce::say(links, started, &text);
        std::thread::sleep(announce::AGAIN);
    }
}
