"""Health and metrics, of services that run."""

import asyncio
import time

import aiohttp
import pytest
from frame_samples import PERIOD_NS, made_frames
from prometheus_client.parser import text_string_to_metric_families
from service_runs import MadeSource, Together, endless, small_scene

from mmt.link.access import TOKEN_VARIABLE

TOKEN = "a token that nobody guesses"


@pytest.fixture
async def http():
    async with aiohttp.ClientSession() as session:
        yield session


async def health_of(http, port, **headers):
    async with http.get(f"http://127.0.0.1:{port}/health", headers=headers) as answer:
        return answer.status, await answer.json()


async def metrics_of(http, port, **headers):
    """Return every sample by its name and labels."""
    async with http.get(f"http://127.0.0.1:{port}/metrics", headers=headers) as answer:
        assert answer.status == 200
        assert answer.headers["Content-Type"].startswith("text/plain; version=")
        text = await answer.text()
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


async def test_health_follows_the_session(tmp_path, http):
    together = await Together.listening(small_scene(tmp_path))
    port = together.leader.port
    status, table = await health_of(http, port)
    assert status == 200
    assert table == {
        "ok": True,
        "phase": "waiting",
        "connected": False,
        "session": together.leader.log.session_id,
        "time_s": 0,
        "mode": "streamed",
        "faults": [],
    }
    follower = together.follower(endless())
    following = asyncio.create_task(follower.run())
    await together.until(lambda: together.leader.time_s > 0.05)
    status, table = await health_of(http, port)
    assert (status, table["phase"], table["connected"]) == (200, "streaming", True)
    assert table["time_s"] > 0
    await follower.client.disconnect()
    await together.until(together.leader.health.faults)
    status, table = await health_of(http, port)
    assert (status, table["ok"], table["faults"]) == (503, False, ["follower lost"])
    follower.stop()
    await following
    await together.stop()


async def test_metrics_are_what_the_summary_counts(tmp_path, http, unused_tcp_port):
    scene = small_scene(tmp_path, metrics={"follower_port": unused_tcp_port})
    together = await Together.listening(scene)
    source = endless()
    gap, broken = made_frames(10, 1), made_frames(11, 1)
    broken["force_n"] = float("nan")
    source.blocks[3:12] = [gap, broken]
    following = asyncio.create_task(together.follow(source))
    await together.until(lambda: together.leader.time_s > 0.2)
    up = await metrics_of(http, together.leader.port)
    down = await metrics_of(http, unused_tcp_port)
    leader, follower = await together.stop(), await following
    identity = leader.session["id"]
    for figures, service in ((up, "leader"), (down, "follower")):
        (labels,) = [dict(key[1]) for key in figures if key[0] == "mmt_session_info"]
        assert (labels["id"], labels["service"]) == (identity, service)
        assert figures["process_resident_memory_bytes", ()] > 1e6
        assert figures["process_cpu_seconds_total", ()] > 0
        assert figures["mmt_connected", ()] == 1
        assert figures["mmt_ticks_total", ()] > 0
        ticks = figures["mmt_tick_period_seconds_count", ()]
        assert figures["mmt_tick_period_seconds_bucket", (("le", "+Inf"),)] == ticks
        assert figures["mmt_latency_seconds_count", ()] > 0
    assert 0 < up["mmt_frames_total", ()] <= leader.link["frames"]
    assert up["mmt_lost_total", ()] == leader.link["lost"] == 7
    assert up["mmt_rejected_total", (("reason", "not finite"),)] == 1
    missing = up["mmt_missing_frames_total", ()]
    assert missing == 8
    assert up["mmt_unfilled_frames", ()] + up["mmt_awaited_frames", ()] == missing
    assert up["mmt_filled_frames_total", ()] == 0
    assert down["mmt_backfilled_frames_total", ()] <= 1  # the broken one, broken again
    assert down["mmt_implausible_commands_total", ()] == 0
    assert down["mmt_stale_commands_total", ()] > 0  # made frames have no true time
    assert up["mmt_vibration_mode", (("mode", "streamed"),)] == 1
    assert up["mmt_vibration_mode", (("mode", "synthesized"),)] == 0
    assert up["mmt_playout_delay_seconds", ()] > 0
    assert 0 < up["mmt_session_time_seconds", ()] <= leader.session["duration_s"]
    assert 0 < down["mmt_commands_total", ()] <= follower.link["commands"]
    assert "mmt_model_samples" not in {name for name, _ in up}  # the scene has no [texture]


async def test_the_model_is_in_the_metrics(tmp_path, http):
    scene = small_scene(tmp_path, metrics={}, texture={}, rendering={})
    together = await Together.listening(scene)
    for seconds in (0.25, 0.5):
        together.leader.log.update_times.add(round(1e9 * seconds))
    figures = await metrics_of(http, together.leader.port)
    assert figures["mmt_model_samples", ()] == 0
    assert figures["mmt_model_updates_total", ()] == 2
    assert figures["mmt_model_update_seconds_total", ()] == pytest.approx(0.75, rel=0.01)
    for task in ("segmenting", "fitting", "synthesizing", "completing"):
        for name in ("queue_items", "queue_most_items", "median_seconds", "items_total"):
            assert figures[f"mmt_task_{name}", (("task", task),)] == 0
    await together.stop()


async def test_without_their_tables_there_are_no_metrics_and_no_monitor(tmp_path, http):
    together = await Together.listening(small_scene(tmp_path))
    assert together.leader.parts.monitor is None
    for page in ("metrics", "monitor/"):
        async with http.get(f"http://127.0.0.1:{together.leader.port}/{page}") as answer:
            assert answer.status == 404
    await together.stop()


async def test_a_stranger_learns_but_whether_all_is_well(tmp_path, http, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, TOKEN)
    together = await Together.listening(small_scene(tmp_path, metrics={}))
    port = together.leader.port
    assert await health_of(http, port) == (200, {"ok": True})
    async with http.get(f"http://127.0.0.1:{port}/metrics") as answer:
        assert answer.status == 401
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    assert (await health_of(http, port, **bearer))[1]["phase"] == "waiting"
    assert ("mmt_connected", ()) in await metrics_of(http, port, **bearer)
    await together.stop()


async def test_a_follower_port_that_is_taken_is_explained(tmp_path):
    taken = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
    port = taken.sockets[0].getsockname()[1]
    together = await Together.listening(small_scene(tmp_path, metrics={"follower_port": port}))
    with pytest.raises(Exception, match=r"set follower_port of \[metrics\] to"):
        await together.follow(MadeSource([]))
    await together.stop()
    taken.close()
    await taken.wait_closed()


async def test_a_follower_that_is_too_slow_is_named_at_once_and_at_health(tmp_path, http):
    together = await Together.listening(small_scene(tmp_path))
    client = await together.client()
    started_s, number = time.monotonic(), 0
    while number < 2600 and not any("promised" in sentence for sentence in together.said):
        frame = made_frames(number, 1)
        frame["time_ns"] = number * 2 * PERIOD_NS
        client.send_frames(frame)
        number += 1
        await asyncio.sleep(max(0.0, started_s + number / 500 - time.monotonic()))
    (sentence,) = [sentence for sentence in together.said if "promised" in sentence]
    assert sentence.startswith("the follower promised 1000 frames a second and sends 500:")
    status, table = await health_of(http, together.leader.port)
    assert (status, table["faults"]) == (503, [sentence])
    await client.end("done")
    await client.disconnect()
    await together.end()
