//! Text made from figures, for the notes of tables.

use oqtal_observe::plot::unit::rounded;

use crate::sheet::is_near;

/// `yes` if `holds`, else `no`.
#[must_use]
pub fn either<'a>(holds: bool, yes: &'a str, no: &'a str) -> &'a str {
    if holds { yes } else { no }
}

/// A list as text: "a, b and c", or "none".
#[must_use]
pub fn listed<T: AsRef<str>>(items: &[T]) -> String {
    let items: Vec<&str> = items.iter().map(AsRef::as_ref).collect();
    match items.as_slice() {
        [] => "none".to_owned(),
        [only] => (*only).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// A number with four significant digits, as in the tables; a count unchanged.
#[must_use]
pub fn figure(value: f64) -> String {
    let is_count = value.fract() == 0.0 && value.abs() < 1e4;
    if is_count { format!("{value}") } else { rounded(value, 4) }
}

/// A number with two significant digits.
#[must_use]
pub fn about(value: f64) -> String {
    rounded(value, 2)
}

/// Integers in rising order as ranges: "1 to 3 and 7", each end written by `name`.
#[must_use]
pub fn ranges(numbers: &[i32], name: impl Fn(i32) -> String) -> String {
    let parts = numbers.chunk_by(|a, b| b - a == 1).map(|part| match part {
        [only] => name(*only),
        [first, .., last] => format!("{} to {}", name(*first), name(*last)),
        [] => String::new(),
    });
    listed(&parts.collect::<Vec<_>>())
}

/// The figures `(name, computed, printed)` that agree within 10 %, and those that do not, as text.
#[must_use]
pub fn reproduced(figures: &[(&str, f64, f64)]) -> String {
    let compared = |(name, ours, printed): &(&str, f64, f64)| {
        format!("{name} ({} for {} printed)", figure(*ours), figure(*printed))
    };
    let (near, far): (Vec<_>, Vec<_>) =
        figures.iter().partition(|(_, ours, printed)| is_near(*ours, *printed));
    let [near, far] = [near, far].map(|some: Vec<_>| some.iter().map(compared).collect::<Vec<_>>());
    format!("within 10 %: {}; not: {}", listed(&near), listed(&far))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_read_as_sentences() {
        assert_eq!(listed::<&str>(&[]), "none");
        assert_eq!(listed(&["a"]), "a");
        assert_eq!(listed(&["a", "b", "c"]), "a, b and c");
    }

    #[test]
    fn numbers_in_a_row_are_a_range() {
        assert_eq!(
            ranges(&[-3, -2, -1, 4, 7, 8], |n| format!("2^{n}")),
            "2^-3 to 2^-1, 2^4 and 2^7 to 2^8"
        );
        assert_eq!([figure(49.0), figure(0.123_456)], ["49", "0.1235"]);
    }

    #[test]
    fn a_figure_is_reproduced_within_a_tenth() {
        let text = reproduced(&[("a", 1.09, 1.0), ("b", 1.2, 1.0)]);
        assert_eq!(text, "within 10 %: a (1.090 for 1 printed); not: b (1.200 for 1 printed)");
    }
}
