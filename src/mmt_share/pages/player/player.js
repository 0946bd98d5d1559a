// The texture player's page: it renders by itself; its server sends models, and keeps recordings and answers.

import { Grid } from "./grid.js";
import { Link } from "./link.js";
import { Hand, ModelError, Sound, heldShare, parseModel, render } from "./mmt-texture.js";
import { say } from "./orders.js";
import { Study } from "./study.js";

const MM_PER_PX = 25.4 / 96;
const BAR_MM = 50;
const SHOW_EVERY_MS = 250;
const STEP_MS = 10;
const LONGEST_STEP_MS = 1000;
const STEPS = 10; // of a stroke in one message

const $ = (id) => document.getElementById(id);
const text = (id, value) => { const node = $(id); if (node.textContent !== value) node.textContent = value; };
const number = (id) => Number($(id).value);

let names = [];
let models = [];
let tile = null; // under the hand
let mmPerPx = Number(localStorage.getItem("mmt-mm-per-px")) || MM_PER_PX;
let records = false;
let movedAt = 0;
let steps = [];
let then = 0;
let shownAt = 0;
let level = { square: 0, counted: 0 };
let completion = ""; // how far a shared model is
let reach = null; // how far the leader's hand has been: least x, y, largest x, y

const grid = new Grid($("grid"));
const sound = new Sound(report, (state, sentence) => { if (state !== "waiting") say(sentence, state === "running"); });
const hand = new Hand($("grid"), () => ({ mmPerPx, force: number("force"), speed: number("speed") }), moved);
const link = new Link("player", (message) => take[message.kind]?.(message), connected);
const study = new Study(link, grid);

const take = {
  hello(message) {
    if (String(message.names) !== String(names)) models = [];
    ({ names, records } = message);
    if (!message.scenarios) $("settings").open = false;
    $("study").hidden = $("help").hidden = !message.scenarios;
    study.make(names, message.best);
    grid.make(names);
    captions();
    fit();
  },
  model({ texture, form, arrays }) {
    try {
      models[texture] = parseModel(form);
    } catch (error) {
      if (!(error instanceof ModelError)) throw error;
      say(`${names[texture]}: ${error.message}`, false);
      return;
    }
    grid.paint(texture, arrays.picture);
    captions();
  },
  study(message) {
    study.show(message);
    fit(); // the panel above the grid has another height
  },
  answer: (message) => study.orders.answered(message),
  hand({ x_mm: x, y_mm: y, touches }) {
    reach ??= [x, y, x + 1, y + 1];
    reach = [Math.min(reach[0], x), Math.min(reach[1], y), Math.max(reach[2], x), Math.max(reach[3], y)];
    const [left, low, right, high] = reach;
    grid.lead(touches ? [0.1 + (0.8 * (x - left)) / (right - left), 0.9 - (0.8 * (y - low)) / (high - low)] : null);
  },
  status(message) {
    const said = [message.problem ?? (records ? `recorded ${message.recorded_s.toFixed(1)} s` : "")];
    said.push(message.rows ? `${message.rows} rows of results` : "", message.said);
    text("recording", said.filter(Boolean).join(", "));
    if (completion === message.completion) return;
    ({ completion } = message);
    captions();
  },
};

/** Return the model under a tile, or null if there is none now. */
const modelOf = (at) => models[study.state.scenario === null ? at : study.state.textures[at]] ?? null;

function captions() {
  if (names.length === 1) grid.caption(0, models.length ? "touch to feel" : `not ready yet: ${completion || "the leader still explores the surface"}`);
}

/** Say that the page plays on without its server. */
function connected(state) {
  if (state !== "live") grid.lead(null);
  if (state === "lost" && models.length) text("connection", "connection lost: this page plays on with the last models, and tries again");
  fit(); // the header may have another height
}

/** Play what is under the hand, while it is on a tile. */
function moved() {
  const at = hand.touches ? grid.at(hand.left, hand.top) : null;
  movedAt = performance.now();
  if (at !== tile) {
    lifted();
    if (at !== null) grid.choose(at);
  }
  tile = at;
  if (tile === null) hand.lift();
  else sound.setModel(modelOf(tile));
  sound.move(hand);
  grid.point(tile, hand.left, hand.top);
  if (hand.presses) text("force-name", "Force at full pressure");
}

// ---- Strokes for the server: for a recording, and for how long a texture was felt

const wanted = () => records || study.state.scenario !== null;

function lifted() {
  send();
  if (tile !== null && wanted()) link.send({ do: "stroke", tile: null });
  then = performance.now();
}

function send() {
  if (steps.length) link.send({ do: "stroke", tile, steps });
  steps = [];
}

setInterval(() => {
  const now = performance.now();
  if (tile === null || !wanted()) {
    then = now;
    return;
  }
  const passed = Math.min(Math.floor(now - then), LONGEST_STEP_MS);
  if (passed < 1) return;
  then += passed;
  const held = heldShare(hand.holdMs, now - movedAt);
  steps.push([passed, hand.x, hand.y, held * hand.vx, held * hand.vy, hand.force]);
  if (steps.length >= STEPS) send();
}, STEP_MS);

// ---- What is shown

/** Show the level and the latency of the vibration, a few times a second. */
function report(rms) {
  level.square += rms * rms;
  level.counted++;
  const now = performance.now();
  if (now - shownAt < SHOW_EVERY_MS) return;
  shownAt = now;
  const played = Math.sqrt(level.square / level.counted);
  level = { square: 0, counted: 0 };
  $("level").value = played;
  text("level-text", `${played.toFixed(2)} m/s²`);
  text("latency", sound.latency());
  $("latency").dataset.by = sound.node.by;
}

/** Let the grid fill the screen below the controls. */
function fit() {
  const count = grid.tiles.length || 1;
  const columns = Math.ceil(Math.sqrt(count));
  const rows = Math.ceil(count / columns);
  const room = Math.max(innerHeight - $("grid").getBoundingClientRect().top - scrollY - 90, rows * 120);
  $("grid").style.setProperty("--columns", innerWidth <= 620 ? Math.min(2, columns) : columns);
  $("grid").style.setProperty("--tile", `${Math.min(room / rows - 10, count === 1 ? Infinity : 420)}px`);
  grid.moved();
}

function setScale(px) {
  mmPerPx = BAR_MM / px;
  $("scale-bar").style.width = `${px}px`;
}

function key(event) {
  const typing = event.target.closest("input:not([type=range]), select, summary");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "+" || event.key === "-") {
    event.key === "+" ? $("force").stepUp() : $("force").stepDown();
    showSettings();
  } else if (event.key === "Enter" && grid.focused()) {
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
  sound.setVolume(number("volume") / 100);
  text("force-text", `${number("force").toFixed(1)} N`);
  text("speed-text", `${$("speed").value} mm/s`);
}

for (const id of ["volume", "force", "speed"]) $(id).oninput = showSettings;
$("scale").value = BAR_MM / mmPerPx;
$("scale").oninput = () => {
  setScale(number("scale"));
  localStorage.setItem("mmt-mm-per-px", String(mmPerPx));
};
setScale(BAR_MM / mmPerPx);
showSettings();
addEventListener("keydown", key);
addEventListener("resize", fit);
for (const node of document.querySelectorAll("details")) node.addEventListener("toggle", fit);

window.mmtTexture = {
  /** Vibration (m/s2) of the chosen texture, else the first: speed and force or velocity x, y and force, and an excitation. */
  render: (...given) => render(modelOf(grid.chosen ?? 0), ...given),
  figures: () => sound.figures(),
};
