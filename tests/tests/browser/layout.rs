//! Every screen in both themes: all is in view, large enough for a finger, and free of faults that axe-core finds.

use std::path::PathBuf;

use retrace_tests::command::{Bench, root};
use retrace_tests::not_run::not_run;
use retrace_tests::page_user::{PageUser, Screen};
use serde_json::json;

use super::{browser, in_control, serve, zigzag};

/// Buttons that are too small, out of view, or under something else; and what scrolls.
const FAULTS: &str = r"((width, height, least) => {
  const faults = [];
  const page = document.scrollingElement;
  if (page.scrollWidth > width || page.scrollHeight > height || innerWidth > width)
    faults.push(`the page scrolls: ${page.scrollWidth} x ${page.scrollHeight}, ${innerWidth}`);
  for (const node of document.querySelectorAll('button, input:not([type=file]), select, [role=tab], .track')) {
    const box = node.getBoundingClientRect();
    if (box.width === 0 || node.closest('.unseen')) continue;
    const name = `${node.tagName} ${node.className} ${node.textContent.trim() || node.getAttribute('aria-label')}`;
    if (Math.min(box.width, box.height) < least - 0.01)
      faults.push(`${name}: ${box.width.toFixed(1)} x ${box.height.toFixed(1)}`);
    // What lies in a list or in a strip of tabs may be scrolled to.
    if (node.closest('.list, [role=tablist], .mdi-history, .zero-rows')) continue;
    if (box.left < -0.5 || box.top < -0.5 || box.right > width + 0.5 || box.bottom > height + 0.5)
      faults.push(`${name} is out of view: ${box.left}, ${box.top}, ${box.right}, ${box.bottom}`);
    const top = document.elementFromPoint(box.left + box.width / 2, box.top + box.height / 2);
    if (top && !node.contains(top) && !top.contains(node))
      faults.push(`${name} is under ${top.tagName} ${top.className}`);
  }
  return faults;
})";

/// The tabs of both strips.
fn tabs(user: &mut PageUser) -> Vec<String> {
    let names = "[...document.querySelectorAll('[role=tab]')].filter(tab => tab.offsetParent).map(tab => tab.id)";
    let names = user.evaluate(names);
    names.as_array().into_iter().flatten().filter_map(|name| name.as_str().map(str::to_owned)).collect()
}

/// Fails where something cannot be reached on the page as it is.
pub(crate) fn no_fault(user: &mut PageUser, what: &str) {
    let Screen { width, height, .. } = user.screen();
    let faults = user.evaluate(&format!("{FAULTS}({width}, {height}, 44)"));
    assert_eq!(faults, json!([]), "{what} at {width} x {height}");
}

/// At each size and in each theme, tab by tab.
#[test]
fn everything_is_in_view_and_large_enough() {
    let Some(mut browser) = browser() else { return };
    let bench = Bench::new();
    for screen in [Screen::TABLET, Screen::PHONE.light(), Screen::DESK] {
        let server = serve(&bench, &zigzag(40), &[]);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        for tab in tabs(&mut user) {
            user.tap(&format!("#{tab}"), "");
            std::thread::sleep(std::time::Duration::from_millis(100));
            no_fault(&mut user, &tab);
            user.picture(&format!("{}-{tab}", screen.width));
        }
        user.tap("#tab-path", "");
        user.tap(".motion.start", "");
        user.wait_for_word("RUNNING");
        no_fault(&mut user, "running");
        user.tap("#control-button", "");
        user.wait("document.querySelector('.dialog') !== null");
        let hold = user.find(".motion.hold", "");
        assert!(hold.size.0 >= 88.0 && hold.size.1 >= 44.0, "HOLD is the largest: {hold:?}");
        user.tap(".motion.hold", "");
    }
}

/// axe-core: `RETRACE_AXE` names `axe.min.js`, or `tests/node_modules` has it.
fn axe() -> Option<String> {
    let named = std::env::var_os("RETRACE_AXE").map(PathBuf::from);
    let path = named.unwrap_or_else(|| root().join("tests/node_modules/axe-core/axe.min.js"));
    std::fs::read_to_string(path).ok()
}

/// What axe-core finds of serious faults: none, in any tab, in either theme.
#[test]
fn axe_finds_no_serious_fault() {
    let Some(mut browser) = browser() else { return };
    let Some(axe) = axe() else {
        return not_run("layout::axe_finds_no_serious_fault", "no axe-core: RETRACE_AXE names no axe.min.js");
    };
    let bench = Bench::new();
    for screen in [Screen::TABLET, Screen::TABLET.light(), Screen::PHONE] {
        let server = serve(&bench, &zigzag(4), &[]);
        let mut user = in_control(&mut browser, &server, screen);
        user.wait_for_word("READY");
        user.evaluate(&axe);
        for tab in tabs(&mut user) {
            user.tap(&format!("#{tab}"), "");
            std::thread::sleep(std::time::Duration::from_millis(100));
            let found = user.evaluate(
                "axe.run(document, { resultTypes: ['violations'] }).then(result => result.violations
                   .filter(fault => ['serious', 'critical'].includes(fault.impact))
                   .map(fault => `${fault.id}: ${fault.nodes.map(node => node.target + ' ' + node.failureSummary)}`))",
            );
            assert_eq!(found, json!([]), "{tab} at {screen:?}");
        }
    }
}
