"use strict";
/* Puts the page of a map together. */

class Rows {
  constructor(data, numbers) {
    this.data = data;
    this.numbers = numbers;
    this.count = data.count;
    this.status = new Uint8Array(numbers, ...data.status);
    this.statuses = data.colours.statuses;
    this.scale = data.colours.scale;
    this.columns = {};
    this.axes = Object.fromEntries(data.axes.map((axis) => [axis.key, { ...axis, label: this.label(axis.key) }]));
    this.explanation = new Uint32Array(numbers, ...data.explanation.index);
    this.coefficients = new Float32Array(numbers, ...data.coefficients.values);
  }

  column(name) {
    this.columns[name] ??= new Float32Array(this.numbers, ...this.data.columns[name].values);
    return this.columns[name];
  }

  axis(key) {
    const axis = this.axes[key];
    axis.cell ??= Int32Array.from(this.column(key), (value) => cellOf(axis.edges, value));
    return axis;
  }

  label(name) {
    return this.data.columns[name]?.label ?? name;
  }

  shown(name, row) {
    const value = this.column(name)[row];
    const digits = name in this.axes ? 6 : 4; // what was asked for, and what was found
    return Number.isNaN(value) ? "–" : `${shortNumber(value, digits)} ${this.data.columns[name].unit}`.trim();
  }

  coefficientsOf(row) {
    const { size } = this.data.coefficients;
    const values = this.coefficients.slice(row * size, (row + 1) * size);
    return size && !Number.isNaN(values[0]) ? Array.from(values, (value) => (Number.isNaN(value) ? 0 : value)) : null;
  }
}

const CALM = matchMedia("(prefers-reduced-motion: reduce)"); // whether the reader asks for less motion

function fillSelect(select, options, chosen) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  select.value = chosen;
}

class Page {
  constructor(data, numbers) {
    this.data = data;
    this.rows = new Rows(data, numbers);
    this.flight = data.flight && new Flight(data.flight);
    this.holder = document.getElementById("map");
    this.tip = document.getElementById("tip");
    this.film = document.getElementById("stage");
    this.map = new HeatMap(this.rows, this.holder, document.getElementById("bar"));
    this.stage = this.player = null;
    this.fixed = new Map();
    this.ofPlans = []; // swatches of statuses with a plan: the map has their colours only where it shows the status
    this.fill();
    this.listen();
    this.redraw();
  }

  fill() {
    const { data, rows } = this;
    const keys = data.axes.map((axis) => [axis.key, rows.label(axis.key)]);
    const colours = ["status", ...Object.keys(data.columns)].map((name) => [name, rows.label(name)]);
    this.selects = ["across", "up", "colour"].map((id) => document.getElementById(id));
    this.selects.forEach((select, index) => fillSelect(select, index < 2 ? keys : colours, data.map[index]));
    this.cut = document.getElementById("cut");
    const key = document.getElementById("key");
    const counts = rows.statuses.map((_, index) => rows.status.reduce((sum, one) => sum + (one === index), 0));
    rows.statuses.forEach(({ colour, words }, index) => {
      if (!counts[index]) return;
      const mark = make("i", "swatch bar");
      mark.style.background = colour;
      addKey(key, mark, `${words} (${counts[index]})`);
      if (index < SOLVED) this.ofPlans.push(mark);
    });
    this.empty = addKey(key, make("i", "swatch bar none"), "no row");
    this.nothing = this.film.appendChild(make("p", "nothing", "Choose a point of the map."));
  }

