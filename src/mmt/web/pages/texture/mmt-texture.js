// Renders texture models in a browser (or Node) as mmt.Synthesizer does, in float64, without dependencies.
//
//   const model = parseModel(await (await fetch("oak.json")).json());
//   const texture = await new TextureNode(audioContext).ready;
//   texture.setModel(model);
//   texture.setMotion(100, 0, 1.0); // mm/s along x and y, N; called for each report of the hand
//   texture.connect(audioContext.destination);
//
// The same excitation gives the samples that Python gives. The form of a model is in docs/reference/model-json.md.

const FORMAT = "mmt-texture";
const VERSION = 1;
export const FULL_SCALE_M_S2 = 30; // what an amplitude of 1 in the audio graph stands for
export const MOST_BYTES = 4_000_000; // of a model's JSON

const MOST_ORDER = 64;
const MOST_ROWS = 5_000; // a filter is renewed within 2 ms
const MOST_SIMPLICES = 10_000;
const MOST_LEVEL = 1e12; // (m/s2)^2
const LARGEST_AMPLITUDE = 1e150;
const LARGEST_REFLECTION = 1 - 2 ** -53;
const LIMIT_M_S2 = 60;
const RELEASE_S = 0.004;
const SILENCE = 1e-9;

// ---- The model: read and checked. Whatever breaks a rule is refused with a sentence.

export class ModelError extends Error {}

const refuse = (condition, sentence) => { if (condition) throw new ModelError(`This is no texture model that can be played: ${sentence}.`); };
const isWhole = (value, least, most) => Number.isInteger(value) && value >= least && value <= most;
const within = (value, least, most) => typeof value === "number" && value >= least && value <= most;
const TYPES = { float64: Float64Array, float32: Float32Array, uint16: Uint16Array };

/** Return a checked model of its JSON form, a text or what JSON.parse made of it. */
export function parseModel(form) {
  if (typeof form === "string") {
    refuse(form.length > MOST_BYTES, `it has ${form.length} characters, allowed are ${MOST_BYTES}`);
    try {
      form = JSON.parse(form);
    } catch {
      refuse(true, "it is not JSON");
    }
  }
  refuse(form === null || typeof form !== "object" || form.format !== FORMAT, `its "format" must be "${FORMAT}"`);
  refuse(form.version !== VERSION, `its version is ${String(form.version).slice(0, 20)}, this page reads ${VERSION}`);
  const { name, method, inputs, order } = form;
  refuse(typeof name !== "string" || name.length > 200, "its name must be a text of at most 200 characters");
  refuse(method !== "field" && method !== "published", 'its method must be "field" or "published"');
  refuse(inputs !== "isotropic" && inputs !== "anisotropic", 'its inputs must be "isotropic" or "anisotropic"');
  refuse(!isWhole(order, 1, MOST_ORDER), `its order must be 1 to ${MOST_ORDER}`);
  refuse(!within(form.rate_hz, 100, 20_000), "its rate_hz must be 100 to 20000");
  for (const end of ["maximum_speed_mm_s", "maximum_force_n"]) refuse(!within(form[end], 1e-6, 1e6), `its ${end} must be 1e-6 to 1e6`);
  const dimensions = inputs === "anisotropic" ? 3 : 2;
  const model = {
    name, order, dimensions, rateHz: form.rate_hz,
    maximumSpeed: form.maximum_speed_mm_s, maximumForce: form.maximum_force_n,
    perSpeed: 1 / form.maximum_speed_mm_s, perForce: 1 / form.maximum_force_n,
    width: dimensions + 1 + order, links: null, network: null, level: null, levelShape: null,
  };
  const rows = arrayOf(form.rows, "rows", ["float64"], 2, MOST_ROWS * (4 + MOST_ORDER));
  refuse(rows.shape[1] !== model.width || !isWhole(rows.shape[0], 1, MOST_ROWS), `its rows must have ${model.width} columns, and there may be ${MOST_ROWS}`);
  model.rows = rows.data;
  model.count = rows.shape[0];
  refuse(!isWhole(form.samples, 1, model.count), "its samples must be 1 to the number of its rows");
  model.samples = form.samples;
  if (form.network === undefined) {
    checkVertices(model);
    model.links = linksOf(form.simplices, model);
  } else {
    model.network = networkOf(form.network, model);
  }
  if (form.level !== undefined) readLevel(form.level, model);
  return model;
}

/** Return what an encoded array holds: every number finite. */
function arrayOf(value, name, types, axes, most) {
  refuse(value === null || typeof value !== "object", `it lacks ${name}`);
  const { type, shape, data } = value;
  refuse(!types.includes(type), `${name} must be of ${types.join(" or ")}`);
  refuse(!Array.isArray(shape) || shape.length !== axes || !shape.every((size) => isWhole(size, 1, most)), `the shape of ${name} is wrong`);
  const size = shape.reduce((product, axis) => product * axis, 1);
  const Numbers = TYPES[type];
  const bytes = size * Numbers.BYTES_PER_ELEMENT;
  refuse(size > most || typeof data !== "string" || data.length !== 4 * Math.ceil(bytes / 3), `${name} has another size than its shape says`);
  let text;
  try {
    text = atob(data);
  } catch {
    refuse(true, `${name} is not base64`);
  }
  refuse(text.length !== bytes, `${name} has another size than its shape says`);
  const raw = new DataView(new ArrayBuffer(bytes));
  for (let i = 0; i < bytes; i++) raw.setUint8(i, text.charCodeAt(i));
  const numbers = new (type === "uint16" ? Uint16Array : Float64Array)(size);
  const step = Numbers.BYTES_PER_ELEMENT; // little-endian, whatever the machine
  for (let i = 0; i < size; i++) {
    numbers[i] = type === "float64" ? raw.getFloat64(i * step, true) : type === "float32" ? raw.getFloat32(i * step, true) : raw.getUint16(i * step, true);
    refuse(!Number.isFinite(numbers[i]), `${name} holds a number that is not finite`);
  }
  return { data: numbers, shape };
}

/** See that each vertex has a place, a level and a stable filter. */
function checkVertices({ rows, count, width, dimensions, order }) {
  for (let row = 0; row < count; row++) {
    const at = row * width;
    for (let axis = 0; axis < dimensions; axis++) refuse(Math.abs(rows[at + axis]) > 10, "a vertex lies outside of the space");
    refuse(!within(rows[at + dimensions], 0, MOST_LEVEL), `a level is not within 0 to ${MOST_LEVEL} (m/s2)^2`);
    let before = 0;
    for (let k = 1; k <= order; k++) {
      const lsf = rows[at + dimensions + k];
      refuse(!(lsf > before && lsf < Math.PI), "line spectral frequencies do not ascend within 0 to pi");
      before = lsf;
    }
  }
}

