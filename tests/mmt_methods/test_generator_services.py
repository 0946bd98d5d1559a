"""A generator of another package in the leader: fitted, felt, recorded, and what goes wrong."""

import re
import time

import numpy as np
import pytest
from plugin_samples import install_package
from service_runs import Together, small_scene
from waiting import until

from mmt.core.errors import InputError
from mmt.evaluation.run_verdict import fault_sentences
from mmt.leader.part import Part, Session
from mmt.leader.parts import PARTS, build_parts
from mmt.leader.service import Leader
from mmt.scene import Scene
from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.online.modeller import OnlineModeller
from mmt_methods.generators.part import GeneratingPart
from mmt_methods.generators.registry import GROUP

ORIGIN = "band_plugin:band of band-plugin 2.1"

PLUGIN = '''
"""Noise of a band that no texture here has, as loud as the strokes were; and faulty ones."""

import os
import time

import numpy as np

POLE = 0.985 * np.exp(2j * np.pi * 400.0 / 1000.0)  # of a resonance 5 Hz wide


class BandNoise:
    def __init__(self, segments, fault=None):
        self._points = np.array([(s.speed_mm_s / 300.0, s.force_n / 3.0) for s in segments])
        self._rms = np.array([s.vibration_m_s2.std() for s in segments])
        self._fault = fault

    def reset(self, seed):
        self._random = np.random.default_rng(seed)
        self._state = 0j
        self._done = 0

    def generate(self, speed_mm_s, force_n):
        self._done += len(force_n)
        if self._fault is not None and self._done > 300:
            return self._fault(force_n)
        output = np.empty(len(force_n))
        for index, noise in enumerate(self._random.standard_normal(len(force_n))):
            self._state = POLE * self._state + noise * np.sqrt(2.0 - 2.0 * abs(POLE) ** 2)
            output[index] = self._state.real
        here = np.stack([speed_mm_s / 300.0, force_n / 3.0], axis=1)
        near = np.exp(-20.0 * np.square(here[:, None] - self._points).sum(axis=2)) + 1e-9
        return output * (near @ self._rms) / near.sum(axis=1)


def no_number(force_n):
    return np.full(len(force_n), np.nan)


def leaves(force_n):
    os._exit(3)


def hangs(force_n):
    time.sleep(3600.0)


def made(fault):
    def build(observed, previous):
        return BandNoise(observed.segments, fault) if observed.segments else None

    return build


band = made(None)
nan, leaving, hanging = map(made, (no_number, leaves, hangs))


def build_raising(observed, previous):
    if observed.segments:
        raise ValueError("no two segments are alike")


def no_copy(observed, previous):
    made = BandNoise(observed.segments)
    made.reset = lambda seed: None
    return made


def quits(observed, previous):
    os._exit(5)
'''


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    """An installed package, by its files alone, that offers these generators."""
    (tmp_path / "band_plugin.py").write_text(PLUGIN, encoding="utf-8")
    names = ["band", "nan", "leaving", "hanging", "build_raising", "no_copy", "quits", "lacking"]
    offered = {name: f"band_plugin:{name}" for name in names}
    install_package(tmp_path, monkeypatch, "band-plugin", {GROUP: offered}, version="2.1")


def scene_with(directory, generator, duration_s=3.5):
    """Strokes on felt, replayed; the model is ready as soon as there is one."""
    frames, annotations = simulate_session(Scene(), "felt", duration_s, 4)
    session = directory / "strokes.npz"
    write_session(session, frames, annotations=annotations)
    return small_scene(
        directory,
        simulated=None,
        hand=None,
        replay={"file": str(session)},
        texture={"start_share": 0.05, "stop_share": 0.9999},
        rendering={"generator": generator},
    )


async def led(scene):
    together = Together.of(scene)
    await together.listen()
    await together.follow()
    return together, await together.end()


async def test_it_is_fitted_while_the_surface_is_touched_felt_and_recorded(tmp_path, plugin):
    scene = scene_with(tmp_path, "band")
    together, summary = await led(scene)
    said = f"generator band ({ORIGIN}) renders"
    assert said in together.said
    table = summary.as_dict()["generator"]
    assert (table["name"], table["origin"], table["fault"]) == ("band", ORIGIN, None)
    assert table["heard_from_s"] >= summary.texture["start_s"]
    assert table["fits"] >= 2
    assert table["segments"] >= 2
    assert 0.0 < table["fit_median_ms"] <= table["fit_longest_ms"]
    assert 0.0 < table["block_p50_ms"] <= table["block_p99_ms"]
    assert table["blocks"] > 100
    assert table["core_share"] > 0.0
    assert table["memory_mb"] > 30.0
    recorded = read_session(scene.recording.file)
    assert recorded.scene["rendering"]["generator"] == "band"
    events = [event for event in recorded.events if event.get("generator") == "band"]
    told = [(event["event"], event["origin"], event["heard"]) for event in events]
    assert told == [(said, ORIGIN, True)]
    assert recorded.models  # ours, which listeners get
    assert band_share(recorded, "synthesized", events[0]["time_s"] + 0.2) > 0.8
    assert band_share(recorded, "streamed", 0.0) < 0.3


