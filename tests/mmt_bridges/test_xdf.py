"""What goes out by LSL and was recorded as XDF comes back."""

import json
import time

import numpy as np
import pytest
from session_samples import made_frames
from test_lsl_services import needs_the_library
from xdf_writer import Received, write_xdf

from mmt.core.errors import InputError
from mmt.core.frames import ALL_CHANNELS, channels_of
from mmt.leader.publishing import Block, Marker
from mmt.session.files import import_session, read_session
from mmt.session.importing.recording import read_columns
from mmt_bridges.lsl.streams import Streams

pytestmark = pytest.mark.usefixtures("read_here")

pytest.importorskip("pyxdf", reason="needs the extra 'import'")

EVENT = {"time_s": 0.25, "event": "it begins"}
OTHER = """<?xml version="1.0"?><info><name>EEG</name><type>EEG</type>
<channel_count>2</channel_count><nominal_srate>250</nominal_srate><channel_format>float32</channel_format><desc></desc></info>"""


class Outlet:
    """Keeps what a recipient would get."""

    def __init__(self, info, max_buffered):
        self.xml = info.as_xml()
        self.samples = []
        self.stamps_s = []

    def push_chunk(self, values, stamps_s):
        self.samples += list(values)
        self.stamps_s += stamps_s

    def push_sample(self, values, stamp_s):
        self.push_chunk([values], [stamp_s])


@pytest.fixture
def streamed(monkeypatch):
    """Returns the streams of frames (n,), from now on by LSL's clock."""
    needs_the_library()
    import pylsl

    def stream(frames, samples_per_frame, offset_s):
        made = []

        def outlet(info, max_buffered):
            made.append(Outlet(info, max_buffered))
            return made[-1]

        monkeypatch.setattr(pylsl, "StreamOutlet", outlet)
        streams = Streams("bench", channels_of(frames.dtype), 1000.0, samples_per_frame, "3f9c")
        begin_ns = round(streams.clock_s() * 1e9)
        streams.push_frames([Block(frames, begin_ns - int(frames["time_ns"][0]))])
        streams.push_marker(Marker(begin_ns, json.dumps(EVENT)))
        return [Received(each.xml, each.samples, each.stamps_s, offset_s) for each in made]

    return stream


@pytest.mark.parametrize("several", [1, 5])
@pytest.mark.parametrize("offset_s", [0.0, -7000.5])
def test_a_recorded_stream_comes_back(tmp_path, streamed, several, offset_s):
    steps = np.ones(59, dtype=int)
    steps[20] = 4
    frames = made_frames(60, ALL_CHANNELS, steps=steps, samples_per_frame=several)
    write_xdf(tmp_path / "a.xdf", streamed(frames, several, offset_s))
    back = import_session(tmp_path / "a.xdf", acceleration_rate_hz=1000 * several)
    for name in ("position_mm", "force_n", "acceleration_m_s2", "orientation"):
        np.testing.assert_array_equal(back.frames[name], frames[name])
    np.testing.assert_array_equal(np.diff(back.frames["sequence"]), steps)
    assert back.events == [EVENT]
    assert back.began_utc_ns == pytest.approx(time.time_ns(), abs=60e9)


def test_streams_of_other_programs_are_mapped_by_their_names(tmp_path, streamed):
    times_s = [1.0 + k / 1000 for k in range(600)]
    other = Received(OTHER, [[k, -k] for k in range(600)], times_s)
    write_xdf(tmp_path / "a.xdf", [other, *streamed(made_frames(60), 1, 0.0)])
    columns = {"force_x": "0", "force_y": "0", "force_z": "EEG.2"}
    assert len(import_session(tmp_path / "a.xdf").frames) == 60
    write_xdf(tmp_path / "b.xdf", [other])
    back = import_session(tmp_path / "b.xdf", columns=columns)
    np.testing.assert_array_equal(back.frames["force_n"][:, 2], -np.arange(600))
    assert back.began_utc_ns is None
    labels = "<desc><channels>" + 2 * "<channel><label>F</label></channel>" + "</channels></desc>"
    for described, name in (("", "EEG.2"), (labels, "EEG.F.2")):
        xml = OTHER.replace("<desc></desc>", described)
        write_xdf(tmp_path / "b.xdf", [other._replace(xml=xml)])
        values = read_columns(tmp_path / "b.xdf", bool).values
        np.testing.assert_array_equal(values[name], -np.arange(600))
    content = (tmp_path / "b.xdf").read_bytes()
    (tmp_path / "b.xdf").write_bytes(content[: content.rindex(b"<?xml") - 12])
    cut = read_columns(tmp_path / "b.xdf", bool)
    assert len(cut.values["EEG.F.1"]) == 600
    assert "EEG was not finished: it was read as far as it goes" in cut.notes
    (tmp_path / "c.xdf").write_bytes(b"no XDF at all")
    with pytest.raises(InputError, match=r"c\.xdf: this is not an XDF file"):
        read_session(tmp_path / "c.xdf")
