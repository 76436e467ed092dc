//! A box whose power supply is too weak.

use super::*;

#[test]
fn a_weak_supply_and_a_slow_processor_are_warned_of_once_each() {
    let (mut receiver, _) = receiver();
    let power = |uptime_ms: u64, undervoltage, throttled| {
        let Message::Health(before) = health(CameraState::Running, uptime_ms, 1) else {
            unreachable!("a Health")
        };
        Message::Health(Health { undervoltage, throttled, ..before })
    };
    let (yes, no) = (Some(true), Some(false));
    let messages = [hello(START), power(8000, None, None), power(8100, no, no)];
    let now = take(&mut receiver, Instant::now(), &messages);
    assert_eq!(receiver.take_notices(), [""; 0]);
    // It restarts in between.
    let now = take(&mut receiver, now, &[power(8200, yes, no), power(8300, no, yes)]);
    let later = now + Duration::from_secs(5);
    for message in [hello(2), power(10, yes, yes)] {
        receiver.handle(Event::Packet(packet(2, message)), later).unwrap();
    }
    assert_eq!(receiver.sessions(), 2);
    let notices = receiver.take_notices().join("\n");
    for part in
        ["warning: the voltage of the box's power supply was", "warning: the box's processor"]
    {
        assert_eq!(notices.matches(part).count(), 1, "{part}: {notices}");
    }
}
