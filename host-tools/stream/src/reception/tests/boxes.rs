//! Several boxes that announce themselves to one computer: which of them is heard, and what is said
//! of the others.

use std::net::SocketAddr;
use std::thread;

use plumbline::packet::{PROTOCOL_VERSION, SCHEMA_HASH};
use plumbline::seal::{BoxState, Key, KeyId};

use super::*;
use crate::fixture::OtherRelease;
use crate::others::Others;
use crate::transport::{Event, KnownBox, Memory};

/// A box of which this computer has the key too.
fn ward_4() -> KnownBox {
    KnownBox { name: "ward 4 (PL-0002)".into(), key: Key::new([9; 32]).unwrap(), address: None }
}

/// Where boxes were met.
#[derive(Clone, Default)]
struct Met(Arc<Mutex<Vec<SocketAddr>>>);

impl Memory for Met {
    fn met_at(&mut self, _: KeyId, address: SocketAddr) {
        self.0.lock().unwrap().push(address);
    }

    fn take_start(&mut self, _: KeyId, _: u32) -> bool {
        panic!("a line without a way back")
    }
}

/// Another program may look for it there at once.
#[test]
fn the_place_of_a_box_is_noted_with_its_first_message() {
    let (link, to) = link();
    let met = Met::default();
    let mut link = link.remembering(Box::new(met.clone()));
    let mut sealed_box = SealedBox::new(to, START);
    let (mut is_greeted, mut is_heard) = (false, false);
    // It announces itself once: what it says comes within its first half second.
    for _ in 0..20 {
        sealed_box.serve();
        if !is_greeted && !sealed_box.end().listeners().is_empty() {
            is_greeted = true;
            sealed_box.send(&hello(START));
        }
        link.poll(&mut |event| is_heard |= matches!(event, Event::Packet(_))).unwrap();
        if is_heard {
            break;
        }
    }
    assert!(is_heard);
    let port = |address: &SocketAddr| address.port();
    assert_eq!(
        met.0.lock().unwrap().iter().map(port).collect::<Vec<_>>(),
        [port(&sealed_box.address())]
    );
}

#[test]
fn other_boxes_are_named_once_and_not_mixed_in() {
    let udp = Udp::bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let to = udp.local_address().unwrap();
    let mut link = Link::new(udp, vec![known_box(), ward_4()], "a test");
    let sender = thread::spawn(move || {
        let mut first = SealedBox::new(to, START);
        first.meet();
        first.send(&hello(START));
        first.send(&pose(0));
        let mut known = SealedBox::with_key(to, 20, ward_4().key);
        let mut unknown = SealedBox::with_key(to, 21, Key::new([3; 32]).unwrap());
        for _ in 0..4 {
            for other in [&mut known, &mut unknown] {
                other.live(Duration::from_millis(60));
                other.send(&pose(500));
            }
            first.live(Duration::from_millis(20));
        }
        assert!(known.end().listeners().is_empty() && unknown.end().listeners().is_empty());
        first.send(&pose(1));
        first.live(Duration::from_millis(500));
    });
    let (mut receiver, csv) = receiver();
    receive(&mut link, &mut receiver, &mut (), Some(2), &AtomicBool::new(false), on()).unwrap();
    sender.join().unwrap();
    assert_eq!(rows(&csv.text()).len(), 4);
    let notices = receiver.take_notices();
    let unknown = format!("whose key, {}, this computer", Key::new([3; 32]).unwrap().id());
    for text in ["another box is heard: ward 4 (PL-0002)", &unknown] {
        let said = notices.iter().filter(|notice| notice.contains(text)).count();
        assert_eq!(said, 1, "{text:?} in {notices:?}");
    }
}

#[test]
fn a_box_that_restarts_is_heard_again_by_its_key() {
    let (mut link, to) = link();
    let sender = thread::spawn(move || {
        for (start, frames) in [(5, 0..2), (6, 0..3)] {
            let mut sealed_box = SealedBox::new(to, start);
            sealed_box.meet();
            sealed_box.send(&hello(start));
            for sequence in frames {
                sealed_box.send(&pose(sequence));
            }
            sealed_box.live(Duration::from_millis(500));
        }
    });
    let begun = Instant::now();
    let (mut receiver, csv) = receiver();
    receive(&mut link, &mut receiver, &mut (), Some(5), &AtomicBool::new(false), on()).unwrap();
    sender.join().unwrap();
    // The start before is believed to be over once it is silent for two seconds.
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    assert_eq!((receiver.sessions(), receiver.counts().received), (2, 5));
    assert_eq!(rows(&csv.text()).len(), 10);
}

/// What is said when nothing but a box is heard that lives like this.
fn obstacle(mut live: impl FnMut(Duration), link: &mut Link<Udp>) -> String {
    for _ in 0..20 {
        live(Duration::from_millis(5));
        link.poll(&mut |_| {}).unwrap();
        if let Some((what, remedy)) = link.obstacle() {
            return format!("{what}; {remedy}");
        }
    }
    panic!("nothing is said");
}

