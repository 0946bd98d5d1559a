"""The packed index: the same file as the library's own list makes, in a tenth of the memory."""

import io
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from mmt.session import mcap_writer
from mmt.session.mcap_writer import open_writer


def file_of(chunks: int) -> bytes:
    stream = io.BytesIO()
    writer = open_writer(stream)
    fill(writer, chunks)
    writer.finish()
    return stream.getvalue()


def fill(writer: Writer, chunks: int) -> None:
    schema = writer.register_schema("s", "jsonschema", b"{}")
    channels = [writer.register_channel(name, "json", schema) for name in ("a", "b", "c", "d")]
    for number in range(chunks):
        for channel in channels:
            writer.add_message(channel, 10**18 + number, b"{}", 10**18 + number)
        writer.flush()


@pytest.mark.parametrize("chunks", [0, 1, 127, 128, 129, 400])
def test_the_file_is_the_same_as_with_the_librarys_own_index(
    monkeypatch: pytest.MonkeyPatch, chunks: int
) -> None:
    packed = file_of(chunks)
    summary = make_reader(io.BytesIO(packed)).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == chunks
    monkeypatch.setattr(mcap_writer, "pack_index", lambda _: None)
    assert packed == file_of(chunks)


def test_a_long_recording_holds_little_of_its_index(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def grown_bytes(pack: Callable[[Writer], None]) -> int:
        monkeypatch.setattr(mcap_writer, "pack_index", pack)
        with (tmp_path / "file.mcap").open("wb") as stream:
            writer = open_writer(stream)
            fill(writer, 200)
            tracemalloc.start()
            try:
                before, _ = tracemalloc.get_traced_memory()
                fill(writer, 1000)
                after, _ = tracemalloc.get_traced_memory()
            finally:
                tracemalloc.stop()
        return after - before

    packs = mcap_writer.pack_index
    own, packed = grown_bytes(lambda _: None), grown_bytes(packs)
    assert packed < own / 3
