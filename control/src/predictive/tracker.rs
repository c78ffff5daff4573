//! The only estimate of the vehicle's motion. It contains the commands in transit, the resulting motion, and the predictive
//! model. The gate uses it for the expected pose, the limits for the future motion, and predictive laws for control.
//!
//! For a law that does not predict, the model is the configured one and the noise that of admission. For one that predicts, the
//! model is the adapted one, and the motion is estimated with the noise of an undisturbed flight ([`Track`]). The adaptation uses
//! only admitted poses, within its bounds, continues under any law that follows in the same flight, and is reset on the ground.

use super::adaptation::{Adaptation, AdaptedModel};
use super::history::{CommandEffect, CommandHistory, CommandReport};
use super::model::{Bias, Integration, ModelInput, Motion, VehicleModel};
use super::options::{FilterOptions, PredictiveOptions};
use super::track::{Deviation, FilterInnovation, MeasuredPose, Propagation, Track, TrackNoise};
use crate::estimator::Estimate;

/// Fraction of the weight that the thrust reaches when the vehicle is about to leave the floor \[-\].
const LIFTING: f64 = 0.9;

/// Lower bound of the noise that a predictive law assumes, as a share of the measured noise \[-\].
const ESTIMATED_SHARE: f64 = 0.8;

/// Distance of a pose from the predicted position above which a tracker without a gate restarts at the pose \[m\].
const LOST_M: f64 = 1.0;

/// Motion of a vehicle, and the commands in transit to it. No method allocates.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTracker {
    /// The configured model.
    nominal: VehicleModel,
    /// The model that predicts: the configured one, adapted.
    model: VehicleModel,
    /// The configured noise.
    expected: TrackNoise,
    /// The noise in use: the configured one, or the measured one where it is greater.
    noise: TrackNoise,
    history: CommandHistory,
    /// Adaptation of the model; `None` for a fixed model.
    adaptation: Option<Adaptation>,
    /// Height of the floor from which the flight began \[m, world z\].
    floor_m: f64,
    /// On the ground: the motion of the last pose.
    resting: Option<Motion>,
    /// In flight: the motion at the last admitted pose, or later.
    track: Option<Track>,
    /// Innovation of the last admitted pose; `None` on the ground.
    innovation: Option<FilterInnovation>,
}

impl MotionTracker {
    /// The tracker of a vehicle on the ground with the model `model`, for a law that does not predict. Poses are admitted with the
    /// noise `admission`; `delay_s` is the delay from sending a command to its effect until one is measured \[s\].
    pub fn new(model: VehicleModel, admission: FilterOptions, delay_s: f64) -> Self {
        let expected = TrackNoise { admission, estimation: None };
        Self {
            nominal: model,
            model,
            expected,
            noise: expected,
            history: CommandHistory::new(delay_s),
            adaptation: None,
            floor_m: 0.0,
            resting: None,
            track: None,
            innovation: None,
        }
    }

    /// The same for a law that flies on the tracked motion.
    pub fn predictive(self, options: &PredictiveOptions) -> Self {
        let adaptation = options
            .adaptation
            .adapt
            .then(|| Adaptation::new(&options.adaptation, &options.filter, &self.nominal));
        let noise = TrackNoise { estimation: Some(options.filter), ..self.expected };
        Self { expected: noise, noise, adaptation, ..self }
    }

    /// Continues the flight with the model and the noise of `other`, for another law or other options. The adapted parameters are kept
    /// unless the bounds of the adaptation have changed, or `other` predicts with a fixed model.
    pub fn change_law(&mut self, other: &Self) {
        self.nominal = other.nominal;
        (self.expected, self.noise, self.innovation) = (other.expected, other.noise, None);
        self.adaptation = match (self.adaptation, other.adaptation) {
            (Some(own), Some(other)) => Some(own.continued_as(&other)),
            (Some(own), None) if other.expected.estimation.is_none() => Some(own),
            (_, other) => other,
        };
        self.adopt_model();
        self.track = self.track.map(|track| track.with_noise(&other.noise));
    }

