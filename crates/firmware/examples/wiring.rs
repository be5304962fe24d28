//! Prints the wiring picture of a board as SVG, from the pins of the firmware: `cargo xtask figures` writes it to
//! docs/figures.
//!
//! Invariant: every pin of the firmware is in the picture, with the use that the firmware has for it.

use retrace_firmware::AXES;
use retrace_firmware::output_level::High;
use retrace_firmware::{rp2040, stm32f4};
use retrace_link::channel;

/// Pixels of a pin's row, of the picture's width, and of the board.
const ROW: usize = 22;
const WIDTH: usize = 860;
const BOARD: [usize; 2] = [300, 560];
const TOP: usize = 64;
const AXIS_NAMES: [char; AXES] = ['X', 'Y', 'Z', 'A'];

/// A pin: its label on the board, what it is used for, and the kind of wire.
struct Pin {
    label: String,
    function: String,
    kind: Kind,
}

/// What is at the other end of a wire.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Step,
    Output,
    Input,
    Line,
    Power,
    Unused,
}

impl Kind {
    const ALL: [(Self, &'static str); 5] = [
        (Self::Step, "steps and directions: 74HCT245 (5 V), then the drives"),
        (Self::Output, "outputs: a driver with 10 kΩ to ground at its input; high is on"),
        (Self::Input, "inputs: contacts to ground, filtered or by optocouplers; 3.3 V at most"),
        (Self::Line, "line by a USB-serial adapter of 3.3 V, or by the USB socket of the board"),
        (Self::Power, "ground, power and reset"),
    ];

    fn colour(self) -> &'static str {
        match self {
            Self::Step => "#1f6fb2",
            Self::Output => "#b3541e",
            Self::Input => "#2e7d32",
            Self::Line => "#6a3d9a",
            Self::Power => "#444444",
            Self::Unused => "#aaaaaa",
        }
    }
}

/// Use of an output pin.
fn output(high: High) -> String {
    match high {
        High::Either(..) => "coolant (M8, M7)".into(),
        High::NotZero(channel::FLOOD) => "flood (M8)".into(),
        High::NotZero(channel::MIST) => "mist (M7)".into(),
        High::NotZero(digital) => format!("output {digital} (M62 P{digital})"),
        High::Above(_) => "spindle clockwise (M3)".into(),
        High::Below(_) => "spindle counterclockwise (M4)".into(),
    }
}

/// Use of a pin of the Pico by its GPIO.
fn pico_gpio(gpio: u8) -> (String, Kind) {
    use rp2040::pins;
    let axis_of =
        |first: u8| (first..first + AXES as u8).contains(&gpio).then(|| AXIS_NAMES[usize::from(gpio - first)]);
    if let Some(at) = pins::SERIAL_PINS.iter().position(|&pin| pin == gpio) {
        return (["UART: from the card", "UART: to the card, or voltage module"][at].into(), Kind::Line);
    }
    if let Some(axis) = axis_of(pins::FIRST_STEP_PIN) {
        return (format!("step {axis}"), Kind::Step);
    }
    if let Some(axis) = axis_of(pins::FIRST_DIRECTION_PIN) {
        return (format!("direction {axis}"), Kind::Step);
    }
    if let Some(&(_, high)) = pins::OUTPUT_PINS.iter().find(|&&(pin, _)| pin == gpio) {
        return (output(high), Kind::Output);
    }
    if gpio == pins::SPINDLE_PWM_PIN {
        return ("S: speed or power (PWM)".into(), Kind::Output);
    }
    if (pins::FIRST_INPUT_PIN..pins::FIRST_INPUT_PIN + pins::INPUTS).contains(&gpio) {
        let input = format!("input {}", gpio - pins::FIRST_INPUT_PIN);
        let other = match gpio.checked_sub(pins::FIRST_SPINDLE_PIN) {
            Some(at @ 0..pins::SPINDLE_INPUTS) => {
                format!(", or spindle encoder {}", ["A", "B", "index"][usize::from(at)])
            }
            _ if gpio == pins::FREQUENCY_PIN => ", or a frequency".into(),
            _ => String::new(),
        };
        return (input + &other, Kind::Input);
    }
    match pins::ENCODER_PINS.iter().position(|&pin| pin == gpio) {
        Some(at) => (format!("handwheel {}", ["A", "B"][at]), Kind::Input),
        None => (String::new(), Kind::Unused),
    }
}

/// Both sides of a Pico: the left one from pin 1 down, the right one from pin 40 down (Pico data sheet, 2.1).
fn pico() -> [Vec<Pin>; 2] {
    /// GPIO of each pin; or its name.
    const PINS: [Result<u8, &str>; 40] = {
        const GROUND: Result<u8, &str> = Err("GND");
        [
            Ok(0),
            Ok(1),
            GROUND,
            Ok(2),
            Ok(3),
            Ok(4),
            Ok(5),
            GROUND,
            Ok(6),
            Ok(7),
            Ok(8),
            Ok(9),
            GROUND,
            Ok(10),
            Ok(11),
            Ok(12),
            Ok(13),
            GROUND,
            Ok(14),
            Ok(15),
            Ok(16),
            Ok(17),
            GROUND,
            Ok(18),
            Ok(19),
            Ok(20),
            Ok(21),
            GROUND,
            Ok(22),
            Err("RUN"),
            Ok(26),
            Ok(27),
            GROUND,
            Ok(28),
            Err("ADC_VREF"),
            Err("3V3"),
            Err("3V3_EN"),
            GROUND,
            Err("VSYS"),
            Err("VBUS"),
        ]
    };
    let pin = |number: usize| match PINS[number - 1] {
        Ok(gpio) => {
            let (function, kind) = pico_gpio(gpio);
            Pin { label: format!("{number}  GP{gpio}"), function, kind }
        }
        Err(name) => {
            let (function, kind) = match name {
                "GND" => ("ground", Kind::Power),
                "RUN" => ("reset: a key to ground", Kind::Power),
                "VSYS" => ("5 V by a diode, or open", Kind::Power),
                _ => ("", Kind::Unused),
            };
            Pin { label: format!("{number}  {name}"), function: function.into(), kind }
        }
    };
    [(1..=20).map(pin).collect(), (21..=40).rev().map(pin).collect()]
}

