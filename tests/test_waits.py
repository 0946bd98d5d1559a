"""No test waits for ever for a process or a thread."""

import ast
from pathlib import Path

WAITS = {"wait", "join", "communicate"}
RUNS = {"run", "call", "check_call", "check_output"}


def unbounded(tree):
    """Waits without a bound; coroutines, which are awaited or given to asyncio, are none."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    coroutines = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Await)}
    for call in calls:
        if ast.unparse(call.func).startswith("asyncio."):
            coroutines |= {id(argument) for argument in call.args}
    for call in calls:
        if not isinstance(call.func, ast.Attribute) or id(call) in coroutines:
            continue
        bounded = {keyword.arg for keyword in call.keywords} & {"timeout", None}
        runs = ast.unparse(call.func.value) == "subprocess" and call.func.attr in RUNS
        if not bounded and (runs or (call.func.attr in WAITS and not call.args)):
            yield call


def test_every_wait_for_a_process_or_a_thread_has_a_bound():
    here = Path(__file__).parent
    found = [
        f"{file.relative_to(here)}:{call.lineno}: {ast.unparse(call)[:60]}"
        for file in sorted(here.rglob("*.py"))
        for call in unbounded(ast.parse(file.read_text(encoding="utf-8")))
    ]
    assert not found


def test_a_wait_without_a_bound_is_found():
    for text, expected in (
        ("process.wait()", 1),
        ("process.wait(3)", 0),
        ("thread.join(timeout=3)", 0),
        ("subprocess.run(['a'])", 1),
        ("subprocess.run(['a'], timeout=3)", 0),
        ("asyncio.create_task(event.wait())", 0),
        ("async def f():\n    await event.wait()", 0),
    ):
        assert len(list(unbounded(ast.parse(text)))) == expected, text
