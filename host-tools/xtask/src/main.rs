//! `cargo xtask`: the project's own tasks, which need no tool but Rust.
//!
//! | task | does |
//! |---|---|
//! | `demo` | builds the release programs and runs `plumb demo` |
//! | `deny` | checks the dependencies: licences, known flaws, sources |
//! | `test` | formatting, lints, build, tests, and the proof that the core needs no heap |
//! | `image` | makes what a box boots from: for QEMU, an SD card, a Debian package |
//! | `dist` | makes what people download: programs, packages, wheels, images |
//! | `bench` | measures the figures that README.md quotes |
//! | `evidence` | runs what is tried long and often, and writes `tests/evidence.md` |
//! | `fuzz` | tries what must hold for any bytes from outside, with inputs that are made up |
//! | `mutants` | changes the sources a little, and sees whether a test notices |
//!
//! Exit codes: 0 done, 1 something failed, 2 the input cannot be used, or the machine lacks
//! something that could not be installed (the message contains the remedy, or the line to run).

mod agreement;
mod bare_metal;
mod bench;
mod beside;
mod command;
mod commit;
#[cfg(test)]
mod crates;
mod cross;
mod debian;
mod demo;
mod deny;
mod dist;
mod evidence;
mod fuzz;
mod generated;
mod image;
mod instructions;
mod mutants;
mod python;
mod setup;
mod stack;
mod suite;
mod sums;
mod tests;
mod toolchain;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// The project's own tasks.
///
/// Run it as `cargo xtask` anywhere in the checkout. `demo` and `test` install
/// with apt what they lack: they say first what and why, and work as root or
/// through sudo. Every command that is run is printed before it starts.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Build the release programs and run `plumb demo`: a rendered person, the
    /// box's real program, and its packets received over UDP.
    Demo(demo::Arguments),
    /// Check everything: rustfmt, clippy with warnings as errors, build, all
    /// tests, and that the core links without an allocator.
    Test(tests::Arguments),
    /// Check the crates that are used: their licences, known flaws, where they come from. `test` does
    /// this too.
    Deny(deny::Arguments),
    /// Make what a box boots from: for QEMU, an SD card, or a Debian package.
    Image(image::Arguments),
    /// Make what people download: programs for each platform, Debian packages, wheels, the box's
    /// card, with lists of components and SHA-256 sums.
    Dist(dist::Arguments),
    /// Measure speed, spread and memory on rendered frames, beside OpenCV where
    /// Python has it.
    Bench(bench::Arguments),
    /// Run what is tried long and often, and write down how often, and what was found. Takes a night.
    Evidence(evidence::Arguments),
    /// Try what must hold for any bytes from outside, with inputs that libFuzzer
    /// makes up. Ctrl-C ends it; what was counted and found until then is told.
    Fuzz(fuzz::Arguments),
    /// Change the sources a little, thousands of times, and see whether a test notices. Ctrl-C ends it; the
    /// next run goes on.
    Mutants(mutants::Arguments),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().task {
        Task::Demo(arguments) => demo::run(&arguments),
        Task::Test(arguments) => tests::run(&arguments),
        Task::Deny(arguments) => deny::run(&arguments),
        Task::Image(arguments) => image::run(&arguments),
        Task::Dist(arguments) => dist::run(&arguments),
        Task::Bench(arguments) => bench::run(&arguments),
        Task::Evidence(arguments) => evidence::run(&arguments),
        Task::Fuzz(arguments) => fuzz::run(&arguments),
        Task::Mutants(arguments) => mutants::run(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<tests::Told>() => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error:#}");
            let outside = error.is::<setup::Lacking>() || error.is::<command::BadInput>();
            ExitCode::from(if outside { 2 } else { 1 })
        }
    }
}

#[cfg(test)]
mod checks {
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        super::Arguments::command().debug_assert();
    }
}