/** Return corners, then the simplex opposite each (-1 for none), of simplices given by corners. */
function linksOf(value, { count, dimensions }) {
  const corners = dimensions + 1;
  const { data, shape } = arrayOf(value, "simplices", ["uint16"], 2, MOST_SIMPLICES * 4);
  refuse(shape[1] !== corners || shape[0] > MOST_SIMPLICES, `simplices must have ${corners} corners, and there may be ${MOST_SIMPLICES}`);
  const links = new Int32Array(2 * data.length).fill(-1);
  const open = new Map();
  for (let simplex = 0; simplex < shape[0]; simplex++) {
    const own = data.slice(simplex * corners, (simplex + 1) * corners);
    refuse(new Set(own).size !== corners || own.some((corner) => corner >= count), "a simplex has corners that do not exist");
    for (let corner = 0; corner < corners; corner++) {
      const place = 2 * simplex * corners + corners + corner;
      links[place - corners] = own[corner];
      const facet = own.filter((_, index) => index !== corner).sort().join();
      const other = open.get(facet);
      if (other === undefined) {
        open.set(facet, place);
        continue;
      }
      refuse(other < 0, "three simplices share a side");
      links[place] = Math.floor(other / (2 * corners));
      links[other] = simplex;
      open.set(facet, -1);
    }
  }
  return links;
}

function networkOf(value, { rows, count, width, dimensions, order }) {
  const tailWidth = Math.max(4, 1 + order);
  const { data, shape } = arrayOf(value, "network", ["float64"], 2, 7 * (1 + MOST_ORDER));
  refuse(shape[0] !== 4 + dimensions || shape[1] !== tailWidth, `network must have the shape ${4 + dimensions} x ${tailWidth}`);
  const [gap, unit, slowest, lightest] = data;
  refuse(!within(gap, 0, 1) || !within(unit, 0, MOST_LEVEL) || !within(slowest, 1e-6, 1) || !within(lightest, 1e-6, 1), "the first row of network is out of range");
  refuse(!within(data[2 * tailWidth], 0, 10 * MOST_LEVEL), "the largest level of network is out of range");
  for (const bound of [tailWidth, 2 * tailWidth]) {
    for (let k = 1; k <= order; k++) {
      const before = k === 1 ? 0 : data[bound + k - 1];
      refuse(!(data[bound + k] > before && data[bound + k] < Math.PI), "bounds of network do not ascend within 0 to pi");
      refuse(data[tailWidth + k] > data[2 * tailWidth + k], "a least frequency of network is above the largest");
    }
  }
  for (let i = 0; i < count * width; i++) refuse(Math.abs(rows[i]) > 1e100, "a weight of the network is out of range");
  return { data, width: tailWidth };
}

function readLevel(value, model) {
  const { data, shape } = arrayOf(value, "level", ["float64", "float32"], 3, 200_000);
  refuse(shape[1] < 2 || shape[2] < 2 || (shape[0] > 1) !== (model.dimensions === 3), "the shape of level is wrong");
  const highest = Math.log(MOST_LEVEL) + 1;
  refuse(data.some((logarithm) => logarithm > highest), `a level is above ${MOST_LEVEL} (m/s2)^2`);
  model.level = data;
  model.levelShape = shape;
}

// ---- Interpolation: mmt.texture.interpolation

const scratch = () => ({ weights: new Float64Array(4), point: new Float64Array(3), values: new Float64Array(1 + MOST_ORDER), work: new Float64Array(5 * (MOST_ORDER / 2 + 2)), pools: new Float64Array(3 * MOST_ORDER), block: new Float64Array(1 + MOST_ORDER), hint: 0 });

const fromZero = (value, perUnit) => { const scaled = value * perUnit; return scaled > 0 ? Math.min(scaled, 1) : 0; };
const bounded = (value, perUnit) => { const scaled = value * perUnit; return Number.isNaN(scaled) ? 0 : Math.max(Math.min(scaled, 1e6), -1e6); };

function normalise(model, first, second, third, point) {
  if (model.dimensions === 2) {
    point[0] = fromZero(first, model.perSpeed);
    point[1] = fromZero(second, model.perForce);
    return;
  }
  let x = bounded(first, model.perSpeed), y = bounded(second, model.perSpeed);
  const square = x * x + y * y;
  if (square > 1) {
    const beyond = Math.sqrt(square);
    x /= beyond;
    y /= beyond;
  }
  point[0] = x;
  point[1] = y;
  point[2] = fromZero(third, model.perForce);
}

/** Write the weights of a point in a simplex; false where it is flat. */
function barycentric({ rows, links, width, dimensions }, simplex, point, weights) {
  const at = 2 * (dimensions + 1) * simplex;
  const a = links[at] * width, b = links[at + 1] * width, c = links[at + 2] * width;
  const ax = rows[a], ay = rows[a + 1];
  const bx = rows[b] - ax, by = rows[b + 1] - ay, cx = rows[c] - ax, cy = rows[c + 1] - ay;
  const px = point[0] - ax, py = point[1] - ay;
  if (dimensions === 2) {
    const area = bx * cy - by * cx;
    if (Math.abs(area) <= 1e-15) return false;
    weights[1] = (px * cy - py * cx) / area;
    weights[2] = (bx * py - by * px) / area;
    weights[0] = 1 - weights[1] - weights[2];
    return true;
  }
  const d = links[at + 3] * width, az = rows[a + 2];
  const bz = rows[b + 2] - az, cz = rows[c + 2] - az, pz = point[2] - az;
  const dx = rows[d] - ax, dy = rows[d + 1] - ay, dz = rows[d + 2] - az;
  const ux = cy * dz - cz * dy, uy = cz * dx - cx * dz, uz = cx * dy - cy * dx;
  const volume = bx * ux + by * uy + bz * uz;
  const vx = py * bz - pz * by, vy = pz * bx - px * bz, vz = px * by - py * bx;
  weights[1] = (px * ux + py * uy + pz * uz) / volume;
  weights[2] = -(dx * vx + dy * vy + dz * vz) / volume;
  weights[3] = (cx * vx + cy * vy + cz * vz) / volume;
  weights[0] = 1 - weights[1] - weights[2] - weights[3];
  return true;
}

function least(weights, corners) {
  let found = 0;
  for (let corner = 1; corner < corners; corner++) if (weights[corner] < weights[found]) found = corner;
  return found;
}

