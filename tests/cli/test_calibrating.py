"""`mmt device calibrate`: asked for on an emulated board, and from recorded rests."""

import itertools
import json
import sys

import pytest
import typer
from command_runs import output_of, refusal, run_json

from mmt.cli.device import calibrating
from mmt.devices.adxl335.gravity import GRAVITY_M_S2, UPS, GravityCalibration, rests_from
from mmt.devices.adxl335.sensor import Adxl335
from mmt.devices.calibrations import load_calibration

TRUE = GravityCalibration((1.60, 1.68, 1.75), (0.0345, 0.033, 0.0325))


@pytest.fixture(autouse=True)
def own_calibrations(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


CALIBRATE = ("device", "calibrate")
RECORDED = (*CALIBRATE, "adxl335-serial", "--set", "port=none")


def felt(up):
    x, y, z = (GRAVITY_M_S2 * (up[1] == a) * (1 if up[0] == "+" else -1) for a in "xyz")
    return x, y, z


def recorded(path, true, **more):
    rests = [
        {
            "up": up,
            "mean_v": [true.zero_v[i] + true.gain_v_per_m_s2[i] * felt(up)[i] for i in range(3)],
            "spread_v": [0.002] * 3,
        }
        for up in UPS
    ]
    path.write_text(json.dumps({"rests": rests, **more}))
    return path


def test_recorded_rests_are_fitted_stored_and_compared(tmp_path):
    first = recorded(tmp_path / "first.json", TRUE, serial="bench-3")
    said = output_of(*RECORDED, "--rests", first)
    stored = load_calibration("adxl335", "bench-3")
    assert stored["zero_v"] == pytest.approx(TRUE.zero_v)
    assert "changed" not in said
    moved = recorded(tmp_path / "second.json", TRUE._replace(zero_v=(1.60, 1.80, 1.75)))
    found, result = run_json(
        tmp_path, *RECORDED, "--set", "serial=bench-3", "--rests", moved, code=None
    )
    (change,) = found["changes"]
    assert change.startswith("y: zero moved by +3.64 m/s2")
    assert "changed since the last time: y" in result.output


LAB = '[devices]\nrobot = "virtual-robot"\n\n[link]\n\n[recording]\nchannels = "needed"\n'


@pytest.mark.parametrize(
    ("name", "text", "arguments", "message"),
    [
        ("rests.json", "{", (*RECORDED, "--rests"), "not valid JSON"),
        ("rests.json", "[" * 100_000, (*RECORDED, "--rests"), "not valid JSON"),
        ("rests.json", "[]", (*RECORDED, "--rests"), 'must hold "rests"'),
        ("rests.json", '{"rests": 1, "serial": "7"}', (*RECORDED, "--rests"), "list"),
        ("rests.json", None, (*RECORDED, "--rests"), "no serial number: give it one"),
        ("rests.json", "", (*CALIBRATE, "ati-net-ft", "--rests"), "is not calibrated by gravity"),
        ("lab.toml", LAB, CALIBRATE, "has no accelerometer; it has robot"),
    ],
)
def test_what_cannot_be_calibrated_is_told(tmp_path, name, text, arguments, message):
    file = tmp_path / name
    if text is None:
        recorded(file, TRUE)
    else:
        file.write_text(text)
    assert message in refusal(*arguments, file)


def test_rests_that_cannot_be_kept_calibrate_nevertheless(tmp_path, monkeypatch):
    rests = json.loads(recorded(tmp_path / "rests.json", TRUE).read_text())["rests"]
    monkeypatch.setattr(calibrating, "_measure", lambda *_: ("7", rests_from(rests)))
    keep = tmp_path / "rests.json" / "kept.json"
    said = refusal(*RECORDED, "--keep", keep)
    assert said == f"cannot write {keep}: File exists"
    assert load_calibration("adxl335", "7") is not None


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_a_sensor_is_turned_six_ways(tmp_path, monkeypatch):
    from mmt.testing.emulated.adxl335_board import EmulatedAdxl335Board

    held = {"felt": felt("+z"), "shaken": False}
    asked = []

    def truth(time_ns):
        x, y, z = held["felt"]
        return (x + 3.0 * (-1) ** (time_ns // 10_000_000) * held["shaken"], y, z)

    def turn(text, **_):
        asked.append(text)
        axis, _, where = text.split()
        held["felt"] = felt(("+" if where == "up" else "-") + axis)
        # in the hand at first: it is asked for again
        held["shaken"] = text == "x points down" and asked.count(text) == 1
        return "s" if text == "y points down" else ""

    monkeypatch.setattr(typer, "prompt", turn)
    board = EmulatedAdxl335Board(truth, calibration=TRUE)
    board.start()
    try:
        output_of(
            *(*CALIBRATE, "adxl335-serial", "--set", f"port={board.path}", "--set", "serial=7"),
            *("--duration", "0.3", "--keep", tmp_path / "kept.json"),
        )
    finally:
        board.stop()
    ways = [f"{axis} points {way}" for axis in "xyz" for way in ("up", "down")]
    assert [text for text, _ in itertools.groupby(asked)] == ways
    assert asked.count("x points down") >= 2
    stored = load_calibration("adxl335", "7")
    assert stored["zero_v"] == pytest.approx(TRUE.zero_v, abs=0.003)
    assert stored["gain_v_per_m_s2"] == pytest.approx(TRUE.gain_v_per_m_s2, rel=0.01)
    kept = json.loads((tmp_path / "kept.json").read_text())
    assert (kept["serial"], len(kept["rests"])) == ("7", 5)


def test_nobody_turns_what_cannot_be_stored(tmp_path, monkeypatch):
    (tmp_path / "data").write_text("")
    monkeypatch.setattr(typer, "prompt", lambda *_, **__: pytest.fail("one was asked to turn it"))
    monkeypatch.setattr(Adxl335, "connect", lambda _: None)
    bench = ("--set", "serial=bench-3")
    monkeypatch.setattr(Adxl335, "serial_number", "bench-3")
    assert "adxl335-bench-3.json: Not a directory" in refusal(*RECORDED, *bench)
    assert "tool-pen.json: Not a directory" in refusal(*CALIBRATE, "virtual-lab", "--tool", "pen")
