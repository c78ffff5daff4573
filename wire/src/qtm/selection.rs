//! Sections of the parameters.

use std::fmt;

/// Names of sections that a server may have and this one has not.
const ABSENT: [&str; 9] = [
    "2D",
    "Analog",
    "Force",
    "Image",
    "GazeVector",
    "EyeTracker",
    "Skeleton",
    "Calibration",
    "Timecode",
];

/// Sections of the parameters that a client asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParameterSelection {
    /// `General`: the rate.
    pub general: bool,
    /// `3D`: the labels of markers.
    pub markers: bool,
    /// `6D`: the bodies.
    pub bodies: bool,
}

impl ParameterSelection {
    /// Every section.
    pub const ALL: Self = Self { general: true, markers: true, bodies: true };

    /// Selects what `name` names, in any case; `None` if it names no section of the protocol.
    pub(super) fn with(self, name: &str) -> Option<Self> {
        let is = |known: &&str| known.eq_ignore_ascii_case(name);
        match () {
            () if is(&"All") => Some(Self::ALL),
            () if is(&"General") => Some(Self { general: true, ..self }),
            () if is(&"3D") => Some(Self { markers: true, ..self }),
            () if is(&"6D") => Some(Self { bodies: true, ..self }),
            () => ABSENT.iter().any(is).then_some(self),
        }
    }

    /// Whether the selection contains nothing that the server has.
    pub fn is_empty(self) -> bool {
        self == Self::default()
    }
}

impl fmt::Display for ParameterSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::ALL {
            return f.write_str("All");
        }
        let names = [(self.general, "General"), (self.markers, "3D"), (self.bodies, "6D")];
        let selected = names.into_iter().filter(|(on, _)| *on);
        for (index, (_, name)) in selected.enumerate() {
            write!(f, "{}{name}", if index > 0 { " " } else { "" })?;
        }
        Ok(())
    }
}
