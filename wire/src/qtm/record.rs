//! Bodies and markers on the wire, and their meaning.

use super::component::ComponentKind;
use crate::bytes::{ByteReader, ByteWriter};
use crate::motion::{BodySample, MarkerSample, RigidPose};

/// Orientation of a body on the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BodyOrientation {
    /// Rotation matrix from body to volume, column by column \[-\].
    Matrix([f32; 9]),
    /// Angles whose axes are a setting of the server; here Rx(a1) Ry(a2) Rz(a3) \[deg\].
    Euler([f32; 3]),
}

/// A body on the wire. Every number of a lost body is a NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyRecord {
    /// Position \[mm, volume\].
    pub position_mm: [f32; 3],
    /// Orientation.
    pub orientation: BodyOrientation,
    /// Residual, in the components that have one \[mm\].
    pub residual_mm: Option<f32>,
}

/// Reason why a record has no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoPose {
    /// The cameras do not see the body.
    #[error("the body is not tracked")]
    Lost,
    /// The numbers are not a pose.
    #[error("the numbers are not a pose")]
    Unsound,
    /// Euler angles about axes that are configured in the server.
    #[error("Euler angles have no meaning without the server's settings; ask for 6D or 6DRes")]
    Euler,
}

impl BodyRecord {
    /// The record of a body.
    pub fn new(kind: ComponentKind, body: &BodySample) -> Self {
        let euler = matches!(kind, ComponentKind::BodiesEuler | ComponentKind::BodiesEulerResidual);
        let nan = f32::from_bits(u32::MAX);
        let orientation = match (&body.pose, euler) {
            (Some(pose), true) => BodyOrientation::Euler(narrowed(pose.euler_xyz_deg())),
            (Some(pose), false) => BodyOrientation::Matrix(narrowed(pose.columns())),
            (None, true) => BodyOrientation::Euler([nan; 3]),
            (None, false) => BodyOrientation::Matrix([nan; 9]),
        };
        let position_mm =
            body.pose.map_or([nan; 3], |pose| narrowed(pose.position_m.map(|x| x * 1e3)));
        let residual_mm = body.pose.map_or(nan, |_| (body.residual_m * 1e3) as f32);
        Self { position_mm, orientation, residual_mm: kind.has_residual().then_some(residual_mm) }
    }

    /// Pose in the volume.
    ///
    /// # Errors
    /// The record has none.
    pub fn pose(&self) -> Result<RigidPose, NoPose> {
        let BodyOrientation::Matrix(columns) = self.orientation else { return Err(NoPose::Euler) };
        if self.position_mm.iter().chain(&columns).any(|number| number.is_nan()) {
            return Err(NoPose::Lost);
        }
        let position_m = self.position_mm.map(|x| f64::from(x) * 1e-3);
        RigidPose::from_columns(position_m, columns.map(f64::from)).ok_or(NoPose::Unsound)
    }

    pub(super) fn read(reader: &mut ByteReader<'_>, kind: ComponentKind) -> Option<Self> {
        let position_mm = reader.f32s()?;
        let orientation = match kind {
            ComponentKind::Bodies | ComponentKind::BodiesResidual => {
                BodyOrientation::Matrix(reader.f32s()?)
            }
            ComponentKind::BodiesEuler | ComponentKind::BodiesEulerResidual => {
                BodyOrientation::Euler(reader.f32s()?)
            }
            _ => return None,
        };
        let residual_mm = if kind.has_residual() { Some(reader.f32()?) } else { None };
        Some(Self { position_mm, orientation, residual_mm })
    }

    pub(super) fn write(&self, writer: &mut ByteWriter<'_>) {
        writer.f32s(&self.position_mm);
        match &self.orientation {
            BodyOrientation::Matrix(columns) => writer.f32s(columns),
            BodyOrientation::Euler(angles) => writer.f32s(angles),
        };
        if let Some(residual) = self.residual_mm {
            writer.f32(residual);
        }
    }
}

/// A marker on the wire. Every number of a lost labelled marker is a NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarkerRecord {
    /// Position \[mm, volume\].
    pub position_mm: [f32; 3],
    /// Identifier, in the components without labels \[-\].
    pub id: Option<u32>,
    /// Residual, in the components that have one \[mm\].
    pub residual_mm: Option<f32>,
}

impl MarkerRecord {
    /// The record of marker number `id` in a component of `kind`.
    pub fn new(kind: ComponentKind, id: u32, marker: &MarkerSample) -> Self {
        let nan = f32::from_bits(u32::MAX);
        let unlabelled =
            matches!(kind, ComponentKind::Unlabelled | ComponentKind::UnlabelledResidual);
        let residual_mm = marker.position_m.map_or(nan, |_| (marker.residual_m * 1e3) as f32);
        Self {
            position_mm: marker.position_m.map_or([nan; 3], |at| narrowed(at.map(|x| x * 1e3))),
            id: unlabelled.then_some(id),
            residual_mm: kind.has_residual().then_some(residual_mm),
        }
    }

    pub(super) fn read(reader: &mut ByteReader<'_>, kind: ComponentKind) -> Option<Self> {
        let position_mm = reader.f32s()?;
        let unlabelled =
            matches!(kind, ComponentKind::Unlabelled | ComponentKind::UnlabelledResidual);
        let id = if unlabelled { Some(reader.u32()?) } else { None };
        let residual_mm = if kind.has_residual() { Some(reader.f32()?) } else { None };
        Some(Self { position_mm, id, residual_mm })
    }

    pub(super) fn write(&self, writer: &mut ByteWriter<'_>) {
        writer.f32s(&self.position_mm);
        if let Some(id) = self.id {
            writer.u32(id);
        }
        if let Some(residual) = self.residual_mm {
            writer.f32(residual);
        }
    }
}

fn narrowed<const N: usize>(numbers: [f64; N]) -> [f32; N] {
    numbers.map(|number| number as f32)
}
