"""Orders of the monitor's page about the surface under the tool."""

import json
from types import SimpleNamespace
from typing import Any, cast

import pytest
from monitor_messages import unpack

from mmt.core.errors import InputError
from mmt.leader.modelling.pipeline import Modelling
from mmt.leader.modelling.process import ModellingProcess
from mmt.leader.monitoring.controls import Controls
from mmt.leader.part import Session
from mmt.scene import Scene
from mmt.texture.online.updates import SurfaceChange, surface_statements
from mmt.texture.settings import ModellingSettings, SurfaceSettings


async def ordered(surface, surfaces):
    said = []
    session, nothing = Session(Scene()), cast("Any", None)
    if surfaces is not None:
        now, known = surfaces
        session.log.surfaces = cast("Any", SimpleNamespace(current=now, entries=set(known)))
    modelling = SimpleNamespace(state_surface=said.append)
    order = json.dumps({"id": 1, "do": "surface", "surface": surface})
    _, answer = await Controls(session, nothing, nothing, modelling).answer(order)
    message = unpack(answer)
    return message["ok"], message["text"], said


@pytest.mark.parametrize(
    ("surface", "sentence", "told"),
    [(1, "surface 1 again", [1]), (4, "surface 4 it is", []), (None, "a new surface, 6", [6])],
)
async def test_a_person_names_the_surface(surface, sentence, told):
    assert await ordered(surface, (4, [1, 4, 5])) == (True, sentence, told)


async def test_what_is_no_known_surface_is_refused():
    for surface in (0, 2, "1", 1.5, [1], True, -1):
        good, sentence, told = await ordered(surface, (4, [4, 5]))
        assert (good, told) == (False, [])
        assert "known are 4, 5" in sentence
    good, sentence, told = await ordered(1, None)
    assert (good, told) == (False, [])
    assert "tells no surfaces apart" in sentence


async def test_a_scene_with_one_surface_takes_no_word():
    session = Session(Scene())
    modelling = Modelling(session, ModellingProcess(ModellingSettings(), 1.0))
    with pytest.raises(InputError, match=r"no \[texture\.surfaces\]"):
        modelling.state_surface(1)
    modelling.close()
    settings = ModellingSettings(surfaces=SurfaceSettings())
    several = Modelling(session, ModellingProcess(settings, 1.0))
    several.state_surface(1)
    several.close()


@pytest.mark.parametrize(
    "event",
    [
        {"event": "mark"},
        {"kind": "recalled", "surface": 1, "at_sample": 5, "evidence": 12.0},
        {"kind": "recalled", "surface": 0, "at_sample": 5, "evidence": None},
        {"kind": "recalled", "surface": 1, "at_sample": -5, "evidence": None},
        {"kind": "recalled", "surface": "1", "at_sample": 5, "evidence": None},
        {"kind": "recalled", "surface": 1, "evidence": None},
    ],
)
def test_events_that_are_no_persons_word_are_none(event):
    change = SurfaceChange("recalled", 2, 1, 7, 9)
    word = {"surface": change.surface, "at_sample": change.at_sample, "evidence": change.evidence}
    assert surface_statements([event, word]) == surface_statements([word])
    assert len(surface_statements([word])) == 1
