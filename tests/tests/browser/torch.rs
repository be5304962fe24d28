//! What the page has for a torch: height control while it cuts, the edge of the sheet before.

use retrace_tests::command::{Bench, root};
use retrace_tests::page_client::PageServer;
use retrace_tests::page_user::Screen;

use super::layout::no_fault;
use super::{Machine, browser, in_control};

/// Colours of the lines of voltage and height, and of the bar where the torch is on.
const CHART_COLOURS: [[u8; 3]; 3] = [[0x56, 0xb4, 0xe9], [0x2b, 0xbd, 0x92], [0xe6, 0x9f, 0x00]];

/// Adds more samples to the chart than it has room for, and draws it. Returns the numbers of samples and of places.
const OVERFILL: &str = "import('/page/app.js').then(({ heightChart: { history } }) => {
  for (let index = 0; index < 3 * history.capacity; index++) {
    history.add(performance.now(), 115, 115, index % 7, 1);
  }
  return [history.length, history.times.length, history.heights.length, history.capacity];
})";

/// A server with the example of height control, and its journal in the bench.
fn serve_torch(bench: &Bench) -> PageServer {
    serve_torch_at(3000, bench)
}

/// The same at this feed, mm/min: a computer under load is seconds behind the cut.
fn serve_torch_at(feed: u32, bench: &Bench) -> PageServer {
    let example = |name: &str| root().join("examples/height-control").join(name);
    let program = std::fs::read_to_string(example("strips.ngc")).expect("an example");
    let program = bench.file("strips.ngc", program.replace("F3000", &format!("F{feed}"))).display().to_string();
    let machine = example("table.toml").display().to_string();
    let journal = bench.path("jobs").display().to_string();
    PageServer::start(&[&program, "--machine", &machine, "--journal", &journal, "--source-faults", "warp=5"])
}

/// The torch one volt higher and back, the control off and on, by taps on the row of height control.
#[test]
fn height_control_has_a_row_of_its_own() {
    let Some(mut browser) = browser() else { return };
    for screen in [Screen::TABLET, Screen::DESK] {
        let bench = Bench::new();
        let server = serve_torch_at(600, &bench);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.tap(".motion", "CYCLE START");
        machine.wait("height control", |report| report["live"]["height"]["state"] == "active");
        user.wait_for_text(".height-text", "active");
        user.tap(".height-line button", "+");
        let higher = machine.wait("a volt more", |report| report["live"]["height"]["offset_volts"] == 1.0);
        assert!(higher["live"]["height"]["volts"].as_f64() > Some(105.0), "{higher:#}");
        user.wait_for_text(".height-text", "+1 V");
        user.picture(&format!("height-{}", screen.width));
        user.tap(".height-line button", "0");
        machine.wait("the voltage of the material", |report| report["live"]["height"]["offset_volts"] == 0.0);
        user.tap(".height-line button", "THC");
        machine.wait("off", |report| report["live"]["height"]["is_on"] == false);
        user.wait_for_text(".height-text", "OFF");
        user.tap(".height-line button", "THC");
        machine.wait("on", |report| report["live"]["height"]["is_on"] == true);
    }
}

/// What the page shows of a height and a voltage that are not known.
const UNKNOWN: &str = "import('/page/height_line.js').then(({ HeightLine }) => {
  const line = new HeightLine({ axis: () => ({ letter: 'z' }), allows: () => false }, {});
  const height = { state: 'off', is_on: true, volts: null, target_volts: null, offset_volts: 0 };
  line.show({ work: [0, 0, 0], layer: { axis: 2, path_mm: null, layer_mm: null }, height });
  return `${line.figures.textContent} | ${line.text.textContent}`;
})";

/// Whether the button of the torch is in view as a whole, in a panel that scrolls too.
const IS_TORCH_IN_VIEW: &str = "(() => {
  const torch = document.querySelector('#feed .output').getBoundingClientRect();
  return torch.height >= 44 && torch.bottom <= document.querySelector('#feed').getBoundingClientRect().bottom;
})()";

/// Path, layer and sum change while the torch follows the sheet, the chart shows them, and its memory is bounded.
#[test]
fn the_height_is_shown_in_figures_and_in_a_chart() {
    let Some(mut browser) = browser() else { return };
    let panel = Screen { width: 1280, height: 800, ..Screen::TABLET };
    for screen in [panel, Screen::PHONE] {
        let bench = Bench::new();
        let server = serve_torch(&bench);
        let machine = Machine::new(&server);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        let is_phone = screen.width < 760;
        if is_phone {
            user.tap("#tab-feed", "");
        }
        user.wait_for_text(".tool-height", "layer 0.000");
        user.wait_for_text(".height-text", "off · 0.0 V");
        assert_eq!(user.evaluate(UNKNOWN), "Z path –layer –sum – mmover sheet – | off · – V");
        let is_shown = "findByEye('#height-chart canvas', '') !== null";
        assert_eq!(user.evaluate(is_shown), false, "it is closed at first");
        user.tap(".height-opener", "");
        user.wait(is_shown);
        assert_eq!(user.evaluate(IS_TORCH_IN_VIEW), true, "the torch is in view beside the chart");
        user.picture(&format!("height-chart-{}-empty", screen.width));
        no_fault(&mut user, "the chart");
        user.tap(".motion.start", "");
        machine.wait("height control", |report| report["live"]["height"]["state"] == "active");
        user.wait_for_text(".height-text", "active");
        let cutting = machine.report()["live"].clone();
        assert_eq!(cutting["height"]["target_volts"], 115.0, "{cutting:#}");
        let [path, layer, sum] = [&cutting["layer"]["path_mm"], &cutting["layer"]["layer_mm"], &cutting["work"][2]]
            .map(|mm| mm.as_f64().unwrap_or(f64::NAN));
        assert!((path + layer - sum).abs() < 2e-4 && layer < -60.0, "{path} + {layer} = {sum}");
        let before = user.text(".tool-height");
        user.wait(&format!("document.querySelector('.tool-height').textContent !== {before:?}"));
        machine.wait("the second strip", |report| report["state"]["cutter"]["contour"] == 2);
        machine.wait("it is cut", |report| report["live"]["height"]["state"] == "held");
        std::thread::sleep(std::time::Duration::from_millis(200));
        user.picture(&format!("height-chart-{}", screen.width));
        for colour in CHART_COLOURS {
            let pixels = user.pixels_of("#height-chart canvas", colour);
            assert!(pixels > 100, "{pixels} pixels of {colour:?}");
        }
        no_fault(&mut user, "the chart while it cuts");
        let end = machine.wait("the end", |report| report["state"]["situation"] == "program_end");
        assert_eq!(end["live"]["layer"]["layer_mm"], 0.0, "{end:#}");
        user.wait_for_text(".tool-height", "layer 0.000");
        user.picture(&format!("height-chart-{}-end", screen.width));
        let [samples, rooms @ ..] = &user.evaluate(OVERFILL).as_array().expect("numbers").clone()[..] else { return };
        assert!(rooms.iter().all(|room| room == samples), "{samples} samples in {rooms:?} places");
        user.evaluate("window.isOldPage = true");
        user.reload();
        user.wait("!window.isOldPage && document.querySelector('.tool-height b')?.textContent === '0.000'");
        if is_phone {
            user.tap("#tab-feed", "");
        }
        user.wait(is_shown);
        user.tap(".height-opener", "");
        user.wait("findByEye('#height-chart canvas', '') === null");
    }
}
