"""Orders of the monitor's page to give, refuse or take back control, which are not trusted."""

import pytest
from service_runs import small_scene

from mmt.core.errors import InputError
from mmt.leader.service import Leader
from mmt_share.parts.control import ControlPart
from mmt_share.tables import CONTROL_VARIABLE


@pytest.fixture
def control(tmp_path, monkeypatch):
    monkeypatch.setenv(CONTROL_VARIABLE, "0123456789abcdef")
    tables = {"texture": {}, "rendering": {}, "sharing": {"port": 0}, "control": {}}
    part = Leader(small_scene(tmp_path, **tables)).parts.get(ControlPart)
    assert part is not None
    return part.orders()["control"]


@pytest.mark.parametrize("decision", [None, 1, "gift", [], {}, ["give"]])
def test_a_decision_that_makes_no_sense_is_refused(control, decision):
    with pytest.raises(InputError, match="allowed are give, refuse, take back"):
        control({"decision": decision})


@pytest.mark.parametrize("who", [None, 1.0, "1", [1]])
def test_a_listener_is_named_by_its_number(control, who):
    with pytest.raises(InputError, match="who is the number of a listener"):
        control({"decision": "refuse", "who": who})
