//! The command line of `cargo xtask verify`.
//!
//! Invariant: a word that is not valid is refused; none is ignored.

use super::outcome::Engine;

/// Options of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Whether only as much is run as a test run has time for.
    pub(crate) quick: bool,
    /// These engines only; empty: all.
    pub(crate) engines: Vec<Engine>,
    /// Engines whose absence is a failure.
    pub(crate) require: Vec<Engine>,
    /// Whether a row of the committed ledger that is of other sources is a failure: `--require current`.
    pub(crate) require_current: bool,
    /// Writes the rows of this run to the committed ledger.
    pub(crate) update: bool,
    /// These rows only; empty: all.
    pub(crate) rows: Vec<String>,
    /// Lists the rows and their checks, and ends.
    pub(crate) list: bool,
    /// A harness and the numbers to replay.
    pub(crate) replay: Option<(String, String)>,
}

impl Options {
    /// What a test run has time for.
    pub fn quick() -> Self {
        Self { quick: true, ..Self::default() }
    }

    /// Parses the words after `verify`.
    ///
    /// # Errors
    /// The word that is not valid.
    pub fn read(words: &[&str]) -> Result<Self, String> {
        let mut options = Self::default();
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            let mut value = || words.next().copied().ok_or_else(|| format!("{word} needs a value"));
            match word {
                "--quick" => options.quick = true,
                "--list" => options.list = true,
                "--engine" => options.engines.extend(engines(value()?)?),
                "--require" => {
                    let (current, named): (Vec<&str>, Vec<&str>) =
                        value()?.split(',').partition(|name| *name == "current");
                    options.require_current |= !current.is_empty();
                    if !named.is_empty() {
                        options.require.extend(engines(&named.join(","))?);
                    }
                }
                "--update" => options.update = true,
                "--row" => options.rows.push(value()?.to_owned()),
                "--replay" => {
                    let (name, numbers) = value()?.split_once('=').ok_or("--replay needs HARNESS=1,2,3")?;
                    options.replay = Some((name.to_owned(), numbers.to_owned()));
                }
                other => return Err(format!("`verify` knows no `{other}`; see `cargo xtask help`")),
            }
        }
        Ok(options)
    }

    /// Whether this engine is requested.
    pub(crate) fn wants(&self, engine: Engine) -> bool {
        self.engines.contains(&engine)
            || self.require.contains(&engine)
            || self.engines.is_empty() && self.usual(engine)
    }

    /// Engines of a run that names none. CBMC builds and proves again for every mutant, which takes longer than all the
    /// rest; miri and the thread sanitizer need a nightly toolchain and build everything again.
    fn usual(&self, engine: Engine) -> bool {
        match engine {
            Engine::CbmcMutants | Engine::Miri | Engine::Tsan => false,
            Engine::Kani => !self.quick,
            _ => true,
        }
    }

    /// Whether this run covers everything, so that it may write the committed ledger.
    pub(crate) fn is_full(&self) -> bool {
        !self.quick && self.engines.is_empty() && self.rows.is_empty()
    }
}

fn engines(names: &str) -> Result<Vec<Engine>, String> {
    let known = || Engine::ALL.map(Engine::name).join(", ");
    let find = |name| Engine::named(name).ok_or_else(|| format!("there is no engine `{name}`; there are {}", known()));
    names.split(',').map(find).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn engines_may_be_listed_or_repeated() {
        let options =
            Options::read(&["--engine", "native", "--engine", "cbmc", "--require", "kani,cbmc", "--row", "a"]).unwrap();
        assert_eq!(options.engines, [Engine::Native, Engine::Cbmc]);
        assert_eq!(options.require, [Engine::Kani, Engine::Cbmc]);
        assert!(options.wants(Engine::Kani) && options.wants(Engine::Native) && !options.wants(Engine::Loom));
        assert!(!options.is_full() && Options::default().is_full() && !Options::quick().is_full());
        assert!(!Options::quick().wants(Engine::Kani) && Options::default().wants(Engine::Kani));
        let current = Options::read(&["--require", "current,cbmc", "--update"]).unwrap();
        assert!(current.require_current && current.update && current.require == [Engine::Cbmc]);
        let replay = Options::read(&["--replay", "h=1,2"]).unwrap().replay;
        assert_eq!(replay, Some(("h".into(), "1,2".into())));
    }

    #[test]
    fn what_is_not_understood_is_refused() {
        for words in [&["--engine"][..], &["--engine", "z3"], &["--replay", "h"], &["quick"], &["--row"]] {
            assert!(Options::read(words).is_err(), "{words:?}");
        }
    }
}
