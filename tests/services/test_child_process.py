"""A child process is heard all the while, whatever it prints."""

import asyncio
import signal

import pytest

from mmt.cli.running.child import Child

PROGRAMS = {
    "noisy_program": (
        "import json, sys\n"
        "sys.stderr.write('a warning of a driver\\n' * 100_000)\n"
        "print('driver 1.2 ready')\n"
        "print(json.dumps({'kind': 'summary', 'text': 'x' * 200_000}))\n"
        "print('[1, 2]')\n"
        "sys.stderr.write('last words\\n')\n"
        "sys.exit(3)\n"
    ),
    "warning_program": (
        "import sys\n"
        "sys.stderr.write('compiling\\nwarning: the sensor is overl')\n"
        "sys.stderr.flush()\n"
        "sys.stderr.write('oaded\\nwarning: half a line')\n"
    ),
    "short_program": "raise SystemExit(3)\n",
    "lasting_program": (
        "import signal, sys, time\n"
        "signal.signal(signal.SIGTERM, signal.default_int_handler)\n"
        "try:\n"
        '    print(\'{"kind": "ready", "argument": "\' + sys.argv[1] + \'"}\', flush=True)\n'
        "    time.sleep(60)\nexcept KeyboardInterrupt:\n    raise SystemExit(4)\n"
    ),
}


@pytest.fixture
def directory(tmp_path, monkeypatch):
    for name, text in PROGRAMS.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path


async def started(directory, program):
    return await Child.start(program, program, ["me"])


async def test_what_a_child_warns_of_is_told_line_by_line(directory):
    told = []
    child = await Child.start("warning_program", "warning_program", [], None, told.append)
    async with asyncio.timeout(20):
        assert await child.wait() == 0
    assert told == ["warning: the sensor is overloaded"]
    assert child.messages.startswith("compiling")


async def test_a_child_that_writes_much_never_waits_for_a_reader(directory):
    child = await started(directory, "noisy_program")
    async with asyncio.timeout(20):
        lines = [line async for line in child.lines()]
        assert await child.wait() == 3
    assert [line["kind"] for line in lines] == ["event", "summary", "event"]
    assert lines[0]["event"] == "driver 1.2 ready"
    assert len(lines[1]["text"]) == 200_000
    assert lines[2]["event"] == "[1, 2]"
    assert child.messages.endswith("a warning of a driver\nlast words")
    assert len(child.messages) <= 2**16


async def test_a_child_is_interrupted_as_by_a_person(directory):
    lasting = await started(directory, "lasting_program")
    async with asyncio.timeout(20):
        async for line in lasting.lines():
            assert line == {"kind": "ready", "argument": "me"}
            lasting.interrupt()
        assert await lasting.wait() == 4
    lasting.interrupt()  # harmless once it has ended


async def test_a_child_that_is_killed_as_it_ends_keeps_its_exit_code(directory):
    async with asyncio.timeout(60):
        for _ in range(25):
            child = await started(directory, "short_program")
            assert [line async for line in child.lines()] == []
            await child.kill()
            assert await child.wait() in {3, -signal.SIGKILL}  # not 255, which stands for unknown
