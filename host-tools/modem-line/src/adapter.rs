//! What the kernel's device tree (sysfs) tells of the adapter behind a serial device.

use std::fs::{self, File};
use std::os::linux::fs::MetadataExt as _;
use std::path::Path;
use std::time::Duration;

use nix::sys::stat::{major, minor};

/// An adapter, or a port of the computer itself.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Adapter {
    /// It tells of a change at most this much later: the computer asks an adapter on USB at intervals
    /// that the adapter names.
    pub late: Duration,
    /// Whether it is a modem on USB.
    pub is_cdc_acm: bool,
}

impl Adapter {
    /// That of a device; one of which nothing is known is taken for the computer's own.
    pub(super) fn of(port: &File) -> Self {
        let Ok(number) = port.metadata().map(|it| it.st_rdev()) else { return Self::default() };
        let place = format!("/sys/dev/char/{}:{}/device", major(number), minor(number));
        Self::at(Path::new(&place))
    }

    fn at(place: &Path) -> Self {
        let Ok(place) = place.canonicalize() else { return Self::default() };
        let driver = place.join("driver").canonicalize().ok();
        let is_cdc_acm = driver.is_some_and(|it| it.ends_with("cdc_acm"));
        // That of FTDI's, which has no interrupt endpoint, in milliseconds.
        if let Some(ms) = read(&place.join("latency_timer")).and_then(|text| text.parse().ok()) {
            return Self { late: Duration::from_millis(ms), is_cdc_acm };
        }
        // The interface on USB is this device, or the one that it belongs to.
        let late = place.ancestors().take(2).find_map(interrupt_interval);
        Self { late: late.unwrap_or_default(), is_cdc_acm }
    }
}

fn read(file: &Path) -> Option<String> {
    fs::read_to_string(file).ok().map(|text| text.trim().to_owned())
}

/// How often the interrupt endpoint of an interface is asked.
fn interrupt_interval(interface: &Path) -> Option<Duration> {
    let entries = fs::read_dir(interface).ok()?.flatten().map(|entry| entry.path());
    let is_asked = |endpoint: &std::path::PathBuf| {
        let is = |name: &str, wanted: &str| {
            read(&endpoint.join(name)).is_some_and(|text| text == wanted)
        };
        is("type", "Interrupt") && is("direction", "in")
    };
    entries.filter(is_asked).find_map(|it| interval(&read(&it.join("interval"))?))
}

/// As the kernel has it: `32ms` or `125us`.
fn interval(text: &str) -> Option<Duration> {
    if let Some(ms) = text.strip_suffix("ms") {
        return ms.parse().ok().map(Duration::from_millis);
    }
    text.strip_suffix("us")?.parse().ok().map(Duration::from_micros)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes the files of an endpoint.
    fn endpoint(interface: &Path, name: &str, [kind, direction, interval]: [&str; 3]) {
        let place = interface.join(name);
        fs::create_dir_all(&place).unwrap();
        for (file, text) in [("type", kind), ("direction", direction), ("interval", interval)] {
            fs::write(place.join(file), format!("{text}\n")).unwrap();
        }
    }

    #[test]
    fn an_adapter_on_usb_is_asked_as_often_as_it_names() {
        let root = tempfile::tempdir().unwrap();
        let [modem, port] = ["1-1:1.0", "1-2:1.0/ttyUSB0"].map(|it| root.path().join(it));
        endpoint(&modem, "ep_82", ["Interrupt", "in", "32ms"]);
        let driver = root.path().join("drivers/cdc_acm");
        fs::create_dir_all(&driver).unwrap();
        std::os::unix::fs::symlink(&driver, modem.join("driver")).unwrap();
        let late = Duration::from_millis(32);
        assert_eq!(Adapter::at(&modem), Adapter { late, is_cdc_acm: true });

        // The port of an adapter is a device below the interface.
        fs::create_dir_all(&port).unwrap();
        let interface = port.parent().unwrap();
        endpoint(interface, "ep_02", ["Bulk", "out", "0ms"]);
        assert_eq!(Adapter::at(&port), Adapter::default());
        endpoint(interface, "ep_81", ["Interrupt", "in", "125us"]);
        let late = Duration::from_micros(125);
        assert_eq!(Adapter::at(&port), Adapter { late, is_cdc_acm: false });
        fs::write(port.join("latency_timer"), "16\n").unwrap();
        let late = Duration::from_millis(16);
        assert_eq!(Adapter::at(&port), Adapter { late, is_cdc_acm: false });
    }

    #[test]
    fn a_port_of_the_computer_itself_tells_at_once() {
        assert_eq!(Adapter::at(Path::new("/no/such/device")), Adapter::default());
        assert_eq!(Adapter::of(&File::open("/dev/null").unwrap()), Adapter::default());
    }
}
