"""Recordings as others read them: opened, counted and decoded with the public `mcap` package, by the schemas in the file."""

import json
import struct
import sys

from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

PNG = b"\x89PNG\r\n\x1a\n"
SCHEMAS = {
    "/scanner/points": "foxglove.PointCloud",
    "/scanner/picture": "foxglove.CompressedImage",
    "/flange/picture": "foxglove.CompressedImage",
    "/scanner/calibration": "foxglove.CameraCalibration",
    "/flange/calibration": "foxglove.CameraCalibration",
    "/tf": "foxglove.FrameTransform",
    "/log": "foxglove.Log",
}


class JsonFactory:
    """`mcap` leaves JSON to its users."""

    def decoder_for(self, message_encoding, schema):
        return json.loads if message_encoding == "json" else None


def counted(path):
    counts, last = {}, 0
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory(), JsonFactory()])
        summary = reader.get_summary()
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=True):
            assert message.log_time > last, "times rise"
            last = message.log_time
            assert message.sequence == counts.get(channel.topic, 0), f"{channel.topic} counts on"
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic in SCHEMAS:
                assert schema.name == SCHEMAS[channel.topic] and schema.encoding == "protobuf"
                assert decoded.timestamp.seconds > 1_700_000_000
            if channel.topic == "/scanner/points":
                points = len(decoded.data) // decoded.point_stride
                fields = {field.name: (field.offset, field.type) for field in decoded.fields}
                assert fields["z"] == (8, 7) and fields["blue"] == (14, 1), fields
                # Recordings of format 2 have no alpha.
                assert fields.get("alpha") == ((15, 1) if decoded.point_stride == 16 else None), fields
                depths = [struct.unpack_from("<f", decoded.data, i * decoded.point_stride + 8)[0] for i in range(points)]
                seen = sorted(depth for depth in depths if depth == depth)
                print(f"  {points} points, {len(seen)} seen, median depth {seen[len(seen) // 2]:.1f} mm")
            elif channel.topic.endswith("/picture"):
                assert decoded.format == "png" and decoded.data[:8] == PNG
            elif channel.topic.endswith("/calibration"):
                assert decoded.distortion_model == "plumb_bob" and len(decoded.D) == 5, decoded
                assert len(decoded.K) == 9 and len(decoded.P) == 12 and decoded.width > 0, decoded
            elif channel.topic == "/tf":
                turn = decoded.rotation
                assert abs(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2 - 1) < 1e-9
            elif channel.topic == "/log":
                assert decoded.message
            else:
                assert set(decoded) == {"said", "heard"}, decoded
        stated = {summary.channels[id].topic: n for id, n in summary.statistics.channel_message_counts.items()}
        attachments = [(item.name, len(item.data)) for item in reader.iter_attachments()]
        metadata = {item.name: item.metadata for item in reader.iter_metadata()}
    assert {topic: n for topic, n in stated.items() if n} == counts, (stated, counts)
    assert json.loads(metadata["panelprep.end"]["lost"]) == []
    return counts, attachments, metadata["panelprep"]


def main():
    for path in sys.argv[1:]:
        counts, attachments, begun = counted(path)
        print(f"{path}: {sum(counts.values())} messages, {len(attachments)} attachments, {begun}")
        for topic, count in sorted(counts.items()):
            print(f"  {count:6} {topic}")
        with open(path, "rb") as file:
            streamed = sum(1 for _ in NonSeekingReader(file).iter_messages())
        assert streamed == sum(counts.values()), "read as a stream it is the same"


if __name__ == "__main__":
    main()
