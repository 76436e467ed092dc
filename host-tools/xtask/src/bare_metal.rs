//! Runs the core as the only program of a computer, on two emulated boards.
//!
//! The package `tests/bare-metal` is linked with start-up code, a configuration and one rendered
//! frame: no operating system, and no allocator. (A `no_std` library that uses `alloc` compiles, but a
//! program with it is refused where there is no allocator.) On each board it measures the frame a few
//! times, prints the poses and ends the emulator. The same package, run on this machine with the same
//! limits, must print the same poses. The board also prints its poses as sealed packets, which the
//! package opens on this machine as a host would: they must say the same.
//!
//! The stack depth of `Pipeline::step` is measured there, and on this machine, by painting the
//! stack; it is also computed from the same programs with the compiler's stack sizes. memory.md
//! contains both.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use plumbline_test_support::{CONFIG_FILE, FRAMES_FILE, STANDARD, VGA};

use crate::agreement::{DIFFERENCE_MAX, compare_rows};
use crate::command::{Task, root, target_directory};
use crate::cross::{self, BUILT_LIBRARY, Compiler};
use crate::generated::Part;
use crate::setup::{self, Need, Probe};
use crate::stack::{self, Deepest, Processor, Program, table};

const PACKAGE: &str = "plumbline-bare-metal";

/// The number of rows in a table: the firmware's `STEPS` times the standard scene's two targets.
const ROWS: usize = 5 * 2;

/// The largest stack depth of `step` that [`memory.md`](../../../memory.md) allows.
const STEP_STACK_BYTES_MAX: u64 = 64 * 1024;

/// The largest static that need not be listed in memory.md.
const STATIC_BYTES_MAX: u64 = 1024;

/// An allowance for functions whose frame size is unknown: the C library's `memcpy` and the like.
const UNTOLD_BYTES_MAX: u64 = 256;

/// The largest difference of what packets say: half a step of a 32-bit number at 2 to 4 m, in mm.
const PACKET_DIFFERENCE_MAX: f64 = 1.25e-4;

/// The time limit for an emulator, in seconds; a run takes a few.
const WITHIN_S: &str = "120";

/// The variable that tells the firmware's build where its frame and its configuration are.
const STORED: &str = "PLUMBLINE_STORED";

/// What the board has printed, in the directory of its frame and its configuration.
const PRINTED_FILE: &str = "printed.txt";

/// The name of `Pipeline::step` in the program.
const STEP: &str = "plumbline_bare_metal::step";

/// What to do with the tables in memory.md.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Document {
    Compare,
    Write,
}

/// A board and the settings to build for it.
pub struct Board {
    /// QEMU's name for it, or a substitute.
    pub name: &'static str,
    /// Its title in memory.md.
    title: &'static str,
    triple: &'static str,
    processor: Processor,
    /// The compiler flags needed besides the target.
    rustflags: &'static str,
    /// The features of the program's package.
    features: &'static [&'static str],
    /// The emulator's command line; empty if the program runs on this machine.
    emulator: &'static [&'static str],
    needs: &'static [Need],
    emulator_needs: &'static [Need],
    /// The recording whose first frame is measured.
    recording: &'static str,
}

/// All boards available on this machine.
pub const BOARDS: &[Board] =
    if cfg!(target_arch = "x86_64") { &[VIRT, MPS2_AN500, HERE] } else { &[VIRT, MPS2_AN500] };

/// A 64-bit ARM processor, with the standard frame and the standard limits.
const VIRT: Board = Board {
    name: "virt",
    title: "aarch64 (QEMU's `virt`)",
    triple: "aarch64-unknown-none",
    processor: Processor { binutils: "aarch64-linux-gnu-", address_bytes: 8, call_bytes: 0 },
    rustflags: "",
    features: &[],
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
    recording: STANDARD,
};

/// A Cortex-M7, with a smaller frame and the smaller limits.
const MPS2_AN500: Board = Board {
    name: "mps2-an500",
    title: "Cortex-M7 (QEMU's `mps2-an500`, the smaller limits)",
    triple: "thumbv7em-none-eabihf",
    processor: Processor { binutils: "arm-linux-gnueabihf-", address_bytes: 4, call_bytes: 0 },
    // The target by default has single-precision arithmetic only.
    rustflags: "-Ctarget-cpu=cortex-m7",
    features: &["--features", "plumbline-bare-metal/small-limits"],
    emulator: &["qemu-system-arm", "-M", "mps2-an500"],
    needs: &[Need {
        probe: Probe::Program("arm-linux-gnueabihf-ld"),
        package: "binutils-arm-linux-gnueabihf",
        why: "links firmware for 32-bit ARM",
    }],
    emulator_needs: setup::QEMU_MICROCONTROLLER,
    recording: VGA,
};