/** Walk to the simplex that holds a point; write its weights, not negative and with sum one. */
function locate(model, start, point, weights) {
  const corners = model.dimensions + 1, count = model.links.length / (2 * corners);
  let simplex = start >= 0 && start < count ? start : 0, found = false;
  for (let step = 0; step <= count; step++) {
    if (!barycentric(model, simplex, point, weights)) break;
    const lowest = least(weights, corners);
    if (weights[lowest] >= -1e-12) {
      found = true;
      break;
    }
    const opposite = model.links[(2 * simplex + 1) * corners + lowest];
    if (opposite < 0) break;
    simplex = opposite;
  }
  if (!found) simplex = scan(model, count, point, weights);
  let total = 0;
  for (let corner = 0; corner < corners; corner++) {
    weights[corner] = Math.max(weights[corner], 0);
    total += weights[corner];
  }
  for (let corner = 0; corner < corners; corner++) weights[corner] /= total;
  return simplex;
}

function scan(model, count, point, weights) {
  let best = 0, bestLeast = -Infinity;
  for (let simplex = 0; simplex < count; simplex++) {
    if (!barycentric(model, simplex, point, weights)) continue;
    const value = weights[least(weights, model.dimensions + 1)];
    if (value > bestLeast) {
      best = simplex;
      bestLeast = value;
    }
  }
  barycentric(model, best, point, weights);
  return best;
}

function linear(model, work) {
  const { rows, links, width, dimensions, order } = model;
  const { point, weights, values } = work;
  const simplex = (work.hint = locate(model, work.hint, point, weights));
  for (let k = 0; k <= order; k++) values[k] = 0;
  for (let corner = 0; corner <= dimensions; corner++) {
    const row = links[2 * (dimensions + 1) * simplex + corner] * width + dimensions;
    for (let k = 0; k <= order; k++) values[k] += weights[corner] * rows[row + k];
  }
  separate(values, order);
}

const bits = new DataView(new ArrayBuffer(8));
/** Return the next number above (by 1) or below (by -1) a positive one. */
function neighbour(value, by) {
  bits.setFloat64(0, value);
  bits.setBigInt64(0, bits.getBigInt64(0) + BigInt(by));
  return bits.getFloat64(0);
}

/** Make frequencies ascend strictly inside (0, pi), moving what is closer by roundings. */
function separate(values, order) {
  const lowest = 2 ** -100;
  let apart = values[1] >= lowest && values[order] < Math.PI;
  for (let k = 2; k <= order; k++) apart = apart && values[k - 1] < values[k];
  if (apart) return;
  let bound = lowest;
  for (let k = 1; k <= order; k++) {
    values[k] = Math.max(values[k], bound);
    bound = neighbour(values[k], 1);
  }
  bound = neighbour(Math.PI, -1);
  for (let k = order; k >= 1; k--) {
    values[k] = Math.min(values[k], bound);
    bound = neighbour(values[k], -1);
  }
}

/** The radial basis function network of paper B, made valid. */
function networked(model, work) {
  const { rows, count, width, dimensions, order } = model;
  const { data: tail, width: columns } = model.network;
  const { point, values, block } = work;
  values.fill(0, 0, order + 1);
  for (let first = 0; first < count; first += 32) { // added up by blocks, as in Python: the same roundings
    block.fill(0, 0, order + 1);
    for (let row = first; row < Math.min(first + 32, count); row++) {
      let squared = 0;
      for (let axis = 0; axis < dimensions; axis++) squared += (point[axis] - rows[row * width + axis]) ** 2;
      const phi = squared > 0 ? 0.5 * squared * Math.log(squared) : 0;
      for (let k = 0; k <= order; k++) block[k] += phi * rows[row * width + dimensions + k];
    }
    for (let k = 0; k <= order; k++) values[k] += block[k];
  }
  for (let k = 0; k <= order; k++) {
    values[k] += tail[3 * columns + k];
    for (let axis = 0; axis < dimensions; axis++) values[k] += point[axis] * tail[(4 + axis) * columns + k];
  }
  const speed = dimensions === 2 ? point[0] : Math.hypot(point[0], point[1]);
  const reach = Math.min(1, speed / tail[2], point[dimensions - 1] / tail[3]);
  const level = values[0] > 0 ? values[0] * tail[1] : 0;
  values[0] = Math.min(level, tail[2 * columns] * reach);
  nearestValid(values, order, tail, columns, work.pools);
}

/** Replace frequencies by the nearest ones within bounds that are a gap apart: pool adjacent violators. */
function nearestValid(values, order, tail, columns, pools) {
  const gap = tail[0];
  let count = 0;
  for (let i = 0; i < order; i++) {
    let mean = (Number.isFinite(values[1 + i]) ? values[1 + i] : 0.5 * Math.PI) - i * gap;
    let size = 1, first = i;
    const low = tail[columns + 1 + i] - i * gap;
    let value = Math.min(Math.max(mean, low), tail[2 * columns + 1 + i] - i * gap);
    while (count > 0 && pools[3 * count - 2] >= value) {
      count--;
      const before = pools[3 * count + 2], share = size / (before + size);
      mean = pools[3 * count] * (1 - share) + mean * share;
      size += before;
      first -= before;
      value = Math.min(Math.max(mean, low), tail[2 * columns + 1 + first] - first * gap);
    }
    pools.set([mean, value, size], 3 * count++);
  }
  for (let pool = 0, i = 0; pool < count; pool++) {
    for (let n = 0; n < pools[3 * pool + 2]; n++, i++) values[1 + i] = pools[3 * pool + 1] + i * gap;
  }
  separate(values, order);
}

const SLOWEST = 0.01, NEAR_REST = 0.15;
const LOWEST = Math.log(SLOWEST + NEAR_REST);
const PER_LOGARITHM = 1 / (Math.log(1 + NEAR_REST) - LOWEST);

/** Return the level of a model with a table at a normalised point. */
function tabulated({ level, levelShape }, x, y, force) {
  const [headings, speeds, forces] = levelShape;
  const speed = Math.sqrt(x * x + y * y);
  const fall = Math.min(speed / SLOWEST, 1) * Math.min(force / SLOWEST, 1);
  if (fall <= 0) return 0;
  let across = (Math.log(Math.max(speed, SLOWEST) + NEAR_REST) - LOWEST) * PER_LOGARITHM * (speeds - 1);
  let along = (Math.log(Math.max(force, SLOWEST) + NEAR_REST) - LOWEST) * PER_LOGARITHM * (forces - 1);
  const row = Math.min(Math.trunc(across), speeds - 2), column = Math.min(Math.trunc(along), forces - 2);
  across -= row;
  along -= column;
  let turn = 0, below = 0, above = 0;
  if (headings > 1) {
    turn = Math.atan2(y, x) * (0.5 / Math.PI);
    turn = (turn - Math.floor(turn)) * headings;
    below = Math.min(Math.trunc(turn), headings - 1);
    turn -= below;
    above = below + 1 < headings ? below + 1 : 0;
  }
  const at = (heading) => {
    const place = (heading * speeds + row) * forces + column, next = place + forces;
    const lower = level[place] + along * (level[place + 1] - level[place]);
    const upper = level[next] + along * (level[next + 1] - level[next]);
    return lower + across * (upper - lower);
  };
  return Math.exp(at(below) * (1 - turn) + at(above) * turn) * fall;
}

