from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_samples import aligned

from mmt.texture.segmentation.bottom_up import CELL
from mmt.texture.segmentation.segmenter import OnlineSegmenter, SampleRange, segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock, dft321

RATE_HZ = 1000.0
INPUTS = {False: "isotropic", True: "anisotropic"}


def make_block(speed_mm_s, force_n=1.0, heading_rad=0.3, *, first=0, axes=1):
    count = len(speed_mm_s)
    heading_rad = np.broadcast_to(heading_rad, count)
    direction = np.stack([np.cos(heading_rad), np.sin(heading_rad), np.zeros(count)], axis=1)
    velocity_mm_s = np.asarray(speed_mm_s, dtype=float)[:, None] * direction
    return aligned(
        np.random.default_rng(first).normal(size=(count, 1, axes)),
        first,
        position_mm=np.cumsum(velocity_mm_s, axis=0) / RATE_HZ,
        velocity_mm_s=velocity_mm_s[:, :2],
        speed_mm_s=speed_mm_s,
        normal_force_n=force_n,
    )


def ranges(segments):
    return [(found.start, found.stop) for found in segments]


class Model:
    """Keep what the changes say, and complain about any that cannot be."""

    def __init__(self):
        self.live = {}

    def apply(self, segmenter, block):
        change = segmenter.update(block)
        for key in change.removed:
            assert not self.live.pop(key).final
            assert any(key.start < new.stop and new.start < key.stop for new in change.added)
        for new in change.added:
            assert SampleRange(new.start, new.stop) not in self.live
            self.live[SampleRange(new.start, new.stop)] = new
        ordered = sorted(self.live)
        assert all(a.stop <= b.start for a, b in pairwise(ordered))


def online(block, period, **arguments):
    model, segmenter = Model(), OnlineSegmenter(**arguments)
    for start in range(0, len(block), period):
        model.apply(segmenter, block[start : start + period])
    return model


def test_one_steady_stroke_is_one_segment():
    block = make_block(np.full(500, 80.0), 1.5)
    (found,) = segment(block)
    # Whole cells with both neighbours usable.
    assert (found.start, found.stop) == (10, 490)
    assert found.speed_mm_s == pytest.approx(80.0)
    assert found.force_n == pytest.approx(1.5)
    assert found.time_ns == 489 * 1_000_000 + 77
    np.testing.assert_array_equal(found.vibration_m_s2, block.vibration_m_s2[10:490, 0, 0])
    assert found.measured is None


def test_filled_samples_are_told_from_measured_ones():
    block = make_block(np.full(500, 80.0))
    block.measured[100:103] = False
    (found,) = segment(block)
    np.testing.assert_array_equal(found.measured, block.measured[10:490])
    assert found.measured_count == 477


def test_the_vibration_is_a_copy():
    block = make_block(np.full(500, 80.0))
    (found,) = segment(block)
    before = found.vibration_m_s2.copy()
    block.vibration_m_s2[:] = 0.0
    np.testing.assert_array_equal(found.vibration_m_s2, before)


def test_three_axes_are_reduced_over_the_segment():
    block = make_block(np.full(500, 80.0), axes=3)
    (found,) = segment(block)
    np.testing.assert_allclose(found.vibration_m_s2, dft321(block.vibration_m_s2[10:490, 0]))


@pytest.mark.parametrize("inputs", INPUTS.values())
@pytest.mark.parametrize("channel", ["speed", "force"])
def test_a_step_in_speed_or_force_cuts_there(channel, inputs):
    step = np.r_[np.full(400, 1.0), np.full(400, 1.8)]
    block = make_block(80.0 * step) if channel == "speed" else make_block(0 * step + 80.0, step)
    assert ranges(segment(block, ModellingSettings(inputs=inputs))) == [(10, 400), (400, 790)]


@pytest.mark.parametrize("by_heading", [False, True])
def test_only_by_heading_a_slow_turn_cuts_the_stroke(by_heading):
    heading_rad = np.linspace(0.0, 0.9, 900)
    block = make_block(np.full(900, 100.0), heading_rad=heading_rad)
    found = segment(block, ModellingSettings(straightness_mm=50.0, inputs=INPUTS[by_heading]))
    assert len(found) == (3 if by_heading else 1)
    for one in found:
        velocity = block.velocity_mm_s[one.start : one.stop]
        mean = velocity.mean(axis=0)
        np.testing.assert_allclose(one.velocity_mm_s, mean, rtol=1e-12)
        if by_heading:
            deviation = np.sqrt(((velocity - mean) ** 2).sum(axis=1).mean())
            assert deviation <= 0.12 * np.linalg.norm(mean) * (1 + 1e-9)


