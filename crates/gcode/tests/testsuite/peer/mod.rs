//! A program in two interpreters: LinuxCNC's `rs274 -g`, and this one.
//!
//! Invariant: every program has a folder of its own with only its own files, so that no run of LinuxCNC's interpreter
//! depends on another.

use crate::common::{Outcome, carried_out};
use crate::writer::Case;
use retrace_gcode::{Parameters, Setup, SubFile, SubFiles, ToolTable};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Number of programs that run at a time.
const WORKERS: u64 = 2;

/// The files of a case, for this interpreter.
#[derive(Debug)]
struct Beside(Vec<(String, String)>);

impl SubFiles for Beside {
    fn find(&self, name: &str) -> Option<SubFile> {
        let (name, text) = self.0.iter().find(|(own, _)| own == name)?;
        Some(SubFile { name: format!("{name}.ngc"), text: Ok(text.as_bytes().into()) })
    }
}

impl Case {
    fn setup(&self) -> Setup {
        let mut setup = Setup::rs274();
        if let Some(tools) = self.tools {
            setup.tools = ToolTable::read(tools).expect("a tool table");
        }
        if let Some(parameters) = &self.parameters {
            setup.parameters = Parameters::read(parameters).expect("a parameter file");
        }
        if !self.files.is_empty() {
            setup.files = Some(Arc::new(Beside(self.files.clone())));
        }
        setup
    }

    /// Whether it has M72 or M73.
    fn restores_modes(&self) -> bool {
        let texts = self.files.iter().map(|(_, text)| text).chain([&self.program]);
        texts.map(|text| text.to_lowercase()).any(|text| text.contains("m72") || text.contains("m73"))
    }

    /// Returns the result of this interpreter.
    pub(crate) fn ours(&self) -> Outcome {
        carried_out(&self.program, self.setup())
    }

    /// Removes each refused line, so that the lines after it are compared too: at most `most` of them. A line with an O
    /// word stays, since others belong to it.
    pub(crate) fn without_refused_lines(mut self, most: u32) -> Case {
        for _ in 0..most {
            let Some((0, line)) = self.ours().refused else { break };
            let mut lines: Vec<&str> = self.program.lines().collect();
            let index = line as usize - 1;
            if lines.get(index).is_none_or(|line| others_belong_to(line)) {
                break;
            }
            lines.remove(index);
            self.program = lines.join("\n") + "\n";
        }
        self
    }
}

/// Whether a line opens or closes something: it has an O word, or ends what G5.2, G41 or G42 has begun.
fn others_belong_to(line: &str) -> bool {
    let line = line.trim_start_matches(|letter: char| {
        letter.is_whitespace() || letter.is_ascii_digit() || "/Nn.".contains(letter)
    });
    line.starts_with(['o', 'O']) || line.contains("5.3") || line.to_lowercase().contains("g40")
}

/// Result of LinuxCNC's interpreter for a program.
struct Theirs {
    functions: String,
    complaint: String,
    refused: bool,
}

/// Returns what `rs274 -g` prints for a program, its error message, and whether it refused the program; `None` where it
/// is not installed.
fn rs274(folder: &Path, case: &Case) -> Option<Theirs> {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("a file for the peer");
    write("program.ngc", &case.program);
    for (name, text) in &case.files {
        write(&format!("{name}.ngc"), text);
    }
    // It stores its tool data in the home folder, where another running instance would find them.
    let mut command = Command::new("timeout");
    command.args(["20", "rs274", "-g"]).env("HOME", folder).current_dir(folder).stdin(Stdio::null());
    if let Some(tools) = case.tools {
        write("tools.tbl", tools);
        command.args(["-t", "tools.tbl"]);
    }
    if let Some(parameters) = &case.parameters {
        write("parameters.var", parameters);
        command.args(["-v", "parameters.var"]);
    }
    let output = command.arg("program.ngc").output().ok().filter(|output| output.status.code() != Some(127))?;
    for (name, _) in &case.files {
        let _ = std::fs::remove_file(folder.join(format!("{name}.ngc")));
    }
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (functions, complaint) = (text(&output.stdout), text(&output.stderr));
    Some(Theirs { functions, complaint, refused: !output.status.success() })
}

pub(crate) fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Returns the lines of rs274's standard output that are canonical functions, without their running number: its error
/// messages have the same destination.
fn functions(text: &str) -> Vec<&str> {
    let is_function = |line: &&str| line.len() > 13 && line.as_bytes()[6] == b'N' && line.ends_with(')');
    text.lines().filter(is_function).map(|line| &line[6..]).collect()
}

