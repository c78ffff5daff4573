//! Parameter spread, `plant.spread`: a simulated vehicle that differs from its nominal values.

use oqtal_config::PlantOptions;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;

/// Shortest time constant that the integrator follows \[ms\].
const LEAST_LAG_MS: f64 = 1.0;

/// Draws the parameters of a vehicle under `seed`: each of those named at [`PlantOptions::spread`] differs from its value in
/// `nominal` by up to `nominal.spread`, uniformly in both directions. The inertia is scaled as a whole.
pub fn drawn(nominal: &PlantOptions, seed: u64) -> PlantOptions {
    let mut spread = Spread { generator: stream(seed, RandomSource::Spread), most: nominal.spread };
    let mut plant = nominal.clone();
    spread.apply(&mut plant.mass_kg);
    let inertia = spread.factor();
    plant.inertia_kg_m2.iter_mut().flatten().for_each(|moment| *moment *= inertia);
    spread.apply(&mut plant.max_thrust_n);
    plant.rate_authority_rad_s.iter_mut().for_each(|authority| spread.apply(authority));
    spread.apply(&mut plant.max_torque_nm);
    spread.apply(&mut plant.rate_lag_ms);
    spread.apply(&mut plant.thrust_lag_ms);
    spread.apply(&mut plant.command_delay_ms);
    spread.apply(&mut plant.drag_per_s);
    let rotors = &mut plant.rotors;
    spread.apply(&mut rotors.arm_m);
    spread.apply(&mut rotors.thrust_coefficient);
    spread.apply(&mut rotors.torque_coefficient);
    spread.apply(&mut rotors.lag_ms);
    spread.apply(&mut rotors.max_speed_rad_s);
    spread.apply(&mut plant.attitude_gain_per_s);
    plant.rate_lag_ms = plant.rate_lag_ms.max(LEAST_LAG_MS);
    plant.rotors.lag_ms = plant.rotors.lag_ms.max(LEAST_LAG_MS);
    plant
}

/// Source of relative deviations.
struct Spread {
    generator: Generator,
    /// Greatest deviation \[-\].
    most: f64,
}

impl Spread {
    /// Factor of the next parameter \[-\].
    fn factor(&mut self) -> f64 {
        1.0 + self.most * (2.0 * self.generator.random::<f64>() - 1.0)
    }

    fn apply(&mut self, parameter: &mut f64) {
        *parameter *= self.factor();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Config;

    fn nominal(spread: f64) -> PlantOptions {
        PlantOptions { spread, ..Config::default().plant }
    }

    #[test]
    fn without_spread_the_plant_is_the_nominal_one_bit_for_bit() {
        for seed in 0..20 {
            assert_eq!(drawn(&nominal(0.0), seed), nominal(0.0));
        }
    }

    #[test]
    fn with_spread_every_drawn_parameter_differs_within_bounds_and_repeats_with_the_seed() {
        let (nominal, spread) = (nominal(0.2), 0.2);
        let parameters = |plant: &PlantOptions| {
            let [roll, pitch, yaw] = plant.rate_authority_rad_s;
            let rotors = &plant.rotors;
            let body =
                [plant.mass_kg, plant.inertia_kg_m2[1][1], plant.max_thrust_n, roll, pitch, yaw];
            let loops =
                [plant.rate_lag_ms, plant.thrust_lag_ms, plant.command_delay_ms, plant.drag_per_s];
            let rest = [
                plant.max_torque_nm,
                plant.attitude_gain_per_s,
                rotors.arm_m,
                rotors.lag_ms,
                rotors.max_speed_rad_s,
            ];
            [&body[..], &loops, &rest, &[rotors.thrust_coefficient, rotors.torque_coefficient]]
                .concat()
        };
        let draws: Vec<Vec<f64>> = (0..50).map(|seed| parameters(&drawn(&nominal, seed))).collect();
        assert_eq!(draws[7], parameters(&drawn(&nominal, 7)));
        for (index, value) in parameters(&nominal).into_iter().enumerate() {
            let ratios: Vec<f64> = draws.iter().map(|draw| draw[index] / value).collect();
            assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() <= spread + 1e-12), "{index}");
            let most = ratios.iter().fold(0.0, |most: f64, ratio| most.max((ratio - 1.0).abs()));
            assert!(most > 0.5 * spread, "{index}: fifty draws deviate by at most {most}");
        }
    }
}
