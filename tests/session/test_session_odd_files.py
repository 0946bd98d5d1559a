"""Files that no program of good will writes: one sentence each, which is short."""

import io
import zipfile

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.scene.files import load_scene
from mmt.session import import_session


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


def test_the_sentence_on_a_table_of_a_million_columns_is_short(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text(",".join(f"c{n}" for n in range(1_000_000)), encoding="utf-8")
    with pytest.raises(InputError, match="the first of 1000000 columns") as told:
        import_session(path)
    assert len(str(told.value)) < 1000


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("scene_json", "[1]", "scene_json is not a JSON object"),
        ("events_json", '{"event": "mark"}', "events_json is not a list of JSON objects"),
        ("events_json", "[1]", "events_json is not a list of JSON objects"),
        ("events_json", "[", "events_json is not valid JSON"),
    ],
)
def test_scenes_and_events_of_another_form_are_explained(tmp_path, name, text, reason):
    path = tmp_path / "odd.npz"
    np.savez(path, time_s=np.arange(5) / 1000, force_n=np.ones((5, 3)), **{name: np.array(text)})
    with pytest.raises(InputError, match=rf"odd\.npz: {reason}"):
        import_session(path)
