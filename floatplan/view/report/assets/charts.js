"use strict";
/* The curves: one uPlot each, a line that follows the time, and the values at it. Dragging along a curve seeks. */

const CHART_HEIGHT = 168;
const BAND = 17; // px of the height of what is there or not
const MANY = 6; // curves, from which on the legend beside the robot names them, and captions only the chosen one
const ASIDE = 22; // percent: strength of curves that are not chosen

class Chart {
  constructor(motion, spec, holder, onSeek) {
    this.motion = motion;
    this.spec = spec;
    this.segment = null;
    this.many = spec.series.length > MANY;
    const figure = holder.appendChild(make("figure", this.many ? "chart many" : "chart"));
    const title = figure.appendChild(make("figcaption"));
    title.append(make("strong", "", spec.title), make("span", "unit", spec.unit));
    this.readouts = spec.series.map((series) => this.readout(title, series));
    if (this.many) title.append(make("span", "beyond choose", "choose a joint in the legend"));
    this.explainLines(title);
    const body = figure.appendChild(make("div", "plot"));
    this.bands = spec.unit === "";
    this.height = this.bands ? BAND * (spec.series.length + 1) : CHART_HEIGHT;
    body.style.height = `${this.height}px`;
    this.plot = new uPlot(this.options(body.clientWidth), this.table(), body);
    this.plot.root.setAttribute("role", "img");
    this.plot.root.setAttribute("aria-label", `${spec.title} over time, ${spec.unit}`);
    this.head = this.plot.over.appendChild(make("div", "playhead"));
    this.follow(onSeek);
    this.choose(null);
    DARK.addEventListener("change", () => this.plot.redraw());
    new ResizeObserver(() => {
      this.plot.setSize({ width: body.clientWidth, height: this.height });
      this.draw(this.time);
    }).observe(body);
    this.draw(0);
  }

  readout(title, { name, colour, key, limit }) {
    const [entry, value] = [make("span", "entry curve"), make("b", "value")];
    value.dataset.key = key;
    entry.append(swatch("", colour), make("span", "", name), value);
    if (limit) entry.append(make("span", "limit", limit));
    title.append(entry);
    return value;
  }

  /* Dashed lines are told by name, in their colour where they share one. */
  explainLines(title) {
    const { lines, beyond } = this.spec;
    for (const name of new Set(lines.map((line) => line.name))) {
      const colours = new Set(lines.filter((line) => line.name === name).map((line) => line.colour));
      const mark = swatch("dashed", colours.size === 1 ? [...colours][0] : INK);
      title.appendChild(make("span", "entry")).append(mark, make("span", "", name));
    }
    if (beyond) title.append(make("span", "beyond", beyond));
  }

  /* Show the chosen segment's curve, limits and value before all others: 0 is the base, null none. */
  choose(segment) {
    this.segment = segment;
    const { lines, series } = this.spec;
    const own = segment !== null && series.some((one) => one.segment === segment);
    lines.forEach((line, index) => {
      const seen = line.segment === null || (own ? line.segment === segment : !this.many);
      this.plot.setSeries(index + 1, { show: seen });
    });
    this.readouts.forEach((value, index) => {
      value.parentElement.classList.toggle("chosen", own && series[index].segment === segment);
    });
    this.plot.root.closest(".chart").classList.toggle("choosing", own);
    this.plot.redraw();
  }

  stroke(segment, colour) {
    const shown = this.spec.series.some((one) => one.segment === this.segment);
    const aside = this.segment !== null && segment !== this.segment && shown;
    const strength = aside && segment !== null ? ASIDE : 100;
    return painted(`color-mix(in srgb, var(--shade) ${strength}%, var(--paper))`, colour);
  }

