//! Picture of the model.

use crate::layout::{CHART_LINES, ScreenParts};
use crate::lines::{self, StatusLine};
use crate::look::{ScreenLook, Weight};
use crate::model::{MonitorModel, ShownAnswer, Trends};
use crate::picture::{Picture, Rect};
use crate::trend::{STEP, Trend};
use crate::wrapping::{folded, wrapped};

/// Width of labels of status lines and charts \[cells\].
const LABEL_WIDTH: u16 = 10;
const CHART_LABEL_WIDTH: u16 = 14;

/// Height of the terminal over the maximum height of the title \[-\].
const TITLE_SHARE: u16 = 6;

/// Chart of a quantity over time: name, curve, minimum of the scale's upper limit, number of digits.
struct Chart<'a>(&'static str, &'a Trend, f64, usize);

/// Draws `model` in a terminal of this many columns and rows.
pub fn draw(model: &MonitorModel, look: ScreenLook, size: (u16, u16)) -> Picture {
    let mut picture = Picture::new(size);
    let area = picture.area();
    let (title, weight) = title(model);
    let title = folded(&title, area.width, (area.height / TITLE_SHARE).max(1));
    let status = status(model, area.width);
    let parts = ScreenParts::of(area, [&title.len(), &status.len()].map(|rows| *rows as u16));
    for (row, line) in parts.title.rows().zip(title) {
        picture.text(row, &line, weight);
    }
    draw_status(&mut picture, &status, parts.status);
    if let Some(area) = parts.charts {
        draw_charts(&mut picture, look, &model.trends, area);
    }
    if let Some(area) = parts.hops {
        draw_table(&mut picture, &lines::hop_table(&model.instance), area);
    }
    if let Some(area) = parts.events {
        draw_events(&mut picture, model, area);
    }
    if let Some(area) = parts.footer {
        picture.text(area, &footer(&parts), Weight::Label);
    }
    picture
}

/// Title: the request being typed, the answer to the last one, or the instance.
fn title(model: &MonitorModel) -> (String, Weight) {
    let age = model.instance.age().seconds();
    let name = &model.name;
    match (&model.keyboard.line, &model.answer) {
        (Some(line), _) => (format!("{name} (Ctrl-S stops): {line}_"), Weight::Plain),
        (None, Some(ShownAnswer { text, .. })) => (format!("{name}, {text}"), Weight::Alarm),
        (None, None) => (format!("oqtal monitor: {name}, observed for {age:.0} s"), Weight::Label),
    }
}

/// Lines of the status in this number of columns \[cells\]: reasons, which may be long, are wrapped, and figures are not.
fn status(model: &MonitorModel, width: u16) -> Vec<StatusLine> {
    let wrap = |StatusLine { label, text, weight }: StatusLine| {
        let rows = match weight {
            Weight::Warning | Weight::Alarm => wrapped(&text, width.saturating_sub(LABEL_WIDTH)),
            _ => vec![text],
        };
        let labels = std::iter::once(label).chain(std::iter::repeat(""));
        labels.zip(rows).map(move |(label, text)| StatusLine { label, text, weight })
    };
    lines::status(&model.instance).into_iter().flat_map(wrap).collect()
}

fn draw_status(picture: &mut Picture, lines: &[StatusLine], area: Rect) {
    for (row, StatusLine { label, text, weight }) in area.rows().zip(lines) {
        picture.text(Rect { width: row.width.min(LABEL_WIDTH), ..row }, label, Weight::Label);
        picture.text(row.right_of(LABEL_WIDTH), text, *weight);
    }
}

fn draw_charts(picture: &mut Picture, look: ScreenLook, trends: &Trends, area: Rect) {
    let Trends { error, thrust, latency } = trends;
    let charts = [
        Chart("distance [m]", error, 0.05, 3),
        Chart("thrust [%]", thrust, 100.0, 1),
        Chart("latency [ms]", latency, 1.0, 1),
    ];
    for (number, chart) in (0..).zip(charts) {
        let y = area.y + number * CHART_LINES;
        draw_chart(picture, look, &chart, Rect { y, height: CHART_LINES, ..area });
    }
}

/// Draws a chart with a scale from zero and the newest step at the right end.
fn draw_chart(picture: &mut Picture, look: ScreenLook, chart: &Chart<'_>, area: Rect) {
    let Chart(name, trend, least, digits) = chart;
    let plot = area.right_of(CHART_LABEL_WIDTH);
    let values: Vec<_> = trend.newest_first(usize::from(plot.width)).collect();
    let most = values.iter().flatten().copied().fold(*least, f64::max);
    let latest = trend.latest().map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"));
    let label = Rect { width: CHART_LABEL_WIDTH.saturating_sub(1), ..area };
    picture.text(Rect { height: 1, ..label }, name, Weight::Label);
    let text = format!("{latest} /{most:.digits$}");
    picture.text(Rect { y: area.y + 1, height: 1, ..label }, &text, Weight::Plain);
    // A chart has a vertical resolution of an eighth of a cell.
    let eighths = f64::from(8 * plot.height);
    for (x, value) in (plot.x..plot.x + plot.width).rev().zip(values) {
        let Some(value) = value else { continue };
        let mut level = (value.max(0.0) / most * eighths).round() as usize;
        for row in (plot.y..plot.y + plot.height).rev() {
            picture.put((x, row), look.bar(level.min(8)), Weight::Plain);
            level = level.saturating_sub(8);
        }
    }
}

/// Draws a heading and rows; the last line is the number of rows that do not fit.
fn draw_table(picture: &mut Picture, lines: &[String], area: Rect) {
    let height = usize::from(area.height);
    for (number, (row, line)) in area.rows().zip(lines).enumerate() {
        let is_cut = number + 1 == height && lines.len() > height;
        let weight = if number == 0 { Weight::Label } else { Weight::Plain };
        match is_cut {
            true => {
                let text = format!("and {} more", lines.len() + 1 - height);
                picture.text(row, &text, Weight::Label);
            }
            false => picture.text(row, line, weight),
        }
    }
}

fn draw_events(picture: &mut Picture, model: &MonitorModel, area: Rect) {
    let count = usize::from(area.height.saturating_sub(1));
    picture.text(area, "      s event", Weight::Label);
    let lines = lines::events(&model.instance, area.width);
    let newest = lines.iter().skip(lines.len().saturating_sub(count));
    for (row, line) in area.rows().skip(1).zip(newest) {
        picture.text(row, line, Weight::Plain);
    }
}

/// The keys, or the names of the parts left out.
fn footer(parts: &ScreenParts) -> String {
    let left_out = parts.left_out();
    if left_out.is_empty() {
        let per_column = STEP.seconds();
        return format!(
            "q quits, r restarts the figures, S stops, : request; charts: {per_column} s a column"
        );
    }
    let (width, height) = parts.complete_size();
    format!("q quits, S stops; not shown: {} (needs {width} x {height})", left_out.join(", "))
}
