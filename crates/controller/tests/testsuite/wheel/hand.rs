//! Actions of the operator: random signals of a handwheel, period by period, and commands between them.
//!
//! Invariant: they follow from the seed alone.

use retrace_controller::OperatorCommand;
use retrace_core::Rate;
use retrace_hal_sim::Random;

use crate::wired::pick;

/// Actions in one turn of the motion path.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moment {
    pub word: Option<OperatorCommand>,
    /// Counts of the screen's wheel.
    pub screen: i16,
    /// Counts of the wheel that is wired to the card.
    pub encoder: i16,
}

/// Settings of a handwheel, as in the machine file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setting {
    pub counts_per_s: u32,
    pub mean_ms: u32,
}

impl Setting {
    pub(super) fn any(random: &mut Random) -> Self {
        Self {
            counts_per_s: pick(random, &[10, 50, 100, 100, 400, 2000]),
            mean_ms: pick(random, &[1, 7, 50, 100, 100, 250, 500]),
        }
    }
}

/// Which wheel is turned.
#[derive(Clone, Copy, Debug)]
enum Which {
    Screen,
    Encoder,
    Both,
}

/// Turns of an operator who uses the wheel several times, with other actions between.
pub(super) fn moments(random: &mut Random, setting: Setting) -> Vec<Moment> {
    // the card reads its encoder for the first time in the first period
    let mut moments = vec![Moment::default(); 3];
    for _ in 0..=random.up_to(2) {
        let longest = pick(random, &[300, 3000]);
        let run = 50 + random.up_to(longest);
        turned(random, &mut moments, run, setting, Signal::Jitter);
        if random.up_to(3) == 0 {
            let rate = Rate::ONE * i64::from(1 + random.up_to(99)) / 100;
            say(
                &mut moments,
                pick(random, &[OperatorCommand::Reverse(rate), OperatorCommand::Hold, OperatorCommand::Override(rate)]),
            );
            turned(random, &mut moments, 400, setting, Signal::Jitter);
        }
        say(&mut moments, OperatorCommand::Wheel { counts_per_s: 0.0, seconds: 0.0 });
        for _ in 0..1 + random.up_to(7) {
            let signal = Signal::any(random);
            let longest = pick(random, &[100, 1500]);
            let periods = 20 + random.up_to(longest);
            turned(random, &mut moments, periods, setting, signal);
            if random.up_to(15) == 0 {
                say(&mut moments, OperatorCommand::Hold);
                turned(random, &mut moments, 100, setting, signal);
                say(&mut moments, OperatorCommand::Resume);
            }
        }
        say(&mut moments, OperatorCommand::Leave { ask: false });
    }
    for word in [OperatorCommand::Override(Rate::ONE), OperatorCommand::Resume, OperatorCommand::Leave { ask: false }] {
        say(&mut moments, word);
    }
    moments
}

fn say(moments: &mut Vec<Moment>, word: OperatorCommand) {
    moments.push(Moment { word: Some(word), ..Moment::default() });
}

/// Signal of a wheel; rates in counts per second.
#[derive(Clone, Copy, Debug)]
enum Signal {
    Rest,
    /// A count in each direction, as an encoder at rest on an edge gives.
    Jitter,
    Step(f64),
    Ramp(f64, f64),
    /// A rate that reverses after this many periods.
    Square(f64, u32),
    /// All counts in one period, several times.
    Bursts,
}

impl Signal {
    fn any(random: &mut Random) -> Self {
        let mut rate = |most: u32| f64::from(random.up_to(2 * most)) - f64::from(most);
        let (a, b, chosen) = (rate(3000) / 1000.0, rate(3000) / 1000.0, rate(50) as i32);
        match chosen {
            ..-30 => Self::Rest,
            -30..-22 => Self::Jitter,
            // back more than forward, so that both ends are reached
            -22..0 => Self::Step(if b > -1.0 { -a.abs() } else { a.abs() }),
            0..22 => Self::Ramp(a, b),
            22..42 => Self::Square(a, 1 + random.up_to(600)),
            _ => Self::Bursts,
        }
    }

    /// Share of the counts that make rate 1, in period `n` of `periods`.
    fn rate(self, n: u32, periods: u32) -> f64 {
        match self {
            Self::Rest | Self::Jitter | Self::Bursts => 0.0,
            Self::Step(rate) => rate,
            Self::Ramp(from, to) => from + (to - from) * f64::from(n) / f64::from(periods),
            Self::Square(rate, every) => {
                if (n / every).is_multiple_of(2) {
                    rate
                } else {
                    -rate
                }
            }
        }
    }
}

/// Turns the wheel for this many periods.
fn turned(random: &mut Random, moments: &mut Vec<Moment>, periods: u32, setting: Setting, signal: Signal) {
    let which = pick(random, &[Which::Screen, Which::Encoder, Which::Both]);
    let noisy = matches!(signal, Signal::Jitter) || !matches!(signal, Signal::Rest) && random.up_to(2) == 0;
    let (mut due, mut turned, mut shaken) = (0.0, 0i64, 0i64);
    for n in 0..periods {
        due += signal.rate(n, periods) * f64::from(setting.counts_per_s) / 1000.0;
        let mut counts = due as i64 - turned;
        turned += counts;
        if noisy && random.up_to(3) == 0 {
            let to = i64::from(random.up_to(2)) - 1;
            counts += to - shaken;
            shaken = to;
        }
        if matches!(signal, Signal::Bursts) && random.up_to(99) == 0 {
            let most = pick(random, &[20, 500, 32_000]);
            counts = i64::from(random.up_to(2 * most)) - i64::from(most);
        }
        let counts = counts as i16;
        moments.push(match which {
            Which::Screen => Moment { screen: counts, ..Moment::default() },
            Which::Encoder => Moment { encoder: counts, ..Moment::default() },
            Which::Both => Moment { screen: counts / 2, encoder: counts - counts / 2, word: None },
        });
    }
}
