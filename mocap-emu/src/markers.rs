//! Pose from simulated markers: image points in every camera, triangulated markers, a rigid body fitted to them.
//!
//! | file | subject |
//! |---|---|
//! | `camera.rs` | a camera |
//! | `triangulation.rs` | a marker from its image points |
//! | `rigid_body.rs` | a body from its markers |
//! | `mishaps.rs` | hidden and swapped markers |
//!
//! The noise of the pose is not configured: it follows from pixel noise, geometry and visibility.

mod camera;
mod mishaps;
mod rigid_body;
mod triangulation;

use nalgebra::{Vector2, Vector3};
use oqtal_bus::message::{PoseV1, TruthV1};
use oqtal_config::{CameraOptions, MarkerOptions, MocapOptions};
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand_distr::{Distribution, StandardNormal};

use crate::body::BODY;
pub use camera::PinholeCamera;
use mishaps::{MOST_MARKERS, Mishaps};
pub use rigid_body::{BodyFit, fit};
pub use triangulation::{MarkerPoint, Sighting, triangulate};

/// Random words reserved for each frame: sixteen cameras times sixteen markers need about 1100.
const WORDS_PER_FRAME: u128 = 8192;

/// Markers and body that the cameras reconstruct from one frame.
#[derive(Clone, Copy, Debug)]
pub struct MarkerFrame {
    /// The markers by their numbers on the body, as labelled by the camera system; `None` for a marker that was not triangulated.
    pub markers: [Option<MarkerPoint>; MOST_MARKERS],
    /// The body fitted to them; `None` if it is not tracked.
    pub body: Option<BodyFit>,
}

/// Cameras and markers. Pure; a frame depends on the seed, its number, and the marker errors of earlier frames. No frame
/// allocates.
#[derive(Clone, Debug)]
pub struct MarkerCameras {
    options: CameraOptions,
    marker_options: MarkerOptions,
    cameras: Vec<PinholeCamera>,
    /// Positions of the markers \[m, body\].
    places: Vec<Vector3<f64>>,
    generator: Generator,
    mishaps: Mishaps,
    /// Image points of the present frame, by marker and camera.
    images: Vec<Option<Vector2<f64>>>,
}

impl MarkerCameras {
    /// The cameras and markers of a configuration.
    pub fn new(mocap: &MocapOptions, seed: u64) -> Self {
        let cameras = PinholeCamera::all(&mocap.cameras);
        let places: Vec<_> =
            mocap.markers.positions_m.iter().map(|place| Vector3::from(*place)).collect();
        Self {
            options: mocap.cameras.clone(),
            marker_options: mocap.markers.clone(),
            images: vec![None; cameras.len() * places.len()],
            cameras,
            places,
            generator: stream(seed, RandomSource::Markers),
            mishaps: Mishaps::default(),
        }
    }

    /// Takes a frame of the true state.
    pub fn observe(&mut self, truth: &TruthV1) -> MarkerFrame {
        self.generator.set_word_pos(u128::from(truth.capture) * WORDS_PER_FRAME);
        self.mishaps.advance(&self.marker_options, self.places.len(), &mut self.generator);
        self.take_images(truth);
        let mut markers = [None; MOST_MARKERS];
        for marker in 0..self.places.len() {
            let point = triangulate(self.sightings(marker));
            let limit = self.marker_options.max_reprojection_px;
            markers[self.mishaps.taken_for(marker)] =
                point.filter(|point| point.reprojection_px() <= limit);
        }
        MarkerFrame { markers, body: self.fit(&markers) }
    }

    /// The pose of a frame, as a message.
    pub fn pose(&mut self, truth: &TruthV1) -> PoseV1 {
        let body = self.observe(truth).body;
        PoseV1 {
            position: body.map_or([f64::NAN; 3], |fit| fit.position.into()),
            attitude: body.map_or([f64::NAN; 4], |fit| fit.attitude.xyzw()),
            residual_m: body.map_or(f64::NAN, |fit| fit.residual_m),
            body: BODY,
            tracked: u8::from(body.is_some()),
            simulated: 1,
            ..PoseV1::default()
        }
    }

    /// Fills in the image points: those of markers in view, in front of the hull, with noise.
    fn take_images(&mut self, truth: &TruthV1) {
        let attitude = Attitude::from_xyzw(truth.attitude).unwrap_or_default();
        // The middle of the exposure.
        let after_s = self.options.exposure_ms * 0.5e-3;
        let position = Vector3::from(truth.position) + Vector3::from(truth.velocity) * after_s;
        let attitude = attitude.turned_by(Vector3::from(truth.rate) * after_s);
        let count = self.cameras.len();
        for (k, image) in self.images.iter_mut().enumerate() {
            let (marker, camera) = (k / count, k % count);
            // Noise is drawn in any case, so that hidden markers do not change the noise of visible ones.
            let [x, y] =
                [(); 2].map(|()| Distribution::<f64>::sample(&StandardNormal, &mut self.generator));
            let is_hidden = self.marker_options.hidden.contains(&(marker + 1))
                || self.options.covered.contains(&(camera + 1))
                || !self.mishaps.shows(marker);
            let (place, camera) = (&self.places[marker], &self.cameras[camera]);
            let eye = attitude.to_body(&(camera.position() - position));
            *image = if is_hidden || hides(&self.marker_options.hull_m, place, &eye) {
                None
            } else {
                camera.image(&(position + attitude.to_world(place)))
            };
            let noise = Vector2::new(x, y) * self.options.pixel_noise_px;
            *image = image.map(|pixel| pixel + noise);
        }
    }

    fn sightings(&self, marker: usize) -> impl Iterator<Item = Sighting<'_>> + Clone {
        let count = self.cameras.len();
        let images = &self.images[marker * count..(marker + 1) * count];
        let seen = self.cameras.iter().zip(images);
        seen.filter_map(|(camera, image)| image.map(|pixel| Sighting { camera, pixel }))
    }

    /// The body fitted to `markers`, if there are enough of them and they agree.
    fn fit(&self, markers: &[Option<MarkerPoint>; MOST_MARKERS]) -> Option<BodyFit> {
        let pairs = self.places.iter().zip(markers);
        let pairs = pairs.filter_map(|(place, point)| point.map(|point| (*place, point.position)));
        if pairs.clone().count() < self.marker_options.least_visible {
            return None;
        }
        fit(pairs).filter(|fit| fit.residual_m <= self.marker_options.max_residual_mm * 1e-3)
    }
}

/// Whether the ellipsoid of semi-axes `hull` \[m, body\] is between `place` and `eye` \[m, body\].
fn hides(hull: &[f64; 3], place: &Vector3<f64>, eye: &Vector3<f64>) -> bool {
    if hull.contains(&0.0) {
        return false;
    }
    let scaled = |point: &Vector3<f64>| point.component_div(&Vector3::from(*hull));
    let (from, to) = (scaled(place), scaled(eye));
    let way = to - from;
    let share = (-from.dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
    (from + way * share).norm() < 1.0
}
