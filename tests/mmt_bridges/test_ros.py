"""The part for ROS 2, whose process has a stand-in of rclpy; rclpy: `test_ros_services.py`."""

import json
import signal
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from frame_samples import made_frames
from publishing_samples import OFFSET_NS, Publishing
from waiting import until

from mmt.core.errors import InputError
from mmt.core.frames import acceleration_samples
from mmt.leader.building import LeaderParts
from mmt.leader.part import Session
from mmt.scene.files import scene_from_tables
from mmt_bridges.ros import part as ros
from mmt_bridges.ros.part import RosPart

STAND_IN = {
    "rclpy/__init__.py": """
import json, os, pathlib

log = open(os.environ["STAND_IN_LOG"], "a", buffering=1)

def say(**line):
    log.write(json.dumps(line) + "\\n")

class Publisher:
    def __init__(self, kind, topic, qos):
        self.topic = topic
        say(made=topic, kind=f"{kind.__module__}.{kind.__name__}", qos=vars(qos))

    def publish(self, data):
        assert isinstance(data, bytes)
        say(topic=self.topic, data=data.hex())

    def wait_for_all_acked(self, timeout):
        return True

class Node:
    def __init__(self, name, namespace, **rest):
        say(node=name, namespace=namespace)
        self.namespace = namespace

    def create_publisher(self, kind, topic, qos):
        return Publisher(kind, f"/{self.namespace}/{topic}", qos)

    def destroy_node(self):
        say(node=None)

def init(args, signal_handler_options):
    os.write(1, b"the middleware's licence\\n")
    if os.environ.get("ROS_DOMAIN_ID") == "999":
        raise RuntimeError("domain ID is out of range")

create_node = Node

def shutdown():
    pass
""",
    "rclpy/duration.py": "def Duration(seconds): return seconds",
    "rclpy/qos.py": """
class DurabilityPolicy:
    TRANSIENT_LOCAL, VOLATILE = "transient local", "volatile"

class QoSProfile:
    def __init__(self, depth, durability):
        self.depth, self.durability = depth, durability
""",
    "rclpy/signals.py": "class SignalHandlerOptions: NO = 0",
    **{
        f"{package}/msg.py": f"""
def __getattr__(name):
    return type(name, (), {{"__module__": "{package}.msg"}})
"""
        for package in ("std_msgs", "geometry_msgs", "sensor_msgs", "rcl_interfaces")
    },
}


class Running(Publishing):
    """The part with its process."""

    def __init__(self, monkeypatch, folder, samples=1):
        for name, text in STAND_IN.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text)
        self.log = folder / "log"
        monkeypatch.setenv("STAND_IN_LOG", str(self.log))
        monkeypatch.setenv("PYTHONPATH", str(folder), prepend=":")
        monkeypatch.syspath_prepend(str(folder))
        parts = LeaderParts()
        parts.completing = self.output = SimpleNamespace(newest=None)  # which has the models
        tables = {"session": {"acceleration_rate_hz": 1000 * samples}}
        super().__init__(RosPart, parts, **tables, ros={"namespace": "bench", "chunk_ms": 1})
        self.process = self.part._outlet  # to be killed and stopped

    def lines(self):
        return [json.loads(line) for line in self.log.read_text().splitlines()]

    def published(self):
        """The messages by topic, as rosbags reads them."""
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE)
        kinds, got = {}, {}
        for line in self.lines():
            if "made" in line:
                kinds[line["made"]] = line["kind"].replace(".msg.", "/msg/")
                got[line["made"]] = []
            if "topic" in line:
                data = bytes.fromhex(line["data"])
                message = store.deserialize_cdr(data, kinds[line["topic"]])
                got[line["topic"]].append(message)
        return got


@pytest.fixture
def running(monkeypatch, tmp_path):
    pytest.importorskip("rosbags", reason="needs the extra 'import'")
    made = Running(monkeypatch, tmp_path)
    made.part.begin()
    yield made
    made.part.close()


def stamp_ns(stamp):
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def vectors(values):
    return np.array([[value.x, value.y, value.z] for value in values])


def test_frames_are_published_to_the_bit_with_their_times_by_utc(running):
    ahead_ns = time.time_ns() - time.monotonic_ns()
    frames = made_frames(0, 500)
    for row in range(500):
        running.send(frames[row : row + 1])
    figures = running.end()
    passed_on = {"frames": 500, "events": 1, "models": 0}
    assert figures == {**passed_on, "dropped": 0, "unstamped": 0, "error": None}
    assert running.process.returncode == 0
    got = running.published()
    assert [message.data for message in got["/bench/sequence"]] == list(range(500))
    position_m = vectors([message.point for message in got["/bench/position"]])
    np.testing.assert_array_equal((position_m * 1e3).astype(np.float32), frames["position_mm"])
    force_n = vectors([message.wrench.force for message in got["/bench/force"]])
    np.testing.assert_array_equal(force_n, frames["force_n"])
    values = [message.linear_acceleration for message in got["/bench/acceleration"]]
    np.testing.assert_array_equal(vectors(values), frames["acceleration_m_s2"])
    stamps_ns = [stamp_ns(message.header.stamp) for message in got["/bench/force"]]
    assert np.diff(stamps_ns).tolist() == np.diff(frames["time_ns"]).tolist()
    expected_ns = int(frames["time_ns"][0]) - OFFSET_NS + ahead_ns
    assert abs(stamps_ns[0] - expected_ns) < 1_000_000_000