/// Removes feed, speed and path mode where they equal the last ones: the release restores them even if they have not
/// changed, the installed version does not.
fn leave_out_repeated_settings(lines: &mut Vec<&str>) {
    const SETTINGS: [&str; 4] =
        ["SET_FEED_RATE(", "SET_SPINDLE_SPEED(", "SET_MOTION_CONTROL_MODE(", "SET_NAIVECAM_TOLERANCE("];
    let mut last: [Option<&str>; 4] = [None; 4];
    lines.retain(|line| {
        let call = line.get(7..).unwrap_or_default();
        match SETTINGS.iter().position(|name| call.starts_with(name)) {
            // G94 after a block of G93 without motion: LinuxCNC's last feed is another one.
            _ if call == "SET_FEED_RATE(0.0000)" => {
                last[0] = Some(call);
                true
            }
            Some(setting) => last[setting].replace(call) != Some(call),
            None => true,
        }
    });
}

/// Statistics of many programs.
#[derive(Debug, Default)]
struct Tally {
    refused: u64,
    differing: u64,
    /// Programs whose first difference is a known fault of LinuxCNC.
    known: u64,
    /// Programs that differ only in the sign of a zero or in a last printed digit.
    roundings: u64,
    /// Number of programs that each error ended.
    errors: BTreeMap<&'static str, u64>,
}

impl Tally {
    fn add(&mut self, seed: u64, case: &Case, theirs: &Theirs) {
        let ours = case.ours();
        self.refused += u64::from(ours.refused.is_some());
        if let Some(error) = ours.error {
            *self.errors.entry(error).or_default() += 1;
        }
        let (mut their_calls, mut our_calls) = (functions(&theirs.functions), functions(&ours.text));
        if case.restores_modes() {
            leave_out_repeated_settings(&mut their_calls);
            leave_out_repeated_settings(&mut our_calls);
        }
        // Changes of the release after the installed version count as equal.
        let our_calls: Vec<&str> = (0..our_calls.len())
            .map(|at| match their_calls.get(at) {
                Some(theirs) if is_of_the_release(theirs, our_calls[at]) => *theirs,
                _ => our_calls[at],
            })
            .collect();
        if their_calls == our_calls && theirs.refused == ours.refused.is_some() {
            return;
        }
        // Moves that take longer than a day are refused here alone, on purpose.
        if ours.error == Some("E1512")
            && our_calls.iter().zip(&their_calls).filter(|(ours, theirs)| ours != theirs).count() <= 2
        {
            self.known += 1;
            return;
        }
        let are_alike = |(theirs, ours): (&&str, &&str)| theirs == ours || differ_in_roundings(theirs, ours);
        if their_calls.len() == our_calls.len()
            && theirs.refused == ours.refused.is_some()
            && their_calls.iter().zip(&our_calls).all(are_alike)
        {
            println!("seed {seed} differs in roundings alone");
            self.roundings += 1;
            return;
        }
        let at = their_calls.iter().zip(&our_calls).take_while(|(theirs, ours)| theirs == ours).count();
        if is_dwell_of_another_cycle(case, their_calls.get(at), our_calls.get(at))
            // A coordinate beyond 10¹⁵ is refused here intentionally.
            || matches!(ours.error, Some("E1660" | "E1103"))
            // Both refuse the program, LinuxCNC earlier where a comment is not closed after a faulty line.
            || theirs.refused && ours.refused.is_some() && theirs.complaint.contains("Unclosed comment")
            || is_mode_behind_a_spline(case, their_calls.get(at), our_calls.get(at))
            || is_feed_that_waited(their_calls.get(at), our_calls.get(at))
        {
            self.known += 1;
            return;
        }
        self.differing += 1;
        println!(
            "seed {seed}, function {at}, refused by them {}, by us {:?} {:?}",
            theirs.refused, ours.refused, ours.error
        );
        println!(
            "theirs: {:?}\nours:   {:?}\nthey say: {:?}",
            their_calls.get(at),
            our_calls.get(at),
            theirs.complaint
        );
        if self.differing <= number("RETRACE_DIFFERENTIAL_SHOWN", 1) {
            println!("{}{:?} {:?}", case.program, case.files, case.parameters);
        }
    }
}

/// Whether two lines differ by a known difference between the installed version and the release (peer_faults.md): the
/// minimum feed of G93, and values below 0.0001 in messages, which the installed version shows as 0.
fn is_of_the_release(theirs: &str, ours: &str) -> bool {
    let (Some(their_call), Some(our_call)) = (theirs.get(7..), ours.get(7..)) else { return false };
    let feed = |call: &str| call.strip_prefix("SET_FEED_RATE(")?.strip_suffix(')')?.parse::<f64>().ok();
    if feed(their_call) == Some(0.1) {
        return theirs[..7] == ours[..7] && feed(our_call).is_some_and(|feed| feed < 0.1);
    }
    let is_small = |word: &str| word.parse::<f64>().is_ok_and(|value| value.abs() <= 1e-4);
    let same = |(theirs, ours): (&str, &str)| theirs == ours || theirs == "0.000000" && is_small(ours);
    let split = |call: &str| call.split([' ', '"']).map(str::to_owned).collect::<Vec<_>>();
    let (their_words, our_words) = (split(theirs), split(ours));
    their_call.starts_with("MESSAGE(")
        && their_words.len() == our_words.len()
        && their_words.iter().zip(&our_words).all(|(theirs, ours)| same((theirs, ours)))
}

