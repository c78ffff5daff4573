//! Served bodies: names, markers in body axes, and positions of the markers in a frame.

use std::net::Ipv4Addr;

use oqtal_wire::motion::{BodySample, MarkerSample};
use oqtal_wire::natnet::{BodyDefinition, NatNetServerOptions, NatNetVersion};
use oqtal_wire::qtm::{QtmBody, QtmParameters, QtmPoint};

/// Greatest number of bodies \[-\].
pub const MAX_BODIES: usize = 32;

/// Markers of every body \[m, body\]: on the four arms of a Hummingbird, at heights that no rotation maps onto each other.
const MARKERS_M: [[f64; 3]; 4] =
    [[0.17, 0.0, 0.02], [0.0, 0.17, 0.035], [-0.14, 0.03, 0.05], [0.02, -0.17, 0.025]];

/// The served bodies.
#[derive(Clone, Debug)]
pub struct BodyModels {
    names: Vec<String>,
    rate_hz: f64,
}

impl BodyModels {
    /// Bodies with these names, at most [`MAX_BODIES`], at this frame rate \[Hz\].
    pub fn new(names: &[String], rate_hz: f64) -> Self {
        Self { names: names.iter().take(MAX_BODIES).cloned().collect(), rate_hz }
    }

    /// Names in the order of every frame.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Rate of the frames \[Hz\].
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// The parameters of a QTM server.
    pub fn to_qtm(&self) -> QtmParameters {
        let points = |name: &str| {
            let points = (1..).zip(MARKERS_M);
            points.map(|(number, at)| point(format!("{name} - {number}"), at)).collect::<Vec<_>>()
        };
        let body = |name: &String| QtmBody {
            name: name.clone(),
            color: 0x0000_FF00,
            points: points(name),
        };
        let labels = self.names.iter().flat_map(|name| points(name)).map(|point| point.name);
        QtmParameters {
            frequency_hz: Some(self.rate_hz.round() as u32),
            markers: Some(labels.collect()),
            bodies: Some(self.names.iter().map(body).collect()),
        }
    }

    /// The options of a NatNet server of this version that sends frames to the group `multicast`; numbers of bodies from 1.
    pub fn to_natnet(
        &self,
        version: NatNetVersion,
        multicast: Option<Ipv4Addr>,
    ) -> NatNetServerOptions {
        let definition = |(id, name): (i32, &String)| BodyDefinition {
            name: name.clone(),
            id,
            markers_m: MARKERS_M.to_vec(),
        };
        let bodies = (1..).zip(&self.names).map(definition).collect();
        let rate_hz = self.rate_hz as f32;
        NatNetServerOptions { version, multicast, rate_hz, bodies, ..Default::default() }
    }

    /// The markers of a frame; markers of an untracked body are untracked.
    pub fn markers(&self, bodies: &[BodySample], markers: &mut Vec<MarkerSample>) {
        markers.clear();
        for BodySample { pose, residual_m } in bodies {
            markers.extend(MARKERS_M.map(|at| MarkerSample {
                position_m: pose.map(|pose| pose.transformed(at)),
                residual_m: *residual_m,
            }));
        }
    }
}

fn point(name: String, at_m: [f64; 3]) -> QtmPoint {
    QtmPoint { name, position_mm: at_m.map(|x| x * 1e3) }
}
