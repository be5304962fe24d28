//! Publisher: takes snapshots of the screen model and gives them to all pages.
//!
//! Invariant: the lock of the model is held for one snapshot at a time, and only where the model has changed; pages
//! receive the newest snapshot and never wait for one another. The levels of a path are made in a thread of their own,
//! so that no hold and no beat of a jog waits for them.

use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex};

use retrace_controller::PlannedPath;
use retrace_tui::{Rejection, ScreenModel, lock_model, panel_status};

use crate::path_levels::PathLevels;
use crate::snapshot::{LiveView, LogView, SeenState, StateView, is_retracing};

/// What pages show, as JSON where it is sent.
#[derive(Clone, Debug)]
pub(crate) struct Snapshot {
    /// The message `state`.
    pub(crate) state: Arc<str>,
    /// The message `live`.
    pub(crate) live: Arc<str>,
    /// The message `log`.
    pub(crate) log: Arc<str>,
    /// The path, once it is known.
    pub(crate) path: Option<Arc<PathLevels>>,
    /// The last order that was rejected after it had been passed on.
    pub(crate) rejection: Arc<Rejection>,
    /// Number of the state that matters for starting motion.
    pub(crate) n: u32,
    /// Whether the machine is at rest.
    pub(crate) at_rest: bool,
    /// Whether the path is being retraced.
    pub(crate) is_retracing: bool,
    /// Whether a program runs.
    pub(crate) runs_program: bool,
}

impl Snapshot {
    /// Number of the path.
    pub(crate) fn path_number(&self) -> Option<u32> {
        self.path.as_ref().map(|path| path.number)
    }
}

/// Publisher with what it published last.
pub(crate) struct Publisher {
    model: Arc<Mutex<ScreenModel>>,
    changes: Option<u64>,
    state: Option<StateView>,
    live: Option<LiveView>,
    log: Option<LogView>,
    /// States that matter for starting motion, the newest last, with their numbers.
    seen: Vec<(u32, SeenState)>,
    path: Option<Arc<PathLevels>>,
    /// The planned path that `path` shows, or will show.
    planned: Option<Arc<PlannedPath>>,
    /// The levels that are being made.
    making: Option<Receiver<Arc<PathLevels>>>,
    paths: u32,
    snapshot: Option<Snapshot>,
}

/// Number of earlier states that can be named in a refusal.
const MAX_SEEN: usize = 64;

impl Publisher {
    /// Publisher of this model.
    pub(crate) fn new(model: Arc<Mutex<ScreenModel>>) -> Self {
        Self {
            model,
            changes: None,
            state: None,
            live: None,
            log: None,
            seen: Vec::new(),
            path: None,
            planned: None,
            making: None,
            paths: 0,
            snapshot: None,
        }
    }

    /// Takes a snapshot. `None` where nothing has changed since the last one.
    pub(crate) fn poll(&mut self) -> Option<Snapshot> {
        let (state, live, log, seen, planned, flags, rejection) = {
            let model = lock_model(&self.model);
            if self.changes == Some(model.changes) && self.making.is_none() {
                return None;
            }
            self.changes = Some(model.changes);
            let status = panel_status(&model);
            let seen = SeenState::of(&model, &status);
            let planned = model.facts.planned_path.as_ref().or(model.executed_path.as_ref()).cloned();
            let flags = (model.at_rest, is_retracing(&model), model.stage == retrace_tui::ScreenStage::Job);
            let log = LogView::of(&model);
            let rejection = Arc::clone(&model.rejection);
            (StateView::of(&model, status), LiveView::of(&model), log, seen, planned, flags, rejection)
        };
        let path = self.path_of(planned);
        let n = self.number_of(seen);
        let state = state.with_numbers(n, path.as_ref().map(|path| path.number));
        let text = |view: serde_json::Result<String>| Arc::<str>::from(view.unwrap_or_default());
        let before = self.snapshot.as_ref();
        let kept = |is_same: bool, old: Option<&Arc<str>>| old.filter(|_| is_same).cloned();
        let next = Snapshot {
            state: kept(self.state.as_ref() == Some(&state), before.map(|it| &it.state))
                .unwrap_or_else(|| text(serde_json::to_string(&state))),
            live: kept(self.live.as_ref() == Some(&live), before.map(|it| &it.live))
                .unwrap_or_else(|| text(serde_json::to_string(&live))),
            log: kept(self.log.as_ref() == Some(&log), before.map(|it| &it.log))
                .unwrap_or_else(|| text(serde_json::to_string(&log))),
            path,
            rejection,
            n,
            at_rest: flags.0,
            is_retracing: flags.1,
            runs_program: flags.2,
        };
        (self.state, self.live, self.log) = (Some(state), Some(live), Some(log));
        let is_new = before.is_none_or(|before| {
            !Arc::ptr_eq(&before.state, &next.state)
                || !Arc::ptr_eq(&before.live, &next.live)
                || !Arc::ptr_eq(&before.log, &next.log)
                || !Arc::ptr_eq(&before.rejection, &next.rejection)
        });
        self.snapshot = Some(next.clone());
        is_new.then_some(next)
    }

    /// What has changed since the state of this number, in words.
    pub(crate) fn changes_since(&self, seen: u32) -> String {
        let now = self.seen.last().map(|(_, state)| state);
        let before = self.seen.iter().find(|(n, _)| *n == seen).map(|(_, state)| state);
        match (now, before) {
            (Some(now), Some(before)) => now.changes_from(before),
            _ => "the page's state is too old".into(),
        }
    }

    fn number_of(&mut self, seen: SeenState) -> u32 {
        if let Some((n, last)) = self.seen.last()
            && *last == seen
        {
            return *n;
        }
        let n = self.seen.last().map_or(1, |(n, _)| n.wrapping_add(1));
        if self.seen.len() >= MAX_SEEN {
            self.seen.remove(0);
        }
        self.seen.push((n, seen));
        n
    }

    /// Levels of the planned path. Those of the path before are shown until the new ones are made.
    fn path_of(&mut self, planned: Option<Arc<PlannedPath>>) -> Option<Arc<PathLevels>> {
        match self.making.as_ref().map(Receiver::try_recv) {
            Some(Ok(levels)) => (self.path, self.making) = (Some(levels), None),
            Some(Err(TryRecvError::Disconnected)) => self.making = None,
            Some(Err(TryRecvError::Empty)) => return self.path.clone(),
            None => {}
        }
        let is_same = match (&planned, &self.planned) {
            (Some(new), Some(old)) => Arc::ptr_eq(new, old),
            (new, old) => new.is_none() && old.is_none(),
        };
        if !is_same {
            self.planned.clone_from(&planned);
            match planned {
                Some(planned) => self.make_levels(planned),
                None => self.path = None,
            }
        }
        self.path.clone()
    }

    /// Begins to make the levels of a path. Where it is the one that is shown, that keeps its number.
    fn make_levels(&mut self, planned: Arc<PlannedPath>) {
        let (sender, receiver) = channel();
        self.paths += 1;
        let (number, shown) = (self.paths, self.path.clone());
        let make = move || {
            let levels = match shown {
                Some(shown) if *shown.path == *planned => shown,
                _ => Arc::new(PathLevels::new(number, planned)),
            };
            // A server that has ended needs no path.
            let _ = sender.send(levels);
        };
        if std::thread::Builder::new().name("path levels".into()).spawn(make).is_ok() {
            self.making = Some(receiver);
        }
    }
}
