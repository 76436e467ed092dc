//! The text in a box's messages, made safe where it enters this computer: see
//! [`plumbline_files::text`].

use heapless::String;
use plumbline::packet::{
    Hello, Log, Message, Packet, Reply, ReplyOutcome, UpdateOutcome, UpdateReply,
};
use plumbline_files::text::shown;

/// The packet with all its message's texts as they can be shown.
pub fn printable(mut packet: Packet) -> Packet {
    match &mut packet.message {
        Message::Hello(Hello { device, serial_number, firmware, targets, .. }) => {
            for text in [device, serial_number, firmware] {
                show(text);
            }
            targets.iter_mut().for_each(|target| show(&mut target.name));
        }
        Message::Log(Log { target, text, .. }) => {
            show(target);
            show(text);
        }
        Message::Reply(Reply { outcome: ReplyOutcome::Refused { reason, .. }, .. }) => show(reason),
        // These have no text.
        Message::Reply(_)
        | Message::Pose(_)
        | Message::Health(_)
        | Message::Command(_)
        | Message::View(_)
        | Message::Picture(_)
        | Message::Part(_)
        | Message::Trigger(_) => {}
    }
    packet
}

/// The same of what a box answers about an update.
pub fn printable_reply(mut reply: UpdateReply) -> UpdateReply {
    show(&mut reply.version);
    match &mut reply.outcome {
        UpdateOutcome::State { text, .. } | UpdateOutcome::Refused { text, .. } => show(text),
    }
    reply
}

/// No character becomes a longer one, so that the text keeps its room.
fn show<const N: usize>(text: &mut String<N>) {
    if text.chars().any(|letter| shown(letter) != letter) {
        *text = text.chars().map(shown).collect();
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{
        Deframer, FRAME_BYTES_MAX, LogLevel, PACKET_BYTES_MAX, Refusal, encode_datagram,
        encode_frame,
    };

    use super::*;
    use crate::fixture::{START, config, hello, packet};
    use crate::transport::Raw;

    /// As it comes in a datagram, and on a serial line.
    fn received(message: Message) -> Message {
        let Packet { start, message } = packet(START, message);
        let datagram =
            encode_datagram(start, &message, &mut [0; PACKET_BYTES_MAX]).unwrap().to_vec();
        let frame = encode_frame(start, &message, &mut [0; FRAME_BYTES_MAX]).unwrap().to_vec();
        let [by_datagram, by_line] = [Raw::Datagram(datagram), Raw::Frame(frame)]
            .map(|raw| raw.decode(&mut Deframer::new()).unwrap());
        assert_eq!(by_datagram, by_line);
        by_datagram.message
    }

    #[test]
    fn no_text_of_a_box_commands_the_terminal() {
        let mut told = hello(&config());
        told.device = "\u{1b}[2Jward".try_into().unwrap();
        told.targets[0].name = "l\u{202e}x".try_into().unwrap();
        let Message::Hello(found) = received(Message::Hello(told)) else { panic!("a Hello") };
        assert_eq!((found.device.as_str(), found.targets[0].name.as_str()), ("?[2Jward", "l?x"));

        let [target, text] = ["bo\u{9b}ot", "up\r\n\u{200b}"];
        let (target, text) = (target.try_into().unwrap(), text.try_into().unwrap());
        let log = Log { uptime_ms: 7, level: LogLevel::Error, target, text, cut: 0 };
        let Message::Log(found) = received(Message::Log(log)) else { panic!("a Log") };
        assert_eq!((found.target.as_str(), found.text.as_str()), ("bo?ot", "up  ?"));

        let reason = "no\u{7}".try_into().unwrap();
        let outcome = ReplyOutcome::Refused { refusal: Refusal::Busy, reason };
        let reply = received(Message::Reply(Reply { id: 1, outcome }));
        let Message::Reply(Reply { outcome: ReplyOutcome::Refused { reason, .. }, .. }) = reply
        else {
            panic!("a refusal")
        };
        assert_eq!(reason, "no?");
    }

    /// Each character that is replaced is as long as its replacement, or longer.
    #[test]
    fn a_text_that_fills_its_room_is_not_cut() {
        let mut full = String::<8>::new();
        (0..8).for_each(|_| full.push('\u{1}').unwrap());
        show(&mut full);
        assert_eq!(full, "????????");
    }
}
