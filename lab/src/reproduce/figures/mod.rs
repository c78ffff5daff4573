//! Figures of the paper, from the same runs as the tables.

pub mod scene;
pub mod square;
pub mod surface;
pub mod turn;

use maud::Markup;

use oqtal_observe::plot::axis::Axis;
use oqtal_observe::plot::chart::{Mark, Plot};
use oqtal_observe::plot::figure::{HALF, figure};
use oqtal_observe::plot::palette::Ink;
use oqtal_observe::plot::trace::{Point, Trace, thin};

/// Height of a plot, twice the displayed height.
const HEIGHT: u32 = 520;
const LABEL_WIDTH: u32 = 110;
const LINE_WIDTH: u32 = 3;

/// Traces over a common horizontal axis with the unit `unit`.
pub fn over(title: &str, unit: &str, traces: Vec<Trace>) -> Markup {
    let lines = traces.into_iter().map(|trace| (trace.name, trace.ink, trace.points));
    lines_over(title, unit, lines.collect())
}

/// Lines with their names and colours over a common horizontal axis with the unit `unit`.
pub fn lines_over(title: &str, unit: &str, lines: Vec<(&str, Ink, Vec<Point>)>) -> Markup {
    let points = || lines.iter().flat_map(|(_, _, points)| points);
    let x = Axis::fitting(points().map(|point| point.0)).range;
    let y = Axis::fitting(points().map(|point| point.1));
    let legend: Vec<_> = lines.iter().map(|(name, ink, _)| (*name, *ink)).collect();
    let marks = lines.into_iter().map(|(_, ink, points)| Mark::Line(ink, LINE_WIDTH, thin(points)));
    let plot = Plot {
        size: (HALF, HEIGHT),
        label_width: LABEL_WIDTH,
        x: Axis::linear(x, 8.0, unit),
        y,
        shapes: marks.collect(),
    };
    figure(title, &legend, &plot)
}
