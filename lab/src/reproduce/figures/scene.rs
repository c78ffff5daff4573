//! Three-dimensional drawings: lines and surfaces in a box, seen from above a corner.

use std::fmt::Write;
use std::ops::Range;

use maud::{Markup, PreEscaped, html};

use oqtal_observe::plot::axis::extent;
use oqtal_observe::plot::figure::framed;
use oqtal_observe::plot::palette::Ink;

/// A point in space.
pub type Point3 = [f64; 3];

/// Size of the drawing \[pixels\].
const SIZE: (f64, f64) = (560.0, 380.0);
/// Centre of the box in the drawing \[pixels\].
const MIDDLE: (f64, f64) = (280.0, 190.0);
/// Length of the edges along x, y and z in the drawing.
const EDGES: Point3 = [245.0, 245.0, 200.0];
/// Direction of view: cosine and sine of the angle about the vertical, and of the angle above the horizontal.
const TURN: (f64, f64) = (0.819, 0.574);
const RISE: (f64, f64) = (0.87, 0.49);

/// An axis of the box.
#[derive(Clone, Debug)]
pub struct Edge {
    /// Name of the axis.
    pub name: &'static str,
    /// Range of the axis \[unit of the axis\].
    pub range: Range<f64>,
    /// Label of a value.
    pub label: fn(f64) -> String,
}

/// A box with lines and surfaces.
#[derive(Clone, Debug)]
pub struct Scene {
    edges: [Edge; 3],
    body: String,
    /// Labels in front of all other marks.
    labels: String,
    legend: Vec<(&'static str, Ink)>,
}

impl Scene {
    /// An empty box.
    pub fn new(edges: [Edge; 3]) -> Self {
        let mut scene =
            Self { edges, body: String::new(), labels: String::new(), legend: Vec::new() };
        scene.draw_box();
        scene
    }

    /// Draws a line through `points`.
    pub fn line(&mut self, name: &'static str, ink: Ink, points: &[Point3]) {
        self.legend.push((name, ink));
        let path: Vec<String> = points.iter().map(|point| self.written(point)).collect();
        let _ = write!(
            self.body,
            "<polyline fill=\"none\" style=\"stroke:{}\" stroke-width=\"1.6\" points=\"{}\"/>",
            ink.css(),
            path.join(" ")
        );
    }