/// Whether two lines differ in roundings only: in the sign of a zero, or in the last printed digit of a number
/// (peer_faults.md).
fn differ_in_roundings(theirs: &str, ours: &str) -> bool {
    let words = |line: &str| line.split([' ', ',', '(', ')', '"']).map(str::to_owned).collect::<Vec<_>>();
    let decimals = |word: &str| word.split_once('.').map_or(0, |(_, decimals)| decimals.len() as i32);
    let is_same = |(theirs, ours): (&String, &String)| {
        let (Ok(a), Ok(b)) = (theirs.parse::<f64>(), ours.parse::<f64>()) else { return theirs == ours };
        let last_digit = if decimals(theirs) >= 4 { 10_f64.powi(-decimals(theirs)) } else { 0.0 };
        a == b || decimals(theirs) == decimals(ours) && (a - b).abs() <= 1.01 * last_digit
    };
    let (theirs, ours) = (words(theirs), words(ours));
    theirs.len() == ours.len() && theirs.iter().zip(&ours).all(is_same)
}

/// G74 and G84 without P: LinuxCNC uses the dwell of another cycle (peer_faults.md). The writer gives them a P; a
/// removed line may leave a hole without one.
fn is_dwell_of_another_cycle(case: &Case, theirs: Option<&&str>, ours: Option<&&str>) -> bool {
    let call = |line: Option<&&str>| line.and_then(|line| line.get(7..)).unwrap_or_default().to_owned();
    let text = case.program.to_lowercase();
    call(ours) == "DWELL(0.0000)"
        && call(theirs).starts_with("DWELL(")
        && (text.contains("g84") || text.contains("g74"))
}

/// Under cutter compensation a waiting feed rate keeps its number when the units change (outline/). The writer excludes
/// that; a removed line may have been the one between. The same applies to a concave corner after a stop, which is
/// refused here (E1660).
fn is_feed_that_waited(theirs: Option<&&str>, ours: Option<&&str>) -> bool {
    let feed =
        |line: Option<&&str>| line?.get(7..)?.strip_prefix("SET_FEED_RATE(")?.strip_suffix(')')?.parse::<f64>().ok();
    let (Some(theirs), Some(ours)) = (feed(theirs), feed(ours)) else { return false };
    let is_converted = |from: f64, to: f64| (from * 25.4 - to).abs() <= 0.002 * from.abs();
    is_converted(theirs, ours) || is_converted(ours, theirs)
}

/// After G5.3 `#<_motion_mode>` is −1 in LinuxCNC and 800 here, as after G80: there is no motion mode (peer_faults.md).
fn is_mode_behind_a_spline(case: &Case, theirs: Option<&&str>, ours: Option<&&str>) -> bool {
    let (Some(theirs), Some(ours)) = (theirs, ours) else { return false };
    let text = case.program.to_lowercase();
    text.contains("5.3") && text.contains("#<_motion_mode>") && theirs.replace("-1.000000", "800.000000") == **ours
}

/// Compares the results of both for the programs of as many seeds as the environment requests.
pub(crate) fn compare(name: &str, case_of: impl Fn(u64) -> Case + Sync) {
    let root = std::env::temp_dir().join(format!("retrace-{name}-{}", std::process::id()));
    let (first, count) = (number("RETRACE_DIFFERENTIAL_FIRST", 0), number("RETRACE_DIFFERENTIAL", 120));
    let (next, tally) = (AtomicU64::new(first), Mutex::new(Tally::default()));
    let is_missing = AtomicU64::new(0);
    let work = |folder: PathBuf| {
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= first + count {
                break;
            }
            let case = case_of(seed);
            let Some(theirs) = rs274(&folder, &case) else {
                is_missing.store(1, Ordering::Relaxed);
                break;
            };
            tally.lock().expect("a tally").add(seed, &case, &theirs);
        }
    };
    std::thread::scope(|scope| {
        for worker in 0..WORKERS {
            let folder = root.join(worker.to_string());
            scope.spawn(|| work(folder));
        }
    });
    let _ = std::fs::remove_dir_all(&root);
    if is_missing.into_inner() != 0 {
        return crate::not_run::not_run(name, "rs274 is not installed");
    }
    let Tally { refused, differing, known, roundings, errors } = tally.into_inner().expect("a tally");
    println!(
        "{name}: {count} programs from seed {first}, {refused} of them refused, {differing} differ, {known} by a \
            fault of the peer, {roundings} in roundings alone; refusals: {errors:?}"
    );
    assert!(roundings <= 1 + count / 5_000, "more than roundings: {roundings} of {count} programs");
    assert_eq!(differing, 0, "of {count} programs");
}
