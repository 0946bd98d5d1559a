"""Stored calibrations: kept by serial number, never mistaken for another's."""

import pytest

from mmt.core.errors import InputError, MmtError
from mmt.devices.calibrations import calibration_file, load_calibration, save_calibration


def test_what_is_saved_is_loaded(tmp_path):
    assert load_calibration("adxl335", "0042", tmp_path / "new") is None
    path = save_calibration("adxl335", "0042", {"zero_v": [1.5, 1.6, 1.4]}, tmp_path / "new")
    assert load_calibration("adxl335", "0042", tmp_path / "new") == {
        "device": "adxl335",
        "serial": "0042",
        "zero_v": [1.5, 1.6, 1.4],
    }
    assert list(path.parent.iterdir()) == [path]


def test_a_serial_number_cannot_leave_the_folder(tmp_path):
    assert calibration_file("box", "../../etc/passwd", tmp_path).parent == tmp_path
    with pytest.raises(InputError, match="no serial number"):
        calibration_file("box", " ", tmp_path)


@pytest.mark.parametrize("text", ["{", "[]", '{"serial": "8"}', "\xff"])
def test_a_file_that_cannot_be_used_is_named(tmp_path, text):
    path = calibration_file("box", "7", tmp_path)
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(MmtError, match=r"box-7\.json .*calibrate again"):
        load_calibration("box", "7", tmp_path)


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(MmtError, match=r"cannot write .*box-7\.json"):
        save_calibration("box", "7", {}, tmp_path / "file")
