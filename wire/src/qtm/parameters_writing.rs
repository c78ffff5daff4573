//! Parameters as XML, in the two generations of the protocol.

use std::io;

use quick_xml::Writer;
use quick_xml::events::{BytesText, Event};

use super::parameters::{QtmBody, QtmParameters};
use super::selection::ParameterSelection;
use super::version::QtmVersion;

/// Names of the Euler angles that [`crate::motion::RigidPose::euler_xyz_deg`] returns.
const EULER: [(&str, &str); 3] = [("First", "Roll"), ("Second", "Pitch"), ("Third", "Yaw")];
/// Longest time of a capture that is reported \[s\].
const CAPTURE_TIME_S: u32 = 3600;

type Xml = Writer<Vec<u8>>;

impl QtmParameters {
    /// Writes the requested and existing sections, as a server of this version does.
    pub fn to_xml(&self, version: QtmVersion, selection: ParameterSelection) -> String {
        let mut xml = Writer::new(Vec::new());
        let root = format!("QTM_Parameters_Ver_{version}");
        let written = parent(&mut xml, &root, |xml| {
            if let Some(hz) = self.frequency_hz.filter(|_| selection.general) {
                general(xml, hz)?;
            }
            if let Some(labels) = self.markers.as_ref().filter(|_| selection.markers) {
                markers(xml, labels)?;
            }
            if let Some(bodies) = self.bodies.as_ref().filter(|_| selection.bodies) {
                parent(xml, "The_6D", |xml| bodies_section(xml, bodies, version))?;
            }
            Ok(())
        });
        // A vector takes every byte, and what is written to it is UTF-8.
        written.ok().and_then(|()| String::from_utf8(xml.into_inner()).ok()).unwrap_or_default()
    }
}

/// Writes an element with children.
fn parent(
    xml: &mut Xml,
    name: &str,
    children: impl FnOnce(&mut Xml) -> io::Result<()>,
) -> io::Result<()> {
    xml.create_element(name).write_inner_content(children).map(drop)
}

/// Writes an element with a text. Control characters, which XML has no form for, are left out.
fn leaf(xml: &mut Xml, name: &str, text: &str) -> io::Result<()> {
    let text: String = text.chars().filter(|letter| !letter.is_control()).collect();
    xml.create_element(name).write_text_content(BytesText::new(&text)).map(drop)
}

/// Writes an element with attributes alone.
fn empty(xml: &mut Xml, name: &str, attributes: &[(&str, String)]) -> io::Result<()> {
    let attributes = attributes.iter().map(|(key, value)| (*key, value.as_str()));
    xml.create_element(name).with_attributes(attributes).write_empty().map(drop)
}

fn general(xml: &mut Xml, hz: u32) -> io::Result<()> {
    parent(xml, "General", |xml| {
        leaf(xml, "Frequency", &hz.to_string())?;
        leaf(xml, "Capture_Time", &CAPTURE_TIME_S.to_string())
    })
}

fn markers(xml: &mut Xml, labels: &[String]) -> io::Result<()> {
    parent(xml, "The_3D", |xml| {
        leaf(xml, "AxisUpwards", "+Z")?;
        leaf(xml, "CalibrationTime", "")?;
        leaf(xml, "Labels", &labels.len().to_string())?;
        for label in labels {
            parent(xml, "Label", |xml| {
                leaf(xml, "Name", label)?;
                leaf(xml, "RGBColor", "65280")
            })?;
        }
        Ok(())
    })
}

fn bodies_section(xml: &mut Xml, bodies: &[QtmBody], version: QtmVersion) -> io::Result<()> {
    let new = version >= QtmVersion::NEW_PARAMETERS;
    leaf(xml, "Bodies", &bodies.len().to_string())?;
    for body in bodies {
        parent(xml, "Body", |xml| if new { new_body(xml, body) } else { old_body(xml, body) })?;
    }
    parent(xml, "Euler", |xml| EULER.iter().try_for_each(|(place, name)| leaf(xml, place, name)))
}

/// A body before version 1.21.
fn old_body(xml: &mut Xml, body: &QtmBody) -> io::Result<()> {
    leaf(xml, "Name", &body.name)?;
    leaf(xml, "RGBColor", &body.color.to_string())?;
    for point in &body.points {
        parent(xml, "Point", |xml| {
            for (axis, value) in ["X", "Y", "Z"].iter().zip(point.position_mm) {
                leaf(xml, axis, &value.to_string())?;
            }
            leaf(xml, "Virtual", "0")?;
            leaf(xml, "PhysicalId", "0")
        })?;
    }
    Ok(())
}

/// A body from version 1.21 on.
fn new_body(xml: &mut Xml, body: &QtmBody) -> io::Result<()> {
    let [red, green, blue, _] = body.color.to_le_bytes();
    let color = [("R", red), ("G", green), ("B", blue)].map(|(key, part)| (key, part.to_string()));
    leaf(xml, "Name", &body.name)?;
    leaf(xml, "Enabled", "true")?;
    empty(xml, "Color", &color)?;
    leaf(xml, "MaximumResidual", "10")?;
    leaf(xml, "MinimumMarkersInBody", "3")?;
    leaf(xml, "BoneLengthTolerance", "5")?;
    empty(xml, "Filter", &[("Preset", "No filter".to_owned())])?;
    mesh(xml)?;
    parent(xml, "Points", |xml| points(xml, body))?;
    let origin = ["X", "Y", "Z", "Relative_body"].map(|key| (key, "0".to_owned()));
    attributed(xml, "Data_origin", &origin)?;
    let mut rotation = Vec::with_capacity(10);
    for (row, column) in (1..=3).flat_map(|row| (1..=3).map(move |column| (row, column))) {
        rotation.push((format!("R{row}{column}"), u8::from(row == column).to_string()));
    }
    rotation.push(("Relative_body".to_owned(), "0".to_owned()));
    let rotation: Vec<(&str, String)> =
        rotation.iter().map(|(key, value)| (key.as_str(), value.clone())).collect();
    attributed(xml, "Data_orientation", &rotation)
}

fn points(xml: &mut Xml, body: &QtmBody) -> io::Result<()> {
    for point in &body.points {
        let [x, y, z] = point.position_mm.map(|value| value.to_string());
        let ids = [("Virtual", "0".to_owned()), ("PhysicalId", "0".to_owned())];
        let name = point.name.chars().filter(|letter| !letter.is_control()).collect();
        let place = [("X", x), ("Y", y), ("Z", z)];
        let all: Vec<_> = place.into_iter().chain(ids).chain([("Name", name)]).collect();
        empty(xml, "Point", &all)?;
    }
    Ok(())
}

/// The shape that is shown for a body: none.
fn mesh(xml: &mut Xml) -> io::Result<()> {
    parent(xml, "Mesh", |xml| {
        leaf(xml, "Name", "")?;
        let zero = ["X", "Y", "Z"].map(|axis| (axis, "0".to_owned()));
        empty(xml, "Position", &zero)?;
        empty(xml, "Rotation", &zero)?;
        leaf(xml, "Scale", "1")?;
        leaf(xml, "Opacity", "1")
    })
}

/// Writes an element with attributes and the text `0`: the volume's own origin and axes.
fn attributed(xml: &mut Xml, name: &str, attributes: &[(&str, String)]) -> io::Result<()> {
    let attributes = attributes.iter().map(|(key, value)| (*key, value.as_str()));
    let element = xml.create_element(name).with_attributes(attributes);
    element.write_inner_content(|xml| xml.write_event(Event::Text(BytesText::new("0")))).map(drop)
}
