"""The leader's side of a passage: playout, modelling, switch and synthesis by its own code."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.leader.building import LeaderParts
from mmt.leader.part import Session
from mmt.leader.parts import build_parts
from mmt.scene import (
    Actuator,
    Hand,
    Link,
    Playout,
    Rendering,
    Scene,
    SessionTable,
    Simulated,
    Texture,
)
from mmt.testing.simulation import PERIOD_NS, RATE_HZ
from mmt.testing.simulation.known_surfaces import vibration_of
from mmt.testing.simulation.vibration import Stroke
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.online.updates import ModelUpdate
from mmt.texture.settings import Inputs, ModellingSettings
from mmt_lab.felt.passing import NEVER_TICK, Passage

BACKFILL_TICKS: Final = 250
"""Delay of the back-fill of a lost frame beyond the longest way there and back."""

UPDATE_TICKS: Final = 50
"""Ticks from a model's last frame until it is in use."""


@dataclass(frozen=True)
class FeltVibration:
    """Vibration that a method gives the hand.

    ``vibration_m_s2`` has shape (n,); ``start_s`` is when the model took over, or None if it did
    not.
    """

    vibration_m_s2: FloatArray
    start_s: float | None


def undelayed_vibration(passage: Passage, seed: int) -> FeltVibration:
    """Return the surface's vibration at the hand's own speed and force, without a delay.

    It is a separate realisation: no rendering from a model can come nearer to the texture.
    """
    surface = vibration_of(passage.surface, np.random.default_rng([seed, 77]))
    motion = zip(
        passage.speed_mm_s.tolist(),
        passage.force_n.tolist(),
        passage.heading.tolist(),
        np.cumsum(passage.velocity_mm_s / RATE_HZ, axis=0).tolist(),
        strict=True,
    )
    values = [
        surface.step(Stroke(speed, force, (u, v), (x, y)))[0]
        for speed, force, (u, v), (x, y) in motion
    ]
    return FeltVibration(np.array(values), 0.0)


def leader_vibration(
    passage: Passage, models: Mapping[int, TextureModel] | None, seed: int
) -> FeltVibration:
    """Return the vibration that a leader plays from the frames of a passage.

    Parameters
    ----------
    passage
        The frames with their arrivals, and the hand's motion.
    models
        The models to render, by the tick from which each is used; None to play the stream alone.
    seed
        Seed of the synthesis and of the concealment.
    """
    ticks = len(passage.frames)
    parts = _leader(seed, renders=models is not None)
    stream, vibration, rendering = parts.playout, parts.vibration, parts.synthesizing
    assert stream is not None and vibration is not None  # noqa: S101, PT018 - the scene has both
    switch = vibration.switch
    directed = not passage.surface.isotropic
    drives = passage.velocity_mm_s.T if directed else passage.speed_mm_s[None]
    inputs = np.vstack([drives, passage.force_n])
    order = np.argsort(passage.arrival_tick, kind="stable")
    arrived = np.searchsorted(passage.arrival_tick[order], np.arange(ticks), side="right").tolist()
    output = np.empty(ticks)
    taken, start_s = 0, None
    for tick in range(ticks):
        if models is not None and rendering is not None and tick in models:
            rendering.synthesizer.model = models[tick]
            switch.use_model(True)
            start_s = tick / RATE_HZ if start_s is None else start_s
        for index in order[taken : arrived[tick]]:
            stream.on_frames(passage.frames[index : index + 1], tick * PERIOD_NS)
        taken = arrived[tick]
        output[tick] = switch.render(tick * PERIOD_NS, *inputs[:, tick : tick + 1])[0]
    return FeltVibration(output, start_s)


def _leader(seed: int, *, renders: bool) -> LeaderParts:
    """Return the leader's own parts that play, with the scene's defaults."""
    scene = Scene(
        session=SessionTable(seed=seed),
        link=Link(),
        simulated=Simulated(),
        hand=Hand(),
        texture=Texture(),
        rendering=Rendering() if renders else None,
        playout=Playout(),
        actuator=Actuator(),
    )
    return build_parts(Session(scene), ("playout", "synthesizing", "vibration"))


def settings_over(passage: Passage, texture: Mapping[str, Any]) -> ModellingSettings:
    """Return keys of ``[texture]`` as settings, with the inputs that the surface needs."""
    inputs: Inputs = "isotropic" if passage.surface.isotropic else "anisotropic"
    return ModellingSettings(inputs=inputs, **texture)


def taking_over(updates: Mapping[int, ModelUpdate]) -> dict[int, TextureModel]:
    """Return the models of the updates from the start criterion on, by their ticks."""
    return {
        tick: update.model
        for tick, update in updates.items()
        if update.started and update.model is not None
    }


def local_updates(passage: Passage, settings: ModellingSettings) -> dict[int, ModelUpdate]:
    """Return the updates of the local model, by the tick from which each is in use.

    An update takes the frames of one second, delimited by sequence numbers. As in the leader's
    modelling, it waits until lost frames are filled in.
    """
    modeller, updates = OnlineModeller(settings), {}
    period = round(RATE_HZ)
    come = _filled_in(passage.arrival_tick)
    for first in range(0, len(passage.frames) - period + 1, period):
        update = modeller.update(passage.frames[first : first + period])
        updates[int(come[: first + period].max()) + UPDATE_TICKS] = update
        if update.stopped:
            break
    return updates


def _filled_in(arrival_tick: IntArray) -> IntArray:
    """Return the tick at which each frame has come; lost frames come by back-fill."""
    sent = np.arange(len(arrival_tick))
    lost = arrival_tick == NEVER_TICK
    longest = int((arrival_tick - sent)[~lost].max()) if not lost.all() else 0
    return np.where(lost, sent + 2 * longest + BACKFILL_TICKS, arrival_tick)
