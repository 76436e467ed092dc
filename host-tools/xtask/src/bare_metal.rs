//! The core as the only program of a computer, on two emulated boards.
//!
//! The package `tests/bare-metal` is linked with start-up code, a configuration and one rendered
//! frame: no operating system, no allocator. On each board it measures the frame a few times,
//! prints the poses and ends the emulator. The same package, run on this machine with the same
//! limits, must print the same poses.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};

use crate::agreement::{DIFFERENCE_MAX, compare_rows};
use crate::command::{Task, target_directory};
use crate::cross::{BUILT_LIBRARY, Compiler};
use crate::setup::{self, Need, Probe};

const PACKAGE: &str = "plumbline-bare-metal";

/// Rows of a table: the firmware's `STEPS` times the standard scene's two targets.
const ROWS: usize = 5 * 2;

/// Most that [`memory.md`](../../../memory.md) allows `step` of the stack.
const STEP_STACK_BYTES_MAX: u64 = 64 * 1024;

/// Longest run of an emulator, in seconds; it takes a few.
const WITHIN_S: &str = "120";

/// The variable that tells the firmware's build where its frame and its configuration are.
const STORED: &str = "PLUMBLINE_STORED";

/// A board, and what is built for it.
pub struct Board {
    /// QEMU's name of it.
    machine: &'static str,
    triple: &'static str,
    /// What a compiler must know besides the target.
    rustflags: &'static str,
    /// Of the firmware's package.
    features: &'static [&'static str],
    linker: &'static str,
    emulator: &'static [&'static str],
    needs: &'static [Need],
    emulator_needs: &'static [Need],
    /// The lens of `plumb simulate`, which has the frame's size.
    lens: &'static str,
}

/// A 64-bit ARM processor, with the standard frame and the standard limits.
pub const VIRT: Board = Board {
    machine: "virt",
    triple: "aarch64-unknown-none",
    rustflags: "",
    features: &[],
    linker: "aarch64-linux-gnu-ld",
    emulator: &[
        "qemu-system-aarch64",
        "-M",
        "virt",
        "-cpu",
        "cortex-a72",
        "-m",
        "64",
        "-nic",
        "none",
    ],
    needs: &[Need {
        probe: Probe::Program("aarch64-linux-gnu-ld"),
        package: "binutils-aarch64-linux-gnu",
        why: "links firmware for 64-bit ARM",
    }],
    emulator_needs: setup::QEMU_SYSTEM,
    lens: "mild",
};

/// A Cortex-M7, with a smaller frame and the smaller limits.
pub const MPS2_AN500: Board = Board {
    machine: "mps2-an500",
    triple: "thumbv7em-none-eabihf",
    // The target alone has arithmetic of single precision only.
    rustflags: "-Ctarget-cpu=cortex-m7",
    features: &["--features", "small-limits"],
    linker: "arm-linux-gnueabihf-ld",
    emulator: &["qemu-system-arm", "-M", "mps2-an500"],
    needs: &[Need {
        probe: Probe::Program("arm-linux-gnueabihf-ld"),
        package: "binutils-arm-linux-gnueabihf",
        why: "links firmware for 32-bit ARM",
    }],
    emulator_needs: setup::QEMU_MICROCONTROLLER,
    lens: "vga",
};

/// Installs what both boards need.
pub fn prepare() -> Result<()> {
    for board in [&VIRT, &MPS2_AN500] {
        setup::ensure(&[setup::LINKER, board.needs, board.emulator_needs])?;
        board.compiler()?;
    }
    Ok(())
}

/// Builds the firmware, runs it on the board, and compares its poses with this machine's.
pub fn check(board: &Board) -> Result<()> {
    let stored = target_directory().join("bare-metal").join(board.machine);
    board.store(&stored)?;
    let expected = Task::cargo()
        .args(["run", "--quiet", "--package", PACKAGE])
        .args(board.features)
        .args([Path::new("--"), &stored])
        .output()?;
    let firmware = board.build(&stored)?;
    let mut printed = Vec::new();
    let start = Instant::now();
    Task::new("timeout")
        .args([WITHIN_S])
        .args(board.emulator)
        .args(["-display", "none", "-monitor", "none", "-serial", "none"])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .args([firmware])
        .run_and_read(|line| printed.push(line.to_owned()))?;
    let took = start.elapsed();
    let printed = Printed::read(&printed)?;
    let compared = compare_rows(&expected, &printed.table)?;
    println!(
        "{}: {compared}; `step` takes {} bytes of stack, the whole program {}, \
         the pipeline {} bytes; {:.1} s in the emulator",
        board.machine,
        printed.step_stack_bytes,
        printed.program_stack_bytes,
        printed.pipeline_bytes,
        took.as_secs_f64()
    );
    ensure!(
        compared.rows == ROWS && compared.poses == ROWS,
        "there should be {ROWS} poses in as many rows"
    );
    ensure!(
        compared.largest <= DIFFERENCE_MAX,
        "the poses differ from this machine's by {:e} mm or rad, more than {DIFFERENCE_MAX:e}",
        compared.largest
    );
    ensure!(
        printed.step_stack_bytes <= STEP_STACK_BYTES_MAX,
        "`step` takes more of the stack than {STEP_STACK_BYTES_MAX} bytes"
    );
    Ok(())
}

