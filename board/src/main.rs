//! The program of the Plumbline box: see `plumbline-board --help`.

use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result, bail};
use clap::Parser;
use plumbline::config::Config;
use plumbline::packet::ResetReason;
use plumbline::pipeline::Pipeline;
use plumbline::seal::StreamRing;
use plumbline_board::allocation::CountingAllocator;
use plumbline_board::boot::{self, Role};
use plumbline_board::boot_count::count_start;
use plumbline_board::cli::Cli;
use plumbline_board::config_store::ConfigStore;
use plumbline_board::equipment::Equipment;
use plumbline_board::key_store::{self, KeyStore};
use plumbline_board::link::{FileLink, Identity, Links, Ports, SerialLink, UdpLink};
use plumbline_board::logger;
use plumbline_board::machine::realtime;
use plumbline_board::machine::watchdog::Watchdog;
use plumbline_board::random;
use plumbline_board::session::{self, Setup};
use plumbline_board::source::FrameSource;
use plumbline_board::source::chosen::Source;
use plumbline_board::source::replay::{Input, Pace, Replay};
use plumbline_board::trigger::Triggers;
use plumbline_board::update::Updates;
use signal_hook::consts::{SIGINT, SIGTERM};
use static_cell::ConstStaticCell;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Every buffer of the measurement, in static memory.
static PIPELINE: ConstStaticCell<Pipeline> = ConstStaticCell::new(Pipeline::new());

/// The packets that can be sent again.
static RING: ConstStaticCell<StreamRing> = ConstStaticCell::new(StreamRing::new());

/// The rate of a serial line for which neither the command line nor the configuration gives one.
const BAUD_DEFAULT: u32 = 115_200;

fn main() -> ExitCode {
    let arguments: Vec<String> =
        std::env::args_os().map(|it| it.to_string_lossy().into_owned()).collect();
    let (called, rest) = arguments.split_first().map_or(("", &[][..]), |(it, rest)| (it, rest));
    let result = match Role::of(std::process::id(), called) {
        Role::Box => boot::run(PIPELINE.take(), RING.take()),
        Role::Network => {
            logger::install(log::LevelFilter::Info);
            boot::network::run(rest)
        }
        Role::Lease => {
            let event = rest.first().map_or("", String::as_str);
            boot::network::lease::run(event, |name| std::env::var(name).ok());
            Ok(())
        }
        Role::Program => {
            let cli = Cli::parse();
            // For a box elsewhere it does not matter that its host cannot be reached from here.
            let level = if cli.check { log::LevelFilter::Error } else { log::LevelFilter::Info };
            logger::install(level);
            run(&cli)
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Standard error may be closed; then there is nobody to tell.
            let _ = writeln!(std::io::stderr(), "plumbline-board: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    let stop = stop_on_signals()?;
    let config = read_config(cli)?;
    if cli.check {
        let name = cli.config.display();
        Equipment::of(&config)
            .with_context(|| format!("the configuration {name} cannot be used by a box"))?;
        KeyStore::file(&cli.key_file()).read()?;
        let _ = writeln!(std::io::stdout(), "{name}: a box can run with it");
        return Ok(());
    }
    let pipeline = PIPELINE.take();
    pipeline
        .configure(&config)
        .with_context(|| format!("the configuration {} cannot be used", cli.config.display()))?;
    refuse_recording_onto_inputs(cli)?;
    let ports = open_ports(cli, &config)?;
    let key_store = KeyStore::file(&cli.key_file());
    let key = key_store.read();
    key_store::report(&key);
    let boot_count = cli.boot_count_file.as_deref().map(count_start).transpose()?;

    let Some(mut source) = open_source(cli, &config, &stop)? else { return Ok(()) };
    let identity = Identity {
        start: random::start(),
        name: Identity::name_of(&config),
        key,
        store: Some(key_store),
        // The reason for the computer's start may be known, the one for this program's is not.
        reset_reason: ResetReason::Unknown,
        start_count: boot_count,
        refusal: None,
    };
    // A recording can be replayed on any computer, whose settings are then left alone.
    let live = cli.replay.is_none();
    let setup = Setup {
        links: Links::new(ports, identity, Some(RING.take())),
        boot_count,
        reset_reason: ResetReason::Unknown,
        watchdog: if live { Watchdog::of(&config.machine) } else { None },
        triggers: if live {
            Triggers::of(config.trigger.as_ref(), config.capture.as_ref())
        } else {
            Triggers::default()
        },
        store: Some(ConfigStore::file(&cli.config)),
        may_reboot: cli.supervised,
        updates: &mut Updates::impossible(
            "it is a program among others on its computer, and is updated as these are, with apt",
        ),
    };
    if live {
        realtime::set_up(&config.machine);
    }
    let ended = session::run(pipeline, &config, &mut source, setup, &stop);
    let _ = writeln!(std::io::stdout(), "{}", ended.summary);
    if let Some(fault) = ended.broken.or(ended.unrecorded) {
        bail!(fault);
    }
    Ok(())
}

/// The recording given on the command line, or else the camera of the configuration;
/// `None` if the program was stopped while it waited for the recording.
fn open_source(cli: &Cli, config: &Config, stop: &AtomicBool) -> Result<Option<Source>> {
    let name = cli.config.display();
    let Some(path) = &cli.replay else {
        let source = Source::camera(config).with_context(|| {
            format!("no camera can be used (add --replay FILE for a recording): {name}")
        })?;
        return Ok(Some(source));
    };
    let input = Input::from(path.as_path());
    let pace = if cli.unpaced { Pace::Unpaced } else { Pace::Recorded };
    let Some(replay) = Replay::open(&input, pace, cli.fps, stop)? else { return Ok(None) };
    let (width, height) = replay.size_px();
    let expected = (usize::from(config.lens.width_px), usize::from(config.lens.height_px));
    if (width, height) != expected {
        bail!(
            "{input}: its frames are {width}x{height}, but the camera in {name} was calibrated at \
             {}x{}: use the configuration of the camera that made the recording",
            expected.0,
            expected.1
        );
    }
    log::info!(
        "replaying {input}: {width}x{height} at {:.3} frames per second",
        replay.rate().hz()
    );
    Ok(Some(Source::Replay(replay.into())))
}

/// The first signal asks the loop to end; the second ends the program at once.
fn stop_on_signals() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&stop))
            .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&stop)))
            .context("signals cannot be handled")?;
    }
    Ok(stop)
}

