//! Compares `plumb calibrate` with OpenCV's calibrateCamera on real photographs.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};

use super::{Figures, figures_of, get, python_has};
use plumbline_test_support::data_directory;

use crate::command::{Task, root, target_directory};

/// A set of photographs, if the data are present.
struct Set {
    folder: &'static str,
    columns: u8,
    rows: u8,
    pitch_mm: f64,
}

const SETS: [Set; 2] = [
    Set { folder: "opencv_left", columns: 9, rows: 6, pitch_mm: 25.0 },
    Set { folder: "ur3a_cam1/intrinsic", columns: 9, rows: 7, pitch_mm: 20.0 },
];

/// The table; empty if there are no photographs.
pub fn table() -> Result<String> {
    let data = data_directory();
    let mut rows = String::new();
    for set in &SETS {
        let folder = data.join(set.folder);
        if !folder.is_dir() {
            println!("{}: no such photographs; set PLUMBLINE_DATA", folder.display());
            continue;
        }
        let images = images(&folder)?;
        let mut add = |by: &str, figures: &Figures| -> Result<()> {
            let cell = |name| get(figures, name);
            rows += &format!(
                "| {} | {by} | {} | {} | {} +- {} | {} |\n",
                set.folder,
                cell("photographs")?,
                cell("rms_px")?,
                cell("fx_px")?,
                cell("fx_sd_px")?,
                cell("seconds")?
            );
            Ok(())
        };
        add("Plumbline", &ours(set, &images)?)?;
        if python_has("cv2, numpy") {
            let script = root().join("host-tools/bench/opencv_calibration.py");
            let chain = Task::new("python3")
                .args([script])
                .args([set.columns, set.rows].map(|count| count.to_string()))
                .args([set.pitch_mm.to_string()])
                .args(&images);
            add("OpenCV", &figures_of(|each_line| chain.run_and_read(each_line))?)?;
        }
    }
    if rows.is_empty() {
        return Ok(rows);
    }
    let head =
        "| calibration, k1 k2 p1 p2 k3, one core | by | photographs | RMS, px | fx, px | seconds |";
    Ok(format!("{head}\n|---|---|---:|---:|---:|---:|\n{rows}"))
}

fn images(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut images = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "jpg" || extension == "png") {
            images.push(path);
        }
    }
    images.sort();
    Ok(images)
}

fn ours(set: &Set, images: &[PathBuf]) -> Result<Figures> {
    let out = target_directory().join("bench-camera.toml");
    let build = ["build", "--release", "--package", "plumb"];
    Task::cargo().args(build).run()?;
    let start = Instant::now();
    Task::new(target_directory().join("release/plumb"))
        .args(["calibrate", "--force", "--model", "brown5", "--board"])
        .args([format!("{}x{}", set.columns, set.rows), "--pitch-mm".into()])
        .args([set.pitch_mm.to_string(), "--out".into()])
        .args([&out])
        .args(images)
        .env("RAYON_NUM_THREADS", "1")
        .run()?;
    let seconds = start.elapsed().as_secs_f64();
    let text = fs::read_to_string(&out).with_context(|| out.display().to_string())?;
    let file: toml::Table = text.parse()?;
    let number = |table: &toml::Table, name: &str| {
        table.get(name).and_then(toml::Value::as_float).with_context(|| name.to_owned())
    };
    let sd = file.get("calibration").and_then(|it| it.get("sd")).and_then(toml::Value::as_table);
    let photographs = file.get("images").and_then(toml::Value::as_integer).context("images")?;
    Ok(Figures::from([
        ("seconds".to_owned(), format!("{seconds:.2}")),
        ("photographs".to_owned(), photographs.to_string()),
        ("rms_px".to_owned(), format!("{:.4}", number(&file, "rms_px")?)),
        ("fx_px".to_owned(), format!("{:.2}", number(&file, "fx_px")?)),
        ("fx_sd_px".to_owned(), format!("{:.2}", number(sd.context("sd")?, "fx_px")?)),
    ]))
}
