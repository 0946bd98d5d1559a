"""Force feedback over a delay: the closed loop, recorded contacts, and what is printed."""

import json
from pathlib import Path

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt_lab.experiments.feedback import TARGET_RATIO, run
from mmt_lab.feedback import recorded, simulated
from mmt_lab.feedback.recorded import evaluate_run, read_run
from mmt_lab.feedback.sides import METHODS
from mmt_lab.feedback.simulated import DelayLine, run_cell

RECORDED = Path(__file__).parents[2] / "../shared/data/bilateral_1dof"
NEEDS_RECORDED = pytest.mark.skipif(not RECORDED.is_dir(), reason=f"{RECORDED.name} is not there")


def write_run(path, seconds=3.0, stiffness_n_m=800.0, **odd):
    """A spring that is pressed at 2 Hz, felt at a lever of 75 mm, at 2 kHz."""
    time_s = np.arange(0.0, seconds, 5e-4)
    depth_m = 4e-3 * np.sin(2 * np.pi * 2 * time_s - 1.0)
    arrays = {
        "time_s": time_s,
        "leader_position_rad": depth_m / 0.075,
        "follower_position_rad": depth_m / 0.075,
        "environment_torque_nm": -0.075 * stiffness_n_m * np.maximum(0.0, depth_m),
        "arm_length_m": 0.075,
    }
    np.savez(path, **{name: each for name, each in (arrays | odd).items() if each is not None})
    return path


def test_a_stiff_wall_shakes_the_streamed_force_and_neither_of_the_others():
    streamed, passive, model = (run_cell(method, 10.0, 50) for method in METHODS)
    assert not streamed.stable
    assert streamed.injected_mj > 100.0
    for cell in (passive, model):
        assert cell.stable
        assert cell.passive
    assert model.force_error_n < 0.2 * passive.force_error_n
    assert model.position_error_mm < 0.5 * passive.position_error_mm


def test_a_line_delivers_in_order_and_each_once():
    line = DelayLine(20, 15, 3)
    arrived = []
    for tick in range(300):
        if tick < 200:
            line.push(tick, tick)
        for item in line.pop(tick):
            assert tick - item >= 5
            arrived.append(item)
    assert arrived == list(range(200))


def test_a_recorded_spring_is_found_and_shown_without_its_delay(tmp_path):
    run = read_run(write_run(tmp_path / "one_spring.npz"))
    assert run.contact == "spring"
    assert run.force_n.max() == pytest.approx(3.2, rel=0.02)  # the sign is turned
    assert run.opening_j == 0.0
    streamed, passive, model = (evaluate_run(run, method, 100) for method in METHODS)
    assert model.force_error_n < TARGET_RATIO * streamed.force_error_n
    assert model.surface.stiffness_n_m == pytest.approx(800.0, rel=0.1)
    assert model.settled_s < 1.5
    for result in (passive, model):
        assert result.energy_mj <= 1.0 + 1e-6


def test_the_tables_the_json_and_the_report_hold_every_cell(tmp_path, monkeypatch):
    springs_n_m = {"one_spring": 800.0, "in_air": 0.0}
    paths = [write_run(tmp_path / f"{name}.npz", 1.5, n_m) for name, n_m in springs_n_m.items()]
    monkeypatch.setattr(simulated, "WALLS_N_MM", (2.0,))
    monkeypatch.setattr(simulated, "DELAYS_MS", (10,))
    monkeypatch.setattr(recorded, "DELAYS_MS", (100,))
    found = run(paths, workers=1)
    document = json.loads(json.dumps(found.as_dict()))
    assert 2 * len(document["simulated"]) == len(document["recorded"]) == 6
    assert {row["method"] for row in document["pooled"]} == set(METHODS)
    assert [len(table.rows) for table in found.tables] == [1, 1, 2, 2]
    assert any("model: stable and passive in 1 of 1" in text for text in found.sentences)
    assert [target.met for target in found.targets] == [True, True, True, None]


@pytest.mark.parametrize(
    ("odd", "problem"),
    [
        ({"time_s": None}, "no array"),
        ({"time_s": np.zeros(3)}, "one length"),
        ({"time_s": np.full(6000, 0.4)}, "over more than 0.4 s"),
        ({"time_s": -np.arange(6000.0)}, "time_s must ascend"),
        ({"arm_length_m": 0.0}, "one number, and not 0"),
        ({"arm_length_m": (0.1, 0.1)}, "one number"),
    ],
)
def test_a_file_that_is_none_is_named(tmp_path, odd, problem):
    with pytest.raises(InputError, match=problem):
        read_run(write_run(tmp_path / "wrong.npz", **odd))
    (tmp_path / "wrong.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="no recording"):
        read_run(tmp_path / "wrong.npz")
    with pytest.raises(InputError, match="no recording there"):
        run([tmp_path / "none.npz"])


@NEEDS_RECORDED
@pytest.mark.parametrize("contact", ["foam", "spring", "rigid"])
def test_the_model_has_less_than_a_third_of_the_error_on_real_contact(contact):
    """100 ms each way, pooled over the three recorded runs."""
    paths = sorted(RECORDED.glob(f"*_{contact}.npz"))
    assert len(paths) == 3
    squares = {"streamed": 0.0, "model": 0.0}
    for path in paths:
        run = read_run(path)
        assert run.contact == contact
        for method in ("streamed", "model"):
            squares[method] += evaluate_run(run, method, 100).force_error_n ** 2
    assert squares["model"] < TARGET_RATIO**2 * squares["streamed"]


@NEEDS_RECORDED
@pytest.mark.parametrize(("name", "largest"), [("a", 0.5), ("c", 0.67)])
def test_a_rigid_wall_that_is_met_in_knocks_is_estimated(name, largest):
    """The knocks last 20 ms, among drag and pushes of something else on the way out."""
    run = read_run(RECORDED / f"question1{name}_rigid.npz")
    streamed, model = (evaluate_run(run, method, 100) for method in ("streamed", "model"))
    assert model.force_error_n < largest * streamed.force_error_n
    assert model.surface.stiffness_at(1.0) > 2000.0
