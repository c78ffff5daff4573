//! Figures of the paper, from the same runs as the tables.

pub mod scene;
pub mod square;
pub mod surface;
pub mod turn;

use maud::Markup;

use oqtal_observe::plot::axis::Axis;
use oqtal_observe::plot::chart::{Mark, Plot};
use oqtal_observe::plot::figure::{HALF, figure};
use oqtal_observe::plot::trace::{Trace, thin};

/// A figure of a page.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Number in the paper; 0 for a figure that is not in the paper.
    pub number: u8,
    /// The drawing with its caption.
    pub markup: Markup,
}

/// Height of a plot, twice the displayed height.
const HEIGHT: u32 = 520;
const LABEL_WIDTH: u32 = 110;
const LINE_WIDTH: u32 = 3;

/// Traces over a common horizontal axis with the unit `unit`.
pub fn over(title: &str, unit: &str, traces: Vec<Trace>) -> Markup {
    let points = || traces.iter().flat_map(|trace| &trace.points);
    let x = Axis::fitting(points().map(|point| point.0)).range;
    let y = Axis::fitting(points().map(|point| point.1));
    let legend: Vec<_> = traces.iter().map(|trace| (trace.name, trace.ink)).collect();
    let lines =
        traces.iter().map(|trace| Mark::Line(trace.ink, LINE_WIDTH, thin(trace.points.clone())));
    let plot = Plot {
        size: (HALF, HEIGHT),
        label_width: LABEL_WIDTH,
        x: Axis::linear(x, 8.0, unit),
        y,
        shapes: lines.collect(),
    };
    figure(title, &legend, &plot)
}