def test_each_sample_of_acceleration_is_published_with_a_stamp_of_its_own(monkeypatch, tmp_path):
    pytest.importorskip("rosbags", reason="needs the extra 'import'")
    running = Running(monkeypatch, tmp_path, samples=5)
    running.part.begin()
    frames = made_frames(0, 50, samples_per_frame=5)
    frames["acceleration_m_s2"] = np.random.default_rng(5).normal(size=(50, 5, 3))
    running.send(frames)
    assert running.end()["frames"] == 50
    got = running.published()
    messages = got["/bench/acceleration"]
    values = vectors([message.linear_acceleration for message in messages])
    np.testing.assert_array_equal(values, acceleration_samples(frames))
    stamps_ns = [stamp_ns(message.header.stamp) for message in messages]
    assert np.diff(stamps_ns).tolist() == 249 * [200_000]
    force_ns = [stamp_ns(message.header.stamp) for message in got["/bench/force"]]
    assert stamps_ns[4::5] == force_ns
    made = {line["made"]: line["qos"] for line in running.lines() if "made" in line}
    assert made["/bench/acceleration"]["depth"] == 5000


def test_events_scene_and_each_model_are_published_and_kept(running):
    running.session.journal.event("the model is ready", samples=3)
    for text in (b"a model's file", b"another"):
        running.output.newest = SimpleNamespace(to_bytes=lambda text=text: text)
        running.part.poll()
        running.part.poll()  # it is the same one
        until(lambda text=text: text.hex() in running.log.read_text())
    assert running.end()["models"] == 2
    got = running.published()
    (scene,) = got["/bench/scene"]
    assert json.loads(scene.data) == running.session.scene.dump()
    events = [json.loads(message.data) for message in got["/bench/events"]]
    assert events[0]["event"] == "UTC compared"
    assert events[1] == {"time_s": 1.25, "event": "the model is ready", "samples": 3}
    assert [message.msg for message in got["/bench/log"]][1] == "the model is ready"
    models = [bytes(message.data) for message in got["/bench/model"]]
    assert models == [b"a model's file", b"another"]
    made = {line["made"]: line["qos"] for line in running.lines() if "made" in line}
    assert made["/bench/model"] == {"depth": 1, "durability": "transient local"}
    assert made["/bench/events"]["durability"] == "transient local"
    assert made["/bench/force"] == {"depth": 1000, "durability": "volatile"}
    assert running.lines()[-1] == {"node": None}, "the node is taken down"


def test_a_process_that_ends_is_told_once_and_the_session_goes_on(running):
    running.process.kill()
    running.process.wait(60.0)
    running.send(made_frames(0, 5))
    until(lambda: running.part.error)
    running.send(made_frames(5, 5))
    running.part.poll()
    running.part.poll()
    (sentence,) = running.said
    assert sentence == (
        "[ros] has failed: the process that publishes has ended: the session goes on without it"
    )
    assert running.part.faults() == [running.part.error]
    assert running.end()["dropped"] >= 5


def test_a_process_that_stands_still_holds_nothing_up(running, monkeypatch):
    monkeypatch.setattr(ros, "_LEAVE_S", 0.1)
    running.process.send_signal(signal.SIGSTOP)
    frames = made_frames(0, 10_000)
    for first in range(0, 10_000, 10):  # more than the pipe takes; it returns all the same
        running.send(frames[first : first + 10])
    figures = running.end()
    assert figures["dropped"] > 0
    assert "[ros] has failed" in figures["error"]
    assert running.process.returncode == -signal.SIGKILL


@pytest.mark.parametrize(
    ("domain", "code", "said"),
    [
        ("999", STAND_IN["rclpy/__init__.py"], "domain ID is out of range"),
        ("1", "from rclpy import _rclpy_pybind11", "cannot import name '_rclpy_pyb"),
    ],
    ids=["wrong settings", "another Python"],
)
def test_what_ros_refuses_is_explained(monkeypatch, tmp_path, domain, code, said):
    pytest.importorskip("rosbags", reason="needs the extra 'import'")
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    monkeypatch.setitem(STAND_IN, "rclpy/__init__.py", code)
    with pytest.raises(InputError, match=rf"\[ros\] cannot publish: {said}"):
        Running(monkeypatch, tmp_path)


def test_the_table_says_what_is_allowed_and_what_is_missing(monkeypatch):
    tables = {"link": {}, "simulated": {}, "hand": {}, "ros": {}}
    assert scene_from_tables(tables).channels() == ("position", "force", "acceleration")
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(InputError, match=r"\[ros\] needs rclpy, which comes with ROS 2: source"):
        RosPart.build(Session(scene_from_tables(tables)), LeaderParts())
    for table, said in (({"namespace": "/mmt"}, "namespace"), ({"chunk_ms": 0}, "chunk_ms")):
        with pytest.raises(InputError, match=rf"ros.*{said}"):
            scene_from_tables({**tables, "ros": table})
    with pytest.raises(InputError, match=r"\[ros\] needs a follower: add \[link\]"):
        scene_from_tables({"hand": {}, "ros": {}})