def band_share(session, mode, from_s):
    """Return the share of the power between 370 and 430 Hz of what was played."""
    played = [o.vibration_m_s2 for o in session.outputs if o.mode == mode and o.time_s >= from_s]
    power = np.square(np.abs(np.fft.rfft(np.concatenate(played))))
    frequencies_hz = np.linspace(0.0, 500.0, len(power))
    return float(power[np.abs(frequencies_hz - 400.0) < 30.0].sum() / power.sum())


async def test_a_builder_that_fails_leaves_the_session_to_our_model(tmp_path, plugin):
    scene = scene_with(tmp_path, "build_raising", 2.0)
    together, summary = await led(scene)
    fault = summary.more["generator"]["fault"]
    said = "generator build_raising: the builder raised ValueError: no two segments are alike ("
    assert fault.startswith(said)
    assert ".py, line " in fault
    assert f"{fault}: our model renders in its place" in together.said
    assert summary.outcome == "source ended"
    assert summary.vibration["mode"] == "synthesized"
    assert summary.recording["frames"] == 2000
    assert f"leader: {fault}; our model was rendered in its place" in fault_sentences(
        "leader", summary.as_dict()
    )
    assert any(event.get("heard") is False for event in read_session(scene.recording.file).events)


FAULTS = {
    "nan": "generate gave a sample that is no number",
    "leaving": "the process that renders has ended",
    "hanging": "too slow, ",
    "no_copy": "copying it to the process that renders (pickle) raised ",
    "quits": "the process that fits has ended",
}


MOTION = np.full((3, 10), [[80.0], [0.0], [1.0]])


def strokes():
    """What the updates of two seconds on felt have got."""
    frames, _ = simulate_session(Scene(), "felt", 2.0, 4)
    return list(OnlineModeller().segment(frames))


def part_with(directory, generator, events=None):
    """The part by itself, without a link and ticks."""
    session = Session(small_scene(directory, texture={}, rendering={"generator": generator}))
    parts = build_parts(session, ["modelling", "synthesizing", "generating"])
    if events is not None:
        parts.add(events)
    part = parts.generating
    assert isinstance(part, GeneratingPart)
    return part


def feed(part, work):
    for each in work:
        part._session.parts.modelling._on_samples(each.samples)


def end(part):
    part.close()
    part._session.parts.modelling.close()
    assert all(process.returncode is not None for process in part._processes.values())


def test_what_goes_wrong_is_told_in_a_sentence(tmp_path, plugin):
    """All at once, each in processes of its own."""
    events, work = {name: Events() for name in FAULTS}, strokes()
    parts = {name: part_with(tmp_path, name, events[name]) for name in FAULTS}
    try:
        for part in parts.values():
            part.connect()
            part.start_rendering()
            feed(part, work)
        deadline_s = time.monotonic() + 60.0
        while any(not events[name].told for name in FAULTS) and time.monotonic() < deadline_s:
            for part in parts.values():
                began_s = time.monotonic()
                part.vibration.render(*MOTION)
                assert time.monotonic() - began_s < 1.0  # whatever it does, hanging included
                part.poll()
            time.sleep(0.01)
    finally:
        for part in parts.values():
            end(part)
    for name, fault in FAULTS.items():
        sentence = events[name].told[-1]
        assert sentence.startswith(f"generator {name}: {fault}"), sentence
        assert sentence.endswith(": our model renders in its place")
        assert parts[name].faults()


class Events(Part):
    """Keeps the sentences of what is told of a fault."""

    def __init__(self):
        self.told = []

    def on_event(self, event, sentence):
        if sentence is not None and not event["heard"]:
            self.told.append(sentence)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("lacking", "generator 'lacking': band_plugin:lacking cannot be imported"),
        ("unknown", "generator 'unknown' is not known; allowed are band, "),
    ],
)
async def test_a_generator_that_is_not_there_ends_the_start(tmp_path, plugin, name, sentence):
    scene = small_scene(tmp_path, texture={}, rendering={"generator": name})
    with pytest.raises(InputError, match=re.escape(sentence)):
        await Leader(scene).run()


def test_a_scene_without_one_wants_no_part_of_it(tmp_path):
    assert not PARTS["generating"].wanted(small_scene(tmp_path, texture={}, rendering={}))


def test_after_a_reset_it_learns_anew(tmp_path, plugin):
    part, work = part_with(tmp_path, "band"), strokes()

    def renders():
        part.vibration.render(*MOTION)
        part.poll()
        return part.vibration.is_rendered

    try:
        part.connect()
        for epoch in range(2):
            assert part.vibration.epoch == epoch
            part.start_rendering()
            assert not part.vibration.is_rendered
            feed(part, work)
            until(renders)
            part.reset()
    finally:
        end(part)
    assert part.summary(0.0)["generator"]["fits"] >= 1
