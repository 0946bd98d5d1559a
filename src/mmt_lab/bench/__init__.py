"""Error against run time: the stages of ``mmt bench``, one file each.

A stage is a module with a function ``run()`` that returns a `Findings`; it is imported when
it is run.
"""

import importlib
from collections.abc import Callable
from typing import Final, cast

from mmt_lab.harness.findings import Findings

STAGES: Final = {
    "burg": "mmt_lab.bench.burg",
    "lines": "mmt_lab.bench.lines",
    "interpolation": "mmt_lab.bench.interpolation",
    "networks": "mmt_lab.bench.networks",
    "synthesis": "mmt_lab.bench.synthesis",
    "update": "mmt_lab.bench.update",
    "order": "mmt_lab.bench.order",
    "pipeline": "mmt_lab.bench.pipeline",
    "conceal": "mmt_lab.bench.conceal",
    "contact": "mmt_lab.bench.contact",
    "devices": "mmt_lab.bench.devices",
}
"""Modules by the name of their stage."""


def run_stage(name: str) -> Findings:
    """Run a stage by its name.

    Raises
    ------
    ImportError
        It needs a package that is not installed.
    """
    run = cast(Callable[[], Findings], importlib.import_module(STAGES[name]).run)
    return run()
