"""Frames and events by the real library, from a follower whose clock is another one."""

import json
from importlib.util import find_spec
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from network_namespaces import LEADER_ADDRESS, veth, within_follower
from publishing_samples import run_beside

from mmt.core.errors import InputError
from mmt_bridges.lsl.streams import load_pylsl

AHEAD_S = 5000
SCENE = """
[session]
duration_s = 3
[link]
host = "{address}"
open = true
[simulated]
[hand]
[lsl]
name = "bench"
[recording]
file = "session.mcap"
"""
LIBRARY = """
[multicast]
ResolveScope = machine
[ports]
IPv6 = disable
[log]
level = -2
"""
"""Settings of liblsl: it finds streams on this machine alone, and prints errors only."""

RECEIVER = """
import json, pathlib, sys
import pylsl

names = ("bench-frames", "bench-events")
inlets = {}
for name in names:
    (found,) = pylsl.resolve_byprop("name", name, timeout=30)
    inlets[name] = pylsl.StreamInlet(found, recover=False)
    inlets[name].open_stream(timeout=30)
print("ready", flush=True)
received = {name: [[], []] for name in names}
for name, inlet in inlets.items():
    received[name].append(inlet.info(timeout=30).as_xml())
ended = False
while not ended:
    for name, inlet in inlets.items():
        try:
            samples, stamps = inlet.pull_chunk(timeout=0.05, max_samples=4096)
        except pylsl.util.LostError:
            ended = True
            continue
        received[name][0] += [[v if isinstance(v, str) else float(v) for v in s] for s in samples]
        received[name][1] += [float(stamp) for stamp in stamps]
pathlib.Path(sys.argv[1]).write_text(json.dumps(received))
"""


def needs_the_library():
    if find_spec("pylsl") is None:
        pytest.skip("needs the extra 'lsl'")
    try:
        load_pylsl()
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """What a recipient got of a session, the session, and the leader's summary."""
    needs_the_library()
    folder = tmp_path_factory.mktemp("lsl")
    scene = folder / "lsl.toml"
    scene.write_text(SCENE.format(address=LEADER_ADDRESS))
    library = folder / "lsl_api.cfg"
    library.write_text(LIBRARY)
    with veth() as made:
        return run_beside(
            RECEIVER,
            scene,
            LEADER_ADDRESS,
            made.within_leader(),
            within_follower(made, AHEAD_S),
            LSLAPICFG=str(library),
        )


def test_frames_arrive_as_they_were_recorded_stamped_by_the_leaders_clock(run):
    received, session, summary = run
    samples, stamps_s, _ = received["bench-frames"]
    frames = session.frames
    assert summary["lsl"]["frames"] == len(samples)
    assert summary["lsl"]["frames"] + summary["lsl"]["unstamped"] == len(frames)
    assert summary["lsl"]["dropped"] == 0
    assert summary["lsl"]["error"] is None
    assert 1000 < len(samples) < len(frames), "the clock is compared in the first second"
    frames = frames[-len(samples) :]
    fields = ("position_mm", "force_n", "acceleration_m_s2")
    expected = np.concatenate([frames[field] for field in fields], axis=1)
    np.testing.assert_array_equal(np.array(samples, np.float32), expected)
    there_s = frames["time_ns"] / 1e9 - AHEAD_S
    uncertainty_s = 1e-3 * summary["link"]["clock"]["uncertainty_ms"]
    assert np.abs(np.array(stamps_s) - there_s).max() < 0.05 + uncertainty_s


def test_events_arrive_as_markers_and_the_session_is_named(run):
    received, session, summary = run
    markers, stamps_s, _ = received["bench-events"]
    texts = [json.loads(marker) for (marker,) in markers]
    assert "follower connected" in " ".join(text["event"] for text in texts)
    assert summary["lsl"]["events"] >= len(markers)
    recorded = [event["event"] for event in session.events]
    assert {text["event"] for text in texts} <= set(recorded)
    assert stamps_s == sorted(stamps_s)
    (compared,) = [event for event in session.events if "lsl_clock_ahead_ns" in event]
    assert abs(compared["lsl_clock_ahead_ns"]) < 1_000_000_000, "on Linux it is the same clock"
    described = ET.fromstring(received["bench-frames"][2])
    assert described.findtext("type") == "Haptics"
    assert described.findtext("desc/synchronization/can_drop_samples") == "true"
    assert described.findtext("desc/session_id") == session.session_id
