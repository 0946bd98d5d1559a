"""A folder is replaced whole, or stays as it was."""

import pytest

from mmt.core.errors import MmtError
from mmt.core.files.existing import replacing_folder


def write(path, text):
    with replacing_folder(path) as part:
        part.mkdir()
        (part / "file").write_text(text)


@pytest.mark.parametrize("name", ["set", "replaced", "set.before"])
def test_a_folder_of_any_name_is_replaced(tmp_path, name):
    for text in ("earlier", "later"):
        write(tmp_path / name, text)
    assert (tmp_path / name / "file").read_text() == "later"
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_what_was_there_stays_where_nothing_can_take_its_place(tmp_path):
    write(tmp_path / "set", "kept")
    with pytest.raises(MmtError, match=r"writing .*set failed"), replacing_folder(tmp_path / "set"):
        pass  # nothing is made
    assert (tmp_path / "set" / "file").read_text() == "kept"
    assert [each.name for each in tmp_path.iterdir()] == ["set"]
