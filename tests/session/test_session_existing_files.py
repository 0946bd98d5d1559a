"""A recorder keeps what an earlier one has recorded; a folder is replaced whole or stays."""

import pytest
from session_samples import made_frames

from mmt.core.errors import InputError, MmtError
from mmt.core.files.existing import replacing_folder
from mmt.core.frames import CHANNELS
from mmt.session.files import read_session
from mmt.session.mcap.index import IndexedSession
from mmt.session.recorder import McapRecorder


def record(path, count, **options):
    with McapRecorder(path, channels=CHANNELS, **options) as recorder:
        recorder.record_frames(made_frames(count))
    return recorder.path


def test_a_recorder_refuses_a_file_that_holds_something(tmp_path):
    path = record(tmp_path / "run.mcap", 30)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"run\.mcap: it exists already; choose .* --force"):
        McapRecorder(path, channels=CHANNELS)
    assert path.read_bytes() == before
    record(path, 10, existing="replace")
    assert len(read_session(path).frames) == 10


def test_a_recording_that_replaced_another_has_an_index_that_counts_from_its_beginning(tmp_path):
    path = record(tmp_path / "run.mcap", 3000, scene={"session": {"name": "first"}})
    record(path, 10, existing="replace", scene={"session": {"name": "second"}})
    windows = IndexedSession.open(path)
    assert windows.scene == {"session": {"name": "second"}}


def test_a_recorder_that_numbers_takes_the_next_name(tmp_path):
    path = tmp_path / "run.mcap"
    made = [record(path, count, existing="number") for count in (30, 20, 10)]
    assert [each.name for each in made] == ["run.mcap", "run-2.mcap", "run-3.mcap"]
    assert [len(read_session(each).frames) for each in made] == [30, 20, 10]


def test_a_file_that_is_being_recorded_into_is_passed_over(tmp_path):
    path = tmp_path / "run.mcap"
    with McapRecorder(path, channels=CHANNELS, existing="number") as first:
        assert record(path, 20, existing="number").name == "run-2.mcap"
        first.record_frames(made_frames(10))
    assert len(read_session(path).frames) == 10


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
