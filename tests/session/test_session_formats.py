"""A package adds a format of session files by entry points."""

import numpy as np
import pytest
from frame_samples import made_frames
from plugin_samples import install_package

from mmt.core.errors import InputError
from mmt.session.data import RecordedSession
from mmt.session.files import export_session, read_session
from mmt.session.formats import GROUP, suffixes

MODULE = """
import numpy as np
from mmt.session.data import RecordedSession
from mmt.session.importing.columns import SourceColumns


def write(path, session):
    with path.open("wb") as file:
        np.save(file, session.frames)


def read(path):
    return RecordedSession(np.load(path), path=path)


def read_folder(path, wanted, options):
    return SourceColumns({}, frames=np.load(path / "frames.npy"))
"""


@pytest.fixture
def session():
    return RecordedSession(made_frames(0, 50))


@pytest.fixture
def package(tmp_path, monkeypatch):
    (tmp_path / "added_formats.py").write_text(MODULE)
    names = {
        "write.raw": "added_formats:write",
        "read.raw": "added_formats:read",
        "import/frames.npy": "added_formats:read_folder",
        "read.broken": "added_formats:absent",
    }
    install_package(tmp_path, monkeypatch, "added-formats", {GROUP: names})


def test_a_format_of_another_package_is_written_and_read(package, session, tmp_path):
    export_session(session, tmp_path / "a.raw")
    (tmp_path / "set").mkdir()  # a folder is told by a file in it
    np.save(tmp_path / "set" / "frames.npy", session.frames)
    for name in ("a.raw", "set"):
        assert np.array_equal(read_session(tmp_path / name).frames, session.frames)
    assert ".raw" in suffixes("write")
    with pytest.raises(InputError, match=r"added_formats:absent cannot be imported"):
        read_session(tmp_path / "a.broken")


def test_a_suffix_without_a_format_is_answered_with_those_there_are(session, tmp_path):
    with pytest.raises(InputError, match=r"\.raw cannot be written; .* \.csv, \.h5, \.hdf5, "):
        export_session(session, tmp_path / "a.raw")
    with pytest.raises(InputError, match=r"\.raw cannot be read; .* \.bag, \.csv, .*\.xlsx"):
        read_session(tmp_path / "a.raw")
