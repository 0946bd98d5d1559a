// The space of velocity and force, seen along the force: heading and speed, one force band at a time.

import { ModelPlane, advise, circle, drawAdvice, drawTrail, headingOf, lack, prepare, shade, worstOf } from "./canvas.js";

const BANDS = ["light", "medium", "strong"];
const DIVISIONS = 3;
const MARGIN = 30;
const LABELS_AT = -Math.PI / 8;

export class VelocityPlane extends ModelPlane {
  band = null;
  slices = new Map();

  setModel(model) {
    this.slices.clear();
    super.setModel(model);
  }

  draw(trail) {
    this.#follow(trail.newest);
    const { pen, width, height, colour } = prepare(this.canvas);
    this.colour = colour;
    const shown = this.#shown();
    const radius = Math.max(Math.min((height - 2 * MARGIN) / 2, (width - 3 * MARGIN) * 0.36), 20);
    const disc = { x: MARGIN + radius, y: height / 2, radius };
    this.#cells(pen, disc, shown, true);
    this.#rings(pen, disc);
    this.#samples(pen, disc, shown);
    this.#mark(pen, disc, shown);
    const { speed } = this.limits;
    drawTrail(pen, colour, trail.points, ({ velocity: [x, y] }) => within(disc, x / speed, y / speed));
    this.#small(pen, disc, width, height, shown);
  }

  /** Show the band of the hand while it presses; the last one while it does not. */
  #follow(hand) {
    if (!hand || !(hand.force > 0)) return;
    const band = Math.min(Math.floor((hand.force / this.limits.force) * BANDS.length), BANDS.length - 1);
    if (band === this.band) return;
    this.band = band;
    this.show();
  }

  /** The band of the hand; before it has pressed, the one that lacks most. */
  #shown() {
    if (this.band !== null) return this.band;
    return this.cells ? Math.floor(worstOf(this.cells, this.limits) / DIVISIONS ** 2) : 1;
  }

  #cells(pen, disc, band, numbers) {
    const { cells } = this;
    if (!cells) return;
    pen.save();
    circle(pen, disc.x, disc.y, disc.radius);
    pen.clip();
    const size = (2 * disc.radius) / DIVISIONS;
    cells.slice(band * DIVISIONS ** 2, (band + 1) * DIVISIONS ** 2).forEach((value, index) => {
      const column = index % DIVISIONS, row = Math.floor(index / DIVISIONS);
      const x = disc.x - disc.radius + column * size, y = disc.y + disc.radius - (row + 1) * size;
      pen.fillStyle = shade(lack(value, this.limits, cells.length), this.colour);
      pen.fillRect(x, y, size, size);
      pen.strokeStyle = this.colour("panel");
      pen.strokeRect(x, y, size, size);
      if (!numbers) return;
      pen.fillStyle = this.colour("ink");
      pen.textAlign = "center";
      const inwards = (1 - column) * size * 0.18;
      pen.fillText(value.toFixed(2), x + size / 2 + inwards, y + size / 2 + (row - 1) * size * 0.3);
    });
    pen.restore();
  }

  #rings(pen, disc) {
    const { speed } = this.limits;
    pen.strokeStyle = this.colour("line");
    pen.fillStyle = this.colour("ink");
    pen.lineWidth = 1;
    for (let i = 1; i <= 3; i++) {
      circle(pen, disc.x, disc.y, (disc.radius * i) / 3);
      pen.stroke();
      pen.textAlign = "left";
      // between two spokes, where no cell has its number
      const [x, y] = within(disc, (i / 3) * Math.cos(LABELS_AT), (i / 3) * Math.sin(LABELS_AT));
      pen.fillText(`${Math.round((speed * i) / 3)}${i === 3 ? " mm/s" : ""}`, x + 3, y + 4);
    }
    for (let degrees = 0; degrees < 360; degrees += 45) {
      const [c, s] = [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180)];
      pen.beginPath();
      pen.moveTo(...within(disc, c / 3, s / 3));
      pen.lineTo(...within(disc, c, s));
      pen.stroke();
      if (degrees % 90) continue;
      pen.textAlign = "center";
      const beyond = 1 + 14 / disc.radius;
      const [x, y] = within(disc, c * beyond, s * beyond);
      pen.fillText(`${degrees}°`, x, y + 4);
    }
  }

  #samples(pen, disc, band) {
    const points = this.model?.arrays.points;
    if (!points) return;
    pen.save();
    circle(pen, disc.x, disc.y, disc.radius);
    pen.clip(); // the tetrahedra reach a little beyond what a hand does
    pen.strokeStyle = this.colour("faint");
    pen.globalAlpha = 0.45;
    pen.lineWidth = 1;
    pen.beginPath();
    for (const polygon of this.#slice(band)) {
      polygon.forEach(([x, y], i) => (i ? pen.lineTo(...within(disc, x, y)) : pen.moveTo(...within(disc, x, y))));
      pen.closePath();
    }
    pen.stroke();
    pen.restore();
    pen.fillStyle = pen.strokeStyle = this.colour("measured");
    for (let i = 0; i < points.length; i += 3) {
      const inside = bandOf(points[i + 2]) === band;
      circle(pen, ...within(disc, points[i], points[i + 1]), inside ? 4.5 : 2);
      if (inside) pen.fill();
      else pen.stroke();
    }
  }

  /** Mark where a stroke is wanted, in the band of its force. */
  #mark(pen, disc, band, size = 1) {
    const { speed, force } = this.limits;
    if (!this.advice || bandOf(this.advice[2] / force) !== band) return;
    drawAdvice(pen, this.colour, within(disc, this.advice[0] / speed, this.advice[1] / speed), size);
  }

  /** The other bands in small, the strongest on top; the one that is shown has a frame. */
  #small(pen, disc, width, height, shown) {
    const x = disc.x + disc.radius + 2 * MARGIN;
    const radius = Math.min((height - 2 * MARGIN) / 8, (width - x) / 2 - 4);
    if (radius < 14) return;
    BANDS.forEach((name, band) => {
      const small = { x: x + radius, y: height / 2 + (1 - band) * (2 * radius + 26) + 6, radius };
      this.#cells(pen, small, band, false);
      this.#mark(pen, small, band, 0.4);
      circle(pen, small.x, small.y, radius);
      pen.lineWidth = band === shown ? 3 : 1;
      pen.strokeStyle = this.colour(band === shown ? "ink" : "line");
      pen.stroke();
      pen.fillStyle = this.colour("ink");
      pen.textAlign = "center";
      pen.fillText(this.#range(band), small.x, small.y - radius - 6);
    });
  }

  /** What a plane at the middle of a band cuts out of the tetrahedra: polygons. */
  #slice(band) {
    if (!this.slices.has(band)) {
      const { vertices, tetrahedra } = this.model.arrays;
      this.slices.set(band, tetrahedra ? slice(vertices, tetrahedra, (band + 0.5) / BANDS.length) : []);
    }
    return this.slices.get(band);
  }

  #range(band) {
    const step = this.limits.force / BANDS.length;
    return `${(band * step).toFixed(0)} to ${((band + 1) * step).toFixed(0)} N`;
  }

  /** Say in words what is shown, and which stroke gains most; without advice, where the model lacks most. */
  describe() {
    const { model } = this, shown = this.#shown();
    const forces = model.arrays.points.filter((_, i) => i % 3 === 2);
    const here = forces.filter((force) => bandOf(force) === shown).length;
    return `${model.samples} samples, order ${model.order}; ${here} with ${BANDS[shown]} force `
      + `(${this.#range(shown)}), which is shown.${this.advice ? advise(this.advice) : lacking(this.cells, this.limits)}`;
  }
}

