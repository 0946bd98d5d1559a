"""Fitted segments: which are refused, and what they tell of themselves."""

from dataclasses import replace

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.texture.space import ANISOTROPIC, ISOTROPIC, LARGEST_POWER, TextureSamples

SPEED, FORCE = np.array([50.0, 0.0, 120.0]), np.array([0.5, 0.7, 0.0])
POWER = np.array([0.0, LARGEST_POWER, 1.0])
LSF = np.tile([0.4, 0.9, 1.5, 2.5], (3, 1))
PLANE = TextureSamples.isotropic(SPEED, FORCE, LSF, POWER, POWER)
SPACE = replace(PLANE, inputs=np.column_stack([-SPEED, SPEED, FORCE]), space=ANISOTROPIC)


def orders(count):
    return np.tile(np.linspace(0.01, 3.14, count), (3, 1))


@pytest.mark.parametrize("samples", [PLANE, SPACE], ids=["plane", "space"])
def test_samples_within_bounds_pass_and_tell_their_inputs(samples):
    some = np.array([1e-9, 1.0, LARGEST_POWER])
    for changes in (
        {},
        {"lsf": orders(1)},
        {"lsf": orders(64)},
        {"effective": some, "counts": some},
    ):
        replace(samples, **changes).check()
    assert len(samples) == 3
    np.testing.assert_array_equal(samples.force_n, FORCE)
    np.testing.assert_allclose(samples.speed_mm_s, SPEED * np.sqrt(samples.inputs.shape[1] - 1))
    np.testing.assert_allclose(samples.points, samples.inputs / samples.space.scale)


SPOILT = np.array([1.0, np.nan, 1.0])
NEGATIVE = np.array([1.0, -1e-9, 1.0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lsf": LSF[:0], "inputs": PLANE.inputs[:0]}, r"lsf has shape \(0, 4\): at least one"),
        ({"lsf": LSF[0]}, "at least one sample"),
        ({"lsf": LSF[:, :0]}, "at least one sample"),
        ({"lsf": orders(65)}, "order 1 to 64"),
        ({"lsf": np.array([["a"]])}, "lsf is of"),
        ({"inputs": np.array(["a"])}, "inputs is of"),
        ({"inputs": SPACE.inputs}, r"inputs has shape \(3, 3\), \(3, 2\) needed"),
        ({"power": POWER[:2]}, r"power has shape \(2,\), \(3,\) needed"),
        ({"variance": SPOILT}, r"variance must be finite, at most 1e\+300 and not negative"),
        ({"power": NEGATIVE}, "power must be finite"),
        ({"power": 1.001 * POWER}, "power must be finite"),
        ({"inputs": PLANE.inputs * (-1.0, 1.0)}, "speed_mm_s must be finite.* not negative"),
        ({"effective": np.array([1.0, 0.0, 1.0])}, "effective must be positive"),
        ({"counts": np.array([1.0, 0.0, 1.0])}, "counts must be positive"),
        *(({"noise_power": wrong}, "noise_power is ") for wrong in (np.nan, -1.0, 1.7e308)),
        *(
            ({"lsf": np.array([[0.4, wrong, 2.5]] * 3)}, "lsf must ascend")
            for wrong in (0.4, 2.5, np.nan)
        ),
        ({"lsf": LSF - 0.4}, "lsf must ascend"),
        ({"lsf": LSF - 2.5 + np.pi}, "lsf must ascend"),
    ],
)
def test_samples_that_cannot_be_are_explained(changes, words):
    with pytest.raises(InputError, match=words):
        replace(PLANE, **changes).check()
    with pytest.raises(InputError, match=r"velocity_x_mm_s must be finite, at most 1e\+300$"):
        replace(SPACE, inputs=SPACE.inputs - (np.inf, 0.0, 0.0)).check()
    for given, name in (((SPEED[:2], FORCE), "speed_mm_s"), ((SPEED, FORCE[:2]), "force_n")):
        with pytest.raises(InputError, match=rf"{name} has shape \(2,\), \(3,\) needed"):
            TextureSamples.isotropic(*given, LSF, POWER, POWER)


def test_a_frozen_copy_is_of_its_own():
    inputs, counts = np.column_stack([SPEED, FORCE]), np.ones(3, np.int64)
    given = TextureSamples.isotropic(SPEED, FORCE, LSF, 0.5 * POWER, POWER)
    frozen = replace(given, counts=counts, noise_power=0.5).frozen()
    assert (frozen.effective, frozen.noise_power, frozen.space) == (None, 0.5, ISOTROPIC)
    arrays = {"lsf": LSF, "variance": 0.5 * POWER, "power": POWER, "counts": counts}
    for name, wanted in {"inputs": inputs, **arrays}.items():
        array = getattr(frozen, name)
        np.testing.assert_array_equal(array, wanted)
        assert array.dtype == np.float64
        assert not array.flags.writeable
        assert not np.shares_memory(array, wanted)
