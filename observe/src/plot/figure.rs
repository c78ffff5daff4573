//! Figures as HTML: a plot with title and legend.

use std::ops::Range;

use maud::{Markup, PreEscaped, html};

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

/// A figure of `plot`, with a legend if it has more than one entry.
pub fn figure(title: &str, legend: &[(&str, Ink)], plot: &Plot) -> Markup {
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
            div.scroll role="img" aria-label=(title) { (PreEscaped(plot.to_svg())) }
        }
    }
}

/// A figure of traces over the time `span` \[s\], with the interval `shaded` \[s\] in the background.
pub fn over_time(
    title: &str,
    traces: Vec<Trace>,
    span: Range<f64>,
    shaded: Option<Range<f64>>,
) -> Markup {
    let values = traces.iter().flat_map(|trace| &trace.points).map(|point| point.1);
    let legend: Vec<_> = traces.iter().map(|trace| (trace.name, trace.ink)).collect();
    let band = shaded.map(Mark::Band);
    let plot = Plot {
        size: (HALF, HEIGHT),
        label_width: LABEL_WIDTH,
        x: Axis::linear(span, 8.0, " s"),
        y: Axis::fitting(values),
        shapes: band.into_iter().chain(lines(traces)).collect(),
    };
    figure(title, &legend, &plot)
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
    figure(title, &legend, &plot.with_equal_scale())
}

fn lines(traces: Vec<Trace>) -> impl Iterator<Item = Mark> {
    traces.into_iter().map(|trace| Mark::Line(trace.ink, LINE_WIDTH, trace.points))
}

/// Number of `values` in each of `bins` equal parts of `range`; values outside are ignored.
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