#[test]
fn a_box_with_which_there_can_be_no_session_is_explained() {
    let (mut link, to) = link();
    let mut stranger = SealedBox::with_key(to, 7, Key::new([3; 32]).unwrap());
    let said = obstacle(|time| stranger.live(time), &mut link);
    assert!(said.contains("this computer does not have; bring the key"), "{said}");
    let mut unpaired = SealedBox::unpaired(to, 8);
    unpaired.end().describe(BoxState::Unpaired, 255, "ward 9 (PL-0009): it was never paired");
    let said = obstacle(|time| unpaired.live(time), &mut link);
    assert!(said.contains("has no key: ward 9 (PL-0009): it was never paired"), "{said}");
    assert!(said.contains("--new-key") && said.contains("plumb pair"), "{said}");
}

/// Whether it answers or is only heard, and whether this computer knew where it was.
#[test]
fn a_box_of_another_release_is_explained() {
    let ours = PROTOCOL_VERSION;
    let cases = [
        (
            [ours + 1, ours + 1],
            SCHEMA_HASH,
            [
                "speaks version 5 of the link, this program 4",
                "this program is the older one: update Plumbline on this computer",
            ],
        ),
        (
            [ours + 2, ours + 4],
            SCHEMA_HASH,
            ["speaks versions 6 to 8 of", "or give the box the release that is on this computer"],
        ),
        (
            [1, ours - 1],
            0,
            [
                "speaks versions 1 to 3 of",
                "the box is the older one: give it the release that is on",
            ],
        ),
        (
            [ours; 2],
            0x0BAD_CAFE,
            ["is of another release: its messages are 0badcafe", "give both the same release"],
        ),
    ];
    for (versions, schema_hash, expected) in cases {
        for is_deaf in [false, true] {
            let (mut link, to) = link();
            let other = OtherRelease::new(to, versions, schema_hash);
            let other = if is_deaf { other.deaf() } else { other };
            let mut others = Others::default();
            let mut notices = Vec::new();
            let mut said = None;
            for _ in 0..10 {
                other.live(Duration::from_millis(5));
                link.poll(&mut |event| match event {
                    Event::Other { from, name, announcement } => {
                        notices.extend(others.take(from, name.as_deref(), &announcement));
                    }
                    other => panic!("{other:?}"),
                })
                .unwrap();
                said = link.obstacle();
            }
            let (what, remedy) = said.expect("it is said why");
            assert!(what.starts_with("the box ward 3 (PL-0001) "), "{what}");
            assert!(what.contains(expected[0]) && remedy.contains(expected[1]), "{what}: {remedy}");
            assert_eq!(notices.len(), 1, "{notices:?}");
            assert!(notices[0].contains(expected[0]) && notices[0].contains(expected[1]));
        }
    }
}

/// An announcement is not authentic: it does not stop a box from being heard that is understood.
#[test]
fn an_announcement_of_another_release_changes_nothing_in_a_session() {
    let (mut link, to) = link();
    let sender = thread::spawn(move || {
        let mut sealed_box = SealedBox::new(to, START);
        sealed_box.meet();
        sealed_box.send(&hello(START));
        let forged = OtherRelease::new(to, [9, 9], 0);
        for sequence in 0..20 {
            forged.live(Duration::from_millis(2));
            sealed_box.send(&pose(sequence));
        }
        sealed_box.live(Duration::from_millis(500));
    });
    let (mut receiver, csv) = receiver();
    receive(&mut link, &mut receiver, &mut (), Some(20), &AtomicBool::new(false), on()).unwrap();
    sender.join().unwrap();
    assert_eq!(rows(&csv.text()).len(), 40);
    assert_eq!(receiver.take_notices(), Vec::<String>::new());
}

/// The place of a program that ends is free at once, whatever it has ended by.
#[test]
fn a_link_that_is_dropped_says_goodbye() {
    let (mut link, to) = link();
    let mut sealed_box = SealedBox::new(to, START);
    let listens = |sealed_box: &mut SealedBox, link: &mut Link<Udp>| {
        let give_up = Instant::now() + Duration::from_secs(5);
        while !sealed_box.is_heard() {
            assert!(Instant::now() < give_up);
            sealed_box.live(Duration::from_millis(5));
            link.poll(&mut |_| {}).unwrap();
        }
    };
    listens(&mut sealed_box, &mut link);
    drop(link);
    sealed_box.live(Duration::from_millis(5));
    assert!(!sealed_box.is_heard());
    // One that fails.
    let udp = Udp::bind(to).unwrap();
    let mut link = Link::new(udp, vec![known_box()], "a test");
    listens(&mut sealed_box, &mut link);
    let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(move || {
        let _link = link;
        panic!("this test does so");
    }));
    assert!(panicked.is_err());
    sealed_box.live(Duration::from_millis(5));
    assert!(!sealed_box.is_heard());
}
