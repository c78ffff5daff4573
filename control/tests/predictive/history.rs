//! The history of commands.

use oqtal_control::predictive::{
    Bias, CommandEffect, CommandHistory, CommandReport, ModelInput, Motion,
};

use super::*;

fn thrust(thrust_n: f64) -> ModelInput {
    ModelInput { thrust_n, ..ModelInput::default() }
}

fn report(sequence: u64, acts_s: f64) -> CommandReport {
    CommandReport { sequence, acts_s, follows: true }
}

/// The thrust that a vehicle without lag has at `t_s`.
fn thrust_at(history: &CommandHistory, t_s: f64) -> f64 {
    let model = VehicleModel { thrust_lag_s: 0.0, ..quadrotor() };
    let state = (&Motion::default(), &Bias::default());
    history.propagate(&model, state, (0.0, t_s)).thrust_n
}

#[test]
fn a_command_acts_a_delay_after_it_was_sent_and_until_the_next_does() {
    let mut history = CommandHistory::new(DELAY_S);
    for (sequence, sent_s) in [(1, 0.1), (2, 0.3)] {
        history.push(sequence, sent_s, thrust(sequence as f64));
    }
    for (t_s, expected) in [(0.119, 0.0), (0.135, 1.0), (0.319, 1.0), (0.335, 2.0), (9.0, 2.0)] {
        assert!((thrust_at(&history, t_s) - expected).abs() < 1e-5, "at {t_s}");
    }
}

#[test]
fn the_delay_is_measured_from_the_reports_of_the_vehicle() {
    let mut history = CommandHistory::new(0.0);
    for sequence in 1..200 {
        let sent_s = sequence as f64 * PERIOD_S;
        history.push(sequence, sent_s, thrust(1.0));
        history.applied(report(sequence, sent_s + 0.03));
    }
    assert!((history.delay_s() - 0.03).abs() < 1e-6);
    // Neither an unknown command nor an impossible stamp changes it.
    history.applied(report(7_000, 0.0));
    history.applied(report(199, 1e3));
    history.applied(report(199, f64::NAN));
    assert!((history.delay_s() - 0.03).abs() < 1e-6);
}

#[test]
fn a_delay_found_in_the_rotation_delays_the_demand_and_not_the_thrust() {
    for hidden_s in [-0.01, 0.0, 0.02] {
        let mut history = CommandHistory::new(DELAY_S);
        history.push(1, 0.1, ModelInput { demand: Vector3::x(), ..thrust(1.0) });
        history.set_effect(CommandEffect { delay_s: hidden_s, gain: Vector3::repeat(0.5) });
        let acts_s = 0.1 + DELAY_S;
        // Longer than the thrust's shortest lag, shorter than the longest hidden delay.
        for (after_s, thrust_n) in [(-1e-3, 0.0), (15e-3, 1.0)] {
            let found = thrust_at(&history, acts_s + after_s);
            assert!((found - thrust_n).abs() < 1e-5, "{hidden_s}: {found} N");
        }
        let model = quadrotor();
        let rate = |t_s| {
            let state = (&Motion::default(), &Bias::default());
            history.propagate(&model, state, (0.0, t_s)).rate.x
        };
        assert_eq!(rate(acts_s + hidden_s - 1e-3), 0.0, "{hidden_s}");
        assert!(rate(acts_s + hidden_s + 1e-3) > 0.0, "{hidden_s}");
        assert!((rate(9.0) - 0.5).abs() < 1e-6, "{hidden_s}");
    }
}

#[test]
fn commands_that_are_not_finite_or_older_than_the_last_are_not_stored() {
    let mut history = CommandHistory::new(DELAY_S);
    history.push(1, 1.0, thrust(1.0));
    let before = history;
    history.push(2, 0.5, thrust(2.0));
    history.push(3, f64::NAN, thrust(3.0));
    assert_eq!(history, before);
}

/// A history of commands with the thrust of their number, one a period, of which some are reported lost by silence: those for which
/// `lost` is true. Reports come while one newer command is on its way.
fn reported(commands: u64, lost: impl Fn(u64) -> bool) -> CommandHistory {
    let mut history = CommandHistory::new(DELAY_S);
    for tick in 1..=commands {
        if tick > 2 && !lost(tick - 2) {
            history.applied(report(tick - 2, (tick - 2) as f64 * PERIOD_S + DELAY_S));
        }
        history.push(tick, tick as f64 * PERIOD_S, thrust(tick as f64));
    }
    history
}

/// When command `tick` acts, and a little.
fn effect_s(tick: u64) -> f64 {
    tick as f64 * PERIOD_S + DELAY_S + 1e-6
}

#[test]
fn a_command_whose_report_is_overdue_was_lost_and_the_last_one_acts_on() {
    let history = reported(100, |tick| (90..95).contains(&tick));
    for tick in 90..95 {
        assert_eq!(history.reported(effect_s(tick), 0.0).0.thrust_n, 89.0);
    }
    assert_eq!(history.reported(effect_s(95), 0.0).0.thrust_n, 95.0);
    // In a burst that lasts, only the last two commands are open.
    let history = reported(100, |tick| tick >= 90);
    assert_eq!(history.reported(effect_s(98), 0.0).0.thrust_n, 89.0);
    let open = history.reported(effect_s(99), 0.0).0.thrust_n;
    assert!(open > 89.0 && open < 99.0, "{open}");
}

