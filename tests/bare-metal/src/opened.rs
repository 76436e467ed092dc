//! A host's end of the boards' line: what the packets say that a board has printed.

use std::fmt::Write as _;

use anyhow::{Context as _, Result, anyhow, bail, ensure};
use plumbline::config::Config;
use plumbline::packet::{Message, SCHEMA_HASH};
use plumbline::seal::{OneWay, StreamOpener};
use plumbline::target::Role;
use plumbline_bare_metal::{PACKET, key, write_header};

/// The table of the packets' poses, with the columns of the others.
pub fn table(printed: &str, blob: &[u8]) -> Result<String> {
    let config = Config::decode(blob).map_err(|error| anyhow!("{error:?}"))?;
    let mut packets = printed.lines().filter_map(|line| line.strip_prefix(PACKET)).map(bytes);
    let announcement = packets.next().context("the board has announced nothing")??;
    let announcement =
        OneWay::read(&key(), &announcement).context("the announcement is not authentic")?;
    ensure!(announcement.schema_hash == SCHEMA_HASH, "the board has other messages");
    let mut stream =
        StreamOpener::one_way(&key(), &announcement).context("no stream can be announced so")?;
    let mut table = String::new();
    write_header(&mut table)?;
    for (counter, packet) in (0..).zip(packets) {
        let packet = packet?;
        let opened = stream.open(&packet).context("a packet is not authentic")?;
        ensure!(opened.counter == counter, "packet {counter} has the number {}", opened.counter);
        ensure!(stream.open(&packet).is_none(), "packet {counter} is taken twice");
        let Message::Pose(pose) = opened.message else { bail!("packet {counter} is no pose") };
        for (target, named) in pose.targets.iter().zip(&config.targets) {
            write!(table, "{},{},{}", pose.sequence, named.name, target.state.word())?;
            let measured = target.pose.map_err(|why| anyhow!("no pose: {why:?}"))?;
            write!(table, ",{}", measured.corners)?;
            for value in measured.theta_rad.iter().chain(&measured.translation_mm) {
                write!(table, ",{value}")?;
            }
            let trunk = match target.role {
                Role::Upper => pose.upper_trunk,
                Role::Lower => pose.lower_trunk,
                Role::Scene => None,
            };
            match trunk {
                Some(at) => writeln!(table, ",{},{},{}", at.ap_mm, at.ml_mm, at.si_mm)?,
                None => writeln!(table, ",,,")?,
            }
        }
    }
    Ok(table)
}

fn bytes(digits: &str) -> Result<Vec<u8>> {
    let pair = |at: usize| {
        let pair = digits.get(at..at + 2).context("half a byte")?;
        Ok(u8::from_str_radix(pair, 16)?)
    };
    (0..digits.trim_end().len()).step_by(2).map(pair).collect()
}
