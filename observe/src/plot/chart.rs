//! One plot as SVG: axes, grid and marks.
//!
//! A plot is drawn at twice its displayed size. The points of a line are integers in tenths of a pixel, each relative to the
//! previous point: short, and precise enough for a script to read values from them. Colours are variables of the style sheet.

use std::ops::Range;

use maud::{Markup, html};

use super::axis::Axis;
use super::palette::Ink;
use super::trace::{Point, is_drawable_point};

/// Height of the labels of the horizontal axis \[pixels\].
const LABEL_HEIGHT: u32 = 44;
/// Space above the axes \[pixels\].
const TOP: u32 = 22;
/// Space to the right of the axes, for half a label \[pixels\].
const RIGHT: u32 = 44;
/// Approximate distance of the ticks of axes in equal scale \[pixels\].
const DIVISION: f64 = 120.0;

/// A graphical element between the axes.
#[derive(Clone, Debug)]
pub enum Mark {
    /// Line with a width \[pixels\] through points; a point that cannot be drawn is a gap.
    Line(Ink, u32, Vec<Point>),
    /// A shaded interval of the horizontal axis, behind the grid \[unit of the axis\].
    Band(Range<f64>),
    /// A filled rectangle between two corners.
    Block(Ink, Point, Point),
    /// A disc; omitted if its centre cannot be drawn.
    Disc(Ink, Point),
    /// Vertical line at a position on the horizontal axis \[unit of the axis\].
    Instant(f64),
}

/// A plot.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Width and height, twice the displayed size \[pixels\].
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
    /// Widens one axis so that both have the same scale.
    pub fn with_equal_scale(mut self) -> Self {
        let [left, top, right, bottom] = self.borders();
        let (width, height) = (right - left, bottom - top);
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
        let (width, height) = self.size;
        [self.label_width, TOP, width - RIGHT, height - LABEL_HEIGHT].map(f64::from)
    }

    /// Draws the plot as SVG.
    pub fn to_svg(&self) -> Markup {
        let (width, height) = self.size;
        let is_band = |mark: &&Mark| matches!(mark, Mark::Band(_));
        html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {width} {height}")) font-size="24" {
                @for band in self.shapes.iter().filter(is_band) { (self.mark(band)) }
                (self.axes())
                @for mark in self.shapes.iter().filter(|mark| !is_band(mark)) { (self.mark(mark)) }
            }
        }
    }

    /// Grid and labels at the ticks, and the lines of the axes.
    fn axes(&self) -> Markup {
        let [left, top, right, bottom] = self.borders();
        let lines = |ink: Ink, path: String| {
            html! { path d=(path) stroke-width="2" fill="none" style={ "stroke:" (ink.css()) } {} }
        };
        let x = |at: f64| self.pixel((at, self.y.range.start)).0;
        let y = |at: f64| self.pixel((self.x.range.start, at)).1;
        let grid = self.x.ticks.iter().map(|tick| format!("M{:.1} {bottom}V{top}", x(tick.at)));
        let rows = self.y.ticks.iter().map(|tick| format!("M{left} {:.1}H{right}", y(tick.at)));
        html! {
            (lines(Ink::Grid, grid.chain(rows).collect()))
            (lines(Ink::Axis, format!("M{left} {top}V{bottom}H{right}")))
            @for tick in &self.x.ticks {
                text x=(format!("{:.1}", x(tick.at))) y=(bottom + 32.0) text-anchor="middle" { (tick.label) }
            }
            @for tick in &self.y.ticks {
                text x=(left - 10.0) y=(format!("{:.1}", y(tick.at) + 8.0)) text-anchor="end" { (tick.label) }
            }
        }
    }

    /// Position of a point in the drawing \[pixels\].
    fn pixel(&self, (a, b): Point) -> Point {
        let [left, top, right, bottom] = self.borders();
        let share = |value: f64, Range { start, end }: &Range<f64>| (value - start) / (end - start);
        let (x, y) = (share(a, &self.x.range), share(b, &self.y.range));
        (left + x * (right - left), bottom - y * (bottom - top))
    }

    fn mark(&self, mark: &Mark) -> Markup {
        let [_, top, _, bottom] = self.borders();
        match mark {
            Mark::Line(ink, width, points) => {
                let tenths = |point| {
                    let (x, y) = self.pixel(point);
                    [x, y].map(|pixels| (10.0 * pixels).round() as i64)
                };
                html! {
                    path.line transform="scale(.1)" fill="none" style={ "stroke:" (ink.css()) }
                        stroke-width=(10 * width) d=(steps(points, tenths)) {}
                }
            }
            Mark::Band(Range { start, end }) => {
                let ends = [(*start, self.y.range.start), (*end, self.y.range.end)];
                self.block(Ink::Shade, ends)
            }
            Mark::Block(ink, from, to) => self.block(*ink, [*from, *to]),
            Mark::Disc(ink, centre) if is_drawable_point(centre) => {
                let (x, y) = self.pixel(*centre);
                html! { circle cx=(x.round()) cy=(y.round()) r="10" style={ "fill:" (ink.css()) } {} }
            }
            Mark::Instant(at) if self.x.range.contains(at) => {
                let x = self.pixel((*at, self.y.range.start)).0;
                let path = format!("M{x:.1} {top}V{bottom}");
                html! { path.instant d=(path) stroke-width="2" style={ "stroke:" (Ink::Warning.css()) } {} }
            }
            Mark::Disc(..) | Mark::Instant(_) => html! {},
        }
    }

    /// A filled rectangle between two corners.
    fn block(&self, ink: Ink, corners: [Point; 2]) -> Markup {
        let [(a, b), (c, d)] = corners.map(|corner| self.pixel(corner));
        let path = format!("M{a:.1} {b:.1}H{c:.1}V{d:.1}H{a:.1}Z");
        html! { path d=(path) style={ "fill:" (ink.css()) } {} }
    }
}

/// Path through points, in steps from point to point; a point that cannot be drawn is a gap.
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
            // A minus sign also separates numbers.
            text += &format!("{a}{}{b}", if b < 0 { "" } else { " " });
            last = [x, y];
        }
    }
    text
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
        let svg = plot.to_svg().into_string();
        assert!(svg.contains(&path), "{path} in {svg}");
        assert_eq!(svg.matches("<text").count(), plot.x.ticks.len() + plot.y.ticks.len());
    }
}
