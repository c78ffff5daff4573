//! Attitude laws in the experiments of the spacecraft, as data.

use oqtal_control::controller::{
    ControlOptions, ControllerName, LqrOptions, OqtalDtOptions, OqtalOptions, PidOptions,
    RateFeedback,
};
use oqtal_control::error_model::Jacobian;
use oqtal_control::schedule::Cells;

use super::lander::{Descent, RATE_HZ};
use crate::sheet::Variant;

/// Limit above every pitch angle \[rad\]: cells are linearised at the points given by the printed rule.
const NO_LIMIT_RAD: f64 = 10.0;
/// Limit of the integral that is never reached \[s\]: the paper has no limit.
const NO_INTEGRAL_LIMIT: f64 = 1e6;
/// Rate of a practically continuous loop \[Hz\].
const CONTINUOUS_HZ: f64 = 64.0 * RATE_HZ;

/// A law with its settings.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Name in tables.
    pub controller: &'static str,
    /// Origin.
    pub variant: Variant,
    /// Description of its settings.
    pub settings: String,
    /// Options.
    pub options: ControlOptions,
    /// Conditions of the gravity turn.
    pub descent: Descent,
}

/// Wie's PID as printed, with these gains.
pub fn pid([c, k, t]: [f64; 3], rate: RateFeedback) -> ControlOptions {
    let pid = PidOptions {
        gain: k,
        integral_time_s: t,
        rate_gain_per_s: c,
        rate,
        integral_limit_s: NO_INTEGRAL_LIMIT,
        ..PidOptions::spacecraft()
    };
    ControlOptions { controller: ControllerName::Pid, pid, ..ControlOptions::spacecraft() }
}

/// The classic LQR with `Q = q I`, `R = r I`.
pub fn lqr([q, r]: [f64; 2], cells: Cells) -> ControlOptions {
    let lqr = LqrOptions {
        attitude_weight: q,
        rate_weight: q,
        input_weight: r,
        cells,
        operating_pitch_limit_rad: NO_LIMIT_RAD,
        ..LqrOptions::spacecraft()
    };
    ControlOptions { controller: ControllerName::Lqr, lqr, ..ControlOptions::spacecraft() }
}

/// OQTAL with `Q = q I`, `R = r I`, as printed: with the Jacobian of Eqs. (45) and (46).
pub fn oqtal_as_printed(weights: [f64; 2], cells: Cells) -> ControlOptions {
    let mut options = oqtal(weights, cells);
    options.oqtal.jacobian = Jacobian::Printed45;
    options
}

/// OQTAL with `Q = q I`, `R = r I`, with the decoupled Jacobian, which is not in the paper: erratum E-47.
pub fn oqtal([q, r]: [f64; 2], cells: Cells) -> ControlOptions {
    let oqtal = OqtalOptions {
        attitude_weight: q,
        rate_weight: q,
        input_weight: r,
        cells,
        ..OqtalOptions::spacecraft()
    };
    ControlOptions { controller: ControllerName::Oqtal, oqtal, ..ControlOptions::spacecraft() }
}

/// `oqtal-dt` with these weights of attitude, rate and input.
pub fn oqtal_dt([attitude_weight, rate_weight, input_weight]: [f64; 3]) -> ControlOptions {
    let oqtal_dt = OqtalDtOptions { attitude_weight, rate_weight, input_weight };
    ControlOptions { controller: ControllerName::OqtalDt, oqtal_dt, ..ControlOptions::spacecraft() }
}

/// The laws of Table IV.
pub fn table_4() -> Vec<Entry> {
    [as_printed(), ours()].concat()
}

fn entry(
    controller: &'static str,
    variant: Variant,
    settings: impl Into<String>,
    options: ControlOptions,
) -> Entry {
    let descent = Descent::default();
    Entry { controller, variant, settings: settings.into(), options, descent }
}

/// The rules for cells and their names.
pub const CELLS: [(Cells, &str); 4] = [
    (Cells::Centred, "centred"),
    (Cells::Floor, "floor"),
    (Cells::Truncated, "truncated"),
    (Cells::Deadband, "deadband"),
];

