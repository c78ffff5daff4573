//! A ring buffer of fixed size.

/// Capacity \[-\]: one second at 60 Hz.
const KEPT: usize = 64;

/// Ring buffer of the newest items.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring<T> {
    items: [Option<T>; KEPT],
    /// Index of the next item; the newest is before it.
    next: usize,
}

impl<T: Copy> Ring<T> {
    /// An empty buffer.
    pub fn new() -> Self {
        Self { items: [None; KEPT], next: 0 }
    }

    /// Adds an item; the oldest one is dropped if the buffer is full.
    pub fn push(&mut self, item: T) {
        self.items[self.next] = Some(item);
        self.next = (self.next + 1) % KEPT;
    }

    /// The items, newest first.
    pub fn newest_first(&self) -> impl Iterator<Item = &T> {
        (1..=KEPT).map_while(|back| self.items[self.index(back)].as_ref())
    }

    /// The oldest item of a full buffer, which may have dropped older ones.
    pub fn oldest_if_full(&self) -> Option<&T> {
        self.items[self.index(KEPT)].as_ref()
    }

    /// The item that was added `back` items ago \[-\]; 1 for the newest.
    pub fn back_mut(&mut self, back: usize) -> Option<&mut T> {
        if !(1..=KEPT).contains(&back) {
            return None;
        }
        let index = self.index(back);
        self.items[index].as_mut()
    }

    /// Index of the item that was added `back` items ago \[-\]; 1 for the newest.
    fn index(&self, back: usize) -> usize {
        (self.next + KEPT - back) % KEPT
    }
}
