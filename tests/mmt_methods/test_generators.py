"""Generators of other packages: found by name, built online, and checked block by block."""

import sys

import numpy as np
import pytest
from plugin_samples import install_package

from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.signals.filtering import StreamFilter
from mmt_methods.generators import registry
from mmt_methods.generators.building import GeneratorModeller
from mmt_methods.generators.guarded import GeneratorFault, GuardedGenerator

BLOCK = np.full(10, 100.0), np.full(10, 1.0)


class Gives:
    """Gives what it was made with, whatever it is asked."""

    def __init__(self, what):
        self.what = what

    def reset(self, seed):
        self.seed = seed

    def generate(self, *inputs):
        self.inputs = inputs
        if isinstance(self.what, Exception):
            raise self.what
        return self.what


def build(observed, previous):
    return Gives(np.zeros(10))


def build_alone(observed):
    return Gives(np.zeros(10))


def test_a_builder_is_found_by_module_and_by_entry_point(tmp_path, monkeypatch):
    here = f"{__name__}:build"
    assert registry.load(here) is build
    install_package(tmp_path, monkeypatch, "mine", {registry.GROUP: {"mine": here}})
    assert registry.load("mine") is build
    with pytest.raises(InputError, match=r"'hers' is not known; allowed are mine, package\.module"):
        registry.load("hers")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent_package:build", "absent_package:build cannot be imported .* PYTHONPATH"),
        (f"{__name__}:absent", "cannot be imported .*absent"),
        (f"{__name__}:build_alone", "build_alone is no builder"),
        ("nothing", "is not known; allowed are .*entry points of mmt.generators"),
    ],
)
def test_what_is_no_builder_is_refused_in_words(name, message):
    with pytest.raises(InputError, match=message):
        registry.load(name)


def test_a_module_that_fails_as_it_is_imported_is_told(tmp_path, monkeypatch):
    (tmp_path / "needs_more.py").write_text("raise RuntimeError('no weights file')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match="no weights file"):
        registry.load("needs_more:build")
    assert "needs_more" not in sys.modules


@pytest.mark.parametrize(
    ("what", "message"),
    [
        (ValueError("no\nstroke"), "generator mine: generate raised ValueError: no stroke"),
        (KeyError(), r"mine: generate raised KeyError \(.*test_generators.py, line \d+\)$"),
        (np.zeros(9), r"gave the shape \(9,\) for inputs of 10 samples: \(10,\) is due"),
        (np.zeros((10, 1)), r"gave the shape \(10, 1\)"),
        (None, r"gave the shape \(\)"),
        ("loud", "gave str, no array of numbers"),
        (np.full(10, np.nan), "gave a sample that is no number"),
        (np.full(10, -np.inf), "gave a sample that is no number"),
    ],
)
def test_what_cannot_be_felt_is_told_in_a_sentence(what, message):
    with pytest.raises(GeneratorFault, match=message):
        GuardedGenerator("mine", Gives(what)).render(*BLOCK)


def test_what_is_too_loud_is_clipped_and_counted():
    loud = np.array([0.0, 3.0, -3.0, 5.0, -7.0, *np.zeros(5)])
    guarded = GuardedGenerator("mine", Gives(loud), limit_m_s2=4.0)
    np.testing.assert_array_equal(guarded.render(*BLOCK)[:5], [0.0, 3.0, -3.0, 4.0, -4.0])
    guarded.render(*BLOCK)
    assert (guarded.samples, guarded.clipped) == (20, 4)
    assert loud[3] == 5.0


def test_a_generator_has_arrays_of_its_own_and_a_list_will_do():
    mine = Gives([1] * 10)
    guarded = GuardedGenerator("mine", mine)
    assert guarded.render(*BLOCK).tolist() == [1.0] * 10
    mine.inputs[0][:] = 0.0
    assert BLOCK[0][0] == 100.0
    guarded.reset(5)
    assert mine.seed == 5
    assert not guarded.directed
    with pytest.raises(GeneratorFault, match="returned list, which has no method reset"):
        GuardedGenerator("mine", [])


def session(seconds=4.0):
    frames, _ = simulate_session(Scene(), "wood", seconds, 1)
    return [frames[start : start + 1000] for start in range(0, len(frames), 1000)]


def test_a_builder_gets_the_segments_and_samples_of_our_own_modelling_and_what_it_made():
    calls = []

    def grow(observed, previous):
        calls.append((observed, previous))
        if observed.time_s < 1.5:
            return None
        return previous or Gives(np.zeros(10))

    modeller, ours = GeneratorModeller("mine", grow), OnlineModeller()
    blocks = session()
    sources = [modeller.update(block) for block in blocks]
    for block in blocks:
        ours.update(block)
    last = calls[-1][0]
    kept = sorted(ours.fits)
    assert sorted((s.start, s.stop) for s in last.segments) == kept
    assert modeller.segments == len(kept) > 3
    assert last.time_s == pytest.approx(4.0)
    assert (last.rate_hz, last.inputs) == (1000.0, "isotropic")
    assert len(last.samples) == 4000 - StreamFilter().delay_samples
    assert (np.diff(last.samples.index) == 1).all()
    assert sources[0] is None
    first = next(source for source in sources if source is not None)
    assert calls[-1][1] is first.generator
    assert sources[-1] is first
