//! Messages of Open Sound Control by UDP, for programs that make movement heard or seen.
//!
//! Each frame is one bundle, one datagram, whose time tag is the frame's time by this computer's wall
//! clock. [The page on the formats](../FORMATS.md) lists the messages. OSC is for what happens now:
//! a late frame is not sent, and nobody knows whether a datagram has come.

use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::mpsc::Receiver;

use plumbline::target::Role;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};

use crate::item::{Gap, Item, Sample};

/// From 1900, where OSC's time begins, to 1970.
const NTP_UNIX_S: f64 = 2_208_988_800.0;

/// The time tag that means *now*.
const IMMEDIATELY: OscTime = OscTime { seconds: 0, fractional: 1 };

/// Sends to one address.
pub struct Sender {
    socket: UdpSocket,
    to: SocketAddr,
}

impl Sender {
    /// A socket that sends there.
    ///
    /// # Errors
    /// When the system has none.
    pub fn to(to: SocketAddr) -> Result<Self, BadInput> {
        let from: SocketAddr = match (to, to.ip().is_loopback()) {
            (SocketAddr::V4(_), true) => (Ipv4Addr::LOCALHOST, 0).into(),
            (SocketAddr::V4(_), false) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            (SocketAddr::V6(_), true) => (Ipv6Addr::LOCALHOST, 0).into(),
            (SocketAddr::V6(_), false) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(from)
            .and_then(|socket| socket.set_nonblocking(true).map(|()| socket))
            .map_err(|error| BadInput::io(format!("--osc {to}"), &error))?;
        Ok(Self { socket, to })
    }

    /// Sends until nothing more comes; what came of it, in words.
    #[must_use]
    pub fn run(self, items: &Receiver<Item>) -> Vec<String> {
        let (mut sent, mut unsent, mut zero_unix_s) = (0_u64, 0_u64, 0.0);
        for item in items {
            if let Item::Stream(stream) = &item {
                zero_unix_s = stream.zero_unix_s;
            }
            let Some(packet) = packet(&item, zero_unix_s) else { continue };
            let bytes = encoder::encode(&packet).ok();
            let is_sent = bytes.is_some_and(|bytes| self.socket.send_to(&bytes, self.to).is_ok());
            *(if is_sent { &mut sent } else { &mut unsent }) += 1;
        }
        let mut said = vec![format!("OSC to {}: {}", self.to, counted(sent, "packet"))];
        if unsent > 0 {
            said.push(format!(
                "warning: OSC: {} could not be sent: check the address and the network",
                counted(unsent, "packet")
            ));
        }
        said
    }
}

/// The packet for an item, if it is sent.
fn packet(item: &Item, zero_unix_s: f64) -> Option<OscPacket> {
    match item {
        Item::Frame(sample) if !sample.is_late => Some(frame(sample, zero_unix_s)),
        Item::Gap(Gap { first, count, .. }) => {
            Some(message("/plumbline/gap", vec![int(*first), int(*count)]))
        }
        Item::Mark(mark) => {
            let time_s = mark.time_s.unwrap_or(f64::NAN);
            let label = OscType::String(mark.label.clone());
            Some(message("/plumbline/mark", vec![label, OscType::Float(time_s as f32)]))
        }
        Item::Stream(_) | Item::Frame(_) | Item::Notice(_) => None,
    }
}

fn frame(sample: &Sample, zero_unix_s: f64) -> OscPacket {
    let mut content = Vec::new();
    for (role, name) in [(Role::Lower, "lower"), (Role::Upper, "upper")] {
        let Some(target) = sample.target(role) else { continue };
        let number = int(sample.packet.sequence);
        let time_s = OscType::Float(sample.time_s as f32);
        let floats = |values: &[f32]| values.iter().map(|it| OscType::Float(*it)).collect();
        let with = |mut values: Vec<OscType>| {
            values.splice(0..0, [number.clone(), time_s.clone()]);
            values
        };
        match &target.pose {
            Ok(pose) => {
                if let Some(at) = sample.trunk(role) {
                    let point = floats(&[at.ap_mm, at.ml_mm, at.si_mm]);
                    content.push(message(&format!("/plumbline/{name}"), with(point)));
                }
                let pose = floats(&[pose.theta_rad, pose.translation_mm].concat());
                content.push(message(&format!("/plumbline/{name}/pose"), with(pose)));
            }
            Err(why) => {
                let why = vec![OscType::String(why.words().to_owned())];
                content.push(message(&format!("/plumbline/{name}/lost"), with(why)));
            }
        }
    }
    let timetag = time_tag(zero_unix_s + 1e-9 * sample.host_ns);
    OscPacket::Bundle(OscBundle { timetag, content })
}

fn message(addr: &str, args: Vec<OscType>) -> OscPacket {
    OscPacket::Message(OscMessage { addr: addr.to_owned(), args })
}

/// OSC's integers have a sign; after 414 days of 60 Hz the number becomes negative.
fn int(number: u32) -> OscType {
    OscType::Int(number.cast_signed())
}

fn time_tag(unix_s: f64) -> OscTime {
    let since_1900_s = unix_s + NTP_UNIX_S;
    if !(0.0..f64::from(u32::MAX)).contains(&since_1900_s) {
        // From 2036 on the seconds begin anew.
        return IMMEDIATELY;
    }
    let seconds = since_1900_s as u32;
    let fractional = (since_1900_s.fract() * 4_294_967_296.0) as u32;
    OscTime { seconds, fractional }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;
    use crate::item::Marked;
    use crate::json::lines::tests::{covered, sample, stream};

    #[test]
    fn a_frame_is_a_bundle_and_late_ones_are_not_sent() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        receiver.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let sender = Sender::to(receiver.local_addr().unwrap()).unwrap();
        let (items, queue) = channel();
        let mark = Marked {
            label: "stands".to_owned(),
            source: "key".to_owned(),
            host_ns: 4e9,
            time_s: Some(2.0),
        };
        let late = Sample { is_late: true, ..sample(6) };
        items.send(Item::Stream(Arc::new(stream()))).unwrap();
        for item in [
            Item::Frame(Arc::new(covered(120))),
            Item::Frame(Arc::new(late)),
            Item::Mark(Arc::new(mark)),
        ] {
            items.send(item).unwrap();
        }
        drop(items);
        assert!(sender.run(&queue)[0].ends_with(": 2 packets"));
        let take = || {
            let mut bytes = [0; 2048];
            let length = receiver.recv(&mut bytes).unwrap();
            rosc::decoder::decode_udp(&bytes[..length]).unwrap().1
        };
        let OscPacket::Bundle(OscBundle { timetag, content }) = take() else { panic!("no bundle") };
        assert_eq!(timetag.seconds, 1_800_000_004 + 2_208_988_800);
        assert!(timetag.fractional < 5000, "{timetag:?}");
        let point = [4.25, -1.5, 1012.0].map(OscType::Float);
        let head = [OscType::Int(120), OscType::Float(2.0)];
        assert_eq!(content[0], message("/plumbline/lower", [&head[..], &point].concat()));
        let pose = [0.1, 0.2, -0.1, 1.0, 2.0, 1000.0].map(OscType::Float);
        assert_eq!(content[1], message("/plumbline/lower/pose", [&head[..], &pose].concat()));
        let why = [OscType::String("too few corners".to_owned())];
        assert_eq!(content[2], message("/plumbline/upper/lost", [&head[..], &why].concat()));
        assert_eq!(content.len(), 3);
        let args = vec![OscType::String("stands".to_owned()), OscType::Float(2.0)];
        assert_eq!(take(), message("/plumbline/mark", args));
    }
}
