//! The targets of `cargo xtask fuzz` and their stored inputs, for the command and for the laws that it tries.

use std::fmt::Write as _;

/// Names the directory into which a target's program writes its seeds before it begins.
pub const SEEDS: &str = "PLUMBLINE_FUZZ_SEEDS";

/// Something that is given bytes from outside, and the bounds of its inputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FuzzTarget {
    /// Its name: of its module in `plumbline-laws`, of its program and of its directories.
    pub name: &'static str,
    /// What is tried.
    pub what: &'static str,
    /// The most bytes of an input.
    pub input_bytes_max: u32,
    /// The time that an input may take, on a computer that is busy.
    pub input_s_max: u32,
}

/// All of them.
pub const TARGETS: [FuzzTarget; 9] = [
    FuzzTarget {
        name: "packets",
        what: "packets in clear, their frames on a serial line, a receiver's counts",
        input_bytes_max: 4096,
        input_s_max: 10,
    },
    FuzzTarget {
        name: "link",
        what: "handshakes and sealed packets of a box and its hosts on a hostile network",
        input_bytes_max: 1024,
        input_s_max: 20,
    },
    FuzzTarget {
        name: "config",
        what: "a box's configuration, as it is given, used and given back",
        input_bytes_max: 8192,
        input_s_max: 10,
    },
    FuzzTarget {
        name: "trials",
        what: "journals and folders of trials, damaged and cut off",
        input_bytes_max: 16_384,
        input_s_max: 20,
    },
    FuzzTarget {
        name: "pictures",
        what: "Y4M, PNG, JPEG and PGM at the host, Motion JPEG at the box",
        input_bytes_max: 32_768,
        input_s_max: 20,
    },
    FuzzTarget {
        name: "tables",
        what: "TOML, YAML, JSON, CSV, TRC and C3D at the host",
        input_bytes_max: 8192,
        input_s_max: 20,
    },
    FuzzTarget {
        name: "frames",
        what: "frames through the pipeline: pieces of boards, noise, any times",
        input_bytes_max: 256,
        input_s_max: 20,
    },
    FuzzTarget {
        name: "camera",
        what: "a V4L2 driver's formats, strides, lengths and buffers, in shared memory",
        input_bytes_max: 4096,
        input_s_max: 10,
    },
    FuzzTarget {
        name: "requests",
        what: "HTTP requests and WebSockets at the desk",
        input_bytes_max: 4096,
        input_s_max: 30,
    },
];

/// The text of stored inputs: a line of hexadecimal digits for each, the shortest first.
#[must_use]
pub fn text_of(mut inputs: Vec<Vec<u8>>) -> String {
    inputs.sort_by(|a, b| (a.len(), a).cmp(&(b.len(), b)));
    let mut text = String::new();
    for input in inputs {
        for byte in input {
            // Writing to a string never fails.
            let _ = write!(text, "{byte:02x}");
        }
        text.push('\n');
    }
    text
}

/// The inputs of such a text; `None` for another one.
#[must_use]
pub fn inputs_of(text: &str) -> Option<Vec<Vec<u8>>> {
    let byte = |digits: &[u8]| match digits {
        [b'0'..=b'9' | b'a'..=b'f', b'0'..=b'9' | b'a'..=b'f'] => {
            u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()
        }
        _ => None,
    };
    text.lines().map(|line| line.as_bytes().chunks(2).map(byte).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_come_back_from_their_text_and_what_is_none_is_refused() {
        let inputs = vec![vec![], vec![0x0a], vec![0xff], (0..=255).collect()];
        let text = text_of(inputs.iter().rev().cloned().collect());
        assert!(text.starts_with("\n0a\nff\n0001"), "{text}");
        assert_eq!(inputs_of(&text), Some(inputs));
        assert_eq!(inputs_of(""), Some(Vec::new()));
        for other in ["0", "0a0", "+1", "0A", "xy", "ä"] {
            assert_eq!(inputs_of(other), None, "{other}");
        }
    }
}
