//! Plots as SVG, their axes, colours and figures, and numbers as text: shared by the flight report and the studies. Knows
//! nothing of flights.

pub mod axis;
pub mod chart;
pub mod figure;
pub mod palette;
pub mod trace;
pub mod unit;
