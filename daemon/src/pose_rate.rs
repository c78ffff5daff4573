//! Rate at which poses arrive, compared with the one that the loop expects. For the background thread.

use oqtal_bus::message::Header;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

/// Shortest window in which poses are counted.
const WINDOW: Span = Span::from_millis(1000);
/// Time without a pose that counts as a pause; a window with a pause is not used, and a pause ends a warning.
const PAUSE: Span = Span::from_millis(2000);
/// Time with another rate in every window after which there is a warning.
const LASTING: Span = Span::from_millis(5000);
/// Share of lost frames above which a window is not used: the loss has a warning of its own \[0..1\].
const MOST_LOST: f64 = 0.05;

/// Monitor of the rate of the poses.
#[derive(Debug, Default)]
pub(crate) struct PoseRate {
    /// The newest pose, with the instant at which it was taken first.
    newest: Option<(Time, Header)>,
    /// The pose at which the present window began.
    window: Option<Header>,
    /// The pose since which all windows have had another rate.
    since: Option<Header>,
    warning: Option<String>,
}

impl PoseRate {
    /// Takes the header of the newest pose, new or not, at `now`.
    pub(crate) fn take(&mut self, now: Time, header: &Header, config: &Config) {
        let known = self.newest.filter(|(_, it)| it == header);
        let (taken_at, _) = *self.newest.insert(known.unwrap_or((now, *header)));
        let window = *self.window.get_or_insert(*header);
        let length = elapsed(&window, header);
        if window.source != header.source || length.max(now.since(taken_at)) > PAUSE {
            *self = Self { newest: self.newest, window: Some(*header), ..Self::default() };
        } else if length >= WINDOW {
            let is_whole = share_lost(&window, header) <= MOST_LOST;
            self.window = Some(*header);
            if !(is_whole && config.is_other_pose_rate(rate_hz(&window, header))) {
                (self.since, self.warning) = (None, None);
                return;
            }
            let since = *self.since.get_or_insert(window);
            if elapsed(&since, header) >= LASTING {
                let advice = config.camera_rate_advice(rate_hz(&since, header));
                self.warning =
                    advice.map(|it| format!("poses arrive at {}; {}", it.found, it.remedy));
            }
        }
    }

    /// Warning that the poses arrive at another rate than the loop expects, with the remedy; `None` if they do not.
    pub(crate) fn warning(&self) -> Option<&String> {
        self.warning.as_ref()
    }
}

/// Time between two poses.
fn elapsed(from: &Header, to: &Header) -> Span {
    to.stamps.pose_published_at.since(from.stamps.pose_published_at)
}

/// Rate of the poses between two of them \[Hz\].
fn rate_hz(from: &Header, to: &Header) -> f64 {
    to.sequence.saturating_sub(from.sequence) as f64 / elapsed(from, to).seconds()
}

/// Share of the frames between two poses that were not published \[0..1\].
fn share_lost(from: &Header, to: &Header) -> f64 {
    let frames = to.pose_sequence.saturating_sub(from.pose_sequence);
    let lost = frames.saturating_sub(to.sequence.saturating_sub(from.sequence));
    lost as f64 / frames.max(1) as f64
}

#[cfg(test)]
mod tests {
    use oqtal_bus::message::Stamps;
    use oqtal_bus::time::Time;

    use super::*;

    /// The monitor after `seconds` \[s\] of poses at `rate_hz` \[Hz\], of which `is_lost` selects the lost frames.
    fn monitor(rate_hz: u64, seconds: u64, is_lost: fn(u64) -> bool) -> PoseRate {
        let (mut rate, config) = (PoseRate::default(), Config::default());
        let frames = (1..=rate_hz * seconds).filter(|frame| !is_lost(*frame));
        for (sequence, pose_sequence) in (1..).zip(frames) {
            let at = Span::period_of(rate_hz as f64).scaled(pose_sequence as f64);
            let pose_published_at = Time::VIRTUAL_START + at;
            let stamps = Stamps { pose_published_at, ..Stamps::default() };
            let header = Header { sequence, pose_sequence, source: 1, stamps, ..Header::default() };
            rate.take(pose_published_at, &header, &config);
        }
        rate
    }

    /// The warning after the poses of [`monitor`].
    fn warning(rate_hz: u64, seconds: u64, is_lost: fn(u64) -> bool) -> Option<String> {
        monitor(rate_hz, seconds, is_lost).warning().cloned()
    }

    #[test]
    fn poses_that_arrive_at_another_rate_for_some_seconds_cause_a_warning_with_its_remedy() {
        for (rate_hz, remedy) in [
            (100, "set safety.pose-rate-hz = 100 and control.rate-hz = 50"),
            (50, "set safety.pose-rate-hz = 50 and control.rate-hz = 50"),
            (240, "set safety.pose-rate-hz = 240"),
        ] {
            let told = warning(rate_hz, 8, |_| false).unwrap();
            assert!(told.ends_with(remedy), "{told}");
            assert!(told.starts_with(&format!("poses arrive at {rate_hz}.0 Hz")), "{told}");
            assert_eq!(warning(rate_hz, 4, |_| false), None, "too short");
        }
    }

    #[test]
    fn neither_a_small_deviation_nor_a_pause_nor_losses_are_another_rate() {
        assert_eq!(warning(57, 20, |_| false), None);
        assert_eq!(warning(64, 20, |_| false), None);
        assert_eq!(warning(60, 20, |frame| frame % 5 == 0), None);
        assert_eq!(warning(60, 20, |frame| (300..420).contains(&frame)), None);
    }

    #[test]
    fn a_pause_is_not_another_rate_and_ends_a_warning() {
        for (rate_hz, is_warned) in [(60, false), (100, true)] {
            let mut rate = monitor(rate_hz, 8, |_| false);
            assert_eq!(rate.warning().is_some(), is_warned);
            let (mut now, mut header) = rate.newest.unwrap();
            for _ in 0..60 {
                now = now + Span::from_millis(1000);
                rate.take(now, &header, &Config::default());
            }
            assert_eq!(rate.warning(), None, "the newest pose is old");
            header.sequence += 1;
            header.pose_sequence += 1;
            header.stamps.pose_published_at = now;
            rate.take(now, &header, &Config::default());
            assert_eq!(rate.warning(), None, "a window with a pause");
        }
    }
}
