//! The loop that connects keys, model and terminal.
//!
//! Invariant: the terminal is restored, however the loop ends.

use std::io;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{
    self, DisableMouseCapture, EnableMouseCapture, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers,
    KeyboardEnhancementFlags, MouseEventKind, PopKeyboardEnhancementFlags, PushKeyboardEnhancementFlags,
};
use ratatui::crossterm::terminal::{BeginSynchronizedUpdate, EndSynchronizedUpdate};
use ratatui::crossterm::{execute, queue};

use crate::key_state::KeyState;
use crate::keys::Key;
use crate::model::ScreenModel;
use crate::model_observer::lock_model;
use crate::ui_command::UiCommand;
use crate::view::{self, Theme};

/// Interval of the polls for keys.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Minimum time between two redraws.
const MIN_REDRAW_INTERVAL: Duration = Duration::from_millis(40);

/// Maximum time between two redraws, so that a notice disappears.
const MAX_REDRAW_INTERVAL: Duration = Duration::from_millis(500);

/// Screen loop.
#[derive(Debug)]
pub struct Screen {
    key_state: KeyState,
    theme: Theme,
}

impl Default for Screen {
    fn default() -> Self {
        Self { key_state: KeyState::new(), theme: Theme::of_environment() }
    }
}

impl Screen {
    /// Draws the model and handles keys until the operator quits or the model is closed.
    ///
    /// # Errors
    /// The terminal reports an error.
    pub fn run(&mut self, model: &Mutex<ScreenModel>, say: impl FnMut(UiCommand)) -> io::Result<()> {
        // The terminal is restored on a panic too.
        let mut terminal = ratatui::try_init()?;
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            let _ = execute!(io::stdout(), PopKeyboardEnhancementFlags);
            let _ = execute!(io::stdout(), DisableMouseCapture);
            hook(panic);
        }));
        // A terminal without a mouse works too, and one that does not report when a key is released (kitty's keyboard
        // protocol does, and others ignore the sequence).
        let _ = execute!(io::stdout(), EnableMouseCapture);
        let reports =
            KeyboardEnhancementFlags::DISAMBIGUATE_ESCAPE_CODES | KeyboardEnhancementFlags::REPORT_EVENT_TYPES;
        let _ = execute!(io::stdout(), PushKeyboardEnhancementFlags(reports));
        let done = self.show(&mut terminal, model, say);
        restore_terminal();
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
                let model = lock_model(model);
                (model.changes, model.is_closed)
            };
            if is_over {
                return Ok(());
            }
            let is_due = match shown {
                None => true,
                Some((at, drawn)) => {
                    at.elapsed() >= MIN_REDRAW_INTERVAL && (touched || changes != drawn)
                        || at.elapsed() >= MAX_REDRAW_INTERVAL
                }
            };
            if is_due {
                let started = Instant::now();
                let picture = lock_model(model).clone();
                let now_ms = begun.elapsed().as_millis() as u64;
                self.key_state.follow(&picture);
                // A terminal that knows synchronized output shows a redraw whole; others ignore the two sequences.
                queue!(io::stdout(), BeginSynchronizedUpdate)?;
                terminal.draw(|frame| view::draw(frame.buffer_mut(), &picture, &self.key_state, self.theme, now_ms))?;
                execute!(io::stdout(), EndSynchronizedUpdate)?;
                record_redraw(model, started.elapsed());
                shown = Some((started, picture.changes));
                touched = false;
            }
            if !event::poll(POLL_INTERVAL)? {
                continue;
            }
            // All pending events are handled before the next redraw: a wheel turns faster than a screen is drawn.
            while event::poll(Duration::ZERO)? {
                touched = true;
                let now_ms = begun.elapsed().as_millis() as u64;
                let command = self.handle_event(&event::read()?, now_ms, model);
                if let Some(command) = command {
                    let quits = command == UiCommand::Quit;
                    say(command);
                    if quits {
                        return Ok(());
                    }
                }
            }
        }
    }

    fn handle_event(&mut self, event: &Event, now_ms: u64, model: &Mutex<ScreenModel>) -> Option<UiCommand> {
        let picture = || lock_model(model).clone();
        match event {
            Event::Key(key) => match key.kind {
                KeyEventKind::Press => self.key_state.key(key_of(key)?, now_ms, &picture()),
                KeyEventKind::Repeat => self.key_state.repeat(key_of(key)?, now_ms, &picture()),
                KeyEventKind::Release => self.key_state.release(key_of(key)?),
            },
            Event::Mouse(mouse) => match mouse.kind {
                MouseEventKind::ScrollUp => self.key_state.mouse_wheel(true, &picture()),
                MouseEventKind::ScrollDown => self.key_state.mouse_wheel(false, &picture()),
                _ => None,
            },
            _ => None,
        }
    }
}

/// Restores the terminal. Errors of a terminal that is gone are ignored.
pub fn restore_terminal() {
    let _ = execute!(io::stdout(), PopKeyboardEnhancementFlags);
    let _ = execute!(io::stdout(), DisableMouseCapture);
    let _ = ratatui::try_restore();
}

/// Publishes the duration of a redraw.
fn record_redraw(model: &Mutex<ScreenModel>, took: Duration) {
    let ms = took.as_secs_f64() * 1000.0;
    let mut model = lock_model(model);
    let redraw = &mut model.redraw;
    redraw.count += 1;
    redraw.mean_ms += (ms - redraw.mean_ms) / redraw.count as f64;
    redraw.max_ms = redraw.max_ms.max(ms);
}

/// Converts a key event, if the key has a use on the screen.
fn key_of(event: &KeyEvent) -> Option<Key> {
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
