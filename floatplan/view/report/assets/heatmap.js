"use strict";
/* The map: rows gathered into cells, each of which shows its best row. */

const LEFT = 62; // pixels, of what is beside a plot
const AXIS_LABEL = 18; // pixels, of an axis's name
const FONT = "12px system-ui, sans-serif";
const SOLVED = 2; // statuses below it hold a plan
const WORST_FIRST = [0, 0, 1, 2, 3]; // which status a cell without a plan shows: impossible only where all are

class HeatMap {
  constructor(rows, holder, bar) {
    this.rows = rows;
    this.holder = holder;
    this.bar = bar;
    this.hovered = this.selected = null;
    new ResizeObserver(() => this.build()).observe(holder);
    DARK.addEventListener("change", () => this.build());
  }

  /* Show a column over two keys; `fixed` are the cells that other keys are held in, null where the best is shown. */
  show(x, y, z, fixed, cut) {
    const { rows } = this;
    this.x = rows.axis(x);
    this.y = rows.axis(y);
    this.z = z;
    this.width = this.x.edges.length - 1;
    this.height = this.y.edges.length - 1;
    this.row = new Int32Array(this.width * this.height).fill(-1);
    this.values = z === "status" ? null : rows.column(z);
    const sign = z === "clearance" ? -1 : 1;
    const held = fixed.filter(([, cell]) => cell !== null).map(([key, cell]) => [rows.axis(key).cell, cell]);
    for (let index = 0; index < rows.count; index++) {
      if (held.some(([cells, cell]) => cells[index] !== cell)) continue;
      const known = this.row[this.placeOf(index)];
      if (known < 0 || this.isBetter(index, known, sign)) this.row[this.placeOf(index)] = index;
    }
    this.findRange(cut);
    this.hovered = null;
    this.build();
  }

  isBetter(one, other, sign) {
    const [a, b] = [this.rows.status[one], this.rows.status[other]];
    if (WORST_FIRST[a] !== WORST_FIRST[b]) return WORST_FIRST[a] < WORST_FIRST[b];
    if (!this.values || a >= SOLVED) return a < b;
    const [mine, its] = [this.values[one], this.values[other]];
    return sign * mine < sign * its || (Number.isNaN(its) && !Number.isNaN(mine));
  }

  findRange(cut) {
    const hasColour = (row) => row >= 0 && this.rows.status[row] < SOLVED && Number.isFinite(this.values[row]);
    const shown = Float32Array.from(this.values ? this.row.filter(hasColour) : [], (row) => this.values[row]).sort();
    this.range = shown.length ? [shown[0], shown[Math.floor((cut ? 0.98 : 1) * (shown.length - 1))]] : null;
    const { logarithmic } = this.rows.data.colours;
    this.isLogarithmic = this.range !== null && this.range[0] > 0 && this.range[1] > logarithmic * this.range[0];
    this.isCut = cut && shown.length > 0 && this.range[1] < shown[shown.length - 1];
  }

  colour(row) {
    const status = this.rows.status[row];
    const value = this.values ? this.values[row] : NaN;
    if (!this.values || status >= SOLVED) return this.rows.statuses[status].colour;
    if (!Number.isFinite(value)) return painted("var(--paper)");
    return this.rows.scale[Math.round(this.share(value) * (this.rows.scale.length - 1))];
  }

  /* Where a value is on the scale, from 0 to 1. */
  share(value) {
    const [low, high] = this.range;
    const at = this.isLogarithmic ? Math.log : (number) => number;
    return high > low ? Math.min((at(value) - at(low)) / (at(high) - at(low)), 1) : 0;
  }

  build() {
    if (!this.x) return;
    if (this.plot) this.plot.destroy();
    const [x, y] = [this.x, this.y].map(({ edges }) => scaleOver(edges[0], edges.at(-1)));
    this.plot = drawnAxes(this.holder, [x, y], {
      height: this.holder.clientHeight,
      axes: [axis(this.x.label), { ...axis(this.y.label), size: LEFT - AXIS_LABEL }],
      hooks: { drawClear: [() => this.drawCells()], draw: [() => this.drawMarks()] },
    });
    this.marks = ["hovered", "selected"].map((name) => this.plot.over.appendChild(make("div", `mark ${name}`)));
    this.bar.replaceChildren();
    if (this.range) this.drawBar();
  }

  drawCells() {
    const sharp = (name, edge) => Math.round(this.plot.valToPos(edge, name, true));
    const across = Array.from(this.x.edges, (edge) => sharp("x", edge));
    const up = Array.from(this.y.edges, (edge) => sharp("y", edge));
    this.row.forEach((row, place) => {
      if (row < 0) return;
      const [column, line] = [place % this.width, Math.floor(place / this.width)];
      this.plot.ctx.fillStyle = this.colour(row);
      this.plot.ctx.fillRect(across[column], up[line + 1], across[column + 1] - across[column], up[line] - up[line + 1]);
    });
  }

