"""Damaged and hostile files: each is read, or refused in one sentence that stays short.

MATLAB files are left out: scipy's own reader ends the process on some that are damaged.
"""

import io
import resource
import time
import zipfile
from functools import cache
from pathlib import Path

import fuzzing
import numpy as np
import pytest
from hypothesis import strategies as st

import mmt
from mmt.core.errors import MmtError
from mmt.devices.ati.gauges import parse_calibration_file
from mmt.scene.files import example_scenes, load_scene
from mmt.session.files import import_session, read_session, write_session
from mmt.session.recover import recover
from mmt.testing.simulation.recorded_path import load_path
from mmt_bridges.hatt.file import parse_hatt

pytestmark = pytest.mark.usefixtures("read_here")

LONGEST_SENTENCE = 1000
SLOWEST_S = 20.0
MOST_GROWTH_MB = 1500.0

TIME_S = np.arange(200) / 500
VECTORS = np.random.default_rng(1).standard_normal((200, 3))


def _packed(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def _recorded(path):
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=0.3)
    events = [{"time_s": 0.1, "event": "mark"}]
    write_session(path, frames, scene=mmt.Scene().dump(), annotations=truth, events=events)
    return path.read_bytes()


def _workbook():
    openpyxl = pytest.importorskip("openpyxl")
    book, stream = openpyxl.Workbook(), io.BytesIO()
    book.active.append(["time_s", "force_x_n", "force_y_n", "force_z_n"])
    for row in np.column_stack([TIME_S, VECTORS]).tolist():
        book.active.append(row)
    book.save(stream)
    return stream.getvalue()


def _table():
    rows = [",".join(map(str, row)) for row in np.column_stack([TIME_S, VECTORS]).tolist()]
    return "\n".join(["time_s,force_x_n,force_y_n,force_z_n", *rows]).encode()


HATT = b"""<?xml version="1.0"?><modelSet><material>x</material><numMod>1</numMod>
<SampleRate>10000</SampleRate><maxSpeed>800</maxSpeed><maxForce>4</maxForce>
<AccelUnits>m/s^2</AccelUnits><SpeedUnits>mm/s</SpeedUnits><ForceUnits>N</ForceUnits>
<model><speedMod>1</speedMod><forceMod>1</forceMod><var>1</var><ARlsf><value>1</value>
<value>2</value></ARlsf></model></modelSet>"""


def _bytes_of(reads):
    return lambda path: reads(path.read_bytes())


READ_HATT = _bytes_of(parse_hatt)
READ_CAL = _bytes_of(parse_calibration_file)

MODEL = next(Path(mmt.__file__).parent.glob("models/*.npz"), None)

KINDS = {
    "archive": (".npz", lambda _: _packed(time_s=TIME_S, force_n=VECTORS), import_session),
    "table": (".csv", lambda _: _table(), import_session),
    "workbook": (".xlsx", lambda _: _workbook(), import_session),
    "session": (".mcap", _recorded, read_session),
    "recovery": (".mcap", _recorded, lambda p: recover(p, p.with_suffix(".saved.mcap"))),
    "model": (".npz", lambda _: _model(), mmt.load_model),
    "stroke": (
        ".npz",
        lambda _: _packed(time_s=TIME_S, position_mm=VECTORS, force_n=VECTORS),
        load_path,
    ),
    "scene": (".toml", lambda _: next(iter(example_scenes().values())).read_bytes(), load_scene),
    "hatt": (".xml", lambda _: HATT, READ_HATT),
    "calibration": (".cal", lambda _: HATT.replace(b"modelSet", b"FTSensor"), READ_CAL),
}


def _model():
    return MODEL.read_bytes()


def _changed(data, changes):
    for how, at, piece in changes:
        place = at % (len(data) + 1)
        match how:
            case "cut":
                data = data[:place]
            case "overwrite":
                data = data[:place] + piece + data[place + len(piece) :]
            case "insert":
                data = data[:place] + piece + data[place:]
            case "repeat":
                data = data[:place] + data[place : place + 100] * 20 + data[place:]
            case "remove":
                data = data[:place] + data[place + len(piece) :]
    return data


