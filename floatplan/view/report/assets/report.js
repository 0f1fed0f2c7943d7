"use strict";
/* Puts the report together. */

function fillKey({ robot, frames }) {
  const list = document.getElementById("key");
  ["base", ...robot.joints].forEach((name, part) => {
    const entry = addKey(list, swatch("bar", robot.colours[part]), name);
    entry.dataset.part = part;
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
  const entries = [...list.querySelectorAll("[data-part]")];
  let kept = null;
  const keep = (entry) => {
    const part = Number(entry.dataset.part);
    kept = kept === part ? null : part;
    for (const one of entries) one.setAttribute("aria-pressed", Number(one.dataset.part) === kept);
    show(kept);
  };
  for (const entry of entries) {
    entry.addEventListener("mouseenter", () => show(Number(entry.dataset.part)));
    entry.addEventListener("mouseleave", () => show(kept));
    entry.addEventListener("click", () => keep(entry));
    entry.addEventListener("keydown", (event) => {
      if (event.key === "Enter") keep(entry);
    });
  }
}

function fillFacts(data, onSeek) {
  const holder = document.getElementById("facts");
  for (const { title, rows, tone, note, motors, findings } of data.sections) {
    const part = holder.appendChild(make("article", tone));
    part.append(make("h2", "", title));
    addRows(part.appendChild(make("dl")), rows);
    if (note) part.append(make("p", "note", note));
    if (motors) {
      part.classList.add("motors");
      fillTable(part, motors, onSeek);
    }
    if (findings && findings[1].length) {
      const details = part.appendChild(make("details"));
      details.append(make("summary", "", `All ${findings[1].length} constraints`));
      const lines = fillTable(details, findings, onSeek);
      findings[1].forEach(([, verdict], index) => lines[index].classList.add(verdict));
    }
  }
  const file = holder.appendChild(make("article", "file")).appendChild(make("details"));
  const link = make("a", "download", "Save it");
  link.href = URL.createObjectURL(new Blob([data.problem], { type: "application/toml" }));
  link.download = `${data.name.replace(/[^\p{L}\p{N}.-]+/gu, "_") || "problem"}.toml`;
  const summary = data.own_problem ? "The problem file, as written" : "The problem, as a file";
  file.append(make("summary", "", summary), make("pre", "", data.problem), link);
}

/* Titles, and rows of texts; a click on one goes to the instant in its last cell. */
function fillTable(part, [titles, rows], onSeek) {
  const table = part.appendChild(make("div", "wide")).appendChild(make("table"));
  const filled = (tag, texts) => {
    const row = make("tr");
    row.append(...texts.map((text) => make(tag, "", text)));
    return row;
  };
  table.appendChild(make("thead")).append(filled("th", titles));
  const lines = rows.map((texts) => filled("td", texts));
  table.appendChild(make("tbody")).append(...lines);
  lines.forEach((line, index) => {
    const instant = Number(rows[index].at(-1));
    if (!Number.isFinite(instant)) return;
    line.classList.add("seekable");
    line.addEventListener("click", () => onSeek(instant));
  });
  return lines;
}

(function main() {
  const data = JSON.parse(document.getElementById("data").textContent);
  const motion = new Motion(data.motion);
  const stage = new Stage(motion, document.getElementById("stage"));
  const seek = (time) => {
    player.pause();
    player.seek(time);
  };
  fillHeader(data);
  const badge = document.getElementById("verdict");
  badge.textContent = data.verdict.word;
  badge.classList.add(data.verdict.tone);
  fillFacts(data, seek);
  const holder = document.getElementById("charts");
  const key = fillKey(data.motion);
  if (data.motion.flown) {
    addKey(key, swatch("bar", INK), data.motion.scale);
    document.getElementById("forces").parentElement.hidden = false;
    document.getElementById("ghosts").checked = false; // they stand where the robot does
  }
  const charts = data.charts.map((spec) => new Chart(motion, spec, holder, seek));
  const player = new Player(motion.duration, (time) => [stage, ...charts].forEach((one) => one.draw(time)));
  offerParts(key, (part) => [stage, ...charts].forEach((one) => one.choose(part)));
  window.floatplan = { motion, stage, player, charts };
})();
