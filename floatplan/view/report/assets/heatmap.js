"use strict";
/* The map: rows gathered into cells, each of which shows its best row. */

const MARGIN = { left: 62, right: 12, top: 8, bottom: 46 };
const BETWEEN = 64; // pixels, of two numbers on the scale
const SOLVED = 2; // statuses below it hold a plan
const WORST_FIRST = [0, 0, 1, 2, 3]; // which status a cell without a plan shows: impossible only where all are

class HeatMap {
  constructor(rows, holder, bar) {
    this.rows = rows;
    this.holder = holder;
    this.cells = holder.querySelector("#cells");
    this.marks = holder.querySelector("#marks");
    this.bar = bar;
    this.hovered = this.selected = null;
    new ResizeObserver(() => this.resize()).observe(holder);
    paint(() => this.resize());
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
    this.resize();
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
    if (!Number.isFinite(value)) return tone("paper");
    return this.rows.scale[Math.round(this.share(value) * (this.rows.scale.length - 1))];
  }

  /* Where a value is on the scale, from 0 to 1. */
  share(value) {
    const [low, high] = this.range;
    const at = this.isLogarithmic ? Math.log : (number) => number;
    return high > low ? Math.min((at(value) - at(low)) / (at(high) - at(low)), 1) : 0;
  }

  resize() {
    if (!this.x) return;
    const { clientWidth: width, clientHeight: height } = this.holder;
    for (const canvas of [this.cells, this.marks]) fit(canvas, width, height);
    this.plot = [MARGIN.left, MARGIN.top, width - MARGIN.right, height - MARGIN.bottom];
    this.drawCells();
    this.drawMarks();
    this.drawBar();
  }

  /* Screen from values. */
  across(value) {
    return this.plot[0] + shareOf(this.x.edges, value) * (this.plot[2] - this.plot[0]);
  }

  up(value) {
    return this.plot[3] - shareOf(this.y.edges, value) * (this.plot[3] - this.plot[1]);
  }

  box(place) {
    const [column, line] = [place % this.width, Math.floor(place / this.width)];
    const [left, right] = [column, column + 1].map((edge) => this.across(this.x.edges[edge]));
    const [low, top] = [line, line + 1].map((edge) => this.up(this.y.edges[edge]));
    return [left, top, right - left, low - top];
  }

  drawCells() {
    const pen = cleared(this.cells);
    const ratio = window.devicePixelRatio || 1;
    const sharp = (place) => Math.round(place * ratio) / ratio;
    const across = Array.from(this.x.edges, (edge) => sharp(this.across(edge)));
    const up = Array.from(this.y.edges, (edge) => sharp(this.up(edge)));
    this.row.forEach((row, place) => {
      if (row < 0) return;
      const [column, line] = [place % this.width, Math.floor(place / this.width)];
      pen.fillStyle = this.colour(row);
      pen.fillRect(across[column], up[line + 1], across[column + 1] - across[column], up[line] - up[line + 1]);
    });
    this.drawAxes(pen);
  }

