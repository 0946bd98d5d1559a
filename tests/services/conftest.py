"""What several tests of services share."""

import pytest


@pytest.fixture
def drivers(tmp_path, monkeypatch):
    (tmp_path / "lab_drivers.py").write_text(
        "from instruments import Instrument as Robot, Instrument as Force\n"
        "from mmt.core.errors import MmtError\n"
        "number = 3\n"
        "def absent():\n    raise OSError('no such port')\n"
        "def explained():\n    raise MmtError('switch it on')\n"
    )
    (tmp_path / "broken_drivers.py").write_text("raise OSError('libHD.so is missing')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "lab_drivers"
