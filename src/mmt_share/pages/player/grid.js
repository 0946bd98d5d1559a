// The grid of textures: their pictures, which one is touched, chosen or asked for.

const letter = (tile) => String.fromCharCode(65 + tile);

export class Grid {
  /** `onChoose(tile)` is told which tile was touched or focused last. */
  constructor(node, onChoose) {
    Object.assign(this, { node, onChoose });
    this.tiles = [];
    this.chosen = null;
    this.pointed = null;
    this.boxes = [];
    new ResizeObserver(() => this.moved()).observe(node);
    addEventListener("scroll", () => this.moved(), { passive: true });
    addEventListener("resize", () => this.moved());
  }

  /** Make a tile for each texture; those that are there already stay, and what is done on them. */
  make(names, pictures) {
    if (JSON.stringify(names) === JSON.stringify(this.names)) return;
    this.names = names;
    this.moved();
    this.pictures = names.map((_, index) => painted(index, pictures, names.length));
    this.tiles = names.map((_, tile) => this.#tile(tile));
    this.node.replaceChildren(...this.tiles);
    this.shown = undefined;
    this.show(names.map((_, index) => index));
  }

  /** Show which texture each tile is; null hides it. */
  show(textures) {
    const key = JSON.stringify(textures);
    if (key === this.shown) return;
    this.shown = key;
    this.tiles.forEach((node, tile) => {
      const texture = textures?.[tile] ?? null;
      const name = texture === null ? letter(tile) : `${letter(tile)} ${this.names[texture]}`;
      node.classList.toggle("hidden", texture === null);
      node.setAttribute("aria-label", texture === null ? `hidden texture ${name}` : name);
      node.querySelector("b").textContent = name;
      const canvas = node.querySelector("canvas");
      canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
      if (texture !== null) canvas.getContext("2d").putImageData(this.pictures[texture], 0, 0);
    });
    this.choose(null);
  }

  /** Mark tiles by classes: `marks(tile)` gives those that hold. */
  mark(marks) {
    this.tiles.forEach((node, tile) => {
      const given = marks(tile);
      for (const name of ["asked", "off", "right", "wrong"]) node.classList.toggle(name, given.includes(name));
    });
  }

  choose(tile) {
    if (tile === this.chosen) return;
    this.chosen = tile;
    this.tiles.forEach((node, index) => node.classList.toggle("chosen", index === tile));
    this.onChoose(tile);
  }

  focus(tile) {
    this.tiles[tile]?.focus();
  }

  focused() {
    const tile = this.tiles.indexOf(document.activeElement);
    return tile < 0 ? null : tile;
  }

  at(x, y) {
    const tile = this.tiles.findIndex((_, index) => {
      const box = this.box(index);
      return x >= box.left && x < box.right && y >= box.top && y < box.bottom;
    });
    return tile < 0 ? null : tile;
  }

  /** Return where a tile is on the screen; kept, since asking costs the browser a layout. */
  box(tile) {
    this.boxes[tile] ??= this.tiles[tile].getBoundingClientRect();
    return this.boxes[tile];
  }

  /** Forget where tiles are: the page has been laid out anew. */
  moved() {
    this.boxes = [];
  }

  /** Show where the pointer is, at the next picture of the screen. */
  point(tile, x, y) {
    this.pointer = tile === null ? null : { tile, x, y };
    if (this.drawing) return;
    this.drawing = true;
    requestAnimationFrame(() => this.#draw());
  }

  #draw() {
    this.drawing = false;
    const tile = this.pointer?.tile ?? null;
    if (tile !== this.pointed) {
      this.tiles[this.pointed]?.classList.remove("touched");
      this.tiles[tile]?.classList.add("touched");
      this.pointed = tile;
    }
    if (tile === null) return;
    const box = this.box(tile), dot = this.tiles[tile].lastChild;
    dot.style.transform = `translate(${this.pointer.x - box.left}px, ${this.pointer.y - box.top}px)`;
  }

  #tile(tile) {
    const node = document.createElement("div");
    node.className = "tile";
    node.tabIndex = 0;
    node.setAttribute("role", "button");
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = this.pictures[tile].width;
    node.append(canvas, document.createElement("b"), document.createElement("i"));
    node.addEventListener("focus", () => this.choose(tile));
    return node;
  }
}

/** Paint a relief in grey: colours have a meaning. */
function painted(index, pictures, count) {
  const size = Math.round(Math.sqrt(pictures.length / count));
  const image = new ImageData(size, size);
  for (let i = 0; i < size * size; i++) {
    const share = Math.min(1, Math.max(0, 0.5 + pictures[index * size * size + i] / 5));
    image.data.set([0, 1, 2].map(() => 40 + 180 * share), 4 * i);
    image.data[4 * i + 3] = 255;
  }
  return image;
}