fn as_printed() -> Vec<Entry> {
    let printed = Variant::AsPrinted;
    let gains = [50.0, 5.95, 1.15];
    let text = "c 50, k 5.95, T 1.15 (Table IV), c omega";
    let mut entries = vec![entry("pid", printed, text, pid(gains, RateFeedback::Omega))];
    for (cells, name) in CELLS {
        let text = format!("q 128, r 1, 60 Hz hold, {name} cells");
        entries.push(entry("lqr", printed, text, lqr([128.0, 1.0], cells)));
    }
    for (cells, name) in CELLS {
        let text = format!("q 256, r 1, 60 Hz hold, {name} cells");
        entries.push(entry("oqtal", printed, text, oqtal_as_printed([256.0, 1.0], cells)));
    }
    let planar = Descent { noise_rad: 0.0, ..Descent::default() };
    let lqr = entry(
        "lqr",
        printed,
        "q 128, r 1, 60 Hz hold, centred cells, in the plane to the last bit",
        lqr([128.0, 1.0], Cells::Centred),
    );
    entries.push(Entry { descent: planar, ..lqr });
    let without = Descent { rates: false, ..Descent::default() };
    let fast = Descent { rate_hz: CONTINUOUS_HZ, ..Descent::default() };
    for (descent, text) in [
        (without, "q 256, r 1, 60 Hz hold, centred cells, without omega_d"),
        (fast, "q 256, r 1, 3840 Hz hold (as good as continuous), centred cells"),
    ] {
        let oqtal = entry("oqtal", printed, text, oqtal_as_printed([256.0, 1.0], Cells::Centred));
        entries.push(Entry { descent, ..oqtal });
    }
    entries
}

fn ours() -> Vec<Entry> {
    let ours = Variant::Ours;
    let gains = [50.0, 5.95, 1.15];
    let mut with_rate_error = lqr([256.0, 1.0], Cells::Truncated);
    with_rate_error.lqr.rate = RateFeedback::OmegaE;
    let mut fed_forward = oqtal([256.0, 1.0], Cells::Centred);
    fed_forward.oqtal.feed_forward = true;
    let mut entries = vec![
        entry("pid", ours, "c 50, k 5.95, T 1.15, c omega_e", pid(gains, RateFeedback::OmegaE)),
        entry(
            "lqr",
            ours,
            "q 256, r 1, truncated cells, rate error in place of rate",
            with_rate_error,
        ),
        entry(
            "oqtal",
            ours,
            "q 256, r 1, centred cells, decoupled Jacobian",
            oqtal([256.0, 1.0], Cells::Centred),
        ),
        entry(
            "oqtal",
            ours,
            "q 256, r 1, centred cells, decoupled Jacobian, feed-forward",
            fed_forward,
        ),
    ];
    entries.extend(new_laws());
    entries
}

/// Every registered law that is not in the paper, with its gains for the spacecraft; `oqtal-dt` last.
fn new_laws() -> Vec<Entry> {
    use ControllerName::{Geometric, Lqr, Oqtal, OqtalDt, Pid};
    let others =
        ControllerName::ALL.into_iter().filter(|law| !matches!(law, Pid | Lqr | Oqtal | OqtalDt));
    let other = |controller: ControllerName| {
        let options = ControlOptions { controller, ..ControlOptions::spacecraft() };
        let text = if controller == Geometric {
            "k_R 256, k_Omega 32"
        } else {
            "its gains for the spacecraft"
        };
        entry(controller.name(), Variant::Ours, text, options)
    };
    // 2^20 and 2^6
    let text = "split weights 2^20 and 2^6, r 1";
    let ours = entry("oqtal-dt", Variant::Ours, text, oqtal_dt([1_048_576.0, 64.0, 1.0]));
    others.map(other).chain([ours]).collect()
}

/// One configuration of each law, for experiments other than the gravity turn.
pub fn each() -> Vec<Entry> {
    let pid = pid([50.0, 5.95, 1.15], RateFeedback::Omega);
    let lqr = lqr([128.0, 1.0], Cells::Truncated);
    let oqtal = oqtal_as_printed([256.0, 1.0], Cells::Truncated);
    let printed = Variant::AsPrinted;
    let mut entries = vec![
        entry("pid", printed, "c 50, k 5.95, T 1.15 (Table IV)", pid),
        entry("lqr", printed, "q 128, r 1, truncated cells", lqr),
        entry("oqtal", printed, "q 256, r 1, truncated cells", oqtal),
    ];
    entries.extend(new_laws());
    entries
}

/// Every law with its shipped gains for the quadrotor.
pub fn shipped() -> Vec<Entry> {
    let shipped = |entry: Entry| {
        let options = ControlOptions { controller: entry.options.controller, ..Default::default() };
        Entry { settings: "shipped gains".to_owned(), options, ..entry }
    };
    each().into_iter().map(shipped).collect()
}
