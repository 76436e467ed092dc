//! Writes an update to the idle slot beside the measurement, and reads it back.
//!
//! A card takes as long as it likes, now and then for a second; the loop that measures must not wait
//! for it. So a thread of its own writes, with an ordinary priority, from a few blocks that go back
//! and forth: where it has none left to give, the sender waits.

use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread;

use anyhow::{Context, Result, ensure};
use plumbline_update::header::HASH_BYTES;
use sha2::{Digest, Sha256};

use super::disk::{BLOCK_BYTES, Block, Disk};
use crate::machine::realtime;

/// Blocks that are on their way at once.
const BLOCKS: usize = 4;

enum Job {
    /// Write the first bytes of a block.
    Write { at: u64, block: Box<Block>, bytes: usize },
    /// Read so many bytes back, and compare their hash.
    Check { bytes: u64, hash: [u8; HASH_BYTES] },
}

/// The thread, as long as it is kept.
#[derive(Debug)]
pub struct Writer {
    jobs: SyncSender<Job>,
    free: Receiver<Box<Block>>,
    outcome: Receiver<Result<()>>,
}

impl Writer {
    /// Starts the thread for this partition.
    ///
    /// # Errors
    /// When it cannot be opened, or no thread can be had.
    pub fn start(partition: &Path) -> Result<Self> {
        let (writer, work) = Self::and_its_work(Disk::open(partition, true)?);
        thread::Builder::new()
            .name("update".into())
            .spawn(move || {
                realtime::be_ordinary();
                work.run();
            })
            .context("no thread that writes the update")?;
        Ok(writer)
    }

    /// A writer without its thread, and what that has to do.
    fn and_its_work(disk: Disk) -> (Self, Work) {
        // Room for all blocks and the last job: nobody ever waits to hand something over.
        let (jobs, to_do) = sync_channel(BLOCKS + 1);
        let (give_back, free) = sync_channel(BLOCKS);
        let (say, outcome) = sync_channel(1);
        for _ in 0..BLOCKS {
            // There is room for them.
            let _ = give_back.try_send(Block::new());
        }
        (Self { jobs, free, outcome }, Work { disk, to_do, give_back, say })
    }

    /// A block to be filled, if one is free.
    pub fn block(&self) -> Option<Box<Block>> {
        self.free.try_recv().ok()
    }

    /// Has the first bytes of a block written at a sector's start.
    pub fn write(&self, at: u64, block: Box<Block>, bytes: usize) {
        // There is room, unless the thread has ended with an error, which `outcome` tells.
        let _ = self.jobs.try_send(Job::Write { at, block, bytes });
    }

    /// Has what was written read back, and compared with what was signed.
    pub fn check(&self, bytes: u64, hash: [u8; HASH_BYTES]) {
        let _ = self.jobs.try_send(Job::Check { bytes, hash });
    }

    /// What came of it, once it is known: of the check, or of a write that failed.
    pub fn outcome(&self) -> Option<Result<()>> {
        match self.outcome.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(anyhow::anyhow!("what writes the update has ended")))
            }
        }
    }
}

/// What the thread has to do, and whom it tells.
struct Work {
    disk: Disk,
    to_do: Receiver<Job>,
    give_back: SyncSender<Box<Block>>,
    say: SyncSender<Result<()>>,
}

impl Work {
    /// Does the jobs until one fails or the last is done, and says what came of it.
    fn run(self) {
        if let Some(outcome) = self.outcome() {
            let _ = self.say.try_send(outcome);
        }
    }

    /// `None` if nobody wants the rest.
    fn outcome(&self) -> Option<Result<()>> {
        while let Ok(job) = self.to_do.recv() {
            match job {
                Job::Write { at, block, bytes } => {
                    if let Err(error) = self.disk.write(at, &block, bytes) {
                        return Some(Err(error));
                    }
                    let _ = self.give_back.try_send(block);
                }
                Job::Check { bytes, hash } => return Some(check(&self.disk, bytes, &hash)),
            }
        }
        None
    }
}

