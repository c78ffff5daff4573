//! Page of a search: what it traded, and its path.

use maud::{Markup, html};
use oqtal_observe::page::page;
use oqtal_observe::plot::axis::Axis;
use oqtal_observe::plot::chart::{Mark, Plot};
use oqtal_observe::plot::figure::{HALF, figure};
use oqtal_observe::plot::palette::Ink;
use oqtal_observe::plot::trace::Point;

use super::trade;
use super::tuned::{SearchPath, Tuned};

/// Height of a plot \[pixels\].
const HEIGHT: u32 = 420;
/// Width of the labels of a vertical axis \[pixels\].
const LABEL_WIDTH: u32 = 110;
/// Values of the objective above this multiple of its start, or of its end without one, are not drawn \[-\].
const DRAWN: f64 = 2.0;

/// The HTML page of `tuned`.
pub fn html(tuned: &Tuned) -> String {
    let sheet = trade::sheet(&tuned.components, tuned.draws > 0);
    let title = format!("oqtal: gains of {}", tuned.target);
    let body = html! {
        header {
            p.eyebrow { "oqtal tune" }
            h1 { "Gains of " (tuned.target) }
            p.note { (tuned.headline()) "; " (tuned.comparison()) "." }
            @for warning in tuned.warnings() { p.note { "Warning: " (warning) } }
        }
        main {
            @if !sheet.rows.is_empty() {
                section {
                    h2 { (sheet.title) }
                    p.note { (tuned.failures()) }
                    table {
                        thead { tr { th {} @for (_, heading) in &sheet.columns { th { (heading) } } } }
                        tbody {
                            @for row in &sheet.rows {
                                tr { td { (row.controller) } @for cell in &row.cells { td { (cell.show()) } } }
                            }
                        }
                    }
                }
            }
            section { h2 { "Path of the search" } div.grid { (plots(tuned)) } }
        }
    };
    page(&title, "td { font-variant-numeric: tabular-nums; }", &body)
}

fn plots(tuned: &Tuned) -> Markup {
    let SearchPath { objectives, gains } = &tuned.path;
    let worst = if tuned.start.is_finite() { tuned.start } else { tuned.objective };
    let shown = |value: &f64| if *value <= DRAWN * worst { *value } else { f64::NAN };
    let points = |values: &mut dyn Iterator<Item = f64>| -> Vec<Point> {
        values.enumerate().map(|(k, value)| (k as f64 + 1.0, value)).collect()
    };
    let mut best = f64::INFINITY;
    let mut least = objectives.iter().map(|value| {
        best = best.min(*value);
        shown(&best)
    });
    let least = points(&mut least);
    let evaluated = points(&mut objectives.iter().map(shown));
    html! {
        (plot(
            &format!("objective: the best so far, and each point up to {DRAWN} times the start"),
            evaluated,
            Some(least),
        ))
        // Values that were computed, and not searched for, are the last.
        @for (k, (key, _)) in tuned.values.iter().enumerate().take(gains.first().map_or(0, Vec::len)) {
            @let values = points(&mut gains.iter().map(|gains| gains[k]));
            (plot(key, values, None))
        }
    }
}

/// Plot of a value at each evaluated point, with `line` on top.
fn plot(title: &str, evaluated: Vec<Point>, line: Option<Vec<Point>>) -> Markup {
    let points = || evaluated.iter().chain(line.iter().flatten());
    let last = points().map(|point| point.0).fold(1.0, f64::max);
    let y = Axis::fitting(points().map(|point| point.1));
    let discs = evaluated.into_iter().map(|point| Mark::Disc(Ink::Second, point));
    let plot = Plot {
        size: (HALF, HEIGHT),
        label_width: LABEL_WIDTH,
        x: Axis::linear(0.0..last, 8.0, ""),
        y,
        shapes: discs.chain(line.map(|line| Mark::Line(Ink::Actual, 3, line))).collect(),
    };
    figure(title, &[], &plot)
}
