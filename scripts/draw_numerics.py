"""Draw the pictures of ``mmt bench`` and ``mmt stability``; see ``scripts/pictures``."""

from dataclasses import replace
from typing import Final

from image_files import write

from mmt_lab.bench.command import run_stage
from mmt_lab.experiments.stability import load_families, run_families
from mmt_lab.harness.plots import panels_figure
from mmt_lab.stability.maps import contact_map, loop_map

PANELS: Final = {
    "burg": ("batch", "offset"),
    "lines": ("to_lsf", "low_pass"),
    "pipeline": None,
}
"""The stages that are drawn, and which of their panels; None draws them all."""


def main() -> None:
    """Run the stages and the families of cases that have pictures, draw, and write."""
    for name, chosen in PANELS.items():
        result = run_stage(name)
        panels = tuple(p for p in result.panels if chosen is None or p.name in chosen)
        write(f"bench-{name}", panels_figure(replace(result, panels=panels)))
    found = [row.figures for row in run_families(load_families(["contact", "loop"]))]
    (contact,) = [figures for figures in found if {"growth", "limit_s"} <= set(figures)]
    (loop,) = [figures for figures in found if "grows" in figures]
    boundaries = [figures for figures in found if {"wall_n_mm", "measured_ms"} <= set(figures)]
    write("stability-contact", contact_map(contact))
    write("stability-loop", loop_map(loop, boundaries))


if __name__ == "__main__":
    main()
