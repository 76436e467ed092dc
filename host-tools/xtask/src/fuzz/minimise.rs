//! What is stored of the inputs that runs have kept: the fewest and smallest that together reach all that
//! they have reached, as far as there is room.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use plumbline_test_support::fuzz::SEEDS;

use super::{Place, emptied};

/// A stored input has at most this many bytes: each run of the tests tries all of them.
const INPUT_BYTES_MAX: u64 = 8 << 10;

/// The stored inputs of a target have at most this many together.
const CORPUS_BYTES_MAX: u64 = 40 << 10;

/// Replaces the stored corpus of a target by what it and the runs have, minimised.
pub fn minimise(place: &Place) -> Result<()> {
    let (merged, corpus, stored) = (place.of("merged"), place.of("corpus"), place.stored());
    let seeds = place.of("seeds");
    for directory in [&corpus, &stored] {
        fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    }
    emptied(&merged)?;
    emptied(&seeds)?;
    let merge = place
        .task()?
        .args(["-merge=1"])
        .args([&merged, &stored, &seeds, &corpus])
        .env(SEEDS, &seeds.to_string_lossy());
    let mut last = String::new();
    let status = merge.watch(Duration::from_secs(60), |line| {
        last = line.map_or_else(|| std::mem::take(&mut last), str::to_owned);
        true
    })?;
    ensure!(status.success(), "{}: its inputs cannot be merged: {last}", place.target.name);
    let mut inputs: Vec<(u64, PathBuf)> = Vec::new();
    for entry in fs::read_dir(&merged).with_context(|| merged.display().to_string())? {
        let entry = entry?;
        inputs.push((entry.metadata()?.len(), entry.path()));
    }
    let count = inputs.len();
    let chosen = chosen(inputs);
    emptied(&stored)?;
    for (_, path) in &chosen {
        let name = path.file_name().context("an input without a name")?;
        fs::copy(path, stored.join(name)).with_context(|| path.display().to_string())?;
    }
    let bytes: u64 = chosen.iter().map(|(bytes, _)| bytes).sum();
    println!("{}: {} of {count} inputs are stored, {bytes} bytes", place.target.name, chosen.len());
    Ok(())
}

/// The smallest inputs, as many as there is room for.
fn chosen(mut inputs: Vec<(u64, PathBuf)>) -> Vec<(u64, PathBuf)> {
    inputs.sort();
    let mut room = CORPUS_BYTES_MAX;
    inputs.retain(|(bytes, _)| {
        let fits = *bytes <= INPUT_BYTES_MAX.min(room);
        room -= if fits { *bytes } else { 0 };
        fits
    });
    inputs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_are_stored_as_far_as_there_is_room() {
        let input = |bytes: u64| (bytes, PathBuf::from(bytes.to_string()));
        let inputs = [9000, 8000, 10, 8001, 8002, 8003, 8004].map(input).to_vec();
        let sizes: Vec<u64> = chosen(inputs).into_iter().map(|(bytes, _)| bytes).collect();
        assert_eq!(sizes, [10, 8000, 8001, 8002, 8003, 8004]);
        let inputs = [10, 8189, 8189, 8190, 8191, 8192, 8192].map(input).to_vec();
        let sizes: Vec<u64> = chosen(inputs).into_iter().map(|(bytes, _)| bytes).collect();
        assert_eq!(sizes, [10, 8189, 8189, 8190, 8191]);
    }
}
