"""A run that is published on topics of ROS 2, to a subscriber of ROS itself where there is one."""

import json
import os
from importlib.util import find_spec

import numpy as np
import pytest
from publishing_samples import run_beside

DOMAIN = 100 + os.getpid() % 100
SCENE = f"""
[session]
duration_s = 3
[link]
open = true
[simulated]
[hand]
[ros]
namespace = "bench{os.getpid()}"
[recording]
file = "session.mcap"
"""

SUBSCRIBER = """
import json, os, pathlib, sys
import rclpy
from geometry_msgs.msg import PointStamped, WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Imu
from std_msgs.msg import String, UInt32

namespace, path = os.environ["LISTENED_TO"], sys.argv[1]
rclpy.init()
node = rclpy.create_node("listener")
got = {}

def subscribe(name, kind, get, **qos):
    got[name] = []
    keep = lambda message: got[name].append(get(message))
    profile = QoSProfile(depth=10_000, **qos)
    return node.create_subscription(kind, f"/{namespace}/{name}", keep, profile)

def xyz(vector):
    return [vector.x, vector.y, vector.z]

late = {"durability": DurabilityPolicy.TRANSIENT_LOCAL}
kept = [
    subscribe("position", PointStamped, lambda m: xyz(m.point)),
    subscribe("force", WrenchStamped, lambda m: xyz(m.wrench.force)),
    subscribe("acceleration", Imu, lambda m: xyz(m.linear_acceleration)),
    subscribe("sequence", UInt32, lambda m: m.data),
    subscribe("events", String, lambda m: m.data, **late),
    subscribe("scene", String, lambda m: m.data, **late),
]
while not all(node.count_publishers(f"/{namespace}/{name}") for name in got):
    rclpy.spin_once(node, timeout_sec=0.1)
while not got["scene"]:  # it is kept for us: by now every topic is matched
    rclpy.spin_once(node, timeout_sec=0.1)
print("ready", flush=True)
(found,) = node.get_publishers_info_by_topic(f"/{namespace}/acceleration")
got["hash"] = str(found.topic_type_hash)
idle = 0
while idle < 5:  # what is left when the leader has gone
    before = sum(map(len, got.values()))
    rclpy.spin_once(node, timeout_sec=0.1)
    waiting = node.count_publishers(f"/{namespace}/sequence")
    idle = 0 if waiting or sum(map(len, got.values())) > before else idle + 1
pathlib.Path(path).write_text(json.dumps(got))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """What a subscriber of ROS got of a session, the session, and the leader's summary."""
    if find_spec("rclpy") is None:
        pytest.skip("needs rclpy, which ROS brings")
    scene = tmp_path_factory.mktemp("ros") / "ros.toml"
    scene.write_text(SCENE)
    local = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(DOMAIN)}
    return run_beside(SUBSCRIBER, scene, **local, LISTENED_TO=f"bench{os.getpid()}")


def test_ros_has_every_frame_as_it_was_recorded(run):
    got, session, summary = run
    frames = session.frames
    assert summary["ros"]["dropped"] == summary["ros"]["unstamped"] == 0
    assert summary["ros"]["error"] is None
    assert summary["ticks"]["period_p50_ms"] < 2.0, "four thousand messages a second delay no tick"
    assert got["sequence"] == frames["sequence"].tolist()
    position_mm = (np.array(got["position"]) * 1e3).astype(np.float32)
    np.testing.assert_array_equal(position_mm, frames["position_mm"])
    np.testing.assert_array_equal(np.array(got["force"]), frames["force_n"])
    np.testing.assert_array_equal(np.array(got["acceleration"]), frames["acceleration_m_s2"])


def test_ros_has_events_scene_and_the_type(run):
    got, session, _ = run
    events = [json.loads(text)["event"] for text in got["events"]]
    assert "follower connected" in " ".join(events)
    assert set(events) <= {event["event"] for event in session.events}
    assert json.loads(got["scene"][0]) == session.scene
    assert got["hash"].startswith("RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71")
