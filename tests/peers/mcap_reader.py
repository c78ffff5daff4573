"""Reads a recording with the `mcap` package and decodes every message by the schema in the file.

Usage: mcap_reader.py FILE [--cut-off]
Prints one JSON object: messages by topic, whether every message was decoded, whether times are ordered, metadata, attachments.
"""

import json
import sys

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory


def main() -> None:
    path, cut_off = sys.argv[1], "--cut-off" in sys.argv[2:]
    counts: dict[str, int] = {}
    last, ordered, samples = 0, True, {}
    result: dict[str, object] = {}
    with open(path, "rb") as stream:
        reader = (NonSeekingReader if cut_off else make_reader)(stream, decoder_factories=[DecoderFactory()])
        try:
            in_file_order = reader.iter_decoded_messages(log_time_order=False)
            for schema, channel, message, decoded in in_file_order:
                counts[channel.topic] = counts.get(channel.topic, 0) + 1
                ordered = ordered and message.log_time >= last
                last = message.log_time
                samples[channel.topic] = (schema.name, decoded)
        except (McapError, EOFError) as error:
            result["end"] = type(error).__name__
        if not cut_off:
            summary = reader.get_summary()
            by_channel = summary.statistics.channel_message_counts
            result["indexed"] = {
                summary.channels[number].topic: count for number, count in by_channel.items()
            }
            result["metadata"] = sorted({record.name for record in reader.iter_metadata()})
            result["attachments"] = sorted(record.name for record in reader.iter_attachments())
    result["messages"] = counts
    result["ordered"] = ordered
    result["schemas"] = {topic: name for topic, (name, _) in samples.items()}
    telemetry = samples.get("telemetry")
    if telemetry:
        result["last_tick"] = telemetry[1].tick
        result["last_position_m"] = list(telemetry[1].position_m)
    pose = samples.get("scene/estimate")
    if pose:
        result["last_pose_z"] = pose[1].pose.position.z
    print(json.dumps(result))


main()
