import json
import sys
from importlib import metadata
from types import SimpleNamespace

import pytest

from mmt.core.errors import InputError
from mmt.core.extras import install_command, optional_import, require


@pytest.mark.parametrize(
    ("origin", "target"),
    [
        ({"url": "file:///a%20b/mmt", "dir_info": {"editable": True}}, "-e '/a b/mmt[leader]'"),
        ({"url": "file:///mmt", "dir_info": {}}, "'mmt-haptics[leader] @ file:///mmt'"),
        (
            {"url": "https://a.example/mmt", "vcs_info": {"vcs": "git", "commit_id": "1a2b"}},
            "'mmt-haptics[leader] @ git+https://a.example/mmt@1a2b'",
        ),
        (None, "'mmt-haptics[leader]'"),
    ],
)
def test_an_extra_is_added_from_where_the_installation_came_from(monkeypatch, origin, target):
    text = None if origin is None else json.dumps(origin)
    found = SimpleNamespace(read_text=lambda _: text)
    monkeypatch.setattr(metadata, "distribution", lambda _: found)
    assert install_command("leader") == f"{sys.executable} -m pip install {target}"


def test_a_package_that_is_there_is_not_imported(monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "serial"]:
        monkeypatch.delitem(sys.modules, name)
    require("serial")
    assert "serial" not in sys.modules


def test_only_a_missing_optional_package_is_explained(monkeypatch):
    with pytest.raises(ModuleNotFoundError, match="nowhere"), optional_import():
        import nowhere  # noqa: F401
    with pytest.raises(ImportError, match="no_such_name"), optional_import():
        from serial import no_such_name  # noqa: F401
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(InputError, match=r"pyserial, which is not installed; .*\[devices\]"):
        require("serial")
    with pytest.raises(InputError, match="pyserial, which is not installed"), optional_import():
        import serial  # noqa: F401
