//! One plot as SVG: axes and marks. The only module that uses plotters.
//!
//! The backend rounds to whole pixels; plots are therefore drawn at twice the size at which the page shows them. Lines are written
//! here, to a tenth of a pixel and in steps from point to point: shorter, and exact enough for a script to read values from them.

use std::ops::Range;

use plotters::chart::ChartContext;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::prelude::*;

use super::axis::Axis;
use super::palette::Ink;
use super::trace::{Point, is_drawable_point};

/// Size of text \[pixels\]; the backend divides by 1.24.
const FONT_SIZE: f64 = 24.0 * 1.24;
/// Height of the labels of the horizontal axis \[pixels\].
const LABEL_HEIGHT: u32 = 44;
/// Space above the axes \[pixels\].
const TOP: u32 = 22;
/// Space to the right of the axes, for half a label \[pixels\].
const RIGHT: u32 = 44;
/// Approximate distance of the ticks of axes in equal scale \[pixels\].
const DIVISION: f64 = 120.0;

const NEVER_FAILS: &str = "drawing into a string cannot fail";

type Plane = Cartesian2d<Axis, Axis>;

/// A graphical element between the axes.
#[derive(Clone, Debug)]
pub enum Mark {
    /// A line of a width \[pixels\] through points; a point that cannot be drawn is a gap.
    Line(Ink, u32, Vec<Point>),
    /// A shaded interval of the horizontal axis, behind the grid \[unit of the axis\].
    Band(Range<f64>),
    /// A filled rectangle between two corners.
    Block(Ink, Point, Point),
    /// A disc; omitted if its centre cannot be drawn.
    Disc(Ink, Point),
    /// A vertical line at a place on the horizontal axis \[unit of the axis\].
    Instant(f64),
}

/// A plot.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Width and height, twice as large as shown \[pixels\].
    pub size: (u32, u32),
    /// Width of the labels of the vertical axis \[pixels\].
    pub label_width: u32,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Marks from back to front.
    pub shapes: Vec<Mark>,
}

impl Plot {
    /// Size of the area between the axes.
    fn area(&self) -> (f64, f64) {
        let (width, height) = self.size;
        (f64::from(width - self.label_width - RIGHT), f64::from(height - LABEL_HEIGHT - TOP))
    }

    /// Widens one axis so that both have the same scale.
    pub fn with_equal_scale(mut self) -> Self {
        let (width, height) = self.area();
        let span = |axis: &Axis| axis.range.end - axis.range.start;
        let per_pixel = (span(&self.x) / width).max(span(&self.y) / height);
        let widened = |axis: &Axis, pixels: f64, unit: &str| {
            let middle = 0.5 * (axis.range.start + axis.range.end);
            let half = 0.5 * per_pixel * pixels;
            Axis::linear(middle - half..middle + half, pixels / DIVISION, unit)
        };
        self.x = widened(&self.x, width, " m");
        self.y = widened(&self.y, height, "");
        self
    }

    /// The area between the axes: left, top, right and bottom border \[pixels\].
    pub fn borders(&self) -> [f64; 4] {
        let (width, height) = self.area();
        let (left, top) = (f64::from(self.label_width), f64::from(TOP));
        [left, top, left + width, top + height]
    }

    /// Draws the plot as SVG.
    pub fn to_svg(&self) -> String {
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, self.size).into_drawing_area();
            let mut chart = ChartBuilder::on(&root)
                .margin_top(TOP)
                .margin_right(RIGHT)
                .x_label_area_size(LABEL_HEIGHT)
                .y_label_area_size(self.label_width)
                .build_cartesian_2d(self.x.clone(), self.y.clone())
                .expect(NEVER_FAILS);
            let is_behind = |shape: &&Mark| matches!(shape, Mark::Band(_));
            for shape in self.shapes.iter().filter(is_behind) {
                draw(chart.plotting_area(), shape);
            }
            draw_axes(&mut chart);
            for shape in self.shapes.iter().filter(|shape| !is_behind(shape)) {
                draw(chart.plotting_area(), shape);
            }
            root.present().expect(NEVER_FAILS);
        }
        let lines: String = self.shapes.iter().map(|shape| self.written(shape)).collect();
        svg.replacen("</svg>", &format!("{lines}</svg>"), 1)
    }

    /// The shapes that the backend does not draw, as SVG in tenths of a pixel.
    fn written(&self, shape: &Mark) -> String {
        let [left, top, right, bottom] = self.borders();
        let part = |value: f64, axis: &Axis| {
            (value - axis.range.start) / (axis.range.end - axis.range.start)
        };
        let x = |value| 10.0 * (left + part(value, &self.x) * (right - left));
        let y = |value| 10.0 * (bottom - part(value, &self.y) * (bottom - top));
        match shape {
            Mark::Line(ink, width, points) => {
                let steps = steps(points, |(a, b)| [x(a).round() as i64, y(b).round() as i64]);
                format!(
                    "<path class=\"line\" transform=\"scale(.1)\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}0\" \
                     d=\"{steps}\"/>",
                    ink.hex()
                )
            }
            Mark::Instant(at) if self.x.range.contains(at) => format!(
                "<path class=\"instant\" transform=\"scale(.1)\" stroke=\"{}\" stroke-width=\"20\" d=\"M{:.0} {:.0}V{:.0}\"/>",
                Ink::Warning.hex(),
                x(*at),
                10.0 * top,
                10.0 * bottom
            ),
            Mark::Disc(ink, (a, b)) if is_drawable_point(&(*a, *b)) => format!(
                "<circle cx=\"{:.0}\" cy=\"{:.0}\" r=\"10\" fill=\"{}\"/>",
                0.1 * x(*a),
                0.1 * y(*b),
                ink.hex()
            ),
            _ => String::new(),
        }
    }
}