// ---- Filters: mmt.texture.autoregression

// By the split recurrences, see mmt.texture.autoregression.split; Python takes a faster way where the same digits come of it.

function moveOrigin(q, e, size, distance) {
  let t = distance;
  for (let i = 0; i < size; i++) {
    const old = q[i];
    q[i] = old + t;
    if (i + 1 < size) {
      const share = e[i] / q[i];
      e[i] = share * old;
      t = distance + share * t;
    }
  }
}

function addMass(q, e, size, mass, added) {
  let d = q[0] * (added / (mass + added));
  q[0] *= mass / (mass + added);
  for (let i = 0; i < size - 1; i++) {
    const beside = d + e[i], following = q[i + 1] / beside;
    q[i + 1] = following * e[i];
    d *= following;
    e[i] = beside;
  }
  e[size - 1] = d;
  q[size] = 0;
}

const distance = (left, right) => 4 * Math.sin(0.5 * (left + right)) * Math.sin(0.5 * Math.abs(right - left));
const square = (value) => value * value;

/** Write the masses at the zeros of P (first 0) or Q (first 1); return the mass at pi. */
function weigh(values, order, first, weights) {
  const other = 1 - first, zeroAtPi = (order + first) % 2 === 0;
  let atPi = first === 0 ? 2 : 0.5;
  for (let i = first; i < order; i += 2) {
    const lsf = values[1 + i], cosine = Math.cos(0.5 * lsf);
    let mass = first === 0 ? 2 * square(Math.sin(0.5 * lsf)) : 0.5;
    if (zeroAtPi) {
      mass /= 4 * cosine * cosine;
      atPi /= 4 * cosine * cosine;
    }
    for (let j = 0; j < order; j += 2) {
      const same = j + first, opposite = j + other;
      if (opposite < order) mass *= distance(lsf, values[1 + opposite]);
      if (same < order && same !== i) mass /= distance(lsf, values[1 + same]);
    }
    weights[i >> 1] = mass;
  }
  for (let i = other; i < order; i += 2) atPi *= 4 * square(Math.cos(0.5 * values[1 + i]));
  return zeroAtPi ? atPi : 0;
}

/** Write the qd array of P (first 0) or Q (first 1); return its mass. */
function recover(values, order, first, weights, q, e) {
  const atPi = weigh(values, order, first, weights);
  if (first >= order) return atPi;
  let mass = weights[0], size = 1;
  q[0] = 0;
  for (let i = first + 2; i < order; i += 2) {
    moveOrigin(q, e, size, distance(values[i - 1], values[1 + i]));
    addMass(q, e, size, mass, weights[i >> 1]);
    mass += weights[i >> 1];
    size++;
  }
  const last = order - 1 - ((order - 1 - first) % 2);
  moveOrigin(q, e, size, 4 * square(Math.cos(0.5 * values[1 + last])));
  if (atPi > 0) addMass(q, e, size, mass, atPi);
  return mass + atPi;
}

function lsfToReflection(values, order, reflection, work) {
  const half = (order >> 1) + 2;
  const [pq, pe, qq, qe, weights] = [0, 1, 2, 3, 4].map((part) => work.subarray(part * half, (part + 1) * half));
  let ratio = recover(values, order, 0, weights, pq, pe) / recover(values, order, 1, weights, qq, qe);
  for (let done = 0; done < order; done++) {
    const k = (ratio - 1) / (ratio + 1);
    reflection[order - 1 - done] = Math.min(Math.max(k, -LARGEST_REFLECTION), LARGEST_REFLECTION);
    ratio *= done % 2 === 0 ? pq[done >> 1] / qq[done >> 1] : pe[done >> 1] / qe[done >> 1];
  }
}

/** Write a model's filter at one motion; return its amplitude (m/s2). Frequencies stay in work.values. */
function filterInto(model, first, second, third, work, reflection, complement) {
  const { point } = work;
  normalise(model, first, second, third, point);
  if (model.network === null) linear(model, work);
  else networked(model, work);
  lsfToReflection(work.values, model.order, reflection, work.work);
  for (let j = 0; j < model.order; j++) complement[j] = Math.sqrt((1 - reflection[j]) * (1 + reflection[j]));
  if (model.level !== null) {
    const power = tabulated(model, point[0], model.dimensions === 3 ? point[1] : 0, point[model.dimensions - 1]);
    return Math.min(Math.sqrt(power), LARGEST_AMPLITUDE);
  }
  let amplitude = Math.sqrt(work.values[0]);
  for (let j = 0; j < model.order; j++) amplitude /= complement[j];
  return Math.min(amplitude, LARGEST_AMPLITUDE);
}

/** Return the filter at a motion: `rms` (m/s2), and `density(f)`, one-sided, in (m/s2)^2/Hz. */
export function filterAt(model, ...inputs) {
  const { order, rateHz } = model, work = scratch();
  const reflection = new Float64Array(order), complement = new Float64Array(order);
  const [first, second, third] = motionOf(model, inputs);
  const rms = filterInto(model, first, second, third, work, reflection, complement);
  const variance = complement.reduce((left, c) => left * c * c, rms * rms);
  const density = (hz) => {
    const w = (2 * Math.PI * hz) / rateHz;
    let p = order % 2 ? 1 : 4 * square(Math.cos(0.5 * w)), q = order % 2 ? 4 * square(Math.sin(w)) : 4 * square(Math.sin(0.5 * w));
    for (let i = 0; i < order; i++) {
      const factor = square(2 * Math.cos(w) - 2 * Math.cos(work.values[1 + i]));
      if (i % 2) q *= factor;
      else p *= factor;
    }
    return variance > 0 ? (8 * variance) / (rateHz * (p + q)) : 0;
  };
  return { rms, density };
}

/** Speed and force alone are a stroke along x in a space of velocity. */
function motionOf({ dimensions }, inputs) {
  if (dimensions === 3 && inputs.length === 2) return [inputs[0], undefined, inputs[1]];
  if (inputs.length !== dimensions) throw new ModelError(`The model takes ${dimensions === 3 ? "velocity x, velocity y" : "speed"} and force; ${inputs.length} inputs were given.`);
  return inputs;
}

