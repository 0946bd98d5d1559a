"""Stored calibrations: kept by serial number, never mistaken for another's."""

import pytest
from driver_fixtures import own_calibrations  # noqa: F401 - a fixture

from mmt.core.errors import InputError, MmtError
from mmt.devices.calibrations import (
    calibration_file,
    load_calibration,
    require_storable,
    save_calibration,
)


def test_what_is_saved_is_loaded():
    assert load_calibration("adxl335", "0042") is None
    path = save_calibration("adxl335", "0042", {"zero_v": [1.5, 1.6, 1.4]})
    assert load_calibration("adxl335", "0042") == {
        "device": "adxl335",
        "serial": "0042",
        "zero_v": [1.5, 1.6, 1.4],
    }
    require_storable("adxl335", "0043")
    assert list(path.parent.iterdir()) == [path]


def test_a_serial_number_cannot_leave_the_folder(tmp_path):
    assert calibration_file("box", "../../etc/passwd").parents[2] == tmp_path
    with pytest.raises(InputError, match="no serial number"):
        calibration_file("box", " ")


@pytest.mark.parametrize("text", ["{", "[]", "[" * 100_000, '{"serial": "8"}', "\xff"])
def test_a_file_that_cannot_be_used_is_named(text):
    path = calibration_file("box", "7")
    path.parent.mkdir(parents=True)
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(MmtError, match=r"box-7\.json .*calibrate again"):
        load_calibration("box", "7")


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "mmt-haptics").write_text("")
    with pytest.raises(MmtError, match=r"cannot write .*box-7\.json"):
        save_calibration("box", "7", {})
    with pytest.raises(InputError, match=r"cannot write .*box-7\.json: Not a directory"):
        require_storable("box", "7")
