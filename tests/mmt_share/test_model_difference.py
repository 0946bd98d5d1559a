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


def test_a_malformed_change_is_refused():
    before, after = (arrays_of(model_of(ISOTROPIC, range(n)).contents) for n in (9, 11))
    change = over_the_wire(before, after)
    (rows,), arrays = change["rows"], change["arrays"]
    kind, shape, data = arrays["variance"]
    beyond_the_end, before_the_beginning, not_there = [[0, 500]], [[-5, 2]], [[-1, 500]]
    plans = (beyond_the_end, before_the_beginning, not_there, "abc", [[0, 9]] * 200_000)
    objects, no_dtype = ["|O", shape, data], ["f8,(", shape, data]
    too_few_bytes = [kind, shape, data[:-3]]
    wrong = [{}, [1, 2], {**change, "digest": None}, {**change, "digest": bytes(8)}]
    wrong += [{**change, "rows": [{**rows, "plan": plan}]} for plan in plans]
    wrong += [{**change, "rows": [{**rows, "names": ["nobody"]}]}]
    variances = (objects, no_dtype, too_few_bytes, [kind, [-7], data])
    wrong += [{**change, "arrays": {**arrays, "variance": each}} for each in variances]
    for each in wrong:
        with pytest.raises(InputError, match="the change of a model"):
            apply(before, each)


def test_noise_power_that_appears_and_goes():
    with_noise = arrays_of(TextureModel(replace(samples_of(range(9)), noise_power=0.01)).contents)
    without = arrays_of(model_of(ISOTROPIC, range(9)).contents)
    assert with_noise.keys() != without.keys()
    for before, after in ((with_noise, without), (without, with_noise)):
        assert_same(apply(before, over_the_wire(before, after)), after)
