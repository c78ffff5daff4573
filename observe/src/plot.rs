//! Plots as SVG: axes, colours, figures, and numbers as text; independent of flights.

pub mod axis;
pub mod chart;
pub mod figure;
pub mod palette;
pub mod trace;
pub mod unit;
