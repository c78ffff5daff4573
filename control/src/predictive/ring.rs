//! The newest of something, in a memory of fixed size.

/// How many are kept. At 60 Hz that is a second, at 1 kHz still more than any delay flown with.
const KEPT: usize = 64;

/// The newest items pushed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring<T> {
    items: [Option<T>; KEPT],
    /// Where the next goes: the newest is before it.
    next: usize,
}

impl<T: Copy> Ring<T> {
    /// Nothing yet.
    #[must_use]
    pub fn new() -> Self {
        Self { items: [None; KEPT], next: 0 }
    }

    /// Adds one; the oldest makes room.
    pub fn push(&mut self, item: T) {
        self.items[self.next] = Some(item);
        self.next = (self.next + 1) % KEPT;
    }

    /// Those kept, the newest first.
    pub fn newest_first(&self) -> impl Iterator<Item = &T> {
        (1..=KEPT).map_while(|back| self.items[(self.next + KEPT - back) % KEPT].as_ref())
    }

    /// Those kept, in no order.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.items.iter_mut().flatten()
    }
}
