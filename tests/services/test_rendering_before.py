"""What is played before the start criterion: the stream, or silence."""

import pytest
from service_runs import small_scene

from mmt.core.errors import InputError
from mmt.scene.files import scene_of_recording


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
