"""A model is updated in the thread that asks for it, however many threads BLAS may start."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

UPDATE = """
import json, os
from pathlib import Path
import mmt, sys
from mmt.texture.online.history import stream_blocks
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.settings import ModellingSettings

def cpu_ns():
    tasks = Path("/proc/self/task").iterdir()
    own = {int(task.name): int((task / "schedstat").read_text().split()[0]) for task in tasks}
    return own.pop(os.getpid()), sum(own.values()), len(own)

frames, _ = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=30.0)
for number in range(2):  # the first compiles
    settings = ModellingSettings(method=sys.argv[1], inputs=sys.argv[2])
    modeller, before = OnlineModeller(settings), cpu_ns()
    for block in stream_blocks([frames], 1000):
        model = modeller.update(block).model
        if model is not None:
            model.prepared()
    after = cpu_ns()
print(json.dumps([after[0] - before[0], after[1] - before[1], after[2]]))
"""


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="needs Linux's schedstat")
@pytest.mark.parametrize("method", ["field", "published"])
@pytest.mark.parametrize("inputs", ["isotropic", "anisotropic"])
def test_an_update_uses_no_threads_of_blas(method, inputs):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "4"}
    result = subprocess.run(
        [sys.executable, "-c", UPDATE, method, inputs],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=150,
    )
    own_ns, others_ns, others = json.loads(result.stdout.splitlines()[-1])
    if not others:
        pytest.skip("this BLAS has no threads")
    assert others_ns < 0.05 * own_ns
