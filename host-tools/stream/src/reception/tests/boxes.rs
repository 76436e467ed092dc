//! Several boxes that send to one computer: which of them is heard, and what is said of the others.

use std::thread;

use super::*;
use crate::sessions::LeftOut;

#[test]
fn a_second_box_is_not_mixed_in() {
    let mut udp = Udp::bind("0.0.0.0:0".parse().unwrap()).unwrap();
    let port = udp.local_address().unwrap().port();
    let sender = |from: &str| std::net::UdpSocket::bind((from, 0)).unwrap();
    let send = |from: &std::net::UdpSocket, packet: &Packet| {
        from.send_to(&datagram_of(packet), ("127.0.0.1", port)).unwrap();
    };
    // Linux has all of 127/8. The last is another program of the first one's computer.
    let boxes = ["127.0.0.1", "127.0.0.2", "127.0.0.1"].map(sender);
    send(&boxes[0], &sent(&hello(START)));
    send(&boxes[0], &sent(&pose(0)));
    for (start, other) in (20..).zip(&boxes[1..]) {
        send(other, &packet(start, pose(500)));
        send(other, &packet(start, hello_of("ward 4", start)));
        send(other, &packet(start, hello_of("ward 4", start)));
    }
    send(&boxes[0], &sent(&pose(1)));
    let (mut receiver, csv) = receiver();
    receive(&mut udp, &mut receiver, &mut (), Some(2), &AtomicBool::new(false), on()).unwrap();
    assert_eq!(receiver.left_out(), LeftOut { other_box: 6, ..LeftOut::default() });
    assert_eq!(rows(&csv.text()).len(), 4);
    let notices = receiver.take_notices();
    for other in &boxes[1..] {
        let address = other.local_addr().unwrap();
        let text = format!("another box sends here too: ward 4 (PL-0001), at {address}");
        let said = notices.iter().filter(|notice| notice.contains(&text)).count();
        assert_eq!(said, 1, "{text:?} in {notices:?}");
    }
}

/// What a transport makes of datagrams from several sockets, one after the other.
struct Senders {
    udp: Udp,
    port: u16,
}

impl Senders {
    fn new() -> Self {
        let udp = Udp::bind("0.0.0.0:0".parse().unwrap()).unwrap();
        let port = udp.local_address().unwrap().port();
        Self { udp, port }
    }

    /// Whether the message counts.
    fn heard(&mut self, from: &std::net::UdpSocket, message: &Message) -> bool {
        from.send_to(&datagram(message), ("127.0.0.1", self.port)).unwrap();
        let mut heard = None;
        while heard.is_none() {
            let mut take = |event| match event {
                Event::Raw(_) => {}
                event => heard = Some(matches!(event, Event::Packet(_))),
            };
            self.udp.poll(&mut take).unwrap();
        }
        heard.unwrap()
    }
}

#[test]
fn a_box_that_restarts_is_known_by_its_name_and_not_by_its_port() {
    let [first, second, third] =
        [(); 3].map(|()| std::net::UdpSocket::bind("127.0.0.1:0").unwrap());
    let elsewhere = std::net::UdpSocket::bind("127.0.0.2:0").unwrap();
    let mut senders = Senders::new();
    assert!(senders.heard(&first, &pose(0)));
    assert!(!senders.heard(&second, &hello(2)), "nobody knows yet who the first one is");
    assert!(senders.heard(&first, &hello(1)));
    assert!(!senders.heard(&second, &pose(0)), "it does not say who it is");
    assert!(!senders.heard(&second, &hello_of("ward 4", 2)), "another box");
    assert!(!senders.heard(&second, &hello(1)), "the same start cannot be at two ports");
    assert!(!senders.heard(&elsewhere, &hello(2)), "the same name on another computer");
    assert!(senders.heard(&second, &hello(2)), "the first one has restarted");
    assert!(senders.heard(&second, &pose(0)));
    assert!(!senders.heard(&first, &hello(1)), "it still sends: two boxes of one name");
    assert!(senders.heard(&third, &hello(3)), "and anew");

    senders.udp.hold(true);
    assert!(!senders.heard(&second, &hello(4)), "held");
    senders.udp.hold(false);
    assert!(senders.heard(&first, &hello(4)), "held no longer");
}

#[test]
fn a_silent_box_leaves_its_place_to_another_unless_it_is_held() {
    let [first, second] = [(); 2].map(|()| std::net::UdpSocket::bind("127.0.0.1:0").unwrap());
    let mut senders = Senders::new();
    assert!(senders.heard(&first, &hello(1)));
    thread::sleep(Duration::from_millis(3100));
    senders.udp.hold(true);
    assert!(!senders.heard(&second, &hello_of("ward 4", 2)));
    senders.udp.hold(false);
    assert!(senders.heard(&second, &hello_of("ward 4", 2)));
    assert!(!senders.heard(&first, &hello(1)));
}

#[test]
fn a_reception_ends_when_another_box_has_taken_the_place_of_the_first() {
    let mut udp = Udp::bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let to = udp.local_address().unwrap();
    let sender = thread::spawn(move || {
        let [first, other] = [(); 2].map(|()| std::net::UdpSocket::bind("127.0.0.1:0").unwrap());
        for message in [hello(START), pose(0), pose(1)] {
            first.send_to(&datagram(&message), to).unwrap();
        }
        thread::sleep(Duration::from_millis(3100));
        for packet in [packet(9, hello_of("ward 4", 9)), packet(9, pose(0))] {
            other.send_to(&datagram_of(&packet), to).unwrap();
        }
    });
    let (mut receiver, csv) = receiver();
    let stop = AtomicBool::new(false);
    let ended = receive(&mut udp, &mut receiver, &mut (), Some(100), &stop, on());
    sender.join().unwrap();
    let error = ended.unwrap_err().to_string();
    assert!(error.starts_with("ward 3 (PL-0001): it has been silent for 3 s"), "{error}");
    assert!(error.contains("another box sends now: ward 4 (PL-0001)"), "{error}");
    assert_eq!(rows(&csv.text()).len(), 4, "what came of the first is kept");
}
