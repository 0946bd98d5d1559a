"""What is logged is whole, on time, and cannot be forged or hold anything up."""

import io
import json
import logging
import os
import threading
from pathlib import Path

import pytest

import mmt.core.output.logs
from mmt.core.errors import InputError, MmtError
from mmt.core.output.logs import Logs, RepeatLimit, details, details_for_log

LOG = logging.getLogger("mmt.test")


def lines(path):
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def test_every_line_has_time_level_service_session_and_event(tmp_path):
    path = tmp_path / "deep" / "log.jsonl"
    with Logs("leader", path) as logs:
        LOG.info("before")
        logs.session_id = "abc"
        LOG.info("after %d", 5, extra=details(time_s=1.5, mode="streamed"))
        LOG.debug("not at this level")
    first, second = lines(path)
    assert (first["service"], first["session"], first["event"]) == ("leader", None, "before")
    assert second["time"] >= first["time"]
    assert second["time"].endswith("+00:00")
    told = {"level": "info", "service": "leader", "session": "abc", "logger": "mmt.test"}
    told |= {"event": "after 5", "time_s": 1.5, "mode": "streamed"}
    assert second == told | {"time": second["time"]}


def test_a_line_stays_one_line_and_no_detail_hides_another_key(tmp_path):
    path = tmp_path / "log.jsonl"
    with Logs("leader", path) as logs:
        logs.session_id = 'a"\n{"level": "forged"}'
        LOG.warning('x"\n{"event": "forged"}\x1b[2J\x00', extra=details(event="hidden", level="y"))
        LOG.warning("x" * 10**6)
    first, second = lines(path)
    assert first["event"] == 'x"\n{"event": "forged"}\x1b[2J\x00'
    assert first["level"] == "warning"
    assert len(second["event"]) == 4000


def test_what_ends_a_service_is_logged_and_a_mistake_has_its_trace(tmp_path, capsys, monkeypatch):
    path = tmp_path / "log.jsonl"
    for error in (ZeroDivisionError("oops"), MmtError("the port is taken")):
        with pytest.raises(type(error)), Logs("leader", path):
            raise error
    mistake, fault = lines(path)
    assert mistake["event"] == "the service failed: oops"
    assert "ZeroDivisionError" in mistake["traceback"]
    assert fault["event"] == "the service failed: the port is taken"
    assert "traceback" not in fault
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # pytest's, which a program has not
    with pytest.raises(MmtError), Logs("leader"):
        raise MmtError("the port is taken")
    assert capsys.readouterr().err == ""  # the command line says it itself


@pytest.mark.parametrize(
    ("file", "level", "shown"),
    [
        (False, None, ["warning: w"]),
        (False, "debug", ["debug: d", "info: i", "warning: w"]),
        (False, "error", []),
        (True, None, ["warning: w"]),
        (True, "debug", ["warning: w"]),
    ],
)
def test_the_terminal_shows_warnings_unless_told_otherwise(
    tmp_path, monkeypatch, file, level, shown
):
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    path = tmp_path / "log.jsonl"
    with Logs("follower", path if file else None, level):
        LOG.debug("d")
        LOG.info("i")
        LOG.warning("w")
    assert stream.getvalue().splitlines() == shown
    if file:
        wanted = ["d", "i", "w"] if level == "debug" else ["i", "w"]
        assert [line["event"] for line in lines(path)] == wanted


def test_logging_is_as_before_afterwards(tmp_path):
    root, own = logging.getLogger(), logging.getLogger("mmt")
    before = (list(root.handlers), own.level, threading.active_count())
    with Logs("leader", tmp_path / "log.jsonl", "debug"):
        pass
    assert (list(root.handlers), own.level, threading.active_count()) == before


def test_a_level_or_a_file_that_cannot_be_is_explained(tmp_path):
    with pytest.raises(InputError, match="--log-level loud: allowed are debug, info, warning, er"):
        Logs("leader", None, "loud")
    with pytest.raises(InputError, match=r"--log .*: Is a directory"):
        Logs("leader", tmp_path)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_is_said_once(capsys):
    with Logs("leader", Path("/dev/full")):
        for number in range(20):
            LOG.info("line %d", number)
    assert capsys.readouterr().err.count("No space left on device") == 1


def test_a_stalled_disk_holds_up_nothing_and_the_loss_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr("mmt.core.output.streams.MOST_WAITING", 100)
    path = tmp_path / "log.jsonl"
    flowing = threading.Event()
    write = os.write

    def stalled(descriptor, data):
        flowing.wait(30)
        return write(descriptor, data)

    monkeypatch.setattr("mmt.core.output.streams.os.write", stalled)
    with Logs("leader", path):
        for number in range(300):
            LOG.info("line %d", number)
        flowing.set()
        LOG.info("last")
    written = lines(path)
    losses = [line["count"] for line in written if line["event"] == "log lines dropped"]
    assert losses  # one, or more where the writer gets a turn while lines are still dropped
    assert sum(losses) + len(written) - len(losses) == 301


def test_after_the_clock_jumped_back_lines_go_on(monkeypatch):
    limit, now_s = RepeatLimit(), 1000.0
    monkeypatch.setattr(mmt.core.output.logs.time, "monotonic", lambda: now_s)
    assert [limit.allow("kind"), limit.allow("kind")] == [1, 0]
    now_s = 5.0
    assert [limit.allow("kind"), limit.allow("kind")] == [2, 0]


def test_nothing_from_elsewhere_steers_the_terminal(capsys):
    with Logs("leader"):
        LOG.warning("refused: \x1b[2Jmine\nerror: forged")
        LOG.error("it failed", exc_info=ValueError("\x1b[2J\x07\u202eforged"))
    text = capsys.readouterr().err
    assert text.startswith("warning: refused: \ufffd[2Jmine\ufffderror: forged\n")
    assert "ValueError: \ufffd[2J\ufffd\ufffdforged" in text


def test_what_a_person_is_told_already_is_in_the_file_alone(tmp_path, capsys):
    with Logs("leader", level="info"):
        LOG.info("told", extra=details_for_log(time_s=1.0))
        LOG.info("not told")
    assert capsys.readouterr().err == "info: not told\n"
    path = tmp_path / "log.jsonl"
    with Logs("leader", path):
        LOG.info("told", extra=details_for_log(time_s=1.0))
    (line,) = lines(path)
    assert (line["event"], line["time_s"]) == ("told", 1.0)
