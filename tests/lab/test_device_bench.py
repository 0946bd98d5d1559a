"""The bench of the device path: its arithmetic on frames that are known, and one run of it."""

import numpy as np
import pytest

from mmt.core.errors import MmtError
from mmt_lab.bench.device_path.emulated import adxl335, bota, iio, net_ft, u6
from mmt_lab.bench.device_path.frame_times import Motion, frame_times, time_errors_ms
from mmt_lab.experiments.bench import devices
from mmt_lab.experiments.bench.devices import SetUp

START_NS = 7_000_000_000_123


def turned(motion, times_ns):
    return np.array([motion(int(time_ns)) for time_ns in times_ns])


def moving(size):
    motion = Motion(size)
    motion.begin()
    return motion


@pytest.mark.parametrize("late_ns", [-3_000_000, -20_000, 0, 90_000, 20_000_000])
def test_a_value_tells_how_much_later_it_was_there(late_ns):
    times_ns = START_NS + 1_000_000 * np.arange(300)
    values = 0.4 * turned(moving(5.0), times_ns + late_ns)  # a filter takes of its length
    assert time_errors_ms(values, times_ns) == pytest.approx(late_ns / 1e6, abs=1e-6)


def test_latency_jitter_and_offset_of_frames_that_are_known():
    times_ns = START_NS + 1_000_000 * np.arange(1000)
    wander_ns = np.where(np.arange(1000) % 10 == 0, 40_000, 0)
    values = {
        "force": turned(moving(5.0), times_ns - 100_000 + wander_ns),
        "acceleration": turned(moving(20.0), times_ns - 300_000),
    }
    formed_ns = times_ns + np.where(np.arange(1000) < 20, 9_000_000, 2_000_000)
    found, offset_ms = frame_times(values, times_ns, formed_ns, stated_ms=0.5)
    assert found["latency p50 (ms)"] == pytest.approx(2.0 + 0.3 - 0.5)
    assert found["p99 (ms)"] == pytest.approx(8.8)
    assert offset_ms == pytest.approx({"force": -0.1, "acceleration": -0.3})
    assert found["jitter p99: force (ms)"] == pytest.approx(0.04, abs=1e-6)
    assert found["acceleration (ms)"] == pytest.approx(0.0, abs=1e-6)
    assert found["apart, p99 (ms)"] == pytest.approx(0.24)


@pytest.mark.parametrize(("force", "acceleration"), [(net_ft, adxl335), (bota, iio)])
def test_a_run_on_emulated_devices_finds_what_holds_on_any_machine(
    force, acceleration, monkeypatch
):
    monkeypatch.setattr(devices, "SET_UPS", [SetUp("both", force, acceleration)])
    monkeypatch.setattr(devices, "DURATION_S", 1.0)
    monkeypatch.setattr(devices, "STOPS", 1)
    result = devices.run()
    assert result.left_out == ()
    (cost,), (times,), (frames,), (clocks,) = (records.rows for records in result.records)
    assert 0.0 < cost["share of a core"] < 1.0
    assert 0.0 < cost["tick alone"] < 1.0
    assert times["latency p50 (ms)"] > 0.5
    assert frames["frames"] > 100
    assert frames["stop seen after, longest (ms)"] > 10.0
    assert clocks["error of the drift: force (ppm)"] >= 0.0
    imported = result.targets[-1]
    assert imported.what == "set-ups that import scipy or numba"
    assert imported.met
    assert result.as_dict()["targets"][0]["bound"] == 0.25


def test_targets_are_of_the_worst_set_up_and_what_cannot_run_is_left_out(monkeypatch):
    def measured(set_up, **_):
        if set_up.name == "broken":
            raise MmtError("no compiler")
        share = 0.1 if set_up.name == "good" else 0.301
        times = {"p99 (ms)": 9.0 if set_up.slow else 1.5}
        times |= {"jitter p99: force (ms)": 0.0, "acceleration (ms)": 0.0}
        cost = {"share of a core": share, "emulation": 0.05, "tick alone": 0.02}
        frames = {"stop seen after, longest (ms)": 16.0}
        return {"cost": cost, "times": times, "frames": frames, "clocks": {}}, False

    monkeypatch.setattr(devices, "measure_set_up", measured)
    names = ("good", "worse", "broken")
    set_ups = [SetUp(name, net_ft, u6) for name in names]
    set_ups.append(SetUp("slow", bota, iio, slow=True))
    monkeypatch.setattr(devices, "SET_UPS", set_ups)
    result = devices.run()
    by_name = {target.what: target for target in result.targets}
    share = by_name["share of a core, without emulation"]
    assert share.measured == pytest.approx(0.25 + 1e-3)
    assert not share.met
    assert by_name["stopped sensor seen after, longest (ms)"].met
    assert by_name["latency sensor to frame, p99 (ms)"].measured == pytest.approx(1.5, abs=1e-3)
    assert [(out.name, out.reason) for out in result.left_out] == [("broken", "no compiler")]