#[test]
fn losses_are_expected_as_often_as_they_came() {
    // Bursts of five in fifty.
    let history = reported(5001, |tick| tick % 50 < 5);
    let [after_arrival, after_loss] = history.loss_probabilities();
    assert!((0.01..0.05).contains(&after_arrival), "{after_arrival}");
    assert!((0.7..0.9).contains(&after_loss), "{after_loss}");
    let none = reported(1000, |_| false);
    assert_eq!(none.loss_probabilities()[0], 0.0);
    assert_eq!(none.reported(effect_s(1000), 0.0).0.thrust_n, 1000.0);
}

#[test]
fn reports_that_were_missed_make_no_command_a_lost_one() {
    let mut history = CommandHistory::new(DELAY_S);
    for tick in 1..=100 {
        if tick > 2 && tick % 2 == 0 {
            let acts_s = (tick - 2) as f64 * PERIOD_S + DELAY_S;
            history.applied(CommandReport { follows: false, ..report(tick - 2, acts_s) });
        }
        history.push(tick, tick as f64 * PERIOD_S, thrust(tick as f64));
    }
    assert!(history.loss_probabilities()[0] < 0.05, "{:?}", history.loss_probabilities());
    assert_eq!(history.reported(effect_s(95), 0.0).0.thrust_n, 95.0);
}

#[test]
fn a_vehicle_without_reports_is_predicted_from_the_sent_commands() {
    let mut history = CommandHistory::new(DELAY_S);
    for tick in 1..=100 {
        history.push(tick, tick as f64 * PERIOD_S, thrust(tick as f64));
    }
    assert_eq!(history.reported(effect_s(60), 0.0).0.thrust_n, 60.0);
}

proptest! {
    /// Propagation in two parts equals propagation in one.
    #[test]
    fn prediction_is_a_flow(
        demands in prop::collection::vec(vector(2.0), 5),
        rate in vector(1.0),
        split_s in 0.0..0.2_f64,
    ) {
        let mut history = CommandHistory::new(DELAY_S);
        for (k, demand) in (0_u32..).zip(&demands) {
            let thrust_n = 4.0 + f64::from(k);
            let input = ModelInput { demand: *demand, thrust_n, ..ModelInput::default() };
            history.push(u64::from(k), f64::from(k) * PERIOD_S, input);
        }
        let (model, bias) = (quadrotor(), Bias::default());
        let start = Motion { rate, thrust_n: 4.905, ..Motion::default() };
        let whole = history.propagate(&model, (&start, &bias), (0.0, 0.2));
        let part = history.propagate(&model, (&start, &bias), (0.0, split_s));
        let parts = history.propagate(&model, (&part, &bias), (split_s, 0.2));
        prop_assert!((whole.position - parts.position).amax() < 1e-8);
        prop_assert!((whole.velocity - parts.velocity).amax() < 1e-7);
        prop_assert!(whole.attitude.angle_to(&parts.attitude) < 1e-6);
        prop_assert!((whole.rate - parts.rate).amax() < 1e-6);
    }

    /// From a pose to the effect of a command the coarse integration stays within the noise of cameras.
    #[test]
    fn coarse_prediction_is_close_to_fine_prediction(
        demands in prop::collection::vec(vector(2.0), 5),
        thrusts in prop::collection::vec(0.0..10.0, 5),
        rate in vector(1.0),
        horizon_s in 0.01..0.08,
    ) {
        let mut history = CommandHistory::new(0.0);
        for (sequence, (demand, thrust_n)) in demands.into_iter().zip(thrusts).enumerate() {
            let input = ModelInput { demand, thrust_n, ..ModelInput::default() };
            history.push(sequence as u64 + 1, sequence as f64 * PERIOD_S, input);
        }
        let start = Motion { rate, thrust_n: 5.0, ..Motion::default() };
        let after = |integration| {
            let model = VehicleModel { integration, ..quadrotor() };
            history.propagate(&model, (&start, &Bias::default()), (0.0, horizon_s))
        };
        let (fine, coarse) = (after(Integration::Fine), after(Integration::Coarse));
        prop_assert!((fine.position - coarse.position).norm() < 0.5e-3);
        prop_assert!((fine.velocity - coarse.velocity).norm() < 0.01);
        prop_assert!(fine.attitude.angle_to(&coarse.attitude) < 2e-3);
        prop_assert!((fine.rate - coarse.rate).norm() < 0.05);
    }
}

/// At high rates fewer commands are kept than act within a pause of the cameras.
#[test]
fn before_the_commands_that_are_kept_the_oldest_of_them_is_assumed() {
    let mut history = CommandHistory::new(DELAY_S);
    history.push(1, 1e-3, thrust(2.0));
    assert!(thrust_at(&history, 1e-3).abs() < 1e-9, "nothing acts before the first command");
    for sequence in 2..=200 {
        history.push(sequence, sequence as f64 * 1e-3, thrust(2.0));
    }
    assert!((thrust_at(&history, 0.05) - 2.0).abs() < 1e-5);
}
