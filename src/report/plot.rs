//! One plot as SVG: axes, then shapes. The only place that knows plotters.
//!
//! The backend rounds to whole pixels, so plots are drawn at twice the size at which the page shows them.

use std::ops::Range;

use plotters::chart::ChartContext;
use plotters::coord::combinators::{BindKeyPoints, WithKeyPoints};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::axis::{Axis, Tick};
use super::palette::Ink;
use super::series::{Point, is_drawable};

/// Size of text; the backend divides by 1.24.
const FONT_SIZE: f64 = 24.0 * 1.24;
/// Height of the labels of the horizontal axis.
const LABEL_HEIGHT: u32 = 52;
/// Free space at the other edges.
const MARGIN: u32 = 22;

const NEVER_FAILS: &str = "drawing into a string cannot fail";

type Coordinates = Cartesian2d<WithKeyPoints<RangedCoordf64>, WithKeyPoints<RangedCoordf64>>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Coordinates>;

/// Something drawn between the axes.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A line of that width through points; a point that cannot be drawn is a gap.
    Line(Ink, u32, Vec<Point>),
    /// A shaded stretch of the horizontal axis, behind the grid.
    Band(Range<f64>),
    /// A filled rectangle between two corners.
    Block(Ink, Point, Point),
    /// A disc.
    Disc(Ink, Point),
}

/// A plot.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Width and height, twice as large as shown.
    pub size: (u32, u32),
    /// Width of the labels of the vertical axis.
    pub label_width: u32,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// From the back to the front.
    pub shapes: Vec<Shape>,
}

impl Plot {
    /// Size of the area between the axes.
    pub fn area(&self) -> (f64, f64) {
        let (width, height) = self.size;
        (f64::from(width - self.label_width - 2 * MARGIN), f64::from(height - LABEL_HEIGHT - 2 * MARGIN))
    }

    /// Widens one axis until a length is equally long on both, `ticks` apart.
    pub fn with_equal_scale(mut self) -> Self {
        let (width, height) = self.area();
        let span = |axis: &Axis| axis.range.end - axis.range.start;
        let per_pixel = (span(&self.x) / width).max(span(&self.y) / height);
        let widened = |axis: &Axis, pixels: f64, unit: &str| {
            let middle = 0.5 * (axis.range.start + axis.range.end);
            let half = 0.5 * per_pixel * pixels;
            Axis::linear(middle - half..middle + half, (pixels / 120.0) as usize, unit)
        };
        self.x = widened(&self.x, width, " m");
        self.y = widened(&self.y, height, "");
        self
    }

    /// The drawing.
    pub fn to_svg(&self) -> String {
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, self.size).into_drawing_area();
            let mut chart = ChartBuilder::on(&root)
                .margin(MARGIN)
                .x_label_area_size(LABEL_HEIGHT)
                .y_label_area_size(self.label_width)
                .build_cartesian_2d(coordinate(&self.x), coordinate(&self.y))
                .expect(NEVER_FAILS);
            for shape in &self.shapes {
                if let Shape::Band(range) = shape {
                    let corners = [(range.start, self.y.range.start), (range.end, self.y.range.end)];
                    let band = Rectangle::new(corners, Ink::Shade.color().filled());
                    chart.plotting_area().draw(&band).expect(NEVER_FAILS);
                }
            }
            self.draw_axes(&mut chart);
            for shape in &self.shapes {
                draw(chart.plotting_area(), shape);
            }
            root.present().expect(NEVER_FAILS);
        }
        svg
    }

    fn draw_axes(&self, chart: &mut Chart<'_, '_>) {
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(Ink::Grid.color().stroke_width(2))
            .axis_style(Ink::Axis.color().stroke_width(2))
            .label_style(("sans-serif", FONT_SIZE))
            .x_label_formatter(&|at| label(&self.x.ticks, *at))
            .y_label_formatter(&|at| label(&self.y.ticks, *at))
            .draw()
            .expect(NEVER_FAILS);
    }
}

fn coordinate(axis: &Axis) -> WithKeyPoints<RangedCoordf64> {
    axis.range.clone().with_key_points(axis.ticks.iter().map(|tick| tick.at).collect())
}

fn label(ticks: &[Tick], at: f64) -> String {
    ticks.iter().find(|tick| tick.at == at).map_or_else(String::new, |tick| tick.label.clone())
}

fn draw(plane: &DrawingArea<SVGBackend<'_>, Coordinates>, shape: &Shape) {
    match shape {
        Shape::Band(_) => {}
        Shape::Line(ink, width, points) => {
            let style = ink.color().stroke_width(*width);
            for run in points.split(|(x, y)| !(is_drawable(*x) && is_drawable(*y))) {
                if run.len() > 1 {
                    plane.draw(&PathElement::new(run, style)).expect(NEVER_FAILS);
                }
            }
        }
        Shape::Block(ink, from, to) => {
            plane.draw(&Rectangle::new([*from, *to], ink.color().filled())).expect(NEVER_FAILS);
        }
        Shape::Disc(ink, center) => {
            plane.draw(&Circle::new(*center, 11, ink.color().filled())).expect(NEVER_FAILS);
        }
    }
}