// ---- Synthesis: mmt.texture.synthesis

/** Normal numbers of a seed: sfc32 (Doty-Humphrey) and the polar method. Not those of Python. */
function normals(seed) {
  let a = seed >>> 0, b = 0x9e3779b9, c = 0x243f6a88, counter = 1, spare = null;
  const uniform = () => {
    const t = (((a + b) | 0) + counter++) | 0;
    a = b ^ (b >>> 9);
    b = (c + (c << 3)) | 0;
    c = (((c << 21) | (c >>> 11)) + t) | 0;
    return (t >>> 0) / 2 ** 32;
  };
  for (let i = 0; i < 16; i++) uniform();
  return () => {
    if (spare !== null) {
      const value = spare;
      spare = null;
      return value;
    }
    for (;;) {
      const x = 2 * uniform() - 1, y = 2 * uniform() - 1, s = x * x + y * y;
      if (s >= 1 || s === 0) continue;
      const scale = Math.sqrt((-2 * Math.log(s)) / s);
      spare = y * scale;
      return x * scale;
    }
  };
}

/** Renders one model at the model's rate. Assigning `model` later keeps the filter's memory. */
export class Synthesizer {
  constructor(model, { seed = 0, renewalSamples = 1 } = {}) {
    Object.assign(this, { model, renewalSamples });
    this.draw = normals(seed);
    this.reflection = new Float64Array(MOST_ORDER);
    this.complement = new Float64Array(MOST_ORDER).fill(1);
    this.past = new Float64Array(MOST_ORDER);
    this.begun = false;
    this.work = scratch();
    this.order = 1;
    this.wanted = 0;
    this.amplitude = 0;
    this.counter = 0;
    this.release = 0;
  }

  /** Return vibration (m/s2) for the motion at each sample: Float64Arrays of the model's inputs. */
  render(inputs, excitation = null) {
    const [first, second, third] = motionOf(this.model, inputs);
    const count = first.length;
    for (const given of [second, third, excitation]) {
      if (given && given.length !== count) throw new ModelError(`Inputs and excitation must have the same length; ${count} and ${given.length} were given.`);
    }
    if (excitation === null) this.#begin();
    this.begun = true;
    const output = new Float64Array(count);
    for (let i = 0; i < count; i++) {
      output[i] = this.next(first[i], second ? second[i] : 0, third ? third[i] : 0, excitation === null ? this.draw() : excitation[i]);
    }
    return output;
  }

  /** Return the next sample at a motion, or with `touches` false of a hand that was lifted. */
  next(first, second, third, excitation, touches = true) {
    const { model } = this;
    if (!touches) {
      this.wanted = 0;
    } else if (this.counter++ % this.renewalSamples === 0) {
      this.wanted = filterInto(model, first, second, third, this.work, this.reflection, this.complement);
      this.order = model.order;
      this.release = Math.exp(-1 / (RELEASE_S * model.rateHz));
    }
    const value = this.#lattice(excitation);
    this.amplitude *= this.release;
    if (!(this.amplitude >= SILENCE)) this.amplitude = 0;
    if (this.wanted > this.amplitude) this.amplitude = this.wanted;
    return Math.min(Math.max(this.amplitude * value, -LIMIT_M_S2), LIMIT_M_S2);
  }

  /** Return the next sample of the synthesizer's own excitation. */
  live(first, second, third, touches) {
    this.#begin();
    return this.next(first, second, third, this.draw(), touches);
  }

  /** Start the memory in the stationary state; with an excitation that is given it starts at rest. */
  #begin() {
    if (this.begun) return;
    this.begun = true;
    for (let j = 0; j < MOST_ORDER; j++) this.past[j] = this.draw();
  }

  #lattice(excitation) {
    const { reflection, complement, past, order } = this;
    let before = past[order - 1];
    let forward = complement[order - 1] * excitation - reflection[order - 1] * before;
    for (let j = order - 2; j >= 0; j--) {
      before = past[j];
      past[j + 1] = reflection[j] * forward + complement[j] * before;
      forward = complement[j] * forward - reflection[j] * before;
    }
    past[0] = forward;
    return forward;
  }
}

// ---- From the model's rate to the device's: mmt.rendering.generating

const greatestCommonDivisor = (a, b) => (b ? greatestCommonDivisor(b, a % b) : a);

/** Kaiser-windowed sinc in polyphase form, 16 samples of the slower rate long. */
export class RateConverter {
  constructor(fromHz, toHz) {
    const [from, to] = [Math.round(fromHz * 100), Math.round(toHz * 100)];
    const common = greatestCommonDivisor(to, from);
    this.up = to / common;
    this.down = from / common;
    if (!(Math.max(this.up, this.down) <= 100_000)) throw new ModelError(`From ${fromHz} to ${toHz} Hz: the ratio is no simple fraction.`);
    this.taps = this.up === this.down ? 1 : Math.ceil(16 * Math.max(1, this.down / this.up));
    this.phases = this.up === this.down ? Float64Array.of(1) : polyphase(this.up, this.down, this.taps);
    this.delayS = (this.up * this.taps - 1) / (2 * this.up * fromHz);
    if (this.up === this.down) this.up = this.down = 1;
    this.line = new Float64Array(this.taps); // a ring of the newest samples
    this.taken = this.given = 0;
  }

  put(sample) {
    this.line[this.taken++ % this.taps] = sample;
  }

  /** Return the next sample, or null where another must be put in before. */
  get() {
    const step = this.given * this.down, newest = Math.floor(step / this.up);
    if (newest >= this.taken) return null;
    this.given++;
    const { taps, line, phases } = this, at = (step % this.up) * taps;
    let sum = 0, place = (newest + 1) % taps;
    for (let tap = 0; tap < taps; tap++) {
      sum += line[place] * phases[at + tap];
      if (++place === taps) place = 0;
    }
    return sum;
  }

  /** Return all samples that follow from these more. */
  convert(samples) {
    const output = [];
    for (const sample of samples) {
      this.put(sample);
      for (let value = this.get(); value !== null; value = this.get()) output.push(value);
    }
    return Float64Array.from(output);
  }
}

/** The modified Bessel function of order 0, by its series. */
function bessel0(x) {
  let term = 1, sum = 1;
  for (let n = 1; term > 1e-18 * sum; n++) {
    term *= square(x / (2 * n));
    sum += term;
  }
  return sum;
}