fn read_config(cli: &Cli) -> Result<Config> {
    let name = cli.config.display();
    let blob = ConfigStore::file(&cli.config)
        .read()
        .with_context(|| format!("the configuration {name} cannot be read: check the path"))?;
    Config::decode(&blob).with_context(|| {
        format!("the configuration {name} cannot be used: make it again with `plumb provision`")
    })
}

/// Packets are appended, which would spoil a recording or a configuration.
fn refuse_recording_onto_inputs(cli: &Cli) -> Result<()> {
    let Some(record) = &cli.record else { return Ok(()) };
    // A file that does not exist yet is not an input.
    let Ok(existing) = record.canonicalize() else { return Ok(()) };
    let key = cli.key_file();
    let inputs = [Some(&cli.config), Some(&key), cli.replay.as_ref(), cli.boot_count_file.as_ref()];
    let is_input = |input: &std::path::PathBuf| input.canonicalize().is_ok_and(|it| it == existing);
    if inputs.into_iter().flatten().any(is_input) {
        bail!(
            "--record: {} is one of the inputs, and would be spoilt: give another name for the \
             packets",
            record.display()
        );
    }
    Ok(())
}

/// The links of the command line, and those of the configuration that it does not replace.
fn open_ports(cli: &Cli, config: &Config) -> Result<Ports> {
    let udp = cli.udp.clone().or_else(|| config.links.udp.map(|address| address.to_string()));
    let configured = config.links.serial.as_ref();
    let serial = cli.serial.as_deref().or(configured.map(|serial| serial.path.as_str()));
    let baud = cli.baud.or(configured.map(|serial| serial.baud)).unwrap_or(BAUD_DEFAULT);
    if cli.baud.is_some() && serial.is_none() {
        bail!(
            "--baud: there is no serial line, neither here nor in the configuration {}: \
             add --serial DEVICE, or leave --baud out",
            cli.config.display()
        );
    }
    let mut udp = udp.map(|destination| UdpLink::open(&destination)).transpose()?;
    if let Some(port) = cli.listen {
        let Some(udp) = &mut udp else {
            bail!(
                "--listen: the box is announced to nobody over UDP, neither here nor in the \
                 configuration {}: add --udp HOST:PORT, or leave --listen out",
                cli.config.display()
            );
        };
        udp.listen_on(port).with_context(|| {
            format!("--listen: the UDP port {port} cannot be used: give another, or leave it out")
        })?;
    }
    let ports = Ports {
        udp,
        serial: serial.map(|device| SerialLink::open(device, baud)).transpose()?,
        is_one_way: configured.is_some_and(|line| line.one_way),
        file: cli.record.as_deref().map(FileLink::open).transpose()?,
    };
    if ports.is_empty() {
        bail!(
            "packets have nowhere to go: the configuration {} names no link; \
             add --udp HOST:PORT, --serial DEVICE or --record FILE",
            cli.config.display()
        );
    }
    Ok(ports)
}
