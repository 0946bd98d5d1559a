"""Recordings as the MCAP library reads them, without anything of this package."""

import json

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from session_samples import made_frames

from mmt.core.frames import CHANNELS
from mmt.session.recorder import McapRecorder


def test_what_is_said_of_each_topics_encoding_is_true(tmp_path):
    path = tmp_path / "run.mcap"
    with McapRecorder(path, channels=CHANNELS) as recorder:
        recorder.record_frames(made_frames(40))
        recorder.record_backfill(made_frames(40), 5_000_000_000)
        recorder.record_output(5_000_000_000, "streamed", np.zeros(40))
        recorder.record_event({"time_s": 0.0, "event": "it begins"})
    seen = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            seen[channel.topic] = (channel.message_encoding, schema.encoding)
            if schema.encoding == "jsonschema":
                assert json.loads(schema.data)["type"] == "object"
                assert json.loads(message.data)["event"] == "it begins"
            else:
                files = FileDescriptorSet.FromString(schema.data).file
                names = {
                    f"{file.package}.{kind.name}" for file in files for kind in file.message_type
                }
                assert schema.name in names
    block = ("protobuf", "protobuf")
    assert seen == {
        **dict.fromkeys(("/frames", "/backfill", "/plot", "/output"), block),
        "/events": ("json", "jsonschema"),
    }
