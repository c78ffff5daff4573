//! Figures as HTML: a plot with title and legend.

use std::ops::Range;

use maud::{Markup, html};
use serde::Serialize;

use super::axis::Axis;
use super::chart::{Mark, Plot};
use super::palette::Ink;
use super::trace::Trace;

/// Width of a plot over half of the page \[pixels\].
pub const HALF: u32 = 1120;
/// Width of a plot over the whole page \[pixels\].
pub const FULL: u32 = 2320;
const HEIGHT: u32 = 420;
const PATH_HEIGHT: u32 = 900;
const LABEL_WIDTH: u32 = 92;
const LINE_WIDTH: u32 = 3;

/// Data for the script that reads values from the lines of a plot.
#[derive(Serialize)]
struct LinePlot<'a> {
    /// Whether the horizontal axis is time, common to all such plots of the page.
    is_time: bool,
    x: [f64; 2],
    y: [f64; 2],
    /// Left, top, right and bottom border \[pixels\].
    area: [f64; 4],
    names: Vec<&'a str>,
    /// Marked instants \[s\].
    instants: Vec<f64>,
}

/// Figure of `plot`, with a legend if it has more than one entry.
pub fn figure(title: &str, legend: &[(&str, Ink)], plot: &Plot) -> Markup {
    framed(title, legend, (plot.to_svg(), None))
}

/// Figure whose values a script can read, on a time axis if `is_time`.
fn readable(title: &str, legend: &[(&str, Ink)], plot: &Plot, is_time: bool) -> Markup {
    let instant = |shape: &Mark| match shape {
        Mark::Instant(at) => Some(*at),
        _ => None,
    };
    let lines = LinePlot {
        is_time,
        x: [plot.x.range.start, plot.x.range.end],
        y: [plot.y.range.start, plot.y.range.end],
        area: plot.borders(),
        names: legend.iter().map(|(name, _)| *name).collect(),
        instants: plot.shapes.iter().filter_map(instant).collect(),
    };
    let data = serde_json::to_string(&lines).expect("numbers and names are plain JSON");
    framed(title, legend, (plot.to_svg(), Some(data)))
}

/// Drawing with title and, if it has more than one entry, legend; `data` is read by the script of the page.
pub fn framed(
    title: &str,
    legend: &[(&str, Ink)],
    (svg, data): (Markup, Option<String>),
) -> Markup {
    html! {
        figure.plot {
            figcaption {
                span.title { (title) }
                @if legend.len() > 1 {
                    span.legend {
                        @for (name, ink) in legend {
                            span { i style={ "background:" (ink.css()) } {} (name) }
                        }
                    }
                }
            }
            div.scroll role="img" aria-label=(title) data-plot=[data] { (svg) }
        }
    }
}

/// Time axis of several figures.
#[derive(Clone, Debug, Default)]
pub struct TimeSpan {
    /// Beginning and end \[s\].
    pub range: Range<f64>,
    /// Shaded intervals \[s\].
    pub shaded: Vec<Range<f64>>,
    /// Marked instants \[s\].
    pub instants: Vec<f64>,
}

/// A figure of traces over time.
pub fn over_time(title: &str, traces: Vec<Trace>, span: &TimeSpan) -> Markup {
    let values = traces.iter().flat_map(|trace| &trace.points).map(|point| point.1);
    let legend: Vec<_> = traces.iter().map(|trace| (trace.name, trace.ink)).collect();
    let bands = span.shaded.iter().cloned().map(Mark::Band);
    let instants = span.instants.iter().copied().map(Mark::Instant);
    let plot = Plot {
        size: (HALF, HEIGHT),
        label_width: LABEL_WIDTH,
        x: Axis::linear(span.range.clone(), 8.0, " s"),
        y: Axis::fitting(values),
        shapes: bands.chain(instants).chain(lines(traces)).collect(),
    };
    readable(title, &legend, &plot, true)
}

/// A figure of paths in a plane in equal scale, with marked points on top.
pub fn in_plane(title: &str, paths: Vec<Trace>, marks: Vec<Trace>) -> Markup {
    let points = || paths.iter().chain(&marks).flat_map(|trace| &trace.points);
    let x = Axis::fitting(points().map(|point| point.0));
    let y = Axis::fitting(points().map(|point| point.1));
    let shown = paths.iter().chain(&marks).filter(|trace| !trace.points.is_empty());
    let legend: Vec<_> = shown.map(|trace| (trace.name, trace.ink)).collect();
    let discs = marks
        .into_iter()
        .flat_map(|mark| mark.points.into_iter().map(move |at| Mark::Disc(mark.ink, at)));
    let shapes = lines(paths).chain(discs).collect();
    let plot = Plot { size: (HALF, PATH_HEIGHT), label_width: LABEL_WIDTH, x, y, shapes };
    readable(title, &legend, &plot.with_equal_scale(), false)
}

fn lines(traces: Vec<Trace>) -> impl Iterator<Item = Mark> {
    traces.into_iter().map(|trace| Mark::Line(trace.ink, LINE_WIDTH, trace.points))
}

/// Number of `values` in each of `bins` equal parts of `range`; values outside the range are ignored.
pub fn histogram(values: impl Iterator<Item = f64>, range: &Range<f64>, bins: usize) -> Vec<u64> {
    let mut counts = vec![0; bins];
    for value in values {
        let share = (value - range.start) / (range.end - range.start);
        if (0.0..1.0).contains(&share) {
            counts[(share * bins as f64) as usize] += 1;
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_counts_what_is_inside() {
        let values = [-0.1, 0.0, 0.9, 1.0, 3.99, 4.0, f64::NAN];
        assert_eq!(histogram(values.into_iter(), &(0.0..4.0), 4), [2, 1, 0, 1]);
    }
}