/// The path through points, in steps from one to the next; a point that cannot be drawn is a gap.
fn steps(points: &[Point], pixel: impl Fn(Point) -> [i64; 2]) -> String {
    let mut text = String::new();
    for run in points.split(|point| !is_drawable_point(point)).filter(|run| run.len() > 1) {
        let mut last = [0; 2];
        for (index, point) in run.iter().enumerate() {
            let [x, y] = pixel(*point);
            let [a, b] = if index == 0 { [x, y] } else { [x - last[0], y - last[1]] };
            text += match index {
                0 => "M",
                1 => "l",
                _ if a >= 0 => " ",
                _ => "",
            };
            // A minus separates numbers, too.
            text += &format!("{a}{}{b}", if b < 0 { "" } else { " " });
            last = [x, y];
        }
    }
    text
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (low, high): (i32, i32)) -> i32 {
        let share = (value - self.range.start) / (self.range.end - self.range.start);
        // A value far outside the plot, or NaN, must not overflow.
        low.saturating_add((share * f64::from(high - low)).round() as i32)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let ticks = if hint.weight().allow_light_points() { &[] } else { self.ticks.as_slice() };
        ticks.iter().map(|tick| tick.at).collect()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, at: &f64) -> String {
        let tick = self.ticks.iter().find(|tick| tick.at == *at);
        tick.map_or_else(String::new, |tick| tick.label.clone())
    }
}

fn draw_axes(chart: &mut ChartContext<'_, SVGBackend<'_>, Plane>) {
    chart
        .configure_mesh()
        .bold_line_style(Ink::Grid.color().stroke_width(2))
        .axis_style(Ink::Axis.color().stroke_width(2))
        .label_style(("sans-serif", FONT_SIZE))
        .draw()
        .expect(NEVER_FAILS);
}

fn draw(plane: &DrawingArea<SVGBackend<'_>, Plane>, shape: &Mark) {
    match shape {
        Mark::Band(stretch) => {
            let y = plane.get_y_range();
            let corners = [(stretch.start, y.start), (stretch.end, y.end)];
            let band = Rectangle::new(corners, Ink::Shade.color().filled());
            plane.draw(&band).expect(NEVER_FAILS);
        }
        Mark::Block(ink, from, to) => {
            plane.draw(&Rectangle::new([*from, *to], ink.color().filled())).expect(NEVER_FAILS);
        }
        Mark::Line(..) | Mark::Disc(..) | Mark::Instant(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_written_in_steps_and_a_gap_begins_another() {
        let points = [(0.0, 0.0), (2.0, -3.0), (1.0, 4.0), (f64::NAN, 0.0), (5.0, 5.0), (6.0, 5.0)];
        let path = steps(&points, |(x, y)| [x as i64, y as i64]);
        assert_eq!(path, "M0 0l2-3-1 7M5 5l1 0");
    }

    #[test]
    fn lines_reach_from_border_to_border() {
        let plot = Plot {
            size: (400, 200),
            label_width: 100,
            x: Axis::linear(0.0..10.0, 5.0, ""),
            y: Axis::linear(0.0..1.0, 5.0, ""),
            shapes: vec![Mark::Line(Ink::Actual, 3, vec![(0.0, 0.0), (10.0, 1.0)])],
        };
        let [left, top, right, bottom] = plot.borders().map(|pixels| (10.0 * pixels) as i64);
        let path = format!("M{left} {bottom}l{} {}", right - left, top - bottom).replace(" -", "-");
        assert!(plot.to_svg().contains(&path), "{path} in {}", plot.to_svg());
    }
}
