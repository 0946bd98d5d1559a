"""Draw three hands on one surface, from a run of a leader, a follower and two listeners."""

import asyncio
import tempfile
from collections.abc import Coroutine
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from image_files import write
from matplotlib.figure import Figure

from mmt.cli.running.scene_services import run_services
from mmt.core.arrays import FloatArray
from mmt.core.errors import MmtError
from mmt.core.output.palette import LIGHT, SERIES
from mmt.evaluation.reports.figures import style_axes
from mmt.scene import Hand
from mmt.scene.files import example_scenes, load_scene
from mmt.session.data import RecordedSession
from mmt.session.files import read_session
from mmt.testing.simulation.hand import SimulatedHand
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_share.client import ListenerClient
from mmt_share.messages import shared_at
from mmt_share.tables import Listening

DURATION_S: Final = 18.0
SHOWN_S: Final = 2.0
HANDS: Final = (
    ("a listener", 7, Hand(kind="circles")),
    ("another listener", 8, Hand(kind="quick", headings="all")),
)


class Felt(NamedTuple):
    """Motion of one hand and vibration that it felt, at 1 kHz."""

    name: str
    time_s: FloatArray
    position_mm: FloatArray
    vibration_time_s: FloatArray
    vibration_m_s2: FloatArray


@dataclass
class Listeners:
    """Listeners that join as soon as the model is shared, and keep the models that they get."""

    models: dict[str, list[tuple[float, TextureModel]]] = field(default_factory=dict)
    tasks: list[asyncio.Task[None]] = field(default_factory=list)

    def start_on_event(self, sentence: str) -> Coroutine[Any, Any, str] | None:
        """Return a call of `open` if a sentence gives the URL; see `SideService`."""
        url = shared_at(sentence)
        return None if url is None else self.open(url)

    async def open(self, url: str) -> str:
        """Let all listeners join."""
        self.tasks = [asyncio.create_task(self.listen(url, name)) for name, _, _ in HANDS]
        return "two more hands listen"

    async def listen(self, url: str, name: str) -> None:
        """Keep each model with the session time that it was made at."""
        kept = self.models.setdefault(name, [])
        client = ListenerClient(Listening(url=url, name=name))
        await client.connect()
        try:
            while True:
                about, model = await client.next_state()
                if model is not None:
                    kept.append((about.time_s, model))
        finally:
            await client.close()


def main() -> None:
    """Run the demo, let two hands listen, draw, and write."""
    listeners = Listeners()
    session = asyncio.run(run(listeners))
    felt = [of_the_operator(session)]
    felt += [rendered(name, seed, hand, listeners.models[name]) for name, seed, hand in HANDS]
    first_s = min(kept[0][0] for kept in listeners.models.values())
    write("three-hands", three_hands(felt, first_s))


async def run(listeners: Listeners) -> RecordedSession:
    """Run the demo's services; return their recording."""
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / "session.mcap"
        overrides = {"session.duration_s": DURATION_S, "recording.file": str(file)}
        scene = load_scene(example_scenes()["demo"], overrides, tables=["sharing"])
        found = await run_services(scene, side_services=[listeners])
        if found.failed:
            raise MmtError("; ".join(found.errors))
        for task in listeners.tasks:
            task.cancel()
        await asyncio.gather(*listeners.tasks, return_exceptions=True)
        return read_session(file)


def of_the_operator(session: RecordedSession) -> Felt:
    """Return motion and vibration of the leader's hand, from its recording."""
    blocks = session.outputs
    vibration = np.concatenate([block.vibration_m_s2 for block in blocks])
    time_s = np.concatenate(
        [block.time_s + np.arange(len(block.vibration_m_s2)) / 1000.0 for block in blocks]
    )
    return Felt(
        "the operator",
        session.time_s,
        session.frames["position_mm"].astype(np.float64),
        time_s,
        vibration,
    )


def rendered(
    name: str, seed: int, settings: Hand, models: list[tuple[float, TextureModel]]
) -> Felt:
    """Render for a hand of this seed the models that its listener got."""
    hand = SimulatedHand(settings, seed)
    states = [hand.read(1) for _ in range(round(1000 * DURATION_S))]
    time_s = np.arange(len(states)) / 1000.0
    speed = np.array([np.hypot(*state.velocity_mm_s[:2]) for state in states])
    force = np.array([state.force_n for state in states])
    synthesizer, parts = Synthesizer(seed=seed), []
    ends = np.searchsorted(time_s, [at_s for at_s, _ in models]).tolist()
    for model, first, end in zip(
        [None, *(model for _, model in models)], [0, *ends], [*ends, len(states)], strict=True
    ):
        synthesizer.model = model
        parts.append(synthesizer.render(speed[first:end], force[first:end]))
    position = np.array([state.position_mm for state in states])
    return Felt(name, time_s, position, time_s, np.concatenate(parts))


def three_hands(felt: list[Felt], first_s: float) -> Figure:
    """Draw each hand's path, and the vibration that it feels, around the first model."""
    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    axes = figure.subplots(len(felt), 2, width_ratios=(1, 3.2), sharex="col", sharey="col")
    shown = (first_s - 0.5, first_s - 0.5 + SHOWN_S)
    for (way, trace), hand, colour in zip(axes, felt, SERIES, strict=False):
        within = (hand.time_s >= shown[0]) & (hand.time_s < shown[1])
        way.plot(*hand.position_mm[within, :2].T, color=colour, linewidth=1.2)
        way.set_ylabel("y (mm)")
        way.set_aspect("equal")
        seen = (hand.vibration_time_s >= shown[0]) & (hand.vibration_time_s < shown[1])
        trace.plot(
            hand.vibration_time_s[seen], hand.vibration_m_s2[seen], color=colour, linewidth=0.7
        )
        trace.axvline(first_s, color=LIGHT["faint"], linestyle="--", linewidth=1.0)
        trace.set(xlim=shown, ylabel="m/s²")
        trace.set_title(hand.name, loc="left", fontsize=10)
        for axis in (way, trace):
            style_axes(axis)
    axes[-1, 0].set_xlabel("x (mm)")
    axes[-1, 1].set_xlabel("session time (s); dashed: the model is ready")
    return figure


if __name__ == "__main__":
    main()
