//! The gate on the innovation: in flight a pose is believed if it lies where the commands sent can have brought the vehicle.

mod doubt;
mod stranger;

use oqtal_bus::code::Cause;
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{
    CommandHistory, CommandReport, FilterOptions, Integration, MeasuredPose, Surroundings, Track,
};

use crate::command::VehicleCommand;
use crate::command_model::CommandModel;
use crate::floor::LIFTING;
use crate::pose_noise::PoseNoise;
use doubt::{Doubt, DoubtVerdict};
use stranger::Stranger;

/// Poses in a row that agree with each other and not with the motion, after which they are of another body or of markers that
/// were exchanged \[-\].
const RELABEL_POSES: u32 = 3;
/// Greatest angle of a pose from the predicted attitude, however uncertain that has become \[rad\]: markers that were exchanged turn a
/// body by more, and a vehicle that no pose is believed of for so long that it may have turned as far must not be flown on.
const MOST_TURNED_RAD: f64 = 0.5;
/// Greatest innovation of a pose that agrees with the motion without a doubted one before it \[standard deviations\].
const DOUBT_SIGMA: f64 = 3.0;
/// Repetitions of a pose from which on its source may count as frozen \[-\].
const FROZEN_REPEATS: u32 = 2;
/// Predicted motion during which a pose cannot stay the same \[m\]: many times the resolution of a coarse source.
const CHANGED_M: f64 = 0.02;
/// Predicted rotation during which it cannot \[rad\].
const CHANGED_RAD: f64 = 0.06;
/// Longest prediction with which a pose that stays the same is compared, because of the error of the velocity \[s\].
const LONGEST_PREDICTION_S: f64 = 0.15;
/// Time after which a vehicle on the floor must have been lifted by a thrust above [`LIFTING`] \[s\].
const LIFTED_S: f64 = 0.12;

/// The last refused pose.
#[derive(Clone, Copy, Debug)]
struct Refused {
    stranger: Stranger,
    /// How many agreed with it in a row \[-\].
    poses: u32,
}

/// The gate on the innovation.
#[derive(Clone, Debug)]
pub struct MotionGate {
    commands: CommandModel,
    history: CommandHistory,
    options: FilterOptions,
    /// Greatest innovation of a pose that is believed \[standard deviations\].
    sigma: f64,
    /// The motion at the last pose that was believed; `None` on the ground.
    track: Option<Track>,
    /// When that pose was measured \[s\]: the motion may have been carried forward since.
    seen_s: f64,
    /// The last believed pose that is doubted.
    doubt: Option<Doubt>,
    /// The motion since which a pose that stays the same is compared with the prediction.
    changed: Option<Track>,
    noise: PoseNoise,
    /// Height of the floor from which the flight began \[m, world z\].
    floor_m: f64,
    refused: Option<Refused>,
}

