use std::cell::RefCell;
use std::rc::Rc;

use plumbline::packet::{Command, LogLevel};

use super::*;
use crate::fixture;

/// What a played box has got.
type Got = Rc<RefCell<Vec<Message>>>;

/// A box that says who it is and takes every configuration.
struct Played {
    hello: Option<Hello>,
    answers: Vec<Message>,
    got: Got,
}

impl Transport for Played {
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
        for message in self.answers.drain(..) {
            take(fixture::event(message));
        }
        Ok(())
    }

    fn send(&mut self, message: &Message) {
        self.got.borrow_mut().push(message.clone());
        let Message::Command(Command { id, action, .. }) = message else { return };
        let outcome = match action {
            Action::SendHello if self.hello.is_none() => ReplyOutcome::Refused {
                refusal: Refusal::NotSupported,
                reason: "no camera".try_into().unwrap(),
            },
            Action::StoreConfig { crc, .. } => ReplyOutcome::Stored { crc: *crc },
            _ => ReplyOutcome::Accepted,
        };
        self.answers.extend(self.hello.clone().map(Message::Hello));
        self.answers.push(Message::Reply(Reply { id: *id, outcome }));
    }
}

/// The way to a played box, which has said something.
fn link(hello: Option<Hello>) -> (BoxLink, Got) {
    let got = Got::default();
    let log = Message::Log(plumbline::packet::Log {
        uptime_ms: 7,
        level: LogLevel::Info,
        target: heapless::String::new(),
        text: heapless::String::new(),
        cut: 0,
    });
    let played = Played { hello, answers: vec![log], got: Rc::clone(&got) };
    let link = BoxLink {
        transport: Box::new(played),
        place: "here".into(),
        kind: LinkKind::Udp,
        questions: Questions::of_link(),
        heard: None,
        others: Others::default(),
    };
    (link, got)
}

fn hello(device: &str) -> Hello {
    Hello { device: device.try_into().unwrap(), ..fixture::hello(&fixture::config()) }
}

#[test]
fn a_configuration_goes_to_the_box_that_was_met_and_to_no_other() {
    let config = fixture::config();
    let [met, anew, another] = [("ward 3", 1), ("ward 3", 2), ("ward 4", 1)]
        .map(|(device, boot_id)| Some(Hello { boot_id, ..hello(device) }));
    let is_stored = |message: &Message| {
        let is_store = |action| matches!(action, Action::StoreConfig { .. });
        matches!(message, Message::Part(_))
            || matches!(message, Message::Command(command) if is_store(command.action))
    };
    for (met, now) in [(&met, &met), (&met, &anew), (&None, &None)] {
        let (mut link, got) = link(now.clone());
        let stored = link.store_config(met.as_ref(), &config).unwrap();
        assert_eq!(stored, (now.clone(), config.crc()));
        assert!(got.borrow().iter().any(is_stored));
    }
    for (met, now, words) in [
        (&met, &another, "another box is heard now: ward 4 ("),
        (&met, &None, "one that tracks nothing (no camera), no longer ward 3 ("),
        (&None, &met, "ward 3 (PL-0001), no longer the box that tracks nothing"),
    ] {
        let (mut link, got) = link(now.clone());
        let error = link.store_config(met.as_ref(), &config).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("nothing was changed"), "{error}");
        assert!(!got.borrow().iter().any(is_stored));
    }
}

#[test]
fn what_has_fallen_silent_is_not_said_to_be_heard() {
    let (mut link, _) = link(None);
    let text = |link: &BoxLink| link.no_answer("a question").to_string();
    assert!(text(&link).contains("no box is heard; check that the box is on"));
    // A line may give back what was sent.
    let echo = Message::Command(Command { id: 1, action: Action::SendHello, is_forced: false });
    assert!(!is_of_box(&echo));
    link.wait_until_heard().unwrap();
    assert!(text(&link).contains("the box is heard, but does not answer a question"));
    link.heard = Instant::now().checked_sub(Duration::from_millis(2900));
    assert!(text(&link).contains("is heard, but"), "{}", text(&link));
    link.heard = Instant::now().checked_sub(Duration::from_millis(4100));
    let silent = "the box has fallen silent: nothing heard from it for 4 s";
    assert!(text(&link).contains(silent), "{}", text(&link));
}

#[test]
fn a_program_that_was_stopped_listens_for_the_time_that_is_left() {
    /// Its first look lasts as long as the program is stopped in it; what then comes, the next brings.
    struct StoppedOnce(Duration, bool);
    impl Transport for StoppedOnce {
        fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
            if std::mem::replace(&mut self.1, true) {
                take(fixture::event(Message::Hello(hello("ward 3"))));
            } else {
                std::thread::sleep(self.0);
            }
            Ok(())
        }
        fn send(&mut self, _: &Message) {}
    }
    let listen = |for_ms, stopped_ms| {
        let transport = Box::new(StoppedOnce(Duration::from_millis(stopped_ms), false));
        let mut link = BoxLink::new(transport, "here".into(), LinkKind::Udp);
        link.wait_until_heard_within(Duration::from_millis(for_ms)).is_ok()
    };
    // 1,000 ms were asked for, of which 500 may pass in one look.
    assert!(listen(1_000, 1_500));
    // A look that takes its time is not a stop, and bounds what is waited.
    assert!(!listen(300, 400));
}
