//! A picture of characters in rows and columns.

use crate::look::Weight;

/// A rectangle of cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rect {
    /// First column \[cells\].
    pub x: u16,
    /// First row \[cells\].
    pub y: u16,
    /// Number of columns \[cells\].
    pub width: u16,
    /// Number of rows \[cells\].
    pub height: u16,
}

impl Rect {
    /// Whether the rectangle has no cell.
    pub fn is_empty(self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// The rows of the rectangle.
    pub fn rows(self) -> impl Iterator<Item = Self> {
        (0..self.height).map(move |row| Self { y: self.y + row, height: 1, ..self })
    }

    /// The part right of the first `width` columns.
    pub fn right_of(self, width: u16) -> Self {
        let width = width.min(self.width);
        Self { x: self.x + width, width: self.width - width, ..self }
    }
}

/// A cell: its character and weight.
pub type Cell = (char, Weight);

/// Cells of a terminal.
#[derive(Debug)]
pub struct Picture {
    /// Columns and rows \[cells\].
    pub size: (u16, u16),
    cells: Vec<Cell>,
}

impl Picture {
    /// Empty picture with these columns and rows.
    pub fn new(size: (u16, u16)) -> Self {
        let count = usize::from(size.0) * usize::from(size.1);
        Self { size, cells: vec![(' ', Weight::Plain); count] }
    }

    /// Rectangle of the whole picture.
    pub fn area(&self) -> Rect {
        Rect { width: self.size.0, height: self.size.1, ..Rect::default() }
    }

    /// Writes a text into the first row of `area`; a text that is too long ends in dots.
    pub fn text(&mut self, area: Rect, text: &str, weight: Weight) {
        let width = usize::from(area.width);
        if area.is_empty() {
            return;
        }
        let kept = if text.chars().count() <= width { width } else { width.saturating_sub(2) };
        let dots = if kept == width { "" } else { ".." };
        let characters = text.chars().take(kept).chain(dots.chars()).take(width);
        for (x, character) in (area.x..).zip(characters) {
            self.put((x, area.y), character, weight);
        }
    }

    /// Writes a character at a column and row.
    pub fn put(&mut self, (x, y): (u16, u16), character: char, weight: Weight) {
        let index = usize::from(y) * usize::from(self.size.0) + usize::from(x);
        if let Some(cell) = self.cells.get_mut(index).filter(|_| x < self.size.0) {
            *cell = (character, weight);
        }
    }

    /// The rows, from the top.
    pub fn rows(&self) -> impl Iterator<Item = &[Cell]> {
        self.cells.chunks(usize::from(self.size.0).max(1))
    }
}
