"""A warm start through both services: known texture first, local model then; or silence."""

from pathlib import Path

import pytest
from service_runs import Together, small_scene

from mmt.core.errors import InputError
from mmt.leader.summary import LeaderSummary
from mmt.models import shipped_models
from mmt.scene import Scene
from mmt.scene.files import load_scene
from mmt.session import write_session
from mmt.testing.simulation.offline import simulate_session

SCENE = """
[link]
[simulated]
[hand]
[texture]
[actuator]
[rendering]
before = "warm"
library = ["mine.npz", "oak"]
"""


async def led(directory: Path, rendering: dict[str, object]) -> tuple[Together, LeaderSummary]:
    frames, annotations = simulate_session(Scene(), "felt", 5.0, 4)
    session = directory / "strokes.npz"
    write_session(session, frames, annotations=annotations)
    scene = small_scene(
        directory,
        simulated=None,
        hand=None,
        replay={"file": str(session), "speed": 2.0},
        texture={"start_share": 0.9999, "stop_share": 0.9999},  # neither is met in five seconds
        rendering=rendering,
    )
    together = Together.of(scene)
    await together.listen()
    await together.follow()
    return together, await together.end()


async def test_a_known_texture_is_rendered_before_the_start_criterion(tmp_path: Path) -> None:
    together, summary = await led(tmp_path, {"before": "warm", "library": ["felt"]})
    assert any(line.startswith("warm start: felt at") for line in together.said)
    assert summary.texture["start_s"] is None
    assert summary.texture["warm"]["texture"] == "felt"
    assert [switch["mode"] for switch in summary.vibration["switches"]][-1] == "synthesized"
    assert "playout" in summary.vibration
    together.leader.reset_model()
    assert together.leader.log.warm is None


async def test_silence_before_the_start_criterion_plays_no_stream(tmp_path: Path) -> None:
    _, summary = await led(tmp_path, {"before": "silent"})
    assert summary.vibration["switches"] == []
    assert summary.vibration["mode"] == "silent"
    assert "playout" not in summary.vibration
    assert "warm" not in summary.texture


@pytest.mark.parametrize(
    ("rendering", "texture", "sentence"),
    [
        ({"before": "warm", "model": "felt"}, {}, "renders its model from the start"),
        ({"before": "warm"}, None, "needs a model"),
        ({"library": ["felt"]}, {}, "is for a warm start"),
        ({"before": "later"}, {}, "stream"),
    ],
)
def test_what_cannot_be_before_is_refused(
    tmp_path: Path, rendering: dict[str, object], texture: dict[str, object] | None, sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        small_scene(tmp_path, rendering=rendering, texture=texture)


def test_a_library_stands_beside_its_scene(tmp_path: Path) -> None:
    (tmp_path / "mine.npz").write_bytes(shipped_models()["felt"].read_bytes())
    file = tmp_path / "scene.toml"
    file.write_text(SCENE, encoding="utf-8")
    rendering = load_scene(file).rendering
    assert rendering is not None
    assert rendering.library == [str(tmp_path / "mine.npz"), "oak"]


@pytest.mark.parametrize("before", ["warm", "silent"])
def test_what_is_before_decides_the_channels(tmp_path: Path, before: str) -> None:
    scene = small_scene(tmp_path, rendering={"before": before}, texture={})
    assert scene.streams == (before == "warm")
