"""What the leader makes of updates on several surfaces: what is rendered, noted and recorded."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from model_updates import made_update

from mmt.core.errors import InputError
from mmt.core.files.existing import replacing
from mmt.leader.output.model_output import ModelOutput
from mmt.leader.output.synthesis import SynthesizingPart
from mmt.leader.output.vibration import VibrationSwitch
from mmt.leader.part import Part, Session
from mmt.leader.recording import RecordingPart
from mmt.leader.surface_log import write_surface_models
from mmt.scene import Scene
from mmt.texture.online.updates import SurfaceChange

FADE = 50


class Model:
    """Sounds like a number."""

    def __init__(self, level):
        self.level = level
        self.samples = [level] * 9

    def to_bytes(self):
        return str(self.level).encode()

    def save(self, path):
        with replacing(path) as part:
            part.write_bytes(self.to_bytes())


class Sounding:
    """Stands for the crossfading synthesizers; notes when it is told to fade."""

    directed = False

    def __init__(self):
        self.model = None
        self.crossed = []

    def cross_to(self, model):
        self.crossed.append(model.level)
        self.model = model

    def render(self, *inputs):
        return np.full(len(inputs[0]), 0.0 if self.model is None else self.model.level)


class Recorder:
    path = Path("session.mcap")

    def __init__(self):
        self.models = []
        self.events = []

    def attach_model(self, pack, time_s):
        self.models.append((pack().decode(), time_s))

    def record_event(self, event):
        self.events.append(event)


class Leader:
    """The models' use with parts that a test looks at."""

    def __init__(self):
        self.sounding, self.recorder = Sounding(), Recorder()
        sounding = self.sounding
        self.known = {}
        self.modelling = modelling = SimpleNamespace(
            models=lambda: self.known, reset=self.known.clear, since_s=0.0
        )
        self.session = Session(Scene())
        self.session.journal.event = self._say
        self.log = self.session.log
        self.recording = RecordingPart(self.session)
        self.recording.recorder = self.recorder
        self.switch = VibrationSwitch(lambda _: (-1.0,), sounding, crossfade_samples=FADE)
        vibration = SimpleNamespace(switch=self.switch, response=lambda: None)
        rendering = SynthesizingPart(sounding, sounding)
        self.said = []
        self.details = []
        self.use = ModelOutput(self.session, self.recording, modelling, rendering, None, vibration)

    def _say(self, sentence, **details):
        self.said.append(sentence)
        self.details.append(details)

    def heard(self):
        """Play until every fade is over; return what is heard then."""
        return float(self.switch.render(0, np.ones(4 * FADE), np.ones(4 * FADE))[-1])

    def update(self, time_s, surface, level, *, started=False, stopped=False, changes=(), left=()):
        model = None if level is None else Model(level)
        if level is not None:
            self.known[surface] = model
        more = {"started": started, "stopped": stopped, "changes": changes, "left": left}
        self.use.update(made_update(time_s, surface=surface, model=model, **more), 0.01)

    def recall(self):
        """Let the tool come from surface 2 back onto surface 1, whose model is complete."""
        changes = (change("recalled", 2, 1, 15_000),)
        left = (made_update(15.0, surface=2, model=Model(22.0), started=True),)
        self.update(15.3, 1, 12.0, started=True, stopped=True, changes=changes, left=left)


def change(kind, before, surface, from_sample):
    return SurfaceChange(kind, before, surface, from_sample, from_sample + 300, 15.0)


@pytest.fixture
def leader():
    """Surface 1 is rendered, complete; then the tool comes onto surface 2."""
    made = Leader()
    made.update(1.0, 1, 10.0)
    assert made.heard() == -1.0
    made.update(4.0, 1, 11.0, started=True)
    assert made.heard() == 11.0
    made.update(8.0, 1, 12.0, started=True, stopped=True)
    left = (made_update(9.0, surface=1, model=made.known[1], started=True, stopped=True),)
    made.update(9.3, 2, None, changes=(change("new", 1, 2, 9000),), left=left)
    assert made.heard() == -1.0
    return made


def test_on_a_new_surface_the_stream_is_heard_until_its_own_model_is_ready(leader):
    assert leader.heard() == -1.0
    assert (leader.log.start_s, leader.log.stop_s) == (None, None)
    leader.update(10.3, 2, 20.0)
    assert leader.heard() == -1.0
    leader.update(13.3, 2, 21.0, started=True)
    assert leader.heard() == 21.0
    assert leader.log.start_s == 13.3
    assert leader.sounding.crossed == []  # from the stream: the switch's fade


