//! The single steps of `oqtal reproduce step`.

use oqtal_lab::progress::Progress;
use oqtal_lab::reproduce::lander::Lander;
use oqtal_lab::reproduce::step::chapter;
use oqtal_lab::sheet::{Sheet, SheetRow};

fn number(sheet: &Sheet, row: &SheetRow, key: &str) -> f64 {
    row.number(&sheet.columns, key)
}

#[test]
fn the_linear_loop_steps_as_the_law_does_and_the_quadrotor_follows_every_law_of_the_paper() {
    let chapter = chapter(&Lander::new().unwrap(), &Progress::default()).unwrap();
    let [spacecraft, quadrotor] = chapter.sheets.as_slice() else { panic!("two tables") };
    let lqr = |of: &str| {
        let row =
            spacecraft.rows.iter().find(|row| row.controller == "lqr" && row.settings.contains(of));
        row.unwrap()
    };
    // The first flown row is a roll of 5 degrees; the torque is held for a sixtieth of a second.
    for key in ["rise_s", "settle_s"] {
        let [flown, linear] = ["truncated", "(26)"].map(|of| number(spacecraft, lqr(of), key));
        assert!((flown / linear - 1.0).abs() < 0.03, "{key}: {flown} s flown, {linear} s linear");
    }
    let laws = ["pid", "lqr", "oqtal"];
    for row in quadrotor.rows.iter().filter(|row| laws.contains(&row.controller.as_str())) {
        let (angle, rise) = (number(quadrotor, row, "angle_deg"), number(quadrotor, row, "rise_s"));
        assert!(angle > 15.0 || rise < 1.0, "{row:?}");
    }
    for law in laws {
        assert_eq!(quadrotor.rows.iter().filter(|row| row.controller == law).count(), 12);
    }
}
