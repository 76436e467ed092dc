//! What is stored of the inputs that runs have kept: each reaches code that neither the seeds nor a
//! smaller one reaches, so that together they reach all that has been reached, as far as there is room.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use plumbline_test_support::fuzz::{SEEDS, text_of};

use super::{Place, emptied};

/// A stored input has at most this many bytes: each run of the tests tries all of them.
const INPUT_BYTES_MAX: usize = 8 << 10;

/// The stored inputs of a target have at most this many together.
const CORPUS_BYTES_MAX: usize = 40 << 10;

/// Replaces the stored corpus of a target by what it and the runs have, minimised.
pub fn minimise(place: &Place) -> Result<()> {
    let (corpus, seeds) = (place.of("corpus"), place.of("seeds"));
    fs::create_dir_all(&corpus).with_context(|| corpus.display().to_string())?;
    let stored = place.unpacked()?;
    emptied(&seeds)?;
    let merging = place.of("merging");
    emptied(&merging)?;
    let control = merging.join("control.txt");
    // The seeds come first. libFuzzer adds to them what adds to them; the next run empties them.
    let merge = place
        .task()?
        .args(["-merge=1".to_owned(), format!("-merge_control_file={}", control.display())])
        .args([&seeds, &stored, &corpus])
        .env(SEEDS, &seeds.to_string_lossy());
    let mut last = String::new();
    let status = merge.watch(Duration::from_secs(60), |line| {
        last = line.map_or_else(|| std::mem::take(&mut last), str::to_owned);
        true
    })?;
    ensure!(status.success(), "{}: its inputs cannot be merged: {last}", place.target.name);
    let text = fs::read_to_string(&control).with_context(|| control.display().to_string())?;
    let reaching =
        reaching_more(&text).context("libFuzzer's account of a merge is not as known")?;
    let mut inputs = BTreeSet::new();
    for path in reaching.into_iter().filter(|path| !path.starts_with(&seeds)) {
        inputs.insert(fs::read(&path).with_context(|| path.display().to_string())?);
    }
    let all = inputs.len();
    let chosen = chosen(inputs.into_iter().collect());
    let (count, bytes) = (chosen.len(), chosen.iter().map(Vec::len).sum::<usize>());
    let file = place.stored();
    fs::write(&file, text_of(chosen)).with_context(|| file.display().to_string())?;
    println!("{}: {count} of {all} inputs are stored, {bytes} bytes", place.target.name);
    Ok(())
}

/// The inputs of a merge that reached code that none before them did, by libFuzzer's account of it: the
/// number of inputs, and of those that were there first; their paths; then, for each that was tried, what
/// it has reached. `None` for another text.
///
/// ```text
/// 2
/// 1
/// seeds/seed-0
/// corpus/5ba93c
/// STARTED 0 12
/// FT 0 34 35
/// COV 0 7 8
/// STARTED 1 13
/// FT 1 36
/// COV 1
/// ```
fn reaching_more(account: &str) -> Option<Vec<PathBuf>> {
    let mut lines = account.lines();
    let count = lines.next()?.parse().ok()?;
    lines.next()?;
    let paths: Vec<&str> = lines.by_ref().take(count).collect();
    let mut reaching = Vec::new();
    for line in lines {
        let mut words = line.split_whitespace();
        if words.next() == Some("COV") {
            let path = paths.get(words.next()?.parse::<usize>().ok()?)?;
            if words.next().is_some() {
                reaching.push(PathBuf::from(path));
            }
        }
    }
    Some(reaching)
}

/// The smallest inputs, as many as there is room for.
fn chosen(mut inputs: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
    inputs.sort_by_key(Vec::len);
    let mut room = CORPUS_BYTES_MAX;
    inputs.retain(|input| {
        let bytes = input.len();
        let fits = bytes <= INPUT_BYTES_MAX.min(room);
        room -= if fits { bytes } else { 0 };
        fits
    });
    inputs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_reach_more_are_known_by_the_account_of_a_merge() {
        let account = "3\n1\n/s/seed-0\n/c/a\n/c/b\nSTARTED 0 1\nFT 0 34 35\nCOV 0 7 8\n\
                       STARTED 1 2\nFT 1 36\nCOV 1\nSTARTED 2 3\nFT 2 37\nCOV 2 9\n";
        let expected = ["/s/seed-0", "/c/b"].map(PathBuf::from).to_vec();
        assert_eq!(reaching_more(account), Some(expected));
        for other in ["", "1\n", "1\n0\n/c/a\nCOV 1 5\n", "a\n0\n"] {
            assert_eq!(reaching_more(other), None, "{other}");
        }
    }

    #[test]
    fn the_smallest_are_stored_as_far_as_there_is_room() {
        let input = |bytes: usize| vec![0; bytes];
        let inputs = [9000, 8000, 10, 8001, 8002, 8003, 8004].map(input).to_vec();
        let sizes: Vec<usize> = chosen(inputs).iter().map(Vec::len).collect();
        assert_eq!(sizes, [10, 8000, 8001, 8002, 8003, 8004]);
        let inputs = [10, 8189, 8189, 8190, 8191, 8192, 8192].map(input).to_vec();
        let sizes: Vec<usize> = chosen(inputs).iter().map(Vec::len).collect();
        assert_eq!(sizes, [10, 8189, 8189, 8190, 8191]);
    }
}
