"""Sessions as ROS 2 bags: read back to the bit, and as the tools of ROS read them."""

import sys
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from command_runs import output_of, refusal
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from session_samples import made_frames

from mmt.core.errors import InputError, MmtError
from mmt.core.frames import ALL_CHANNELS, FIELD_OF_CHANNEL
from mmt.session.data import RecordedSession
from mmt.session.files import export_session, import_session, read_session
from mmt.session.info import info

pytestmark = pytest.mark.usefixtures("read_here")

BEGAN_NS = 1_765_000_000_123_456_789
SCENE = {"session": {"name": "wood"}}
EVENTS = [
    {"time_s": 0.1, "event": "marked", "surface": {"number": 2}},
    {"time_s": 0.25, "kind": "model", "samples": [1, 2]},
]

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs the extra 'import'")


@pytest.fixture
def session():
    frames = made_frames(300, steps=np.where(np.arange(299) == 10, 6, 1))
    frames["sequence"] += 7
    return RecordedSession(frames, SCENE, b"truth", [], EVENTS, began_utc_ns=BEGAN_NS)


def test_long_sessions_are_written_in_blocks(tmp_path):
    frames = made_frames(9000)
    times_ns = frames["time_ns"].copy()
    frames["time_ns"][6000:] -= 3_000_000_000  # the follower's machine restarted
    export_session(RecordedSession(frames), tmp_path / "bag")
    back = read_session(tmp_path / "bag").frames
    np.testing.assert_array_equal(back["sequence"], frames["sequence"])
    np.testing.assert_allclose(np.diff(back["time_ns"]), np.diff(times_ns), atol=20_000)


@pytest.mark.parametrize("began_ns", [-1, 1 << 61])
def test_a_date_that_has_no_stamp_is_refused(tmp_path, session, began_ns):
    with pytest.raises(InputError, match="no stamps before 1970 and after 2037"):
        export_session(replace(session, began_utc_ns=began_ns), tmp_path / "bag")
    assert list(tmp_path.iterdir()) == []


def same_bits(one, other):
    np.testing.assert_array_equal(one.view("u4"), other.view("u4"))


def test_channels_are_mapped_by_their_topics(tmp_path):
    frames = made_frames(100, ALL_CHANNELS)
    export_session(RecordedSession(frames), tmp_path / "bag")
    columns = {channel: f"/mmt/{channel}" for channel in ALL_CHANNELS}
    back = import_session(tmp_path / "bag", columns=columns).frames
    for field in map(FIELD_OF_CHANNEL.get, ALL_CHANNELS):
        np.testing.assert_allclose(back[field], frames[field], rtol=1e-6)
    with pytest.raises(InputError, match=r"no array of shape \(n, 4\), and no message with w, x"):
        import_session(tmp_path / "bag", columns={"orientation": "/mmt/force"})


def test_what_was_exported_is_read_back_to_the_bit(tmp_path, session):
    export_session(session, tmp_path / "bag")
    back = read_session(tmp_path / "bag")
    for name in "position_mm", "force_n", "acceleration_m_s2":
        same_bits(back.frames[name], session.frames[name])
    np.testing.assert_array_equal(back.frames["sequence"], session.frames["sequence"])
    since_ns = session.frames["time_ns"] - session.frames["time_ns"][0]
    np.testing.assert_array_equal(back.frames["time_ns"], since_ns)
    assert back.began_utc_ns == BEGAN_NS
    assert back.scene == SCENE
    assert list(back.events) == EVENTS
    assert sorted(file.name for file in (tmp_path / "bag").iterdir()) == [
        "bag.mcap",
        "metadata.yaml",
    ]
    assert [file.name for file in tmp_path.iterdir()] == ["bag"]


@settings(max_examples=10, phases=[Phase.generate])
@given(
    npst.arrays(
        np.float32,
        (100, 9),
        elements=st.floats(width=32, allow_nan=False, allow_infinity=False),
    )
)
def test_every_finite_number_survives_to_the_bit(tmp_path_factory, values):
    """Millimetres become metres and back, with two roundings."""
    session = RecordedSession(made_frames(100))
    folder = tmp_path_factory.mktemp("bag") / "bag"
    names = ("position_mm", "force_n", "acceleration_m_s2")
    for name, vectors in zip(names, np.split(values, 3, axis=1), strict=True):
        session.frames[name] = vectors
    export_session(session, folder)
    back = read_session(folder).frames
    for name in names:
        same_bits(back[name], session.frames[name])


