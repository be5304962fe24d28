//! Manual inputs of the machine at a served card, as text lines: handwheel, switches, doors.
//!
//! Invariant: a line that cannot be parsed has no effect, and is reported.

use retrace_config::AnalogInput;
use retrace_hal_sim::{CardSimulator, SpindlePlant};
use retrace_link::{InputSetting, InputUse};

/// Syntax of the lines.
const SYNTAX: &str = "`wheel -120 for 2s`, `wheel -7`, `press door`, `release door`, `press emergency-stop`, `press \
    probe`, `press breakaway`, \
    `input 5 on`, `input 5 off`, `unplug`, `plug in`, `power off`, `power on`, `spindle load 30% for 200ms`, `spindle \
    stall`, `spindle free`, `spindle turn -2`, `encoder dead`, `encoder lose 7`, `encoder no-index`, `analog 1 3.2`, \
    `analog 1 none`";

/// Inputs of the machine file.
#[derive(Clone, Copy, Debug)]
pub struct DeclaredInputs<'m> {
    pub digital: &'m [InputSetting],
    pub analog: &'m [AnalogInput],
}

/// Manual input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ManualInput {
    /// Turns the handwheel at this number of counts per second, for this number of microseconds.
    Wheel { counts_per_s: i32, for_us: u64 },
    /// Turns the handwheel by this number of counts at once.
    Notch(i16),
    /// Makes an input active or inactive; a switch that an axis operates still follows its axis.
    Input { number: u8, active: bool },
    /// Pulls the cable of the line out, or plugs it in: what is sent meanwhile is lost in both directions.
    Cable { is_in: bool },
    /// Switches the card off or on: its state and position are lost, and the machine stays where it is.
    Power { is_on: bool },
    /// Sets an analog input, to a reading in units of 2⁻¹⁶ of its range, or to none.
    Analog { number: u8, reading: Option<u16> },
    /// Something happens to the spindle or its encoder.
    Spindle(SpindleEvent),
}

/// What happens to the spindle or its encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SpindleEvent {
    /// It loses this part of its speed for so many microseconds.
    Load(f64, u64),
    /// It is stopped at once, or free again.
    Stalled(bool),
    /// It is turned by hand by so many turns, at half a turn per second.
    Turned(f64),
    /// Its encoder shows nothing any more.
    EncoderDead,
    /// Its encoder loses so many counts.
    CountsLost(i64),
    /// Its encoder shows no index any more.
    IndexLost,
}

impl ManualInput {
    /// Parses a line; inputs are those of the machine file. `None` for an empty line, and for a comment after
    /// `#`.
    ///
    /// # Errors
    /// The line is invalid; the text includes the syntax.
    pub fn read(line: &str, inputs: DeclaredInputs<'_>) -> Result<Option<Self>, String> {
        let words: Vec<&str> = line.split('#').next().unwrap_or_default().split_whitespace().collect();
        let wrong = || format!("`{}` is not a manual input; possible are {SYNTAX}", line.trim());
        let input = |what: &str, active: bool| -> Result<Self, String> {
            let used_for = used_for(what).ok_or_else(wrong)?;
            let number = inputs.digital.iter().position(|input| input.used_for == used_for);
            let number = number.ok_or_else(|| format!("no input is wired as {what}; see `[[card.input]]`"))?;
            Ok(Self::Input { number: number as u8, active })
        };
        Ok(Some(match words[..] {
            [] => return Ok(None),
            ["wheel", counts, "for", time] => Self::Wheel {
                counts_per_s: counts.parse().ok().filter(|counts: &i32| counts.abs() <= 1_000_000).ok_or_else(wrong)?,
                for_us: microseconds(time).ok_or_else(wrong)?,
            },
            ["wheel", counts] => Self::Notch(counts.parse().map_err(|_| wrong())?),
            ["press", what] => input(what, true)?,
            ["release", what] => input(what, false)?,
            ["input", number, level @ ("on" | "off")] => {
                let number = number.parse().ok().filter(|&number: &u8| usize::from(number) < inputs.digital.len());
                Self::Input { number: number.ok_or_else(wrong)?, active: level == "on" }
            }
            ["analog", number, amount] => {
                let number = number.parse::<u8>().ok();
                let amount = match amount {
                    "none" => None,
                    amount => Some(amount.parse().ok().filter(|amount: &f64| amount.is_finite()).ok_or_else(wrong)?),
                };
                let input = inputs.analog.iter().find(|input| Some(input.number) == number);
                let input = input.ok_or("no such analog input is declared; see `[[card.analog_input]]`")?;
                Self::Analog { number: input.number, reading: amount.map(|amount| input.reading(amount)) }
            }
            ["unplug"] => Self::Cable { is_in: false },
            ["plug", "in"] => Self::Cable { is_in: true },
            ["spindle" | "encoder", ..] => Self::Spindle(SpindleEvent::read(&words).ok_or_else(wrong)?),
            ["power", state @ ("on" | "off")] => Self::Power { is_on: state == "on" },
            _ => return Err(wrong()),
        }))
    }

    /// Applies it to the machine; cable and power are none of its parts.
    pub fn apply<const A: usize>(self, rig: &mut CardSimulator<A>) {
        let now_us = rig.now_us();
        let machine = rig.machine();
        match self {
            Self::Wheel { counts_per_s, for_us } => machine.turn_wheel_for(now_us, counts_per_s, for_us),
            Self::Notch(counts) => machine.turn_wheel(counts),
            Self::Input { number, active } => machine.set_input(number, active),
            Self::Analog { number, reading } => machine.set_analog_input(number, reading),
            Self::Spindle(event) => {
                if let Some(spindle) = machine.spindle() {
                    event.apply(spindle);
                }
            }
            Self::Cable { .. } | Self::Power { .. } => {}
        }
    }
}

