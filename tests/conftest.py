"""What holds for every test: how the suite is spread over processes, and what is put back."""

import gc
import os
import random
import re
import signal
import socket
import sys
from contextlib import suppress

import pytest
from driver_fixtures import closing, connected, started  # noqa: F401 - fixtures
from hypothesis import HealthCheck, Phase, settings
from stroked_sessions import make_session, stroked_session  # noqa: F401 - fixtures

import mmt.cli  # noqa: F401 - before NumPy: linear algebra in one thread, as the programs have it
from mmt.core.output.streams import finish_output
from mmt.core.running.process import ask_for_short_turns

SLOW = (
    "test_first_start.py", "test_phantom_lab.py", "test_service_interruption.py",
    "test_stability_services.py", "test_papers.py", "test_core_alone.py",
    "test_sharing_services.py", "test_hubs.py", "test_service_soak.py",
    "test_demo_shared.py", "test_lean_scenes.py", "test_lean_installs.py", "test_monitor_page.py",
    "test_player_page.py", "test_firefox.py", "test_site.py", "test_report_pages.py",
    "test_backfill.py", "test_stalled_readers.py", "test_interrupted_connecting.py",
    "test_selection_evaluation.py", "test_service_namespaces.py", "test_surface_evaluation.py",
    "test_device_bench.py", "test_compare_generators.py", "test_sweep.py", "test_fuzz_leader.py",
    "test_fuzz_follower.py", "test_full_disk.py",
)  # fmt: skip
"""Files that only `scripts/test --all` runs: soak, installations, faults, browsers, evaluations.

They begin, the slowest first: at the end, they would keep one process alone.
"""
LONG = (
    "test_lattice.py", "test_lsl_services.py", "test_model_difference.py", "test_motion_limit.py",
    "test_resampled_models.py", "test_selection.py", "test_selection_outliers.py",
    "test_surface_detection.py", "test_tool_turning.py", "test_validity.py",
)  # fmt: skip
"""Files that take four seconds and more: `scripts/test --fast` leaves them out."""
LIVE = re.compile(
    r"^(?:from|import) (?:aiohttp|asyncio|h5py|(?:link|sharing|hub|player)_samples|multiprocessing"
    r"|nbclient|openpyxl|playwright|pyarrow|rosbags|runpy|running_source|sensor_reading|sketches"
    r"|socket|socketio|stroked_sessions|subprocess|threading|time|waiting"
    r"|\w+_(?:browser|processes|programs?|runs)|mmt\.(?:evaluation|testing)|mmt_lab)\b"
    r"|\b(?:make|stroked)_session\b|importorskip",
    re.MULTILINE,
)
"""What a file of tests uses that needs real time, a child, a socket, a browser, an emulated device,
a simulated session or another program's files: `scripts/test --fast` leaves it out."""

# ignored in the background of a shell without job control, or under nohup: processes that the tests
# start would inherit it, and could not be interrupted
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
HANDLERS = {number: signal.getsignal(number) for number in signal.valid_signals()}

SWITCH_INTERVAL_S = sys.getswitchinterval()

# how long an example takes says more of the machine's load than of the example
settings.register_profile("mmt", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# where a change is judged: the same examples before and after it, and none made smaller
settings.register_profile(
    "repeatable",
    settings.get_profile("mmt"),
    derandomize=True,
    phases=(Phase.explicit, Phase.generate),
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "mmt"))


def pytest_addoption(parser):
    parser.addoption("--lane", choices=("fast", "usual", "all"), default="all", help="files to run")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config):
    """Run three processes for two cores: a third of its time, a test waits for a clock."""
    cores = os.cpu_count() or 1
    return min(cores if config.getoption("lane") == "fast" else 3 * cores // 2, 8)


def pytest_ignore_collect(collection_path, config):
    """Leave out the files of slower lanes before they are read: that takes a fifth of a minute."""
    lane = config.getoption("lane")
    if lane == "all" or not collection_path.name.startswith("test_"):
        return None
    slow = collection_path.name in (SLOW + LONG if lane == "fast" else SLOW)
    if lane == "fast" and not slow:
        slow = LIVE.search(collection_path.read_text("utf-8")) is not None
    return slow or None


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Keep what is imported and collected from the collector, which would go through it anew.

    It stays until the end: half a million objects, a fifth of a second each time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _heap_that_is_collected():
    """Let no service freeze what its test made: that would last for the tests that follow.

    To thaw it afterwards would thaw what was collected, too.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gc, "freeze", lambda: None)
        yield


def pytest_collection_modifyitems(config, items):
    """Begin with what takes longest, in every process alike."""
    if hasattr(config, "workerinput"):
        places = {name: place for place, name in enumerate(SLOW)}
        items.sort(key=lambda item: places.get(item.path.name, len(places)))


@pytest.fixture
def unused_tcp_port():
    """A port that the system does not give away meanwhile, to another process of the tests."""
    while True:
        port = random.randrange(20_000, 32_000)  # below those that port 0 stands for
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


@pytest.fixture(scope="module")
def read_here():
    """Read files of foreign formats in this process: each child takes a second to start."""
    from mmt.session.importing.reading_child import reads_here

    reads_here.set()
    yield
    reads_here.clear()


@pytest.fixture(autouse=True)
def _ordinary_process():
    """Put back what a service asks of its process: it would last, and children would inherit it."""
    yield
    finish_output()
    os.environ.pop("PYTHONSAFEPATH", None)
    for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGINT)):
        if signal.getsignal(number) != HANDLERS[number]:
            signal.signal(number, HANDLERS[number])
    if sys.getswitchinterval() != SWITCH_INTERVAL_S:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        ask_for_short_turns(0)
