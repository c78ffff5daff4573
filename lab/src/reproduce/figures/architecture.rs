//! Figs. 3 to 5, 15 and 16: the structure of the three laws, of the testbed and of the loops around the laws, with the equations
//! that each box computes.

use super::Figure;
use super::diagram::DiagramPart::{Block, Sum};
use super::diagram::DiagramPlace::{At, Bottom, Left, Right, Top};
use super::diagram::{Diagram, DiagramPart};

/// What the laws control.
const VEHICLE: [&str; 2] = ["vehicle", "Eqs. (3), (7)"];

/// Fig. 3.
const PID: Diagram = Diagram {
    number: 3,
    title: "quaternion PID",
    parts: &[
        Block((0.95, 0.6), ["quaternion error", "Eqs. (8) to (10)"]),
        Block((2.1, 0.6), ["2k sat_L(ε + ∫ε / T)", "Eqs. (17), (18)"]),
        Sum((2.85, 0.6)),
        Block((3.6, 0.6), ["−J, sat_U", "Eqs. (17), (19)"]),
        Block((4.7, 0.6), VEHICLE),
        Block((2.85, 1.5), ["c", "Eq. (17)"]),
    ],
    wires: &[
        ("q_d", &[At(0.1, 0.6), Left(0)]),
        ("ε", &[Right(0), Left(1)]),
        ("", &[Right(1), Left(2)]),
        ("", &[Right(2), Left(3)]),
        ("τ", &[Right(3), Left(4)]),
        ("q, ω", &[Right(4), At(5.55, 0.6)]),
        ("q", &[At(5.3, 0.6), At(5.3, 2.1), At(0.95, 2.1), Bottom(0)]),
        ("ω", &[Bottom(4), At(4.7, 1.5), Right(5)]),
        ("", &[Top(5), Bottom(2)]),
    ],
    size: (5.7, 2.3),
};

/// Fig. 4.
const CLASSIC: Diagram = Diagram {
    number: 4,
    title: "classic LQR, with set-point tracking and integral action",
    parts: &[
        Block((1.0, 0.6), ["N̄", "Eqs. (24), (25)"]),
        Sum((2.4, 0.6)),
        Block((3.7, 0.6), VEHICLE),
        Block((2.4, 1.6), ["−K, by cells of [ω; Θ]", "Eqs. (22), (31) to (35)"]),
        Block((1.0, 1.6), ["∫(Θ_d − Θ)", "Eq. (33)"]),
    ],
    wires: &[
        ("Θ_d", &[At(0.1, 0.6), Left(0)]),
        ("", &[At(0.35, 0.6), At(0.35, 1.6), Left(4)]),
        ("", &[Right(0), Left(1)]),
        ("τ", &[Right(1), Left(2)]),
        ("ω, Θ", &[Right(2), At(4.7, 0.6)]),
        ("", &[At(4.4, 0.6), At(4.4, 1.6), Right(3)]),
        ("Θ", &[At(3.3, 1.6), At(3.3, 2.2), At(1.0, 2.2), Bottom(4)]),
        ("Θ_I", &[Right(4), Left(3)]),
        ("", &[Top(3), Bottom(1)]),
    ],
    size: (4.9, 2.4),
};

/// Fig. 5.
const OQTAL: Diagram = Diagram {
    number: 5,
    title: "OQTAL, with integral action",
    parts: &[
        Block((1.0, 0.6), ["errors ε, ω_e", "Eqs. (8) to (10), (36)"]),
        Block((2.4, 0.6), ["−K, by cells of [ω_e; ε]", "Eqs. (43) to (48), (56)"]),
        Sum((3.2, 0.6)),
        Block((4.1, 0.6), VEHICLE),
        Block((1.7, 1.5), ["∫ −ε", "Eq. (57)"]),
        Block((3.2, 1.5), ["ω × Jω", "Eq. (56)"]),
    ],
    wires: &[
        ("q_d, ω_d", &[At(0.05, 0.6), Left(0)]),
        ("ε, ω_e", &[Right(0), Left(1)]),
        ("ε", &[At(1.7, 0.6), Top(4)]),
        ("ε_I", &[Right(4), At(2.4, 1.5), Bottom(1)]),
        ("", &[Right(1), Left(2)]),
        ("τ", &[Right(2), Left(3)]),
        ("q, ω", &[Right(3), At(5.0, 0.6)]),
        ("", &[At(4.8, 0.6), At(4.8, 2.1), At(1.0, 2.1), Bottom(0)]),
        ("ω", &[At(4.8, 1.5), Right(5)]),
        ("", &[Top(5), Bottom(2)]),
    ],
    size: (5.2, 2.3),
};

