//! Terminal used by the monitor. It is restored whenever the program ends, except after a signal that cannot be caught.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, IsTerminal, Read, Write, stdin, stdout};
use std::os::fd::AsFd;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcgetwinsize, tcsetattr};

use crate::look::{ScreenLook, Weight};
use crate::picture::{Cell, Picture};

/// Control sequences of xterm: alternate screen and hidden cursor, and back.
const ENTER: &[u8] = b"\x1b[?1049h\x1b[?25l";
const LEAVE: &[u8] = b"\x1b[?1049l\x1b[?25h";
/// Size of the kernel's queue of keys: pasted text that waits there is read at once \[bytes\].
const QUEUE_BYTES: usize = 4096;
const CLEAR: &str = "\x1b[0m\x1b[2J";

/// Terminal in use. Its previous state is restored on drop.
#[derive(Debug)]
pub struct OpenTerminal {
    /// Source of the keys.
    keys: File,
    shown: Picture,
    _restored_on_drop: SavedTerminal,
}

/// Previous settings of the terminal, restored on drop.
#[derive(Debug)]
struct SavedTerminal {
    keys: File,
    settings: Termios,
}

impl OpenTerminal {
    /// Switches the terminal to its alternate screen and to raw key input.
    ///
    /// # Errors
    /// The terminal refuses.
    pub fn enter() -> io::Result<Self> {
        let keys = match stdin().is_terminal() {
            true => File::from(stdin().as_fd().try_clone_to_owned()?),
            false => File::open("/dev/tty")?,
        };
        let settings = tcgetattr(&keys)?;
        restore_on_panic(SavedTerminal { keys: keys.try_clone()?, settings: settings.clone() });
        let mut raw = settings.clone();
        raw.make_raw();
        let restored_on_drop = SavedTerminal { keys: keys.try_clone()?, settings };
        tcsetattr(&keys, OptionalActions::Now, &raw)?;
        stdout().write_all(ENTER)?;
        Ok(Self { keys, shown: Picture::new((0, 0)), _restored_on_drop: restored_on_drop })
    }

    /// Number of columns and rows \[cells\].
    ///
    /// # Errors
    /// The terminal is gone.
    pub fn size(&self) -> io::Result<(u16, u16)> {
        let size = tcgetwinsize(stdout())?;
        Ok((size.ws_col, size.ws_row))
    }

    /// Shows `picture`; writes only the rows that have changed.
    ///
    /// # Errors
    /// The terminal is gone.
    pub fn show(&mut self, picture: Picture, look: ScreenLook) -> io::Result<()> {
        let is_resized = picture.size != self.shown.size;
        let mut text = if is_resized { CLEAR.to_owned() } else { String::new() };
        let before = self.shown.rows().map(Some).chain(std::iter::repeat(None));
        for (number, (row, before)) in picture.rows().zip(before).enumerate() {
            if is_resized || before != Some(row) {
                // Writing to a string does not fail.
                let _ = write!(text, "\x1b[{};1H{}", number + 1, sequences(row, look));
            }
        }
        self.shown = picture;
        let mut output = stdout().lock();
        output.write_all(text.as_bytes())?;
        output.flush()
    }

    /// Waits at most `timeout` for keys; returns their bytes, none of a closed terminal, `None` if no key was pressed.
    ///
    /// # Errors
    /// The terminal fails.
    pub fn keys(&mut self, timeout: Duration) -> io::Result<Option<Vec<u8>>> {
        let output = stdout();
        let mut ends =
            [PollFd::new(&self.keys, PollFlags::IN), PollFd::new(&output, PollFlags::empty())];
        let timeout = Timespec::try_from(timeout).map_err(io::Error::other)?;
        match poll(&mut ends, Some(&timeout)) {
            // A signal, for example after a change of size.
            Err(Errno::INTR) => return Ok(None),
            other => other?,
        };
        let gone = PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL;
        if ends.iter().any(|end| end.revents().intersects(gone)) {
            return Ok(Some(Vec::new()));
        }
        if !ends[0].revents().contains(PollFlags::IN) {
            return Ok(None);
        }
        let mut bytes = [0; QUEUE_BYTES];
        let length = self.keys.read(&mut bytes)?;
        Ok(Some(bytes[..length].to_vec()))
    }
}

/// A row as text with control sequences.
fn sequences(row: &[Cell], look: ScreenLook) -> String {
    let mut text = look.sequence(Weight::Plain).to_owned();
    for cells in row.chunk_by(|(_, a), (_, b)| a == b) {
        text.push_str(look.sequence(cells[0].1));
        text.extend(cells.iter().map(|(character, _)| character));
    }
    text
}

impl SavedTerminal {
    /// Restores the terminal. An error is ignored: the terminal is gone.
    fn restore(&self) {
        let _ = tcsetattr(&self.keys, OptionalActions::Now, &self.settings);
        let _ = stdout().write_all(LEAVE);
        let _ = stdout().flush();
    }
}

impl Drop for SavedTerminal {
    fn drop(&mut self) {
        self.restore();
    }
}

/// Restores the terminal before the message of a panic is printed, so that the message is readable.
fn restore_on_panic(saved: SavedTerminal) {
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        saved.restore();
        print(panic);
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_changes_its_look_where_the_weight_changes() {
        let row = [('a', Weight::Plain), ('b', Weight::Alarm), ('c', Weight::Alarm)];
        let look = ScreenLook { has_colour: false, has_blocks: false };
        assert_eq!(sequences(&row, look), "\x1b[0m\x1b[0ma\x1b[0;1;7mbc");
    }
}
