//! The tap of a reception whose frames are published.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use plumbline::packet::{Action, Hello, LogLevel, Message, Reply, ReplyOutcome, Trigger};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::clock::Exchange;
use plumbline_stream::others;
use plumbline_stream::questions::Questions;
use plumbline_stream::reception::Tap;
use plumbline_stream::sessions::{Frame, Judged, SessionClock, Sessions};
use plumbline_stream::transport::Event;

use crate::feed::Feed;
use crate::item::{Gap, Item, Marked, Sample, Stream};
use crate::lsl::Lsl;
use crate::timing::{Mapping, Timing};
use crate::{json, lsl, osc};

/// The box's clock is asked for so often at first, and after that less often.
const PINGS_AT_FIRST: u32 = 8;
const PING_AT_FIRST_EVERY: Duration = Duration::from_millis(100);
const PING_EVERY: Duration = Duration::from_secs(1);

/// Frames that can wait until their times are known: those of the minute that a box keeps.
const HELD_MAX: usize = 8192;

/// The word for where the box's triggers come from.
const TRIGGER: &str = "trigger";

/// Marks that can wait for the next turn.
const MARKS_MAX: usize = 64;

/// Publishes the frames of a reception, and the marks of its recording.
pub struct Publisher {
    begun: Instant,
    zero_unix_s: f64,
    /// The questions for the box's clock, unless a recording asks them.
    questions: Option<Questions>,
    pings: u32,
    ping_at: Instant,
    sessions: Sessions,
    current: Option<Current>,
    /// The session before, whose frames may come late.
    previous: Option<(u32, Mapping)>,
    held: VecDeque<Held>,
    marks: mpsc::Receiver<Marked>,
    mark_feed: MarkFeed,
    feeds: Vec<Feed>,
    counts: Counts,
}

/// The session that is under way.
struct Current {
    number: u32,
    hello: Hello,
    timing: Timing,
    /// Whether its stream has been described.
    is_described: bool,
    /// The newest frame.
    last: Option<Placed>,
    /// That of its frames.
    clock: Option<SessionClock>,
}

/// A frame in its place.
#[derive(Debug, Clone, Copy)]
struct Placed {
    number: u32,
    /// Its time here, and the largest error of that.
    host_ns: f64,
    error_s: f64,
    /// Its time in the tables.
    time_s: f64,
}

impl Placed {
    /// The same, no earlier than the frame before it: where a better answer says that frames were placed
    /// too late until now, time stands still until it is there. It is as true as the worse of the two.
    fn after(self, before: Option<Self>) -> Self {
        match before {
            Some(before) if before.host_ns > self.host_ns => {
                let error_s = self.error_s.max(before.error_s);
                Self { host_ns: before.host_ns, error_s, ..self }
            }
            _ => self,
        }
    }
}

/// What waits until its time is known.
enum Held {
    Frame(Box<Frame>),
    Mark(Marked),
    Trigger(Trigger),
}

#[derive(Debug, Default)]
struct Counts {
    frames: u64,
    missing: u64,
    late: u64,
    not_placed: u64,
}

/// Hands the marks of a recording to its publisher.
#[derive(Debug, Clone)]
pub struct MarkFeed {
    sender: mpsc::SyncSender<Marked>,
    dropped: Arc<AtomicU64>,
}

