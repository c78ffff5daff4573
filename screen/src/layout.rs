//! Layout of the parts in a terminal of a given size. Parts that do not fit are left out, least important first, and named.

use crate::picture::Rect;

/// Least size at which everything is shown, if no text is wrapped: columns and rows \[cells\].
const COMPLETE: (u16, u16) = (80, 24);
/// Number of title and status lines without wrapped ones \[cells\].
const HEAD_LINES: u16 = 10;
/// Height of a chart, and number of charts \[cells\].
pub const CHART_LINES: u16 = 2;
const CHARTS: u16 = 3;
/// Least width of a chart with its label \[cells\].
const CHART_WIDTH: u16 = 40;
/// Width of the table of hops \[cells\].
const HOPS_WIDTH: u16 = 44;
const HOPS_LINES: u16 = 7;
/// Least height of the events: title and two of them \[cells\].
const EVENTS_LINES: u16 = 3;
/// Least width of the events \[cells\].
const EVENTS_WIDTH: u16 = 30;

/// Rectangles of the parts; `None` for parts that do not fit.
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
    /// The last line: keys, and names of the parts left out.
    pub footer: Option<Rect>,
    /// Number of title and status lines \[cells\].
    head_lines: u16,
}

impl ScreenParts {
    /// The parts in `area`, with these numbers of title and status lines \[cells\].
    pub fn of(area: Rect, [title_lines, status_lines]: [u16; 2]) -> Self {
        let mut rest = Rows(area);
        let title = rest.take(title_lines);
        let footer = (area.height > 3).then(|| rest.take_last(1));
        let status = rest.take(status_lines);
        let head_lines = title_lines + status_lines;
        let mut parts = Self { title, status, footer, head_lines, ..Self::default() };
        let is_wide = area.width > HOPS_WIDTH + EVENTS_WIDTH;
        let charts = CHARTS * CHART_LINES;
        // With few lines, events are the most important; charts are left out first.
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
            parts.hops = Some(Rect { width: HOPS_WIDTH, ..rest.0 });
            parts.events = Some(rest.0.right_of(HOPS_WIDTH + 1));
        } else if has_hops {
            parts.hops = Some(rest.take(HOPS_LINES));
            parts.events = Some(rest.0);
        } else if least > 0 {
            parts.events = Some(rest.0);
        }
        parts
    }

    /// Names of the parts that are left out.
    pub fn left_out(&self) -> Vec<&'static str> {
        let parts = [
            (
                "some status",
                (self.title.height + self.status.height >= self.head_lines).then_some(self.status),
            ),
            ("charts", self.charts),
            ("hops", self.hops),
            ("events", self.events),
        ];
        parts.into_iter().filter(|(_, part)| part.is_none()).map(|(name, _)| name).collect()
    }

    /// Least size at which everything is shown: columns and rows \[cells\].
    pub fn complete_size(&self) -> (u16, u16) {
        let (width, height) = COMPLETE;
        (width, height + self.head_lines.saturating_sub(HEAD_LINES))
    }
}

/// Rows not yet assigned to a part.
struct Rows(Rect);

impl Rows {
    /// Removes and returns at most `rows` rows at the top.
    fn take(&mut self, rows: u16) -> Rect {
        let rows = rows.min(self.0.height);
        let taken = Rect { height: rows, ..self.0 };
        self.0 = Rect { y: self.0.y + rows, height: self.0.height - rows, ..self.0 };
        taken
    }

    /// Removes and returns at most `rows` rows at the bottom.
    fn take_last(&mut self, rows: u16) -> Rect {
        let rows = rows.min(self.0.height);
        self.0.height -= rows;
        Rect { y: self.0.y + self.0.height, height: rows, ..self.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Title and status lines, of which none is wrapped.
    const LINES: [u16; 2] = [1, HEAD_LINES - 1];

    #[test]
    fn everything_fits_into_80_by_24() {
        let parts = ScreenParts::of(
            Rect { width: COMPLETE.0, height: COMPLETE.1, ..Rect::default() },
            LINES,
        );
        assert!(parts.left_out().is_empty(), "{parts:?}");
        assert!(parts.footer.is_some());
    }

    #[test]
    fn parts_lie_inside_the_terminal_and_do_not_overlap() {
        let sizes = (1..130).flat_map(|w| (0..45).map(move |h| (w, h)));
        for ((width, height), lines) in sizes.flat_map(|size| [(size, LINES), (size, [3, 14])]) {
            let area = Rect { width, height, ..Rect::default() };
            let parts = ScreenParts::of(area, lines);
            let ScreenParts { title, status, charts, hops, events, footer, .. } = parts;
            let optional = [charts, hops, events, footer].into_iter().flatten();
            let all: Vec<Rect> = [title, status].into_iter().chain(optional).collect();
            let ends = |part: &Rect| (part.x + part.width, part.y + part.height);
            let is_inside = |part: &Rect| ends(part).0 <= width && ends(part).1 <= height;
            assert!(all.iter().all(is_inside), "{width} x {height}");
            for (number, part) in all.iter().enumerate() {
                let others = all.iter().skip(number + 1).filter(|other| !other.is_empty());
                let overlaps = others
                    .filter(|other| part.x < ends(other).0 && other.x < ends(part).0)
                    .filter(|other| part.y < ends(other).1 && other.y < ends(part).1)
                    .count();
                assert_eq!((overlaps, part.is_empty() && number > 1), (0, false), "{parts:?}");
            }
        }
    }
}
