//! `cargo xtask firmware`: builds the firmware, checks its size, runs it in emulators and tests it there.
//!
//! Invariant: a check that cannot be run for want of a tool is reported by name; it counts as passed in `test` alone,
//! which lists what it did not run.

mod build;
mod computer_watch;
mod diagnostics;
mod elf;
mod emulator;
mod pico;
mod pico_emulator;
mod pico_failures;
mod pico_threads;
mod sections;
mod test;
mod uf2;

use std::path::Path;
use std::time::Duration;

pub(crate) use build::target_folder;
use build::{Board, Build};
use emulator::Emulator;
pub(crate) use pico::comparison_environment;

/// Command of the task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// Build for these boards.
    Build(Vec<Build>),
    /// Start QEMU and wait.
    Emulate,
    /// Everything that can be tested here, or the checks whose names contain this.
    Test(String),
    /// Print and check the sizes.
    Size(Vec<Build>),
}

impl Order {
    /// Parses the words behind `firmware`.
    ///
    /// # Errors
    /// The word that is not valid.
    pub(crate) fn read(words: &[&str]) -> Result<Self, String> {
        let Some((&verb, options)) = words.split_first() else {
            return Err("`firmware` needs one of build, emulate, test, size".into());
        };
        if verb == "test" {
            return Ok(Self::Test(options.join(" ")));
        }
        let (mut boards, mut crystal) = (Vec::new(), None);
        let mut rest = options.iter();
        while let Some(&option) = rest.next() {
            match (option, rest.next()) {
                ("--board", Some(name)) => boards.push(Board::named(name)?),
                ("--crystal", Some(&"8")) => crystal = Some(8),
                ("--crystal", Some(&"25")) => crystal = Some(25),
                ("--crystal", Some(other)) => return Err(format!("there is no crystal `{other}`: 8 or 25 MHz")),
                (option @ ("--board" | "--crystal"), None) => return Err(format!("{option} needs its value")),
                (other, _) => return Err(format!("`firmware` knows no `{other}`; see `cargo xtask help`")),
            }
        }
        let boards = if boards.is_empty() { Board::ALL.to_vec() } else { boards };
        let builds = boards.into_iter().map(|board| Build { board, crystal, emulated: false }).collect();
        match verb {
            "build" => Ok(Self::Build(builds)),
            "size" => Ok(Self::Size(builds)),
            "emulate" if !options.is_empty() => Err(format!("`firmware {verb}` takes no options")),
            "emulate" => Ok(Self::Emulate),
            other => Err(format!("`firmware` knows no `{other}`: build, emulate, test, size")),
        }
    }
}

/// Executes the command, and returns whether it succeeded.
pub(crate) fn run(root: &Path, order: &Order) -> bool {
    let done = match order {
        Order::Build(builds) => each(builds, |build| {
            let image = build.run(root)?;
            println!("{:<6} {}", build.board.name(), image.display());
            if let Some(path) = build.write_uf2(&image)? {
                println!("{:<6} {}", "", path.display());
            }
            sections::hold(build, &image)
        }),
        Order::Size(builds) => each(builds, |build| sections::hold(build, &build.run(root)?)),
        Order::Emulate => emulate(root).map(|()| true),
        Order::Test(part) => return test::run(root, part).passed,
    };
    done.unwrap_or_else(|reason| {
        eprintln!("firmware: {reason}");
        false
    })
}

/// Result of `test`, as a step of the whole suite.
pub(crate) fn test(root: &Path) -> test::Verdict {
    test::run(root, "")
}

fn each(builds: &[Build], mut task: impl FnMut(&Build) -> Result<bool, String>) -> Result<bool, String> {
    let mut passed = true;
    for build in builds {
        passed &= task(build)?;
    }
    Ok(passed)
}

/// Starts QEMU, prints the path of its serial line, and waits until QEMU ends or this process is interrupted.
fn emulate(root: &Path) -> Result<(), String> {
    let image = Build::EMULATED.run(root)?;
    let mut emulator = Emulator::start(&image, &[])?;
    println!("the card's line: {}", emulator.line());
    println!("it runs until interrupted");
    while emulator.runs() {
        std::thread::sleep(Duration::from_millis(200));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_read_and_nonsense_is_refused() {
        let all = |crystal| Board::ALL.map(|board| Build { board, crystal, emulated: false }).to_vec();
        assert_eq!(Order::read(&["build"]), Ok(Order::Build(all(None))));
        assert_eq!(Order::read(&["size", "--crystal", "25"]), Ok(Order::Size(all(Some(25)))));
        let one = vec![Build { board: Board::F401, crystal: Some(8), emulated: false }];
        assert_eq!(Order::read(&["build", "--board", "f401", "--crystal", "8"]), Ok(Order::Build(one)));
        assert_eq!(Order::read(&["emulate"]), Ok(Order::Emulate));
        assert_eq!(Order::read(&["test"]), Ok(Order::Test(String::new())));
        assert_eq!(Order::read(&["test", "by", "the", "Pico"]), Ok(Order::Test("by the Pico".into())));
        for wrong in
            [&[][..], &["flash"], &["build", "--board"], &["build", "--board", "f103"], &["emulate", "--board", "f405"]]
        {
            assert!(Order::read(wrong).is_err(), "{wrong:?}");
        }
    }
}
