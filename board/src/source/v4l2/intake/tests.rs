use std::cell::RefCell;
use std::collections::VecDeque;

use super::*;

const BUFFERS: usize = 4;
const BYTES: usize = 100;

/// A driver that does what the test says, and remembers what it has.
#[derive(Default)]
struct Fake {
    /// Answers to the calls for a frame; `WouldBlock` is "none yet".
    answers: RefCell<VecDeque<Result<Dequeued, i32>>>,
    /// Answers to the waits; [`Wake::Nothing`] when there are no more.
    wakes: RefCell<VecDeque<Wake>>,
    /// Buffers given to it, in order.
    given: RefCell<Vec<u32>>,
    /// It takes no more than this many.
    accepts: Option<usize>,
}

impl Queue for Fake {
    fn queue(&self, index: u32) -> io::Result<()> {
        if self.accepts.is_some_and(|most| self.given.borrow().len() >= most) {
            return Err(io::Error::from_raw_os_error(libc::EIO));
        }
        self.given.borrow_mut().push(index);
        Ok(())
    }

    fn dequeue(&self) -> io::Result<Option<Dequeued>> {
        match self.answers.borrow_mut().pop_front() {
            None | Some(Err(libc::EAGAIN)) => Ok(None),
            Some(Ok(done)) => Ok(Some(done)),
            Some(Err(code)) => Err(io::Error::from_raw_os_error(code)),
        }
    }

    fn wait(&self, timeout: Duration) -> io::Result<Wake> {
        let wake = self.wakes.borrow_mut().pop_front();
        if wake.is_none() {
            std::thread::sleep(timeout);
        }
        Ok(wake.unwrap_or(Wake::Nothing))
    }

    fn now(&self) -> Now {
        Now { monotonic_ns: 1_000_000_000, instant: Instant::now() }
    }
}

impl Fake {
    fn answers(&self, answers: impl IntoIterator<Item = Result<Dequeued, i32>>) {
        self.answers.borrow_mut().extend(answers);
    }

    fn wakes(&self, wakes: impl IntoIterator<Item = Wake>) {
        self.wakes.borrow_mut().extend(wakes);
    }

    /// Buffers given since the last call of this.
    fn given(&self) -> Vec<u32> {
        self.given.take()
    }
}

fn whole(index: u32, sequence: u32) -> Result<Dequeued, i32> {
    Ok(Dequeued { index, sequence, bytes: BYTES, ..Dequeued::default() })
}

fn started(fake: &Fake) -> Intake {
    let intake = Intake::new(fake, BUFFERS, BYTES).unwrap();
    assert_eq!(fake.given(), [0, 1, 2, 3]);
    intake
}

fn out_index(intake: &Intake) -> Option<u32> {
    intake.out().map(|arrived| arrived.ours.index())
}

/// A wait that does not sleep.
fn wait(intake: &mut Intake, fake: &Fake) -> Waited {
    intake.wait(fake, Instant::now())
}

/// A wait in which the fake's wakes come.
fn long_wait(intake: &mut Intake, fake: &Fake) -> Waited {
    intake.wait(fake, Instant::now() + Duration::from_secs(100))
}

#[test]
fn a_frame_stays_ours_until_the_next_wait() {
    let fake = Fake::default();
    let mut intake = started(&fake);
    fake.answers([whole(2, 0)]);
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert_eq!((out_index(&intake), fake.given()), (Some(2), vec![]));
    assert!(!intake.is_late());
    assert!(matches!(wait(&mut intake, &fake), Waited::Quiet));
    // After a wait in vain nothing is out: all is the driver's.
    assert_eq!((out_index(&intake), fake.given()), (None, vec![2]));
    assert_eq!(intake.counts(), Counts::default());
}

#[test]
fn the_newest_two_are_kept_in_order_and_the_others_counted() {
    let fake = Fake::default();
    let mut intake = started(&fake);
    fake.answers([whole(0, 0), whole(1, 1), whole(2, 2), whole(3, 3)]);
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert_eq!((out_index(&intake), intake.is_late()), (Some(2), true));
    assert_eq!(fake.given(), [0, 1]);
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert_eq!((out_index(&intake), intake.is_late()), (Some(3), false));
    assert_eq!(fake.given(), [2]);
    assert_eq!(intake.counts(), Counts { dropped: 2, missed: 0 });
}

