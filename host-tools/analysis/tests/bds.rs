//! Published figures of published trials are reproduced: the data set BDS (Santos & Duarte 2016,
//! PeerJ 4:e2648).

use plumbline_test_support::data;
use std::io::Read;
use std::path::Path;

use flate2::read::GzDecoder;
use plumbline_analysis::filter::Design;
use plumbline_analysis::series::Series;
use plumbline_analysis::sway::{Settings, Sway, analyze};

/// The sway of one trial, in cm as in the reference.
fn sway(folder: &Path, trial: &str) -> Sway {
    let file = std::fs::File::open(folder.join(format!("{trial}.txt.gz"))).unwrap();
    let mut text = String::new();
    GzDecoder::new(file).read_to_string(&mut text).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split('\t').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split('\t').map(|it| it.parse().unwrap()).collect()).collect();
    let column = |name: &str| -> Vec<f64> {
        let index = names.iter().position(|it| *it == name).unwrap();
        rows.iter().map(|row| row[index]).collect()
    };
    let positions = [column("COPx[cm]"), column("COPy[cm]"), Vec::new()];
    let series = Series::new(column("Time[s]"), positions).unwrap();
    let settings = Settings { filter: Design::None, bins_s: Vec::new(), ..Default::default() };
    analyze(&series, None, &settings).unwrap()
}

#[test]
fn velocity_and_area_are_the_data_sets_own() {
    let Some(folder) = data("sway") else { return };
    let reference = std::fs::read_to_string(folder.join("BDS_reference.tsv")).unwrap();
    let mut trials = 0;
    for line in reference.lines().skip(1) {
        let fields: Vec<&str> = line.split('\t').collect();
        let expected = |column: usize| fields[column].parse::<f64>().unwrap();
        let sway = sway(&folder, fields[0]);
        let area = sway.figures.ellipse.transverse.area_mm2.value().unwrap();
        let velocity = sway.figures.path.mean_velocity_mm_s.planes.transverse.value().unwrap();
        let (area, velocity) = (area / expected(3) - 1.0, velocity / expected(4) - 1.0);
        println!("{}: area {area:.1e}, velocity {velocity:.1e} relative", fields[0]);
        // The authors' quantile of F is accurate to 7.5e-13. The rate is computed from times with
        // two decimals.
        assert!(area.abs() < 1e-12 && velocity.abs() < 1e-12, "{area} {velocity}");
        trials += 1;
    }
    assert_eq!(trials, 4);
}
