"""The test for another surface, and a person's word: delays, change-points, false alarms."""

from dataclasses import replace

import numpy as np
import pytest
from surface_samples import BLOCK, PEAKED, SMOOTH, make_blocks

from mmt.texture.surfaces.tracking import TEMPER, WINDOW, SurfaceDetector


def followed(detector, blocks):
    found = [detector.update(block) for block in blocks]
    return [one for one in found if one is not None]


def after(ar, count, seed, **options):
    detector = SurfaceDetector()
    assert followed(detector, make_blocks(ar, count, seed, **options)) == []
    return detector


def test_a_step_of_6_db_is_found_in_two_seconds():
    delays = []
    for seed in range(5):
        detector = after(SMOOTH, 200, seed)
        louder = make_blocks(SMOOTH, 80, 100 + seed, gain=2.0, first=200)
        delays.append(next(n for n, block in enumerate(louder, 1) if detector.update(block)))
    assert np.mean(delays) * BLOCK <= 2000.0


def test_another_spectrum_is_found_in_a_second_and_where_it_began():
    detector = after(SMOOTH, 120, 5)
    (found,) = followed(detector, make_blocks(PEAKED, 40, 6, first=120))
    assert 118 * BLOCK <= found.from_sample <= 121 * BLOCK
    assert found.at_sample <= 140 * BLOCK


def test_one_stroke_alone_is_no_other_surface():
    """What a stroke does not fit in may be the surface's own."""
    detector = after(SMOOTH, 120, 7)
    odd = make_blocks(PEAKED, 4, 8, first=120)
    assert followed(detector, [*odd, *make_blocks(SMOOTH, 60, 9, first=124)]) == []


def test_a_surface_whose_scatter_has_heavy_tails_raises_no_alarm():
    """Levels by Student's distribution of 3 degrees, the same for a stroke and the block's own."""
    random = np.random.default_rng(3)
    blocks = make_blocks(SMOOTH, 1200, 4)
    for number, block in enumerate(blocks):
        if number % 4 == 0:
            shift = 0.3 * random.standard_t(3.0)
        block.values[0] += shift + 0.3 * random.standard_t(3.0)
    assert followed(SurfaceDetector(), blocks) == []


def test_an_unexplored_part_of_the_plane_is_no_other_surface():
    detector = after(SMOOTH, 120, 7, high=(0.3, 0.3))
    assert followed(detector, make_blocks(SMOOTH, 120, 8, low=(0.6, 0.6), first=120)) == []


@pytest.mark.parametrize("size", [6.0, 60.0, 1e6])
def test_a_knock_is_no_surface(size):
    blocks = make_blocks(SMOOTH, 200, 9)
    blocks[150] = replace(blocks[150], values=blocks[150].values + size)
    assert followed(SurfaceDetector(), blocks) == []


def test_where_the_heading_does_not_count_another_heading_is_another_surface():
    def turned(count, seed, heading, first):
        blocks = make_blocks(SMOOTH, count, seed, heading=heading, first=first)
        louder = 1.5 * np.cos(2.0 * heading) * np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0])
        return [replace(block, values=block.values + louder) for block in blocks]

    headings = [0.0, 0.8, 1.6, 2.4]
    blocks = [b for n in range(60) for b in turned(8, n, headings[n % 4], 8 * n)]
    assert followed(SurfaceDetector(by_heading=True), blocks) == []
    isotropic = [*turned(120, 5, 0.0, 0), *turned(60, 6, 1.6, 120)]
    assert len(followed(SurfaceDetector(), isotropic)) == 1


def test_the_newest_blocks_alone_are_kept():
    detector = after(SMOOTH, 300, 1)
    assert len(detector.window) < WINDOW + 10
    detector.begin(295 * BLOCK)
    assert [block.start for block in detector.window] == [n * BLOCK for n in range(295, 300)]


def test_a_lower_rate_of_false_alarms_takes_more_evidence():
    often, seldom = (SurfaceDetector(rate).least_evidence for rate in (10.0, 0.1))
    assert TEMPER * seldom == pytest.approx(TEMPER * often + np.log(100.0))
