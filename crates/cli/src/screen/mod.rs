//! Full-screen operation: the loop that joins keys, picture and terminal.
//!
//! The screen is a pure function from a picture of the machine ([`model::Model`]) to cells ([`view`]), and another from keys to words
//! ([`hand`]). The picture is kept up by the reporter's thread ([`live`]); the motion path knows nothing of all this.
//!
//! Invariant: the terminal is as it was before, however the loop ends.

pub mod diagnostic_text;
mod event_text;
#[cfg(test)]
mod fake_machine;
mod files;
mod key_state;
mod keys;
mod layout;
pub mod model;
pub mod model_observer;
pub mod path_length;
pub mod preview;
pub mod program_facts;
mod program_outputs;
mod status_line;
pub mod trail;
mod view;

#[cfg(test)]
mod tests;

use std::io;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{
    self, DisableMouseCapture, EnableMouseCapture, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers, MouseEventKind,
};
use ratatui::crossterm::execute;
use retrace_controller::manual::ManualTask;
use retrace_controller::operator::OperatorCommand;

use key_state::KeyState;
use keys::Key;
use model::ScreenModel;
use model_observer::locked;
use view::Theme;

/// How often keys are looked for.
const POLL: Duration = Duration::from_millis(20);

/// The shortest time between two pictures.
const REDRAW: Duration = Duration::from_millis(40);

/// A picture is drawn at least so often, so that a notice goes away.
const AT_LEAST: Duration = Duration::from_millis(500);

/// What the operator says at the screen.
#[derive(Clone, Debug, PartialEq)]
pub enum UiCommand {
    /// While a job runs.
    Deed(OperatorCommand),
    /// While none runs. What moves on until it is stopped, [`Deed::Hold`] stops.
    Task(ManualTask),
    /// The handwheel was turned by so many counts.
    Turn(i32),
    /// The program is to begin.
    Start,
    /// The machine is to be set up again: the job has ended.
    SetUp,
    /// Another program is to be loaded, from this file.
    Load(PathBuf),
    /// Every cutter is to be switched off.
    CutterOff,
    /// M1 is to stop, or not.
    OptionalStop(bool),
    /// What was asked is agreed to, or not.
    Answer(bool),
    /// The operator has read why the program is refused.
    CloseRefusal,
    /// A dry run is wanted, or not.
    DryRun(bool),
    /// The screen is to be left; no job runs.
    Quit,
}

/// The screen.
#[derive(Debug)]
pub struct Screen {
    hand: KeyState,
    look: Theme,
}

impl Default for Screen {
    fn default() -> Self {
        Self { hand: KeyState::new(), look: Theme::of_environment() }
    }
}

impl Screen {
    /// Shows the picture and listens to the keys, until the operator quits, or the picture says that it is over.
    ///
    /// # Errors
    /// The terminal reports a fault.
    pub fn run(&mut self, model: &Mutex<ScreenModel>, say: impl FnMut(UiCommand)) -> io::Result<()> {
        // It puts the terminal back on a panic as well.
        let mut terminal = ratatui::try_init()?;
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            let _ = execute!(io::stdout(), DisableMouseCapture);
            hook(panic);
        }));
        // A terminal without a mouse works as well.
        let _ = execute!(io::stdout(), EnableMouseCapture);
        let done = self.show(&mut terminal, model, say);
        put_back();
        let _ = std::panic::take_hook();
        done
    }

    fn show(
        &mut self,
        terminal: &mut DefaultTerminal,
        model: &Mutex<ScreenModel>,
        mut say: impl FnMut(UiCommand),
    ) -> io::Result<()> {
        let begun = Instant::now();
        let mut shown: Option<(Instant, u64)> = None;
        let mut touched = true;
        loop {
            let (changes, is_over) = {
                let model = locked(model);
                (model.changes, model.over)
            };
            if is_over {
                return Ok(());
            }
            let is_due = match shown {
                None => true,
                Some((at, drawn)) => {
                    at.elapsed() >= REDRAW && (touched || changes != drawn) || at.elapsed() >= AT_LEAST
                }
            };
            if is_due {
                let started = Instant::now();
                let picture = locked(model).clone();
                let now_ms = begun.elapsed().as_millis() as u64;
                terminal.draw(|frame| view::draw(frame.buffer_mut(), &picture, &self.hand, self.look, now_ms))?;
                measured(model, started.elapsed());
                shown = Some((started, picture.changes));
                touched = false;
            }
            if !event::poll(POLL)? {
                continue;
            }
            // All that waits is taken before the next picture: a wheel turns faster than a screen is drawn.
            while event::poll(Duration::ZERO)? {
                touched = true;
                let now_ms = begun.elapsed().as_millis() as u64;
                let said = self.hear(&event::read()?, now_ms, model);
                if let Some(said) = said {
                    let quits = said == UiCommand::Quit;
                    say(said);
                    if quits {
                        return Ok(());
                    }
                }
            }
        }
    }

    fn hear(&mut self, event: &Event, now_ms: u64, model: &Mutex<ScreenModel>) -> Option<UiCommand> {
        let picture = || locked(model).clone();
        match event {
            Event::Key(key) if key.kind != KeyEventKind::Release => self.hand.key(known(key)?, now_ms, &picture()),
            Event::Mouse(mouse) => match mouse.kind {
                MouseEventKind::ScrollUp => self.hand.mouse_wheel(true, &picture()),
                MouseEventKind::ScrollDown => self.hand.mouse_wheel(false, &picture()),
                _ => None,
            },
            _ => None,
        }
    }
}

/// Puts the terminal back to what it was. One that is gone takes nothing any more.
pub fn put_back() {
    let _ = execute!(io::stdout(), DisableMouseCapture);
    let _ = ratatui::try_restore();
}

/// Publishes how long a picture took.
fn measured(model: &Mutex<ScreenModel>, took: Duration) {
    let ms = took.as_secs_f64() * 1000.0;
    let mut model = locked(model);
    let redraw = &mut model.redraw;
    redraw.count += 1;
    redraw.mean_ms += (ms - redraw.mean_ms) / redraw.count as f64;
    redraw.max_ms = redraw.max_ms.max(ms);
}

/// The key, if it is one that the screen knows.
fn known(event: &KeyEvent) -> Option<Key> {
    Some(match event.code {
        KeyCode::Char('c') if event.modifiers.contains(KeyModifiers::CONTROL) => Key::Interrupt,
        KeyCode::Char(_) if event.modifiers.intersects(KeyModifiers::CONTROL | KeyModifiers::ALT) => return None,
        KeyCode::Char(c) => Key::Char(c),
        KeyCode::Up if event.modifiers.contains(KeyModifiers::SHIFT) => Key::ShiftUp,
        KeyCode::Down if event.modifiers.contains(KeyModifiers::SHIFT) => Key::ShiftDown,
        KeyCode::Left if event.modifiers.contains(KeyModifiers::SHIFT) => Key::ShiftLeft,
        KeyCode::Right if event.modifiers.contains(KeyModifiers::SHIFT) => Key::ShiftRight,
        KeyCode::Up => Key::Up,
        KeyCode::Down => Key::Down,
        KeyCode::Left => Key::Left,
        KeyCode::Right => Key::Right,
        KeyCode::PageUp => Key::PageUp,
        KeyCode::PageDown => Key::PageDown,
        KeyCode::Tab => Key::Tab,
        KeyCode::Enter => Key::Enter,
        KeyCode::Esc => Key::Esc,
        KeyCode::Backspace => Key::Backspace,
        _ => return None,
    })
}
