"""Orders of the monitor's page to give, refuse or take back control, which are not trusted."""

import pytest
from service_runs import small_scene

from mmt.core.errors import InputError
from mmt.leader.service import Leader
from mmt_share.parts.control import ControlPart
from mmt_share.tables import CONTROL_VARIABLE


def test_orders_that_make_no_sense_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv(CONTROL_VARIABLE, "0123456789abcdef")
    tables = {"texture": {}, "rendering": {}, "sharing": {"port": 0}, "control": {}}
    part = Leader(small_scene(tmp_path, **tables)).parts.get(ControlPart)
    control = part.orders()["control"]
    for decision in (None, 1, "gift", [], {}, ["give"]):
        with pytest.raises(InputError, match="allowed are give, refuse, take back"):
            control({"decision": decision})
    for who in (None, 1.0, "1", [1]):
        with pytest.raises(InputError, match="who is the number of a listener"):
            control({"decision": "refuse", "who": who})
