//! The colours of plots and pages, for light and dark colour schemes, as variables of the style sheet.

/// Colour by its purpose; the numbered ones distinguish lines without a specific purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Ink {
    Reference,
    Actual,
    Second,
    Third,
    Fourth,
    Fifth,
    Sixth,
    Good,
    Warning,
    Bad,
    Axis,
    Grid,
    Shade,
}

/// Name in the style sheet, and RGB value on light and on dark pages, in the order of [`Ink`].
const INKS: [(&str, u32, u32); 13] = [
    ("reference", 0x6B_7483, 0x9A_A5B5),
    ("actual", 0x1F_6FEB, 0x5C_A2FF),
    ("second", 0xD9_660B, 0xFF_A057),
    ("third", 0x0E_8F74, 0x3F_CFAE),
    ("fourth", 0x8A_4FD0, 0xBD_93F9),
    ("fifth", 0xC7_3E86, 0xF4_84BE),
    ("sixth", 0x6E_7D14, 0xB9_CB4E),
    ("good", 0x1E_9E5A, 0x3F_C37D),
    ("warning", 0xE0_9A0C, 0xF0_BC45),
    ("bad", 0xD4_354B, 0xFF_7485),
    ("axis", 0xB9_C1CC, 0x47_5262),
    ("grid", 0xE7_EAEF, 0x27_2E38),
    ("shade", 0xEE_F4FE, 0x19_253A),
];

impl Ink {
    /// The colour as a value of the style sheet, as in `var(--actual)`.
    pub fn css(self) -> String {
        format!("var(--{})", INKS[self as usize].0)
    }
}

/// The style sheet of the palette.
pub fn css() -> String {
    let light = INKS.map(|(name, light, _)| format!("--{name}:#{light:06X};")).concat();
    let dark = INKS.map(|(name, _, dark)| format!("--{name}:#{dark:06X};")).concat();
    format!(":root{{{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ink_is_a_variable_of_the_style_sheet() {
        assert_eq!(
            (Ink::Reference.css(), Ink::Shade.css()),
            ("var(--reference)".into(), "var(--shade)".into())
        );
        assert_eq!(css().matches("--actual:").count(), 2, "light and dark");
    }
}
