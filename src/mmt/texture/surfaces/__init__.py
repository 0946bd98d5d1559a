"""Detection of changes of surface, and recognition of surfaces met before."""

from mmt.texture.surfaces.blocks import BlockCutter, SurfaceBlock
from mmt.texture.surfaces.changes import SurfaceChange
from mmt.texture.surfaces.detection import SurfaceDetector
from mmt.texture.surfaces.surface import KnownSurface

__all__ = ["BlockCutter", "KnownSurface", "SurfaceBlock", "SurfaceChange", "SurfaceDetector"]
