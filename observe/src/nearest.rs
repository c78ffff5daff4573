//! The sample nearest to an instant, among samples in the order of time.

use std::collections::VecDeque;

use oqtal_bus::time::Time;

/// Index in `samples` of the one whose time is nearest to `at`, the earlier of two; `None` if there are none.
pub fn nearest<T>(samples: &VecDeque<T>, at: Time, time: impl Fn(&T) -> Time) -> Option<usize> {
    let after = samples.partition_point(|sample| time(sample) < at);
    let around = [after.checked_sub(1), Some(after)].into_iter().flatten();
    let distance = |index: &usize| time(&samples[*index]).since(at).nanos().abs();
    around.filter(|index| *index < samples.len()).min_by_key(distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_sample_is_found_and_of_two_the_earlier() {
        let samples = VecDeque::from([10, 20, 20, 30].map(Time::from_nanos));
        let at = |nanos| nearest(&samples, Time::from_nanos(nanos), |time| *time);
        assert_eq!([1, 14, 15, 16, 20, 26, 99].map(at), [0, 0, 0, 1, 1, 3, 3].map(Some));
        assert_eq!(nearest(&VecDeque::<Time>::new(), Time::UNSET, |time| *time), None);
    }
}
