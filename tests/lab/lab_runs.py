"""Runs of an experiment as a command."""

from command_runs import run_json


def run_lab(folder, *arguments, code=0):
    """Run ``mmt lab`` in this process; return its figures and what it printed."""
    figures, result = run_json(folder, "lab", *arguments, code=code)
    return figures, result.output
