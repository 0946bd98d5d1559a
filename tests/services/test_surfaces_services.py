"""A session over two surfaces, through both services: each gets a model of its own.

The frames go on when the leader has said what a test waits for, however long it takes.
"""

import asyncio
from collections.abc import Callable

import pytest
from command_runs import refusal
from service_processes import Service
from service_runs import MadeSource, Together, small_scene
from surface_courses import glass_and_sandpaper, stroked_over

from mmt.core.errors import MmtError
from mmt.leader.service import Leader
from mmt.leader.surface_log import replayed_words
from mmt.scene import Replay
from mmt.session.files import read_session
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.updates import SurfaceStatement, surface_statements
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.surfaces.tracking import surface_changes

FRAMES_A_TICK = 5
MOST_TICKS = 30_000
Gate = tuple[int, Callable[[Leader], object]]
TEXTURE = {"order": 10, "surfaces": {}}


class GatedSource(MadeSource):
    """Streams frames up to a gate, and on when the leader's state opens it."""

    def __init__(self, frames, gates, leader):
        super().__init__([])
        self._frames = frames
        self._gates = [*gates, (len(frames), lambda _: True)]
        self._leader = leader
        self._sent = self._waited_ticks = 0
        self.shut = False
        """Whether a gate never opened, so that the stream ended at it."""

    def start(self, start_time_ns):
        self._start_ns = start_time_ns

    def step(self, elapsed, now_ns, command_position_mm):
        if self._gates and self._sent == self._gates[0][0]:
            self._waited_ticks += elapsed
            if self._gates[0][1](self._leader):
                del self._gates[0]
                self._waited_ticks = 0
            elif self._waited_ticks > MOST_TICKS:
                self.shut = True
                self._gates.clear()
        if not self._gates:
            self.finished = True
            return self._frames[:0]
        first, self._sent = self._sent, min(self._sent + FRAMES_A_TICK, self._gates[0][0])
        block = self._frames[first : self._sent].copy()
        block["time_ns"] += self._start_ns
        return block


def on(surface, mode):
    """Say whether the leader is on a surface and plays it so."""

    def reached(leader):
        surfaces = leader.log.surfaces
        return surfaces is not None and surfaces.current == surface and leader.status().mode == mode

    return reached


async def led(directory, gates, **tables):
    scene = small_scene(
        directory,
        simulated=None,
        hand=None,
        replay={},
        link={"port": 0, "patience_s": 20.0},
        texture=TEXTURE,
        rendering={},
        **tables,
    )
    together = await Together.listening(scene)
    source = GatedSource(stroked_over(glass_and_sandpaper())[0], gates, together.leader)
    await together.follow(source)
    summary = await together.end()
    assert not source.shut
    return summary, together.said


class SurfaceCommand:
    """Says by ``mmt surface`` what the tool is on, once the leader has found the third surface."""

    def __init__(self, directory, surface):
        self._directory, self._surface = directory, surface
        self.service = None

    def __call__(self, leader):
        if self.service is None and on(3, "streamed")(leader):
            address = f"http://127.0.0.1:{leader.port}"
            command = ("main", "surface", self._surface, "--leader", address)
            self.service = Service(*command, cwd=self._directory)
        return self.service is not None and self.service.process.poll() is not None


async def test_a_surface_that_a_person_names_is_rendered_at_once(tmp_path, monkeypatch):
    monkeypatch.setenv("MMT_LINK_TOKEN", "0123456789abcdef")
    command = SurfaceCommand(tmp_path, "1")
    gates = [
        (5500, on(1, "synthesized")),
        (7800, on(2, "streamed")),
        (11_500, on(2, "synthesized")),
        (15_000, command),
        (16_500, on(1, "synthesized")),
    ]
    summary, told = await led(tmp_path, gates, monitor={})
    assert command.service.end() == 0, command.service.stderr
    assert command.service.stdout == "surface 1 again\n"
    assert any(sentence.startswith("surface 2, not known before") for sentence in told)
    assert any(sentence.startswith("surface 3 is surface 1") for sentence in told)
    table = summary.texture["surfaces"]
    found = [(change["kind"], change["surface"]) for change in table["changes"]]
    assert found == [("new", 2), ("new", 3), ("identified", 1)]
    assert 5.0 < table["changes"][0]["from_s"] < 6.5
    assert [len(table[number]["stays"]) for number in ("1", "2")] == [2, 1]

    recording = tmp_path / "session.mcap"
    recorded = read_session(recording)
    (word,) = surface_statements(recorded.events)
    assert word.surface == 1
    assert 14_900 < word.sample <= 15_000
    settings = ModellingSettings(surfaces=SurfaceSettings())
    again = surface_changes(recorded.frames, settings, [word])
    assert [(change.kind, change.surface) for change in again] == found
    first = int(recorded.frames["sequence"][0])
    assert replayed_words(Replay(file=recording)) == [SurfaceStatement(word.sample - first, 1)]
    assert replayed_words(Replay(file=tmp_path / "elsewhere.mcap")) == []
    assert replayed_words(Replay(file=recording, gaps="skip")) == []
    attached = [e["surface"] for e in recorded.events if e.get("kind") == "model"]
    assert attached.count(2) >= 1
    assert len(attached) == len(recorded.models)
    models = [TextureModel.load(tmp_path / f"session-surface-{n}.npz") for n in (1, 2)]
    powers = [float(model.samples.power.mean()) for model in models]
    assert powers[1] > 30 * powers[0]  # sandpaper's over glass's


@pytest.mark.parametrize(
    ("surface", "monitor", "token", "sentence"),
    [
        ("1", {}, "", "this scene tells no surfaces apart"),
        ("one", {}, "", "surface is 'one': give the number of one met before, or new"),
        ("new", None, "", "give the address of the leader, and start it with --monitor"),
        ("new", {}, "fedcba9876543210", "put the leader's token into MMT_LINK_TOKEN"),
    ],
)
async def test_a_word_that_the_leader_cannot_take_is_refused(
    tmp_path, monkeypatch, surface, monitor, token, sentence
):
    if token:
        monkeypatch.setenv("MMT_LINK_TOKEN", "0123456789abcdef")
    together = await Together.listening(small_scene(tmp_path, monitor=monitor))
    monkeypatch.setenv("MMT_LINK_TOKEN", token)
    address = f"http://127.0.0.1:{together.leader.port}"
    said = await asyncio.to_thread(refusal, "surface", surface, "--leader", address)
    assert sentence in said
    await together.stop()


@pytest.mark.parametrize(
    ("scheme", "sentence"),
    [
        ("http", "check http or https, host, port and firewall"),
        ("https", "check this command's certificate, host, port and firewall"),
    ],
)
def test_without_a_leader_the_address_is_to_be_checked(scheme, sentence):
    address = f"{scheme}://127.0.0.1:1"
    assert sentence in refusal("surface", "2", "--leader", address, kind=MmtError)
