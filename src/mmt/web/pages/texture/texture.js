// The page of one file: strokes its textures; all that it needs is in the page itself.

const source = document.getElementById("module").textContent;
const { FULL_SCALE_M_S2, Hand, MOST_BYTES, ModelError, Sound, filterAt, parseModel, render } =
  await import(`data:text/javascript;base64,${btoa(source)}`); // from disk, Chromium takes no Blob for a worklet

const BAR_MM = 50;
const MAP = 36; // cells along each edge
const DECIBELS = 30;
const SHOW_EVERY_MS = 100;

const $ = (id) => document.getElementById(id);
const text = (id, value) => { const node = $(id); if (node.textContent !== value) node.textContent = value; };
const number = (id) => Number($(id).value);
const colour = (name) => getComputedStyle(document.body).getPropertyValue(`--${name}`).trim();

const models = [];
let model = null;
let analyser;
let mmPerPx = 25.4 / 96;
let rms = 0;
let shownAt = 0;
const sound = new Sound(report, sounds);
const hand = new Hand($("surface"), () => ({ mmPerPx, force: number("force"), speed: number("speed") }), moved);

function say(state, sentence) {
  text("state", sentence);
  $("state").dataset.state = state;
}

function problem(sentence) {
  text("problem", sentence);
  $("problem").hidden = sentence === "";
}

// ---- Models

/** Add a model of its JSON form; a sentence says why it is refused. */
function add(form) {
  try {
    models.push(parseModel(form));
  } catch (error) {
    if (!(error instanceof ModelError)) throw error;
    problem(error.message);
    return;
  }
  const at = models.length - 1, button = document.createElement("button");
  button.textContent = models[at].name;
  button.setAttribute("role", "radio");
  button.onclick = () => choose(at);
  $("choice").append(button);
  $("choice").hidden = models.length < 2;
}

function choose(at) {
  model = models[at];
  [...$("choice").children].forEach((button, index) => button.setAttribute("aria-checked", String(index === at)));
  text("name", model.name);
  document.title = `${model.name} · mmt texture`;
  sound.setModel(model);
  requestAnimationFrame(draw);
}

async function open(file) {
  problem("");
  if (file.size > MOST_BYTES) {
    problem(`${file.name} has ${(file.size / 1e6).toFixed(1)} MB: a model has ${MOST_BYTES / 1e6} at most.`);
    return;
  }
  const before = models.length;
  add(await file.text());
  if (models.length > before) choose(before);
}

// ---- Sound and hand

/** Show whether there is sound; when it begins, show what is played as well. */
function sounds(state, sentence) {
  say(state, { waiting: sentence, running: "plays here, without a network", degraded: "no sound" }[state]);
  problem(state === "degraded" ? sentence : "");
  if (state !== "running") return;
  analyser = new AnalyserNode(sound.context, { fftSize: 4096 });
  sound.node.connect(analyser);
}

function report(played) {
  rms = played;
  const now = performance.now();
  if (now - shownAt > SHOW_EVERY_MS) {
    shownAt = now;
    requestAnimationFrame(draw);
  }
}

function moved() {
  sound.move(hand);
  if (hand.presses) text("force-name", "Force at full pressure");
  const surface = $("surface"), box = surface.getBoundingClientRect();
  surface.classList.toggle("touched", hand.touches);
  surface.lastElementChild.style.transform = `translate(${hand.left - box.left}px, ${hand.top - box.top}px)`;
}

// ---- Pictures

/** Return a canvas' pen and size, cleared. */
function canvas(id) {
  const node = $(id), pen = node.getContext("2d");
  pen.clearRect(0, 0, node.width, node.height);
  pen.lineWidth = 3;
  return [pen, node.width, node.height];
}

const now = () => {
  if (model.dimensions === 3) return [hand.vx, hand.vy, hand.force];
  return [Math.hypot(hand.vx, hand.vy), hand.force];
};
let map = { key: "" };

/** Levels over speed and force, or over the velocity at the present force; kept until another force. */
function levels() {
  const force = Math.max(0.1, Math.round(10 * (hand.force || number("force"))) / 10);
  const key = `${models.indexOf(model)} ${model.dimensions === 3 ? force : ""}`;
  if (map.key === key) return map;
  const cells = [];
  for (let row = 0; row < MAP; row++) {
    for (let column = 0; column < MAP; column++) {
      const x = (column + 0.5) / MAP, y = (row + 0.5) / MAP;
      const at = model.dimensions === 3
        ? [(2 * x - 1) * model.maximumSpeed, (2 * y - 1) * model.maximumSpeed, force]
        : [x * model.maximumSpeed, y * model.maximumForce];
      const beyond = model.dimensions === 3 && Math.hypot(at[0], at[1]) > model.maximumSpeed;
      cells.push(beyond ? null : filterAt(model, ...at).rms);
    }
  }
  map = { key, cells, most: Math.max(...cells), force };
  return map;
}

