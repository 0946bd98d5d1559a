"""A scene's description against bytes that were counted by hand."""

import pytest

from mmt.cli.scene.description import describe_scene
from mmt.scene.files import example_scenes, load_scene, scene_from_tables

FRAME = 12
"""Sequence number (4) and time (8); each channel adds three floats, 12."""
COMMAND = 40
FRAMES_ENVELOPE = 1 + 5 + 1 + 5 + 1 + 7 + 2 + 4 + 2
"""map, "type", 2, "data", list, "frames", bytes of one length byte, "nsp", "/"."""
COMMANDS_ENVELOPE = FRAMES_ENVELOPE + 2
SIMULATED = {"link": {}, "simulated": {}, "hand": {}}


def streams(**tables):
    return describe_scene(scene_from_tables(tables)).streams


def described(name):
    return describe_scene(load_scene(example_scenes()[name]))


def test_the_demo_sends_whole_frames_up_and_commands_down():
    up, down = described("demo").streams
    assert (up.way, up.event, up.holds) == ("up", "frames", ("position", "force", "acceleration"))
    assert (up.record_bytes, up.message_bytes) == (FRAME + 36, FRAME + 36 + FRAMES_ENVELOPE)
    assert up.bytes_per_s == 76_000.0
    assert (down.way, down.event, down.record_bytes) == ("down", "commands", COMMAND)
    assert (down.message_bytes, down.bytes_per_s) == (COMMAND + COMMANDS_ENVELOPE, 70_000.0)


@pytest.mark.parametrize(
    ("part", "channels"),
    [("force_feedback", 1), ("playout", 1), ("texture", 3), ("recording", 3)],
)
def test_only_the_channels_that_a_part_needs_are_sent(part, channels):
    up, _ = streams(**SIMULATED, **{part: {}}, actuator={})
    assert len(up.holds) == channels
    assert up.record_bytes == FRAME + 12 * channels


@pytest.mark.parametrize(("part", "floats"), [("texture", 6 + 15), ("playout", 15)])
def test_several_samples_of_acceleration_make_frames_longer(part, floats):
    session = {"acceleration_rate_hz": 5000}
    up, _ = streams(session=session, **SIMULATED, **{part: {}}, actuator={})
    assert (up.record_bytes, up.messages_per_s) == (FRAME + 4 * floats, 1000.0)


def test_gathered_frames_share_an_envelope():
    (up,) = streams(link={"frames_per_message": 20}, replay={}, playout={}, actuator={})
    assert (up.records_per_message, up.messages_per_s) == (20, 50.0)
    longer_length = 2  # two more bytes say the length of 480
    assert up.message_bytes == 20 * 24 + FRAMES_ENVELOPE + longer_length - 1


@pytest.mark.parametrize(
    ("speed", "gathered", "records", "per_s"),
    [(1.0, 1, 1, 1000), (8.0, 1, 8, 1000), (8.0, 20, 24, 8000 / 24), (0.5, 1, 1, 500)],
)
def test_a_replay_at_another_speed_sends_more_or_less(speed, gathered, records, per_s):
    link, replay = {"frames_per_message": gathered}, {"speed": speed}
    (up,) = streams(link=link, replay=replay, playout={}, actuator={})
    assert (up.records_per_message, up.messages_per_s) == (records, per_s)


def test_services_say_what_they_run_and_leave_out():
    assert [stream.way for stream in described("replay").streams] == ["up"], "there is no hand"
    alone = described("model-only")
    assert (alone.follower, alone.streams) == (None, ())
    assert alone.leader.runs == ("hand", "rendering", "actuator")
    tasks = ("segmenting", "fitting", "synthesizing", "completing")
    assert described("demo").leader.tasks == tasks
    streamed = described("stream-only")
    assert streamed.leader.runs == ("link", "hand", "playout", "actuator", "force_feedback")
    assert {"texture", "rendering", "recording"} <= set(streamed.leader.left_out)
    assert streamed.leader.tasks == ()
    assert streamed.follower.runs == ("link", "simulated")
    assert {"replay", "devices"} <= set(streamed.follower.left_out)


def test_the_methods_of_force_feedback_add_what_they_send():
    added = streams(**SIMULATED, force_feedback={"method": "passive"})[2:]
    assert [(s.way, s.event) for s in added] == [("up", "energy"), ("down", "energy")]
    assert {s.record_bytes for s in added} == {36}
    (contact,) = streams(**SIMULATED, force_feedback={"method": "model"})[2:]
    assert (contact.way, contact.event, contact.record_bytes) == ("up", "contact", 48)
    assert (contact.records_per_message, contact.messages_per_s) == (5, 200.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"board": {"driver": "labjack-u6", "rate_hz": 2000}},
         "4 samples a frame; adxl335-board gives 2000 samples a second, the scene takes 4000: "
         "nothing above 1000 Hz is in its acceleration"),
        ({"board": {"driver": "labjack-u6", "rate_hz": 8000}}, "4 samples a frame"),
        ({"board": "labjack-u6"}, "4 samples a frame; its start says what adxl335-board gives"),
    ],
)  # fmt: skip
def test_what_the_acceleration_lacks_is_said(options, said):
    devices = {"robot": "virtual-robot", "accelerometer": {"driver": "adxl335-board", **options}}
    tables = {"link": {}, "devices": devices, "playout": {}, "actuator": {}}
    assert describe_scene(scene_from_tables(tables)).acceleration is None
    tables["session"] = {"acceleration_rate_hz": 4000}
    assert describe_scene(scene_from_tables(tables)).acceleration == said


def test_simulated_frames_of_several_samples_lack_nothing():
    tables = {**SIMULATED, "session": {"acceleration_rate_hz": 4000}, "playout": {}, "actuator": {}}
    assert describe_scene(scene_from_tables(tables)).acceleration == "4 samples a frame"
