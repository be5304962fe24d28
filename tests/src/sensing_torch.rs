//! A table with a torch that senses the sheet, for tests of its heights.
//!
//! Invariant: its figures are those of the constants here.

/// Pulses per mm of the tool axis.
pub const TOOL_PULSES: f64 = 400.0;
/// Where the sheet is expected, in pulses of the tool axis.
pub const SHEET: i64 = -70 * 400;
/// How the sheet is sensed, unless a test states it otherwise.
pub const SENSE: &str = "contacts = [7], sheet_mm = -70, float_travel_mm = 1.2";

/// A material whose heights are controlled, with a kerf that is known.
pub const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.2\ncut_height_mm = 1.5\nfeed_mm_per_min = 3000\nvolts = 115\n";
/// The analog input that reads the arc voltage.
pub const ARC_VOLTAGE: &str =
    "[[card.analog_input]]\nnumber = 1\nname = \"arc voltage\"\nunit = \"V\"\nat_full = 256\n";

/// The watchdog of the machine file: it tolerates a computer under load, on a card that is faster than a clock, too.
pub const PATIENT: &str = "watchdog_ms = 2000";

/// The machine file, with this table `sense`.
#[must_use]
pub fn machine(sense: &str) -> String {
    let axis = |name: &str, pulses: f64, travel: &str, [velocity, acceleration]: [u32; 2]| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {pulses}\nmax_velocity_mm_per_s = {velocity}\n\
             max_acceleration_mm_per_s2 = {acceleration}\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = {travel}\n"
        )
    };
    let (x, y) = (axis("x", 200.0, "[-50, 500]", [100, 1000]), axis("y", 200.0, "[-50, 500]", [100, 1000]));
    let z = axis("z", TOOL_PULSES, "[-100, 0]", [60, 600]);
    format!(
        "{x}{y}{z}[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nmaterials = \"materials.toml\"\n\
         ok = {{ input = 5 }}\nstart = {{ start_s = 1.0, retry_s = 0.5 }}\nsense = {{ {sense} }}\n\
         [[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n[card]\n{PATIENT}\n"
    )
}
