"""A recording that fails costs the recording alone, and what fails is said."""

import asyncio
import errno
import json
import subprocess
from pathlib import Path

import aiohttp
import pytest
from frame_samples import made_frames
from service_processes import Service, follower_of, scene
from service_runs import MadeSource, Together, endless, run_session, small_scene

from mmt.core.errors import InputError
from mmt.session.files import read_session
from mmt.session.info import info
from mmt.session.mcap.writer import SessionWriter
from mmt.session.recover import recover

FULL = "No space left on device"


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 96 KiB, some two seconds of a session."""
    place = tmp_path / "small"
    place.mkdir()
    mount = ("mount", "-t", "tmpfs", "-o", "size=96k", "none", place)
    try:
        done = subprocess.run(mount, check=False, capture_output=True, text=True, timeout=20)
    except FileNotFoundError:
        pytest.skip("this system has no mount")
    if done.returncode:
        pytest.skip(f"a file system cannot be mounted: {done.stderr.strip()}")
    yield place
    subprocess.run(["umount", place], check=True, timeout=20)


def fill_after(monkeypatch, blocks):
    """Let a disk be full after this many blocks of frames; setting the first makes room."""
    left = [blocks]
    write = SessionWriter.write_frames

    def write_until_full(self, *block):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, FULL)
        write(self, *block)

    monkeypatch.setattr(SessionWriter, "write_frames", write_until_full)
    return left


def samples_played(together):
    vibration = together.leader.parts.vibration.summary(0.0)["vibration"]
    return int(vibration["actuator"]["samples"])


async def test_a_disk_that_is_full_costs_the_recording_alone(tmp_path, monkeypatch):
    fill_after(monkeypatch, blocks=10)
    together = await Together.listening(small_scene(tmp_path))
    follower = together.follower(endless())
    following = asyncio.create_task(follower.run())
    reason = f"recording {tmp_path / 'session.mcap'}: {FULL}"
    await together.until(lambda: f"{reason}: the session goes on without it" in together.said)
    failed_s, played = together.leader.time_s, samples_played(together)
    async with (
        aiohttp.ClientSession() as http,
        http.get(f"http://127.0.0.1:{together.leader.port}/health") as answer,
    ):
        assert answer.status == 503
        assert (await answer.json())["faults"] == [reason]
    await together.until(lambda: together.leader.time_s > failed_s + 1.0)
    assert samples_played(together) - played > 900
    follower.stop()
    leader, followed = await together.end(), await following
    assert (leader.outcome, leader.problem, followed.problem) == ("source ended", reason, None)
    assert sum(reason in sentence for sentence in together.said) == 1
    assert leader.recording["error"] == FULL
    assert leader.recording["dropped"] == leader.link["frames"] - leader.recording["frames"] > 1000


async def test_another_recording_may_be_begun_once_there_is_room_again(tmp_path, monkeypatch):
    left = fill_after(monkeypatch, blocks=10)
    together = await Together.listening(small_scene(tmp_path, monitor={}))
    follower = together.follower(endless())
    following = asyncio.create_task(follower.run())
    recording = together.leader.parts.recording
    await together.until(lambda: recording.recorder.error)
    with pytest.raises(InputError, match="no recording runs"):
        await recording.end()
    left[0] = 10_000
    await recording.start(tmp_path / "second.mcap")
    await together.until(lambda: recording.recorder.frames > 500)
    follower.stop()
    leader, _ = await together.end(), await following
    assert len(read_session(tmp_path / "second.mcap").frames) > 500
    assert leader.problem == f"recording {tmp_path / 'session.mcap'}: {FULL}"


async def test_a_disk_that_is_full_at_the_end_fails_the_run(tmp_path, monkeypatch):
    def full(self):
        raise OSError(errno.ENOSPC, FULL)

    monkeypatch.setattr(SessionWriter, "finish", full)
    leader, _ = await run_session(small_scene(tmp_path), MadeSource([made_frames(0, 100)]))
    assert leader.outcome == "source ended"
    assert leader.problem == f"recording {tmp_path / 'session.mcap'}: {FULL}"


def test_on_a_full_file_system_summary_report_and_json_are_there(tmp_path, small_disk):
    file = small_disk / "session.mcap"
    arguments = ("--json-lines", "--port", 0, "--duration", 6, "--record", file)
    arguments += ("--json", "leader.json", "--report", "report", "--log", small_disk / "log")
    with (
        Service("leader", scene("demo"), *arguments, cwd=tmp_path) as leader,
        follower_of(leader, "demo", tmp_path) as follower,
    ):
        assert (leader.end(), follower.end()) == (1, 0), leader.stderr + follower.stderr
    assert f"recording {file}: {FULL}: the session goes on without it" in leader.events()
    assert leader.stderr.splitlines()[-1] == f"error: recording {file}: {FULL}"
    assert "Traceback" not in leader.stderr
    summary = leader.summary()
    assert summary["outcome"] == "completed"
    assert summary["recording"]["error"] == FULL
    assert json.loads((tmp_path / "leader.json").read_text())["outcome"] == "completed"
    assert "<html" in (tmp_path / "report" / "report.html").read_text()
    written = summary["recording"]["frames"]
    assert written > 500
    assert info(file).frames >= written
    saved = recover(file, tmp_path / "saved.mcap")
    assert saved.frames == len(read_session(saved.path).frames) >= written


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_progress_that_cannot_be_written_ends_no_session(tmp_path):
    """As where standard error goes into a file on the disk that is full."""
    model = Path(scene("demo")).parent / "models/plastic.npz"
    with Service(
        *("leader", scene("model-only"), "--duration", 1, "--json", "leader.json"),
        *("--model", model),
        cwd=tmp_path,
        within=("sh", "-c", 'exec "$@" 2>/dev/full', "sh"),
    ) as leader:
        assert leader.end() == 1
    assert json.loads((tmp_path / "leader.json").read_text())["outcome"] == "completed"
    assert leader.stdout.startswith("mmt-leader  1.0 s")


def test_a_report_that_fails_leaves_the_closing_lines_and_the_json(tmp_path):
    (tmp_path / "demo" / "report.md").mkdir(parents=True)  # a folder where a file would be
    arguments = ("--duration", 1, "--output", "demo", "--json", "all.json")
    with Service("main", "demo", scene("stream-only"), *arguments, cwd=tmp_path) as demo:
        assert demo.end() == 1
    assert "error: writing demo/report.md failed: Is a directory" in demo.stderr
    assert demo.stdout.startswith("mmt demo  1.0 s")
    assert json.loads((tmp_path / "all.json").read_text())["leader"]["outcome"] == "completed"
