"""What has changed of a model: applied, it gives the new state to the bit, or is refused."""

from dataclasses import replace

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sharing_samples import samples_of

from mmt.core.errors import InputError
from mmt.texture.model.file import arrays_of
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import ANISOTROPIC, ISOTROPIC
from mmt_share.changes import apply, difference

SPACES = pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC], ids=lambda space: space.name)


def model_of(space, numbers):
    return TextureModel(samples_of(numbers, space=space))


def over_the_wire(before, after):
    return msgpack.unpackb(msgpack.packb(difference(before, after)))


def assert_same(one, other):
    assert one.keys() == other.keys()
    for name, array in one.items():
        found, wanted = np.asarray(array), np.asarray(other[name])
        assert found.dtype == wanted.dtype
        assert found.shape == wanted.shape
        assert found.tobytes() == wanted.tobytes()


@SPACES
@given(
    earlier=st.lists(st.integers(0, 30), min_size=5, max_size=25, unique=True),
    later=st.lists(st.integers(0, 30), min_size=5, max_size=25, unique=True),
)
def test_any_state_of_a_model_follows_from_any_other(space, earlier, later):
    before = arrays_of(model_of(space, earlier).contents)
    after = arrays_of(model_of(space, later).contents)
    kept = {name: np.array(array) for name, array in before.items()}
    assert_same(apply(before, over_the_wire(before, after)), after)
    assert_same(before, kept)


def test_only_what_is_new_is_held():
    before = arrays_of(model_of(ISOTROPIC, range(200)).contents)
    after = arrays_of(model_of(ISOTROPIC, [*range(50), *range(51, 202)]).contents)
    change = difference(before, after)
    (rows,) = change["rows"]
    assert rows["plan"] == [[0, 50], [51, 200], [-1, 2]]
    assert {shape[0] for _, shape, _ in change["arrays"].values()} == {2}
    assert len(msgpack.packb(change)) < 600
    assert len(msgpack.packb(difference(after, after))) < 200


def test_another_order_or_space_brings_all_rows():
    before = arrays_of(model_of(ISOTROPIC, range(9)).contents)
    for model in (
        TextureModel(samples_of(range(9), order=8)),
        model_of(ANISOTROPIC, range(9)),
    ):
        after = arrays_of(model.contents)
        assert_same(apply(before, over_the_wire(before, after)), after)


def test_a_change_of_another_state_is_refused():
    before, after = (arrays_of(model_of(ISOTROPIC, range(n)).contents) for n in (9, 11))
    other = arrays_of(model_of(ISOTROPIC, range(20, 29)).contents)
    with pytest.raises(InputError, match="belongs to another state"):
        apply(other, over_the_wire(before, after))


def spoiled(change):
    """What must be refused, by what is wrong with it."""
    (rows,) = change["rows"]
    kind, shape, data = change["arrays"]["variance"]

    def with_plan(plan):
        return {**change, "rows": [{**rows, "plan": plan}]}

    def with_variance(*packed):
        return {**change, "arrays": {**change["arrays"], "variance": list(packed)}}

    return {
        "nothing": {},
        "no map": [1, 2],
        "no digest": {**change, "digest": None},
        "another digest": {**change, "digest": bytes(8)},
        "rows beyond the end": with_plan([[0, 500]]),
        "rows before the beginning": with_plan([[-5, 2]]),
        "rows that are not there": with_plan([[-1, 500]]),
        "a plan of text": with_plan("abc"),
        "endless rows": with_plan([[0, 9]] * 200_000),
        "objects": with_variance("|O", shape, data),
        "too few bytes": with_variance(kind, shape, data[:-3]),
        "a negative shape": with_variance(kind, [-7], data),
        "unknown names": {**change, "rows": [{**rows, "names": ["nobody"]}]},
    }


@pytest.mark.parametrize("wrong", list(spoiled({"rows": [{}], "arrays": {"variance": "abc"}})))
def test_a_malformed_change_is_refused(wrong):
    before, after = (arrays_of(model_of(ISOTROPIC, range(n)).contents) for n in (9, 11))
    change = spoiled(over_the_wire(before, after))[wrong]
    with pytest.raises(InputError, match="the change of a model"):
        apply(before, change)


def test_noise_power_that_appears_and_goes():
    with_noise = arrays_of(TextureModel(replace(samples_of(range(9)), noise_power=0.01)).contents)
    without = arrays_of(model_of(ISOTROPIC, range(9)).contents)
    assert with_noise.keys() != without.keys()
    for before, after in ((with_noise, without), (without, with_noise)):
        assert_same(apply(before, over_the_wire(before, after)), after)
