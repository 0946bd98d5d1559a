// The speed-force plane: samples, triangles, nine cells, the hand and its trail.

const TRAIL = 120;
const MARGIN = { left: 48, right: 10, top: 10, bottom: 36 };
const CELLS = ["slow", "medium", "fast"];
const FORCES = ["light", "medium", "strong"];

export class Plane {
  constructor(canvas, text) {
    this.canvas = canvas;
    this.text = text;
    this.model = null;
    this.trail = [];
    this.limits = { speed: 300, force: 3, start: 7.5, stop: 4.243 };
  }

  setLimits(hello) {
    this.limits = {
      speed: hello.maximum_speed_mm_s, force: hello.maximum_force_n,
      start: hello.start_distance, stop: hello.stop_distance,
    };
    this.trail = [];
  }

  setModel(model) {
    this.model = model;
    this.text.textContent = describe(model);
  }

  /** Add the hand's [speed, force], null where it is not known. */
  move(point) {
    this.trail.push(point);
    if (this.trail.length > TRAIL) this.trail.shift();
  }

  draw() {
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (this.canvas.width !== Math.round(width * ratio)) this.canvas.width = Math.round(width * ratio);
    if (this.canvas.height !== Math.round(height * ratio)) this.canvas.height = Math.round(height * ratio);
    const pen = this.canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const style = getComputedStyle(document.documentElement);
    this.colour = (name) => style.getPropertyValue(`--${name}`).trim();
    this.area = {
      x: MARGIN.left, y: MARGIN.top,
      width: width - MARGIN.left - MARGIN.right, height: height - MARGIN.top - MARGIN.bottom,
    };
    if (this.model) this.#cells(pen);
    this.#axes(pen);
    if (this.model) this.#samples(pen);
    this.#hand(pen);
  }

  #at(u, v) {
    const { x, y, width, height } = this.area;
    return [x + Math.min(Math.max(u, 0), 1) * width, y + (1 - Math.min(Math.max(v, 0), 1)) * height];
  }

  #cells(pen) {
    const cells = this.model.cells;
    if (!cells) return;
    cells.forEach((distance, index) => {
      const column = index % 3, row = Math.floor(index / 3);
      const need = lack(distance, this.limits);
      const [x, y] = this.#at(column / 3, (row + 1) / 3);
      pen.fillStyle = `rgba(${need > 0 ? this.colour("far") : this.colour("near")}, ${need > 0 ? 0.12 + 0.5 * need : 0.18})`;
      pen.fillRect(x, y, this.area.width / 3, this.area.height / 3);
      pen.fillStyle = this.colour("faint");
      pen.font = "12px system-ui, sans-serif";
      pen.textAlign = "left";
      pen.fillText(distance.toFixed(2), x + 6, y + 16);
    });
  }

  #axes(pen) {
    const { x, y, width, height } = this.area;
    pen.strokeStyle = this.colour("line");
    pen.lineWidth = 1;
    pen.fillStyle = this.colour("ink");
    pen.font = "12px system-ui, sans-serif";
    for (let i = 0; i <= 3; i++) {
      const [px] = this.#at(i / 3, 0), [, py] = this.#at(0, i / 3);
      pen.beginPath();
      pen.moveTo(px, y); pen.lineTo(px, y + height);
      pen.moveTo(x, py); pen.lineTo(x + width, py);
      pen.stroke();
      pen.textAlign = "center";
      pen.fillText(String(Math.round((i / 3) * this.limits.speed)), px, y + height + 15);
      pen.textAlign = "right";
      pen.fillText(((i / 3) * this.limits.force).toFixed(1), x - 6, py + 4);
    }
    pen.textAlign = "center";
    pen.fillText("speed, mm/s", x + width / 2, y + height + 31);
    pen.save();
    pen.translate(12, y + height / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText("force, N", 0, 0);
    pen.restore();
  }

  #samples(pen) {
    const { points, vertices, triangles } = this.model.arrays;
    if (triangles) {
      pen.strokeStyle = this.colour("faint");
      pen.globalAlpha = 0.45;
      pen.beginPath();
      for (let t = 0; t < triangles.length; t += 3) {
        const corners = [0, 1, 2].map((k) => triangles[t + k]);
        corners.forEach((c, k) => {
          const at = this.#at(vertices[2 * c], vertices[2 * c + 1]);
          k === 0 ? pen.moveTo(...at) : pen.lineTo(...at);
        });
        pen.closePath();
      }
      pen.stroke();
      pen.globalAlpha = 1;
    }
    pen.fillStyle = this.colour("measured");
    for (let i = 0; points && i < points.length; i += 2) {
      pen.beginPath();
      pen.arc(...this.#at(points[i], points[i + 1]), 4, 0, 2 * Math.PI);
      pen.fill();
    }
  }

  #hand(pen) {
    const { speed, force } = this.limits;
    pen.strokeStyle = pen.fillStyle = this.colour("point");
    pen.lineWidth = 2;
    this.trail.forEach((point, i) => {
      const before = this.trail[i - 1];
      if (!point || !before) return;
      pen.globalAlpha = (i + 1) / this.trail.length;
      pen.beginPath();
      pen.moveTo(...this.#at(before[0] / speed, before[1] / force));
      pen.lineTo(...this.#at(point[0] / speed, point[1] / force));
      pen.stroke();
    });
    pen.globalAlpha = 1;
    const now = this.trail.at(-1);
    if (!now) return;
    pen.beginPath();
    pen.arc(...this.#at(now[0] / speed, now[1] / force), 8, 0, 2 * Math.PI);
    pen.fill();
  }
}

/** How much a cell lacks: 0 at a ninth of the stop distance, 1 at twice a ninth of the start's. */
function lack(distance, { start, stop }) {
  const enough = stop / 9, most = (2 * start) / 9;
  return Math.min(Math.max((distance - enough) / (most - enough), 0), 1);
}

/** Say in words where the model lacks samples most. */
function describe(model) {
  if (!model || model.samples === 0) return "No model yet.";
  const count = `${model.samples} samples, order ${model.order}.`;
  if (!model.cells) return count;
  const worst = model.cells.indexOf(Math.max(...model.cells));
  return `${count} Lacks most: ${CELLS[worst % 3]} strokes with ${FORCES[Math.floor(worst / 3)]} force.`;
}
