"""Generators judged beside the methods: known answers, faults, and the command."""

import re
import signal
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from lab_runs import run_lab

from mmt.core.errors import InputError
from mmt.evaluation.model_errors import Strokes
from mmt.evaluation.strokes_made import StrokesMade
from mmt.evaluation.truth import KnownTexture
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt.texture.online.history import build as build_models
from mmt.texture.synthesis.synthesizer import Synthesizer
from mmt_lab.compare.cases import ComparisonCase
from mmt_lab.compare.generators import (
    check_generators,
    failures,
    generator_sentences,
    generators_table,
    judge_generators,
)
from mmt_lab.compare.judging import blocks_of, figures_of, settings_of
from mmt_lab.compare.rendered_spectra import (
    expected_spectra,
    render_strokes,
    rendered_errors,
    spectra_of,
)
from mmt_lab.compare.time_limit import time_limit
from mmt_lab.experiments import compare
from mmt_methods.generators.guarded import GeneratorFault, GuardedGenerator

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "add-a-generator.md"
CLOSE = {
    "within_jnd": 0.09,
    "power_error_db": 0.1,
    "gfc": 0.003,
    "log_spectral_db": 0.15,
    "band_error_db": 0.12,
}
"""How far an estimate may be from a model's exact figure, three strokes of the 36 for the share;
with 6 s a run on five textures at most 0.06, 0.05, 0.001, 0.05 and 0.05 were seen."""


class Noise:
    """White noise of 1 m/s2 rms over 0 to 500 Hz, times a gain."""

    def __init__(self, gain=1.0, pause_s=0.0):
        self._gain, self._pause_s = gain, pause_s

    def reset(self, seed):
        self._random = np.random.default_rng(seed)

    def generate(self, *inputs):
        time.sleep(self._pause_s)
        return self._gain * self._random.standard_normal(len(inputs[0]))


def build_noise(observed, previous):
    return Noise() if observed.segments else None


def build_late(observed, previous):
    """Fail at the sixth second."""
    if observed.time_s > 5.5:
        raise RuntimeError("diverged")
    return Noise(gain=50.0)


RAISES = f"{__file__}, line {build_late.__code__.co_firstlineno + 3}"


def build_silent(observed, previous):
    return None


class ModelGenerator:
    """A texture model as a generator: the synthesizer of the leader."""

    def __init__(self, model):
        self._model = model
        self.directed = model.space.directed

    def reset(self, seed):
        self._synthesizer = Synthesizer(self._model, seed=seed, limit_m_s2=np.inf)

    def generate(self, *inputs):
        return self._synthesizer.render(*inputs)


class White:
    """A texture of white noise: 1 m/s2 rms over 0 to 500 Hz at any stroke."""

    def spectrum(self, strokes, frequencies_hz):
        return np.full((len(strokes.force_n), len(frequencies_hz)), 1.0 / 500.0)


def errors_of(generator, run_s=2.0):
    strokes = Strokes(np.full(36, 100.0), np.full(36, 1.0), np.zeros(36))
    vibration, _ = render_strokes(GuardedGenerator("noise", generator), strokes, 1, run_s)
    return rendered_errors(spectra_of(vibration), expected_spectra(White(), strokes))


def test_a_generator_that_is_the_texture_has_no_error_and_one_3_db_louder_has_3_db():
    same, scatter_db = errors_of(Noise())
    assert same["within_jnd"] == 1.0
    assert same["power_error_db"] < 0.1
    assert same["gfc"] > 0.995
    assert same["log_spectral_db"] < 0.6
    # White noise for 4 s has 1000 independent values in its band and half: 0.1 dB.
    assert scatter_db == pytest.approx(4.34 / np.sqrt(2000), rel=0.4)
    louder, _ = errors_of(Noise(gain=np.sqrt(2.0)))
    assert louder["power_error_db"] == pytest.approx(3.01, abs=0.1)
    assert louder["band_error_db"] == pytest.approx(3.01, abs=0.15)
    assert louder["log_spectral_db"] == pytest.approx(3.01, abs=0.4)
    assert louder["gfc"] == pytest.approx(same["gfc"], abs=0.005)
    assert louder["within_jnd"] == 0.0


@pytest.mark.parametrize("texture", ["drawn-3", "corduroy"])
def test_the_estimate_of_our_own_model_agrees_with_its_exact_figures(texture):
    case = ComparisonCase(texture, 1000)
    blocks = blocks_of(case.session())
    made = StrokesMade.from_frames(blocks, settings_of(case, "field"))
    model = build_models(blocks, settings_of(case, "field")).model_at(10.0)
    truth = KnownTexture(get_surface(texture))
    strokes = made.strokes(36)
    source = GuardedGenerator("field", ModelGenerator(model))
    vibration, _ = render_strokes(source, strokes, 1, 3.0)
    rendered, scatter_db = rendered_errors(spectra_of(vibration), expected_spectra(truth, strokes))
    exact = figures_of(truth.at(strokes).errors(model))
    for figure in exact:
        assert rendered[figure] == pytest.approx(exact[figure], abs=CLOSE[figure]), figure
    assert 0.02 < scatter_db < 0.4


