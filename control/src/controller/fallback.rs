//! Name of the fallback law in a configuration: `auto`, or the name of a law.

use serde::{Deserialize, Deserializer, Serializer};

use super::ControllerName;

/// Name of the automatic selection.
const AUTO: &str = "auto";

pub(super) fn serialize<S: Serializer>(
    fallback: &Option<ControllerName>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(fallback.map_or(AUTO, ControllerName::name))
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<ControllerName>, D::Error> {
    let name = String::deserialize(deserializer)?;
    let law = ControllerName::ALL.into_iter().find(|law| law.name() == name);
    if law.is_some() || name == AUTO {
        return Ok(law);
    }
    let allowed = ControllerName::NAMES.join("`, `");
    Err(serde::de::Error::custom(format!(
        "unknown fallback law `{name}`, expected `{AUTO}`, `{allowed}`"
    )))
}