def test_every_part_gets_each_update_with_its_session_time_also_after_a_reset(leader):
    got = []
    part = Part()
    part.on_update = lambda update, seconds: got.append((update.time_s, seconds))
    leader.session.parts.add(part)
    leader.update(13.3, 2, 21.0, started=True)
    leader.use.played_share = 0.4
    leader.use.reset()  # which forgets all
    leader.modelling.since_s = 15.0
    assert leader.use.played_share is None
    assert leader.log.surfaces is None
    assert leader.heard() == -1.0
    with pytest.raises(InputError, match="no model yet"):
        leader.use.force("synthesized")
    leader.update(1.0, 1, 10.0)
    assert got == [(13.3, 0.01), (16.0, 0.01)]
    assert leader.log.surfaces.known == 1
    assert leader.log.surfaces.entry.stays == [(15.0, None)]
    assert leader.log.update.time_s == 16.0


def test_a_known_surface_is_rendered_at_once_and_the_summary_has_every_stay(leader):
    leader.update(13.3, 2, 21.0, started=True)
    leader.heard()
    leader.recall()
    assert leader.sounding.crossed == [12.0]
    assert leader.heard() == 12.0
    assert (leader.log.start_s, leader.log.stop_s) == (4.0, 8.0)
    assert leader.said[-1] == "surface 1 again, from 15.00 s on"
    assert sum(s.startswith("start criterion") for s in leader.said) == 2
    assert sum(s.startswith("stop criterion") for s in leader.said) == 1
    table = leader.log.surfaces.as_dict(18.0)
    assert (table["now"], table["known"]) == (1, 2)
    assert table["1"]["stays"] == [{"from_s": 0.0, "to_s": 9.0}, {"from_s": 15.0, "to_s": 18.0}]
    assert table["2"]["stays"] == [{"from_s": 9.0, "to_s": 15.0}]
    assert (table["1"]["start_s"], table["1"]["stop_s"]) == (4.0, 8.0)
    assert (table["2"]["start_s"], table["2"]["stop_s"]) == (13.3, None)
    assert [(c["kind"], c["surface"], c["from_s"], c["found_s"]) for c in table["changes"]] == [
        ("new", 2, 9.0, 9.3),
        ("recalled", 1, 15.0, 15.3),
    ]
    assert leader.details[-1]["from_s"] == 15.0


def test_a_criterion_that_is_taken_back_is_met_again_later(leader):
    """What had met it was of another surface."""
    made = Leader()
    made.update(4.0, 1, 11.0, started=True)
    made.update(
        4.4,
        2,
        None,
        changes=(change("new", 1, 2, 3500),),
        left=(made_update(3.5, surface=1, model=Model(9.0)),),
    )
    made.update(
        6.4,
        1,
        9.0,
        changes=(change("recalled", 2, 1, 6000),),
        left=(made_update(6.0, surface=2, model=None),),
    )
    assert made.heard() == -1.0
    made.update(8.4, 1, 12.0, started=True)
    assert made.log.start_s == 8.4
    assert made.heard() == 12.0


def test_held_vibration_stays_held_over_a_change_to_a_known_surface(leader):
    leader.use.force("streamed")
    changes, left = (change("identified", 2, 1, 9000),), (made_update(12.0, surface=2, model=None),)
    leader.update(12.3, 1, 12.0, started=True, changes=changes, left=left)
    assert leader.heard() == -1.0
    leader.use.force(None)
    assert leader.sounding.crossed == []  # by the fade of the switch
    assert leader.heard() == 12.0
    assert leader.log.surfaces.known == 1
    assert leader.log.surfaces.entries[1].stays == [(0.0, 9.0), (9.0, None)]
    assert leader.said[-1] == "surface 2 is surface 1, from 9.00 s on"


def test_every_models_last_state_is_recorded_once(leader):
    recorder = leader.recorder
    assert recorder.models == [("11.0", 4.0), ("12.0", 9.0)]
    leader.update(13.3, 2, 21.0)
    leader.use.record_last()
    leader.use.record_last()
    assert recorder.models[2:] == [("21.0", 13.3)]
    assert [(e["surface"], e["time_s"]) for e in recorder.events] == [(1, 4.0), (1, 9.0), (2, 13.3)]
    later = Recorder()  # a recording that begins later has them all
    leader.recording.recorder = later
    leader.use.record_last()
    assert sorted(data for data, _ in later.models) == ["12.0", "21.0"]


def test_model_files_stand_beside_the_recording_and_older_ones_go(tmp_path):
    recording = tmp_path / "session.mcap"
    others = [tmp_path / "session-surface-x.npz", tmp_path / "my-session-surface-1.npz"]
    for path in (tmp_path / "session-surface-7.npz", *others):
        path.write_bytes(b"")
    models = {1: Model(12.0), 2: Model(21.0)}
    assert write_surface_models(recording, models) == []
    own = {tmp_path / f"session-surface-{number}.npz" for number in models}
    assert set(tmp_path.iterdir()) == own | set(others)
    assert (tmp_path / "session-surface-2.npz").read_bytes() == b"21.0"
    (problem, _) = write_surface_models(tmp_path / "gone" / "session.mcap", models)
    assert "model of surface 1" in problem


def test_a_reset_of_a_scene_without_a_texture_says_so():
    told = []
    ModelOutput(Session(Scene(), told.append)).reset()
    assert told == ["no model is reset: this scene has no [texture]"]
