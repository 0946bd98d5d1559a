"""No two modules import each other, not even late; all can be imported on every system."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src"


def module_name(path):
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path, modules):
    """Return the modules of this project that a file imports anywhere, by whatever condition."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            inside = {f"{node.module}.{name.name}" for name in node.names}
            found |= (inside & modules) or {node.module}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
    return (found & modules) - {module_name(path)}


def test_imports_form_no_circle():
    paths = {module_name(path): path for path in SOURCE.rglob("*.py")}
    graph = {name: imports(path, set(paths)) for name, path in paths.items()}
    assert len(graph) > 100
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the modules


def test_no_module_needs_what_only_some_systems_have():
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


def test_other_packages_use_public_modules_of_the_core_only():
    listed = (SOURCE / "mmt" / "public_modules.txt").read_text(encoding="utf-8").splitlines()
    public = {line for line in listed if not line.startswith("#")}
    modules = {module_name(path) for path in SOURCE.rglob("*.py")}
    used = {
        (path.relative_to(SOURCE).parts[0], name)
        for path in SOURCE.glob("mmt_*/**/*.py")
        for name in imports(path, modules)
        if name.split(".")[0] == "mmt"
    }
    entries = {name: {name, *(f"{part}.*" for part in packages(name))} for _, name in used}
    assert len(entries) > 100
    assert [each for each in sorted(used) if not entries[each[1]] & public] == []
    assert public <= set().union(*entries.values()), "what no other package uses is not listed"
    assert [n for _, n in used if any(part.startswith("_") for part in n.split("."))] == []


def packages(name):
    """Return a module and the packages that it is in."""
    parts = name.split(".")
    return [".".join(parts[:end]) for end in range(1, len(parts) + 1)]
