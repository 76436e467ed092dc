//! The channel of one session.

extern crate std;

use super::super::SEALED_BYTES_MAX;
use super::super::aead::CipherKey;
use super::super::channel::Channel;
use super::super::wire::Purpose;
use super::world::numbered;
use crate::tell::packet::Message;

#[test]
fn only_what_is_authentic_and_has_come_before_is_repeated() {
    let [to_box, to_host] = [1, 2].map(|byte| CipherKey::new([byte; 32]));
    let mut host = Channel::new(Purpose::Listening, 258, to_box.clone(), to_host.clone());
    let mut of_box = Channel::new(Purpose::Listening, 258, to_host, to_box);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let [first, second] =
        [1, 2].map(|number| of_box.seal(&numbered(number), &mut buffer).unwrap().to_vec());
    assert_eq!(host.open(&first), Some(numbered(1)));
    let mut forged = first.clone();
    *forged.last_mut().unwrap() ^= 1;
    let cases = [
        ("as it came", &first[..], true),
        ("forged", &forged, false),
        ("not yet opened", &second, false),
        ("cut off", &first[..3], false),
    ];
    for (what, packet, is_repeated) in cases {
        assert_eq!(host.is_repeated::<Message>(packet), is_repeated, "{what}");
    }
}
