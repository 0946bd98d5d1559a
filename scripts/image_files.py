"""Write the documentation's pictures, small enough for a repository."""

import io
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure
from PIL import Image

from mmt.evaluation import figures

IMAGES: Final = Path(__file__).resolve().parents[1] / "docs" / "images"
LARGEST_BYTES: Final = 150_000
FULL_COLOUR_BYTES: Final = 60_000


def write(name: str, figure: Figure) -> None:
    """Write a figure as a PNG, in full colour where that is small enough, else in 256."""
    write_png(name, figures.to_png(figure))


def write_png(name: str, png: bytes) -> None:
    """Write a PNG anew, in full colour if that is small enough, else in 256 colours.

    By an octree: the median cut gives up colours that few pixels have, such as those of curves.
    """
    path = IMAGES / f"{name}.png"
    IMAGES.mkdir(parents=True, exist_ok=True)
    drawn = Image.open(io.BytesIO(png)).convert("RGB")
    drawn.save(path, optimize=True)
    if path.stat().st_size > FULL_COLOUR_BYTES:
        few = drawn.quantize(method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        few.save(path, optimize=True)
    size = path.stat().st_size
    if size > LARGEST_BYTES:
        raise SystemExit(f"{path}: {size} bytes, more than {LARGEST_BYTES}")
    print(f"{path.relative_to(IMAGES.parents[1])}: {size} bytes")