/// This machine: the same program under its operating system.
const HERE: Board = Board {
    name: "x86-64",
    title: "x86-64",
    triple: "x86_64-unknown-linux-gnu",
    // The return address.
    processor: Processor { binutils: "", address_bytes: 8, call_bytes: 8 },
    rustflags: "",
    features: &[],
    emulator: &[],
    needs: setup::BINUTILS,
    emulator_needs: &[],
    recording: STANDARD,
};

/// Installs what all boards need.
pub fn prepare() -> Result<()> {
    for board in BOARDS {
        setup::ensure(&[setup::LINKER, board.needs])?;
        // By itself: where an emulator conflicts with what the system has, it is unpacked beside the
        // system, with everything that is asked for at once.
        setup::ensure(&[board.emulator_needs])?;
        cross::add_target(board.triple);
        board.compiler()?;
    }
    Ok(())
}

/// The target directory of all boards. Separate from the other builds, so that their choice of features does
/// not affect it.
fn directory() -> PathBuf {
    target_directory().join("bare")
}

impl Board {
    /// Builds what [`Self::check`] needs, which then finds it built.
    pub fn build_ahead(&self, recordings: &Path) -> Result<()> {
        let stored = self.stored(recordings)?;
        self.build_here()?;
        self.build(&stored).map(drop)
    }

