//! The terminal while it is in use, and how it is left as it was: whatever ends the program, but a signal that cannot be caught.

use std::io::{self, IsTerminal, Stdout, Write, stdin, stdout};
use std::time::Duration;

use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::Show;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

/// What the operator asks for by a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// End.
    Quit,
    /// Begin new latencies and counters.
    Restart,
}

/// The terminal in use. When dropped, it is as it was before.
pub struct OpenTerminal {
    terminal: Terminal<CrosstermBackend<Stdout>>,
    _left_on_drop: LeaveOnDrop,
}

struct LeaveOnDrop;

impl OpenTerminal {
    /// Takes the terminal: its other screen, and every key as it is typed.
    ///
    /// # Errors
    /// The terminal refuses.
    pub fn enter() -> io::Result<Self> {
        leave_on_panic();
        enable_raw_mode()?;
        let left_on_drop = LeaveOnDrop;
        execute!(stdout(), EnterAlternateScreen)?;
        let terminal = Terminal::new(CrosstermBackend::new(stdout()))?;
        Ok(Self { terminal, _left_on_drop: left_on_drop })
    }

    /// Shows what `draw` draws, at the terminal's present size.
    ///
    /// # Errors
    /// The terminal is gone.
    pub fn show(&mut self, draw: impl FnOnce(&mut ratatui::buffer::Buffer)) -> io::Result<()> {
        self.terminal.draw(|frame| draw(frame.buffer_mut())).map(drop)
    }

    /// Waits at most `timeout` for a key; returns at once on a change of the terminal's size. A terminal that was closed counts as
    /// the key that ends.
    ///
    /// # Errors
    /// The terminal fails.
    pub fn key(&mut self, timeout: Duration) -> io::Result<Option<Key>> {
        if is_closed(Duration::ZERO)? {
            return Ok(Some(Key::Quit));
        }
        if !event::poll(Duration::ZERO)? {
            if is_closed(timeout)? {
                return Ok(Some(Key::Quit));
            }
            if !event::poll(Duration::ZERO)? {
                return Ok(None);
            }
        }
        match event::read()? {
            Event::Key(key) if key.kind != KeyEventKind::Release => Ok(meaning(key)),
            _ => Ok(None),
        }
    }
}

impl Drop for LeaveOnDrop {
    fn drop(&mut self) {
        leave(&mut stdout());
    }
}

/// Waits at most `timeout` for input, and returns whether the terminal was closed: nobody looks any more.
fn is_closed(timeout: Duration) -> io::Result<bool> {
    let (input, output) = (stdin(), stdout());
    // An input that is no terminal may be ready for ever.
    let wanted = if input.is_terminal() { PollFlags::IN } else { PollFlags::empty() };
    let mut ends = [PollFd::new(&input, wanted), PollFd::new(&output, PollFlags::empty())];
    let timeout = Timespec::try_from(timeout).map_err(io::Error::other)?;
    match poll(&mut ends, Some(&timeout)) {
        // A signal, as of a change of size.
        Err(Errno::INTR) => return Ok(false),
        other => other?,
    };
    let gone = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
    Ok(ends[1].revents().intersects(gone)
        || (!wanted.is_empty() && ends[0].revents().intersects(gone)))
}

/// What a key asks for.
fn meaning(key: KeyEvent) -> Option<Key> {
    match (key.code, key.modifiers) {
        (KeyCode::Char('q' | 'Q') | KeyCode::Esc, _) => Some(Key::Quit),
        // In raw mode the terminal makes no signal of it.
        (KeyCode::Char('c' | 'd'), KeyModifiers::CONTROL) => Some(Key::Quit),
        (KeyCode::Char('r'), _) => Some(Key::Restart),
        _ => None,
    }
}

/// Gives the terminal back. An error is ignored: the terminal is gone.
fn leave(output: &mut impl Write) {
    let _ = disable_raw_mode();
    let _ = execute!(output, LeaveAlternateScreen, Show);
}

/// Gives the terminal back before a panic is told, so that it can be read.
fn leave_on_panic() {
    let tell = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        leave(&mut stdout());
        tell(panic);
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_that_end_and_keys_that_do_not() {
        let key = |code, modifiers| meaning(KeyEvent::new(code, modifiers));
        for (code, modifiers) in [
            (KeyCode::Char('q'), KeyModifiers::NONE),
            (KeyCode::Char('Q'), KeyModifiers::SHIFT),
            (KeyCode::Char('c'), KeyModifiers::CONTROL),
            (KeyCode::Esc, KeyModifiers::NONE),
        ] {
            assert_eq!(key(code, modifiers), Some(Key::Quit));
        }
        assert_eq!(key(KeyCode::Char('c'), KeyModifiers::NONE), None);
        assert_eq!(key(KeyCode::Char('r'), KeyModifiers::NONE), Some(Key::Restart));
    }

    #[test]
    fn leaving_shows_the_first_screen_and_the_cursor() {
        let mut written = Vec::new();
        leave(&mut written);
        assert_eq!(written, b"\x1b[?1049l\x1b[?25h");
    }
}
