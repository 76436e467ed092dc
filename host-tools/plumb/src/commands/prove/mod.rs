//! `plumb prove`: how good the measurements of one's own camera are, with nothing but a printed
//! sheet.

mod distance;
mod output;
mod picture;
mod plots;
mod repeatability;
mod source;
mod step;
mod words;

/// Show how good your own camera, lens and light measure, with nothing but a printed sheet.
///
/// Three proofs, from the easiest to the most telling. Each reads recordings or trials, checks that
/// what was recorded is what the proof needs, says what to do next, and writes a page that can be
/// published, with all figures beside it as JSON. Uncertainties are those of the GUM: standard
/// uncertainties, and expanded ones with k = 2, within which the truth lies in 95 of 100 cases.
///
/// Exit code 0: measured and, if a limit was given, within it; 1: not shown to be within the limit;
/// 2: the input could not be used.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The sheet for all of them:
  plumb target --standard --out pair.pdf --targets targets.toml
Print it at 100 %, do NOT cut it, and glue it to something flat and stiff, such as glass: this is
the plate. It has two boards, called lumbar and shoulder.

Then, with the box:
  plumb receive --duration 60 --out still          # the plate stands still
  plumb prove repeatability still
  plumb receive --out moved                        # move the plate through the volume; end with Ctrl-C
  plumb prove distance --length-mm 109.0 --length-max-error-mm 0.2 moved
  plumb receive --out block                        # rest it 5 s each, without and with the block, in turn
  plumb prove step --thickness-mm 10 --thickness-max-error-mm 0.01 block")]
pub struct Arguments {
    #[command(subcommand)]
    proof: Proof,
}

#[derive(Debug, clap::Subcommand)]
enum Proof {
    Repeatability(repeatability::Arguments),
    Distance(distance::Arguments),
    Step(step::Arguments),
}

/// Runs the subcommand. Gives whether what was measured is within its limit.
///
/// # Errors
/// When an input cannot be used, does not show what the proof needs, or an output cannot be
/// written.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    match &arguments.proof {
        Proof::Repeatability(arguments) => repeatability::run(arguments).map(|()| true),
        Proof::Distance(arguments) => distance::run(arguments),
        Proof::Step(arguments) => step::run(arguments),
    }
}