/// Fig. 15.
const TESTBED: Diagram = Diagram {
    number: 15,
    title: "the testbed, and the processes that stand for its parts here",
    parts: &[
        Block((0.9, 0.6), ["Qualisys cameras", "receiver or mocap-emu"]),
        Block((2.0, 0.6), ["filter", "daemon: estimator"]),
        Block((3.1, 0.6), ["control laws, Fig. 16", "daemon: loops and law"]),
        Block((4.3, 0.6), ["post-processing", "daemon: limits"]),
        Block((4.3, 1.7), ["XBee radio", "bridge"]),
        Block((0.9, 1.7), ["Hummingbird", "or plant-sim"]),
    ],
    wires: &[
        ("X, Θ", &[Right(0), Left(1)]),
        ("state", &[Right(1), Left(2)]),
        ("δ", &[Right(2), Left(3)]),
        ("η", &[Bottom(3), Top(4)]),
        ("serial packets, by air", &[Left(4), Right(5)]),
        ("markers", &[Top(5), Bottom(0)]),
    ],
    size: (5.2, 2.2),
};

/// The six PIDs of Fig. 16, then what they feed.
const LOOPS: &[DiagramPart] = &[
    Block((1.0, 0.6), ["PID, X", "position to velocity"]),
    Block((1.0, 1.4), ["PID, Y", "position to velocity"]),
    Block((1.0, 2.2), ["PID, Z", "position to velocity"]),
    Block((2.2, 0.6), ["PID, V_X", "velocity to acceleration"]),
    Block((2.2, 1.4), ["PID, V_Y", "velocity to acceleration"]),
    Block((2.2, 2.2), ["PID, V_Z", "velocity to acceleration"]),
    Block((3.4, 1.0), ["desired attitude", "along the force"]),
    Block((4.6, 1.0), ["attitude law", "PID, LQR or OQTAL"]),
    Block((6.0, 1.0), ["quadrotor", "Eqs. (15), (61)"]),
];

/// Fig. 16.
const OUTER_LOOPS: Diagram = Diagram {
    number: 16,
    title: "control architecture: six PIDs around the attitude law",
    parts: LOOPS,
    wires: &[
        ("x_d", &[At(0.1, 0.6), Left(0)]),
        ("y_d", &[At(0.1, 1.4), Left(1)]),
        ("z_d", &[At(0.1, 2.2), Left(2)]),
        ("", &[Right(0), Left(3)]),
        ("", &[Right(1), Left(4)]),
        ("", &[Right(2), Left(5)]),
        ("", &[Right(3), At(2.8, 0.6), At(2.8, 0.9), At(3.0, 0.9)]),
        ("", &[Right(4), At(2.8, 1.4), At(2.8, 1.1), At(3.0, 1.1)]),
        ("q_d", &[Right(6), Left(7)]),
        ("δ_r, δ_p, δ_y", &[Right(7), Left(8)]),
        ("δ_c", &[Right(5), At(6.0, 2.2), Bottom(8)]),
        ("q, ω", &[Top(8), At(6.0, 0.35), At(4.6, 0.35), Top(7)]),
        ("x, v, to all six", &[Right(8), At(6.95, 1.0), At(6.95, 2.8), At(1.0, 2.8), Bottom(2)]),
    ],
    size: (7.1, 3.0),
};

/// Figs. 3 to 5, 15 and 16.
#[must_use]
pub fn all() -> Vec<Figure> {
    [PID, CLASSIC, OQTAL, TESTBED, OUTER_LOOPS].iter().map(Diagram::figure).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_is_drawn_with_all_its_signals() {
        let figures = all();
        assert_eq!(
            figures.iter().map(|figure| figure.number).collect::<Vec<_>>(),
            [3, 4, 5, 15, 16]
        );
        for (figure, diagram) in figures.iter().zip([PID, CLASSIC, OQTAL, TESTBED, OUTER_LOOPS]) {
            let svg = &figure.markup.0;
            assert_eq!(svg.matches("<polyline").count(), diagram.wires.len(), "{}", diagram.number);
            assert!(diagram.wires.iter().all(|(name, _)| svg.contains(name)), "{}", diagram.number);
        }
    }
}
