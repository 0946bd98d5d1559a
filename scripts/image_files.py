"""Write the documentation's pictures, small enough for a repository."""

import io
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure
from PIL import Image

from mmt.evaluation.reports import figures

IMAGES: Final = Path(__file__).resolve().parents[1] / "docs" / "images"
LARGEST_BYTES: Final = 150_000


def write(name: str, figure: Figure) -> None:
    """Write a figure as it is in a report."""
    _write(name, figures.to_png(figure))


def write_screen(name: str, png: bytes) -> None:
    """Write a picture of a screen in 256 colours.

    An octree chooses them: the median cut drops colours that few pixels have, such as of curves.
    """
    screen = Image.open(io.BytesIO(png)).convert("RGB")
    few = io.BytesIO()
    octree = Image.Quantize.FASTOCTREE
    screen.quantize(method=octree, dither=Image.Dither.NONE).save(few, "PNG", optimize=True)
    _write(name, few.getvalue())


def _write(name: str, png: bytes) -> None:
    if len(png) > LARGEST_BYTES:
        raise SystemExit(f"{name}: {len(png)} bytes, more than {LARGEST_BYTES}")
    path = IMAGES / f"{name}.png"
    path.write_bytes(png)
    print(f"{path.relative_to(IMAGES.parents[1])}: {len(png)} bytes")
