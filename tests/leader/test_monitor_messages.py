"""What the monitor makes of what the tick and the link leave for it."""

import asyncio
import math

import numpy as np
import pytest
from frame_samples import made_frames
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from monitor_messages import unpack

from mmt.devices.protocols import InterfaceState
from mmt.scene import Texture
from mmt.scene.files import scene_from_tables
from mmt.texture.completion.distance import CompletionMonitor, cell_distances, distance_sum
from mmt.texture.interpolation.vertices import RIM
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.settings import ModellingSettings
from mmt.texture.space import ANISOTROPIC, ISOTROPIC
from mmt.web.monitor.live import MOST_SAMPLES, LiveMessages, Viewers
from mmt.web.monitor.states import completion_header, hello_header, model_message, surfaces, thinned
from mmt.web.page_server import pack

SCENE = scene_from_tables(
    {"link": {}, "simulated": {}, "hand": {}, "texture": {}, "playout": {}, "actuator": {}}
)


def live_messages():
    live = LiveMessages(SCENE)
    live.restart()
    return live


@given(
    text=st.text(max_size=50),
    values=arrays.arrays(np.float32, arrays.array_shapes(max_dims=3, max_side=5)),
)
def test_a_message_is_read_as_it_was_made(text, values):
    message = unpack(pack("kind", {"text": text}, {"values": values, "none": []}))
    assert (message["kind"], message["text"]) == ("kind", text)
    np.testing.assert_array_equal(message["arrays"]["values"], values)
    assert message["arrays"]["none"].shape == (0,)


def test_what_json_cannot_say_is_null_and_thresholds_are_numbers():
    message = unpack(pack("kind", {"a": math.nan, "b": {"c": [math.inf, 1.0]}}, {}))
    assert (message["a"], message["b"]) == (None, {"c": [None, 1.0]})
    scene = SCENE.model_copy(update={"texture": Texture(method="published")})
    assert scene.texture.start_distance == "auto"
    scale = hello_header(scene, "some-id")["criterion"]
    assert (scale["start"], scale["stop"]) == pytest.approx((7.5, 4.243), abs=1e-3)
    assert (scale["title"], scale["rises"]) == ("completion sum", False)
    assert surfaces(None) == {}
    assert surfaces((1, [1, 3])) == {"surfaces": {"now": 1, "known": 2}}


def test_what_nobody_fetches_is_bounded_and_nothing_is_kept_while_nobody_looks_on():
    live, unwatched = live_messages(), LiveMessages(SCENE)
    for k in range(5000):
        for each in (live, unwatched):
            each.add_frames(made_frames(k, 1))
            each.add_output(np.full(1, k))
    message = unpack(live.make({}))
    assert message["measured_count"] <= 500
    assert message["arrays"]["played"][-1] == 4999
    assert unpack(unwatched.make({}))["measured_count"] == 0
    assert len(unpack(unwatched.make({}))["arrays"]["played"]) == 0


def test_samples_are_numbered_so_that_a_gap_is_seen():
    live = live_messages()
    live.add_frames(made_frames(0, 30))
    live.add_output(np.arange(10.0))
    live.add_output(np.arange(10.0, 14.0))
    message = unpack(live.make({"time_s": 1.0}))
    assert (message["measured_count"], message["played_count"]) == (30, 14)
    np.testing.assert_array_equal(message["arrays"]["played"], np.arange(14.0))
    assert message["arrays"]["measured"].shape == (30,)
    live.add_frames(made_frames(30, 5000))  # as a replay that runs faster than time
    message = unpack(live.make({"time_s": 2.0}))
    assert message["measured_count"] == 5030
    assert message["arrays"]["measured"].shape == (MOST_SAMPLES,)


def test_the_point_is_that_of_the_hand_at_the_leader():
    live = live_messages()
    live.state = InterfaceState((0.0, 0.0, 0.0), (30.0, 40.0, 99.0), 1.5, contact=True)
    message = unpack(live.make({}))
    assert (message["point"], message["contact"]) == ([50.0, 1.5], True)
    assert message["velocity_mm_s"] == [30.0, 40.0]


def test_without_a_hand_the_point_follows_the_stream():
    live = live_messages()
    frames = made_frames(0, 41)
    frames["position_mm"] = np.outer(np.arange(41), [0.03, 0.04, 7.0])  # 50 mm/s across
    frames["force_n"] = [9.0, 9.0, 2.0]
    without = made_frames(0, 500, ("acceleration",))
    without["acceleration_m_s2"] = 9.81
    live.add_frames(without)
    message = unpack(live.make({}))
    assert message["point"] is None
    assert np.abs(message["arrays"]["measured"][-100:]).max() < 0.05  # without the offset
    live.add_frames(frames)
    message = unpack(live.make({}))
    assert message["point"] == pytest.approx([50.0, 2.0], abs=1e-2)
    assert message["force_n"] == [9.0, 9.0, 2.0]


