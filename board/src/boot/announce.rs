//! Talks to hosts while there is no session: what is wrong goes out as Log packets to whoever
//! listens with the box's key, and those may send commands. A box without a key only announces
//! itself, and takes a key over its serial line.
//!
//! The network may come up, and the line be plugged in, at any time. If no host's address is
//! known, the announcements are broadcast.

use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

use plumbline::config;
use plumbline::packet::{Log, LogLevel, Message, Reply, UpdateRefusal, UpdateRequest, UpdateStep};
use plumbline::seal::{ListenerId, StreamRing};

use crate::link::{Identity, Links, MESSAGES_PER_TURN_MAX, Ports, Said, SerialLink, UdpLink};
use crate::logger::pieces;
use crate::update;

/// The port on which hosts listen by default.
const HOST_PORT: u16 = 4210;

/// How long the links may take at the end to send their waiting packets.
const FINISH: Duration = Duration::from_secs(1);

/// The links to the hosts.
pub struct Announcer {
    started: Instant,
    links: Links,
}

impl Announcer {
    /// Opens the links that are available.
    pub fn new(
        links: &config::Links,
        identity: Identity,
        ring: Option<&'static mut StreamRing>,
    ) -> Self {
        let to = links.udp.unwrap_or((Ipv4Addr::BROADCAST, HOST_PORT).into());
        let line = links.serial.as_ref();
        let mut ports = Ports {
            udp: UdpLink::to(to).ok(),
            serial: line.and_then(|line| SerialLink::absent(&line.path, line.baud).ok()),
            is_one_way: line.is_some_and(|line| line.one_way),
            file: None,
        };
        ports.listen_where_hosts_look();
        Self { started: Instant::now(), links: Links::new(ports, identity, ring) }
    }

    /// Sends `text` once to every host that listens.
    pub fn say(&mut self, text: &str) {
        for piece in pieces(text) {
            self.links.send(&Message::Log(Log {
                uptime_ms: self.started.elapsed().as_millis() as u64,
                level: LogLevel::Error,
                target: "plumbline_board::boot".try_into().unwrap_or_default(),
                text: piece.try_into().unwrap_or_default(),
                cut: 0,
            }));
        }
    }

    /// Passes what hosts have sent since the last call to `answer`, sends back the replies, and
    /// announces the box when it is time to. Returns whether somebody has begun to listen.
    pub fn answer(
        &mut self,
        mut answer: impl FnMut(ListenerId, &Message) -> Option<Reply>,
    ) -> bool {
        let mut replies = heapless::Vec::<_, { 2 * MESSAGES_PER_TURN_MAX }>::new();
        let mut requests = heapless::Vec::<u16, { 2 * MESSAGES_PER_TURN_MAX }>::new();
        let arrivals = self.links.receive(|said| match said {
            Said::Message(listener, message) => {
                if let Some(reply) = answer(listener, &message) {
                    // There is room for all of them.
                    let _ = replies.push((listener, reply));
                }
            }
            Said::Request(_, UpdateRequest { step: UpdateStep::Part { .. }, .. }) => {}
            Said::Request(_, request) => drop(requests.push(request.id)),
        });
        for id in requests {
            let why =
                "it tracks nothing, and takes a configuration first (`plumb provision --send`)";
            let outcome = update::refused(UpdateRefusal::NotSupported, why);
            self.links.reply_to_updater(id, outcome);
        }
        for (listener, reply) in replies {
            self.links.send_to(listener, &Message::Reply(reply));
        }
        self.links.service();
        arrivals.has_joined
    }

    /// Sends what is still waiting.
    pub fn finish(&mut self) {
        self.links.finish(FINISH);
    }
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;

    use plumbline::packet::{Action, Command, Refusal, ReplyOutcome, ResetReason};
    use plumbline::seal::{
        Announcement, BoxState, Caller, HostEnd, Key, Peer, SEALED_BYTES_MAX, Told,
    };

    use super::*;
    use crate::provisioning::refused;
    use crate::random;
    use crate::test_listeners::key;

    const WHY: &str = "no configuration: it was never sent";

    /// What a host with the key hears, of words and answers, and what everybody hears.
    #[derive(Default)]
    struct Heard {
        logs: Vec<String>,
        outcomes: Vec<ReplyOutcome>,
        announcement: Option<Announcement>,
    }

    /// A refused box with this key, and a host that asks it for something, for a second.
    fn hear(key_of_box: Option<Key>) -> Heard {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
        let links = config::Links { udp: socket.local_addr().ok(), serial: None };
        let identity = Identity {
            start: random::start(),
            name: String::new(),
            key: Ok(key_of_box),
            store: None,
            reset_reason: ResetReason::PowerOn,
            start_count: None,
            refusal: Some(WHY.into()),
        };
        let mut announcer = Announcer::new(&links, identity, None);
        let caller = Caller { process: 7, name: "test".try_into().unwrap() };
        let mut host = HostEnd::new(key(), caller, None);
        let mut heard = Heard::default();
        let mut has_asked = false;
        let began = Instant::now();
        let mut buffer = [0; SEALED_BYTES_MAX];
        while began.elapsed() < Duration::from_secs(1) {
            let has_joined = announcer.answer(|_, message| {
                let Message::Command(command) = message else { return None };
                Some(Reply { id: command.id, outcome: refused(Refusal::NotSupported, WHY) })
            });
            if has_joined {
                announcer.say(WHY);
            }
            let now_ns = began.elapsed().as_nanos() as u64 + 1_000_000_000;
            while let Some((Peer::Udp(to), packet)) = host.due(now_ns, random::bytes, &mut buffer) {
                socket.send_to(packet, to).unwrap();
            }
            let mut datagram = [0; 512];
            let Ok((length, from)) = socket.recv_from(&mut datagram) else { continue };
            let (packet, peer) = (&datagram[..length], Peer::Udp(from));
            heard.announcement = Announcement::parse(packet).or(heard.announcement);
            match host.receive(peer, packet, now_ns, random::bytes, &mut buffer) {
                Told::Handshake(Some(packet)) => drop(socket.send_to(packet, from).unwrap()),
                Told::Message { message: Message::Log(log), .. } => {
                    heard.logs.push(log.text.as_str().into());
                }
                Told::Message { message: Message::Reply(reply), .. } => {
                    heard.outcomes.push(reply.outcome);
                }
                _ => {}
            }
            let command = Command { id: 1, action: Action::SendView, is_forced: false };
            if let Some(Ok((_, packet))) = host.seal(&Message::Command(command), &mut buffer)
                && !has_asked
            {
                has_asked = true;
                socket.send_to(packet, from).unwrap();
            }
        }
        heard
    }

    #[test]
    fn a_refused_box_says_why_to_those_who_have_its_key() {
        let heard = hear(Some(key()));
        assert!(heard.logs.iter().any(|text| text == WHY), "{:?}", heard.logs);
        assert_eq!(heard.outcomes, [refused(Refusal::NotSupported, WHY)]);
        let announcement = heard.announcement.unwrap();
        assert_eq!(
            (announcement.state, announcement.key_id),
            (BoxState::Refusing, Some(key().id()))
        );
        assert_eq!(announcement.text, "");
    }

    #[test]
    fn a_refused_box_without_a_key_only_announces_itself() {
        let heard = hear(None);
        assert!(heard.logs.is_empty() && heard.outcomes.is_empty());
        let announcement = heard.announcement.unwrap();
        assert_eq!((announcement.state, announcement.key_id), (BoxState::Unpaired, None));
        assert!(announcement.text.ends_with(WHY), "{}", announcement.text);
    }
}
