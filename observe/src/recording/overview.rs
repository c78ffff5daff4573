//! Contents of a recording: `oqtal info`.

use std::collections::BTreeMap;

use serde::Serialize;

use super::facts::RECORDING;
use super::file::RecordingFile;
use crate::explain::wrapped;
use crate::kernel::ProcessUsage;
use crate::table;

/// Contents of one topic.
#[derive(Clone, Debug, Default, Serialize)]
pub struct TopicOverview {
    /// Number of messages \[-\].
    pub messages: u64,
    /// Mean message rate from the publication of the first message to that of the last \[Hz\].
    pub rate_hz: f64,
    /// Size of the messages \[bytes\].
    pub bytes: u64,
    /// Name of the schema.
    pub schema: String,
}

/// Contents of a recording.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingOverview {
    /// Path of the file.
    pub file: String,
    /// Size of the file \[bytes\].
    pub bytes: u64,
    /// Time from the first message to the last \[s\].
    pub duration_s: f64,
    /// Time of the first message, UTC; `None` for a flight in virtual time or without messages.
    pub began: Option<String>,
    /// Whether the file is complete.
    pub is_complete: bool,
    /// Tables of facts by name.
    pub facts: BTreeMap<String, BTreeMap<String, String>>,
    /// Topics by name.
    pub topics: BTreeMap<String, TopicOverview>,
}

impl RecordingOverview {
    /// Overview of a recording.
    pub fn of(file: &RecordingFile) -> Self {
        let mut topics: BTreeMap<String, TopicOverview> = BTreeMap::new();
        let mut spans: BTreeMap<&str, (u64, u64)> = BTreeMap::new();
        for channel in file.channels.values() {
            topics.entry(channel.topic.clone()).or_default().schema = channel.schema.clone();
        }
        for message in &file.messages {
            let Some(channel) = file.channels.get(&message.channel) else { continue };
            let Some(topic) = topics.get_mut(&channel.topic) else { continue };
            topic.messages += 1;
            topic.bytes += message.data.len() as u64;
            // A recorder that joins later receives the messages that wait for it at once.
            let at = message.publish_time;
            let (first, last) = spans.entry(&channel.topic).or_insert((at, at));
            (*first, *last) = (at.min(*first), at.max(*last));
        }
        for (name, topic) in &mut topics {
            let seconds = spans.get(name.as_str()).map_or(0.0, |(from, to)| seconds(*from, *to));
            let intervals = topic.messages.saturating_sub(1) as f64;
            topic.rate_hz = if seconds > 0.0 { intervals / seconds } else { 0.0 };
        }
        let times = file.messages.first().zip(file.messages.last());
        let is_real = file.fact(RECORDING, "clock") == Some("real");
        Self {
            file: file.path.display().to_string(),
            bytes: file.size,
            duration_s: times.map_or(0.0, |(first, last)| seconds(first.log_time, last.log_time)),
            began: times.filter(|_| is_real).map(|(first, _)| utc(first.log_time)),
            is_complete: file.cut_off.is_none(),
            facts: file.facts.clone(),
            topics,
        }
    }

    /// Overview as text for a terminal.
    pub fn to_text(&self) -> String {
        let Self { file, bytes, duration_s, began, is_complete, facts, topics } = self;
        let began = began.as_ref().map_or_else(String::new, |began| format!(", began {began}"));
        let end = if *is_complete { "" } else { ", cut off" };
        let megabytes = *bytes as f64 * 1e-6;
        let mut text = format!("{file}: {megabytes:.2} MB, {duration_s:.1} s{began}{end}\n");
        for (name, entries) in facts {
            text += &format!("\n{name}\n");
            for (key, value) in entries {
                text += &format!("  {}\n", wrapped(&format!("{key}: {}", in_words(value)), 4));
            }
        }
        if topics.values().all(|topic| topic.messages == 0) {
            return format!("{text}\nno samples\n");
        }
        let mut rows = table::table(&["topic", "messages", "Hz", "kB", "schema"]);
        for (name, topic) in topics.iter().filter(|(_, topic)| topic.messages > 0) {
            let TopicOverview { messages, rate_hz, bytes, schema } = topic;
            let kilobytes = *bytes as f64 * 1e-3;
            rows.add_row([
                name.clone(),
                messages.to_string(),
                format!("{rate_hz:.1}"),
                format!("{kilobytes:.0}"),
                schema.clone(),
            ]);
        }
        format!("{text}\n{rows}")
    }
}

/// The fact `value` as text; figures of a process as a sentence.
fn in_words(value: &str) -> String {
    serde_json::from_str::<ProcessUsage>(value)
        .map_or_else(|_| value.to_owned(), |usage| usage.to_string())
}

fn seconds(from_ns: u64, to_ns: u64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 * 1e-9
}

/// An instant of the wall clock as `YYYY-MM-DD hh:mm:ss UTC`.
pub(super) fn utc(nanos: u64) -> String {
    let total = nanos / 1_000_000_000;
    let (days, second) = (total / 86_400, total % 86_400);
    // Days to civil date: an era has 400 years, and a year begins in March (Howard Hinnant's algorithm).
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = year_of_era + 400 * era + u64::from(month <= 2);
    let (hour, minute) = (second / 3600, second % 3600 / 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{:02} UTC", second % 60)
}

#[cfg(test)]
mod tests {
    use super::{RecordingOverview, utc};

    #[test]
    fn a_recording_without_samples_says_so_in_place_of_an_empty_table() {
        let empty = RecordingOverview {
            file: "cut.mcap".to_owned(),
            bytes: 3000,
            duration_s: 0.0,
            began: None,
            is_complete: false,
            facts: Default::default(),
            topics: Default::default(),
        };
        let text = empty.to_text();
        assert_eq!(text, "cut.mcap: 0.00 MB, 0.0 s, cut off\n\nno samples\n");
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_827_696, "2000-02-29 12:34:56 UTC"),
            (1_795_305_599, "2026-11-21 23:59:59 UTC"),
        ] {
            assert_eq!(utc(seconds * 1_000_000_000), text);
        }
    }
}