def test_straightness_is_the_settings():
    heading_rad = np.linspace(0.0, 1.2, 800)  # an arc of 67 mm radius
    block = make_block(np.full(800, 100.0), heading_rad=heading_rad)
    for straightness_mm in (0.3, 1.0, 3.0):
        for found in segment(block, ModellingSettings(straightness_mm=straightness_mm)):
            path_mm = block.position_mm[found.start : found.stop]
            chord = path_mm[-1] - path_mm[0]
            normal = np.array([-chord[1], chord[0], 0.0]) / np.linalg.norm(chord)
            assert np.abs((path_mm - path_mm[0]) @ normal).max() <= straightness_mm
    assert len(segment(block, ModellingSettings(straightness_mm=20.0))) == 1


def test_slow_light_and_invalid_samples_are_left_out_with_a_guard():
    block = make_block(np.full(2000, 80.0))
    block.speed_mm_s[500:520] = 9.9
    block.normal_force_n[1005] = 0.09
    block.valid[1500:1503] = False
    assert ranges(segment(block)) == [(10, 490), (530, 990), (1020, 1490), (1520, 1990)]


def test_a_missing_sample_ends_the_stretch():
    block = make_block(np.full(1000, 80.0))
    before, after = segment(AlignedBlock.concatenate([block[:503], block[504:]]))
    assert ranges([before, after]) == [(10, 490), (520, 990)]
    assert before.final
    assert not after.final


def test_too_short_is_dropped_and_too_long_is_split():
    assert segment(make_block(np.full(135, 80.0))) == []
    assert ranges(segment(make_block(np.full(140, 80.0)))) == [(10, 130)]
    lengths = [b - a for a, b in ranges(segment(make_block(np.full(6000, 80.0))))]
    assert max(lengths) <= 1000
    assert sum(lengths) == 5980


def test_the_result_does_not_depend_on_where_the_data_begins():
    generator = np.random.default_rng(3)
    walk = np.cumsum(generator.normal(size=6000))
    speed_mm_s = 80.0 * np.exp(0.02 * walk)
    speed_mm_s[1990:2050] = 0.0
    block = make_block(speed_mm_s)
    whole = [found for found in ranges(segment(block)) if found[0] >= 2040]
    for begin in (1991, 2003, 2017):
        assert ranges(segment(block[begin:])) == whole


@pytest.mark.parametrize("period", [250, 333, 1000])
def test_a_stroke_across_a_windows_edge_is_not_cut(period):
    for offset in range(0, period, 30):
        speed_mm_s = np.r_[np.zeros(period + offset), np.full(600, 90.0), np.zeros(700)]
        block = make_block(speed_mm_s)
        model = online(block, period)
        assert list(model.live) == ranges(segment(block))
        (found,) = model.live.values()
        assert len(found.vibration_m_s2) >= 570
        assert len(found.vibration_m_s2) == found.stop - found.start


def test_a_stroke_in_progress_is_handed_out_and_replaced():
    block = make_block(np.full(900, 90.0))
    segmenter = OnlineSegmenter()
    first = segmenter.update(block[:400])
    assert (ranges(first.added), first.removed) == ([(10, 390)], [])
    assert not first.added[0].final
    second = segmenter.update(block[400:700])
    assert second.removed == [SampleRange(10, 390)]
    assert ranges(second.added) == [(10, 690)]
    np.testing.assert_array_equal(
        second.added[0].vibration_m_s2, block.vibration_m_s2[10:690, 0, 0]
    )
    still = make_block(np.zeros(300), first=700)
    third = segmenter.update(still)
    assert third.added == []
    assert third.removed == []
    # Final now: nothing that follows can replace it.
    assert segmenter.update(make_block(np.full(900, 90.0), first=1000)).removed == []


def test_an_unchanged_provisional_segment_is_not_handed_out_again():
    block = make_block(np.full(900, 90.0))
    segmenter = OnlineSegmenter()
    segmenter.update(block[:400])
    for n in range(400, 409):
        change = segmenter.update(block[n : n + 1])
        assert (change.added, change.removed) == ([], [])


def test_overlap_says_how_long_segments_stay_provisional():
    speed_mm_s = np.r_[np.full(300, 30.0), np.full(300, 50.0), np.full(300, 90.0)]
    expected = [(10, 300), (300, 600), (600, 890)]
    for overlap_samples, final in ((0, 1), (200, 1), (310, 0), (2000, 0)):
        segmenter = OnlineSegmenter(ModellingSettings(overlap_samples=overlap_samples))
        change = segmenter.update(make_block(speed_mm_s))
        assert ranges(change.added) == expected
        assert [found.final for found in change.added] == [True] * final + [False] * (3 - final)