def test_a_criterion_says_its_value_its_cells_and_where_a_stroke_is_wanted():
    monitor = CompletionMonitor(ModellingSettings(method="published"))
    monitor.update(np.array([[0.2, 0.2], [0.3, 0.2]]), 1.0)
    growing = completion_header(monitor.progress, None, None)
    assert growing["value"] == sum(cell_distances(np.array([[0.2, 0.2], [0.3, 0.2]])))
    assert len(growing["cells"]) == 9
    assert growing["advice"] == pytest.approx((250.0, 2.5))
    complete = completion_header(monitor.progress, 1.0, 2.0)
    assert complete["advice"] is None  # nothing more is modelled
    faulty = completion_header(monitor.progress, None, None, "frames were missing for 1 s")
    assert faulty == {**growing, "faults": "frames were missing for 1 s"}
    assert growing["faults"] == ""
    nothing = completion_header(None, None, None)
    assert (nothing["value"], nothing["cells"], nothing["advice"]) == (None, None, None)


def shown(inputs, space):
    """How many cells are shown of a model, and how large its triangles or tetrahedra are."""
    count = len(inputs)
    lsf = np.tile([0.5, 1.0, 2.0, 2.5], (count, 1))
    samples = TextureSamples(
        inputs, lsf, variance=np.ones(count), power=np.ones(count), space=space
    )
    model = TextureModel(samples)
    message = unpack(model_message(model))
    assert (message["samples"], message["order"]) == (count, 4)
    assert sum(message["cells"]) == pytest.approx(distance_sum(model.points), abs=1e-2)
    scale = [300, 300, 3] if space is ANISOTROPIC else [300, 3]
    np.testing.assert_allclose(message["arrays"]["points"] * scale, inputs, rtol=1e-5)
    simplices = message["arrays"]["triangles" if space is ISOTROPIC else "tetrahedra"].astype(int)
    corners = message["arrays"]["vertices"][simplices]
    edges = corners[:, 1:] - corners[:, :1]
    return len(message["cells"]), np.abs(np.linalg.det(edges)).sum() / math.factorial(len(scale))


def test_a_model_is_shown_with_its_cells_and_the_simplices_that_fill_its_inputs():
    random = np.random.default_rng(1)
    forces = random.uniform(0.2, 2.8, (12, 1))
    cells, area = shown(np.hstack([random.uniform(20, 280, (12, 1)), forces]), ISOTROPIC)
    assert cells == 9
    assert area == pytest.approx(1.0, abs=1e-4)  # they tile the plane
    cells, volume = shown(np.hstack([random.uniform(-200, 200, (12, 2)), forces]), ANISOTROPIC)
    assert cells == 27
    assert np.pi < volume < np.pi * RIM**2  # they fill the cylinder, and a little around it
    assert unpack(model_message(None))["samples"] == 0


def test_a_long_history_is_thinned_to_its_end():
    points = [(float(k), 1.0) for k in range(4000)]
    shown = thinned(points, 1000)
    assert len(shown) <= 1001
    assert shown[-1] == points[-1]
    assert thinned(points[:10], 1000) == points[:10]


class SlowSocket:
    """Sends nothing until it is let."""

    def __init__(self):
        self.sent = []
        self.opened = asyncio.Event()

    async def send_bytes(self, data):
        await self.opened.wait()
        self.sent.append(data)


async def test_a_slow_viewer_skips_states_and_delays_nobody():
    viewers = Viewers()
    viewers.publish("model", b"first model")
    slow, quick = viewers.add(), viewers.add()
    slow_socket, quick_socket = SlowSocket(), SlowSocket()
    quick_socket.opened.set()
    sending = [
        asyncio.create_task(slow.send(slow_socket)),
        asyncio.create_task(quick.send(quick_socket)),
    ]
    states = [b"%d" % k for k in range(100)]
    for state in states:
        viewers.publish("live", state, retain=False)
        await asyncio.sleep(0)
    viewers.publish("model", b"last model")
    assert quick_socket.sent[:1] == [b"first model"]
    viewers.close()
    slow_socket.opened.set()
    await asyncio.gather(*sending)
    assert quick_socket.sent[1:] == [*states, b"last model"]
    assert slow_socket.sent == [b"first model", b"99", b"last model"]