fn check(disk: &Disk, bytes: u64, hash: &[u8; HASH_BYTES]) -> Result<()> {
    disk.sync()?;
    let (mut hasher, mut block) = (Sha256::new(), Block::new());
    let mut at = 0;
    while at < bytes {
        let length = (bytes - at).min(BLOCK_BYTES as u64) as usize;
        disk.read(at, &mut block, length)?;
        hasher.update(&block.bytes()[..length]);
        at += length as u64;
    }
    ensure!(
        hasher.finalize()[..] == hash[..],
        "what is read back from the card is not what was signed: it was changed on its way, or the \
         card is worn out"
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    /// What is on the slot before.
    const BEFORE: u8 = 0xee;

    fn wait<T>(find: impl Fn() -> Option<T>) -> T {
        let give_up = Instant::now() + Duration::from_secs(60);
        loop {
            if let Some(found) = find() {
                return found;
            }
            assert!(Instant::now() < give_up, "it never came");
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// Writes `update` to a slot that has room for a block more, and checks it against `hash`.
    fn written(update: &[u8], hash: [u8; HASH_BYTES]) -> (Vec<u8>, Result<()>) {
        let slot = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(slot.path(), vec![BEFORE; update.len() + BLOCK_BYTES]).unwrap();
        let writer = Writer::start(slot.path()).unwrap();
        for (index, bytes) in update.chunks(BLOCK_BYTES).enumerate() {
            let mut block = wait(|| writer.block());
            block.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
            writer.write((index * BLOCK_BYTES) as u64, block, bytes.len());
        }
        writer.check(update.len() as u64, hash);
        let outcome = wait(|| writer.outcome());
        (std::fs::read(slot.path()).unwrap(), outcome)
    }

    #[test]
    fn what_is_written_is_read_back_and_compared() {
        // More blocks than are on their way at once, and one that is not full.
        let update: Vec<u8> = (0..6 * BLOCK_BYTES + 512).map(|at| (at / 512 % 251) as u8).collect();
        let (slot, outcome) = written(&update, Sha256::digest(&update).into());
        outcome.unwrap();
        assert!(slot.starts_with(&update) && slot[update.len()..].iter().all(|it| *it == BEFORE));
        let (_, outcome) = written(&update, [0; HASH_BYTES]);
        let error = outcome.unwrap_err().to_string();
        assert!(error.contains("not what was signed"), "{error}");
    }

    #[test]
    fn all_blocks_and_the_check_wait_for_a_card_that_takes_nothing_yet() {
        let update = vec![7; BLOCKS * BLOCK_BYTES];
        let slot = tempfile::NamedTempFile::new().unwrap();
        let (writer, work) = Writer::and_its_work(Disk::open(slot.path(), true).unwrap());
        for (index, bytes) in update.chunks(BLOCK_BYTES).enumerate() {
            let mut block = writer.block().expect("all are free");
            block.bytes_mut().copy_from_slice(bytes);
            writer.write((index * BLOCK_BYTES) as u64, block, bytes.len());
        }
        assert!(writer.block().is_none());
        writer.check(update.len() as u64, Sha256::digest(&update).into());
        assert!(writer.outcome().is_none());
        work.run();
        writer.outcome().expect("the check was done").unwrap();
    }

    #[test]
    fn a_slot_that_is_too_small_or_absent_is_an_error_and_nobody_waits() {
        let slot = tempfile::NamedTempFile::new().unwrap();
        let writer = Writer::start(slot.path()).unwrap();
        writer.check(512, [0; HASH_BYTES]);
        let error = wait(|| writer.outcome()).unwrap_err().to_string();
        assert!(error.contains("does not give back"), "{error}");
        assert!(Writer::start(Path::new("/nowhere/slot")).is_err());
    }
}
