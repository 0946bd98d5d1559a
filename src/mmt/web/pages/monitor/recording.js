// A recording on the monitor's page: asks for one moment after the other and shows it.

import { isTaken, offerHelp } from "./help.js";
import { decode } from "./link.js";
import { Panels, number, showLatencies, text } from "./panels.js";
import { TimeBar } from "./timebar.js";

const EVERY_MS = 40;
const GROWTH_EVERY_MS = 400;
const ALIVE_EVERY_MS = 2000; // also when there is nothing new: so a page sees that the server is gone
const ADDRESS_EVERY_MS = 400;
const LEAST_SPAN_S = 0.1;
const RETRY_MS = 1000;
const NO_MODEL = { samples: 0, order: null, cells: null, arrays: {} };
const SOURCES = {
  recorded: "as recorded",
  rendered: "the leader's output was not recorded: this is rendered from the model of this moment",
};

const $ = (id) => document.getElementById(id);
const panels = new Panels();
const wait = (ms) => new Promise((resolve) => { setTimeout(resolve, ms); });

let bar = null;
let line = null;
let wanted = 0;
let stale = true;
let isOpened = false;
let addressTimer = null;
let shownModel = null;
let events = [];
let lastEvent = null;
let failing = null; // the path whose failure is shown
const isStale = () => stale;

/** Ask the program that shows the recording, again while it fails; null if meanwhile the person `hasMovedOn`. */
async function ask(path, hasMovedOn = () => false) {
  do {
    try {
      const answer = await fetch(path);
      if (!answer.ok) throw new Error((await answer.text()).trim());
      const message = decode(await answer.arrayBuffer());
      if (failing === path) failing = null;
      if (failing === null) showState("recorded", "recorded");
      return message;
    } catch (error) {
      failing = path;
      showState("lost", error instanceof TypeError ? "mmt session view has ended: start it again to go on" : error.message);
      await wait(RETRY_MS);
    }
  } while (!hasMovedOn());
  failing = null;
  return null;
}

function showState(state, sentence) {
  text("connection", sentence);
  $("connection").dataset.state = state;
  document.body.classList.toggle("lost", state !== "recorded");
}

/** Show the wanted moment whenever it is another one than is shown. */
async function follow() {
  for (;;) {
    await wait(EVERY_MS);
    if (!stale) continue;
    stale = false;
    if (line.isStale) await showCourse();
    const moment = await ask(`moment?time_s=${wanted}`, isStale);
    if (moment === null) continue;
    if (moment.model !== shownModel) {
      const model = moment.model === null ? NO_MODEL : await ask(`model?number=${moment.model}`, isStale);
      if (model === null) continue;
      panels.model(model);
      shownModel = moment.model;
    }
    show(moment);
  }
}

const orNull = (values) => Array.from(values, (value) => (Number.isNaN(value) ? null : value));
const axes = (values) => [0, 1, 2].map((axis) => orNull(values.subarray((axis * values.length) / 3, ((axis + 1) * values.length) / 3)));

/** The span of time that all panels over time show, shared by their zoom. */
class TimeLine {
  constructor(duration_s, longest_s, plots) {
    Object.assign(this, { duration_s, longest_s, plots, modes: [], isStale: true });
    this.width_s = Math.min(duration_s, longest_s);
    this.span = [0, this.width_s];
    for (const plot of plots) plot.shareTime(this);
  }

  /** Show from one time to another; null for as much as is shown at first. */
  zoom(from, to) {
    const [begin, end] = from === null ? [wanted - this.longest_s / 2, wanted + this.longest_s / 2] : [from, to];
    this.width_s = Math.min(Math.max(end - begin, LEAST_SPAN_S), this.longest_s, this.duration_s);
    this.#show((begin + end - this.width_s) / 2);
  }

  /** Move so that a time is shown. */
  reach(time_s) {
    if (time_s < this.span[0] || time_s > this.span[1]) this.#show(time_s - this.width_s / 2);
  }

  pick(time_s) {
    bar.go(time_s);
  }

  #show(begin) {
    const from = Math.min(Math.max(begin, 0), this.duration_s - this.width_s);
    this.span = [from, from + this.width_s];
    this.isStale = stale = true;
    for (const plot of this.plots) plot.follow();
  }
}

/** Show force, position and what was played in the span of the time line. */
async function showCourse() {
  line.isStale = false;
  const course = await ask(`course?from_s=${line.span[0]}&to_s=${line.span[1]}`, isStale);
  if (course === null) return void (line.isStale = true);
  const { arrays, modes, from_s } = course;
  line.modes = modes;
  panels.history = { time: Array.from(arrays.time_s, (time_s) => from_s + time_s), force: axes(arrays.force_n), position: axes(arrays.position_mm) };
}