function drawPlane() {
  const [pen, width, height] = canvas("plane");
  const { cells, most, force } = levels();
  pen.fillStyle = colour("ready");
  cells.forEach((level, cell) => {
    if (level === null || !(level > 0)) return;
    pen.globalAlpha = Math.max(0, 1 + (20 * Math.log10(level / most)) / DECIBELS);
    pen.fillRect(((cell % MAP) * width) / MAP, height - ((Math.floor(cell / MAP) + 1) * height) / MAP, width / MAP + 0.5, height / MAP + 0.5);
  });
  pen.globalAlpha = 1;
  const directed = model.dimensions === 3;
  const place = (x, y) => (directed ? [((x + 1) * width) / 2, ((1 - y) * height) / 2] : [x * width, (1 - y) * height]);
  pen.fillStyle = colour("measured");
  for (let row = 0; row < model.samples; row++) {
    const [x, y] = place(model.rows[row * model.width], model.rows[row * model.width + 1]);
    pen.fillRect(x - 1.5, y - 1.5, 3, 3);
  }
  const [x, y] = now();
  const [left, top] = place(Math.min(x / model.maximumSpeed, 1), Math.min(y / (directed ? model.maximumSpeed : model.maximumForce), 1));
  pen.fillStyle = colour("synthesized");
  pen.beginPath();
  pen.arc(left, top, 9, 0, 7);
  pen.fill();
  const axes = directed ? `velocity x and y to ±${model.maximumSpeed} mm/s, at ${force.toFixed(1)} N` : `speed to ${model.maximumSpeed} mm/s, force to ${model.maximumForce} N`;
  text("plane-title", `Level over ${axes}: ${DECIBELS} dB to ${most.toPrecision(2)} m/s²; dots are samples`);
}

function curve(pen, values, width, height, name) {
  pen.strokeStyle = colour(name);
  pen.beginPath();
  values.forEach((value, i) => pen.lineTo((i * width) / (values.length - 1), height * (1 - value)));
  pen.stroke();
}

function drawSpectrum() {
  const [pen, width, height] = canvas("spectrum");
  const touched = Math.hypot(hand.vx, hand.vy) > 0 && hand.force > 0;
  const at = touched ? now() : model.dimensions === 3 ? [100, 0, 1] : [100, 1];
  const { rms: level, density } = filterAt(model, ...at);
  const values = Array.from({ length: 200 }, (_, i) => 10 * Math.log10(density((i * model.rateHz) / 400) + 1e-12));
  const top = 10 * Math.ceil(Math.max(...values) / 10);
  curve(pen, values.map((value) => Math.max(0, 1 + (value - top) / 60)), width, height, "synthesized");
  const where = touched ? "at the hand" : "at 100 mm/s and 1 N";
  text("spectrum-title", `Spectrum ${where}: 0 to ${model.rateHz / 2} Hz, ${top - 60} to ${top} dB re 1 (m/s²)²/Hz; level ${level.toFixed(2)} m/s²`);
}

function drawPlayed() {
  const [pen, width, height] = canvas("played");
  const samples = new Float32Array(4096);
  analyser?.getFloatTimeDomainData(samples);
  const most = samples.reduce((largest, value) => Math.max(largest, Math.abs(value)), 1e-3);
  const shown = Array.from({ length: 512 }, (_, i) => 0.5 + (0.48 * samples[8 * i]) / most);
  curve(pen, shown, width, height, "synthesized");
  const seconds = analyser ? `${((1e3 * 4096) / sound.context.sampleRate).toFixed(0)} ms, ` : "";
  const moved = hand.vx || hand.vy ? `${Math.hypot(hand.vx, hand.vy).toFixed(0)} mm/s, ${hand.force.toFixed(2)} N` : "at rest";
  text("played-title", `Played: ${seconds}level ${rms.toFixed(2)} m/s², ±${(most * FULL_SCALE_M_S2).toFixed(1)} m/s²; hand ${moved}`);
}

function draw() {
  if (model === null) return;
  drawPlane();
  drawSpectrum();
  drawPlayed();
  text("latency", sound.latency());
}

// ---- Settings

function settings() {
  const volume = number("volume") / 100;
  sound.setVolume(volume);
  text("volume-text", `${$("volume").value} %`);
  text("force-text", `${number("force").toFixed(1)} N`);
  text("speed-text", `${$("speed").value} mm/s`);
  const full = volume > 0 ? `an amplitude of 1 is ${(FULL_SCALE_M_S2 / volume).toFixed(0)} m/s²` : "nothing is played";
  text("scale-text", `At this volume ${full} at the sound output, at full volume ${FULL_SCALE_M_S2} m/s²; what is above is cut off. Hear it, or drive a voice coil by the headphone jack.`);
}
for (const id of ["volume", "force", "speed"]) $(id).addEventListener("input", settings);
function setScale(px) {
  mmPerPx = BAR_MM / px;
  $("scale-bar").style.width = `${px}px`;
}
$("scale").value = BAR_MM / mmPerPx;
setScale(BAR_MM / mmPerPx);
$("scale").addEventListener("input", () => setScale(number("scale")));
$("open").addEventListener("change", () => { if ($("open").files.length) open($("open").files[0]); });

for (const node of document.querySelectorAll("script.model")) add(node.textContent);
settings();
if (models.length) choose(0);
else if ($("problem").hidden) problem("This page holds no model: open one below.");

window.mmtTexture = {
  /** Vibration (m/s2) of the chosen model: speed and force or velocity x, y and force, and an excitation. */
  render: (...given) => render(model, ...given),
  choose(name) {
    const at = models.findIndex((each) => each.name === name);
    if (at < 0) throw new ModelError(`There is no model ${name} here: there are ${this.names().join(", ")}.`);
    choose(at);
  },
  names: () => models.map((each) => each.name),
  figures: () => sound.figures(),
};
