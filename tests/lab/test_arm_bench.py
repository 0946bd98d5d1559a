"""The bench of arms and handles: its arithmetic, a delay that is known, and each of them once."""

import dataclasses
import os
from importlib.util import find_spec
from pathlib import Path

import delayed_robot
import numpy as np
import pytest

from mmt.core.errors import InputError, MmtError
from mmt_lab.bench.device_path import arm_times
from mmt_lab.bench.device_path.arm_times import (
    ARMS,
    command_delays_ms,
    judge,
    measure_arm,
    position_delays_ms,
)
from mmt_lab.bench.device_path.frame_times import Motion
from mmt_lab.experiments import devices

START_NS = 7_000_000_000_123
MS = 1_000_000


def turned(times_ns: np.ndarray) -> np.ndarray:
    motion = Motion(4.0)
    motion.begin()
    return np.array([motion(int(time_ns)) for time_ns in times_ns])


@pytest.mark.parametrize("delay_ns", [10_000, 2_340_000, 31_000_000])
def test_a_position_is_as_old_as_the_tick_that_reads_it_first_finds_it(delay_ns: int) -> None:
    measured_ns = START_NS + 2 * MS * np.arange(100)  # by an arm at 500 Hz, read at 1 kHz
    read_ns = np.repeat(measured_ns + delay_ns, 2) + np.tile([0, MS], 100)
    delays_ms, came_ns = position_delays_ms(np.repeat(turned(measured_ns), 2, axis=0), read_ns)
    assert delays_ms == pytest.approx(np.full(99, delay_ns / MS), abs=1e-6)
    assert came_ns.tolist() == (measured_ns + delay_ns)[1:].tolist()


def test_a_step_has_come_with_the_first_command_that_leaves_where_it_rested() -> None:
    stepped_ns = START_NS + 60 * MS * np.arange(4)
    heard = [
        (-5.0, 0.0),
        (2.5, 0.05),  # the first step, within bounds
        (4.5, 0.2),
        (20.0, 0.2 + 1e-9),  # rounding
        (61.0, 0.2 + 2e-9),
        (63.5, 0.0),  # the second
        (184.0, 0.2),  # the fourth; of the third there is nothing
    ]
    heard_ns = START_NS + np.array([round(at * MS) for at, _ in heard])
    values = np.array([(x, -430.0, 0.0) for _, x in heard])
    found = command_delays_ms(stepped_ns, heard_ns, values)
    assert found == pytest.approx([2.5, 3.5, np.nan, 4.0], nan_ok=True)
    assert np.isnan(command_delays_ms(stepped_ns, heard_ns[:0], values[:0])).all()


def reads(delays_ms: np.ndarray) -> dict[str, np.ndarray]:
    """Reads at each tick, of positions of so long before."""
    read_ns = START_NS + MS * np.arange(len(delays_ms))
    return {
        "places_mm": turned(read_ns - np.round(delays_ms * MS).astype(np.int64)),
        "read_ns": read_ns,
        "ticked": np.stack([np.arange(len(read_ns)), read_ns], axis=1),
        "stepped_ns": read_ns[::100],
    }


def test_median_and_jitter_are_of_all_and_ticks_held_up_are_told_apart() -> None:
    delays_ms = np.where(np.arange(1000) % 4 == 0, 1.5, 1.25)
    given = reads(delays_ms)
    given["ticked"][900:, 1] += 7 * MS  # by which all the rest is late
    given["read_ns"][900:] += 7 * MS
    heard_ns = np.append(START_NS - MS, given["stepped_ns"] + 2 * MS)[:-1]
    values = np.array([(0.2 * (step % 2), 0.0, 0.0) for step in range(len(heard_ns))])
    found = judge(given, heard_ns, values)
    assert found.positions.p99_ms == pytest.approx(8.5, abs=1e-6)
    assert found.positions.p50_ms == pytest.approx(1.25, abs=1e-6)
    assert found.positions.jitter_p99_ms == pytest.approx(7.25, abs=1e-6)
    assert found.running_p99_ms == pytest.approx(1.5, abs=1e-6)
    assert (found.steps, found.unanswered) == (10, 1)
    assert (found.commands.p50_ms, found.commands.jitter_p99_ms) == pytest.approx((2.0, 0.0))


def test_where_nothing_came_there_is_a_sentence_and_no_figure() -> None:
    given, none = reads(np.ones(200)), np.empty((0, 3))
    with pytest.raises(MmtError, match="no command has arrived"):
        judge(given, none[:, 0], none)
    with pytest.raises(MmtError, match="no new position has come"):
        judge({**given, "places_mm": np.ones((200, 3))}, none[:, 0], none)
    with pytest.raises(MmtError, match="nothing was read"):
        judge({**given, "places_mm": none}, none[:, 0], none)


def test_a_delay_that_is_known_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = str(Path(delayed_robot.__file__).parent)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([folder, os.environ.get("PYTHONPATH", "")]))
    delayed = dataclasses.replace(ARMS["datagrams"], driver="delayed_robot:DelayedRobot")
    monkeypatch.setitem(ARMS, "datagrams", delayed)
    found = measure_arm("datagrams", 1.0)
    # both ends tick at 1 kHz, and the datagrams wait for the other's tick
    assert found.positions.p50_ms == pytest.approx(delayed_robot.READS + 0.5, abs=1.0)
    assert found.commands.p50_ms == pytest.approx(delayed_robot.WRITES + 0.5, abs=1.0)


@pytest.mark.parametrize("arm", [name for name in ARMS if name != "datagrams"])
def test_each_is_read_and_commanded(arm: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if ARMS[arm].package is not None and find_spec(ARMS[arm].package) is None:
        pytest.skip("ur-rtde is not installed: see docs/how-to/universal-robots.md")
    monkeypatch.setattr(devices, "SET_UPS", ())
    monkeypatch.setattr(devices, "ARMS", {arm: ARMS[arm]})
    monkeypatch.setattr(devices, "DURATION_S", 0.5)
    result = devices.run()
    assert result.left_out == ()
    *_, positions, commands = (records.rows[0] for records in result.records if records.rows)
    assert positions["new positions"] > 50
    assert 0.0 < positions["p50 (ms)"] < 40.0
    assert positions["jitter p50 (ms)"] <= positions["jitter p99 (ms)"]
    assert commands["steps"] > commands["unanswered"]
    assert commands["p50 (ms)"] > 0.0


def test_an_arm_whose_package_is_missing_is_a_row_with_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def require(package: str) -> None:
        raise InputError(f"arms need {package}; install it with: pip install x")

    monkeypatch.setattr(arm_times, "require", require)
    monkeypatch.setattr(devices, "SET_UPS", ())
    monkeypatch.setattr(devices, "ARMS", {"ur": ARMS["ur"]})
    result = devices.run()
    (row,) = result.left_out
    assert row.name == "UR arm"
    assert row.reason == "arms need rtde_control; install it with: pip install x"