def test_a_gap_between_updates_makes_the_segment_final():
    block = make_block(np.full(1200, 90.0))
    segmenter = OnlineSegmenter()
    model = Model()
    for part in (slice(400), slice(401, 800), slice(800, 1200)):
        model.apply(segmenter, block[part])
    assert list(model.live) == [(10, 390), (420, 1190)]


def test_memory_stays_bounded_in_an_endless_stroke():
    segmenter = OnlineSegmenter()
    model = Model()
    wobble = 80.0 * (1.0 + 0.02 * np.sin(np.arange(30_000) / 70.0))
    for start in range(0, 30_000, 500):
        model.apply(segmenter, make_block(wobble[start : start + 500], first=start))
        assert len(segmenter._tail) <= 3 * 1000 + 200 + 3 * CELL
    assert sum(b - a for a, b in model.live) == 29_980


@st.composite
def random_strokes(draw):
    """Strokes, rests, bends and gaps, and a cut into updates of any length."""
    generator = np.random.default_rng(draw(st.integers(0, 10_000)))
    speed, force, heading = [], [], []
    for _ in range(draw(st.integers(1, 8))):
        count = draw(st.integers(20, 900))
        wander = np.cumsum(generator.normal(size=(3, count)), axis=1)
        level = draw(st.sampled_from([0.0, 25.0, 120.0]))
        speed.append(level * np.exp(draw(st.sampled_from([0.0, 0.003, 0.02])) * wander[0]))
        force.append(draw(st.floats(0.05, 3.0)) * np.exp(0.005 * wander[1]))
        heading.append(generator.uniform(0, 6) + draw(st.sampled_from([0, 0.01])) * wander[2])
    block = make_block(*(np.concatenate(part) for part in (speed, force, heading)))
    index = block.index.copy()
    for _ in range(draw(st.integers(0, 2))):
        index[draw(st.integers(0, len(index) - 1)) :] += draw(st.integers(1, 10**9))
    lengths = draw(st.lists(st.integers(0, 1200), min_size=1, max_size=12))
    return replace(block, index=index), lengths


@given(
    strokes=random_strokes(),
    overlap_samples=st.sampled_from([0, 55, 200, 1500]),
    by_heading=st.booleans(),
)
@settings(max_examples=120)
def test_never_two_segments_for_one_sample(strokes, overlap_samples, by_heading):
    block, lengths = strokes
    model, at = Model(), 0
    segmenter = OnlineSegmenter(
        ModellingSettings(overlap_samples=overlap_samples, inputs=INPUTS[by_heading])
    )
    for length in [*lengths, len(block)]:
        model.apply(segmenter, block[at : at + length])
        at = min(at + length, len(block))
    for found in model.live.values():
        begin = int(np.searchsorted(block.index, found.start))
        part = block[begin : begin + found.stop - found.start]
        np.testing.assert_array_equal(part.index, np.arange(found.start, found.stop))
        np.testing.assert_array_equal(part.vibration_m_s2[:, 0, 0], found.vibration_m_s2)
        varied = part.velocity_mm_s if by_heading else part.speed_mm_s[:, None]
        deviation = np.sqrt(varied.var(axis=0).sum())
        assert deviation <= (0.12 + 1e-9) * np.linalg.norm(varied.mean(axis=0))
        assert 120 <= len(part) <= 1000


def test_what_holds_no_segment():
    steady = make_block(np.full(600, 80.0))
    for nothing in (
        AlignedBlock.empty(),
        steady[:1],
        replace(steady, valid=np.zeros(600, dtype=bool)),
        replace(steady, speed_mm_s=np.zeros(600), position_mm=np.zeros((600, 3))),
        replace(steady, normal_force_n=np.zeros(600)),
        replace(steady, speed_mm_s=np.full(600, np.nan)),
        replace(steady, position_mm=np.full((600, 3), np.nan)),
        replace(steady, index=2 * steady.index),
    ):
        segmenter = OnlineSegmenter()
        assert segmenter.update(nothing) == ([], [])
        assert segmenter.update(nothing[:0]) == ([], [])


def test_a_teleporting_position_ends_a_segment():
    block = make_block(np.full(800, 80.0))
    position_mm, speed_mm_s = block.position_mm.copy(), block.speed_mm_s.copy()
    position_mm[400:] += 1e6
    speed_mm_s[400:420] = 1e8
    found = ranges(segment(replace(block, position_mm=position_mm, speed_mm_s=speed_mm_s)))
    assert found == [(10, 400), (420, 790)]


def test_samples_at_the_thresholds_count_and_five_cells_are_enough_for_three():
    least = ModellingSettings(shortest_samples=3 * CELL, longest_samples=100)
    block = make_block(np.full(5 * CELL, least.least_speed_mm_s), least.least_force_n)
    assert ranges(segment(block, least)) == [(CELL, 4 * CELL)]
    assert ranges(segment(block[: 5 * CELL - 1], least)) == []
