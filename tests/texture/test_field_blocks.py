"""Blocks of a stream: what is cut, what is left out, and what is withdrawn again."""

import numpy as np
import pytest
from stream_samples import aligned

from mmt.texture.field.blocks import WITHDRAWN_S, BlockCutter, BlockSums
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.space import ANISOTROPIC, ISOTROPIC


def stroke(count, first=0, speed=100.0, force=1.0, seed=0):
    along = 0.1 * (first + np.arange(count))
    return aligned(
        2.0 * np.random.default_rng(seed).standard_normal((count, 1, 1)),
        first,
        position_mm=np.column_stack([along, np.zeros(count), np.full(count, -0.5)]),
        velocity_mm_s=[0.6 * speed, 0.8 * speed],
        speed_mm_s=speed,
        normal_force_n=force,
    )


def cutter(space=ISOTROPIC):
    return BlockCutter(ModellingSettings(inputs=space.name))


@pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC])
def test_a_block_is_a_twentieth_of_a_second_of_a_stroke(space):
    part = stroke(1000)
    found = cutter(space).cut([part])
    assert found.start.tolist() == list(range(50, 1000, 50))  # the first is the touchdown's
    expected = [60.0 / 300, 80.0 / 300, 1.0 / 3] if space is ANISOTROPIC else [100.0 / 300, 1.0 / 3]
    np.testing.assert_allclose(found.points, np.tile(expected, (19, 1)))
    squares = np.square(part.vibration_m_s2[50:]).reshape(19, 50).mean(axis=1)
    np.testing.assert_allclose(found.power, squares)


@pytest.mark.parametrize("step", [1, 7, 50, 333])
def test_how_the_stream_comes_changes_no_block(step):
    whole = stroke(1003, first=13)
    one, parts = cutter().cut([whole]), cutter()
    found = [parts.cut([whole[at : at + step]]) for at in range(0, 1003, step)]
    for name in ("start", "points", "power"):
        joined = np.concatenate([getattr(each, name) for each in found])
        np.testing.assert_array_equal(joined, getattr(one, name))


def test_three_axes_have_the_power_of_all():
    part = stroke(200)
    three = AlignedBlock(**{**vars(part), "vibration_m_s2": np.repeat(part.vibration_m_s2, 3, 2)})
    np.testing.assert_allclose(cutter().cut([three]).power, 3.0 * cutter().cut([part]).power)


@pytest.mark.parametrize(
    "spoil",
    [
        {"speed_mm_s": (120, 5.0)},
        {"normal_force_n": (120, 0.05)},
        {"speed_mm_s": (120, 250.0)},
        {"valid": (120, False)},
        {"vibration_m_s2": (120, np.nan)},
    ],
)
def test_a_block_that_is_no_steady_stroke_is_left_out(spoil):
    part = stroke(300)
    for name, (place, value) in spoil.items():
        getattr(part, name)[place] = value
    assert cutter().cut([part]).start.tolist() == [50, 150, 200, 250]


def test_after_a_touchdown_or_a_gap_a_block_is_left_out():
    part = stroke(300)
    part.normal_force_n[:120] = 0.0
    assert cutter().cut([part]).start.tolist() == [200, 250]
    gap = [stroke(120), stroke(180, first=121)]
    assert cutter().cut(gap).start.tolist() == [50, 200, 250]


def test_nothing_gives_no_blocks():
    found = cutter(ANISOTROPIC)
    assert len(found.cut([]).start) == 0
    assert found.cut([stroke(20)]).points.shape == (0, 3)


def blocks_of(start, speed=100.0):
    return cutter().cut([stroke(1000, first=start, speed=speed)])


def test_blocks_of_another_surface_are_withdrawn():
    sums = BlockSums(ModellingSettings())
    assert sums.add(blocks_of(0))
    assert sums.cells().sums[:, 0].sum() == 19
    assert sums.add(cutter().cut([]), forget_from=800)
    assert sums.cells().sums[:, 0].sum() == 15
    assert not sums.add(cutter().cut([]))


def test_what_is_older_than_can_be_withdrawn_is_summed_for_good():
    sums = BlockSums(ModellingSettings())
    seconds = 2 * round(WITHDRAWN_S) + 3
    for second in range(seconds):
        sums.add(blocks_of(1000 * second))
    before = sums.cells().sums[:, 0].sum()
    sums.add(cutter().cut([]), forget_from=0)
    assert 0 < sums.cells().sums[:, 0].sum() < before == 19 * seconds
