//! Notes on a path that a guarded law cannot fly: the fallback flies in its place.

use oqtal_config::Config;
use oqtal_control::trajectory::Reference;

use crate::envelope::Envelope;

/// Distance by which a vehicle may be below its reference \[m\].
const BELOW_REFERENCE_M: f64 = 0.05;

/// Note that the fallback flies in place of the law of `config` where a path has its least height above the floor, `lowest_m` \[m\];
/// `None` if the path is high enough, or no fallback flies.
pub(crate) fn note_below_envelope(config: &Config, lowest_m: f64) -> Option<String> {
    let margin_m = config.envelope.fence_margin_m;
    (is_guarded(config) && lowest_m < margin_m + BELOW_REFERENCE_M).then(|| {
        format!(
            "at {lowest_m:.2} m above the floor the fallback law flies instead of control.controller = \"{}\": it takes over whenever the vehicle could not stop envelope.fence-margin-m = {margin_m} above the floor",
            config.control.controller
        )
    })
}

/// Note that the fallback flies in place of the law of `config` from where the vehicle, in the motion of one of the references `flown`, of
/// these times from arming \[s\], could not stop inside the fence and above the floor, at height zero; `None` if it could everywhere, or no
/// fallback flies.
pub(crate) fn note_near_border<'a>(
    config: &Config,
    mut flown: impl Iterator<Item = &'a (f64, Reference)>,
) -> Option<String> {
    let envelope = Envelope::new(config).ok().filter(|_| is_guarded(config))?;
    let margin_m = config.envelope.fence_margin_m;
    let border = |reference| match envelope.stop_of(reference) {
        [inside_m, _] if inside_m < margin_m => Some(["inside [fence]", "widen the fence"]),
        [_, height_m] if height_m < margin_m + BELOW_REFERENCE_M => {
            Some(["above the floor", "fly higher"])
        }
        _ => None,
    };
    let (t_s, near, [place, remedy]) =
        flown.find_map(|(t_s, near)| border(near).map(|words| (t_s, near, words)))?;
    let ([x, y, z], speed_m_s): ([f64; 3], f64) = (near.position.into(), near.velocity.norm());
    Some(format!(
        "at {:.1} s, at [{x:.2}, {y:.2}, {z:.2}] m and {speed_m_s:.2} m/s, the fallback law flies instead of control.controller = \"{}\": it takes over whenever the vehicle could not stop envelope.fence-margin-m = {margin_m} {place}; lower that margin, {remedy}, or fly more slowly",
        t_s - config.trajectory.start_s(),
        config.control.controller,
    ))
}

/// Whether a fallback flies in place of the law of `config` when it leads out of the envelope.
fn is_guarded(config: &Config) -> bool {
    config.control.is_external() || config.control.of_fallback().is_some()
}
