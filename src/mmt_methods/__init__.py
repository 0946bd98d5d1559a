"""Additional methods: selection of samples, and other generators of vibration."""

from typing import Final

from mmt.scene.table import AddedPart

GENERATING: Final = AddedPart(
    "mmt_methods.generators.part:GeneratingPart",
    before="vibration",
    key="rendering.generator",
)
"""The leader's part that renders by another method's generator."""
