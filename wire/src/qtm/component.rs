//! Components of a data packet: what clients ask for by name.

use std::fmt;

/// Kind of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComponentKind {
    /// 1, `3D`: labelled markers.
    Markers,
    /// 2, `3DNoLabels`: markers with an identifier.
    Unlabelled,
    /// 5, `6D`: bodies with a rotation matrix.
    Bodies,
    /// 6, `6DEuler`: bodies with Euler angles.
    BodiesEuler,
    /// 9, `3DRes`: labelled markers with their residual.
    MarkersResidual,
    /// 10, `3DNoLabelsRes`: markers with an identifier and their residual.
    UnlabelledResidual,
    /// 11, `6DRes`: bodies with a rotation matrix and their residual.
    BodiesResidual,
    /// 12, `6DEulerRes`: bodies with Euler angles and their residual.
    BodiesEulerResidual,
}

impl ComponentKind {
    /// Every kind, in the order of their types.
    pub const ALL: [Self; 8] = [
        Self::Markers,
        Self::Unlabelled,
        Self::Bodies,
        Self::BodiesEuler,
        Self::MarkersResidual,
        Self::UnlabelledResidual,
        Self::BodiesResidual,
        Self::BodiesEulerResidual,
    ];

    /// The kind of a type on the wire.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.number() == number)
    }

    /// The kind of a name in a command, in any case.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name().eq_ignore_ascii_case(name))
    }

    /// Type on the wire \[-\].
    pub fn number(self) -> u32 {
        match self {
            Self::Markers => 1,
            Self::Unlabelled => 2,
            Self::Bodies => 5,
            Self::BodiesEuler => 6,
            Self::MarkersResidual => 9,
            Self::UnlabelledResidual => 10,
            Self::BodiesResidual => 11,
            Self::BodiesEulerResidual => 12,
        }
    }

    /// Name in a command.
    pub fn name(self) -> &'static str {
        match self {
            Self::Markers => "3D",
            Self::Unlabelled => "3DNoLabels",
            Self::Bodies => "6D",
            Self::BodiesEuler => "6DEuler",
            Self::MarkersResidual => "3DRes",
            Self::UnlabelledResidual => "3DNoLabelsRes",
            Self::BodiesResidual => "6DRes",
            Self::BodiesEulerResidual => "6DEulerRes",
        }
    }

    /// Length of one body or marker \[bytes\].
    pub fn record_bytes(self) -> usize {
        match self {
            Self::Markers => 12,
            Self::Unlabelled | Self::MarkersResidual => 16,
            Self::UnlabelledResidual => 20,
            Self::Bodies => 48,
            Self::BodiesEuler => 24,
            Self::BodiesResidual => 52,
            Self::BodiesEulerResidual => 28,
        }
    }

    /// Whether a record ends with a residual.
    pub fn has_residual(self) -> bool {
        matches!(
            self,
            Self::MarkersResidual
                | Self::UnlabelledResidual
                | Self::BodiesResidual
                | Self::BodiesEulerResidual
        )
    }
}

/// Components of a frame in the requested order, each kind at most once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ComponentSet {
    kinds: [Option<ComponentKind>; ComponentKind::ALL.len()],
}

impl ComponentSet {
    /// No component.
    pub fn new() -> Self {
        Self::default()
    }

    /// The components with `kind`.
    pub fn with(mut self, kind: ComponentKind) -> Self {
        if !self.iter().any(|known| known == kind)
            && let Some(place) = self.kinds.iter_mut().find(|place| place.is_none())
        {
            *place = Some(kind);
        }
        self
    }

    /// The components in their order.
    pub fn iter(&self) -> impl Iterator<Item = ComponentKind> + '_ {
        self.kinds.iter().flatten().copied()
    }

    /// Whether there is no component.
    pub fn is_empty(&self) -> bool {
        self.kinds[0].is_none()
    }
}

impl fmt::Display for ComponentSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, kind) in self.iter().enumerate() {
            write!(f, "{}{}", if index > 0 { " " } else { "" }, kind.name())?;
        }
        Ok(())
    }
}
