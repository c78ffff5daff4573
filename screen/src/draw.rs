//! The picture of the model, in the cells of a buffer.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::widgets::{RenderDirection, Sparkline, Widget};

use crate::layout::{CHART_LINES, COMPLETE, ScreenParts};
use crate::lines::{self, StatusLine};
use crate::look::{ScreenLook, Weight};
use crate::model::{MonitorModel, Trends};
use crate::trend::{STEP, Trend};

/// Width of labels of the status, and of charts \[cells\].
const LABEL_WIDTH: u16 = 10;
const CHART_LABEL_WIDTH: u16 = 14;
/// Levels into which the height of a chart is divided \[-\].
const LEVELS: f64 = 1000.0;

/// A quantity over time: name, curve, least end of the scale, digits.
struct Chart<'a>(&'static str, &'a Trend, f64, usize);

/// Draws `model` into the whole of `buffer`.
pub fn draw(model: &MonitorModel, look: ScreenLook, buffer: &mut Buffer) {
    let parts = ScreenParts::of(buffer.area);
    let mut canvas = Canvas { look, buffer };
    canvas.title(model, parts.title);
    canvas.status(model, parts.status);
    if let Some(area) = parts.charts {
        canvas.charts(&model.trends, area);
    }
    if let Some(area) = parts.hops {
        canvas.table(&lines::hop_table(model), area);
    }
    if let Some(area) = parts.events {
        canvas.events(model, area);
    }
    if let Some(area) = parts.footer {
        canvas.footer(&parts, area);
    }
}

struct Canvas<'a> {
    look: ScreenLook,
    buffer: &'a mut Buffer,
}

impl Canvas<'_> {
    /// Writes a line of text; one that is too long ends in dots.
    fn text(&mut self, area: Rect, text: &str, weight: Weight) {
        if area.is_empty() {
            return;
        }
        let width = usize::from(area.width);
        let style = self.look.style(weight);
        if text.chars().count() <= width {
            self.buffer.set_stringn(area.x, area.y, text, width, style);
            return;
        }
        let kept: String = text.chars().take(width.saturating_sub(2)).collect();
        self.buffer.set_stringn(area.x, area.y, format!("{kept}.."), width, style);
    }

    fn title(&mut self, model: &MonitorModel, area: Rect) {
        let age = model.journal.age(model.now).seconds();
        let text = format!("oqtal monitor: {}, observed for {age:.0} s", model.instance);
        self.text(area, &text, Weight::Label);
    }

    fn status(&mut self, model: &MonitorModel, area: Rect) {
        for (row, StatusLine { label, text, weight }) in rows(area).zip(lines::status(model)) {
            self.text(Rect { width: row.width.min(LABEL_WIDTH), ..row }, label, Weight::Label);
            self.text(right_of(row, LABEL_WIDTH), &text, weight);
        }
    }

    fn charts(&mut self, trends: &Trends, area: Rect) {
        let Trends { error, thrust, latency } = trends;
        let charts = [
            Chart("error [m]", error, 0.05, 3),
            Chart("thrust [%]", thrust, 100.0, 1),
            Chart("latency [ms]", latency, 1.0, 1),
        ];
        for (number, chart) in (0..).zip(charts) {
            let y = area.y + number * CHART_LINES;
            self.chart(&chart, Rect { y, height: CHART_LINES, ..area });
        }
    }

    /// Draws a chart whose scale begins at zero, the newest step at the right end.
    fn chart(&mut self, chart: &Chart<'_>, area: Rect) {
        let Chart(name, trend, least, digits) = chart;
        let plot = right_of(area, CHART_LABEL_WIDTH);
        let values: Vec<_> = trend.newest_first(usize::from(plot.width)).collect();
        let most = values.iter().flatten().copied().fold(*least, f64::max);
        let latest =
            trend.latest().map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"));
        let label = Rect { width: CHART_LABEL_WIDTH.saturating_sub(1), ..area };
        self.text(Rect { height: 1, ..label }, name, Weight::Label);
        let text = format!("{latest} /{most:.digits$}");
        self.text(Rect { y: area.y + 1, height: 1, ..label }, &text, Weight::Plain);
        let levels = values
            .iter()
            .map(|value| value.map(|value| (value.max(0.0) / most * LEVELS).round() as u64));
        Sparkline::default()
            .data(levels)
            .max(LEVELS as u64)
            .direction(RenderDirection::RightToLeft)
            .bar_set(self.look.bars())
            .absent_value_symbol(" ")
            .render(plot, self.buffer);
    }

    /// Draws a head and rows, and says how many rows have no room.
    fn table(&mut self, lines: &[String], area: Rect) {
        let height = usize::from(area.height);
        for (number, (row, line)) in rows(area).zip(lines).enumerate() {
            let is_cut = number + 1 == height && lines.len() > height;
            let weight = if number == 0 { Weight::Label } else { Weight::Plain };
            match is_cut {
                true => {
                    let text = format!("and {} more", lines.len() + 1 - height);
                    self.text(row, &text, Weight::Label);
                }
                false => self.text(row, line, weight),
            }
        }
    }

    fn events(&mut self, model: &MonitorModel, area: Rect) {
        let count = usize::from(area.height.saturating_sub(1));
        self.text(area, "      s event", Weight::Label);
        for (row, line) in rows(area).skip(1).zip(lines::events(model, count)) {
            self.text(row, &line, Weight::Plain);
        }
    }

    fn footer(&mut self, parts: &ScreenParts, area: Rect) {
        let left_out = parts.left_out();
        let text = if left_out.is_empty() {
            let per_column = STEP.seconds();
            format!("q quits, r restarts the figures; charts: {per_column} s a column")
        } else {
            let (width, height) = COMPLETE;
            format!("q quits; not shown: {} ({width} x {height} shows all)", left_out.join(", "))
        };
        self.text(area, &text, Weight::Label);
    }
}

/// The rows of an area.
fn rows(area: Rect) -> impl Iterator<Item = Rect> {
    (0..area.height).map(move |row| Rect { y: area.y + row, height: 1, ..area })
}

/// What is right of the first `width` cells of an area.
fn right_of(area: Rect, width: u16) -> Rect {
    let width = width.min(area.width);
    Rect { x: area.x + width, width: area.width - width, ..area }
}
