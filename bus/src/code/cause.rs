//! Causes of safety states and of refused requests.

use std::fmt;

code! {
    /// Cause of a safety state, or of a refused request.
    Cause {
        /// No cause: nominal.
        None = 0 => "",
        /// No pose arrived in time.
        NoPose = 1 => "no pose",
        /// Poses arrive, but too old.
        Stale = 2 => "stale pose",
        /// A pose is not finite.
        NotFinite = 3 => "pose not finite",
        /// The cameras lost the body.
        Untracked = 4 => "body not tracked",
        /// The quaternion is not of unit norm.
        NotUnit = 5 => "quaternion not of unit norm",
        /// Sequence number or capture time did not increase.
        Order = 6 => "pose out of order",
        /// The pose cannot have resulted from the sent commands.
        Jump = 7 => "pose jumped",
        /// The same pose was repeated with new sequence numbers.
        Frozen = 8 => "pose frozen",
        /// Requested by an operator.
        Operator = 9 => "operator",
        /// Not possible in the present mode.
        WrongMode = 10 => "not possible in this mode",
        /// Neither plant nor bridge answers, the vehicle behind the bridge does not answer, or another process replaced the plant
        /// or bridge.
        NoVehicle = 11 => "vehicle silent",
        /// Poses agree with each other but not with the predicted motion: they are of another body or of swapped markers, or the
        /// vehicle does not move as its model predicts.
        Relabel = 12 => "poses not as predicted",
        /// The vehicle came too close to the fence, or crossed it.
        Fence = 13 => "fence",
        /// The vehicle is faster than allowed.
        Speed = 14 => "too fast",
        /// The vehicle is tilted further than allowed.
        Tilt = 15 => "tipped",
        /// The vehicle is too far from its reference for too long.
        Tracking = 16 => "far from its reference",
        /// The thrust does not lift the vehicle.
        NoLift = 17 => "thrust does not lift",
        /// The battery voltage is low.
        Battery = 18 => "battery low",
        /// Too few requests to the vehicle are answered.
        Link = 19 => "link poor",
        /// Poses arrive, but late.
        PosesLate = 20 => "poses late",
        /// Too many frames are lost or refused.
        PosesLost = 21 => "poses lost",
        /// The landing does not end.
        Landing = 22 => "landing does not end",
        /// The vehicle lies on the floor with thrust.
        Crash = 23 => "on the floor with thrust",
        /// The loop was late several times in a row.
        Overrun = 24 => "loop late",
        /// Processes run with different configurations.
        Configuration = 25 => "configurations differ",
        /// The reference is invalid; the last valid one is held.
        Setpoint = 26 => "set-point refused",
        /// The fence held the flight for too long.
        HeldTooLong = 27 => "held by the fence for too long",
        /// Obstacles prevent a flight; the reply lists them.
        NotReady = 28 => "not ready",
        /// A pilot or the vehicle itself took control: a flight ends, and no commands are sent.
        ControlTaken = 29 => "another has control",
        /// The fallback law flies: the configured law failed.
        Fallback = 35 => "fallback law",
        /// The poses do not follow the rotation or the tilt of the vehicle: they are frozen, mirrored or turned.
        Contradiction = 30 => "poses do not follow the vehicle",
        /// A planner's references stopped.
        ReferencesEnded = 36 => "references ended",
        /// A setting is invalid, or cannot change while the daemon runs.
        Setting = 37 => "setting refused",
        /// The flight takes off.
        TakeOff = 38 => "during the take-off",
        /// The request was read after the operator's time-out for the answer.
        Expired = 40 => "request came too late",
        /// The operator expects another configuration of the daemon.
        OtherConfig = 41 => "another configuration expected",
        /// In flight: the motors did not start, or stopped.
        MotorsNotRunning = 42 => "motors not running",
        /// A file of the instance was removed, so that no process can join it any more.
        FilesLost = 43 => "files of the instance removed",
        /// The way of a request comes too close to the floor.
        NearFloor = 44 => "too close to the floor",
        /// The daemon only observes: it executes no request that commands a vehicle, but a stop.
        ObservesOnly = 45 => "safety.observe-only or mocap.replay is set",
        /// A stop, a landing or a disarming that was requested later called the requested flight off.
        CalledOff = 46 => "called off by a later stop, landing or disarming",
        /// No external law is connected.
        NoLaw = 47 => "no law is connected",
        /// In the health of a receiver: the camera system has no body of this name.
        NoBody = 48 => "no such body",
        /// In the health of a receiver: frames come without stamps by which they can be dated.
        NoStamps = 49 => "no usable stamps",
        /// The daemon of the instance before this one ended while its vehicle flew.
        EndedInFlight = 50 => "the daemon before this one ended in flight",
    }
}

impl Cause {
    /// Whether a request that is refused for this cause was not executed by the loop of the daemon.
    pub fn prevents_execution(self) -> bool {
        matches!(self, Self::Expired | Self::CalledOff)
    }
}
