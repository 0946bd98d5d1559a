"""Recorded slides over real materials, made into courses; here files of the same layout."""

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt_lab.experiments import surfaces
from mmt_lab.surfaces import slides
from mmt_lab.surfaces.slides import (
    Slide,
    in_a_row,
    materials_in,
    read_slide,
    run_slides,
    scatter_db,
)

ROWS = 400


def write_slide(path, pressure, force_n=10.0):
    time_s = 1581.0 + 0.01 * np.arange(len(pressure) // 22)
    bio = np.zeros((len(time_s), 45))
    bio[:, 0], bio[:, 4:26] = time_s, pressure[: 22 * len(time_s)].reshape(-1, 22)
    header = ",".join(["timestamp", *(f"c{number}" for number in range(44))])
    text = "\n".join(",".join(f"{value:.4f}" for value in row) + "," for row in bio)
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"{header}\n{text}\n")
    arm_s = np.arange(1581.0, 1581.0 + 0.01 * len(time_s), 1.0 / 150.0)
    rise = np.linspace(0.5, 1.5, len(arm_s)) * force_n
    arm = np.column_stack([arm_s, 0.6 * rise, 0.8 * rise, 0.0 * rise, *3 * [0.0 * rise]])
    np.savetxt(
        path.with_name(path.name.replace("_bio", "_cw")),
        arm,
        delimiter=",",
        header="timestamp,fx,fy,fz,tx,ty,tz",
        comments="",
    )


def tone(frequency_hz, count=22 * ROWS):
    return 100.0 * np.sin(2.0 * np.pi * frequency_hz * np.arange(count) / 2200.0)


def write_materials(folder, *, slides_each=10):
    random = np.random.default_rng(1)
    for material, smoothing in (("mat1", 1), ("mat2", 30)):
        kernel = np.ones(smoothing) / np.sqrt(smoothing)
        for number in range(slides_each):
            noise = np.convolve(random.standard_normal(22 * ROWS), kernel, "same")
            write_slide(folder / material / f"{material}_{number}_bio.csv", 60.0 * noise)


def test_a_slide_is_resampled_without_folding_and_its_force_brought_into_the_plane(tmp_path):
    write_slide(tmp_path / "a_bio.csv", 400.0 + tone(150.0) + tone(900.0))
    slide = read_slide(tmp_path / "a_bio.csv")
    assert len(slide.vibration_m_s2) == len(slide.force_n) == 10 * ROWS - 300
    spectrum = np.abs(np.fft.rfft(slide.vibration_m_s2 * np.hanning(3700))) / (0.25 * 3700)
    frequencies = np.fft.rfftfreq(3700, 1e-3)
    assert frequencies[np.argmax(spectrum)] == pytest.approx(150.0, abs=1.0)
    assert spectrum.max() == pytest.approx(1.0, rel=0.05)
    assert spectrum[np.abs(frequencies - 150.0) > 5.0].max() < 0.01
    assert slide.force_n[0] == pytest.approx(0.18 * 10.0 * (0.5 + 0.3 / 4.0), rel=0.03)
    assert slide.force_n[-1] == pytest.approx(0.18 * 10.0 * 1.5, rel=0.03)


def test_slides_in_a_row_are_whole_frames_at_a_constant_speed():
    parts = [Slide(np.full(1000, 1.0 + n), np.full(1000, 1.0 + n)) for n in range(3)]
    frames, lengths = in_a_row(parts, [False, True, False])
    assert lengths == [1000, 1300, 1000]
    assert len(frames) == 3300
    np.testing.assert_array_equal(frames["sequence"], np.arange(3300))
    np.testing.assert_allclose(np.diff(frames["position_mm"][:, 0]), 0.025, atol=1e-4)
    force, vibration = frames["force_n"][:, 2], frames["acceleration_m_s2"][:, 2]
    assert force[999] == 1.0
    assert not force[1000:1300].any()
    assert force[1300] == 2.0
    assert force[2300] == 3.0
    assert vibration[1500] == 2.0
    assert vibration[[999, 1300, 2299, 2300]].max() < 0.2


def test_sessions_of_slides_are_followed_and_their_scatter_is_told(tmp_path, monkeypatch):
    write_materials(tmp_path)
    monkeypatch.setattr(slides, "COUNTS", (2, 3))
    found = surfaces.run(slides=tmp_path, seeds=1, workers=1)
    row = found.data["rows"][-1]
    assert (row["group"], row["sessions"], row["stays"]) == ("slides", 1, 9)
    assert row["missed"] == 0
    assert 0.0 < row["delay_s"] < 1.0
    assert found.data["sessions"][0]["surfaces"] in (("mat1", "mat2"), ("mat2", "mat1"))
    rows = found.tables[-1].rows
    assert [cells[0] for cells in rows] == ["from slide to slide", "between materials"]
    within, between = scatter_db(tmp_path)
    assert within.shape == between.shape == (9,)
    assert within.max() < 2.0 < 6.0 < between.max()
    again = run_slides(tmp_path, 1, first=0, workers=1)
    assert again[0].score.delays_s == found.data["sessions"][0]["score"]["delays_s"]


def test_what_holds_no_slides_is_explained(tmp_path):
    with pytest.raises(InputError, match="needs two folders matN"):
        materials_in(tmp_path)
    (tmp_path / "a_bio.csv").write_text("timestamp\n1\n")
    with pytest.raises(InputError, match=r"slide .*a_bio\.csv: "):
        read_slide(tmp_path / "a_bio.csv")
    write_slide(tmp_path / "b_bio.csv", tone(100.0, 22 * 20))
    with pytest.raises(InputError, match="shorter than a second"):
        read_slide(tmp_path / "b_bio.csv")
    with pytest.raises(InputError, match="--slides takes the place"):
        surfaces.run(slides=tmp_path, textures="wood")
