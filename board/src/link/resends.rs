//! Sends again what listeners have asked for, beside what is live.

use plumbline::seal::{BoxEnd, LISTENERS_MAX, SEALED_BYTES_MAX, StreamRing};

use super::Ports;

/// Packets that are sent again in one turn: fewer than fit into a socket's buffer at the host, and
/// with the live ones about 4,000 a second at 60 turns.
const PACKETS_PER_TURN_MAX: usize = 64;

/// Sends as many packets as one turn may, as they were sealed, to the listeners in turn. What the
/// ring has no more is answered.
pub(super) fn serve(end: &mut BoxEnd, ring: &StreamRing, ports: &mut Ports) {
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut waiting = end.listeners();
    let mut left = PACKETS_PER_TURN_MAX;
    while left >= LISTENERS_MAX && !waiting.is_empty() {
        waiting.retain(|(listener, peer)| {
            if !ports.has_room(*peer) {
                return false;
            }
            let Some((peer, packet)) = end.next_resend(*listener, ring, &mut buffer) else {
                return false;
            };
            ports.send(peer, packet);
            left -= 1;
            true
        });
    }
}
