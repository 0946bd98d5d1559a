"""The process that models: what ends it, and what goes on without it."""

import asyncio
import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
from service_runs import LONGEST_S, Together, small_scene

from mmt.core.errors import InputError, MmtError
from mmt.core.running.programs import python_command
from mmt.leader.modelling.process import ModellingProcess
from mmt.texture.settings import ModellingSettings

PARENT = """
import os, sys
from mmt.leader.modelling.process import ModellingProcess
from mmt.texture.settings import ModellingSettings
made = ModellingProcess(ModellingSettings(), 1.0)
made.start().result()
print(made._process.pid, flush=True)
sys.stdin.read()
"""


def modelling_children():
    return [
        child
        for child in psutil.Process().children()
        if ModellingProcess.__module__ in child.cmdline()
    ]


async def test_a_process_that_is_killed_ends_the_modelling_and_nothing_else(tmp_path):
    texture = {"update_period_s": 0.2, "start_share": 0.05, "stop_share": 0.9999}
    scene = small_scene(tmp_path, session={"duration_s": 4.0}, texture=texture, rendering={})
    together = await Together.listening(scene)
    following = asyncio.create_task(together.follow())
    async with asyncio.timeout(LONGEST_S):
        while together.leader.log.start_s is None:
            await asyncio.sleep(0.01)
    (child,) = modelling_children()
    child.kill()
    await following
    summary = await together.end()
    said = "modelling has ended: the process that models was ended by signal 9"
    assert together.said.count(said) == 1
    assert (summary.outcome, summary.problem) == ("completed", None)
    assert summary.texture["fault"] == said
    assert summary.link["frames"] == summary.recording["frames"] >= 4000
    assert summary.vibration["mode"] == "synthesized"
    assert not modelling_children()


async def test_what_fails_in_it_is_told_in_a_sentence():
    made = ModellingProcess(ModellingSettings(), 1.0)
    made.start()
    with pytest.raises(MmtError, match="the process that models has failed: KeyError: 99"):
        await made.call("fit", 99)
    with pytest.raises(MmtError, match="the process that models has ended with code 1"):
        await made.call("begin")
    made.close()


@pytest.mark.parametrize("package", ["numba", "scipy"])
def test_it_is_not_launched_without_its_packages(package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    made = ModellingProcess(ModellingSettings(), 1.0)
    with pytest.raises(InputError, match=f"the numerics need {package}, which is not installed"):
        made.launch()
    made.close()
    assert not modelling_children()


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_it_outlives_signals_of_the_terminal_and_not_its_parent():
    with subprocess.Popen(
        python_command("-c", PARENT), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as parent:
        child = psutil.Process(int(parent.stdout.readline()))
        assert os.getsid(child.pid) != os.getsid(0)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(child.pid, number)
        time.sleep(0.2)
        assert child.is_running()
        parent.kill()
        child.wait(LONGEST_S)
