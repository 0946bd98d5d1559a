"""Overview at the top of a report: the verdict in four tiles, and a sentence."""

from collections.abc import Mapping, Sequence
from typing import Any

from mmt.evaluation.document import Block, Paragraph, Tile, Tiles
from mmt.evaluation.results import Evaluation
from mmt.evaluation.run_verdict import median_of_known, run_verdict
from mmt.evaluation.texts import share


def at_a_glance(
    evaluations: Sequence[Evaluation], figures: Mapping[str, Any], run: Mapping[str, Any]
) -> list[Block]:
    """Return the first blocks of a report; of several sessions the medians.

    `figures` are those of the evaluations, as `evaluations_as_dict` gives them.
    """
    services = {name: run[name] for name in ("leader", "follower") if name in run}
    found = run_verdict(services, figures)
    first, *others = found.faults or ("all well",)
    tiles = [
        Tile("vibration", found.now),
        Tile("readiness", found.readiness),
        Tile("error of the level", found.error, found.noticeable),
        Tile("health", first, "; ".join(others), "" if found.state == "running" else found.state),
    ]
    blocks: list[Block] = [Tiles([tile for tile in tiles if tile.value])]
    return [*blocks, Paragraph(_sentence(evaluations))] if evaluations else blocks


def _sentence(evaluations: Sequence[Evaluation]) -> str:
    is_known = evaluations[0].basis == "truth"
    reference = "known texture" if is_known else "held-out segments"
    right = median_of_known(each.final.within_jnd for each in evaluations)
    if right is None:
        return f"There is no model to compare with the {reference}."
    sentence = (
        f"Against the {reference} the level is right, within one just noticeable difference, on "
        f"{share(right)} of {'the strokes that were made' if is_known else 'their strokes'}"
    )
    plane = median_of_known(each.final.plane_within_jnd for each in evaluations)
    return (
        f"{sentence}."
        if plane is None
        else f"{sentence}, and on {share(plane)} of the whole plane."
    )