#[test]
fn a_frame_that_waits_gives_way_to_two_newer_ones() {
    let fake = Fake::default();
    let mut intake = started(&fake);
    fake.answers([whole(0, 0), whole(1, 1), Err(libc::EAGAIN), whole(2, 2), whole(3, 3)]);
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert_eq!((out_index(&intake), fake.given()), (Some(2), vec![0, 1]));
    assert_eq!(intake.counts(), Counts { dropped: 1, missed: 0 });
}

#[test]
fn damaged_frames_and_gaps_are_missed_frames() {
    let fake = Fake::default();
    let mut intake = started(&fake);
    let damaged =
        Dequeued { index: 0, bytes: BYTES, flags: V4L2_BUF_FLAG_ERROR, ..Dequeued::default() };
    let short = Dequeued { index: 1, sequence: 1, bytes: BYTES - 1, ..Dequeued::default() };
    fake.answers([Ok(damaged), Ok(short), whole(2, 5)]);
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert_eq!((out_index(&intake), fake.given()), (Some(2), vec![0, 1]));
    assert_eq!(intake.counts(), Counts { dropped: 0, missed: 2 + 3 });
}

#[test]
fn a_frame_ends_a_wait_and_a_signal_does_not() {
    let fake = Fake::default();
    let mut intake = started(&fake);
    fake.wakes([Wake::Nothing, Wake::Nothing, Wake::Frame]);
    let none = Err(libc::EAGAIN);
    fake.answers([none, none, none, whole(1, 0)]);
    assert!(matches!(long_wait(&mut intake, &fake), Waited::Ready));
    assert_eq!(out_index(&intake), Some(1));
}

#[test]
fn a_driver_that_errs_is_lost_with_its_reason() {
    let none = Err(libc::EAGAIN);
    let cases = [
        (vec![Err(libc::ENODEV)], vec![], "unplugged"),
        (vec![Err(libc::EIO)], vec![], "Input/output error"),
        (vec![whole(4, 0)], vec![], "buffer 4 of 4"),
        (vec![whole(u32::MAX, 0)], vec![], "buffer 4294967295 of 4"),
        (vec![whole(1, 0), whole(1, 1)], vec![], "buffer 1, which it did not have"),
        (vec![none], vec![Wake::SignalChanged], "signal at its input changed"),
        (vec![none], vec![Wake::Broken], "reports an error"),
        (vec![none, Err(libc::ENODEV)], vec![Wake::Broken], "unplugged"),
    ];
    for (answers, wakes, expected) in cases {
        let fake = Fake::default();
        let mut intake = started(&fake);
        fake.answers(answers);
        fake.wakes(wakes);
        let waited = long_wait(&mut intake, &fake);
        assert!(matches!(&waited, Waited::Lost(what) if what.contains(expected)), "{waited:?}");
        assert!(intake.out().is_none());
    }
}

#[test]
fn a_driver_that_takes_no_buffer_is_lost() {
    let fake = Fake { accepts: Some(3), ..Fake::default() };
    assert!(Intake::new(&fake, BUFFERS, BYTES).is_err());

    let fake = Fake { accepts: Some(4), ..Fake::default() };
    let mut intake = Intake::new(&fake, BUFFERS, BYTES).unwrap();
    fake.answers([whole(0, 0)]);
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert!(matches!(wait(&mut intake, &fake), Waited::Lost(_)));
    assert!(intake.out().is_none());
}

/// Done at once, for ever: one wait takes no more than there are buffers.
#[test]
fn a_driver_that_never_stops_does_not_hold_the_loop() {
    let fake = Fake::default();
    let mut intake = started(&fake);
    fake.answers((0..100).map(|n| whole(n % 4, n)));
    assert!(matches!(wait(&mut intake, &fake), Waited::Ready));
    assert_eq!(fake.answers.borrow().len(), 96);
}

#[test]
fn events_are_told_apart() {
    let cases = [
        (0, Wake::Nothing),
        (libc::POLLIN, Wake::Frame),
        (libc::POLLPRI, Wake::SignalChanged),
        (libc::POLLPRI | libc::POLLIN, Wake::SignalChanged),
        (libc::POLLERR, Wake::Broken),
        (libc::POLLERR | libc::POLLIN, Wake::Broken),
        // What the kernel reports of a device that is gone.
        (libc::POLLERR | libc::POLLHUP | libc::POLLPRI, Wake::Broken),
        (libc::POLLNVAL, Wake::Broken),
    ];
    for (events, expected) in cases {
        assert_eq!(Wake::from_events(events), expected, "{events:#x}");
    }
}