  drawBar() {
    const [low, high] = this.range;
    const ends = `${shortNumber(low, 4)} to ${this.isCut ? "≥ " : ""}${shortNumber(high, 4)}`;
    const scale = { ...scaleOver(low, high), distr: this.isLogarithmic ? 3 : 1 };
    const name = [this.rows.label(this.z), ends, ...(this.isLogarithmic ? ["logarithmic"] : [])].join(", ");
    const plot = drawnAxes(this.bar, [scale, {}], {
      height: this.bar.clientHeight,
      axes: [axis(name), { show: false }],
      padding: [0, 12, 0, LEFT],
    });
    plot.over.style.background = `linear-gradient(to right, ${this.rows.scale})`;
  }

  /* Left, top, width and height of a cell, in pixels of the plot. */
  box(place) {
    const [column, line] = [place % this.width, Math.floor(place / this.width)];
    const [left, right] = [column, column + 1].map((edge) => this.plot.valToPos(this.x.edges[edge], "x"));
    const [low, top] = [line, line + 1].map((edge) => this.plot.valToPos(this.y.edges[edge], "y"));
    return [left, top, right - left, low - top];
  }

  drawMarks() {
    if (!this.plot) return;
    [this.hovered, this.selected === null ? null : this.placeOf(this.selected)].forEach((place, index) => {
      const mark = this.marks[index];
      mark.hidden = place === null;
      if (place === null) return;
      const [left, top, width, height] = this.box(place);
      Object.entries({ left: left + width / 2, top: top + height / 2, width, height }).forEach(
        ([side, pixels]) => (mark.style[side] = `${pixels}px`),
      );
    });
  }

  placeOf(row) {
    return this.y.cell[row] * this.width + this.x.cell[row];
  }

  /* Cell under a pointer; null where there is none. */
  at({ clientX, clientY }) {
    const { left, top } = this.plot.over.getBoundingClientRect();
    const [x, y] = [this.plot.posToVal(clientX - left, "x"), this.plot.posToVal(clientY - top, "y")];
    const isInside = ({ edges }, value) => value >= edges[0] && value <= edges.at(-1);
    if (!isInside(this.x, x) || !isInside(this.y, y)) return null;
    const place = cellOf(this.y.edges, y) * this.width + cellOf(this.x.edges, x);
    return this.row[place] < 0 ? null : place;
  }

  /* Mark the cell that is hovered, or that of the row that is selected. */
  mark(name, what) {
    this[name] = what;
    this.drawMarks();
  }

  /* The cell beside a row's, where there is one. */
  beside(row, dx, dy) {
    const [column, line] = [this.x.cell[row] + dx, this.y.cell[row] + dy];
    if (column < 0 || line < 0 || column >= this.width || line >= this.height) return row;
    const next = this.row[line * this.width + column];
    return next < 0 ? row : next;
  }
}

/* A scale from one value to another, which is larger or the same. */
function scaleOver(low, high) {
  return { time: false, range: [low, high > low ? high : low + 1] };
}

function axis(label) {
  const [stroke, grid] = [() => painted("var(--ink)"), { show: false }];
  const look = { stroke, grid, ticks: { stroke, size: 5, width: 1 }, font: FONT, size: 26 };
  const values = (_, splits) => splits.map((value) => (value === null ? "" : shortNumber(value, 4)));
  return { ...look, label, labelFont: FONT, labelSize: AXIS_LABEL, labelGap: 2, values };
}

/* A plot of nothing but its axes. */
function drawnAxes(holder, [x, y], options) {
  const still = { legend: { show: false }, cursor: { show: false }, series: [{}, { points: { show: false } }] };
  const size = { width: holder.clientWidth, padding: [8, 12, 0, 0] };
  return new uPlot({ ...still, ...size, scales: { x, y }, ...options }, [x.range, y.range || [0, 1]], holder);
}

/* The cell that holds a value, or is nearest to it. */
function cellOf(edges, value) {
  let [low, high] = [0, edges.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (edges[middle] <= value) low = middle;
    else high = middle;
  }
  return low;
}

function shortNumber(value, digits = 6) {
  if (!Number.isFinite(value)) return "–";
  const text = Number(value.toPrecision(digits));
  return Math.abs(text) >= 1e6 || (text !== 0 && Math.abs(text) < 1e-4) ? text.toExponential() : String(text);
}
