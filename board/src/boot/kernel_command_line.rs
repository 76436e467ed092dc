//! The box's options on the kernel's command line.
//!
//! | option | meaning |
//! |---|---|
//! | `plumbline.udp=ADDRESS:PORT` | the host that is told over UDP why there is no usable configuration |
//! | `plumbline.serial=DEVICE:BAUD` | the same over a serial line |
//!
//! With the feature `fault-injection`, for tests only:
//!
//! | option | meaning |
//! |---|---|
//! | `plumbline.hang_after=FRAMES` | the loop hangs after this number of frames |
//! | `plumbline.panic_after=FRAMES` | the loop panics instead |
//! | `plumbline.try_after=FRAMES` | the box restarts instead, into one try of the other slot |
//! | `plumbline.hang_at_start=SECONDS` | the start hangs before the camera, and has this time in all |
//!
//! All other options are the kernel's. An option that cannot be used is ignored with
//! a warning: a box with a mistyped option still tracks.

use std::time::Duration;

use plumbline::config::{Links, SerialLink};

use super::START_WITHIN;

/// The options in use.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Options {
    /// Where faults are reported when there is no configuration.
    pub links: Links,
    /// Frames until the loop hangs.
    #[cfg(feature = "fault-injection")]
    pub hang_after: Option<u64>,
    /// Frames until the loop panics.
    #[cfg(feature = "fault-injection")]
    pub panic_after: Option<u64>,
    /// Frames until the box restarts into the other slot.
    #[cfg(feature = "fault-injection")]
    pub try_after: Option<u64>,
    /// The time that a start which hangs has, in seconds.
    #[cfg(feature = "fault-injection")]
    pub hang_at_start: Option<u64>,
}

impl Options {
    /// The time for the whole start.
    #[cfg_attr(not(feature = "fault-injection"), expect(clippy::unused_self))]
    pub fn start_within(&self) -> Duration {
        #[cfg(feature = "fault-injection")]
        if let Some(seconds) = self.hang_at_start {
            return Duration::from_secs(seconds);
        }
        START_WITHIN
    }
}

/// The options of this boot.
pub fn read() -> Options {
    let text = std::fs::read_to_string("/proc/cmdline").unwrap_or_else(|error| {
        log::warn!("the kernel command line cannot be read: {error}");
        String::new()
    });
    parse(&text, |complaint| log::warn!("kernel command line: {complaint}"))
}

fn parse(text: &str, mut complain: impl FnMut(String)) -> Options {
    let mut options = Options::default();
    let ours = text.split_whitespace().filter_map(|word| word.strip_prefix("plumbline."));
    for option in ours {
        let (name, value) = option.split_once('=').unwrap_or((option, ""));
        let remedy = match name {
            "udp" => {
                options.links.udp = value.parse().ok();
                options.links.udp.is_none().then_some("give ADDRESS:PORT, as 192.168.1.20:4210")
            }
            "serial" => {
                options.links.serial = serial(value);
                options.links.serial.is_none().then_some("give DEVICE:BAUD, as /dev/ttyS0:115200")
            }
            #[cfg(feature = "fault-injection")]
            "hang_after" => number(value, &mut options.hang_after),
            #[cfg(feature = "fault-injection")]
            "panic_after" => number(value, &mut options.panic_after),
            #[cfg(feature = "fault-injection")]
            "try_after" => number(value, &mut options.try_after),
            #[cfg(feature = "fault-injection")]
            "hang_at_start" => number(value, &mut options.hang_at_start),
            _ => Some("this program has no such option"),
        };
        if let Some(remedy) = remedy {
            complain(format!("plumbline.{option} is ignored: {remedy}"));
        }
    }
    options
}

/// Takes a number; otherwise the remedy.
#[cfg(feature = "fault-injection")]
fn number(value: &str, option: &mut Option<u64>) -> Option<&'static str> {
    *option = value.parse().ok();
    option.is_none().then_some("give a number")
}

fn serial(value: &str) -> Option<SerialLink> {
    let (path, baud) = value.rsplit_once(':')?;
    let path = path.try_into().ok().filter(|path: &heapless::String<_>| !path.is_empty())?;
    Some(SerialLink { path, baud: baud.parse().ok()?, one_way: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> (Options, Vec<String>) {
        let mut complaints = Vec::new();
        let options = parse(text, |complaint| complaints.push(complaint));
        (options, complaints)
    }

    #[test]
    fn the_boxs_options_are_found_among_the_kernels() {
        let (options, complaints) = parsed(
            "console=ttyAMA0 quiet plumbline.udp=10.0.2.2:4210 rdinit=/init \
             plumbline.serial=/dev/ttyUSB0:9600\n",
        );
        assert_eq!(options.links.udp, Some("10.0.2.2:4210".parse().unwrap()));
        let line = options.links.serial.unwrap();
        assert_eq!((line.path.as_str(), line.baud), ("/dev/ttyUSB0", 9600));
        assert_eq!(complaints, Vec::<String>::new());
        assert_eq!(parsed("quiet"), (Options::default(), Vec::new()));
    }

    #[test]
    fn what_cannot_be_used_is_named_and_left_out() {
        let long = format!("plumbline.serial=/dev/{}:9600", "x".repeat(80));
        for wrong in [
            "plumbline.udp",
            "plumbline.udp=",
            "plumbline.udp=host:4210",
            "plumbline.serial=/dev/ttyS0",
            "plumbline.serial=:9600",
            "plumbline.serial=/dev/ttyS0:fast",
            "plumbline.upd=10.0.2.2:4210",
            &long,
        ] {
            let (options, complaints) = parsed(wrong);
            assert_eq!(options, Options::default(), "{wrong}");
            assert!(complaints.len() == 1 && complaints[0].contains(wrong), "{complaints:?}");
        }
    }
}