    /// Begins a flight with the vehicle at rest in `pose`, measured at `t_s` \[s\], above a floor at `floor_m` \[m, world z\].
    pub fn begin(&mut self, t_s: f64, pose: &MeasuredPose, floor_m: f64) {
        self.track = Some(Track::at_rest(&self.noise, t_s, pose));
        (self.floor_m, self.innovation) = (floor_m, None);
        // The next flight may have another battery, load or vehicle.
        self.adaptation = self.adaptation.filter(|_| self.noise.estimation.is_some());
        self.adaptation.iter_mut().for_each(Adaptation::reset);
        self.adopt_model();
    }

    /// Ends the flight: on the ground no motion is predicted.
    pub fn end(&mut self) {
        self.resting = self.track.take().map(|track| track.motion).or(self.resting);
        self.innovation = None;
    }

    /// Takes the measured noise of positions \[m\] and attitudes \[rad\]. Where the measured noise is greater than the configured one, it
    /// is used instead; for a predictive law, only once it is greater by a quarter, since the measurement has an error too.
    pub fn set_measured_noise(&mut self, position_m: f64, attitude_rad: f64) {
        let estimation = self.expected.estimation.map(|expected| {
            expected
                .with_measured_noise(ESTIMATED_SHARE * position_m, ESTIMATED_SHARE * attitude_rad)
        });
        let admission = self.expected.admission.with_measured_noise(position_m, attitude_rad);
        self.noise = TrackNoise { admission, estimation };
        if let Some(track) = &mut self.track {
            track.set_noise(&self.noise);
        }
        if let Some((adaptation, filter)) = self.adaptation.as_mut().zip(estimation) {
            adaptation.set_noise(&filter);
        }
    }

    /// Takes the measured motion of a vehicle on the ground.
    pub fn rest(&mut self, measured: &Estimate) {
        self.resting = Some(Motion::of(measured, 0.0));
    }

    /// Records a command sent at `sent_s` \[s\]. It must be within the range of its interface, since the predicted motion is not bounded
    /// otherwise.
    pub fn sent(&mut self, sequence: u64, sent_s: f64, input: ModelInput) {
        self.history.push(sequence, sent_s, input);
    }

    /// Expected input in effect at `t_s` \[s\], with the adapted delay and gain, and the end of its effect \[s\].
    pub fn acting(&self, t_s: f64) -> (ModelInput, f64) {
        self.history.acting(t_s)
    }

    /// Records that a command took effect.
    pub fn applied(&mut self, report: CommandReport) {
        self.history.applied(report);
    }

    /// Marks commands with overdue reports as lost; to be called when the next command is to be sent.
    pub fn expect_reports(&mut self) {
        self.history.expect_reports();
    }

    /// Measured delay from sending a command to its effect \[s\].
    pub fn delay_s(&self) -> f64 {
        self.history.delay_s()
    }

    /// Delay from sending a command to its effect on the rotation, including the adapted part hidden from reports \[s\].
    pub fn effect_delay_s(&self) -> f64 {
        self.history.effect_delay_s()
    }

    /// Correction of the reported effect of commands.
    pub fn effect(&self) -> &CommandEffect {
        self.history.effect()
    }

    /// The model that predicts the motion.
    pub fn model(&self) -> &VehicleModel {
        &self.model
    }

    /// The adapted model, relative to the configured one; `None` if that one predicts.
    pub fn adapted(&self) -> Option<AdaptedModel> {
        self.adaptation.as_ref().map(Adaptation::model)
    }

    /// Height of the floor from which the flight began \[m, world z\].
    pub fn floor_m(&self) -> f64 {
        self.floor_m
    }

    /// The motion at the last admitted pose, or later; `None` on the ground.
    pub fn track(&self) -> Option<&Track> {
        self.track.as_ref()
    }

    /// The motion predicted for `t_s` \[s\] with its uncertainty; `None` on the ground.
    pub fn predict(&self, t_s: f64) -> Option<Track> {
        self.track.map(|track| self.advanced(&track, t_s))
    }

    /// The same prediction in coarse steps, for limits, where an error of a hundredth of a motion over few periods is acceptable.
    pub fn predict_coarsely(&self, t_s: f64) -> Option<Track> {
        let model = VehicleModel { integration: Integration::Coarse, ..self.model };
        let propagation = Propagation { model: &model, ..self.propagation() };
        self.track.map(|track| track.advanced(t_s, &propagation))
    }

