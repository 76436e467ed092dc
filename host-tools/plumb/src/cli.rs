//! The command line: the subcommands and the exit codes.

use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

use crate::commands::{
    aim, analyze, budget, calibrate, cohort, demo, desk, doctor, export, figures, gateway, keys,
    manual, optics, pair, prove, provision, receive, replay, report, scene, show, simulate, study,
    target, track, update, validate,
};

/// Measure how a standing person sways, from one camera and two printed targets.
#[derive(Parser)]
#[command(
    name = "plumb",
    version = plumbline::program_version!(),
    arg_required_else_help = true,
    max_term_width = 100
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// One variant per subcommand; each subcommand's module has its arguments and a
/// `run` that takes them.
#[derive(Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Optics(optics::Arguments),
    Target(target::Arguments),
    Calibrate(calibrate::Arguments),
    Scene(scene::Arguments),
    Track(track::Arguments),
    Provision(provision::Arguments),
    Keys(keys::Arguments),
    Pair(pair::Arguments),
    Update(update::Arguments),
    Aim(aim::Arguments),
    Show(show::Arguments),
    Doctor(doctor::Arguments),
    Desk(desk::Arguments),
    Receive(receive::Arguments),
    Gateway(gateway::Arguments),
    Replay(replay::Arguments),
    Analyze(analyze::Arguments),
    Budget(budget::Arguments),
    Figures(figures::Arguments),
    Study(study::Arguments),
    Cohort(cohort::Arguments),
    Report(report::Arguments),
    Export(export::Arguments),
    Validate(validate::Arguments),
    Prove(prove::Arguments),
    Simulate(simulate::SimulateArguments),
    Manual(manual::Arguments),
}

/// Exit code for input that cannot be used, the same as clap's for a wrong command line.
const EXIT_BAD_INPUT: u8 = 2;

/// Exit code when a check of `plumb doctor` or `plumb receive` failed, a camera of `plumb optics` will
/// not do, an error is not shown to be within the limit that `plumb prove` was given, `plumb figures`
/// could not read one of its trials, or `plumb cohort check` found a fault.
const EXIT_FAILED: u8 = 1;

/// Runs the program on its command line.
#[must_use]
pub fn run() -> ExitCode {
    // On Windows `photos/*.png` comes as it was typed.
    let arguments = Arguments::parse_from(wild::args_os());
    match carry_out(&arguments.command) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(EXIT_FAILED),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(EXIT_BAD_INPUT)
        }
    }
}

/// Runs a subcommand. Gives whether what it checks is as it should be; most check nothing.
fn carry_out(command: &Command) -> anyhow::Result<bool> {
    match command {
        Command::Doctor(arguments) => return doctor::run(arguments),
        Command::Prove(arguments) => return prove::run(arguments),
        Command::Receive(arguments) => return receive::run(arguments),
        Command::Figures(arguments) => return figures::run(arguments),
        Command::Cohort(arguments) => return cohort::run(arguments),
        Command::Optics(arguments) => return Ok(optics::run(arguments)),
        Command::Demo(arguments) => demo::run(arguments),
        Command::Desk(arguments) => desk::run(arguments),
        Command::Gateway(arguments) => gateway::run(arguments),
        Command::Target(arguments) => target::run(arguments),
        Command::Calibrate(arguments) => calibrate::run(arguments),
        Command::Scene(arguments) => scene::run(arguments),
        Command::Track(arguments) => track::run(arguments),
        Command::Provision(arguments) => provision::run(arguments),
        Command::Keys(arguments) => keys::run(arguments),
        Command::Pair(arguments) => pair::run(arguments),
        Command::Update(arguments) => update::run(arguments),
        Command::Aim(arguments) => aim::run(arguments),
        Command::Show(arguments) => show::run(arguments),
        Command::Replay(arguments) => replay::run(arguments),
        Command::Analyze(arguments) => analyze::run(arguments),
        Command::Budget(arguments) => budget::run(arguments),
        Command::Study(arguments) => study::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Validate(arguments) => validate::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Manual(arguments) => manual::run(arguments, Arguments::command()),
    }?;
    Ok(true)
}
