"""A program imports no heavy part that it does not need."""

import pytest
from python_programs import printed_by

LISTED = """
from mmt.cli.main import app
from typer.testing import CliRunner
for asked in (["lab"], ["lab", "--help"]):
    assert CliRunner().invoke(app, asked).exit_code == 0
"""
UNSTORED = """
from mmt_share.process import Relay, Sharing, SharingServer
SharingServer(Sharing(), Relay(), {}, lambda text, count: None)
"""
REPORTING = """
import sys, mmt.cli.reporting, mmt.evaluation.reports.figures
assert "mmt.evaluation.reports.report" in sys.modules
"""
TABLES = (
    "import mmt.evaluation.evaluate, mmt.evaluation.reports.report, mmt.evaluation.reports.tables"
)
PROGRAMS = {
    "a hub": ("import mmt_share.commands.hub, mmt_share.hub.service", "numba scipy"),
    "a shared model without a store": (UNSTORED, "numba scipy"),
    "the list of experiments": (LISTED, "numba scipy matplotlib"),
    "an evaluation and its tables": (TABLES, "matplotlib"),
    "its figures, which open no window": (
        "import mmt.evaluation.reports.figures", "matplotlib.pyplot"
    ),
    "a report, which shows no selection": (REPORTING, "mmt_methods.selection"),
    "a leader without a generator": (
        "from mmt.leader import parts; from mmt.leader.output import vibration",
        "mmt_methods.generators mmt_methods.selection",
    ),
}  # fmt: skip


def imported(program, names):
    told = f"{program}\nimport sys; print(*set({names!r}.split()) & set(sys.modules))"
    return set(printed_by("-c", told).split())


@pytest.mark.parametrize("name", PROGRAMS)
def test_what_a_program_does_not_need_it_does_not_import(name):
    assert imported(*PROGRAMS[name]) == set()


def test_a_store_of_models_has_its_numerics_from_the_start(tmp_path):
    stored = UNSTORED.replace("Sharing()", f"Sharing(store={str(tmp_path)!r})")
    assert imported(stored, "numba scipy") == {"numba", "scipy"}