impl MarkFeed {
    /// A mark, so many seconds after the publisher's zero. Where there is no room, it is dropped and
    /// counted.
    pub fn mark(&self, label: &str, source: &str, since_s: f64) {
        let sent = self.sender.try_send(Marked {
            label: label.to_owned(),
            source: source.to_owned(),
            host_ns: 1e9 * since_s,
            time_s: None,
        });
        if sent.is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Publisher {
    /// Publishes nothing until a way out is added. `begun` is the zero of the questions for the box's
    /// clock, and of marks; if a recording with the same zero asks them, `asks` is false.
    #[must_use]
    pub fn new(begun: Instant, asks: bool) -> Self {
        let (sender, marks) = mpsc::sync_channel(MARKS_MAX);
        let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
        Self {
            begun,
            zero_unix_s: unix_s - begun.elapsed().as_secs_f64(),
            questions: asks.then(Questions::of_clock),
            pings: 0,
            ping_at: begun,
            sessions: Sessions::default(),
            current: None,
            previous: None,
            held: VecDeque::new(),
            marks,
            mark_feed: MarkFeed { sender, dropped: Arc::default() },
            feeds: Vec::new(),
            counts: Counts::default(),
        }
    }

    /// Publishes by the Lab Streaming Layer, under this name.
    ///
    /// # Errors
    /// When there is no thread for it.
    pub fn add_lsl(&mut self, library: Lsl, name: &str) -> Result<(), BadInput> {
        let (begun, name) = (self.begun, name.to_owned());
        let run = move |items| lsl::outlet::run(library, &name, begun, items);
        self.add("Lab Streaming Layer", Feed::start("Lab Streaming Layer", run))
    }

    /// Publishes lines of JSON to whoever connects to this address; returns the address, in which
    /// port 0 is replaced by a free one.
    ///
    /// # Errors
    /// When nobody can listen there.
    pub fn add_json(&mut self, address: SocketAddr) -> Result<SocketAddr, BadInput> {
        let server = json::Server::bind(address)?;
        let address = server.address();
        self.add("JSON", Feed::start("JSON", move |items| server.run(&items)))?;
        Ok(address)
    }

    /// Publishes OSC messages to this address.
    ///
    /// # Errors
    /// When there is no socket.
    pub fn add_osc(&mut self, address: SocketAddr) -> Result<(), BadInput> {
        let sender = osc::Sender::to(address)?;
        self.add("OSC", Feed::start("OSC", move |items| sender.run(&items)))
    }

    /// Hands everything to a thread of one's own, which ends when its queue does, and says then what
    /// there is to say.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn add_own(
        &mut self,
        name: &'static str,
        run: impl FnOnce(mpsc::Receiver<Item>) -> Vec<String> + Send + 'static,
    ) -> Result<(), BadInput> {
        self.add(name, Feed::start(name, run))
    }

    /// The zero of the times.
    #[must_use]
    pub fn begun(&self) -> Instant {
        self.begun
    }

    fn add(&mut self, place: &str, feed: std::io::Result<Feed>) -> Result<(), BadInput> {
        self.feeds.push(feed.map_err(|error| BadInput::io(place, &error))?);
        Ok(())
    }

    /// Through which a recording tells its marks.
    #[must_use]
    pub fn mark_feed(&self) -> MarkFeed {
        self.mark_feed.clone()
    }

    /// The reception is over: everything is published that has come. What came of it, in words.
    #[must_use]
    pub fn finish(mut self) -> Vec<String> {
        self.sessions.finish();
        self.take_judged(self.since_begun_ns(Instant::now()));
        self.take_marks();
        self.publish_held();
        let Counts { frames, missing, late, not_placed } = self.counts;
        let mut said = vec![format!(
            "published: {}, {missing} missing, {late} of them late",
            counted(frames, "frame")
        )];
        if not_placed > 0 {
            said.push(format!(
                "warning: {} were not published, because their time was not known",
                counted(not_placed, "frame")
            ));
        }
        let marks = self.mark_feed.dropped.load(Ordering::Relaxed);
        if marks > 0 {
            said.push(format!(
                "warning: {} came at once and were not published",
                counted(marks, "mark")
            ));
        }
        said.extend(self.feeds.iter_mut().flat_map(Feed::finish));
        said
    }

    fn since_begun_ns(&self, now: Instant) -> u64 {
        now.saturating_duration_since(self.begun).as_nanos() as u64
    }

    fn publish(&self, item: &Item) {
        for feed in &self.feeds {
            feed.push(item.clone());
        }
    }

    fn notice(&self, text: &str) {
        self.publish(&Item::Notice(text.into()));
    }

    fn take_judged(&mut self, now_ns: u64) {
        while let Some(judged) = self.sessions.next_judged() {
            match judged {
                Judged::Begins { session, hello } => self.begin(session, hello),
                Judged::Frame(frame) => self.frame(frame),
                Judged::OtherBox(hello) => self.notice(&format!(
                    "another box sends here too, and is not published: {}",
                    others::name(&hello)
                )),
                Judged::Conflict(hello) => self.notice(&format!(
                    "two boxes send at once as {}; only the first is published",
                    others::name(&hello)
                )),
                Judged::Message(message) => self.message(&message, now_ns),
                Judged::Unnamed(_) => {}
            }
        }
    }

    fn message(&mut self, message: &Message, now_ns: u64) {
        match message {
            Message::Trigger(trigger) => self.hold(Held::Trigger(*trigger)),
            Message::Log(log) if log.level <= LogLevel::Warn => {
                self.notice(&format!("the box: {}", log.text));
            }
            Message::Reply(Reply {
                id,
                outcome: ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns, .. },
            }) if self.questions.is_none() || Questions::is_of_clock(*id) => {
                let exchange = Exchange {
                    host_sent_ns: *host_sent_ns,
                    box_received_ns: *box_received_ns,
                    box_sent_ns: *box_sent_ns,
                    host_received_ns: now_ns,
                };
                // An answer before its question was given to another reception.
                if let Some(current) = &mut self.current
                    && exchange.host_sent_ns <= now_ns
                {
                    current.timing.answer(exchange);
                }
            }
            _ => {}
        }
    }

    fn begin(&mut self, number: u32, hello: Hello) {
        // What still waits is of the session before.
        self.publish_held();
        if let Some(current) = &self.current {
            self.previous = current.timing.mapping().map(|it| (current.number, it));
            self.notice(&format!("the box has restarted: session {number} begins"));
        }
        let timing = Timing::default();
        self.current =
            Some(Current { number, hello, timing, is_described: false, last: None, clock: None });
    }

    fn frame(&mut self, frame: Frame) {
        if let Some(current) = self.current.as_mut().filter(|it| it.number == frame.session) {
            current.clock = Some(frame.clock);
        }
        if let Some(current) = self.current.as_mut().filter(|it| it.number == frame.session)
            && !frame.is_late
        {
            current.timing.frame(frame.arrival_ns, &frame.packet);
        }
        self.hold(Held::Frame(Box::new(frame)));
    }

