//! Numbers, spans and names as text.

/// Placeholder printed for a missing value.
pub const MISSING: &str = "–";

/// `value` with three significant digits; with an exponent only below 1e-6 and from 1e9 on.
pub fn significant(value: f64) -> String {
    rounded(value, 3)
}

/// `value` with `digits` significant digits; with an exponent only below 1e-6 and from 1e9 on.
pub fn rounded(value: f64, digits: i32) -> String {
    if !value.is_finite() {
        return MISSING.to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    if !(1e-6..1e9).contains(&value.abs()) {
        return format!("{value:.*e}", digits.unsigned_abs() as usize - 1);
    }
    let decimals = digits - 1 - value.abs().log10().floor() as i32;
    let unit = 10_f64.powi(-decimals);
    match usize::try_from(decimals) {
        Ok(decimals) => format!("{value:.decimals$}"),
        Err(_) => format!("{:.0}", (value / unit).round() * unit),
    }
}

/// A span \[ns\] in a suitable unit.
pub fn span(nanos: u64) -> String {
    let value = nanos as f64;
    match nanos {
        0 => "0".to_owned(),
        1..1_000 => format!("{nanos} ns"),
        1_000..1_000_000 => format!("{} µs", significant(value * 1e-3)),
        1_000_000..1_000_000_000 => format!("{} ms", significant(value * 1e-6)),
        _ => format!("{} s", significant(value * 1e-9)),
    }
}

/// Suitable unit for a length \[m\], and its number per metre.
pub fn unit_of_length(metres: f64) -> (&'static str, f64) {
    if metres < 1.0 { ("mm", 1e3) } else { ("m", 1.0) }
}

/// A length \[m\] in a suitable unit.
pub fn length(metres: f64) -> String {
    let (unit, per_metre) = unit_of_length(metres);
    format!("{} {unit}", significant(metres * per_metre))
}

/// An identifier with underscores replaced by spaces.
pub fn words(name: &str) -> String {
    name.replace('_', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_are_shown_for_any_size() {
        let cases = [
            (0.083_14, "0.0831"),
            (-1.0, "-1.00"),
            (12_345.6, "12300"),
            (0.0, "0"),
            (3e-7, "3.00e-7"),
        ];
        for (value, text) in cases {
            assert_eq!(significant(value), text);
        }
        assert_eq!(significant(f64::NAN), MISSING);
    }

    #[test]
    fn spans_and_lengths_choose_their_unit() {
        let spans = [0, 850, 12_340, 35_060_000, 1_200_000_000].map(span);
        assert_eq!(spans, ["0", "850 ns", "12.3 µs", "35.1 ms", "1.20 s"]);
        assert_eq!([0.0831, 1.2].map(length), ["83.1 mm", "1.20 m"]);
    }
}
