//! Parameters of a server: rate, labels of markers, bodies.

/// A marker of a body, in body axes.
#[derive(Clone, Debug, PartialEq)]
pub struct QtmPoint {
    /// Label.
    pub name: String,
    /// Position \[mm, body\].
    pub position_mm: [f64; 3],
}

/// Definition of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QtmBody {
    /// Name.
    pub name: String,
    /// Colour, red in the lowest byte \[-\].
    pub color: u32,
    /// Markers.
    pub points: Vec<QtmPoint>,
}

/// Parameters. A section that was not requested is `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QtmParameters {
    /// Rate of the cameras, of the section `General` \[Hz\].
    pub frequency_hz: Option<u32>,
    /// Labels of the markers, of the section `The_3D`.
    pub markers: Option<Vec<String>>,
    /// Bodies, of the section `The_6D`, in the order of every frame.
    pub bodies: Option<Vec<QtmBody>>,
}

/// Error in parameters.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum QtmParametersError {
    /// Text that is not XML.
    #[error("the server's parameters are not XML: {0}")]
    Xml(String),
    /// Elements within elements beyond any that a server writes.
    #[error("the server's parameters are nested too deeply")]
    Depth,
    /// Body without a name.
    #[error("body {0} of the server's parameters has no name")]
    NoName(usize),
}
