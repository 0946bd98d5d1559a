"""Write the targets of ``mmt bench --json`` into the docs; see ``scripts/measure_bench``."""

import json
import sys
from pathlib import Path
from typing import Any, Final

from write_measured import ROOT, Row, replace

BENCH: Final = ROOT / "docs" / "reference" / "bench.md"


def main() -> None:
    """Replace the table between the marks of the page."""
    stages: dict[str, Any] = {}
    for file in sys.argv[1:]:
        stages |= json.loads(Path(file).read_text(encoding="utf-8"))
    rows: list[Row] = []
    for name, stage in stages.items():
        for target in stage.get("targets", ()):
            met = {True: "", False: ", missed", None: ""}[target["met"]]
            found = "not measured" if target["measured"] is None else f"{target['measured']:.3g}"
            aim = f"{target['side']} {target['bound']:g}"
            rows.append((f"{name}: {target['what']} ({aim})", f"{found}{met}"))
    replace(BENCH, "measured", ("target", "measured"), rows)


if __name__ == "__main__":
    main()