  drawAxes(pen) {
    const [left, top, right, low] = this.plot;
    pen.strokeStyle = pen.fillStyle = tone("ink");
    pen.lineWidth = 1;
    pen.strokeRect(left - 0.5, top - 0.5, right - left + 1, low - top + 1);
    pen.textAlign = "center";
    for (const value of ticks(this.x.edges, (right - left) / 80)) {
      pen.fillRect(this.across(value) - 0.5, low, 1, 5);
      pen.fillText(shortNumber(value), this.across(value), low + 18);
    }
    pen.fillText(this.x.label, (left + right) / 2, low + 38);
    pen.textAlign = "right";
    for (const value of ticks(this.y.edges, (low - top) / 50)) {
      pen.fillRect(left - 5, this.up(value) - 0.5, 5, 1);
      pen.fillText(shortNumber(value), left - 8, this.up(value) + 4);
    }
    pen.textAlign = "center";
    pen.translate(14, (top + low) / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText(this.y.label, 0, 0);
  }

  drawMarks() {
    const pen = cleared(this.marks);
    const selected = this.selected === null ? null : this.placeOf(this.selected);
    for (const [place, width] of [[this.hovered, 1.5], [selected, 2.5]]) {
      if (place === null) continue;
      const [x, y, w, h] = this.box(place);
      const [mx, my] = [Math.max(0, (9 - w) / 2), Math.max(0, (9 - h) / 2)];
      for (const [colour, extra] of [["#ffffff", 2], ["#222222", 0]]) {
        pen.strokeStyle = colour;
        pen.lineWidth = width + extra;
        pen.strokeRect(x - mx, y - my, w + 2 * mx, h + 2 * my);
      }
    }
  }

  drawBar() {
    const width = this.bar.clientWidth;
    fit(this.bar, width, 50);
    const pen = cleared(this.bar);
    if (!this.range) return;
    const [left, right] = [MARGIN.left, width - MARGIN.right];
    const { scale } = this.rows;
    scale.forEach((colour, index) => {
      pen.fillStyle = colour;
      const from = left + ((right - left) * index) / scale.length;
      pen.fillRect(from, 2, (right - left) / scale.length + 1, 12);
    });
    pen.fillStyle = tone("ink");
    pen.textAlign = "left";
    pen.fillText(shortNumber(this.range[0], 4), left, 28);
    pen.textAlign = "right";
    pen.fillText(`${this.isCut ? "≥ " : ""}${shortNumber(this.range[1], 4)}`, right, 28);
    pen.textAlign = "center";
    const room = (right - left) / BETWEEN;
    let last = left + BETWEEN / 2;
    const many = this.rows.data.colours.many_decades;
    const marks = this.isLogarithmic ? logarithmicTicks(...this.range, many) : ticks(this.range, room);
    for (const value of marks) {
      const place = left + this.share(value) * (right - left);
      if (place < last + BETWEEN / 2 || place > right - BETWEEN) continue;
      pen.fillRect(place - 0.5, 14, 1, 4);
      pen.fillText(shortNumber(value), place, 28);
      last = place;
    }
    pen.fillText(this.rows.label(this.z) + (this.isLogarithmic ? ", logarithmic" : ""), (left + right) / 2, 44);
  }

  placeOf(row) {
    return this.y.cell[row] * this.width + this.x.cell[row];
  }

  /* Cell under a point of the screen; null where there is none. */
  at(x, y) {
    const [left, top, right, low] = this.plot;
    if (x < left || x > right || y < top || y > low) return null;
    const find = (edges, share) => cellOf(edges, edges[0] + share * (edges.at(-1) - edges[0]));
    const column = find(this.x.edges, (x - left) / (right - left));
    const place = find(this.y.edges, (low - y) / (low - top)) * this.width + column;
    return this.row[place] < 0 ? null : place;
  }

  hover(place) {
    this.hovered = place;
    this.drawMarks();
  }

  select(row) {
    this.selected = row;
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

/* Where a value is between the first and the last edge. */
function shareOf(edges, value) {
  return (value - edges[0]) / (edges.at(-1) - edges[0]);
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

/* Round values between the first and the last edge, about as many as there is room for. */
function ticks(edges, room) {
  const [low, high] = [edges[0], edges.at(-1)];
  const rough = (high - low) / Math.max(room, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough);
  const first = Math.ceil(low / step - 1e-9);
  const count = Math.floor(high / step + 1e-9) - first;
  return Array.from({ length: Math.max(count + 1, 0) }, (_, index) => (first + index) * step);
}

/* 1, 2 and 5 times the powers of ten from low to high, where these are few; else the powers alone. */
function logarithmicTicks(low, high, many) {
  const factors = high / low < many ? [1, 2, 5] : [1];
  const [first, last] = [low, high].map((end) => Math.floor(Math.log10(end)));
  const powers = Array.from({ length: last - first + 1 }, (_, index) => 10 ** (first + index));
  const values = powers.flatMap((power) => factors.map((factor) => factor * power));
  return values.filter((value) => value >= low && value <= high);
}

function shortNumber(value, digits = 6) {
  if (!Number.isFinite(value)) return "–";
  const text = Number(value.toPrecision(digits));
  return Math.abs(text) >= 1e6 || (text !== 0 && Math.abs(text) < 1e-4) ? text.toExponential() : String(text);
}