/** Return the taps of each phase, the oldest sample's first. */
function polyphase(up, down, taps) {
  const count = up * taps, cutoff = 1 / Math.max(up, down), middle = (count - 1) / 2;
  const phases = new Float64Array(count);
  for (let i = 0; i < count; i++) {
    const angle = Math.PI * cutoff * (i - middle);
    const sinc = angle === 0 ? 1 : Math.sin(angle) / angle;
    const window = bessel0(5.4 * Math.sqrt(Math.max(0, 1 - square((i - middle) / middle)))) / bessel0(5.4);
    phases[(i % up) * taps + taps - 1 - Math.floor(i / up)] = sinc * window;
  }
  for (let phase = 0; phase < up; phase++) {
    const own = phases.subarray(phase * taps, (phase + 1) * taps);
    const sum = own.reduce((total, value) => total + value, 0);
    for (let tap = 0; tap < taps; tap++) own[tap] /= sum;
  }
  return phases;
}

// ---- The hand: position reports of a pointer become velocity and force

const SMOOTHING_MS = 12;
const FASTEST_MM_S = 5000;
const [SHORTEST_HOLD_MS, LONGEST_HOLD_MS] = [20, 50];

/** Return what is left of a velocity so long after its report: held until the next is overdue, it then decays. */
export const heldShare = (holdMs, passedMs) => (passedMs > holdMs ? Math.exp((holdMs - passedMs) / SMOOTHING_MS) : 1);

/** Velocity and force of one pointer from touch-down to lift-off. */
export class PointerMotion {
  constructor() {
    this.lift();
  }

  lift() {
    Object.assign(this, { touches: false, vx: 0, vy: 0, force: 0, holdMs: LONGEST_HOLD_MS });
  }

  /** Add a report: time (ms), position (mm, y upwards), force (N). */
  add(timeMs, x, y, force) {
    const passed = timeMs - this.timeMs;
    if (!this.touches) {
      Object.assign(this, { touches: true, force });
    } else {
      if (passed < 0.01) return;
      const share = -Math.expm1(-passed / SMOOTHING_MS);
      const fast = (1e3 * Math.hypot(x - this.x, y - this.y)) / passed;
      const within = (1e3 / passed) * Math.min(1, fast ? FASTEST_MM_S / fast : 1);
      this.vx += share * (within * (x - this.x) - this.vx);
      this.vy += share * (within * (y - this.y) - this.vy);
      this.force += share * (force - this.force);
      this.holdMs = Math.min(Math.max(2 * passed, SHORTEST_HOLD_MS), LONGEST_HOLD_MS);
    }
    Object.assign(this, { x, y, timeMs });
  }
}

// ---- Live, in an audio graph

const RENEWALS_HZ = 500; // a filter follows the hand as often, or at each sample of the model
const REPORT_S = 0.03;

/** Renders what the hand touches at an output rate; a model that is replaced rings out at its own rate. */
export class LiveRenderer {
  constructor(outputHz, seed = 0) {
    Object.assign(this, { outputHz, seed });
    this.lanes = new Map(); // by the rate of models
    this.hand = { vx: 0, vy: 0, force: 0, holdMs: 0, touches: false };
    this.idleMs = 0;
    this.forget();
  }

  /** Take `{ model }` (null for none) or `{ hand }`. */
  take({ model, hand }) {
    if (hand !== undefined) {
      this.hand = hand;
      this.idleMs = 0;
      this.number = hand.number;
    }
    if (model === undefined) return;
    this.model = model;
    if (model === null || this.lanes.has(model.rateHz)) return;
    const synthesizer = new Synthesizer(model, { seed: this.seed, renewalSamples: Math.max(1, Math.round(model.rateHz / RENEWALS_HZ)) });
    this.lanes.set(model.rateHz, { synthesizer, converter: new RateConverter(model.rateHz, this.outputHz) });
  }

  /** Write the next samples; an amplitude of 1 is FULL_SCALE_M_S2. */
  fill(output) {
    output.fill(0);
    for (const [rateHz, { synthesizer, converter }] of this.lanes) {
      const sounds = this.model?.rateHz === rateHz;
      if (sounds) synthesizer.model = this.model;
      for (let i = 0; i < output.length; i++) {
        let value = converter.get();
        while (value === null) {
          converter.put(this.#sample(synthesizer, sounds, 1e3 / rateHz));
          value = converter.get();
        }
        output[i] += value;
      }
      if (!sounds && synthesizer.amplitude === 0) this.lanes.delete(rateHz);
    }
    for (let i = 0; i < output.length; i++) {
      const value = Number.isFinite(output[i]) ? output[i] : 0; // nothing that a model holds may reach the ear
      output[i] = Math.min(Math.max(value / FULL_SCALE_M_S2, -1), 1);
      this.square += (output[i] * FULL_SCALE_M_S2) ** 2;
    }
    this.counted += output.length;
  }

  #sample(synthesizer, sounds, stepMs) {
    const { hand } = this;
    this.idleMs += stepMs;
    const left = heldShare(hand.holdMs, this.idleMs);
    const touches = sounds && hand.touches;
    const vx = left * hand.vx, vy = left * hand.vy;
    if (synthesizer.model.dimensions === 2) return synthesizer.live(Math.hypot(vx, vy), hand.force, 0, touches);
    return synthesizer.live(vx, vy, hand.force, touches);
  }

  /** Return what was played since the last report: at once where the hand has moved, else null until it is time. */
  report() {
    if (this.number === this.reported && this.counted < REPORT_S * this.outputHz) return null;
    const delayS = this.lanes.get(this.model?.rateHz)?.converter.delayS;
    const report = { rms: Math.sqrt(this.square / this.counted), number: this.number, delayS };
    this.reported = this.number;
    this.forget();
    return report;
  }

  forget() {
    this.square = this.counted = 0;
  }
}

const PROCESSOR = "mmt-texture";
if (globalThis.AudioWorkletProcessor !== undefined) {
  class Processor extends AudioWorkletProcessor {
    constructor() {
      super();
      this.renderer = new LiveRenderer(sampleRate, (Math.random() * 2 ** 32) >>> 0);
      this.port.onmessage = ({ data }) => this.renderer.take(data);
    }

    process(_, [[output]]) {
      this.renderer.fill(output);
      const report = this.renderer.report();
      if (report !== null) this.port.postMessage(report);
      return true;
    }
  }
  registerProcessor(PROCESSOR, Processor);
}

const SCRIPT_FRAMES = 256;

/** A source in an audio graph: wait for `ready`, then connect it to anything. */
export class TextureNode {
  /** `onReport({ rms, number, delayS })`: what was played (m/s2), the number of the newest `setMotion` in it, and the conversion's delay. */
  constructor(context, onReport = () => {}) {
    Object.assign(this, { context, onReport });
    this.ready = this.#make();
  }

