//! Keys of earlier versions: they are still accepted, with a warning.

use crate::setting::Setting;

/// A key of earlier versions.
struct RenamedKey {
    /// Former key.
    former: &'static str,
    /// Present keys, each of which takes the value.
    keys: &'static [&'static str],
    /// Former and present value, if a value was renamed too.
    value: Option<[&'static str; 2]>,
}

/// All keys of earlier versions. A further one is a row.
const RENAMED: [RenamedKey; 3] = [
    RenamedKey {
        former: "control.surroundings",
        keys: &["control.stack"],
        value: Some(["own", "default"]),
    },
    RenamedKey {
        former: "control.lqr.delta-rad",
        keys: &["control.lqr.cell-rate-rad-s", "control.lqr.cell-angle-rad"],
        value: None,
    },
    RenamedKey {
        former: "control.oqtal.delta-rad",
        keys: &[
            "control.oqtal.cell-rate-rad-s",
            "control.oqtal.cell-eps",
            "control.oqtal.cell-eps-ddot-per-s2",
        ],
        value: None,
    },
];

fn find(setting: &Setting) -> Option<&'static RenamedKey> {
    RENAMED.iter().find(|renamed| renamed.former == setting.key)
}

/// Settings with the present keys.
pub(crate) fn with_present_keys(settings: &[Setting]) -> Vec<Setting> {
    let rename = |setting: &Setting| {
        let Some(RenamedKey { keys, value, .. }) = find(setting) else {
            return vec![setting.clone()];
        };
        let mut setting = setting.clone();
        if let Some([former, present]) = value
            && setting.value.as_str() == Some(former)
        {
            setting.value = (*present).into();
        }
        keys.iter().map(|key| Setting { key: (*key).to_owned(), ..setting.clone() }).collect()
    };
    settings.iter().flat_map(rename).collect()
}

/// Warnings for settings with keys of earlier versions.
pub(crate) fn warnings(settings: &[Setting]) -> Vec<String> {
    let warn = |setting: &Setting| {
        let keys = find(setting)?.keys.join("`, `");
        let Setting { key, origin, .. } = setting;
        Some(format!("{origin}: `{key}` is a former name of `{keys}`; use the new name"))
    };
    settings.iter().filter_map(warn).collect()
}

#[cfg(test)]
mod tests {
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
}
