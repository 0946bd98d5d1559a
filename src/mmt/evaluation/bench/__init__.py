"""Error against run time: the stages of ``mmt bench``, one file each.

A stage is a module with a function ``run()`` that returns a `StageResult`; it is imported when
it is run.
"""

import importlib
from collections.abc import Callable
from typing import Final, cast

from mmt.evaluation.bench.results import StageResult

STAGES: Final = {
    "burg": "mmt.evaluation.bench.burg",
    "lines": "mmt.evaluation.bench.lines",
    "interpolation": "mmt.evaluation.bench.interpolation",
    "networks": "mmt.evaluation.bench.networks",
    "synthesis": "mmt.evaluation.bench.synthesis",
    "update": "mmt.evaluation.bench.update",
    "order": "mmt.evaluation.bench.order",
    "pipeline": "mmt.evaluation.bench.pipeline",
    "conceal": "mmt.evaluation.bench.conceal",
    "contact": "mmt.evaluation.bench.contact",
    "devices": "mmt.evaluation.bench.devices",
}
"""Modules by the name of their stage."""


def run_stage(name: str) -> StageResult:
    """Run a stage by its name.

    Raises
    ------
    ImportError
        It needs a package that is not installed.
    """
    run = cast(Callable[[], StageResult], importlib.import_module(STAGES[name]).run)
    return run()
