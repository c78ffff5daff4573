//! Times that follow from the configuration and from the line: limits of the command gate, spacing of periodic frames.

use oqtal_bus::time::Span;
use oqtal_config::Config;
use oqtal_runtime::actuation::actuation_of;

use crate::line::LineOccupancy;
use crate::protocol::FrameSizes;
use crate::safety::SafetyLimits;
use crate::schedule::spacing;

/// Age up to which a status counts for a motor sequence \[status periods\].
const STATUS_PERIODS: f64 = 3.0;

/// Spacing of periodic frames on `line`, for frames of `sizes` on the port and `count` periodic frames together; `None` if there is
/// no room for any.
pub(crate) fn periodic_spacing(
    line: &LineOccupancy,
    period: Span,
    sizes: FrameSizes,
    count: usize,
) -> Option<Span> {
    let FrameSizes { setpoint, acknowledgement, periodic, periodic_reply } = sizes;
    let exchange = line.time_for(count * (periodic + periodic_reply));
    spacing(period, line.time_for(setpoint + acknowledgement), exchange)
}

/// `millis` \[ms\] as a span.
pub(crate) fn millis(millis: f64) -> Span {
    Span::from_seconds(millis * 1e-3)
}

/// Limits of `config`, where periodic frames are `spacing` apart.
pub(crate) fn limits(config: &Config, spacing: Span) -> SafetyLimits {
    let options = &config.bridge;
    let period = Span::period_of(config.control.rate_hz);
    let status_period = Span::period_of(options.status_rate_hz).max(spacing);
    SafetyLimits {
        accepts: actuation_of(config.vehicle.interface),
        command_age: period.scaled(options.command_timeout_periods),
        status_age: status_period.scaled(STATUS_PERIODS),
        sequence: millis(options.motor_sequence_ms),
        rest: millis(options.rest_ms),
    }
}