  /* Times, dashed lines, curves, and where these start and should end. */
  table() {
    const { factor, series, lines, starts = [], goals = [] } = this.spec;
    const { columns, count, times } = this.motion;
    const scaled = (values) => values.map((value) => (value === null ? null : factor * value));
    const limits = lines.map(({ value }) => scaled(Array.isArray(value) ? value : new Array(count).fill(value)));
    const only = (value, at) => Array.from(times, (_, index) => (index === at ? factor * value : null));
    const marks = [...starts.map((value) => only(value, 0)), ...goals.map((value) => only(value, count - 1))];
    return [Array.from(times), ...limits, ...series.map(({ key }) => scaled(columns[key])), ...marks];
  }

  options(width) {
    const { bands } = this;
    const { series, lines, unit, range, starts } = this.spec;
    const curve = bands ? { width: 11, cap: "butt" } : { width: 2 };
    const rows = [0.6 - series.length, 0.6];
    const grid = { stroke: () => painted("var(--grid)"), width: 1 };
    const axis = { font: "11px system-ui, sans-serif", stroke: () => painted("var(--soft)"), grid, ticks: grid };
    const drawn = ({ segment, colour }) => ({ stroke: () => this.stroke(segment, colour), points: { show: false } });
    const dot = (fill) => (one) => ({ ...drawn(one), points: { show: true, size: 8.5, width: 1.5, fill } });
    const full = series.map((one) => dot(() => this.stroke(one.segment, one.colour))(one));
    const rings = series.map(dot(() => painted("var(--paper)")));
    return {
      width,
      height: this.height,
      legend: { show: false },
      cursor: { show: false },
      padding: [8, 22, 0, 0],
      hooks: { drawClear: [(plot) => this.shadeFlights(plot)] },
      scales: { x: { time: false, range: [0, this.motion.duration] }, y: bands ? { range: rows } : range ? { range } : {} },
      axes: [
        { ...axis, show: !bands, size: 30, values: (_, ticks) => ticks.map((tick) => `${Number(tick.toFixed(3))} s`) },
        { ...axis, size: 48, space: 24, ...(bands ? { values: () => [], grid: { show: false } } : {}), ...(unit === "deg" ? { incrs: [1, 5, 15, 30, 45, 90, 180, 360, 720, 1440] } : {}) },
      ],
      series: [
        {},
        ...lines.map((line) => ({ ...drawn(line), width: 1, dash: [7, 4] })),
        ...series.map((one) => ({ ...drawn(one), ...curve })),
        ...(starts ? [...full, ...rings] : []),
      ],
    };
  }

  follow(onSeek) {
    const over = this.plot.over;
    const seek = (event) => {
      const box = over.getBoundingClientRect();
      onSeek(((event.clientX - box.left) / box.width) * this.motion.duration);
    };
    over.addEventListener("pointerdown", (event) => {
      over.setPointerCapture(event.pointerId);
      seek(event);
    });
    over.addEventListener("pointermove", (event) => {
      if (over.hasPointerCapture(event.pointerId)) seek(event);
    });
  }

  /* The flights of a jump, behind its curves. */
  shadeFlights(plot) {
    plot.ctx.fillStyle = painted("var(--air)");
    for (const span of this.motion.data.flown ?? []) {
      const [left, right] = span.map((time) => plot.valToPos(time, "x", true));
      plot.ctx.fillRect(left, plot.bbox.top, right - left, plot.bbox.height);
    }
  }

  draw(time) {
    this.time = time;
    const left = this.plot.valToPos(time, "x");
    this.head.style.transform = `translateX(${left}px)`;
    this.spec.series.forEach(({ key }, index) => {
      const value = this.motion.value(key, time);
      const readout = this.readouts[index];
      readout.dataset.value = value === null ? "" : String(value);
      readout.textContent = value === null ? "–" : this.bands ? "stands" : shown(this.spec.factor * value);
    });
  }
}

/* A number in five places, so that it does not dance while it changes. */
function shown(value) {
  const size = Math.abs(value);
  const places = size >= 100 ? 1 : size >= 10 ? 2 : 3;
  return value.toFixed(places).replace(/^-(0\.0*)$/, "$1").replace("-", "−");
}