function show(moment) {
  const { arrays } = moment;
  panels.rings.measured.values = orNull(arrays.measured);
  panels.rings.played.values = orNull(arrays.played);
  panels.rings.modelled.values = Array.from(arrays.modelled);
  panels.trail.points = [];
  for (let i = 0; i < arrays.trail.length; i += 3) {
    const [x, y, force] = arrays.trail.subarray(i, i + 3);
    panels.trail.add(Number.isNaN(x) ? null : { speed: Math.hypot(x, y), force, velocity: [x, y] });
  }
  panels.verdict({ ...moment.verdict, time: `${moment.time_s.toFixed(2)} s` }, SOURCES[moment.source] ?? "nothing was played");
  panels.surface(moment.surfaces);
  panels.completion(moment.completion);
  for (const plot of line.plots) plot.mark(moment.time_s);
  if (!moment.rebuilt) text("plane-text", "The model of this moment is being built.");
  if (moment.link) showLink(moment.link);
  showEvents(moment.time_s);
  panels.dirty = true;
}

function showLink(link) {
  showLatencies(link.bounds_ms ?? [], link.counts ?? [], {
    "frames that did not arrive": String(link.missed),
    "filled in later": String(link.filled),
    "lost for good": String(link.lost),
    "latency p50, p99, last 10 s": `${number(link.latency_p50_ms, 2)}, ${number(link.latency_p99_ms, 2)} ms`,
    "clock offset": `${number(link.clock?.offset_ms, 3)} ± ${number(link.clock?.uncertainty_ms, 3)} ms`,
    "clock drift": number(link.clock?.drift_ppm, 1, " ppm"),
  });
}

function listEvents(happenings) {
  events = happenings.map(([time_s, kind, sentence]) => {
    const item = document.createElement("li");
    const button = document.createElement("button");
    const time = document.createElement("time");
    time.textContent = `${time_s.toFixed(1)} s`;
    button.append(time, sentence);
    button.className = kind;
    button.onclick = () => bar.go(time_s);
    item.append(button);
    return { time_s, item };
  });
  $("events").replaceChildren(...events.map(({ item }) => item));
  if (!events.length) $("events").textContent = "No event was recorded.";
}

/** Tell what has happened up to a time from what is still to come. */
function showEvents(now_s) {
  const last = events.findLastIndex(({ time_s }) => time_s <= now_s);
  if (last === lastEvent) return;
  lastEvent = last;
  const list = $("events"), current = events[last]?.item;
  list.scrollTop = current ? current.offsetTop - list.offsetTop - (list.clientHeight - current.offsetHeight) / 2 : 0;
  events.forEach(({ item }, i) => {
    item.classList.toggle("future", i > last);
    if (i === last) item.setAttribute("aria-current", "time");
    else item.removeAttribute("aria-current");
  });
}

/** A model that is complete stays as it is until the end. */
function toTheEnd({ time_s, value }) {
  if (!time_s.length) return { time_s, value };
  return { time_s: [...time_s, Math.max(bar.duration_s, time_s.at(-1))], value: [...value, value.at(-1)] };
}

/** Show how the model grew, as far as it has been built again. */
async function followGrowth(given) {
  let isDone = false;
  for (;;) {
    const growth = await ask("growth");
    panels.curve(growth.done ? toTheEnd(growth.arrays) : growth.arrays);
    const remarks = growth.problem ? [...given, `The model could not be built: ${growth.problem}`] : given;
    const share = Math.floor((100 * growth.reached_s) / bar.duration_s);
    text("remarks", [...remarks, ...(growth.done ? [] : [`The model is being built: ${share} %.`])].join(" "));
    if (!isOpened && growth.start_s !== null) bar.go(growth.start_s); // where no switch was recorded
    if (!isDone) stale = true;
    isDone = growth.done;
    await wait(isDone ? ALIVE_EVERY_MS : GROWTH_EVERY_MS);
  }
}

/** Keep the moment in the page's address, so that it can be loaded again, and passed on. */
function keepAddress() {
  addressTimer = null;
  history.replaceState(null, "", `#t=${wanted.toFixed(2)}`);
}

function goToAddress() {
  const time_s = Number.parseFloat(new URLSearchParams(location.hash.slice(1)).get("t"));
  if (Number.isFinite(time_s)) bar.go(time_s);
}

function zoomByKey(event) {
  const factor = { "[": 2, "]": 0.5 }[event.key];
  if (factor === undefined || isTaken(event)) return;
  event.preventDefault();
  const half_s = (line.width_s * factor) / 2;
  line.zoom(wanted - half_s, wanted + half_s);
}

async function start() {
  for (const part of document.querySelectorAll("[data-live]")) part.hidden = true;
  $("remarks").hidden = false;
  offerHelp("recording");
  const opening = await ask("opening");
  panels.begin(opening);
  panels.model(NO_MODEL);
  document.title = `mmt: ${opening.session}`;
  $("link-panel").hidden = !opening.link;
  text("h-plane", "The model at this moment");
  bar = new TimeBar(opening.duration_s, (time_s) => {
    wanted = time_s;
    line.reach(wanted); // not at every picture: a zoom may show another time
    stale = isOpened = true;
    addressTimer ??= setTimeout(keepAddress, ADDRESS_EVERY_MS);
  });
  const { completion, force, position } = panels.plots;
  line = new TimeLine(opening.duration_s, opening.longest_course_s, [completion, force, position]);
  goToAddress();
  if (!isOpened && opening.switch_s !== null) bar.go(opening.switch_s);
  addEventListener("hashchange", goToAddress);
  addEventListener("keydown", zoomByKey);
  bar.mark(opening.happenings);
  listEvents(opening.happenings);
  followGrowth(opening.remarks);
  follow();
}

start();
