"""The services over paths that lose packets, measured."""

import os

from mmt_lab.bench import lossy_path


def test_loss_stalls_what_is_sent_again(monkeypatch):
    monkeypatch.setattr(lossy_path, "LOSSES", (0.03,))
    found = lossy_path.measure_losses(1.5)
    rows = {records.name: dict(records.rows[0]) for records in found.records}
    assert {"retransmitted", "datagrams"} <= set(rows)
    assert ("tcp" in rows) != bool(found.left_out)
    assert os.geteuid() == 0 or found.left_out
    for row in rows.values():
        for what in ("frames", "commands"):
            p50, p99, largest = (row[f"{what} {name} (ms)"] for name in ("p50", "p99", "max"))
            assert lossy_path.DELAY_MS < p50 <= p99 <= largest
    assert rows["retransmitted"]["frames max (ms)"] > 3 * lossy_path.DELAY_MS
