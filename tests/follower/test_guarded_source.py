"""The robot is driven within its limits, and holds or retracts while a device is lost."""

import math

import numpy as np
import pytest

from mmt.core.frames import COMMAND_DTYPE, empty_frames
from mmt.follower.guarded_source import GuardedSource
from mmt.scene.files import scene_from_tables
from mmt.scene.leader_tables import Texture

BOX_MM = ((-50.0, -40.0, -10.0), (50.0, 60.0, 80.0))
LIMITS = {"workspace_mm": BOX_MM, "acceleration_limit_mm_s2": 20_000.0}
ARM = {"robot": "a:B"}


class Source:
    """Takes positions, and measures what the test sets, if anything."""

    finished = False
    annotations = b""
    summary = {"robot": {"losses": 1}}  # noqa: RUF012 - it does not change

    def __init__(self):
        self.taken = []
        self.measures = None

    def start(self, start_time_ns=0): ...

    open = close = describe = start

    def on_loss(self, callback):
        self.lose = callback

    def on_late_frames(self, callback):
        self.come_late = callback

    def step(self, elapsed, now_ns, command_position_mm):
        assert elapsed == 1 < now_ns
        self.taken.append(command_position_mm)
        frames = empty_frames(0 if self.measures is None else 1)
        frames["time_ns"], frames["position_mm"] = len(self.taken), self.measures or 0.0
        return frames


class Feedback:
    """Asks for 30 mm more in every third tick, and says what was measured."""

    event, dtype = "nothing", np.dtype([("time_ns", "<i8")])
    summary = {"method": "none"}  # noqa: RUF012 - it does not change

    def __init__(self, ticks=0):
        self.ticks = ticks

    def command(self, position_mm):
        self.ticks += 1
        if position_mm is None or self.ticks % 3:
            return position_mm
        x, y, z = position_mm
        return (x + 30.0, y, z)

    def measured(self, frames):
        return frames[["time_ns"]]

    def on_records(self, records): ...

    def restart(self): ...


class Driven:
    """A guarded source, and what it says and sends."""

    def __init__(self, feedback=None, **tables):
        scene = scene_from_tables({"link": {}, "texture": {}, **tables})
        scene = scene.model_copy(update={"texture": Texture(normal="y")})
        self.source, self.said, self.sent = Source(), [], []
        self.guarded = GuardedSource(
            scene, self.source, feedback, self.said.append, lambda *some: self.sent.append(some)
        )

    def command(self, position_mm, ticks=1, echo_ns=0):
        block = np.zeros(1, COMMAND_DTYPE)
        block["position_mm"], block["echo_time_ns"] = position_mm, echo_ns
        for _ in range(ticks):
            self.guarded.receive(block, echo_ns)
            self.guarded.step(1)
        return self.source.taken[-1]


@pytest.mark.parametrize("tables", [{"simulated": LIMITS}, {"devices": LIMITS | ARM}])
@pytest.mark.parametrize("ticks", [0, 1, 2])
def test_the_limits_of_a_scene_hold_behind_guard_and_feedback(tables, ticks):
    driven = Driven(Feedback(ticks), hand={}, link={"limit_mm_s": 120.0}, **tables)
    driven.source.measures = (0.0, 0.0, 0.0)
    for tick in range(900):
        driven.command((0.2 * tick, 0.0, -0.3 * tick))
    taken = [place for place in driven.source.taken if place is not None]
    places = np.array([(0.0, 0.0, 0.0), *taken])  # it begins where the robot is
    assert (places >= np.array(BOX_MM[0]) - 1e-9).all()
    assert (places <= np.array(BOX_MM[1]) + 1e-9).all()
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= 0.12 + 1e-9
    assert np.abs(np.diff(places, n=2, axis=0)).max() <= 0.02 + 1e-9
    assert places[-1][0] > 40.0
    assert driven.guarded.summary["commands"]["clipped_commands"] > 500


@pytest.mark.parametrize(
    ("on_lost", "said"), [("hold", "holding"), ("retract", "retracting"), ("stop", None)]
)
def test_while_a_device_is_lost_the_robot_takes_no_commands(on_lost, said):
    driven = Driven(hand={}, devices=LIMITS | ARM | {"on_lost": on_lost})
    source = driven.source
    assert driven.command((5.0, 5.0, 5.0)) is None  # not measured yet
    source.measures = (math.nan, 0.0, 0.0)
    assert driven.command((5.0, 5.0, 5.0), 2) is None
    source.measures = (5.0, 5.0, 5.0)
    assert driven.command((5.0, 5.0, 5.0), 10) == (5.0, 5.0, 5.0)
    source.lose(True, "it is lost", False)
    x, y, z = driven.command((20.0, 5.0, 5.0), 1000) or ()
    assert (x > 19.0, y > 6.0, z) == (said is None, on_lost == "retract", 5.0)
    source.lose(True, "it too", True)
    source.measures = (-20.0, 5.0, 5.0)
    assert (driven.command((20.0, 5.0, 5.0)) is None) == (said is not None)
    source.lose(False, "both are back", True)
    driven.command((20.0, 5.0, 5.0))
    place = driven.command((20.0, 5.0, 5.0)) or ()
    assert (place[0] < -19.0) == (said is not None)
    told = [f"it is lost: {said}", f"it too: {said}", "both are back: taking commands again"]
    assert driven.said == (told if said else [])


@pytest.mark.parametrize("feedback", [None, Feedback()])
def test_frames_go_with_the_news_of_the_feedback_and_may_be_echoed(feedback):
    driven = Driven(feedback, hand={}, devices=ARM)
    assert driven.guarded.step(1)[1] is None  # no frame
    driven.source.measures = (1.0, 2.0, 3.0)
    frames, news = driven.guarded.step(1)
    driven.source.come_late(frames)
    for found in (news, driven.sent[0][1]):
        assert (None if found is None else found["time_ns"].tolist()) == (feedback and [2])
    assert driven.sent[0][0] is frames
    driven.command((1.0, 2.0, 3.0), echo_ns=2)
    assert driven.guarded.summary["commands"]["implausible_commands"] == 0
    driven.guarded.connect()
    driven.command((1.0, 2.0, 3.0), echo_ns=2)
    assert driven.guarded.summary["commands"]["implausible_commands"] == 1
    assert driven.guarded.summary["devices"] == Source.summary
    assert driven.guarded.summary["feedback"] == ({"method": "none"} if feedback else {})


def test_a_recording_follows_no_commands():
    driven = Driven(replay={"file": "a.mcap"})
    driven.guarded.connect()
    assert driven.command((1.0, 2.0, 3.0), 50) is None
    assert driven.said == []
    assert driven.guarded.summary["commands"] == {}