impl MotionGate {
    /// The gate of `config`, on the ground.
    ///
    /// # Errors
    /// The vehicle has no model.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        let mut commands = CommandModel::new(config)?;
        commands.model.integration = Integration::Coarse;
        Ok(Self {
            commands,
            history: CommandHistory::new(config.vehicle.command_delay_ms * 1e-3),
            options: config.safety.filter,
            sigma: config.safety.gate_sigma,
            track: None,
            seen_s: 0.0,
            doubt: None,
            changed: None,
            noise: PoseNoise::default(),
            floor_m: 0.0,
            refused: None,
        })
    }

    /// Begins a flight with the vehicle at rest on the floor in `pose`, measured at `t_s` \[s\].
    pub fn begin(&mut self, t_s: f64, pose: &MeasuredPose) {
        self.end();
        self.track = Some(Track::at_rest(self.options, t_s, pose));
        (self.floor_m, self.changed, self.seen_s) = (pose.position.z, self.track, t_s);
    }

    /// Ends it: on the ground no motion is predicted.
    pub fn end(&mut self) {
        (self.track, self.doubt, self.changed, self.refused) = (None, None, None, None);
    }

    /// Records the command that was sent at `sent_s` \[s\].
    pub fn sent(&mut self, sequence: u64, sent_s: f64, command: &VehicleCommand) {
        self.history.push(sequence, sent_s, self.commands.input(command));
    }

    /// Records that a command took effect.
    pub fn applied(&mut self, report: CommandReport) {
        self.history.applied(report);
    }

    /// Delay from sending a command to its effect, as measured \[s\].
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.history.delay_s()
    }

    /// Whether a flight is under way, so that poses are compared with the predicted motion.
    #[must_use]
    pub fn is_flying(&self) -> bool {
        self.track.is_some()
    }

    /// Height of the floor from which the flight began \[m, world z\].
    #[must_use]
    pub fn floor_m(&self) -> f64 {
        self.floor_m
    }

    /// The motion predicted for `t_s` \[s\]; `None` on the ground.
    #[must_use]
    pub fn predict(&self, t_s: f64) -> Option<Track> {
        self.track.map(|track| track.advanced(t_s, &self.surroundings()))
    }

    /// Carries a motion that is older than `oldest_s` \[s\] forward to `t_s` \[s\].
    pub fn carry(&mut self, oldest_s: f64, t_s: f64) {
        if self.track.is_some_and(|track| track.t_s < oldest_s) {
            self.track = self.predict(t_s);
            self.doubt = None;
        }
    }

    /// Judges a pose in flight, measured at `t_s` \[s\]. On the ground every pose passes.
    ///
    /// # Errors
    /// Why the pose is not believed.
    pub fn judge(&mut self, t_s: f64, pose: &MeasuredPose) -> Result<(), Cause> {
        self.noise.take(pose);
        let Some(mut expected) = self.predict(t_s) else { return Ok(()) };
        let mut stranger = Stranger::of(&expected, pose);
        let mut without = self.doubt.map(|doubt| doubt.without(t_s, &self.surroundings()));
        if let Some(returned) = without.filter(|track| returns(track, &stranger, pose)) {
            // The doubted pose was an outlier: the motion is that without it.
            (expected, self.doubt, without) = (returned, None, None);
            stranger = Stranger::of(&expected, pose);
        }
        if !self.lies_on((&expected, &stranger), self.sigma) {
            let agrees =
                |track: &Track| self.lies_on((track, &Stranger::of(track, pose)), DOUBT_SIGMA);
            expected = without.filter(agrees).ok_or_else(|| self.refuse(stranger))?;
            stranger = Stranger::of(&expected, pose);
        }
        if self.is_frozen(t_s) {
            return Err(Cause::Frozen);
        }
        self.settle_doubt((&expected, &stranger), without, pose)?;
        self.refused = None;
        self.track = Some(expected.corrected(&stranger.0, self.floor_m));
        self.seen_s = t_s;
        let is_over = self.changed.is_none_or(|changed| t_s - changed.t_s > LONGEST_PREDICTION_S);
        if self.noise.repeats() == 0 || is_over || self.may_stand(&expected) {
            self.changed = self.track;
        }
        Ok(())
    }

    /// Judges the doubt about the last poses by `pose`, which is `stranger` relative to `expected`, or begins one; `without` is the
    /// motion without them.
    fn settle_doubt(
        &mut self,
        (expected, stranger): (&Track, &Stranger),
        without: Option<Track>,
        pose: &MeasuredPose,
    ) -> Result<(), Cause> {
        let verdict = self.doubt.zip(without).map(|(doubt, without)| doubt.judge(&without, pose));
        match verdict {
            Some(DoubtVerdict::Open(doubt)) => self.doubt = Some(doubt),
            Some(DoubtVerdict::Relabel(without, stranger)) => {
                self.track = Some(without);
                self.refused = Some(Refused { stranger, poses: RELABEL_POSES });
                self.doubt = None;
                return Err(Cause::Relabel);
            }
            Some(DoubtVerdict::Settled) | None => {
                self.doubt = Doubt::about(expected, *stranger, expected.t_s - self.seen_s);
            }
        }
        Ok(())
    }

    /// Whether a pose that is `stranger` relative to `expected` agrees with that motion, and not with the poses refused before it: what was refused is not
    /// believed because the uncertainty has grown since. Poses of another body are refused until one is where the vehicle is.
    fn lies_on(&self, (expected, stranger): (&Track, &Stranger), sigma: f64) -> bool {
        let is_refused = self.refused.is_some_and(|refused| match refused.poses {
            RELABEL_POSES.. => stranger.is_off(),
            _ => refused.stranger.agrees(stranger),
        });
        // A comparison with NaN is false.
        expected.innovation(&stranger.0).sigma() <= sigma
            && stranger.turn_rad() <= MOST_TURNED_RAD
            && !is_refused
    }

    /// Records a refused pose, and returns why.
    fn refuse(&mut self, stranger: Stranger) -> Cause {
        let poses = match self.refused {
            Some(refused) if refused.poses >= RELABEL_POSES => RELABEL_POSES,
            Some(refused) if refused.stranger.agrees(&stranger) => refused.poses + 1,
            _ => 1,
        };
        self.refused = Some(Refused { stranger, poses });
        if poses >= RELABEL_POSES { Cause::Relabel } else { Cause::Jump }
    }

    /// Whether the pose stays the same, up to `t_s` \[s\], although it must have changed: because of its noise, or because of the
    /// motion predicted without the poses that stayed the same.
    fn is_frozen(&self, t_s: f64) -> bool {
        let Some(before) = self.changed.as_ref().filter(|_| self.noise.repeats() >= FROZEN_REPEATS)
        else {
            return false;
        };
        if self.noise.is_frozen() {
            return true;
        }
        let after = before.advanced(t_s, &self.surroundings());
        let (from, to) = (&before.motion, &after.motion);
        let is_lifted = after.is_at_floor(self.floor_m) && t_s - before.t_s > LIFTED_S;
        is_lifted
            || (to.position - from.position).norm() > CHANGED_M
            || from.attitude.angle_to(&to.attitude) > CHANGED_RAD
    }

    /// Whether the vehicle may stand on the floor: it is there, and its thrust need not lift it.
    fn may_stand(&self, track: &Track) -> bool {
        let model = &self.commands.model;
        track.is_at_floor(self.floor_m)
            && track.motion.thrust_n < LIFTING * model.mass_kg * model.gravity_m_s2
    }

    fn surroundings(&self) -> Surroundings<'_> {
        let Self { commands, history, floor_m, .. } = self;
        Surroundings { model: &commands.model, history, floor_m: *floor_m }
    }
}

/// Whether `pose` is where the motion `without` a doubted pose is, and nearer to it than it is, as `stranger`, to the motion with it.
fn returns(without: &Track, stranger: &Stranger, pose: &MeasuredPose) -> bool {
    let off = Stranger::of(without, pose);
    !off.is_off() && off.distance_m() < stranger.distance_m()
}