function within({ x, y, radius }, u, v) {
  return [x + u * radius, y - v * radius];
}

function bandOf(force) {
  return Math.min(Math.floor(force * BANDS.length), BANDS.length - 1);
}

function lacking(cells, limits) {
  if (!cells) return "";
  const index = worstOf(cells, limits), band = BANDS[Math.floor(index / DIVISIONS ** 2)];
  const x = (index % DIVISIONS) - 1, y = (Math.floor(index / DIVISIONS) % DIVISIONS) - 1;
  if (x === 0 && y === 0) return ` Lacks most: slow strokes with ${band} force.`;
  return ` Lacks most: strokes towards ${headingOf([x, y])}° with ${band} force.`;
}

/** Cut tetrahedra (4 corners each) of vertices (3 numbers each) at a height; return polygons of [x, y]. */
export function slice(vertices, tetrahedra, height) {
  const polygons = [];
  for (let t = 0; t < tetrahedra.length; t += 4) {
    const corners = [0, 1, 2, 3].map((k) => vertices.subarray(3 * tetrahedra[t + k], 3 * tetrahedra[t + k] + 3));
    const above = corners.filter((c) => c[2] >= height), below = corners.filter((c) => c[2] < height);
    // taken around, so that a cut through four edges does not cross itself
    const edges = above.flatMap((a, i) => (i % 2 ? below.toReversed() : below).map((b) => [a, b]));
    if (!edges.length) continue;
    polygons.push(edges.map(([a, b]) => {
      const share = (height - b[2]) / (a[2] - b[2]);
      return [b[0] + share * (a[0] - b[0]), b[1] + share * (a[1] - b[1])];
    }));
  }
  return polygons;
}
