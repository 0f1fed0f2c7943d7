"use strict";
/* Puts the report together. */

function fillKey({ robot, frames }) {
  const list = document.getElementById("key");
  ["base", ...robot.joints].forEach((name, segment) => {
    const entry = addKey(list, swatch("bar", robot.colours[segment]), name);
    entry.dataset.segment = segment;
    entry.tabIndex = 0;
    entry.setAttribute("role", "button");
    entry.setAttribute("aria-pressed", "false");
  });
  for (const { name, role, colour } of frames) addKey(list, swatch("ring", colour), `${name} (${role})`);
  addKey(list, swatch("dot", INK), "centre of mass");
  return list;
}

/* Parts of the robot are looked at by pointing at their names, and chosen by a click or the return key. */
function offerParts(list, show) {
  const entries = [...list.querySelectorAll("[data-segment]")];
  let kept = null;
  const keep = (entry) => {
    const segment = Number(entry.dataset.segment);
    kept = kept === segment ? null : segment;
    for (const one of entries) one.setAttribute("aria-pressed", Number(one.dataset.segment) === kept);
    show(kept);
  };
  for (const entry of entries) {
    entry.addEventListener("mouseenter", () => show(Number(entry.dataset.segment)));
    entry.addEventListener("mouseleave", () => show(kept));
    entry.addEventListener("click", () => keep(entry));
    entry.addEventListener("keydown", (event) => {
      if (event.key === "Enter") keep(entry);
    });
  }
}

function offer(name) {
  document.getElementById(name).parentElement.hidden = false;
}

/* A click on a row of a table goes to the instant in its last cell. */
function offerInstants(rows, seek) {
  for (const row of rows) {
    row.dataset.verdict = row.cells[1].textContent;
    const instant = Number(row.lastElementChild.textContent || NaN);
    if (!Number.isFinite(instant)) continue;
    row.classList.add("seekable");
    row.addEventListener("click", () => seek(instant));
  }
}

(function main() {
  const data = JSON.parse(document.getElementById("data").textContent);
  const motion = new Motion(data.motion);
  const stage = new Stage(motion, document.getElementById("stage"));
  const seek = (time) => {
    player.pause();
    player.seek(time);
  };
  offerInstants(document.querySelectorAll("#facts tbody tr"), seek);
  const holder = document.getElementById("charts");
  const key = fillKey(data.motion);
  if (data.motion.flown) {
    addKey(key, swatch("bar", INK), data.motion.scale);
    offer("forces");
    document.getElementById("ghosts").checked = false; // they stand where the robot does
  }
  document.getElementById("margins").parentElement.hidden = !data.motion.obstacles.some(({ margin }) => margin > 0);
  if (data.motion.vector) {
    addKey(key, swatch("bar", INK), data.motion.scale);
    offer("vector");
  }
  const charts = data.charts.map((spec) => new Chart(motion, spec, holder, seek));
  const player = new Player(motion.duration, (time) => [stage, ...charts].forEach((one) => one.draw(time)));
  offerParts(key, (segment) => [stage, ...charts].forEach((one) => one.choose(segment)));
  window.floatplan = { motion, stage, player, charts };
})();
