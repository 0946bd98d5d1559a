"""What several tests of commands share."""

import pytest
from device_drivers import DRIVERS


@pytest.fixture
def drivers(tmp_path, monkeypatch):
    name = f"cli_drivers_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(DRIVERS)
    monkeypatch.syspath_prepend(str(tmp_path))
    return name
