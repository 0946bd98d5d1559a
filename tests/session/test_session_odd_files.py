"""Files that no program of good will writes: one sentence each, which is short."""

import io
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.scene.files import load_scene
from mmt.session.files import import_session, read_session
from mmt.session.formats import suffixes

pytestmark = pytest.mark.usefixtures("read_here")


def archive(path, **members):
    with zipfile.ZipFile(path, "w") as stream:
        for name, data in members.items():
            stream.writestr(f"{name}.npy", data)
    return path


def header(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    return stream.getvalue()


def patched(path, offset_local, offset_central, value):
    """Overwrite a 2-byte field of both headers of an archive's only member."""
    data = bytearray(path.read_bytes())
    central = data.index(b"PK\x01\x02")
    for at in (offset_local, central + offset_central):
        data[at : at + 2] = value.to_bytes(2, "little")
    path.write_bytes(data)
    return path


def stored(path):
    np.savez(path, time_s=np.arange(5.0))
    return path


@pytest.mark.parametrize(
    "made",
    [
        lambda path: archive(path, time_s=header((10**15,))),
        lambda path: patched(stored(path), 6, 8, 1),  # encrypted
        lambda path: patched(stored(path), 8, 10, 99),  # a method that none knows
    ],
    ids=["huge shape", "encrypted", "odd method"],
)
def test_an_odd_archive_is_explained(tmp_path, made):
    path = made(tmp_path / "odd.npz")
    with pytest.raises(
        InputError, match=r"odd\.npz: this is not a .npz archive of numbers"
    ) as told:
        import_session(path)
    assert len(str(told.value)) < 400


def test_a_scene_that_is_nested_without_end_is_explained(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text("x = " + "[" * 100_000, encoding="utf-8")
    with pytest.raises(InputError, match=r"deep\.toml: it is nested too deep"):
        load_scene(path)


def test_a_line_without_end_is_refused_before_it_is_taken_apart(tmp_path):
    path = tmp_path / "line.csv"
    path.write_bytes(b"time_s\n" + b"1," * (10 << 20))
    with pytest.raises(InputError, match=r"line\.csv: a line has more than 1048576 characters"):
        import_session(path)


@given(
    name=st.sampled_from(["scene", "events", "annotations"]),
    value=st.one_of(
        st.none(),  # a group
        st.text("abc {}[]", min_size=1),
        st.integers(-9, 9),
        st.lists(st.floats(-9, 9), max_size=3),
    ),
    ours=st.booleans(),
)
@settings(max_examples=25)
def test_data_sets_of_a_sessions_names_are_anything_in_other_files(name, value, ours):
    h5py = pytest.importorskip("h5py", reason="needs the extra 'import'")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "other.h5"
        with h5py.File(path, "w") as file:
            file["time_s"] = np.arange(50) / 1000
            file["force_n"] = np.ones((50, 3))
            if ours:
                file["sequence"] = file["time_ns"] = np.arange(50)
            if value is None:
                file.create_group(name)
            else:
                file[name] = value
        session, said = None, ""
        try:
            session = import_session(path)
        except InputError as error:
            said = str(error)
    if session is None:
        assert ours
        assert f"{name} is not" in said or "this is not an HDF5 file" in said
    else:
        assert len(session.frames) == 50
        assert ours or (session.scene, session.annotations) == (None, b"")


@pytest.mark.parametrize("suffix", [".mcap", *suffixes("import")])
def test_a_pointer_of_git_lfs_is_called_by_its_name(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n")
    for read in (read_session, import_session):
        with pytest.raises(InputError, match=rf"a{suffix}: .*not fetched: git lfs pull"):
            read(path)
