// The pointer: a finger, a pen, a mouse, or one that arrow keys move.

const MOST_POINTS = 200;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const NO_PRESSURE = [0, 0.5, 1]; // what devices report that do not measure it

export class Pointer {
  /** `grid` finds tiles, `settings()` gives mmPerPx, force and speed. */
  constructor(grid, settings) {
    Object.assign(this, { grid, settings });
    this.points = [];
    this.tile = null;
    this.presses = false;
    this.keys = new Set();
    const node = grid.node;
    node.addEventListener("pointerdown", (event) => this.#down(event));
    node.addEventListener("pointermove", (event) => this.#move(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      node.addEventListener(name, (event) => { if (event.pointerId === this.id) this.lift(); });
    }
    node.addEventListener("contextmenu", (event) => event.preventDefault());
    node.addEventListener("keydown", (event) => this.#key(event, true));
    addEventListener("keyup", (event) => this.#key(event, false));
    addEventListener("blur", () => this.lift());
  }

  /** Return where the pointer is, and what it did since the last call. */
  read() {
    if (this.keys.size) this.#stroke();
    const read = { tile: this.tile, points: this.points, moved: this.points.at(-1)?.[0] };
    this.points = [];
    return read;
  }

  lift() {
    this.id = undefined;
    this.keys.clear();
    this.virtual = undefined;
    this.#leave();
  }

  #leave() {
    this.tile = null;
    this.points = [];
    this.grid.point(null);
  }

  #down(event) {
    if (this.id !== undefined || event.button !== 0) return;
    this.lift();
    this.id = event.pointerId;
    this.grid.node.setPointerCapture(event.pointerId);
    this.#add(event);
  }

  #move(event) {
    if (event.pointerId !== this.id) return;
    const each = event.getCoalescedEvents?.() ?? [];
    for (const one of each.length ? each : [event]) this.#add(one);
  }

  #add(event) {
    const tile = this.grid.at(event.clientX, event.clientY);
    if (tile === null) {
      this.#leave();
      return;
    }
    if (tile !== this.tile) {
      this.points = [];
      this.grid.choose(tile);
    }
    this.tile = tile;
    this.grid.point(tile, event.clientX, event.clientY);
    const { mmPerPx, force } = this.settings();
    if (!this.presses && event.pressure > 0 && !NO_PRESSURE.includes(event.pressure)) this.presses = true;
    const share = this.presses && event.pointerType !== "mouse" ? event.pressure : 1;
    this.#put(event.timeStamp, event.clientX * mmPerPx, -event.clientY * mmPerPx, force * share);
  }

  #put(time, x, y, force) {
    this.points.push([time, x, y, force]);
    if (this.points.length > MOST_POINTS) this.points.shift();
  }

  #key(event, down) {
    if (!(event.key in ARROWS)) return;
    if (!down) {
      this.keys.delete(event.key);
      if (!this.keys.size && this.virtual) this.lift();
      return;
    }
    const tile = this.grid.focused();
    if (tile === null || this.id !== undefined) return;
    event.preventDefault();
    this.keys.add(event.key);
    if (this.virtual?.tile === tile) return;
    const box = this.grid.box(tile);
    this.grid.choose(tile);
    this.virtual = { tile, x: box.left + box.width / 2, y: box.top + box.height / 2, side: [1, 1], time: performance.now() };
  }

  /** Move on by arrow keys; at an edge the stroke turns round. */
  #stroke() {
    const { mmPerPx, force, speed } = this.settings();
    const at = this.virtual;
    const now = performance.now();
    const way = [0, 0];
    for (const key of this.keys) ARROWS[key].forEach((part, axis) => { way[axis] += part; });
    const length = Math.hypot(...way) || 1;
    const px = (speed / mmPerPx) * Math.min(now - at.time, 50) * 1e-3;
    at.time = now;
    const box = this.grid.box(at.tile);
    at.x = turn(at, 0, at.x + (at.side[0] * way[0] * px) / length, box.left + 8, box.right - 8);
    at.y = turn(at, 1, at.y - (at.side[1] * way[1] * px) / length, box.top + 8, box.bottom - 8);
    this.tile = at.tile;
    this.grid.point(at.tile, at.x, at.y);
    this.#put(now, at.x * mmPerPx, -at.y * mmPerPx, force);
  }
}

/** Keep a coordinate within bounds, and turn round at them. */
function turn(at, axis, value, low, high) {
  if (value > low && value < high) return value;
  at.side[axis] = -at.side[axis];
  return Math.min(Math.max(value, low), high);
}