    /// Builds the program, runs it on the board, and compares its poses with this machine's and its
    /// stack with memory.md.
    pub fn check(&self, recordings: &Path, document: Document) -> Result<()> {
        let stored = self.stored(recordings)?;
        let expected = self.here(&[&stored])?;
        let expected = Printed::read(&expected.lines().map(str::to_owned).collect::<Vec<_>>())?;
        let program = self.build(&stored)?;
        let start = Instant::now();
        let printed = self.run(&program, &stored)?;
        let took = start.elapsed();
        let compared = compare_rows(&expected.table, &printed.table)?;
        println!(
            "{}: {compared}; `step` takes {} bytes of stack, the whole program {}, \
             the pipeline {} bytes; {:.1} s",
            self.name,
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
        self.check_packets(&expected.table, &stored)?;
        let symbols = Task::new(format!("{}nm", self.processor.binutils))
            .args(["--print-size", "--demangle"])
            .args([&program])
            .output()?;
        if !self.emulator.is_empty() {
            let initialised = initialised(&symbols);
            ensure!(
                initialised.is_empty(),
                "{initialised:?} does not begin as zeros, and so takes as much of a board's flash as of its \
                 memory: let it begin as zeros, as an idle pipeline does"
            );
        }
        let memory = fs::read_to_string(root().join("memory.md")).context("memory.md")?;
        for name in statics(&symbols) {
            ensure!(
                memory.contains(&format!("| `{name}` | static |")),
                "the core has a static {name} of more than {STATIC_BYTES_MAX} bytes: add it to \
                 memory.md's first table, and its type to tests/core/memory.rs"
            );
        }
        let deepest = Program::read(&program, &self.processor)?.deepest_from(STEP)?;
        self.check_stack(&deepest, printed.step_stack_bytes, document)
    }

    /// Runs the program on this machine; what it prints.
    fn here(&self, arguments: &[&Path]) -> Result<String> {
        Task::new(self.build_here()?).args(arguments).output()
    }

    /// Builds the program for this machine, in the place of that for another board; returns its path.
    /// Of the whole workspace, so that what it uses has the features, and so the builds, of the tests.
    fn build_here(&self) -> Result<PathBuf> {
        let build = ["build", "--quiet", "--workspace", "--bin", PACKAGE];
        Task::cargo().args(build).args(self.features).output()?;
        Ok(target_directory().join("debug").join(PACKAGE))
    }

    /// Opens the packets that the board has printed, and compares what they say with this machine's
    /// poses.
    fn check_packets(&self, expected: &str, stored: &Path) -> Result<()> {
        let opened = self.here(&[stored, &stored.join(PRINTED_FILE)])?;
        let compared = compare_rows(expected, &opened).context("the sealed packets")?;
        println!("{}: in sealed packets {compared}", self.name);
        ensure!(
            compared.rows == ROWS && compared.poses == ROWS,
            "there should be {ROWS} poses in the packets"
        );
        ensure!(
            compared.largest <= PACKET_DIFFERENCE_MAX,
            "the poses in the packets differ from this machine's by {:e} mm or rad, more than \
             {PACKET_DIFFERENCE_MAX:e}",
            compared.largest
        );
        Ok(())
    }

    /// Compares both stack depths with the bound, with each other, and with memory.md.
    fn check_stack(&self, deepest: &Deepest, painted: u64, document: Document) -> Result<()> {
        let title = format!("{}, rustc {}", self.title, self.compiler()?.version()?);
        let measured = table::table(&title, deepest, painted);
        let name = format!("stack: {}", self.name);
        let part = Part { document: "memory.md", name: &name };
        println!("{measured}");
        match document {
            Document::Write => part.write(&measured)?,
            Document::Compare => table::compare(&part.read()?, &measured).with_context(|| {
                format!(
                    "memory.md differs from the build. If this is intended, update it with \
                     `cargo xtask test bare-metal --write-memory`. For {} it should contain:\n\n{measured}\n\n",
                    self.name
                )
            })?,
        }
        let untold = if deepest.uncounted.is_empty() { 0 } else { UNTOLD_BYTES_MAX };
        check_depth(deepest.bytes() + untold, painted)
    }

    fn compiler(&self) -> Result<Compiler> {
        Compiler::of(self.triple, BUILT_LIBRARY)
    }

    /// Puts the recording's first frame and its configuration into a directory of the board's.
    fn stored(&self, recordings: &Path) -> Result<PathBuf> {
        let directory = target_directory().join("bare-metal").join(self.name);
        let from = recordings.join(self.recording);
        fs::create_dir_all(&directory).with_context(|| directory.display().to_string())?;
        let place = from.join(FRAMES_FILE);
        let frame = first_frame(&place).with_context(|| place.display().to_string())?;
        let config = fs::read(from.join(CONFIG_FILE)).context(CONFIG_FILE)?;
        for (name, content) in [(CONFIG_FILE, config), (FRAMES_FILE, frame)] {
            let stored = directory.join(name);
            // What contains it would be built again if it were written again.
            if !fs::read(&stored).is_ok_and(|before| before == content) {
                fs::write(&stored, content).with_context(|| stored.display().to_string())?;
            }
        }
        Ok(directory)
    }

    /// The output of the program.
    fn run(&self, program: &Path, stored: &Path) -> Result<Printed> {
        let task = Task::new("timeout").args([WITHIN_S]).args(self.emulator);
        let task = if self.emulator.is_empty() {
            task.args([program, stored])
        } else {
            task.args(["-display", "none", "-monitor", "none", "-serial", "none"])
                .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
                .args([program])
        };
        let mut printed = Vec::new();
        task.run_and_read(|line| printed.push(line.to_owned()))?;
        let place = stored.join(PRINTED_FILE);
        fs::write(&place, printed.join("\n")).with_context(|| place.display().to_string())?;
        Printed::read(&printed)
    }

    /// Builds the program and returns its path; firmware includes the files in `stored`.
    fn build(&self, stored: &Path) -> Result<PathBuf> {
        let own = format!("CARGO_TARGET_{}", self.triple.replace('-', "_").to_uppercase());
        let directory = directory();
        let compiler = self.compiler()?;
        let mut cargo = compiler.cargo(Some("core"));
        cargo = match compiler {
            // `memcpy` has no other source. rustup's library includes it.
            Compiler::Debian => {
                cargo.env("CARGO_UNSTABLE_BUILD_STD_FEATURES", "compiler-builtins-mem")
            }
            // Emitting the frame sizes of functions is unstable.
            Compiler::Rustup => cargo.env("RUSTC_BOOTSTRAP", "1"),
        };
        if !self.emulator.is_empty() {
            let linker = format!("{}ld", self.processor.binutils);
            cargo = cargo.env(&format!("{own}_LINKER"), &linker);
        }
        let rustflags = format!("{} {}", stack::RUSTFLAGS, self.rustflags);
        cargo
            .env(&format!("{own}_RUSTFLAGS"), rustflags.trim_end())
            .env(STORED, &stored.display().to_string())
            .args(["build", "--package", PACKAGE, "--profile", "bare", "--target", self.triple])
            .args(self.features)
            .args([Path::new("--target-dir"), &directory])
            .run()?;
        Ok(directory.join(self.triple).join("bare").join(PACKAGE))
    }
}

/// The bound is exact, whatever memory.md may be off by: `most` is what the deepest path may take, with
/// what is allowed for functions without a known frame, and `painted` what a run did take.
fn check_depth(most: u64, painted: u64) -> Result<()> {
    ensure!(
        painted <= most,
        "{painted} bytes of stack were used, but the deepest path adds up to {most}: a call in the \
         program was missed"
    );
    ensure!(
        most <= STEP_STACK_BYTES_MAX,
        "`step` may take {most} bytes of the stack, more than {STEP_STACK_BYTES_MAX}"
    );
    Ok(())
}

/// The beginning of a grey Y4M file, up to and including its first frame.
fn first_frame(place: &Path) -> Result<Vec<u8>> {
    let mut file = BufReader::new(File::open(place)?);
    let mut beginning = Vec::new();
    file.read_until(b'\n', &mut beginning)?;
    let header = String::from_utf8_lossy(&beginning).into_owned();
    let number =
        |key| header.split([' ', '\n']).find_map(|word| word.strip_prefix(key)?.parse().ok());
    let size: [Option<u64>; 2] = ['W', 'H'].map(number);
    let [Some(width), Some(height)] = size else { bail!("no size in {header}") };
    file.read_until(b'\n', &mut beginning)?;
    file.take(width * height).read_to_end(&mut beginning)?;
    Ok(beginning)
}

/// The core's statics of more than [`STATIC_BYTES_MAX`], from the lines `address size kind name` of
/// a program's symbol table.
fn statics(symbols: &str) -> Vec<&str> {
    let large = symbols.lines().filter_map(|line| {
        let mut words = line.splitn(4, ' ').skip(1);
        let (size, kind, name) = (words.next()?, words.next()?, words.next()?);
        let is_large = u64::from_str_radix(size, 16).ok()? > STATIC_BYTES_MAX;
        let is_cores = name.starts_with("plumbline::") && !kind.eq_ignore_ascii_case("t");
        (is_large && is_cores).then(|| name.rsplit("::").next().unwrap_or(name))
    });
    large.collect()
}

/// The names of what changes and does not begin as zeros, from the same lines.
fn initialised(symbols: &str) -> Vec<&str> {
    let data = symbols.lines().filter_map(|line| {
        let mut words = line.splitn(4, ' ').skip(2);
        let (kind, name) = (words.next()?, words.next()?);
        kind.eq_ignore_ascii_case("d").then_some(name)
    });
    data.collect()
}

/// The output of the firmware.
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
                .with_context(|| format!("the board did not print {name}"))
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
    fn a_recording_is_cut_after_its_first_frame() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let one = "YUV4MPEG2 W3 H2 F60:1 Cmono\nFRAME\nabcdef";
        fs::write(file.path(), format!("{one}FRAME\nghijkl")).unwrap();
        assert_eq!(first_frame(file.path()).unwrap(), one.as_bytes());
        fs::write(file.path(), "YUV4MPEG2 W3\n").unwrap();
        assert!(first_frame(file.path()).is_err());
    }

    #[test]
    fn the_stacks_bound_is_exact() {
        check_depth(65_536, 65_536).unwrap();
        let too_deep = check_depth(65_537, 60_000).unwrap_err().to_string();
        assert!(too_deep.contains("65537 bytes of the stack, more than 65536"), "{too_deep}");
        assert!(check_depth(60_000, 60_001).is_err());
    }

    #[test]
    fn only_large_statics_of_the_core_are_listed() {
        let symbols = "0000000000097e30 0000000000000408 d plumbline::checksum::CRC32\n\
                       0000000000097e30 0000000000000400 r plumbline::SMALL\n\
                       000000000000ad50 0000000000000940 d std::CACHE\n\
                       0000000000001000 0000000000002000 t plumbline::pose::solve\n\
                       0000000000001000 t plumbline::pose::solve\n\
                                        U memcpy\n";
        assert_eq!(statics(symbols), ["CRC32"]);
        assert_eq!(initialised(symbols), ["plumbline::checksum::CRC32", "std::CACHE"]);
    }

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
