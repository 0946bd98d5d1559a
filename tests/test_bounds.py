"""Settings are checked by their annotations, alike wherever they come from."""

import math
from dataclasses import fields
from typing import get_type_hints

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from mmt.core.bounds import check, finite_number, real_numbers
from mmt.core.errors import InputError
from mmt.scene.leader_tables import TEXTURE_TABLE
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import (
    ModellingSettings,
    SurfaceSettings,
    TextureSettings,
)
from mmt.texture.space import LARGEST_POWER, InputSpace, TextureSamples

NUMBERS = [math.nan, math.inf, -math.inf, -1.0, -1, 0, 0.0, 1, 0.5, 2.5, 7, 64, 65, 1e6, 1.7e308]
OTHERS = ["auto", "delaunay", "no such thing", None, True, []]


def test_real_numbers_are_taken_in_their_shape_and_all_else_refused():
    for values in (1, [1, 2], np.float32([[0.5]]), np.uint8([3]), [math.nan]):
        found = real_numbers("lsf", values)
        np.testing.assert_array_equal(found, values)
        assert found.dtype == np.float64
    for wrong in ("a", ["a"], 1j, [None], [True], [[1.0], [1.0, 2.0]]):
        with pytest.raises(InputError, match=r"^lsf is "):
            real_numbers("lsf", wrong)


@pytest.mark.parametrize("owner", [TextureSettings, SurfaceSettings])
def test_a_value_is_allowed_exactly_where_pydantic_allows_it(owner):
    for name, hint in get_type_hints(owner, include_extras=True).items():
        adapter = TypeAdapter(hint)
        for value in [*NUMBERS, *OTHERS]:
            try:
                adapter.validate_python(value, strict=True)
                allowed = not isinstance(value, float) or math.isfinite(value)
            except ValidationError:
                allowed = False
            if allowed:
                check(name, value, hint)
                continue
            with pytest.raises(InputError) as caught:
                check(name, value, hint)
            assert str(caught.value).startswith(f"{name} is {value!r}, allowed is ")


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"start_share": -1}, "start_share is -1, allowed is a finite number above 0 and below 1"),
        ({"start_share": math.nan}, "start_share is nan"),
        ({"method": "none"}, "method is 'none', allowed is \""),
        ({"order": 2.5}, "order is 2.5, allowed is a whole number at least 1 and at most 64"),
        ({"order": True}, "order is True"),
        ({"rate_hz": math.nan}, "rate_hz is nan"),
        ({"rate_hz": 0}, "rate_hz is 0"),
        ({"rate_hz": -5}, "rate_hz is -5"),
        ({"surfaces": 3}, "surfaces is 3, allowed is SurfaceSettings or None"),
        ({"longest_samples": 130}, "at least twice"),
    ],
)
def test_settings_of_the_library_are_checked(keys, told):
    with pytest.raises(InputError) as caught:
        ModellingSettings(**keys)
    assert told in str(caught.value)


def test_numbers_are_finite_whatever_they_come_as():
    assert finite_number("-2.5e3") == -2500.0
    for text in ("nan", "-inf", "1e999", "", "one"):
        with pytest.raises(ValueError, match=r"not finite|could not convert"):
            finite_number(text)
    with pytest.raises(InputError, match=r"^x is 10+, allowed is a finite number$"):
        check("x", 10**400, float)
    for value in (0.0, -1.0, math.nan, math.inf, "wide"):
        with pytest.raises(InputError, match=r"maximum_force_n is .*, allowed is a finite"):
            InputSpace(maximum_force_n=value)
    settings = ModellingSettings(order=np.int64(5), rate_hz=np.float32(500.0))
    assert (settings.order, settings.rate_hz) == (5, 500.0)


def test_a_scene_names_every_value_that_is_not_allowed():
    with pytest.raises(ValidationError) as caught:
        TEXTURE_TABLE.validate_python({"order": 65, "least_force_n": 0.0})
    assert {problem["loc"][0] for problem in caught.value.errors()} == {"order", "least_force_n"}
    assert {field.name for field in fields(TextureSettings)} >= {"order", "least_force_n"}


def samples(power):
    speed, force = np.array([50.0, 200.0, 120.0]), np.array([0.5, 0.7, 2.0])
    lsf = np.tile([0.4, 0.9, 1.5, 2.5], (3, 1))
    return TextureSamples.isotropic(speed, force, lsf, np.full(3, 0.1 * power), np.full(3, power))


def test_a_model_of_the_largest_power_is_finite():
    model = TextureModel(samples(LARGEST_POWER))
    assert np.isfinite(model.level_db([0.0, 100.0, 300.0], [0.0, 1.0, 3.0])).all()
    assert np.isfinite(model.spectrum(100.0, 1.0, frequencies_hz=np.arange(0.0, 500.0))).all()


@pytest.mark.parametrize("rate_hz", [math.nan, 0.0, -5.0, math.inf])
def test_the_rate_of_a_model_is_checked(rate_hz):
    with pytest.raises(InputError, match=r"rate_hz is .*, allowed is a finite number at least 1"):
        TextureModel(samples(1.0), rate_hz=rate_hz)
