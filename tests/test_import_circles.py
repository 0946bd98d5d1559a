"""No two modules import each other, not even late; all can be imported on every system."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src"


def module_name(path: Path) -> str:
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path, modules: set[str]) -> set[str]:
    """Return the modules of this project that a file imports anywhere, by whatever condition."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            inside = {f"{node.module}.{name.name}" for name in node.names}
            found |= (inside & modules) or {node.module}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return (found & modules) - {module_name(path)}


def test_imports_form_no_circle() -> None:
    paths = {module_name(path): path for path in SOURCE.rglob("*.py")}
    graph = {name: imports(path, set(paths)) for name, path in paths.items()}
    assert len(graph) > 100
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the modules


def test_no_module_needs_what_only_some_systems_have() -> None:
    lacking_on_windows = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
    found = [
        (module_name(path), name.name)
        for path in SOURCE.rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Import)
        for name in node.names
        if name.name in lacking_on_windows
    ]
    assert found == []
