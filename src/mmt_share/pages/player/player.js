// The texture player's page.

import { Grid } from "./grid.js";
import { Link } from "./link.js";
import { say } from "./orders.js";
import { Pointer } from "./pointer.js";
import { OPENING, Sound } from "./sound.js";
import { Study } from "./study.js";

const MM_PER_PX = 25.4 / 96;
const BAR_MM = 50;
const SHOW_EVERY_MS = 250;

const $ = (id) => document.getElementById(id);
const text = (id, value) => { const node = $(id); if (node.textContent !== value) node.textContent = value; };
const ms = (value) => (value === null || value === undefined ? "–" : value.toFixed(1));

let fullScale = 30;
let mmPerPx = Number(localStorage.getItem("mmt-mm-per-px")) || MM_PER_PX;
let rests = false;
let shownAt = 0;
let level = { square: 0, counted: 0 };

const settings = () => ({ mmPerPx, force: Number($("force").value), speed: Number($("speed").value) });

const link = new Link("player", (message) => take[message.kind]?.(message));
const grid = new Grid($("grid"), () => {});
const pointer = new Pointer(grid, settings);
const study = new Study(link, grid);
const sound = new Sound(link, () => pointer.read(), report);

const take = {
  ...sound.take,
  hello(message) {
    fullScale = message.full_scale_m_s2;
    sound.scale = 1 / fullScale;
    study.make(message.names, message.best);
    grid.make(message.names, message.arrays.pictures);
    fit();
    sound.open();
  },
  study(message) {
    study.show(message);
    fit(); // the panel above the grid has another height
  },
  answer: (message) => (message.id === OPENING ? say(`no sound: ${message.text}`, false) : study.orders.answered(message)),
  status(message) {
    const said = [];
    if (message.problem ?? message.recorded_s !== null) said.push(message.problem ?? `recorded ${message.recorded_s.toFixed(1)} s`);
    if (message.rows) said.push(`${message.rows} rows of results`);
    text("recording", said.join(", "));
  },
};

/** Show what is played and how late, a few times a second. */
function report({ rms, counted }) {
  level.square += rms * rms * counted;
  level.counted += counted;
  const now = performance.now();
  if (now - shownAt < SHOW_EVERY_MS) return;
  shownAt = now;
  const played = fullScale * Math.sqrt(level.square / level.counted);
  level = { square: 0, counted: 0 };
  $("level").value = played;
  text("level-text", `${played.toFixed(2)} m/s²`);
  text("force-name", pointer.presses ? "Force at full pressure" : "Force");
  const { total, trip, ahead, conversion, output, by } = sound.figures();
  $("latency").dataset.by = by;
  const worklet = by === "script" ? " (no worklet: open by https)" : "";
  text("latency", `pointer to sound ${ms(total)} ms; now ahead ${ms(ahead)}, round trip ${ms(trip)}, conversion ${ms(conversion)}, output ${ms(output)}${worklet}`);
}

async function toggleSound() {
  const wanted = !sound.running;
  $("start").setAttribute("aria-pressed", String(wanted));
  text("start", wanted ? "Stop sound" : "Start sound");
  try {
    await (wanted ? sound.start() : sound.stop());
  } catch (error) {
    say(`no sound: ${error.message}`, false);
  }
}

/** Let the grid fill the screen below the controls. */
function fit() {
  const count = grid.tiles.length || 1;
  const columns = Math.ceil(Math.sqrt(count));
  const rows = Math.ceil(count / columns);
  const room = Math.max(innerHeight - $("grid").getBoundingClientRect().top - scrollY - 90, rows * 120);
  $("grid").style.setProperty("--columns", innerWidth <= 620 ? Math.min(2, columns) : columns);
  $("grid").style.setProperty("--tile", `${Math.min(room / rows - 10, 420)}px`);
  grid.moved();
}

function setScale(px) {
  mmPerPx = BAR_MM / px;
  $("scale-bar").style.width = `${px}px`;
}

function key(event) {
  const typing = event.target.closest("input:not([type=range]), select, summary");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  const onTile = grid.focused() !== null;
  if (event.key === "+" || event.key === "-") {
    event.key === "+" ? $("force").stepUp() : $("force").stepDown();
    showSettings();
  } else if (event.key === " " && event.target.tagName !== "BUTTON") {
    toggleSound();
  } else if (event.key === "Enter" && onTile) {
    study.match();
  } else if (/^[1-9]$/.test(event.key)) {
    if (!study.rate(Number(event.key))) return;
  } else if (/^[a-z]$/.test(event.key)) {
    grid.focus(event.key.charCodeAt(0) - 97);
  } else {
    return;
  }
  event.preventDefault();
}

function showSettings() {
  text("force-text", `${Number($("force").value).toFixed(1)} N`);
  text("speed-text", `${$("speed").value} mm/s`);
}

$("start").onclick = toggleSound;
$("volume").oninput = () => sound.setVolume(Number($("volume").value) / 100);
$("force").oninput = $("speed").oninput = showSettings;
$("scale").value = BAR_MM / mmPerPx;
$("scale").oninput = () => {
  setScale(Number($("scale").value));
  localStorage.setItem("mmt-mm-per-px", String(mmPerPx));
};
setScale(BAR_MM / mmPerPx);
sound.setVolume(Number($("volume").value) / 100); // browsers keep what a person had set
showSettings();
addEventListener("keydown", key);
addEventListener("resize", fit);
document.addEventListener("visibilitychange", () => {
  if (document.hidden) pointer.lift();
  if (document.hidden ? sound.running : rests) {
    rests = document.hidden;
    toggleSound();
  }
});