    /// Draws surfaces over one square grid, distant patches first. `value(surface, column, row)` is a point, or `None` for a hole
    /// in the surface.
    pub fn surfaces(
        &mut self,
        names: &[(&'static str, Ink)],
        side: usize,
        value: impl Fn(usize, usize, usize) -> Option<Point3>,
    ) {
        self.legend.extend_from_slice(names);
        let mut patches = Vec::new();
        for (surface, (_, ink)) in names.iter().enumerate() {
            for index in 0..(side - 1) * (side - 1) {
                let (column, row) = (index / (side - 1), index % (side - 1));
                let corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
                    .map(|(i, j)| value(surface, column + i, row + j));
                if let [Some(a), Some(b), Some(c), Some(d)] = corners {
                    let corners = [a, b, c, d];
                    patches.push((self.distance(&corners), *ink, corners));
                }
            }
        }
        patches.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, ink, corners) in patches {
            let path = corners.map(|corner| self.written(&corner)).join(" ");
            let color = ink.css();
            let _ = write!(
                self.body,
                "<polygon style=\"fill:{color};fill-opacity:.3;stroke:{color}\" stroke-width=\".6\" points=\"{path}\"/>"
            );
        }
    }

    /// Figure of the drawing, with title and legend.
    pub fn figure(&self, title: &str) -> Markup {
        let (width, height) = SIZE;
        let drawing = html! {
            svg viewBox={ "0 0 " (width) " " (height) } { (PreEscaped(&self.body)) (PreEscaped(&self.labels)) }
        };
        framed(title, &self.legend, (drawing, None))
    }

    /// Coordinates of a point in the box, from -1/2 to 1/2.
    fn placed(&self, point: &Point3) -> Point3 {
        std::array::from_fn(|i| {
            let Range { start, end } = self.edges[i].range;
            (point[i] - start) / (end - start) - 0.5
        })
    }

    /// Coordinates of a point of the box in the drawing \[pixels\].
    fn projected(place: Point3) -> (f64, f64) {
        let [x, y, z] = std::array::from_fn(|i| place[i] * EDGES[i]);
        let (right, away) = (x * TURN.0 - y * TURN.1, x * TURN.1 + y * TURN.0);
        (MIDDLE.0 + right, MIDDLE.1 - z * RISE.0 - away * RISE.1)
    }

    /// Distance of the centre of a patch \[-\], used only for sorting.
    fn distance(&self, corners: &[Point3; 4]) -> f64 {
        let middle = corners.iter().fold([0.0; 3], |sum, corner| {
            let place = self.placed(corner);
            std::array::from_fn(|i| sum[i] + place[i] * EDGES[i])
        });
        (middle[0] * TURN.1 + middle[1] * TURN.0) * RISE.0 - middle[2] * RISE.1
    }

    fn written(&self, point: &Point3) -> String {
        let (x, y) = Self::projected(self.placed(point));
        format!("{x:.1},{y:.1}")
    }

    /// Draws two edges of the floor and one vertical edge, each with its name and the values at its ends.
    fn draw_box(&mut self) {
        const FLOOR: [Point3; 5] = [
            [-0.5, -0.5, -0.5],
            [0.5, -0.5, -0.5],
            [0.5, 0.5, -0.5],
            [-0.5, 0.5, -0.5],
            [-0.5, -0.5, -0.5],
        ];
        let edge = |from: Point3, to: Point3| {
            let ((x1, y1), (x2, y2)) = (Self::projected(from), Self::projected(to));
            let color = Ink::Axis.css();
            format!(
                "<line style=\"stroke:{color}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>"
            )
        };
        for pair in FLOOR.windows(2) {
            self.body += &edge(pair[0], pair[1]);
        }
        self.body += &edge([-0.5, 0.5, -0.5], [-0.5, 0.5, 0.5]);
        // The labels are inset from the corners, where two axes meet.
        let ends: [([Point3; 2], &str); 3] = [
            ([[-0.45, -0.6, -0.5], [0.42, -0.6, -0.5]], "middle"),
            ([[0.6, -0.42, -0.5], [0.6, 0.45, -0.5]], "start"),
            ([[-0.52, 0.53, -0.5], [-0.52, 0.53, 0.5]], "end"),
        ];
        for (i, ([from, to], anchor)) in ends.into_iter().enumerate() {
            let Edge { name, range, label } = self.edges[i].clone();
            let middle = std::array::from_fn(|k| (from[k] + to[k]) / 2.0);
            for (place, text) in
                [(from, label(range.start)), (middle, name.to_owned()), (to, label(range.end))]
            {
                let (x, y) = Self::projected(place);
                let text = html! { (text) }.into_string();
                let _ = write!(
                    self.labels,
                    "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"11\" text-anchor=\"{anchor}\">{text}</text>"
                );
            }
        }
    }
}

/// Box around `points`; no edge is shorter than a tenth of the longest.
pub fn around<'a>(
    names: [&'static str; 3],
    points: impl Iterator<Item = &'a Point3> + Clone,
) -> [Edge; 3] {
    let ranges: [Range<f64>; 3] =
        std::array::from_fn(|i| extent(points.clone().map(|point| point[i])));
    let longest = ranges.iter().map(|range| range.end - range.start).fold(1e-3, f64::max);
    std::array::from_fn(|i| {
        let Range { start, end } = ranges[i];
        let missing = (0.1 * longest - (end - start)).max(0.0);
        let label = |value: f64| oqtal_observe::plot::unit::rounded(value, 3);
        Edge { name: names[i], range: start - missing / 2.0..end + missing / 2.0, label }
    })
}
