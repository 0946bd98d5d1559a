"""The soak's short form: both services for some seconds, with a fault every two."""

import json
import sys

import pytest
from python_programs import run_mmt

from mmt_lab.soak.faults import plan_faults


@pytest.mark.skipif(sys.platform == "win32", reason="processes are paused by signals")
def test_the_services_hold_under_faults(tmp_path):
    figures = tmp_path / "soak.json"
    arguments = ["--duration", "14", "--every", "2", "--seed", "172", "--json", figures]
    ended = run_mmt(tmp_path, "main", "lab", "soak", *arguments)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    found = json.loads(figures.read_text())
    assert [f["kind"] for f in found["faults"]] == [f.kind for f in plan_faults(14.0, 2.0, 172)]
    assert len(found["faults"]) == 5
    frames = next(c for c in found["checks"] if c["what"] == "frames in the recording")
    assert frames["figures"]["frames"] > 5000
    assert (tmp_path / "mmt-soak" / "soak.mcap").exists()
