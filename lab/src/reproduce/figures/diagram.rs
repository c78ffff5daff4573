//! Block diagrams: boxes joined by arrows, on a grid of columns and rows.

use std::fmt::Write;

use maud::{Markup, PreEscaped, html};

use oqtal_observe::plot::palette::Ink;

use super::Figure;

/// Distance of two columns and of two rows \[pixels\].
const PITCH: (f64, f64) = (190.0, 84.0);
/// Half the size of a box \[pixels\].
const HALF_BOX: (f64, f64) = (76.0, 24.0);
/// Radius of a summing junction \[pixels\].
const RADIUS: f64 = 11.0;
/// Length and half width of the head of an arrow \[pixels\].
const HEAD: (f64, f64) = (9.0, 4.0);
/// Distance of two lines of a text \[pixels\].
const LINE: f64 = 15.0;

/// A part of a diagram, by its column and row \[-\].
#[derive(Clone, Copy, Debug)]
pub(super) enum DiagramPart {
    /// A box at a column and row \[-\] with two lines of text.
    Block((f64, f64), [&'static str; 2]),
    /// A summing junction at a column and row \[-\].
    Sum((f64, f64)),
}

/// An end or a bend of a wire: a side of a part, by its index, or a place by its column and row.
#[derive(Clone, Copy, Debug)]
pub(super) enum DiagramPlace {
    Left(usize),
    Right(usize),
    Top(usize),
    Bottom(usize),
    /// A column and row \[-\].
    At(f64, f64),
}

/// A signal: its name, and the places that it passes; an arrow points to the last.
pub(super) type DiagramWire = (&'static str, &'static [DiagramPlace]);

/// A block diagram.
#[derive(Clone, Copy, Debug)]
pub(super) struct Diagram {
    /// Number of the figure in the paper.
    pub(super) number: u8,
    /// Title.
    pub(super) title: &'static str,
    /// Parts, in the order of their indices.
    pub(super) parts: &'static [DiagramPart],
    /// Signals.
    pub(super) wires: &'static [DiagramWire],
    /// Columns and rows of the drawing \[-\].
    pub(super) size: (f64, f64),
}

impl DiagramPart {
    fn centre(&self) -> (f64, f64) {
        let (Self::Block((column, row), _) | Self::Sum((column, row))) = self;
        (column * PITCH.0, row * PITCH.1)
    }

    /// Half of the width and of the height \[pixels\].
    fn half(&self) -> (f64, f64) {
        match self {
            Self::Block(..) => HALF_BOX,
            Self::Sum(_) => (RADIUS, RADIUS),
        }
    }

    fn svg(&self) -> String {
        let ((x, y), (w, h)) = (self.centre(), self.half());
        let style = format!("fill:{};stroke:{}", Ink::Shade.css(), Ink::Actual.css());
        match self {
            Self::Sum(_) => format!(
                "<circle style=\"{style}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{RADIUS}\"/>{}",
                text((x, y + 4.5), "middle", "+")
            ),
            Self::Block(_, lines) => {
                let first = text((x, y - 3.0), "middle", lines[0]);
                let second = text((x, y - 3.0 + LINE), "middle", lines[1]);
                format!(
                    "<rect style=\"{style}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" rx=\"5\"/>{first}{second}",
                    x - w,
                    y - h,
                    2.0 * w,
                    2.0 * h
                )
            }
        }
    }
}

impl Diagram {
    /// The figure.
    pub(super) fn figure(&self) -> Figure {
        let mut body = String::new();
        for (name, places) in self.wires {
            body += &self.wire(name, places);
        }
        for part in self.parts {
            body += &part.svg();
        }
        let (width, height) = (self.size.0 * PITCH.0, self.size.1 * PITCH.1);
        let title = format!("Fig. {}: {}", self.number, self.title);
        let markup: Markup = html! {
            figure.plot style="grid-column:1/-1" {
                figcaption { span.title { (title) } }
                div.scroll role="img" aria-label=(title) {
                    svg viewBox={ "0 0 " (width) " " (height) } style={ "max-width:" (width) "px" } { (PreEscaped(body)) }
                }
            }
        };
        Figure { number: self.number, markup }
    }

    fn point(&self, place: &DiagramPlace) -> (f64, f64) {
        let (index, (right, down)) = match place {
            DiagramPlace::At(column, row) => return (column * PITCH.0, row * PITCH.1),
            DiagramPlace::Left(index) => (index, (-1.0, 0.0)),
            DiagramPlace::Right(index) => (index, (1.0, 0.0)),
            DiagramPlace::Top(index) => (index, (0.0, -1.0)),
            DiagramPlace::Bottom(index) => (index, (0.0, 1.0)),
        };
        let part = &self.parts[*index];
        let ((x, y), (w, h)) = (part.centre(), part.half());
        (x + right * w, y + down * h)
    }

    /// A wire with its arrow, and its name beside the first stretch.
    fn wire(&self, name: &str, places: &[DiagramPlace]) -> String {
        let points: Vec<(f64, f64)> = places.iter().map(|place| self.point(place)).collect();
        let [.., before, end] = points.as_slice() else { return String::new() };
        let color = Ink::Reference.css();
        let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let mut svg = format!(
            "<polyline style=\"stroke:{color};fill:none\" stroke-width=\"1.4\" points=\"{}\"/>",
            path.join(" ")
        );
        let head = head(*before, *end).map(|(x, y)| format!("{x:.1},{y:.1}")).join(" ");
        let _ = write!(svg, "<polygon style=\"fill:{color}\" points=\"{head}\"/>");
        let ((x, y), (to_x, to_y)) = (points[0], points[1]);
        let middle = ((x + to_x) / 2.0, (y + to_y) / 2.0);
        let is_level = (to_y - y).abs() < 1.0;
        svg + &match is_level {
            true => text((middle.0, middle.1 - 5.0), "middle", name),
            false => text((middle.0 + 5.0, middle.1 + 4.0), "start", name),
        }
    }
}

/// The corners of the head of an arrow that comes from `from` and ends at `end`.
fn head(from: (f64, f64), end: (f64, f64)) -> [(f64, f64); 3] {
    let (dx, dy) = (end.0 - from.0, end.1 - from.1);
    let length = dx.hypot(dy).max(1e-9);
    let (ux, uy) = (dx / length, dy / length);
    let foot = (end.0 - ux * HEAD.0, end.1 - uy * HEAD.0);
    let side = |sign: f64| (foot.0 - sign * uy * HEAD.1, foot.1 + sign * ux * HEAD.1);
    [end, side(1.0), side(-1.0)]
}

fn text((x, y): (f64, f64), anchor: &str, words: &str) -> String {
    let words = html! { (words) }.into_string();
    format!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"12\" text-anchor=\"{anchor}\">{words}</text>"
    )
}
