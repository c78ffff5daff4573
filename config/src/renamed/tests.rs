use super::*;
use crate::Config;

#[test]
fn a_former_key_sets_each_present_one_and_warns() {
    let settings = [
        Setting::flag("--set", "control.oqtal.delta-rad", 0.3),
        Setting::flag("lab.toml:7", "control.surroundings", "own"),
        Setting::flag("--set", "control.oqtal.cell-eps", 0.1),
    ];
    let config = Config::from_settings(&settings).unwrap();
    let oqtal = config.control.oqtal;
    assert_eq!((oqtal.cell_rate_rad_s, oqtal.cell_eps), (0.3, 0.1));
    assert_eq!(oqtal.cell_eps_ddot_per_s2, 0.3);
    let warnings = config.rename_warnings();
    assert_eq!(warnings.len(), 2);
    let expected = "lab.toml:7: `control.surroundings` is a former name of `control.stack`";
    assert!(warnings[1].starts_with(expected), "{}", warnings[1]);
}

#[test]
fn every_present_key_exists_and_no_former_one_does() {
    let defaults = Config::default().to_toml();
    for RenamedKey { former, keys, .. } in &RENAMED {
        for key in *keys {
            let (section, name) = key.rsplit_once('.').unwrap();
            let (_, section) = defaults.split_once(&format!("[{section}]\n")).unwrap();
            let section = section.split("\n[").next().unwrap();
            assert!(section.lines().any(|line| line.starts_with(&format!("{name} ="))));
        }
        let (_, name) = former.rsplit_once('.').unwrap();
        assert!(!defaults.lines().any(|line| line.starts_with(&format!("{name} ="))));
    }
}
