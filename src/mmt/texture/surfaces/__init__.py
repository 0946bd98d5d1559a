"""Detection of changes of surface, and what a person says of the surface."""

from mmt.texture.online.surface_changes import SaidSurface, SurfaceChange, said_surfaces
from mmt.texture.surfaces.blocks import BlockCutter, SurfaceBlock
from mmt.texture.surfaces.detection import SurfaceDetector

__all__ = [
    "BlockCutter",
    "SaidSurface",
    "SurfaceBlock",
    "SurfaceChange",
    "SurfaceDetector",
    "said_surfaces",
]