def test_messages_are_standard_with_units_stamps_and_frames(tmp_path, session):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    export_session(session, tmp_path / "bag")
    found = {}
    with AnyReader([tmp_path / "bag"], default_typestore=get_typestore(Stores.LATEST)) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    assert kinds == {
        "/mmt/scene": "std_msgs/msg/String",
        "/mmt/sequence": "std_msgs/msg/UInt32",
        "/mmt/position": "geometry_msgs/msg/PointStamped",
        "/mmt/force": "geometry_msgs/msg/WrenchStamped",
        "/mmt/acceleration": "sensor_msgs/msg/Imu",
        "/mmt/events": "std_msgs/msg/String",
        "/mmt/log": "rcl_interfaces/msg/Log",
    }
    counts = {topic: len(messages) for topic, messages in found.items()}
    few = {"/mmt/scene": 1, "/mmt/events": len(EVENTS), "/mmt/log": 1}
    assert counts == dict.fromkeys(kinds, 300) | few
    frame = session.frames[20]
    stamp_ns = BEGAN_NS + int(frame["time_ns"] - session.frames["time_ns"][0])
    messages = {}
    for topic in "position", "force", "acceleration":
        time_ns, message = found[f"/mmt/{topic}"][20]
        header = message.header
        assert time_ns == stamp_ns == header.stamp.sec * 10**9 + header.stamp.nanosec
        messages[topic] = message
    assert found["/mmt/sequence"][20][1].data == frame["sequence"]
    point, force = messages["position"].point, messages["force"].wrench.force
    np.testing.assert_allclose([1e3 * point.x, 1e3 * point.z], frame["position_mm"][[0, 2]])
    np.testing.assert_array_equal([force.x, force.y, force.z], frame["force_n"])
    imu = messages["acceleration"]
    assert imu.linear_acceleration.y == frame["acceleration_m_s2"][1]
    assert imu.orientation_covariance[0] == imu.angular_velocity_covariance[0] == -1.0
    assert messages["position"].header.frame_id == "mmt_surface"
    assert messages["force"].header.frame_id == imu.header.frame_id == "mmt_tool"
    ((log_ns, log),) = found["/mmt/log"]
    assert (log_ns, log.msg, log.level) == (BEGAN_NS + 100_000_000, "marked", 20)


def test_a_bag_is_replaced_only_with_force_and_whole(tmp_path, session, monkeypatch):
    export_session(session, tmp_path / "bag")
    export_session(
        RecordedSession(session.frames[:200], began_utc_ns=BEGAN_NS), tmp_path / "short.mcap"
    )
    command = ("session", "export", tmp_path / "short.mcap", tmp_path / "bag")
    said = refusal(*command)
    assert "it exists already; choose another name, or --force replaces it" in said
    with monkeypatch.context() as full:
        full.setattr(rosbag2.Writer, "write", Mock(side_effect=OSError(28, "No space left")))
        with pytest.raises(MmtError, match="No space left"):
            export_session(session, tmp_path / "bag")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["bag", "short.mcap"]
    assert len(read_session(tmp_path / "bag").frames) == 300
    output_of(*command, "--force")
    assert len(read_session(tmp_path / "bag").frames) == 200
    size = sum(file.stat().st_size for file in (tmp_path / "bag").iterdir())
    assert info(tmp_path / "bag").size_bytes == size
    output_of("session", "import", tmp_path / "bag", tmp_path / "back.mcap")
    back = read_session(tmp_path / "back.mcap")
    assert (len(back.frames), back.began_utc_ns) == (200, BEGAN_NS)


@pytest.mark.parametrize("name", ["notes.txt", "deep/more.mcap"])
def test_what_is_no_bag_is_never_replaced(tmp_path, session, name):
    folder = tmp_path / "folder"
    (folder / name).parent.mkdir(parents=True)
    (folder / name).write_text("kept")
    (folder / "metadata.yaml").write_text("kept")
    with pytest.raises(InputError, match="holds other things than a ROS 2 bag"):
        export_session(session, folder)
    assert (folder / name).read_text() == (folder / "metadata.yaml").read_text() == "kept"
    (tmp_path / "file").write_text("kept")
    with pytest.raises(InputError, match="a ROS 2 bag is a folder, and this is a file"):
        export_session(session, tmp_path / "file")
    with pytest.raises(InputError, match=r"cannot write .*nowhere"):
        export_session(session, tmp_path / "nowhere" / "bag")


def test_without_rosbags_the_command_that_installs_it_is_said(tmp_path, session, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(InputError, match=r"rosbags, which is not .*\[import\]"):
        export_session(session, tmp_path / "bag")
    assert not list(tmp_path.iterdir())


def test_a_scene_that_is_no_object_is_explained(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    kind = "std_msgs/msg/String"
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/mmt/scene", kind, typestore=store)
        writer.write(connection, BEGAN_NS, store.serialize_cdr(store.types[kind]("[1]"), kind))
    with pytest.raises(InputError, match="a scene or an event is not a JSON object"):
        read_session(tmp_path / "bag")