  async #make() {
    try {
      await this.context.audioWorklet.addModule(import.meta.url); // this very module
      const node = new AudioWorkletNode(this.context, PROCESSOR, { numberOfInputs: 0, outputChannelCount: [1] });
      node.port.onmessage = ({ data }) => this.onReport(data);
      this.send = (message) => node.port.postMessage(message);
      Object.assign(this, { node, by: "worklet" });
    } catch { // no worklet here: pages from other machines by http
      const renderer = new LiveRenderer(this.context.sampleRate, (Math.random() * 2 ** 32) >>> 0);
      const node = this.context.createScriptProcessor(SCRIPT_FRAMES, 1, 1);
      node.onaudioprocess = ({ outputBuffer }) => {
        renderer.fill(outputBuffer.getChannelData(0));
        const report = renderer.report();
        if (report !== null) this.onReport(report);
      };
      this.send = (message) => renderer.take(message);
      Object.assign(this, { node, by: "script" });
    }
    return this;
  }

  /** Play a model of `parseModel`, or its next state, without a click; null for none. */
  setModel(model) {
    this.send({ model });
  }

  /** Set the hand's velocity (mm/s) and force (N), held for `holdMs` until the next; `touches` false lifts it. */
  setMotion(vx, vy, force, { touches = true, holdMs = Infinity, number = 0 } = {}) {
    this.send({ hand: { vx, vy, force, touches, holdMs, number } });
  }

  connect(...to) {
    return this.node.connect(...to);
  }

  disconnect() {
    this.node.disconnect();
  }
}

// ---- What a page of ours is made of: the sound, and the hand on an element

const STARTS_WITHIN_MS = 3000;
const REMEMBERED = 200; // reports of the hand, for the middle of their delays
// Firefox, asked for `outputLatency` while it plays, can lock up: it waits for PulseAudio, which waits for its graph, which waits for it
const GECKO = "mozInnerScreenX" in globalThis;

/** A page's sound: begins with a person's first touch, rests while the page is hidden, tells how late it follows the hand. */
export class Sound {
  #delivered = new Map(); // when a report of the hand was delivered, by its number
  #sent = 0;
  #starting = false;

  /** `onReport(rms)`: what was played (m/s2); `onState(state, sentence)`: waiting, running, or degraded and why; `gone`: a signal that ends it. */
  constructor(onReport, onState, gone) {
    Object.assign(this, { onReport, onState, model: null, hand: { touches: false }, volume: 0.2, delays: [], conversionMs: 0 });
    document.addEventListener("visibilitychange", () => (document.hidden ? this.context?.suspend() : this.context?.resume()), { signal: gone });
    gone?.addEventListener("abort", () => this.context?.close());
  }

