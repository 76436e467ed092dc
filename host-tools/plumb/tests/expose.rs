//! `plumb aim --expose` and a box that is played: its camera is linear, with a black level, and its lamp
//! is known.

use std::net::SocketAddr;

use plumbline_stream::fixture::lit_box::{Left, LitBox, NAME};
use plumbline_test_support::free_address;

use crate::common::finished::{Finished, plumb};
use crate::common::keys;

/// Where `plumb` listens.
fn host() -> SocketAddr {
    free_address()
}

fn expose(light_per_us: f32, takes_gain: bool, more: &[&str]) -> (Finished, Left) {
    let host = host();
    expose_with(LitBox::new(host, light_per_us, takes_gain), host, more)
}

fn expose_with(played: LitBox, host: SocketAddr, more: &[&str]) -> (Finished, Left) {
    let playing = played.play();
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    let finished =
        plumb(folder.path(), &[&["aim", "--udp", &host.to_string(), "--expose"], more].concat());
    (finished, playing.join().expect("the played box plays on"))
}

#[test]
fn what_is_found_is_stored_and_the_box_starts_with_it() {
    let (finished, left) = expose(3e-4, true, &["--store"]);
    assert_eq!(finished.code, Some(0), "{} {}", finished.stdout, finished.stderr);
    let (exposure_us, gain, light) = left.exposed(3e-4);
    assert!((0.7..=0.8).contains(&light), "{exposure_us} us: {light}");
    assert_eq!((gain, left.starts, left.is_aiming), (None, 2, false));
    let found = format!("found: exposure {exposure_us} us\n");
    assert!(finished.stdout.ends_with(&found), "{}", finished.stdout);
    assert!(finished.stderr.contains("the box has restarted with it"), "{}", finished.stderr);
}

#[test]
fn little_light_takes_gain_and_without_one_it_is_said_to_be_too_little() {
    let (finished, left) = expose(3e-5, true, &[]);
    assert_eq!(finished.code, Some(0), "{} {}", finished.stdout, finished.stderr);
    assert!(finished.stdout.contains("found: exposure 8333 us, gain 3\n"), "{}", finished.stdout);
    assert!(finished.stdout.contains("half a frame is 8333 us"), "{}", finished.stdout);
    assert_eq!(left.stored, None);

    let (finished, left) = expose(1e-5, false, &["--store"]);
    assert_eq!(finished.code, Some(2), "{} {}", finished.stdout, finished.stderr);
    assert!(
        finished.stdout.contains("gain 1: the camera does not accept it"),
        "{}",
        finished.stdout
    );
    for part in ["too dark even with exposure 16666 us", "open the aperture, or add light"] {
        assert!(finished.stderr.contains(part), "{part:?} is not in: {}", finished.stderr);
    }
    assert_eq!((left.stored, left.starts, left.is_aiming), (None, 1, false));
}

/// A box of which `restarts` starts come in between, then by this name.
fn expose_through(restarts: u32, restarts_as: &'static str) -> (Finished, Left) {
    let host = host();
    let played = LitBox::new(host, 3e-4, true).restarting(restarts, restarts_as);
    expose_with(played, host, &["--store"])
}

#[test]
fn a_box_that_restarts_meanwhile_is_noticed() {
    let (finished, left) = expose_through(2, NAME);
    assert_eq!(finished.code, Some(0), "{} {}", finished.stdout, finished.stderr);
    let told = finished.stdout.matches("the box has restarted; the same setting again").count();
    // The third is the one with what was stored.
    assert_eq!((told, left.starts, left.is_aiming), (2, 4, false));
    assert!(finished.stdout.contains("found: exposure "), "{}", finished.stdout);
    let (exposure_us, _, light) = left.exposed(3e-4);
    assert!((0.7..=0.8).contains(&light), "its own exposure is not judged: {exposure_us} us");
}

#[test]
fn a_box_that_restarts_again_and_again_is_given_up() {
    let (finished, left) = expose_through(100, NAME);
    assert_eq!((finished.code, left.stored), (Some(2), None), "{}", finished.stdout);
    for part in ["the box has restarted 4 times meanwhile", "`plumb doctor`"] {
        assert!(finished.stderr.contains(part), "{part:?} is not in: {}", finished.stderr);
    }
}

#[test]
fn another_box_in_its_place_is_refused() {
    let (finished, left) = expose_through(1, "other");
    assert_eq!((finished.code, left.stored), (Some(2), None), "{}", finished.stdout);
    let refused = "another box is heard now: other (0), no longer played (0)";
    assert!(finished.stderr.contains(refused), "{}", finished.stderr);
}
