//! Block diagrams of laws, testbed and loops, Figs. 3 to 5, 15 and 16, as files.

use maud::PreEscaped;
use oqtal_observe::plot::figure::framed;

use super::chapter::Chapter;
use super::expression::TextValues;
use super::text;

/// Number, title and drawing of each diagram.
const DIAGRAMS: [(u8, &str, &str); 5] = [
    (3, "quaternion PID", include_str!("diagrams/figure-3.svg")),
    (
        4,
        "classic LQR, with set-point tracking and integral action",
        include_str!("diagrams/figure-4.svg"),
    ),
    (5, "OQTAL, with integral action", include_str!("diagrams/figure-5.svg")),
    (15, "the testbed, and its counterparts here", include_str!("diagrams/figure-15.svg")),
    (
        16,
        "control architecture: six PIDs around the attitude law",
        include_str!("diagrams/figure-16.svg"),
    ),
];

/// The diagrams.
pub fn chapter() -> Chapter {
    let figures = DIAGRAMS.map(|(number, title, svg)| {
        let drawing = PreEscaped(svg.to_owned());
        framed(&format!("Fig. {number}: {title}"), &[], (drawing, None))
    });
    Chapter { figures: figures.into(), ..text::chapter("architecture", &TextValues::new()) }
}