/// The pins of an STM32F4 board: port A, and ports B and C. Boards have them at different places.
fn stm32f4_board() -> [Vec<Pin>; 2] {
    use stm32f4::pins::{self, Port};
    let pin =
        |port: char, number: u8, function: String, kind| Pin { label: format!("P{port}{number}"), function, kind };
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for (axis, name) in AXIS_NAMES.into_iter().enumerate() {
        a.push(pin('A', pins::FIRST_STEP_PIN + axis as u8, format!("step {name}"), Kind::Step));
        a.push(pin('A', pins::FIRST_DIRECTION_PIN + axis as u8, format!("direction {name}"), Kind::Step));
    }
    for (number, function) in pins::SERIAL_PINS.into_iter().zip(["USART1: from the card", "USART1: to the card"]) {
        a.push(pin('A', number, function.into(), Kind::Line));
    }
    for (number, function) in pins::USB_PINS.into_iter().zip(["USB socket: D-", "USB socket: D+"]) {
        a.push(pin('A', number, function.into(), Kind::Line));
    }
    for (input, (port, number)) in pins::INPUT_PINS.into_iter().enumerate() {
        let (letter, side) = match port {
            Port::A => ('A', &mut a),
            Port::B => ('B', &mut b),
            Port::C => ('C', &mut b),
        };
        let is_captured = pins::capture_input(input as u8).is_some();
        let function = if is_captured { format!("input {input}, for a probe") } else { format!("input {input}") };
        side.push(pin(letter, number, function, Kind::Input));
    }
    for (number, function) in pins::ENCODER_PINS.into_iter().zip(["handwheel A", "handwheel B"]) {
        b.push(pin('B', number, function.into(), Kind::Input));
    }
    b.extend(pins::OUTPUT_PINS.into_iter().map(|(number, high)| pin('B', number, output(high), Kind::Output)));
    a.push(Pin { label: "GND".into(), function: "ground".into(), kind: Kind::Power });
    [a, b]
}

fn text(x: usize, y: usize, anchor: &str, colour: &str, text: &str) -> String {
    format!("<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>\n")
}

fn picture(title: &str, sides: &[Vec<Pin>; 2]) -> String {
    let rows = sides[0].len().max(sides[1].len());
    let bottom = TOP + rows * ROW + 12;
    let height = bottom + 24 + Kind::ALL.len() * ROW + 30;
    let [left, right] = BOARD;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" \
         font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#ffffff\"/>\n\
         <rect x=\"{left}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"8\" fill=\"#f2f5f0\" stroke=\"#444444\"/>\n",
        TOP - 12,
        right - left,
        bottom - TOP + 12,
    );
    svg += &text(WIDTH / 2, 30, "middle", "#000000", title);
    for (side, pins) in sides.iter().enumerate() {
        let (edge, end, label, note) = match side {
            0 => (left, left - 40, (left + 8, "start"), (left - 46, "end")),
            _ => (right, right + 40, (right - 8, "end"), (right + 46, "start")),
        };
        for (row, pin) in pins.iter().enumerate() {
            let (y, colour) = (TOP + row * ROW + ROW / 2, pin.kind.colour());
            if pin.kind != Kind::Unused {
                svg += &format!(
                    "<path d=\"M{edge} {y}H{end}\" stroke=\"{colour}\" stroke-width=\"2\"/>\n<circle cx=\"{edge}\" \
                     cy=\"{y}\" r=\"3\" fill=\"{colour}\"/>\n"
                );
            }
            svg +=
                &text(label.0, y + 4, label.1, if pin.kind == Kind::Unused { colour } else { "#000000" }, &pin.label);
            svg += &text(note.0, y + 4, note.1, colour, &pin.function);
        }
    }
    for (row, (kind, note)) in Kind::ALL.into_iter().enumerate() {
        let y = bottom + 24 + row * ROW;
        svg += &format!("<rect x=\"60\" y=\"{}\" width=\"14\" height=\"10\" fill=\"{}\"/>\n", y - 10, kind.colour());
        svg += &text(84, y, "start", "#000000", note);
    }
    let y = bottom + 24 + Kind::ALL.len() * ROW;
    svg += &text(
        60,
        y,
        "start",
        "#b00020",
        "An emergency stop cuts the power of the drives by itself; this board only reads it.",
    );
    svg + "</svg>\n"
}

fn main() {
    let (title, sides) = match std::env::args().nth(1).as_deref() {
        Some("pico") => ("Raspberry Pi Pico and Pico 2, USB socket at the top", pico()),
        Some("stm32f4") => ("STM32F4 boards, by the pins of the chip", stm32f4_board()),
        _ => {
            eprintln!("wiring needs a board: pico, stm32f4");
            std::process::exit(2);
        }
    };
    print!("{}", picture(title, &sides));
}
