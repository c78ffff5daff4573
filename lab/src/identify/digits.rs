//! Numbers with as many digits as their confidence interval supports.

/// `value` and its half width \[any unit\]: the half width with two significant digits, the value with the same number of
/// decimals; a value without an interval, one that is given, with all its digits.
pub fn with_interval(value: f64, half_width: f64) -> (String, String) {
    if half_width == 0.0 {
        return (value.to_string(), "0".to_owned());
    }
    let decimals = if half_width.is_finite() && half_width > 0.0 {
        (1.0 - half_width.log10().floor()).clamp(0.0, 9.0) as usize
    } else {
        4
    };
    (format!("{value:.decimals$}"), format!("{half_width:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_has_the_decimals_of_its_interval() {
        let pair = |value, half| with_interval(value, half);
        assert_eq!(pair(54.2163, 0.5742), ("54.22".to_owned(), "0.57".to_owned()));
        assert_eq!(pair(20.5, 12.3), ("20".to_owned(), "12".to_owned()));
        assert_eq!(pair(0.02745, 0.0), ("0.02745".to_owned(), "0".to_owned()));
    }
}
