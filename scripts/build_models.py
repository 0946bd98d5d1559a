"""Build the shipped texture models, measure them against the truth, and write their table.

Usage: build_models.py [NAME...]; without a name, all models are built. The models go to
src/mmt/models, the table to docs/reference/shipped-models.md.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Final

from write_measured import Row, table_rows
from write_measured import replace as write_table

from mmt.evaluation.model_errors import SectorErrors
from mmt.models import FOLDER, SUFFIX
from mmt.testing.simulation.surfaces.surface import Surface
from mmt.testing.simulation.surfaces.textures import GRAINED
from mmt_lab.shipped_models import build, measure, settings_of, trials_of

PAGE: Final = Path(__file__).resolve().parents[1] / "docs" / "reference" / "shipped-models.md"
COLUMNS: Final = (
    "model",
    "inputs",
    "samples, order",
    "file",
    "GFC",
    "log-spectral distance",
    "power error",
    "within JND",
    "without heading: GFC, distance, power error",
)


def main() -> None:
    """Build the named models, and replace their rows between the marks of the page."""
    chosen = sys.argv[1:] or [surface.name for surface in GRAINED]
    rows = {cells[0].strip("`"): tuple(cells) for cells in table_rows(PAGE, "models")}
    for surface in GRAINED:
        if surface.name in chosen:
            rows[surface.name] = built(surface)
            print(" | ".join(rows[surface.name]), flush=True)
    write_table(PAGE, "models", COLUMNS, [rows[s.name] for s in GRAINED if s.name in rows])


def built(surface: Surface) -> Row:
    """Build and save one model, and return its row."""
    trials = trials_of(surface)
    settings = settings_of(surface)
    model = build(trials, settings)
    path = FOLDER / f"{surface.name}{SUFFIX}"
    FOLDER.mkdir(exist_ok=True)
    model.save(path)
    errors = measure(surface.name, model)
    without = "-"
    if not surface.isotropic:
        plain = build(trials, replace(settings, inputs="isotropic"))
        without = ", ".join(figures(measure(surface.name, plain))[:3])
    return (
        f"`{surface.name}`",
        model.space.name,
        f"{len(model.samples)}, {model.order}",
        f"{path.stat().st_size / 1000:.0f} kB",
        *figures(errors),
        without,
    )


def figures(errors: SectorErrors) -> Row:
    """Return a model's errors as text."""
    return (
        f"{errors.gfc:.3f}",
        f"{errors.log_spectral_db:.1f} dB",
        f"{errors.power_error_db:.2f} dB",
        f"{100 * errors.within_jnd:.0f} %",
    )


if __name__ == "__main__":
    main()
