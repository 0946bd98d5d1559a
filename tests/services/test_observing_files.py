"""The dashboard, the alert rules and the layout against what a run gives."""

import asyncio
import json
import re
import shutil
import subprocess
from pathlib import Path

import aiohttp
import pytest
from emulated_arm import emulated_arm  # noqa: F401 - a fixture
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from service_runs import Together, small_scene

OBSERVING = Path(__file__).parents[2] / "configs" / "observing"
ALERTS = OBSERVING / "alerts.yaml"


def queries():
    dashboard = json.loads((OBSERVING / "grafana.json").read_text(encoding="utf-8"))
    return [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]


async def names_of(http, port):
    """Return the names of samples, asked for as Prometheus asks, by a strict reader."""
    accept = {"Accept": "application/openmetrics-text;version=1.0.0;q=0.75,text/plain;q=0.5"}
    async with http.get(f"http://127.0.0.1:{port}/metrics", headers=accept) as answer:
        assert answer.headers["Content-Type"].startswith("application/openmetrics-text; version=1")
        families = list(text_string_to_metric_families(await answer.text()))
    counters = {f"{family.name}_total" for family in families if family.type == "counter"}
    return counters | {sample.name for family in families for sample in family.samples}


async def test_what_is_asked_for_is_what_a_run_gives(tmp_path, unused_tcp_port):
    sound = "mmt.testing.emulated.haptuator:EmulatedHaptuator"
    together = await Together.listening(
        small_scene(
            tmp_path,
            metrics={"follower_port": unused_tcp_port},
            texture={},
            rendering={},
            actuator={"driver": sound, "volts_per_m_s2": 0.05, "full_scale_v": 3.0},
        )
    )
    following = asyncio.create_task(together.follow())
    await together.until(lambda: together.leader.log.update)
    async with aiohttp.ClientSession() as http:
        served = await names_of(http, together.leader.port) | await names_of(http, unused_tcp_port)
    await together.stop()
    await following
    asked = set(re.findall(r"\b(?:mmt|process)_\w+", f"{queries()} {ALERTS.read_text()}"))
    assert len(asked) > 20
    assert asked - served == {"mmt_handle_lost"}  # the scene has a simulated hand
    assert topics_of_the_layout() <= fields_of(tmp_path / "session.mcap")


async def test_a_handle_says_whether_it_is_lost(tmp_path, emulated):
    handle = {"driver": "openhaptics", "library": emulated.address}
    together = await Together.listening(small_scene(tmp_path, metrics={}, hand=None, handle=handle))
    async with aiohttp.ClientSession() as http:
        assert "mmt_handle_lost" in await names_of(http, together.leader.port)
    await together.stop()


@pytest.mark.skipif(shutil.which("promtool") is None, reason="needs promtool, of prometheus")
def test_prometheus_takes_the_alerts_and_the_dashboards_queries(tmp_path):
    asked = [query.replace("$__rate_interval", "1m") for query in queries()]
    rules = [{"record": f"query_{number}", "expr": query} for number, query in enumerate(asked)]
    of_dashboard = tmp_path / "dashboard.json"  # which is YAML too
    of_dashboard.write_text(json.dumps({"groups": [{"name": "dashboard", "rules": rules}]}))
    command = ["promtool", "check", "rules", ALERTS, of_dashboard]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60.0)
    assert done.returncode == 0, done.stdout + done.stderr


def topics_of_the_layout():
    """Return the message paths that the layout's panels show, and the panels' topics."""
    layout = json.loads((OBSERVING / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    assert set(re.findall(r'"(\w+!\w+)"', json.dumps(layout["layout"]))) == set(panels)
    paths = {path["value"] for panel in panels.values() for path in panel.get("paths", ())}
    return paths | {panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel}


def fields_of(recording):
    """Return the topics of a recording, and the fields of each behind a dot."""
    with recording.open("rb") as stream:
        messages = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        return {
            name
            for _, channel, _, content in messages
            for name in (
                channel.topic,
                *(f"{channel.topic}.{f.name}" for f in content.DESCRIPTOR.fields),
            )
        }


def test_grafanas_own_library_knows_all_of_the_dashboard():
    models = pytest.importorskip("grafana_foundation_sdk.models.dashboard")
    encoder = pytest.importorskip("grafana_foundation_sdk.cog.encoder").JSONEncoder()
    given = json.loads((OBSERVING / "grafana.json").read_text(encoding="utf-8"))
    assert unread(given, json.loads(encoder.encode(models.Dashboard.from_json(given)))) == []
    assert given["annotations"] == {"list": []}, "its schema requires it"


def unread(given, read, place=""):
    """Return what of a document is not in what was read of it, by its place."""
    if isinstance(given, dict) and isinstance(read, dict):
        return [p for key in given for p in unread(given[key], read.get(key), f"{place}/{key}")]
    if isinstance(given, list) and isinstance(read, list) and len(given) == len(read):
        return [p for n, each in enumerate(given) for p in unread(each, read[n], f"{place}/{n}")]
    return [] if given == read else [place]
