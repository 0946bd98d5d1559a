"""A package that offers something by entry points, installed by its files alone."""


def install_package(folder, monkeypatch, name, entries, version="1.0"):
    """Make entry points (group, then name to target) as if a package had been installed."""
    information = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    information.mkdir()
    about = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    (information / "METADATA").write_text(about, encoding="utf-8")
    lines = []
    for group, targets in entries.items():
        lines += [f"[{group}]", *(f"{key} = {value}" for key, value in targets.items())]
    (information / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.syspath_prepend(str(folder))
