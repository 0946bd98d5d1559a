// The table of those who listen to the shared model.

import { number, text } from "./panels.js";

const $ = (id) => document.getElementById(id);
const SILENT_S = 3; // who has said nothing for so long is not known to have anything

const KINDS = ["wholes", "changes", "states"];
const sum = (row, ending = "") => KINDS.reduce((total, kind) => total + row[`${kind}${ending}`], 0);

function cells(row) {
  const answers = row.answered_s !== null && row.answered_s < SILENT_S;
  const quantiles = row.lag_p50_ms === null ? "–" : `${row.lag_p50_ms.toFixed(0)}, ${row.lag_p99_ms.toFixed(0)}`;
  return [
    row.name || `listener ${row.id}`, number(row.listened_s, 0), answers ? number(row.lag_ms, 1) : "–", quantiles,
    number(row.number, 0), (sum(row, "_bytes") / 1000).toFixed(1), String(sum(row)), String(row.skipped),
  ];
}

/** Show who listens, since when, how far behind, and what they were sent; nothing without sharing. */
export function showListeners(figures) {
  $("listeners-panel").hidden = !figures;
  if (!figures) return;
  const { listeners = 0, joined = 0, rows = [] } = figures;
  const those = rows.length < listeners ? ` Shown are the ${rows.length} that are furthest behind.` : "";
  text("listeners-text", `${listeners} listening, ${joined} have joined.${those}`);
  $("listeners").replaceChildren(...rows.map((row) => {
    const line = document.createElement("tr");
    line.append(...cells(row).map((value, i) => {
      const cell = document.createElement(i ? "td" : "th");
      if (!i) cell.scope = "row";
      cell.textContent = value;
      return cell;
    }));
    return line;
  }));
}
