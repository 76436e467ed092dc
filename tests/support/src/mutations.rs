//! Damaged versions of a good file: changed at random, and the same in every run.

/// Values at which arithmetic and allocations go wrong.
const EXTREMES: [&str; 14] = [
    "0",
    "-1",
    "1e160",
    "-1e308",
    "1e999",
    "nan",
    "inf",
    "65535",
    "4294967295",
    "2147483648",
    "18446744073709551615",
    "99999999999999999999",
    "1e-320",
    "0.0000000000000001",
];

/// Versions of a file, each changed in one to three places: bytes overwritten, removed, repeated or
/// cut off, and numbers that became extreme.
pub fn mutations(good: &[u8], count: usize) -> impl Iterator<Item = Vec<u8>> {
    let mut random = Random(1);
    (0..count).map(move |_| {
        let mut bytes = good.to_vec();
        for _ in 0..=random.below(3) {
            mutate(&mut bytes, &mut random);
        }
        bytes
    })
}

/// Knuth's linear congruential generator, of which the high bits are good.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 33) as usize % end.max(1)
    }
}

fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len());
    let end = (at + 1 + random.below(40)).min(bytes.len());
    match random.below(6) {
        0 => bytes[at..end].fill(random.below(256) as u8),
        1 => drop(bytes.drain(at..end)),
        2 => {
            let part = bytes[at..end].to_vec();
            bytes.splice(at..at, part);
        }
        3 if random.below(4) == 0 => bytes.truncate(at),
        4 => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << random.below(8);
            }
        }
        _ => {
            let is_number = |byte: &u8| byte.is_ascii_digit() || b"+-.e".contains(byte);
            let Some(start) = bytes[at..].iter().position(is_number).map(|it| at + it) else {
                return;
            };
            let length = bytes[start..].iter().take_while(|it| is_number(it)).count();
            let extreme = EXTREMES[random.below(EXTREMES.len())];
            bytes.splice(start..start + length, extreme.bytes());
        }
    }
}
