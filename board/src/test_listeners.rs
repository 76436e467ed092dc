//! Listeners of a box, without any link.

use plumbline::packet::Start;
use plumbline::seal::{
    BoxEnd, Caller, Heard, HostEnd, Key, ListenerId, Peer, SEALED_BYTES_MAX, Told,
};

use crate::random;

/// The key of the box.
pub fn key() -> Key {
    Key::new([9; 32]).unwrap()
}

/// A box to which two hosts listen, on the ports 1 and 2.
pub fn listened_to() -> (BoxEnd, [ListenerId; 2]) {
    let mut end = BoxEnd::new(Some(key()), Start::MIN, &random::bytes());
    let listeners = [1, 2].map(|port| join(&mut end, Peer::Udp(([127, 0, 0, 1], port).into())));
    (end, listeners)
}

fn join(end: &mut BoxEnd, peer: Peer) -> ListenerId {
    let now_ns = 1_000_000_000;
    let caller = Caller { process: rand::random(), name: "test".try_into().unwrap() };
    let mut host = HostEnd::new(key(), caller, Some(peer));
    let mut to_box = [0; SEALED_BYTES_MAX];
    loop {
        let (_, packet) = host.due(now_ns, random::bytes, &mut to_box).expect("a packet is due");
        let mut packet = packet.to_vec();
        loop {
            let mut to_host = [0; SEALED_BYTES_MAX];
            match end.receive(peer, &packet, now_ns, random::bytes, &mut to_host) {
                Heard::Message { listener, .. } => return listener,
                Heard::Answer(answer) => {
                    let mut next = [0; SEALED_BYTES_MAX];
                    let told = host.receive(peer, answer, now_ns, random::bytes, &mut next);
                    let Told::Handshake(Some(next)) = told else { break };
                    packet = next.to_vec();
                }
                other => panic!("{other:?}"),
            }
        }
    }
}
