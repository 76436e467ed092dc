//! The command line.

use std::path::PathBuf;

use clap::Parser;

use crate::key_store;
use crate::source::rate::Rate;

/// Tracks the two targets and sends pose packets: the program of the Plumbline box.
///
/// Frames come from the camera that the configuration names, or from a recording;
/// every frame becomes one packet, which goes to every host that listens, over UDP or a serial
/// line, and to a file. Hosts listen with the box's key; without a key the box tracks, and takes
/// none but one that comes over its serial line. Hello and Health packets are sent once a
/// second. A camera that is absent or lost is
/// reopened until it is back. A host may send another configuration (`plumb provision`),
/// which replaces FILE.plb and takes effect at the next start. Stop it with Ctrl-C or SIGTERM:
/// the current frame is finished and sent first.
#[derive(Debug, Clone, Parser)]
#[command(
    name = "plumbline-board",
    version = crate::VERSION,
    after_help = "\
Examples:
  Track what the camera sees and send packets where the configuration says:
    plumbline-board --config box.plb
  Replay a recording at its own rate and send packets to a host:
    plumbline-board --config box.plb --replay trial.y4m --udp 192.168.1.20:4210
  As fast as possible, from another program, with the packets written to a file:
    ffmpeg -i trial.mp4 -pix_fmt yuv420p -f yuv4mpegpipe - |
      plumbline-board --config box.plb --replay - --unpaced --record packets.bin
  Over a serial line and UDP at once:
    plumbline-board --config box.plb --replay trial.y4m --serial /dev/ttyAMA0 --udp host:4210

As the first process of a computer (init) it takes no command line: it finds its
configuration, config.plb, on the settings partition, brings up the network and tracks.

Exit code: 0 when the recording ended or the program was asked to stop, 2 when
an input or a device was at fault or a packet could not be recorded; the message
says what is wrong, where, and what to do.
Messages go to standard error, the final figures to standard output."
)]
pub struct Cli {
    /// The configuration: camera, targets, scene, links, the computer's settings
    #[arg(long, value_name = "FILE.plb")]
    pub config: PathBuf,

    /// The key by which the box and its hosts know each other [default: box.key beside FILE.plb]
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,

    /// Track a recording instead of the camera: a Y4M file, 8-bit grey or the luma of 4:2:0;
    /// - reads standard input
    #[arg(long, value_name = "FILE|-")]
    pub replay: Option<PathBuf>,

    /// Track as fast as frames can be read, instead of at the recording's rate
    #[arg(long, requires = "replay")]
    pub unpaced: bool,

    /// The recording's frame rate, if its header gives none or a wrong one: 60 or 60000/1001
    #[arg(long, value_name = "RATE", requires = "replay")]
    pub fps: Option<Rate>,

    /// Announce the box to this host, instead of the configuration's; whoever has the box's key may
    /// listen, wherever it is
    #[arg(long, value_name = "HOST:PORT")]
    pub udp: Option<String>,

    /// The UDP port on which hosts reach the box [default: any that is free]
    #[arg(long, value_name = "PORT")]
    pub listen: Option<u16>,

    /// Send packets over this serial device, instead of the configuration's
    #[arg(long, value_name = "DEVICE")]
    pub serial: Option<String>,

    /// The serial line's rate, 8N1 [default: the configuration's, or 115200]
    #[arg(long, value_name = "BITS_PER_S")]
    pub baud: Option<u32>,

    /// Append packets to this file, in clear; what cannot be written is dropped, and tracking goes on
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,

    /// Count starts in this file and report the count to the host; needed for a serial line on which
    /// nothing comes back
    #[arg(long, value_name = "FILE")]
    pub boot_count_file: Option<PathBuf>,

    /// Exit when the host asks for a restart, so that the supervisor starts the program again
    #[arg(long)]
    pub supervised: bool,

    /// Only check that a box could run with this configuration: that it is valid and names a
    /// camera and a link, and that the key, if there is one, can be read
    #[arg(
        long,
        conflicts_with_all = ["replay", "udp", "listen", "serial", "baud", "record", "boot_count_file", "supervised"]
    )]
    pub check: bool,
}

impl Cli {
    /// The file of the key, which need not exist.
    #[must_use]
    pub fn key_file(&self) -> PathBuf {
        self.key.clone().unwrap_or_else(|| key_store::beside(&self.config))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_key_is_beside_the_configuration_unless_it_is_named() {
        let file = |arguments: &[&str]| {
            let program = ["plumbline-board", "--config", "/boot/ward-3.plb"];
            Cli::try_parse_from(program.iter().chain(arguments)).unwrap().key_file()
        };
        assert_eq!(file(&[]), PathBuf::from("/boot/box.key"));
        assert_eq!(file(&["--key", "ward-3.key"]), PathBuf::from("ward-3.key"));
    }

    #[test]
    fn a_camera_has_neither_a_pace_nor_a_rate_of_a_recording() {
        let parse = |arguments: &[&str]| {
            let program = ["plumbline-board", "--config", "box.plb"];
            Cli::try_parse_from(program.iter().chain(arguments))
        };
        assert_eq!(parse(&[]).unwrap().replay, None);
        for recording_only in [&["--unpaced"][..], &["--fps", "60"]] {
            let error = parse(recording_only).unwrap_err().to_string();
            assert!(error.contains("--replay"), "{error}");
            assert!(parse(&[recording_only, &["--replay", "-"]].concat()).is_ok());
        }
    }
}