    fn hold(&mut self, held: Held) {
        if self.held.len() == HELD_MAX {
            self.held.pop_front();
            self.counts.not_placed += 1;
        }
        self.held.push_back(held);
    }

    fn take_marks(&mut self) {
        while let Ok(mark) = self.marks.try_recv() {
            self.hold(Held::Mark(mark));
        }
    }

    /// Publishes what waits, by what is known of the clocks now.
    fn publish_held(&mut self) {
        let Some(mapping) = self.current.as_ref().and_then(|it| it.timing.mapping()) else {
            return;
        };
        while let Some(held) = self.held.pop_front() {
            match held {
                Held::Frame(frame) => self.publish_frame(*frame, mapping),
                Held::Mark(mark) => self.publish_mark(mark, mapping),
                Held::Trigger(trigger) => self.publish_trigger(&trigger, mapping),
            }
        }
    }

    fn publish_frame(&mut self, frame: Frame, mapping: Mapping) {
        let Some(current) = self.current.as_mut() else { return };
        let Frame { session, clock, is_late, packet, .. } = frame;
        let is_current = session == current.number;
        let mapping = match self.previous {
            _ if is_current => mapping,
            Some((number, mapping)) if number == session => mapping,
            _ => {
                self.counts.not_placed += 1;
                return;
            }
        };
        let host_ns = mapping.host_ns(packet.capture_time_ns);
        let error_s = mapping.error_s(host_ns);
        let time_s = clock.time_s(packet.capture_time_ns);
        // Of a session that is over, everything is late.
        let is_late = is_late || !is_current;
        let mut placed = Placed { number: packet.sequence, host_ns, error_s, time_s };
        if !is_late {
            placed = placed.after(current.last);
        }
        let Placed { host_ns, error_s, .. } = placed;
        let mut before = Vec::new();
        if is_current && !current.is_described {
            current.is_described = true;
            before.push(Item::Stream(Arc::new(Stream {
                session,
                hello: current.hello.clone(),
                instant: packet.instant,
                error_s,
                zero_unix_s: self.zero_unix_s,
            })));
        }
        if !is_late
            && let Some(last) = current.last.replace(placed)
            && let Some(count @ 1..) = packet.sequence.wrapping_sub(last.number).checked_sub(1)
        {
            self.counts.missing += u64::from(count);
            let (first, before_ns) = (last.number.wrapping_add(1), last.host_ns);
            before.push(Item::Gap(Gap { session, first, count, before_ns, after_ns: host_ns }));
        }
        self.counts.frames += 1;
        self.counts.late += u64::from(is_late);
        let sample = Sample { session, time_s, host_ns, error_s, is_late, packet };
        before.push(Item::Frame(Arc::new(sample)));
        before.iter().for_each(|item| self.publish(item));
    }

    /// A trigger has the clock of the frames: its time in the tables is exact.
    fn publish_trigger(&self, trigger: &Trigger, mapping: Mapping) {
        let clock = self.current.as_ref().and_then(|it| it.clock);
        self.publish(&Item::Mark(Arc::new(Marked {
            label: trigger.edge.words().to_owned(),
            source: TRIGGER.to_owned(),
            host_ns: mapping.host_ns(trigger.time_ns),
            time_s: clock.map(|it| it.time_s(trigger.time_ns)),
        })));
    }

    fn publish_mark(&self, mark: Marked, _: Mapping) {
        // The clocks' pace differs by less than a millisecond in ten seconds, and the newest frame is
        // nearer than that unless the camera is lost.
        let last = self.current.as_ref().and_then(|it| it.last);
        let time_s = last.map(|it| it.time_s + 1e-9 * (mark.host_ns - it.host_ns));
        self.publish(&Item::Mark(Arc::new(Marked { time_s, ..mark })));
    }
}

impl Tap for Publisher {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        let Event::Packet(packet) = event else { return Ok(()) };
        let now_ns = self.since_begun_ns(now);
        self.sessions.take(packet.clone(), now_ns);
        self.take_judged(now_ns);
        Ok(())
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        let now_ns = self.since_begun_ns(now);
        self.sessions.pass(now_ns);
        self.take_judged(now_ns);
        self.take_marks();
        if self.current.as_ref().is_some_and(|it| it.is_described || it.timing.is_settled(now_ns)) {
            self.publish_held();
        }
        let Some(questions) = self.questions.as_mut().filter(|_| self.current.is_some()) else {
            return Ok(None);
        };
        if now < self.ping_at {
            return Ok(None);
        }
        self.pings = self.pings.saturating_add(1);
        let is_at_first = self.pings < PINGS_AT_FIRST;
        self.ping_at = now + if is_at_first { PING_AT_FIRST_EVERY } else { PING_EVERY };
        Ok(Some(questions.ask(Action::Ping { host_sent_ns: now_ns }).1))
    }
}

#[cfg(test)]
mod tests;