impl Board {
    fn compiler(&self) -> Result<Compiler> {
        Compiler::of(self.triple, BUILT_LIBRARY)
    }

    /// Renders the frame and writes the configuration.
    fn store(&self, directory: &Path) -> Result<()> {
        Task::cargo().args(["build", "--package", "plumb"]).run()?;
        let plumb = || Task::new(target_directory().join("debug/plumb"));
        plumb()
            .args(["simulate", "--force", "--frames", "1", "--lens", self.lens, "--out"])
            .args([directory])
            .run()?;
        let place = |name: &str| directory.join(name).display().to_string();
        plumb()
            .args(["provision", "--force", "--camera", &place("camera.toml")])
            .args(["--targets", &place("targets.toml"), "--scene", &place("scene.toml")])
            .args(["--out", &place("box.plb")])
            .run()
    }

    /// The path of the firmware with what is in `stored`.
    fn build(&self, stored: &Path) -> Result<PathBuf> {
        let own = format!("CARGO_TARGET_{}", self.triple.replace('-', "_").to_uppercase());
        let directory = target_directory().join(self.triple);
        let compiler = self.compiler()?;
        let mut cargo = compiler.cargo(Some("core"));
        if compiler == Compiler::Debian {
            // Nobody else brings `memcpy`. rustup's library has it.
            cargo = cargo.env("CARGO_UNSTABLE_BUILD_STD_FEATURES", "compiler-builtins-mem");
        }
        cargo
            .env(&format!("{own}_LINKER"), self.linker)
            .env(&format!("{own}_RUSTFLAGS"), self.rustflags)
            .env(STORED, &stored.display().to_string())
            .args(["build", "--package", PACKAGE, "--profile", "bare", "--target", self.triple])
            .args(self.features)
            .args([Path::new("--target-dir"), &directory])
            .run()?;
        Ok(directory.join(self.triple).join("bare").join(PACKAGE))
    }
}

/// What the firmware says.
#[derive(Debug, PartialEq)]
struct Printed {
    table: String,
    step_stack_bytes: u64,
    program_stack_bytes: u64,
    pipeline_bytes: u64,
}

impl Printed {
    /// A figure is a line of its name, a tab and its value; the table's lines have commas.
    fn read(lines: &[String]) -> Result<Self> {
        let figure = |name: &str| {
            lines
                .iter()
                .find_map(|line| line.strip_prefix(name)?.strip_prefix('\t')?.trim().parse().ok())
                .with_context(|| format!("the board does not tell {name}"))
        };
        let rows = lines.iter().filter(|line| line.contains(',') && !line.contains('\t'));
        Ok(Self {
            table: rows.map(|row| format!("{}\n", row.trim_end())).collect(),
            step_stack_bytes: figure("step_stack_bytes")?,
            program_stack_bytes: figure("program_stack_bytes")?,
            pipeline_bytes: figure("pipeline_bytes")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_tells_its_table_and_its_figures() {
        let lines = [
            "frame,target",
            "0,lumbar\r",
            "step_stack_bytes\t3",
            "program_stack_bytes\t4",
            "pipeline_bytes\t5",
        ]
        .map(str::to_owned);
        let printed = Printed {
            table: "frame,target\n0,lumbar\n".into(),
            step_stack_bytes: 3,
            program_stack_bytes: 4,
            pipeline_bytes: 5,
        };
        assert_eq!(Printed::read(&lines).unwrap(), printed);
        let error = Printed::read(&lines[..4]).unwrap_err().to_string();
        assert!(error.contains("pipeline_bytes"), "{error}");
    }
}
