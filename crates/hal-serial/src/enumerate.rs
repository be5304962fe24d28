//! Enumeration of the serial ports of the system.
//!
//! Invariant: the list is sorted by path and contains no pseudo-terminal; a system without a list of ports has an empty
//! one.

use std::path::Path;

/// Identification of a USB adapter or card.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbDevice {
    /// Vendor ID.
    pub vendor: u16,
    /// Product ID.
    pub product: u16,
    /// Serial number.
    pub serial: Option<String>,
    /// Name of product and manufacturer, as far as the device reports it.
    pub name: String,
}

impl UsbDevice {
    /// Whether this is the same device, as far as can be determined. Two adapters without a serial number cannot be
    /// distinguished.
    #[must_use]
    pub fn same(&self, other: &Self) -> bool {
        (self.vendor, self.product, &self.serial) == (other.vendor, other.product, &other.serial)
    }
}

/// A serial port of the system.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundPort {
    /// Its device file.
    pub path: String,
    /// The USB device behind it, if there is one.
    pub usb: Option<UsbDevice>,
}

/// Lists the serial ports that exist now.
#[must_use]
pub fn ports() -> Vec<FoundPort> {
    // the library panics on a system without this folder
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Vec::new();
    }
    let mut found: Vec<FoundPort> =
        serialport::available_ports().unwrap_or_default().into_iter().map(FoundPort::from).collect();
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

impl From<serialport::SerialPortInfo> for FoundPort {
    fn from(info: serialport::SerialPortInfo) -> Self {
        let usb = match info.port_type {
            serialport::SerialPortType::UsbPort(usb) => Some(UsbDevice {
                vendor: usb.vid,
                product: usb.pid,
                serial: usb.serial_number.filter(|s| !s.is_empty()),
                name: [usb.product, usb.manufacturer].into_iter().flatten().collect::<Vec<_>>().join(", "),
            }),
            _ => None,
        };
        Self { path: info.port_name, usb }
    }
}

/// The USB device behind a device file or a link to one.
pub(crate) fn usb_of(path: &Path) -> Option<UsbDevice> {
    let path = path.canonicalize().ok()?;
    ports().into_iter().find(|port| Path::new(&port.path) == path)?.usb
}

/// Current path of a USB device: `path` if it is there, otherwise its new path.
pub(crate) fn find_device(usb: &UsbDevice, path: &Path, there: &[FoundPort]) -> Option<String> {
    let is_it = |port: &&FoundPort| port.usb.as_ref().is_some_and(|found| found.same(usb));
    let resolved = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let same_place = there.iter().filter(is_it).find(|port| Path::new(&port.path) == resolved);
    // without a serial number only the same path identifies the device
    let elsewhere = || usb.serial.is_some().then(|| there.iter().find(is_it)).flatten();
    same_place.or_else(elsewhere).map(|port| port.path.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(path: &str, product: u16, serial: Option<&str>) -> FoundPort {
        let usb = UsbDevice { vendor: 0x0403, product, serial: serial.map(str::to_owned), name: String::new() };
        FoundPort { path: path.to_owned(), usb: Some(usb) }
    }

    #[test]
    fn an_adapter_is_found_under_its_new_number_and_no_other_is_taken_for_it() {
        let usb = |p: FoundPort| p.usb.expect("given");
        let mine = usb(port("", 1, Some("A1")));
        let old = Path::new("/dev/ttyUSB0");
        let there = [port("/dev/ttyUSB0", 1, Some("B2")), port("/dev/ttyUSB1", 1, Some("A1"))];
        assert_eq!(find_device(&mine, old, &there).as_deref(), Some("/dev/ttyUSB1"));
        assert_eq!(find_device(&mine, old, &there[..1]), None, "another adapter has taken its place");
        let nameless = usb(port("", 2, None));
        let there = [port("/dev/ttyUSB0", 2, None), port("/dev/ttyUSB1", 2, None)];
        assert_eq!(find_device(&nameless, old, &there).as_deref(), Some("/dev/ttyUSB0"));
        assert_eq!(find_device(&nameless, old, &there[1..]), None, "nothing says that this is it");
    }

    #[test]
    fn no_pseudo_terminal_is_in_the_list() {
        let there = ports();
        assert!(there.iter().all(|port| !port.path.starts_with("/dev/pts/")), "{there:?}");
        assert!(there.is_sorted_by(|a, b| a.path < b.path));
    }
}
