"""Declaration of the leader's part that renders by another method's generator."""

from typing import Final

from mmt.scene.added import AddedPart

GENERATING: Final = AddedPart(
    "mmt_methods.generators.part:GeneratingPart",
    before="vibration",
    key="rendering.generator",
)
