"""The test for another surface: delays, recalls, candidates, false alarms."""

from dataclasses import replace

import numpy as np
import pytest
from surface_samples import BLOCK, PEAKED, SMOOTH, make_blocks

from mmt.core.errors import InputError
from mmt.texture.surfaces import KnownSurface, SurfaceBlock, SurfaceDetector
from mmt.texture.surfaces.detection import TEMPER, WINDOW
from mmt.texture.surfaces.identification import recognised


def followed(detector: SurfaceDetector, blocks: list[SurfaceBlock]) -> list[tuple[str, int, int]]:
    changes = [detector.update(block) for block in blocks]
    return [(c.kind, c.surface, c.from_sample) for c in changes if c is not None]


def after(ar: np.ndarray, count: int, seed: int, **options: object) -> SurfaceDetector:
    detector = SurfaceDetector()
    assert followed(detector, make_blocks(ar, count, seed, **options)) == []  # type: ignore[arg-type]
    return detector


def test_a_step_of_3_db_is_found_in_two_seconds() -> None:
    delays = []
    for seed in range(5):
        detector = after(SMOOTH, 200, seed)
        louder = make_blocks(SMOOTH, 80, 100 + seed, gain=np.sqrt(2.0), first=200)
        delays.append(next(n for n, block in enumerate(louder, 1) if detector.update(block)))
    assert np.mean(delays) * BLOCK <= 2000.0


def test_another_spectrum_is_found_in_half_a_second_and_where_it_began() -> None:
    detector = after(SMOOTH, 120, 5)
    changes = [detector.update(block) for block in make_blocks(PEAKED, 12, 6, first=120)]
    (change,) = [change for change in changes if change is not None]
    assert (change.kind, change.before, change.surface) == ("new", 1, 2)
    assert 118 * BLOCK <= change.from_sample <= 121 * BLOCK
    assert change.at_sample <= 130 * BLOCK


def test_one_stroke_alone_is_no_other_surface() -> None:
    """What a stroke does not fit in may be the surface's own."""
    detector = after(SMOOTH, 120, 7)
    odd = make_blocks(PEAKED, 4, 8, first=120)
    assert followed(detector, [*odd, *make_blocks(SMOOTH, 60, 9, first=124)]) == []


def test_a_candidate_that_is_left_at_once_is_forgotten() -> None:
    detector = after(SMOOTH, 120, 7)
    followed(detector, make_blocks(PEAKED, 80, 8, first=120))
    loud = make_blocks(np.array([0.8]), 12, 8, gain=8.0, first=200)
    found = followed(detector, [*loud, *make_blocks(SMOOTH, 60, 9, first=212)])
    assert [(kind, number) for kind, number, _ in found] == [("new", 3), ("recalled", 1)]
    assert list(detector.surfaces) == [2, 1]


def test_a_surface_whose_scatter_has_heavy_tails_raises_no_alarm() -> None:
    """Levels by Student's distribution of 3 degrees, the same for a stroke and the block's own."""
    random = np.random.default_rng(3)
    blocks = make_blocks(SMOOTH, 1200, 4)
    for number, block in enumerate(blocks):
        if number % 4 == 0:
            shift = 0.3 * random.standard_t(3.0)
        block.values[0] += shift + 0.3 * random.standard_t(3.0)
    assert followed(SurfaceDetector(), blocks) == []


def test_a_known_surface_is_recalled() -> None:
    detector = SurfaceDetector()
    found = []
    for turn, ar in enumerate((SMOOTH, PEAKED, SMOOTH, PEAKED)):
        found += followed(detector, make_blocks(ar, 100, turn, first=100 * turn))
    assert found[0][:2] == ("new", 2)
    assert found[-1][1] == 2
    assert list(detector.surfaces) == [1, 2]


def test_a_candidate_that_proves_to_be_a_known_surface_is_merged_into_it() -> None:
    detector = after(SMOOTH, 160, 1)
    followed(detector, make_blocks(PEAKED, 100, 2, first=160))
    learned = detector.surfaces[1].blocks
    detector._stay(3, [], candidate=True)
    found = followed(detector, make_blocks(SMOOTH, 60, 4, first=260))
    assert [(kind, number) for kind, number, _ in found] == [("identified", 1)]
    assert set(detector.surfaces) == {1, 2}
    assert detector.surfaces[1].blocks > learned
    assert len(detector._window) < WINDOW + 10


def test_an_unexplored_part_of_the_plane_is_no_other_surface() -> None:
    detector = after(SMOOTH, 120, 7, high=(0.3, 0.3))
    assert followed(detector, make_blocks(SMOOTH, 120, 8, low=(0.6, 0.6), first=120)) == []


def test_a_knock_is_no_surface() -> None:
    blocks = make_blocks(SMOOTH, 200, 9)
    blocks[150] = replace(blocks[150], values=blocks[150].values + 6.0)
    assert followed(SurfaceDetector(), blocks) == []


def test_blocks_are_of_a_known_surface_only_where_its_own_scatter_allows_it() -> None:
    detector = after(SMOOTH, 200, 1)
    followed(detector, make_blocks(PEAKED, 150, 2, first=200))
    known, unknown = detector.surfaces, KnownSurface(directed=False)
    number, lead = recognised(unknown, known, make_blocks(PEAKED, 12, 3))
    assert number == 2
    assert lead > np.log(499.0)
    assert recognised(unknown, known, make_blocks(PEAKED, 12, 4, gain=4.0))[0] == 0
    assert recognised(unknown, {}, make_blocks(PEAKED, 12, 3)) == (0, 0.0)


def test_where_the_heading_does_not_count_another_heading_is_another_surface() -> None:
    def turned(count: int, seed: int, heading: float, first: int) -> list[SurfaceBlock]:
        blocks = make_blocks(SMOOTH, count, seed, heading=heading, first=first)
        louder = 1.5 * np.cos(2.0 * heading) * np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0])
        return [replace(block, values=block.values + louder) for block in blocks]

    headings = [0.0, 0.8, 1.6, 2.4]
    blocks = [b for n in range(60) for b in turned(8, n, headings[n % 4], 8 * n)]
    assert followed(SurfaceDetector(by_heading=True), blocks) == []
    isotropic = [*turned(120, 5, 0.0, 0), *turned(40, 6, 1.6, 120)]
    assert [kind for kind, *_ in followed(SurfaceDetector(), isotropic)] == ["new"]


def test_the_surface_that_was_left_for_longest_is_forgotten() -> None:
    detector = SurfaceDetector(most=2)
    for turn, ar in enumerate((SMOOTH, PEAKED, np.array([0.8]))):
        followed(detector, make_blocks(ar, 100, turn, first=100 * turn))
    assert list(detector.surfaces) == [2, 3]


def test_a_lower_rate_of_false_alarms_takes_more_evidence() -> None:
    often, seldom = (SurfaceDetector(rate)._least_evidence for rate in (10.0, 0.1))
    assert TEMPER * seldom == pytest.approx(TEMPER * often + np.log(100.0))


@pytest.mark.parametrize(("options", "named"), [((0.0, 20), "false_alarms"), ((1.0, 1), "most")])
def test_settings_that_cannot_be_are_refused(options: tuple[float, int], named: str) -> None:
    with pytest.raises(InputError, match=named):
        SurfaceDetector(*options)
