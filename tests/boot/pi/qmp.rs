//! QEMU's own protocol (QMP), as far as it is needed here: what a machine's memory holds, and a
//! picture of its screen.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;

use serde_json::{Value, json};

/// A connection to a running QEMU.
pub struct Qmp {
    stream: BufReader<UnixStream>,
}

impl Qmp {
    pub fn new(stream: UnixStream) -> Self {
        let mut qmp = Self { stream: BufReader::new(stream) };
        qmp.read().expect("it greets");
        qmp.execute("qmp_capabilities", json!({})).expect("it is ready");
        qmp
    }

    /// Lets a machine that waits begin.
    pub fn go(&mut self) {
        self.execute("cont", json!({})).expect("it begins");
    }

    /// The 32-bit word at a physical address; `None` when QEMU has gone.
    pub fn word(&mut self, address: u64) -> Option<u32> {
        let line = format!("xp /1wx {address:#x}");
        let said = self.execute("human-monitor-command", json!({ "command-line": line }))?;
        // As "00000000fe003004: 0x0174f0d8".
        let (_, word) = said.as_str()?.trim().rsplit_once("0x")?;
        u32::from_str_radix(word, 16).ok()
    }

    /// A picture of the screen, as PNG.
    pub fn picture(&mut self, file: &Path) {
        let arguments = json!({ "filename": file, "format": "png" });
        self.execute("screendump", arguments).expect("the screen is shown");
    }

    fn execute(&mut self, command: &str, arguments: Value) -> Option<Value> {
        let request = json!({ "execute": command, "arguments": arguments });
        // In one piece: QEMU looks up from its work for each.
        self.stream.get_mut().write_all(format!("{request}\n").as_bytes()).ok()?;
        loop {
            let mut answer = self.read()?;
            assert!(answer.get("error").is_none(), "{request}: {answer}");
            // What happens meanwhile is told in between.
            if let Some(value) = answer.get_mut("return") {
                return Some(value.take());
            }
        }
    }

    fn read(&mut self) -> Option<Value> {
        let mut line = String::new();
        match self.stream.read_line(&mut line) {
            Ok(1..) => serde_json::from_str(&line).ok(),
            _ => None,
        }
    }
}
