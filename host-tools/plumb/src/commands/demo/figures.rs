//! What was measured against what was true.

use std::collections::BTreeMap;
use std::fmt;

use anyhow::{Result, bail};
use comfy_table::{Cell, CellAlignment, Table, presets};
use nalgebra::Vector3;
use plumbline::packet::{AnatomicalPoint, PosePacket};
use plumbline::target::Role;
use plumbline_analysis::filter::SavitzkyGolay;
use plumbline_analysis::statistics::describe::median;
use plumbline_render::simulate::Simulation;

use super::Received;

/// The paper's filter: second order, half a second.
const FILTER_S: f64 = 0.5;

/// 95 % of normally distributed errors lie within this many standard deviations.
const SD_95: f64 = 1.96;

/// The figures of one demo.
#[derive(Debug)]
pub struct Figures {
    frames: u32,
    packets: usize,
    repeated: u64,
    corrupt: u64,
    latency_median_ms: f64,
    latency_worst_ms: f64,
    allocations: Option<u32>,
    rate_hz: f64,
    /// One per target.
    pub targets: Vec<TargetFigures>,
    /// Upper and lower trunk point.
    pub trunk: Vec<TrunkFigures>,
}

/// One target's pose against the truth.
#[derive(Debug)]
pub struct TargetFigures {
    /// Its name.
    pub name: &'static str,
    /// Frames in which it was measured.
    found: usize,
    /// Mean error of x, y, z in the camera frame.
    mean_mm: Vector3<f64>,
    /// 1.96 standard deviations of the error of x, y, z.
    pub spread_mm: Vector3<f64>,
    /// Time and error of the depth.
    pub depth_error: Vec<(f64, f64)>,
}

/// One trunk point's path against the truth, AP, ML, SI.
#[derive(Debug)]
pub struct TrunkFigures {
    /// Its name.
    pub name: &'static str,
    /// Filtered positions, in stretches without a gap.
    pub measured_mm: Vec<Vec<Vector3<f64>>>,
    /// The true positions of the same frames.
    pub true_mm: Vec<Vec<Vector3<f64>>>,
    /// Total path length along each axis.
    path_mm: Vector3<f64>,
    /// The true one over the same frames.
    true_path_mm: Vector3<f64>,
    /// The same after the filter, which cuts sharp turns: what is measured
    /// beyond it is noise.
    filtered_true_path_mm: Vector3<f64>,
}

impl Figures {
    /// The figures of what came from the box.
    pub fn new(simulation: &Simulation, received: &Received, frames: u32) -> Result<Self> {
        // By number: repeated packets count once.
        let packets: BTreeMap<u32, &PosePacket> =
            received.poses.iter().map(|packet| (packet.sequence, packet)).collect();
        if packets.is_empty() {
            bail!("the box sent no pose packet");
        }
        let latencies_ms = || packets.values().map(|packet| f64::from(packet.latency_us) / 1e3);
        let targets = simulation.targets().iter().enumerate();
        Ok(Self {
            frames,
            packets: packets.len(),
            repeated: received.repeated,
            corrupt: received.corrupt,
            latency_median_ms: median(latencies_ms()).unwrap_or_default(),
            latency_worst_ms: latencies_ms().fold(0.0, f64::max),
            allocations: received.heap_allocations,
            rate_hz: simulation.settings().frame_rate_hz,
            targets: targets
                .map(|(index, target)| {
                    TargetFigures::new(simulation, &packets, index, target.layout.name)
                })
                .collect(),
            trunk: [("upper trunk", Role::Upper), ("lower trunk", Role::Lower)]
                .into_iter()
                .map(|(name, role)| TrunkFigures::new(simulation, &packets, name, role))
                .collect(),
        })
    }
}

impl TargetFigures {
    fn new(
        simulation: &Simulation,
        packets: &BTreeMap<u32, &PosePacket>,
        index: usize,
        name: &'static str,
    ) -> Self {
        let role = simulation.targets()[index].layout.role;
        let errors: Vec<(f64, Vector3<f64>)> = packets
            .values()
            .filter_map(|packet| {
                let target = packet.targets.iter().find(|target| target.role == role)?;
                let measured_mm = Vector3::from(target.pose.ok()?.translation_mm).cast::<f64>();
                let truth = simulation.truth(u64::from(packet.sequence));
                let true_mm = truth.targets[index].cam_from_target.translation_mm;
                Some((truth.time_s, measured_mm - true_mm))
            })
            .collect();
        let count = errors.len().max(1) as f64;
        let mean_mm = errors.iter().map(|(_, error)| error).sum::<Vector3<f64>>() / count;
        let squares: Vector3<f64> =
            errors.iter().map(|(_, error)| (error - mean_mm).map(|value| value * value)).sum();
        let spread_mm = squares.map(|square| SD_95 * (square / (count - 1.0).max(1.0)).sqrt());
        Self {
            name,
            found: errors.len(),
            mean_mm,
            spread_mm,
            depth_error: errors.iter().map(|(time_s, error)| (*time_s, error.z)).collect(),
        }
    }
}