def stubborn():
    with time_limit(0.05, "too long"):
        while True:
            with suppress(Exception):  # code that is not ours may do so
                time.sleep(0.001)


def test_a_block_that_never_ends_is_interrupted_and_an_earlier_timer_goes_on():
    before = signal.getitimer(signal.ITIMER_REAL)[0]
    handler = signal.getsignal(signal.SIGALRM)
    with pytest.raises(GeneratorFault, match="too long"):
        stubborn()
    left = signal.getitimer(signal.ITIMER_REAL)[0]
    assert (left > 0.0) == (before > 0.0)
    assert left <= before
    assert signal.getsignal(signal.SIGALRM) is handler


def test_a_generator_slower_than_real_time_is_told():
    with pytest.raises(GeneratorFault, match=r"generator noise: slower than real time, 0\.8 s of"):
        errors_of(Noise(pause_s=0.02), run_s=0.6)


def test_a_fault_ends_a_session_for_its_generator_alone():
    names = [f"{__name__}:{name}" for name in ("build_late", "build_noise", "build_silent")]
    late, noise, silent = names
    rendered, faults = judge_generators(ComparisonCase("wood", 1000), names, 2.0)
    moments = {name: [] for name in names}
    for one in rendered:
        moments[one.judged.method].append(one.judged.moment)
        assert 0.0 < one.block_us[0] <= one.block_us[1]
        assert 0.0 < one.update_ms[0] <= one.update_ms[1]
    assert moments == {late: ["3 s"], noise: ["3 s", "10 s", "20 s", "30 s"], silent: []}
    assert [fault.generator for fault in faults] == [late, silent]
    clipped = {one.judged.method: one.clipped for one in rendered}
    assert 0.1 < clipped[late] < 0.4
    assert clipped[noise] == 0.0
    assert [text.partition(" (in 2 sessions")[0] for text in failures([*faults, *faults])] == [
        f"generator {late}: the builder raised RuntimeError: diverged ({RAISES})",
        f"generator {silent}: the builder returned None for the whole session",
    ]
    assert [row[0] for row in generators_table(rendered).rows] == [late, noise]
    slow = [replace(one, block_us=(5_000.0, 20_000.0)) for one in rendered[1:]]
    assert "at 4 of 4 times" in " ".join(generator_sentences(slow))
    assert generator_sentences(rendered[:1]) == []


def test_generators_are_named_once_and_not_as_a_method():
    noise = f"{__name__}:build_noise"
    with pytest.raises(InputError, match="name each once"):
        check_generators([noise, noise])
    with pytest.raises(InputError, match="'soup' is not known"):
        check_generators(["soup"])


def test_the_command_compares_the_guides_generator_and_goes_on_past_a_broken_one(
    tmp_path, monkeypatch
):
    example = re.search(r"```python\n(.*?)^```$", GUIDE.read_text(), re.DOTALL | re.MULTILINE)
    (tmp_path / "replay.py").write_text(example[1])
    monkeypatch.syspath_prepend(tmp_path)
    others = f"replay:build,{__name__}:build_late"
    monkeypatch.setattr(compare, "judge_generators", partial(judge_generators, run_s=1.0))
    options = ["--generators", others, "--methods", "published,field", "--textures", "drawn-3"]
    options += ["--seeds", "1", "--workers", "1"]
    options += ["--report", str(tmp_path / "report")]
    data, output = run_lab(tmp_path, "compare", *options, code=1)
    assert "the builder raised RuntimeError: diverged" in " ".join(output.split())
    found = {(row["name"], row["method"], row["moment"]): row for row in data["rows"]}
    of_replay = found["drawn-3", "replay:build", "30 s"]["figures"]
    assert 0.9 < of_replay["gfc"]["median"] < 1.0
    assert 0.5 < of_replay["power_error_db"]["median"] < 5.0
    assert {"published", "field", "replay:build"} <= {row["method"] for row in data["rows"]}
    assert [fault["reason"] for fault in data["faults"]] == [
        f"generator {__name__}:build_late: the builder raised RuntimeError: diverged ({RAISES})"
    ]
    page = (tmp_path / "report" / "report.html").read_text()
    assert "scatter of the estimates" in page
    assert "diverged" in page
