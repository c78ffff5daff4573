//! Schemas in the message definition language of ROS 2, generated from the field tables of the messages.

use oqtal_bus::message::{Field, FieldType, Header, Message, Stamps};

/// Separator between the definitions of a schema.
const RULE: &str =
    "================================================================================";

/// Name of a message's schema.
pub fn name<M: Message>() -> String {
    let path = std::any::type_name::<M>();
    format!("oqtal_msgs/msg/{}", path.rsplit("::").next().unwrap_or(path))
}

/// Schema of a message: its header, its fields, and the definitions of header and stamps.
pub fn text<M: Message>() -> String {
    let header = lines(Header::FIELDS) + "oqtal_msgs/Stamps stamps\n";
    format!(
        "# Header of every message.\noqtal_msgs/Header header\n{}{RULE}\nMSG: oqtal_msgs/Header\n{header}{RULE}\nMSG: oqtal_msgs/Stamps\n{}",
        lines(M::FIELDS),
        lines(Stamps::FIELDS)
    )
}

/// A comment and a definition for each field.
fn lines(fields: &[Field]) -> String {
    fields
        .iter()
        .map(|field| {
            let length =
                if field.length == 1 { String::new() } else { format!("[{}]", field.length) };
            let kind = type_name(field.element);
            format!(
                "# {} [{}]\n{kind}{length} {}\n",
                plain(field.doc),
                field.unit,
                member_name(field)
            )
        })
        .collect()
}

fn type_name(element: FieldType) -> &'static str {
    match element {
        FieldType::U8 => "uint8",
        FieldType::U32 => "uint32",
        FieldType::U64 | FieldType::Time => "uint64",
        FieldType::I64 => "int64",
        FieldType::F64 => "float64",
    }
}

/// Name of a field in recordings, with its unit as suffix, since viewers do not show comments.
pub fn member_name(field: &Field) -> String {
    let unit = field.unit.split(',').next().unwrap_or_default();
    let suffix = match unit {
        "ns" => "_ns",
        "s" => "_s",
        "m" => "_m",
        "V" => "_v",
        "m/s" => "_m_s",
        "m/s^2" => "_m_s2",
        "m/s^3" => "_m_s3",
        "rad" => "_rad",
        "rad/s" => "_rad_s",
        "N" => "_n",
        "N m" => "_nm",
        _ => "",
    };
    let name = field.name;
    if name.ends_with(suffix) { name.to_owned() } else { format!("{name}{suffix}") }
}

/// A doc comment without link markup.
fn plain(doc: &str) -> String {
    let text = doc.replace(['`', '[', ']'], "").replace("crate::code::", "");
    text.replace("oqtal_control::trajectory::", "")
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::{InputV1, TelemetryV1, TruthV1, VehicleV1};

    #[test]
    fn units_end_the_names_and_stand_in_the_comments() {
        let text = text::<VehicleV1>();
        assert_eq!(name::<VehicleV1>(), "oqtal_msgs/msg/VehicleV1");
        assert!(text.contains("# Battery voltage; NaN if unknown. [V]\nfloat64 battery_v\n"));
        assert!(text.contains("\nuint64 captured_at_ns\n") && text.contains("\nint64 wire_ns\n"));
        assert!(self::text::<TruthV1>().contains("\nfloat64[3] position_m\n"));
        assert!(!self::text::<TelemetryV1>().contains('`'));
    }

    #[test]
    fn names_stay_distinct() {
        for fields in [TelemetryV1::FIELDS, VehicleV1::FIELDS, InputV1::FIELDS, TruthV1::FIELDS] {
            let names: std::collections::BTreeSet<_> = fields.iter().map(member_name).collect();
            assert_eq!(names.len(), fields.len());
        }
    }
}