impl TrunkFigures {
    fn new(
        simulation: &Simulation,
        packets: &BTreeMap<u32, &PosePacket>,
        name: &'static str,
        role: Role,
    ) -> Self {
        let filter = SavitzkyGolay::lasting(FILTER_S, simulation.settings().frame_rate_hz);
        let index = simulation.targets().iter().position(|target| target.layout.role == role);
        let mut figures = Self {
            name,
            measured_mm: Vec::new(),
            true_mm: Vec::new(),
            path_mm: Vector3::zeros(),
            true_path_mm: Vector3::zeros(),
            filtered_true_path_mm: Vector3::zeros(),
        };
        for stretch in stretches(packets, role) {
            let (frames, points_mm): (Vec<u32>, Vec<Vector3<f64>>) = stretch.into_iter().unzip();
            let Some(measured_mm) = filtered(&points_mm, filter.as_ref()) else { continue };
            let true_mm: Vec<Vector3<f64>> = frames
                .iter()
                .filter_map(|frame| {
                    let point = simulation.truth(u64::from(*frame)).targets[index?].trunk_point;
                    Some(Vector3::new(point.ap_mm, point.ml_mm, point.si_mm))
                })
                .collect();
            if let Some(filtered_mm) = filtered(&true_mm, filter.as_ref()) {
                figures.filtered_true_path_mm += path(&filtered_mm);
            }
            figures.path_mm += path(&measured_mm);
            figures.true_path_mm += path(&true_mm);
            figures.measured_mm.push(measured_mm);
            figures.true_mm.push(true_mm);
        }
        figures
    }
}

/// A trunk point in consecutive frames: their numbers, and AP, ML, SI.
type Stretch = Vec<(u32, Vector3<f64>)>;

fn stretches(packets: &BTreeMap<u32, &PosePacket>, role: Role) -> Vec<Stretch> {
    let mut stretches: Vec<Stretch> = Vec::new();
    for (&frame, packet) in packets {
        let point = if role == Role::Upper { packet.upper_trunk } else { packet.lower_trunk };
        let Some(AnatomicalPoint { ap_mm, ml_mm, si_mm }) = point else { continue };
        let point_mm = Vector3::new(ap_mm, ml_mm, si_mm).cast::<f64>();
        match stretches.last_mut() {
            Some(stretch) if stretch.last().is_some_and(|(last, _)| last + 1 == frame) => {
                stretch.push((frame, point_mm));
            }
            _ => stretches.push(vec![(frame, point_mm)]),
        }
    }
    stretches
}

/// Each axis filtered; `None` when there are fewer points than the filter takes, or the frame
/// rate is too low for it.
fn filtered(
    points_mm: &[Vector3<f64>],
    filter: Option<&SavitzkyGolay>,
) -> Option<Vec<Vector3<f64>>> {
    let axis = |axis: usize| {
        let samples: Vec<f64> = points_mm.iter().map(|point| point[axis]).collect();
        filter?.smooth(&samples)
    };
    let (ap, ml, si) = (axis(0)?, axis(1)?, axis(2)?);
    Some((0..points_mm.len()).map(|i| Vector3::new(ap[i], ml[i], si[i])).collect())
}

/// The sum of the steps along each axis.
fn path(points_mm: &[Vector3<f64>]) -> Vector3<f64> {
    points_mm.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum()
}

impl fmt::Display for Figures {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frames = self.frames as usize;
        writeln!(
            formatter,
            "Frames {frames}, {:.1} s at {} Hz. Packets lost {}, repeated {}, corrupt {}.",
            f64::from(self.frames) / self.rate_hz,
            self.rate_hz,
            frames.saturating_sub(self.packets),
            self.repeated,
            self.corrupt
        )?;
        write!(
            formatter,
            "Time per frame on the box: median {:.2} ms, worst {:.2} ms",
            self.latency_median_ms, self.latency_worst_ms
        )?;
        match self.allocations {
            Some(count) => {
                writeln!(formatter, "; heap allocations after the first frame: {count}.\n")?;
            }
            None => writeln!(formatter, ".\n")?,
        }
        writeln!(formatter, "{}\n\n{}", self.pose_table(), self.path_table())?;
        write!(
            formatter,
            "Spread: 1.96 standard deviations of single, unfiltered frames against the truth.\n\
             Path: total path length; the filter is the paper's (Savitzky-Golay, second order, \
             {FILTER_S} s)."
        )
    }
}

impl Figures {
    fn pose_table(&self) -> Table {
        let header = ["target", "found in", "", "x (mm)", "y (mm)", "z, depth (mm)"];
        let mut table = table(&header);
        for target in &self.targets {
            let found = format!("{} of {}", target.found, self.frames);
            let measured = target.found > 0;
            let rows = [
                (target.name, found, "spread \u{b1}", target.spread_mm),
                ("", String::new(), "mean error", target.mean_mm),
            ];
            for (name, found, what, values) in rows {
                let mut row = vec![Cell::new(name), right(found), Cell::new(what)];
                row.extend(values.iter().map(|value| {
                    right(if measured { format!("{value:.4}") } else { "none".into() })
                }));
                table.add_row(row);
            }
        }
        table
    }

    fn path_table(&self) -> Table {
        let mut table = table(&["path length", "", "AP (mm)", "ML (mm)", "SI (mm)"]);
        for trunk in &self.trunk {
            let measured = !trunk.measured_mm.is_empty();
            let rows = [
                (trunk.name, "measured, filtered", trunk.path_mm),
                ("", "true, filtered", trunk.filtered_true_path_mm),
                ("", "true", trunk.true_path_mm),
            ];
            for (name, what, values) in rows {
                let mut row = vec![Cell::new(name), Cell::new(what)];
                row.extend(values.iter().map(|value| {
                    right(if measured { format!("{value:.2}") } else { "none".into() })
                }));
                table.add_row(row);
            }
        }
        table
    }
}

fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_HORIZONTAL_ONLY);
    table.set_header(header.iter().enumerate().map(|(index, text)| {
        let numbers = text.contains("(mm)") || *text == "found in";
        if numbers && index > 0 { right(*text) } else { Cell::new(text) }
    }));
    table
}

fn right(text: impl Into<String>) -> Cell {
    Cell::new(text.into()).set_alignment(CellAlignment::Right)
}
