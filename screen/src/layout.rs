//! What is shown in a terminal of a given size. Parts that do not fit are left out, the least important first, and named.

use ratatui::layout::Rect;

/// Size at which everything is shown: columns and rows \[cells\].
pub const COMPLETE: (u16, u16) = (80, 24);
/// Lines of the status at most \[cells\].
const STATUS_LINES: u16 = 9;
/// Height of a chart, and number of charts \[cells\].
pub const CHART_LINES: u16 = 2;
const CHARTS: u16 = 3;
/// Least width of a chart with its label \[cells\].
const CHART_WIDTH: u16 = 40;
/// Width of the table of hops \[cells\], and its least height: title and sum.
const HOPS_WIDTH: u16 = 44;
const HOPS_LINES: u16 = 7;
/// Least height of the events: title and two of them \[cells\].
const EVENTS_LINES: u16 = 3;
/// Least width of the events \[cells\].
const EVENTS_WIDTH: u16 = 30;

/// The rectangles of the parts; `None` for those that do not fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScreenParts {
    /// Title.
    pub title: Rect,
    /// Lines of the status.
    pub status: Rect,
    /// Charts.
    pub charts: Option<Rect>,
    /// Table of hops.
    pub hops: Option<Rect>,
    /// Events.
    pub events: Option<Rect>,
    /// The last line: keys, and what is left out.
    pub footer: Option<Rect>,
}

impl ScreenParts {
    /// The parts in `area`.
    #[must_use]
    pub fn of(area: Rect) -> Self {
        let mut rest = Rows(area);
        let title = rest.take(1);
        let footer = (area.height > 3).then(|| rest.take_last(1));
        let status = rest.take(STATUS_LINES.min(rest.0.height));
        let mut parts = Self { title, status, footer, ..Self::default() };
        let is_wide = area.width > HOPS_WIDTH + EVENTS_WIDTH;
        let charts = CHARTS * CHART_LINES;
        // Events say most in few lines; charts are the first to be left out.
        let (least, has_hops) = match rest.0.height {
            height if is_wide && height >= HOPS_LINES => (HOPS_LINES, true),
            height
                if !is_wide && height >= HOPS_LINES + EVENTS_LINES && area.width >= HOPS_WIDTH =>
            {
                (HOPS_LINES + EVENTS_LINES, true)
            }
            height if height >= EVENTS_LINES => (EVENTS_LINES, false),
            _ => (0, false),
        };
        if rest.0.height >= least + charts && area.width >= CHART_WIDTH {
            parts.charts = Some(rest.take(charts));
        }
        if has_hops && is_wide {
            let (left, right) = columns(rest.0);
            (parts.hops, parts.events) = (Some(left), Some(right));
        } else if has_hops {
            parts.hops = Some(rest.take(HOPS_LINES));
            parts.events = Some(rest.0);
        } else if least > 0 {
            parts.events = Some(rest.0);
        }
        parts
    }

    /// Names of the parts that are left out.
    #[must_use]
    pub fn left_out(&self) -> Vec<&'static str> {
        let parts = [
            ("some status", (self.status.height >= STATUS_LINES).then_some(self.status)),
            ("charts", self.charts),
            ("hops", self.hops),
            ("events", self.events),
        ];
        parts.into_iter().filter(|(_, part)| part.is_none()).map(|(name, _)| name).collect()
    }
}

/// Rows that are not taken yet.
struct Rows(Rect);

impl Rows {
    /// Takes rows at the top, as many as there are.
    fn take(&mut self, rows: u16) -> Rect {
        let rows = rows.min(self.0.height);
        let taken = Rect { height: rows, ..self.0 };
        self.0 = Rect { y: self.0.y + rows, height: self.0.height - rows, ..self.0 };
        taken
    }

    /// Takes rows at the bottom, as many as there are.
    fn take_last(&mut self, rows: u16) -> Rect {
        let rows = rows.min(self.0.height);
        self.0.height -= rows;
        Rect { y: self.0.y + self.0.height, height: rows, ..self.0 }
    }
}

/// The column of hops, and the rest of the width.
fn columns(area: Rect) -> (Rect, Rect) {
    let left = Rect { width: HOPS_WIDTH, ..area };
    let x = HOPS_WIDTH + 1;
    (left, Rect { x: area.x + x, width: area.width - x, ..area })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_fits_into_80_by_24() {
        let parts = ScreenParts::of(Rect::new(0, 0, COMPLETE.0, COMPLETE.1));
        assert!(parts.left_out().is_empty(), "{parts:?}");
        assert!(parts.footer.is_some());
    }

    #[test]
    fn parts_lie_inside_the_terminal_and_do_not_overlap() {
        for (width, height) in (1..130).flat_map(|w| (0..45).map(move |h| (w, h))) {
            let area = Rect::new(0, 0, width, height);
            let parts = ScreenParts::of(area);
            let ScreenParts { title, status, charts, hops, events, footer } = parts;
            let optional = [charts, hops, events, footer].into_iter().flatten();
            let all: Vec<Rect> = [title, status].into_iter().chain(optional).collect();
            assert!(all.iter().all(|part| area.union(*part) == area), "{width} x {height}");
            for (number, part) in all.iter().enumerate() {
                let others = all.iter().skip(number + 1).filter(|other| !other.is_empty());
                let overlaps = others.filter(|other| part.intersects(**other)).count();
                assert_eq!((overlaps, part.is_empty() && number > 1), (0, false), "{parts:?}");
            }
        }
    }
}
