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
mod tests;