  #start() {
    if (document.hidden) return;
    if (navigator.userActivation?.hasBeenActive === false) {
      this.onState("degraded", "No sound yet: the browser starts it when the finger is lifted.");
      return;
    }
    this.context?.resume();
    if (this.#starting) return;
    this.#starting = true;
    this.onState("waiting", "starting the sound");
    this.#begin().then(() => this.onState("running", ""), (error) => {
      this.#starting = false;
      this.onState("degraded", `No sound: ${error.message}. Connect headphones or an actuator, then touch again.`);
    });
  }

  async #begin() {
    this.context ??= new AudioContext({ latencyHint: 0 });
    let late;
    const tooLong = new Promise((_, reject) => { late = setTimeout(() => reject(new Error("the browser finds no sound device")), STARTS_WITHIN_MS); });
    try {
      await Promise.race([this.context.resume(), tooLong]);
    } finally {
      clearTimeout(late);
    }
    const node = await new TextureNode(this.context, (report) => this.#report(report)).ready;
    this.gain = new GainNode(this.context, { gain: this.volume });
    node.connect(this.gain).connect(this.context.destination);
    node.setModel(this.model);
    this.node = node;
    this.move(this.hand);
  }

  setModel(model) {
    if (model === this.model) return;
    this.model = model;
    this.node?.setModel(model);
  }

  setVolume(volume) {
    this.volume = volume;
    this.gain?.gain.setTargetAtTime(volume, this.context.currentTime, 0.01);
  }

  /** Take what the hand does now. */
  move(hand) {
    const { vx, vy, force, touches, holdMs } = hand;
    if (touches !== this.hand.touches) this.#start();
    this.hand = { vx, vy, force, touches, holdMs };
    if (this.node === undefined) return;
    this.#delivered.set(++this.#sent, performance.now());
    this.node.setMotion(vx, vy, force, { touches, holdMs, number: this.#sent });
  }

  #report({ rms, number, delayS }) {
    if (delayS !== undefined) this.conversionMs = 1e3 * delayS;
    const at = this.#delivered.get(number);
    if (at !== undefined) this.delays.push(performance.now() - at);
    if (this.delays.length > REMEMBERED) this.delays.shift();
    for (const old of this.#delivered.keys()) if (old <= number) this.#delivered.delete(old);
    this.onReport(rms);
  }

  /** What passes between the hand and the sound, in ms; null before the sound has begun. `output`, the device's, is null in Firefox. */
  figures() {
    if (this.node === undefined) return null;
    const output = GECKO ? null : 1e3 * ((this.context.baseLatency || 0) + (this.context.outputLatency || 0));
    return { delays: [...this.delays], conversion: this.conversionMs, output, by: this.node.by, rate: this.context.sampleRate };
  }

  /** The same in words; empty before the first report. */
  latency() {
    if (!this.delays.length) return "";
    const { delays, conversion, output, by } = this.figures();
    const page = delays.sort((a, b) => a - b)[delays.length >> 1];
    const script = by === "script" ? " (no worklet here: open by https or from disk)" : "";
    const device = output === null ? "unknown" : output.toFixed(1);
    return `hand to sound ${(page + conversion + output).toFixed(0)} ms: page ${page.toFixed(1)}, conversion ${conversion.toFixed(1)}, device ${device}${script}`;
  }
}

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const NO_PRESSURE = [0, 0.5, 1]; // what devices report that do not measure it
const EDGE_PX = 8; // where a stroke by keys turns round

/** The hand on an element: mouse, finger or pen, or arrow keys that stroke what has the focus to and fro. */
export class Hand extends PointerMotion {
  #pointer = null;
  #keys = new Set();
  #stroke = null;

  /** `settings()` gives `mmPerPx`, `force` (N) and the keys' `speed` (mm/s); `onMotion()` is called at each change; `gone`: a signal that ends it. */
  constructor(node, settings, onMotion, gone) {
    super();
    Object.assign(this, { node, settings, onMotion, left: 0, top: 0, presses: false });
    const events = ["pointerdown", "pointermove", "pointerup", "pointercancel", "lostpointercapture", "contextmenu", "keydown"];
    for (const name of events) node.addEventListener(name, this, { signal: gone });
    for (const name of ["keyup", "blur"]) addEventListener(name, this, { signal: gone });
    document.addEventListener("visibilitychange", this, { signal: gone });
    gone?.addEventListener("abort", () => this.#away());
  }

  handleEvent(event) {
    if (event.type === "contextmenu") event.preventDefault();
    else if (event.type === "pointerdown") this.#down(event);
    else if (event.type === "keydown") this.#press(event);
    else if (event.type === "keyup") this.#release(event.key);
    else if (event.type === "pointermove") event.pointerId === this.#pointer && this.#follow(event);
    else if (event.pointerId === undefined || event.pointerId === this.#pointer) this.#away();
  }

  #away() {
    this.#pointer = this.#stroke = null;
    this.#keys.clear();
    this.lift();
    this.onMotion();
  }

  #down(event) {
    if (this.#pointer !== null || event.button !== 0) return;
    this.#away();
    this.#pointer = event.pointerId;
    this.node.setPointerCapture(event.pointerId);
    this.#follow(event);
  }

  /** Add a pointer's reports; a pen's pressure is a share of the force that is set. */
  #follow(event) {
    const { mmPerPx, force } = this.settings(), each = event.getCoalescedEvents?.() ?? [];
    for (const one of each.length ? each : [event]) {
      const measures = one.pointerType !== "mouse";
      if (measures && !NO_PRESSURE.includes(one.pressure)) this.presses = true;
      this.add(one.timeStamp, one.clientX * mmPerPx, -one.clientY * mmPerPx, force * (measures && this.presses ? one.pressure : 1));
    }
    Object.assign(this, { left: event.clientX, top: event.clientY });
    this.onMotion();
  }

  #press(event) {
    if (!(event.key in ARROWS) || this.#pointer !== null) return;
    event.preventDefault();
    this.#keys.add(event.key);
    if (this.#stroke?.target === event.target) return;
    const box = event.target.getBoundingClientRect();
    Object.assign(this, { left: box.left + box.width / 2, top: box.top + box.height / 2 });
    this.#stroke = { target: event.target, box, side: [1, 1], at: performance.now() };
    this.#go(this.#stroke);
  }

  #release(key) {
    if (this.#keys.delete(key) && this.#keys.size === 0) this.#away();
  }

  /** Move on by the keys, at each picture of the screen. */
  #go(stroke) {
    if (stroke !== this.#stroke) return;
    const { mmPerPx, force, speed } = this.settings(), { box, side } = stroke, way = [0, 0], now = performance.now();
    for (const key of this.#keys) ARROWS[key].forEach((part, axis) => { way[axis] += part * side[axis]; });
    const each = speed / (Math.hypot(...way) || 1), px = (Math.min(now - stroke.at, 50) * 1e-3) / mmPerPx;
    stroke.at = now;
    Object.assign(this, { touches: true, vx: way[0] * each, vy: way[1] * each, force, holdMs: Infinity });
    this.left = turned(this.left + this.vx * px, box.left, box.right, side, 0);
    this.top = turned(this.top - this.vy * px, box.top, box.bottom, side, 1);
    Object.assign(this, { x: this.left * mmPerPx, y: -this.top * mmPerPx });
    this.onMotion();
    requestAnimationFrame(() => this.#go(stroke));
  }
}

/** Keep a coordinate within bounds, and turn round at them. */
function turned(value, low, high, side, axis) {
  const kept = Math.min(Math.max(value, low + EDGE_PX), high - EDGE_PX);
  if (kept !== value) side[axis] = -side[axis];
  return kept;
}

// ---- <mmt-texture src="oak.json" volume="0.2" force="1">: a surface to stroke, in anyone's page

if (globalThis.customElements !== undefined && customElements.get("mmt-texture") === undefined) {
  customElements.define("mmt-texture", class extends HTMLElement {
    #gone;

    connectedCallback() {
      this.#gone = new AbortController();
      Object.assign(this.style, { display: "grid", placeItems: "center", minHeight: this.style.minHeight || "12rem", touchAction: "none", userSelect: "none" });
      this.tabIndex = 0;
      for (const [name, value] of [["role", "application"], ["aria-label", "Surface: stroke it with mouse, finger, pen or the arrow keys"]]) {
        if (!this.hasAttribute(name)) this.setAttribute(name, value);
      }
      this.#show(this.#gone.signal).catch((error) => { this.textContent = error.message; });
    }

    async #show(gone) {
      this.textContent = "loading";
      const answer = await fetch(this.getAttribute("src"));
      if (!answer.ok) throw new ModelError(`The model ${this.getAttribute("src")} is not there: ${answer.status}.`);
      const length = Number(answer.headers.get("content-length"));
      refuse(length > MOST_BYTES, `it has ${length} bytes, allowed are ${MOST_BYTES}`);
      const model = parseModel(await answer.text());
      if (gone.aborted) return;
      this.textContent = "touch to feel";
      const settings = () => ({ mmPerPx: 25.4 / 96, force: this.#number("force", 1, 100), speed: 100 });
      const hand = new Hand(this, settings, () => this.sound.move(hand), gone);
      const onState = (state, sentence) => { if (state !== "waiting") this.textContent = sentence || "touch to feel"; };
      this.sound = new Sound(() => {}, onState, gone);
      this.sound.setModel(model);
      this.sound.setVolume(this.#number("volume", 0.2, 1));
    }

    #number(name, otherwise, most) {
      const value = Number.parseFloat(this.getAttribute(name) ?? otherwise);
      return Math.min(Math.max(Number.isFinite(value) ? value : otherwise, 0), most);
    }

    disconnectedCallback() {
      this.#gone.abort();
    }
  });
}

/** Return vibration (m/s2) from the start, as mmt.Synthesizer(model).render does.
 *
 * `render(model, speeds_mm_s, forces_n, excitation)`, or over velocity `render(model, vx, vy, force, excitation)`.
 * The excitation is what follows the second array or the third; null for the renderer's own.
 */
export function render(model, ...given) {
  const excitation = given.length > 2 ? given.pop() : null;
  const [inputs, white] = [given.map((values) => Float64Array.from(values)), excitation && Float64Array.from(excitation)];
  if (white !== null && !white.every(Number.isFinite)) throw new ModelError("The excitation holds a number that is not finite.");
  return new Synthesizer(model).render(inputs, white);
}
