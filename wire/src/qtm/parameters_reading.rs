//! Parameters from XML, of both generations of the protocol.

use quick_xml::XmlVersion;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::{BytesRef, BytesStart, Event};
use quick_xml::reader::Reader;

use super::parameters::{QtmBody, QtmParameters, QtmParametersError, QtmPoint};
use crate::text::printable;

/// Greatest depth of elements \[-\]. Servers write skeletons of about thirty.
const MAX_DEPTH: usize = 128;

impl QtmParameters {
    /// Reads parameters of either generation.
    ///
    /// # Errors
    /// The text is not XML, or a body has no name.
    pub fn from_xml(text: &str) -> Result<Self, QtmParametersError> {
        let mut reader = Reader::from_str(text);
        let mut reading = Reading::default();
        loop {
            match reader.read_event().map_err(not_xml)? {
                Event::Start(element) => {
                    reading.open(&element)?;
                    reading.attributes(&element)?;
                }
                Event::Empty(element) => {
                    reading.open(&element)?;
                    reading.attributes(&element)?;
                    reading.close();
                }
                Event::Text(text) => reading.text.push_str(&text),
                Event::CData(text) => reading.text.push_str(&text),
                Event::GeneralRef(reference) => reading.text.push_str(&resolved(&reference)?),
                Event::End(_) => reading.close(),
                Event::Eof => break,
                Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) => {}
            }
        }
        reading.finish()
    }
}

fn not_xml(error: impl std::fmt::Display) -> QtmParametersError {
    QtmParametersError::Xml(printable(&error.to_string()))
}

/// The text of `&amp;` or `&#38;`.
fn resolved(reference: &BytesRef<'_>) -> Result<String, QtmParametersError> {
    if let Some(letter) = reference.resolve_char_ref().map_err(not_xml)? {
        return Ok(letter.to_string());
    }
    let text = resolve_predefined_entity(reference);
    text.map(str::to_owned).ok_or_else(|| not_xml("an entity that is not predefined"))
}

/// Content read so far.
#[derive(Default)]
struct Reading {
    /// Names of the open elements below the root, a `/` before each.
    path: String,
    /// Number of open elements.
    depth: usize,
    /// Text of the innermost element.
    text: String,
    parameters: QtmParameters,
}

impl Reading {
    fn open(&mut self, element: &BytesStart<'_>) -> Result<(), QtmParametersError> {
        if self.depth == MAX_DEPTH {
            return Err(QtmParametersError::Depth);
        }
        if self.depth > 0 {
            self.path.push('/');
            self.path.push_str(element.local_name().as_ref());
        }
        self.depth += 1;
        self.text.clear();
        let parameters = &mut self.parameters;
        match self.path.as_str() {
            "/The_3D" => parameters.markers = Some(Vec::new()),
            "/The_6D" => parameters.bodies = Some(Vec::new()),
            "/The_6D/Body" => {
                parameters.bodies.get_or_insert_default().push(QtmBody::default());
            }
            "/The_6D/Body/Point" | "/The_6D/Body/Points/Point" => {
                if let Some(body) = last_body(parameters) {
                    body.points.push(QtmPoint { name: String::new(), position_mm: [0.0; 3] });
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Reads the attributes of the newer generation.
    fn attributes(&mut self, element: &BytesStart<'_>) -> Result<(), QtmParametersError> {
        let Some(body) = last_body(&mut self.parameters) else { return Ok(()) };
        let (color, point) = match self.path.as_str() {
            "/The_6D/Body/Color" => (true, false),
            "/The_6D/Body/Points/Point" => (false, true),
            _ => return Ok(()),
        };
        for attribute in element.attributes() {
            let attribute = attribute.map_err(not_xml)?;
            let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(not_xml)?;
            match (attribute.key.as_ref(), body.points.last_mut()) {
                ("R", _) if color => set_color(body, 0, &value),
                ("G", _) if color => set_color(body, 1, &value),
                ("B", _) if color => set_color(body, 2, &value),
                ("X", Some(point_of)) if point => point_of.position_mm[0] = number(&value),
                ("Y", Some(point_of)) if point => point_of.position_mm[1] = number(&value),
                ("Z", Some(point_of)) if point => point_of.position_mm[2] = number(&value),
                ("Name", Some(point_of)) if point => point_of.name = value.into_owned(),
                _ => {}
            }
        }
        Ok(())
    }

    fn close(&mut self) {
        let text = std::mem::take(&mut self.text);
        let (parameters, text) = (&mut self.parameters, text.trim());
        match self.path.as_str() {
            "/General/Frequency" => parameters.frequency_hz = text.parse().ok(),
            "/The_3D/Label/Name" => {
                parameters.markers.get_or_insert_default().push(text.to_owned());
            }
            below => {
                if let Some(body) = last_body(parameters)
                    && let Some(place) = below.strip_prefix("/The_6D/Body/")
                {
                    set(body, place, text);
                }
            }
        }
        self.depth = self.depth.saturating_sub(1);
        self.path.truncate(self.path.rfind('/').unwrap_or(0));
    }

    fn finish(self) -> Result<QtmParameters, QtmParametersError> {
        let mut bodies = self.parameters.bodies.iter().flatten();
        match bodies.position(|body| body.name.is_empty()) {
            Some(index) => Err(QtmParametersError::NoName(index + 1)),
            None => Ok(self.parameters),
        }
    }
}

fn last_body(parameters: &mut QtmParameters) -> Option<&mut QtmBody> {
    parameters.bodies.as_mut()?.last_mut()
}

/// Sets the value of an element inside a body.
fn set(body: &mut QtmBody, place: &str, text: &str) {
    let point = body.points.last_mut();
    match (place, point) {
        ("Name", _) => body.name = text.to_owned(),
        ("RGBColor", _) => body.color = text.parse().unwrap_or_default(),
        ("Point/X", Some(point)) => point.position_mm[0] = number(text),
        ("Point/Y", Some(point)) => point.position_mm[1] = number(text),
        ("Point/Z", Some(point)) => point.position_mm[2] = number(text),
        _ => {}
    }
}

fn set_color(body: &mut QtmBody, part: usize, text: &str) {
    let mut parts = body.color.to_le_bytes();
    parts[part] = text.trim().parse().unwrap_or_default();
    body.color = u32::from_le_bytes(parts);
}

/// Number in the parameters; zero for invalid text, which does not invalidate the definition of markers.
fn number(text: &str) -> f64 {
    text.trim().parse().unwrap_or_default()
}
