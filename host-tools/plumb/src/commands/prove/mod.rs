//! `plumb prove`: how good the measurements of one's own camera are, with nothing but a printed
//! sheet.

mod distance;
mod live;
mod output;
mod picture;
mod plots;
mod recording;
mod repeatability;
mod source;
mod step;
mod words;

/// Show how good your own camera, lens and light measure, with nothing but a printed sheet.
///
/// Three proofs, from the easiest to the most telling. Each reads recordings or trials, or watches
/// the box that this computer hears and says what to do meanwhile. It checks that what was seen is
/// what the proof needs, and writes a page that can be published, with all figures beside it as
/// JSON. Uncertainties are those of the GUM: standard
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

Then, with the box that sends to this computer:
  plumb prove repeatability --seconds 60         # the plate stands still
  plumb prove distance --seconds 300 \\
      --length-mm 109.0 --length-max-error-mm 0.2      # move it as you are told
  plumb prove step --seconds 120 \\
      --thickness-mm 10 --thickness-max-error-mm 0.01  # rest it as you are told

Or from trials that `plumb receive --out FOLDER` recorded, or from frames:
  plumb prove repeatability still
  plumb prove distance --camera camera.toml --targets targets.toml moved.y4m")]
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
