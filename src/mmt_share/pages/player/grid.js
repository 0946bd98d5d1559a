// The grid of textures: their pictures, which one is touched, chosen or asked for.

export const letter = (tile) => String.fromCharCode(65 + tile);

export class Grid {
  constructor(node) {
    this.node = node;
    this.tiles = [];
    this.chosen = null;
    this.pointed = null;
    this.boxes = [];
    new ResizeObserver(() => this.moved()).observe(node);
    addEventListener("scroll", () => this.moved(), { passive: true });
    addEventListener("resize", () => this.moved());
  }

  /** Make a tile for each texture; if the names are the same as before, the tiles stay. */
  make(names) {
    if (JSON.stringify(names) === JSON.stringify(this.names)) return;
    this.names = names;
    this.pictures = [];
    this.shown = null;
    this.tiles = names.map((_, tile) => this.#tile(tile));
    this.node.replaceChildren(...this.tiles);
    this.show(names.map((_, index) => index));
  }

  /** Show a texture's picture on the tile that has it. */
  paint(texture, relief) {
    this.pictures[texture] = painted(relief);
    this.tiles.forEach((_, tile) => { if (this.shown[tile] === texture) this.#paint(tile); });
  }

  /** Show a sentence across a tile until it is touched. */
  caption(tile, sentence) {
    const node = this.tiles[tile].querySelector("p");
    node.replaceChildren();
    if (sentence) node.append(Object.assign(document.createElement("span"), { textContent: sentence }));
  }

  /** Show which texture each tile is; null hides it. */
  show(textures) {
    if (JSON.stringify(textures) === JSON.stringify(this.shown)) return;
    this.shown = textures;
    this.tiles.forEach((node, tile) => {
      const texture = textures[tile];
      const name = texture === null ? letter(tile) : `${letter(tile)} ${this.names[texture]}`;
      node.classList.toggle("hidden", texture === null);
      node.setAttribute("aria-label", texture === null ? `hidden texture ${name}` : name);
      node.querySelector("b").textContent = name;
      this.#paint(tile);
    });
    this.choose(null);
  }

  #paint(tile) {
    const canvas = this.tiles[tile].querySelector("canvas"), picture = this.pictures[this.shown[tile]];
    canvas.width = canvas.height = picture?.width ?? 1; // which clears it
    if (picture !== undefined) canvas.getContext("2d").putImageData(picture, 0, 0);
  }

  /** Mark tiles by classes: `marks(tile)` gives those that hold. */
  mark(marks) {
    this.tiles.forEach((node, tile) => {
      const given = marks(tile);
      for (const name of ["asked", "off", "right", "wrong"]) node.classList.toggle(name, given.includes(name));
    });
  }

  choose(tile) {
    this.chosen = tile;
    this.tiles.forEach((node, index) => node.classList.toggle("chosen", index === tile));
  }

  focus(tile) {
    this.tiles[tile]?.focus();
    if (tile in this.tiles) this.choose(tile); // one that has had the focus, too
  }

  focused() {
    return this.tiles.includes(document.activeElement);
  }

  at(x, y) {
    const tile = this.tiles.findIndex((_, index) => {
      const box = this.box(index);
      return x >= box.left && x < box.right && y >= box.top && y < box.bottom;
    });
    return tile < 0 ? null : tile;
  }

  /** Return the box of a tile on the screen; cached, since asking costs the browser a layout. */
  box(tile) {
    this.boxes[tile] ??= this.tiles[tile].getBoundingClientRect();
    return this.boxes[tile];
  }

  /** Forget where tiles are: the page has been laid out anew. */
  moved() {
    this.boxes = [];
  }

  /** Show where the pointer is, in the next animation frame. */
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
    const box = this.box(tile);
    this.#place(tile, "own", this.pointer.x - box.left, this.pointer.y - box.top);
  }

  /** Show where the leader's hand strokes the first tile, as shares of its width and height; null if it does not. */
  lead(place) {
    this.tiles[0]?.classList.toggle("led", place !== null);
    if (place !== null) this.#place(0, "leader", place[0] * this.box(0).width, place[1] * this.box(0).height);
  }

  #place(tile, whose, x, y) {
    this.tiles[tile].querySelector(`.${whose}`).style.transform = `translate(${x}px, ${y}px)`;
  }

  #tile(tile) {
    const node = document.createElement("div");
    node.className = "tile";
    node.tabIndex = 0;
    node.setAttribute("role", "button");
    node.append(...["canvas", "b", "p", "i", "i"].map((name) => document.createElement(name)));
    [...node.querySelectorAll("i")].forEach((dot, index) => { dot.className = ["leader", "own"][index]; });
    node.addEventListener("focus", () => this.choose(tile));
    return node;
  }
}

/** Paint a relief in grey: colours have a meaning. */
function painted(relief) {
  const size = Math.sqrt(relief.length);
  const image = new ImageData(size, size);
  relief.forEach((height, i) => image.data.set([...Array(3).fill(40 + 180 * Math.min(1, Math.max(0, 0.5 + height / 5))), 255], 4 * i));
  return image;
}