    /// Motion predicted for `t_s` \[s\]; on the ground the motion at the last pose, `None` before the first.
    pub fn motion_at(&self, t_s: f64) -> Option<Motion> {
        match &self.track {
            Some(track) if t_s > track.t_s => Some(track.motion_at(t_s, &self.propagation())),
            Some(track) => Some(track.motion),
            None => self.resting,
        }
    }

    /// `track`, propagated to `t_s` \[s\] like the motion.
    pub fn advanced(&self, track: &Track, t_s: f64) -> Track {
        track.advanced(t_s, &self.propagation())
    }

    /// The estimated bias; zero on the ground.
    pub fn bias(&self) -> Bias {
        self.track.as_ref().map_or_else(Bias::default, Track::bias)
    }

    /// Motion at the last admitted pose and the innovation of that pose, for a law that uses it; `None` for other laws, and
    /// before the first pose.
    pub fn filtered(&self) -> Option<(&Motion, Option<&FilterInnovation>)> {
        self.noise.estimation.as_ref()?;
        let motion = self.track.as_ref().map(|track| &track.motion);
        motion.or(self.resting.as_ref()).map(|motion| (motion, self.innovation.as_ref()))
    }

    /// Propagates the motion to `t_s` \[s\] without a pose.
    pub fn propagate(&mut self, t_s: f64) {
        self.track = self.predict(t_s);
    }

    /// Replaces the motion.
    pub fn restore(&mut self, track: Track) {
        self.track = Some(track);
    }

    /// Corrects the prediction `expected` by an admitted pose, which deviates from it by `deviation`.
    pub fn correct(&mut self, expected: &Track, deviation: &Deviation, pose: &MeasuredPose) {
        let mut track = expected.corrected(deviation, self.floor_m);
        if self.noise.estimation.is_some() || self.adaptation.is_some() {
            let weight_n = self.model.mass_kg * self.model.gravity_m_s2;
            if track.motion.thrust_n >= LIFTING * weight_n {
                track = track.lifted();
            }
            let is_free = expected.is_lifted();
            self.innovation = is_free.then(|| expected.filter_innovation(deviation));
            self.adapt(&track, pose);
        }
        self.track = Some(track);
    }

    /// Takes a pose measured at `t_s` \[s\] without a gate. A pose that is not finite, or not later than the last one, is
    /// ignored; at a pose far from the prediction the motion restarts.
    pub fn take(&mut self, t_s: f64, pose: &MeasuredPose) {
        let Some(last_s) = self.track.as_ref().map(|track| track.t_s) else { return };
        let is_finite = pose.position.iter().all(|x| x.is_finite()) && pose.attitude.is_finite();
        // A comparison with NaN is false.
        if !(t_s > last_s && t_s.is_finite() && is_finite) {
            return;
        }
        let Some(expected) = self.predict(t_s) else { return };
        let deviation = expected.deviation(pose);
        if expected.motion.is_finite() && deviation.offset.norm() <= LOST_M {
            self.correct(&expected, &deviation, pose);
        } else {
            let mut track = Track::at_rest(&self.noise, t_s, pose);
            track.motion.thrust_n = self.model.mass_kg * self.model.gravity_m_s2;
            self.restore(track.lifted());
            self.adaptation.iter_mut().for_each(Adaptation::interrupt);
        }
    }

    fn adapt(&mut self, track: &Track, pose: &MeasuredPose) {
        if let Some(adaptation) = self.adaptation.as_mut().filter(|_| track.is_lifted()) {
            let vertical = track.bias().acceleration.z;
            adaptation.take(track.t_s, (pose, &track.motion, vertical), &self.history);
            self.adopt_model();
        }
    }

    /// Predicts with the adapted model from now on, without adaptation with the configured one.
    fn adopt_model(&mut self) {
        let adapted = self.adapted();
        self.model = adapted.map_or(self.nominal, |adapted| adapted.of(&self.nominal));
        self.history.set_effect(adapted.map_or_else(CommandEffect::default, |it| it.effect()));
    }

    fn propagation(&self) -> Propagation<'_> {
        Propagation { model: &self.model, history: &self.history, floor_m: self.floor_m }
    }
}
