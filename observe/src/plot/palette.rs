//! The colours of plots and pages, for light and dark colour schemes.
//!
//! Plots are drawn in the light colours. The style sheet selects each shape by its light colour and replaces that colour
//! in the dark scheme.

use plotters::style::RGBColor;

/// A colour by its purpose; the numbered ones distinguish lines without a purpose of their own.
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

use Ink::{
    Actual, Axis, Bad, Fifth, Fourth, Good, Grid, Reference, Second, Shade, Sixth, Third, Warning,
};

/// Colour, name in the style sheet, and RGB values for light and dark pages. The light values are distinct, because the style
/// sheet selects shapes by them.
const INKS: [(Ink, &str, [u8; 3], [u8; 3]); 13] = [
    (Reference, "reference", [0x6B, 0x74, 0x83], [0x9A, 0xA5, 0xB5]),
    (Actual, "actual", [0x1F, 0x6F, 0xEB], [0x5C, 0xA2, 0xFF]),
    (Second, "second", [0xD9, 0x66, 0x0B], [0xFF, 0xA0, 0x57]),
    (Third, "third", [0x0E, 0x8F, 0x74], [0x3F, 0xCF, 0xAE]),
    (Fourth, "fourth", [0x8A, 0x4F, 0xD0], [0xBD, 0x93, 0xF9]),
    (Fifth, "fifth", [0xC7, 0x3E, 0x86], [0xF4, 0x84, 0xBE]),
    (Sixth, "sixth", [0x6E, 0x7D, 0x14], [0xB9, 0xCB, 0x4E]),
    (Good, "good", [0x1E, 0x9E, 0x5A], [0x3F, 0xC3, 0x7D]),
    (Warning, "warning", [0xE0, 0x9A, 0x0C], [0xF0, 0xBC, 0x45]),
    (Bad, "bad", [0xD4, 0x35, 0x4B], [0xFF, 0x74, 0x85]),
    (Axis, "axis", [0xB9, 0xC1, 0xCC], [0x47, 0x52, 0x62]),
    (Grid, "grid", [0xE7, 0xEA, 0xEF], [0x27, 0x2E, 0x38]),
    (Shade, "shade", [0xEE, 0xF4, 0xFE], [0x19, 0x25, 0x3A]),
];

impl Ink {
    /// The RGB value in a plot.
    pub fn color(self) -> RGBColor {
        let [r, g, b] = self.entry().2;
        RGBColor(r, g, b)
    }

    /// The colour in a plot, by which the style sheet selects.
    pub fn hex(self) -> String {
        hex(self.entry().2)
    }

    /// The value in a style sheet.
    pub fn css(self) -> String {
        format!("var(--{})", self.entry().1)
    }

    fn entry(self) -> &'static (Self, &'static str, [u8; 3], [u8; 3]) {
        let known = INKS.iter().find(|(ink, ..)| *ink == self);
        known.expect("every ink is in the table: a test holds it")
    }
}

fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// The style sheet of the palette.
pub fn css() -> String {
    let light = INKS.map(|(_, name, light, _)| format!("--{name}:{};", hex(light))).concat();
    let dark = INKS.map(|(_, name, _, dark)| format!("--{name}:{};", hex(dark))).concat();
    let shape = |name: &str, key: &str, property: &str| {
        format!(".plot [{property}=\"{key}\"]{{{property}:var(--{name})}}")
    };
    let shapes = INKS
        .map(|(_, name, light, _)| ["stroke", "fill"].map(|p| shape(name, &hex(light), p)).concat())
        .concat();
    format!(
        ":root{{{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}{shapes}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ink_has_one_entry_and_a_light_colour_of_its_own() {
        let all = [
            Reference, Actual, Second, Third, Fourth, Fifth, Sixth, Good, Warning, Bad, Axis, Grid,
            Shade,
        ];
        for ink in all {
            assert_eq!(INKS.iter().filter(|(other, ..)| *other == ink).count(), 1);
            assert_eq!(INKS.iter().filter(|entry| entry.2 == ink.entry().2).count(), 1);
        }
    }
}
