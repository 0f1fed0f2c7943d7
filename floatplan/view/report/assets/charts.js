"use strict";
/* The curves: one uPlot each, a line that follows the time, and the values at it. Dragging along a curve seeks. */

const CHART_HEIGHT = 168;

class Chart {
  constructor(motion, spec, holder, onSeek) {
    this.motion = motion;
    this.spec = spec;
    const figure = holder.appendChild(make("figure", "chart"));
    const title = figure.appendChild(make("figcaption"));
    title.appendChild(make("strong", "", spec.title));
    title.appendChild(make("span", "unit", spec.unit));
    this.readouts = spec.series.map((series) => this.readout(title, series));
    this.explainLines(title);
    const body = figure.appendChild(make("div", "plot"));
    this.plot = new uPlot(this.options(body.clientWidth), this.table(), body);
    this.head = this.plot.over.appendChild(make("div", "playhead"));
    this.follow(onSeek);
    new ResizeObserver(() => {
      this.plot.setSize({ width: body.clientWidth, height: CHART_HEIGHT });
      this.draw(this.time);
    }).observe(body);
    this.draw(0);
  }

  readout(title, { name, colour, key }) {
    const entry = title.appendChild(make("span", "entry"));
    entry.appendChild(make("i", "swatch")).style.background = colour;
    entry.appendChild(make("span", "", name));
    const value = entry.appendChild(make("b", "value"));
    value.dataset.key = key;
    return value;
  }

  /* Dashed lines are told by name, in their colour where they share one. */
  explainLines(title) {
    const { lines, beyond } = this.spec;
    for (const name of new Set(lines.map((line) => line.name))) {
      const colours = new Set(lines.filter((line) => line.name === name).map((line) => line.colour));
      const entry = title.appendChild(make("span", "entry"));
      entry.appendChild(make("i", "swatch dashed")).style.borderColor = colours.size === 1 ? [...colours][0] : "#222222";
      entry.appendChild(make("span", "", name));
    }
    if (beyond) title.appendChild(make("span", "beyond", beyond));
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
    const axis = { font: "11px system-ui, sans-serif", stroke: "#444444", grid: { stroke: "#eeeeee", width: 1 } };
    const limit = ({ colour }) => ({ stroke: colour, width: 1, dash: [7, 4], points: { show: false } });
    const curve = ({ colour }) => ({ stroke: colour, width: 2, points: { show: false } });
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
    series.forEach(({ colour }, index) => {
      drawMark(plot, 0, factor * starts[index], colour, colour);
      drawMark(plot, this.motion.duration, factor * goals[index], "#ffffff", colour);
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

function make(tag, name = "", text = "") {
  const element = document.createElement(tag);
  if (name) element.className = name;
  if (text) element.textContent = text;
  return element;
}