NUMBERS = (b"\xff" * 8, b"\0" * 8, b"nan", b"-inf", b"1e999", b"9" * 50)
ODD = (*NUMBERS, b"[" * 2000, b"{", b'"', b"\n", b";,")
PIECES = st.binary(min_size=1, max_size=8) | st.sampled_from(ODD)
WAYS = st.sampled_from(["cut", "overwrite", "overwrite", "insert", "repeat", "remove"])
CHANGES = st.lists(st.tuples(WAYS, st.integers(0, 2**20), PIECES), min_size=1, max_size=3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_or_refused_in_a_sentence(tmp_path, kind):
    suffix, make, reads = KINDS[kind]
    path = tmp_path / f"file{suffix}"
    whole = make(path)
    path.write_bytes(whole)
    if kind != "calibration":  # of which none may be passed on
        reads(path)

    def body(changes):
        path.write_bytes(_changed(whole, changes))
        began_s = time.monotonic()
        try:
            reads(path)
        except MmtError as error:
            told = str(error)
        else:
            told = "it was read"
        assert 10 < len(told) < LONGEST_SENTENCE
        assert time.monotonic() - began_s < SLOWEST_S

    assert fuzzing.fuzz(body, CHANGES, share=0.2) > 5


def _deep_toml():
    return b"x = " + b"[" * 100_000


@cache
def _bomb(size):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        header = io.BytesIO()
        shape = {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)}
        np.lib.format.write_array_header_1_0(header, shape)
        with archive.open("time_s.npy", "w", force_zip64=True) as member:
            member.write(header.getvalue())
            block = bytes(1 << 20)
            for _ in range(size >> 20):
                member.write(block)
    return stream.getvalue()


def _laughs(encoding):
    entities = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10))
    text = f'<?xml version="1.0" encoding="{encoding}"?><!DOCTYPE x [<!ENTITY a0 "ha">{entities}]>'
    return (text + "<modelSet>&a9;</modelSet>").encode(encoding)


@pytest.mark.parametrize(
    ("name", "content", "reads", "reason"),
    [
        ("bomb.npz", lambda: _bomb(520 << 20), import_session, "unpacks to 545 MB"),
        ("bomb.npz", lambda: _bomb(520 << 20), mmt.load_model, "texture model"),
        ("a.xml", lambda: _laughs("utf-8"), READ_HATT, "document type"),
        ("a.xml", lambda: _laughs("utf-16"), READ_HATT, "document type"),
        ("a.cal", lambda: _laughs("utf-16"), READ_CAL, "document type"),
        ("a.xml", lambda: b"<?xml version='1.0' encoding='utf-7'?><a/>", READ_HATT, "no XML"),
        ("a.xml", lambda: b"<?xml version='1.0' encoding='big5'?><a/>", READ_HATT, "no XML"),
        ("a.xml", lambda: b"<a>" * 200_000, READ_HATT, "no XML"),
        ("a.toml", _deep_toml, load_scene, "nested too deep"),
        ("a.npz", lambda: _packed(time_s=np.array([{}])), import_session, "archive of numbers"),
        (
            "a.npz",
            lambda: _packed(time_s=TIME_S, force_n=VECTORS, scene_json=np.array("[" * 100_000)),
            import_session,
            "not valid JSON",
        ),
    ],
)  # fmt: skip
def test_a_hostile_file_is_refused_at_once(tmp_path, name, content, reads, reason):
    path = tmp_path / name
    path.write_bytes(content())
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    began_s = time.monotonic()
    with pytest.raises(MmtError, match=reason) as told:
        reads(path)
    assert len(str(told.value)) < LONGEST_SENTENCE
    assert time.monotonic() - began_s < SLOWEST_S
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 < before_mb + MOST_GROWTH_MB