impl SpindleEvent {
    /// Parses the words of a line; `None` if they are no event.
    fn read(words: &[&str]) -> Option<Self> {
        Some(match *words {
            ["spindle", "load", part, "for", time] => {
                let percent: f64 = part.strip_suffix('%')?.parse().ok()?;
                Self::Load((0.0..=100.0).contains(&percent).then_some(percent / 100.0)?, microseconds(time)?)
            }
            ["spindle", "stall"] => Self::Stalled(true),
            ["spindle", "free"] => Self::Stalled(false),
            ["spindle", "turn", turns] => Self::Turned(turns.parse().ok().filter(|turns: &f64| turns.abs() <= 1000.0)?),
            ["encoder", "dead"] => Self::EncoderDead,
            ["encoder", "lose", counts] => Self::CountsLost(i64::from(counts.parse::<i32>().ok()?)),
            ["encoder", "no-index"] => Self::IndexLost,
            _ => return None,
        })
    }

    fn apply(self, spindle: &mut SpindlePlant) {
        match self {
            Self::Load(part, us) => spindle.set_load(part, us),
            Self::Stalled(is_stalled) => spindle.set_stalled(is_stalled),
            Self::Turned(turns) => spindle.turn_by_hand(turns),
            Self::EncoderDead => spindle.kill_encoder(),
            Self::CountsLost(counts) => spindle.add_wrong_counts(-counts),
            Self::IndexLost => spindle.lose_index(),
        }
    }
}

fn used_for(what: &str) -> Option<InputUse> {
    Some(match what {
        "door" => InputUse::Door,
        "emergency-stop" => InputUse::EmergencyStop,
        "probe" => InputUse::Probe,
        "breakaway" => InputUse::Collision { only_lit: false },
        _ => return None,
    })
}

/// Parses `2s` or `300ms`, at most an hour.
fn microseconds(text: &str) -> Option<u64> {
    let (number, unit) = match text.strip_suffix("ms") {
        Some(number) => (number, 1e3),
        None => (text.strip_suffix('s')?, 1e6),
    };
    let us = number.parse::<f64>().ok()? * unit;
    (0.0..=3.6e9).contains(&us).then_some(us as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_config::MachineConfig;

    #[test]
    fn what_is_said_is_done_to_what_is_wired() {
        let mut digital = [InputSetting::default(); 16];
        digital[12].used_for = InputUse::Door;
        digital[7].used_for = InputUse::Collision { only_lit: false };
        let text = "[[card.analog_input]]\nnumber = 1\nname = \"arc\"\nunit = \"V\"\nat_full = 256\n";
        let machine = MachineConfig::parse(text, "m.toml").expect("valid");
        let inputs = DeclaredInputs { digital: &digital, analog: &machine.card.analog_inputs };
        let read = |line| ManualInput::read(line, inputs).expect(line);
        assert_eq!(read("wheel -120 for 2s"), Some(ManualInput::Wheel { counts_per_s: -120, for_us: 2_000_000 }));
        assert_eq!(read("wheel 3 for 1.5ms # slowly"), Some(ManualInput::Wheel { counts_per_s: 3, for_us: 1500 }));
        assert_eq!(read("wheel -7"), Some(ManualInput::Notch(-7)));
        assert_eq!(read("press door"), Some(ManualInput::Input { number: 12, active: true }));
        assert_eq!(read("release door"), Some(ManualInput::Input { number: 12, active: false }));
        assert_eq!(read("press breakaway"), Some(ManualInput::Input { number: 7, active: true }));
        assert_eq!(read("unplug"), Some(ManualInput::Cable { is_in: false }));
        assert_eq!(read("plug in"), Some(ManualInput::Cable { is_in: true }));
        assert_eq!(read("power off"), Some(ManualInput::Power { is_on: false }));
        assert_eq!(read("power on"), Some(ManualInput::Power { is_on: true }));
        let spindle = |event| Some(ManualInput::Spindle(event));
        assert_eq!(read("spindle load 30% for 200ms"), spindle(SpindleEvent::Load(0.3, 200_000)));
        assert_eq!(read("spindle stall"), spindle(SpindleEvent::Stalled(true)));
        assert_eq!(read("spindle turn -2.5"), spindle(SpindleEvent::Turned(-2.5)));
        assert_eq!(read("encoder lose 7"), spindle(SpindleEvent::CountsLost(7)));
        assert_eq!(read(" input 5 on"), Some(ManualInput::Input { number: 5, active: true }));
        assert_eq!(read("analog 1 3.25"), Some(ManualInput::Analog { number: 1, reading: Some(832) }));
        assert_eq!(read("analog 1 -7"), Some(ManualInput::Analog { number: 1, reading: Some(0) }));
        assert_eq!(read("analog 1 none"), Some(ManualInput::Analog { number: 1, reading: None }));
        assert_eq!((read(""), read("# nothing")), (None, None));
        for bad in [
            "door",
            "press",
            "press window",
            "press door 1",
            "wheel",
            "wheel x",
            "wheel 1 for 2",
            "wheel 1 for -2s",
            "wheel 9999999 for 2s",
            "wheel 1 for NaNs",
            "input 16 on",
            "input 5",
            "wheel 40000",
            "spindle",
            "spindle load 130% for 1s",
            "encoder lose many",
            "analog 1",
            "analog 1 nan",
        ] {
            assert!(ManualInput::read(bad, inputs).expect_err(bad).contains("is not a manual input"), "{bad}");
        }
        assert!(ManualInput::read("analog 0 1", inputs).expect_err("not declared").contains("[[card.analog_input]]"));
        assert!(
            ManualInput::read("press probe", inputs).expect_err("not wired").contains("no input is wired as probe")
        );
    }
}
