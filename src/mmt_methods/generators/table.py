"""The part that renders by another method's generator, as the leader finds it."""

from typing import Final

from mmt.scene.added import AddedPart

PART: Final = AddedPart(
    "mmt_methods.generators.part:GeneratingPart",
    before="vibration",
    key="rendering.generator",
)