  listen() {
    const [across, up] = this.selects;
    this.selects.forEach((select) =>
      select.addEventListener("change", () => {
        if (across.value === up.value) {
          const other = select === across ? up : across;
          other.value = this.data.axes.find((axis) => axis.key !== select.value).key;
        }
        this.redraw();
      }),
    );
    this.cut.addEventListener("change", () => this.redraw());
    this.holder.addEventListener("pointermove", (event) => this.onMove(event));
    this.holder.addEventListener("pointerleave", () => this.leave());
    this.holder.addEventListener("click", (event) => {
      const place = this.map.at(event);
      if (place === null) return;
      this.choose(this.map.row[place]);
      this.film.scrollIntoView({ block: "nearest", behavior: CALM.matches ? "auto" : "smooth" });
    });
    this.holder.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      const first = this.map.row.find((row) => row >= 0);
      this.choose(this.map.selected === null ? first : this.map.beside(this.map.selected, ...step));
    });
  }

  redraw() {
    const [x, y, z] = this.selects.map((select) => select.value);
    const others = this.data.axes.filter((axis) => axis.key !== x && axis.key !== y);
    document.getElementById("others").replaceChildren(...others.map((axis) => this.slice(axis)));
    this.map.show(x, y, z, others.map((axis) => [axis.key, this.fixed.get(axis.key) ?? null]), this.cut.checked);
    this.ofPlans.forEach((swatch) => (swatch.style.display = z === "status" ? "" : "none"));
    this.empty.style.display = this.map.row.includes(-1) ? "" : "none";
    this.leave();
  }

  /* The choice of a value for a key that is on no axis. */
  slice(axis) {
    const label = make("label", "", `${this.rows.label(axis.key)} `);
    const select = label.appendChild(make("select"));
    const cells = axis.values.map((value, index) => [String(index), shortNumber(value)]);
    const chosen = this.fixed.get(axis.key);
    fillSelect(select, [["best", "the best"], ...cells], chosen === undefined ? "best" : String(chosen));
    select.addEventListener("change", () => {
      if (select.value === "best") this.fixed.delete(axis.key);
      else this.fixed.set(axis.key, Number(select.value));
      this.redraw();
    });
    return label;
  }

  onMove(event) {
    if (event.pointerType === "touch") return;
    const place = this.map.at(event);
    if (place === null) return this.leave();
    const box = this.holder.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    this.map.mark("hovered", place);
    const row = this.map.row[place];
    const names = [...this.data.axes.map((axis) => axis.key), ...(this.map.values ? [this.map.z] : [])];
    const lines = [...new Set(names)].map((name) => `${name}: ${this.rows.shown(name, row)}`);
    this.tip.textContent = [this.rows.statuses[this.rows.status[row]].name.replace("_", " "), ...lines].join("\n");
    this.tip.hidden = false;
    const { offsetWidth: width, offsetHeight: height } = this.tip;
    this.tip.style.left = `${x + width + 24 > this.holder.clientWidth ? Math.max(x - width - 12, 0) : x + 16}px`;
    this.tip.style.top = `${Math.min(y + 12, Math.max(this.holder.clientHeight - height, 0))}px`;
  }

  leave() {
    this.tip.hidden = true;
    if (this.map.x) this.map.mark("hovered", null);
  }

  choose(row) {
    this.map.mark("selected", row);
    const { rows, data } = this;
    const text = data.explanation.texts[rows.explanation[row]];
    document.getElementById("verdict").textContent = `Row ${row}: ${rows.statuses[rows.status[row]].words}. ${text}`;
    const list = document.getElementById("values");
    const found = Object.keys(data.columns).map((name) => [make("dt", "", name), make("dd", "", rows.shown(name, row))]);
    list.replaceChildren(...found.flat());
    this.fly(row);
  }

  fly(row) {
    const coefficients = this.flight && this.rows.coefficientsOf(row);
    this.nothing.hidden = Boolean(coefficients);
    if (this.player) this.player.pause();
    if (!coefficients) {
      this.nothing.textContent = "No motion of this row is kept.";
      return;
    }
    const values = this.data.axes.map((axis) => [axis.key, this.rows.column(axis.key)[row] * axis.factor]);
    const motion = this.flight.motion(this.flight.problem(values), this.rows.column("angular_momentum")[row], coefficients);
    if (!this.stage) {
      this.stage = new Stage(motion, this.film);
      this.player = new Player(motion.duration, (time) => this.stage.draw(time));
    } else {
      this.stage.take(motion);
      this.player.take(motion.duration);
    }
    if (!CALM.matches) this.player.play();
  }
}

const [data, numbers] = ["data", "numbers"].map((id) => document.getElementById(id).textContent);
window.floatplan = new Page(JSON.parse(data), Uint8Array.from(atob(numbers), (letter) => letter.charCodeAt(0)).buffer);
