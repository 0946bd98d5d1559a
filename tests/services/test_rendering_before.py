"""What is played before the start criterion: the stream, or silence."""

import pytest
from service_runs import Together, small_scene

from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.scene.files import scene_of_recording
from mmt.session.files import write_session
from mmt.testing.simulation.offline import simulate_session


async def test_silence_before_the_start_criterion_plays_no_stream(tmp_path):
    frames, annotations = simulate_session(Scene(), "felt", 5.0, 4)
    session = tmp_path / "strokes.npz"
    write_session(session, frames, annotations=annotations)
    scene = small_scene(
        tmp_path,
        simulated=None,
        hand=None,
        replay={"file": str(session), "speed": 2.0},
        texture={"start_share": 0.9999, "stop_share": 0.9999},  # neither is met in five seconds
        rendering={"before": "silent"},
    )
    together = await Together.listening(scene)
    await together.follow()
    summary = await together.end()
    assert summary.vibration["switches"] == []
    assert summary.vibration["mode"] == "silent"
    assert "playout" not in summary.vibration


@pytest.mark.parametrize(
    ("rendering", "sentence"),
    [
        ({"before": "silent", "model": "felt"}, "renders its model from the start"),
        ({"before": "later"}, "stream"),
        ({"before": "warm"}, "no longer a choice.* write start_share = 0.5"),
        ({"library": ["felt"]}, "library: no longer a key.* leave it out"),
        ({"update_fade_ms": 500.0}, "update_fade_ms: no longer a key.* leave it out"),
    ],
)
def test_what_cannot_be_before_is_refused(tmp_path, rendering, sentence):
    with pytest.raises(InputError, match=sentence):
        small_scene(tmp_path, rendering=rendering, texture={})


@pytest.mark.parametrize(
    "former", [{"before": "warm", "library": ["felt"]}, {"update_fade_ms": 1.0}]
)
def test_a_recorded_scene_with_known_textures_is_still_read(former):
    tables = {"link": {}, "simulated": {}, "hand": {}, "texture": {}, "actuator": {}, "playout": {}}
    rendering = scene_of_recording({**tables, "rendering": {**former, "crossfade_ms": 20.0}}, "x")
    now = scene_of_recording({**tables, "rendering": {"crossfade_ms": 20.0}}, "x")
    assert rendering == now


@pytest.mark.parametrize("before", ["stream", "silent"])
def test_what_is_before_decides_the_channels(tmp_path, before):
    scene = small_scene(tmp_path, rendering={"before": before}, texture={})
    assert scene.streams == (before == "stream")
