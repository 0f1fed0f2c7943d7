"use strict";
/* The curves: one uPlot each, a line that follows the time, and the values at it. Dragging along a curve seeks. */

const CHART_HEIGHT = 168;
const MANY = 6; // curves, from which on the legend beside the robot names them, and captions only the chosen one
const ASIDE = 0.22; // strength of curves that are not chosen

class Chart {
  constructor(motion, spec, holder, onSeek) {
    this.motion = motion;
    this.spec = spec;
    this.part = null;
    this.many = spec.series.length > MANY;
    const figure = holder.appendChild(make("figure", this.many ? "chart many" : "chart"));
    const title = figure.appendChild(make("figcaption"));
    title.appendChild(make("strong", "", spec.title));
    title.appendChild(make("span", "unit", spec.unit));
    this.readouts = spec.series.map((series) => this.readout(title, series));
    if (this.many) title.appendChild(make("span", "beyond choose", "choose a joint in the legend"));
    this.explainLines(title);
    const body = figure.appendChild(make("div", "plot"));
    this.plot = new uPlot(this.options(body.clientWidth), this.table(), body);
    this.head = this.plot.over.appendChild(make("div", "playhead"));
    this.follow(onSeek);
    this.choose(null);
    paint(() => this.plot.redraw());
    new ResizeObserver(() => {
      this.plot.setSize({ width: body.clientWidth, height: CHART_HEIGHT });
      this.draw(this.time);
    }).observe(body);
    this.draw(0);
  }

  readout(title, { name, colour, key, limit }) {
    const entry = title.appendChild(make("span", "entry curve"));
    const swatch = entry.appendChild(make("i", "swatch"));
    paint(() => (swatch.style.background = shade(colour)));
    entry.appendChild(make("span", "", name));
    const value = entry.appendChild(make("b", "value"));
    value.dataset.key = key;
    if (limit) entry.appendChild(make("span", "limit", limit));
    return value;
  }

  /* Dashed lines are told by name, in their colour where they share one. */
  explainLines(title) {
    const { lines, beyond } = this.spec;
    for (const name of new Set(lines.map((line) => line.name))) {
      const colours = new Set(lines.filter((line) => line.name === name).map((line) => line.colour));
      const entry = title.appendChild(make("span", "entry"));
      const swatch = entry.appendChild(make("i", "swatch dashed"));
      paint(() => (swatch.style.borderColor = colours.size === 1 ? shade([...colours][0]) : tone("ink")));
      entry.appendChild(make("span", "", name));
    }
    if (beyond) title.appendChild(make("span", "beyond", beyond));
  }

  /* Show the chosen part's curve, limits and value before all others: 0 is the base, null none. */
  choose(part) {
    this.part = part;
    const { lines, series } = this.spec;
    const own = series.some((one) => one.part === part);
    lines.forEach((line, index) => {
      const seen = line.part === null || (own ? line.part === part : !this.many);
      this.plot.setSeries(index + 1, { show: seen });
    });
    this.readouts.forEach((value, index) => {
      value.parentElement.classList.toggle("chosen", own && series[index].part === part);
    });
    this.plot.root.closest(".chart").classList.toggle("choosing", own);
    this.plot.redraw();
  }

  stroke(part, colour) {
    const aside = this.part !== null && part !== this.part && this.spec.series.some((one) => one.part === this.part);
    return faded(colour, aside && part !== null ? ASIDE : 1);
  }

  table() {
    const { factor, series, lines } = this.spec;
    const scaled = (values) => values.map((value) => (value === null ? null : factor * value));
    const curves = series.map(({ key }) => scaled(this.motion.columns[key]));
    const limits = lines.map(({ value }) =>
      Array.isArray(value) ? scaled(value) : new Array(this.motion.count).fill(factor * value),
    );
    return [Array.from(this.motion.times), ...limits, ...curves];
  }

  options(width) {
    const grid = { stroke: () => tone("grid"), width: 1 };
    const axis = { font: "11px system-ui, sans-serif", stroke: () => tone("soft"), grid, ticks: grid };
    const drawn = ({ part, colour }) => ({ stroke: () => this.stroke(part, colour), points: { show: false } });
    const limit = (line) => ({ ...drawn(line), width: 1, dash: [7, 4] });
    const curve = (one) => ({ ...drawn(one), width: 2 });
    const y = this.spec.range ? { range: this.spec.range } : {};
    return {
      width,
      height: CHART_HEIGHT,
      legend: { show: false },
      cursor: { show: false },
      padding: [8, 22, 0, 0],
      scales: { x: { time: false, range: [0, this.motion.duration] }, y },
      axes: [
        { ...axis, size: 30, values: (_, ticks) => ticks.map((tick) => `${Number(tick.toFixed(3))} s`) },
        { ...axis, size: 48, space: 24, ...(this.spec.unit === "deg" ? { incrs: [1, 5, 15, 30, 45, 90, 180, 360, 720, 1440] } : {}) },
      ],
      series: [{}, ...this.spec.lines.map(limit), ...this.spec.series.map(curve)],
      hooks: { draw: [(plot) => this.drawMarks(plot)] },
    };
  }

  /* Full dots where the flight starts, rings where it should end. */
  drawMarks(plot) {
    const { starts, goals, series, factor } = this.spec;
    if (!starts) return;
    series.forEach(({ part, colour }, index) => {
      const rim = this.stroke(part, colour);
      drawMark(plot, 0, factor * starts[index], rim, rim);
      drawMark(plot, this.motion.duration, factor * goals[index], tone("paper"), rim);
    });
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

  draw(time) {
    this.time = time;
    const left = this.plot.valToPos(time, "x");
    this.head.style.transform = `translateX(${left}px)`;
    this.spec.series.forEach(({ key }, index) => {
      const value = this.motion.value(key, time);
      const readout = this.readouts[index];
      readout.dataset.value = value === null ? "" : String(value);
      readout.textContent = value === null ? "–" : shown(this.spec.factor * value);
    });
  }
}

function drawMark(plot, time, value, fill, rim) {
  const pen = plot.ctx;
  const ratio = uPlot.pxRatio;
  pen.save();
  pen.beginPath();
  pen.arc(plot.valToPos(time, "x", true), plot.valToPos(value, "y", true), 3.5 * ratio, 0, 2 * Math.PI);
  pen.fillStyle = fill;
  pen.fill();
  pen.lineWidth = 1.5 * ratio;
  pen.strokeStyle = rim;
  pen.stroke();
  pen.restore();
}

/* A number in five places, so that it does not dance while it changes. */
function shown(value) {
  const size = Math.abs(value);
  const places = size >= 100 ? 1 : size >= 10 ? 2 : 3;
  return value.toFixed(places).replace(/^-(0\.0*)$/, "$1").replace("-", "−");
}
