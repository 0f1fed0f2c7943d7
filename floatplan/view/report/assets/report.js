"use strict";
/* Puts the report together. */

function fillBadge({ word, tone }) {
  const badge = document.getElementById("verdict");
  badge.textContent = word;
  badge.classList.add(tone);
}

function fillKey(data) {
  const list = document.getElementById("key");
  const names = ["base", ...data.motion.robot.joints];
  names.forEach((name, index) => {
    const entry = addColour(list, "bar", data.motion.robot.colours[index], name);
    entry.dataset.part = index;
    entry.tabIndex = 0;
    entry.setAttribute("role", "button");
    entry.setAttribute("aria-pressed", "false");
  });
  for (const { name, role, colour } of data.motion.frames) addColour(list, "ring", colour, `${name} (${role})`);
  addColour(list, "dot", "#222222", "centre of mass");
}

/* Parts of the robot are looked at by pointing at their names, and chosen by a click or the return key. */
function offerParts(list, show) {
  const entries = [...list.querySelectorAll("[data-part]")];
  let kept = null;
  const keep = (entry) => {
    const part = Number(entry.dataset.part);
    kept = kept === part ? null : part;
    for (const one of entries) one.setAttribute("aria-pressed", String(Number(one.dataset.part) === kept));
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

function addColour(list, shape, colour, words) {
  const swatch = addKey(list, shape, words);
  paint(() => (swatch.style[shape === "ring" ? "borderColor" : "background"] = shade(colour)));
  return swatch.parentElement;
}

function fillFacts(data, onSeek) {
  const holder = document.getElementById("facts");
  for (const section of data.sections) {
    const part = holder.appendChild(make("article", section.tone || ""));
    part.appendChild(make("h2", "", section.title));
    const list = part.appendChild(make("dl"));
    for (const [name, text] of section.rows) {
      list.appendChild(make("dt", "", name));
      list.appendChild(make("dd", "", text));
    }
    if (section.note) part.appendChild(make("p", "note", section.note));
    if (section.motors) {
      part.classList.add("motors");
      fillTable(part, section.titles, section.motors, onSeek);
    }
    if (section.findings && section.findings.length) fillFindings(part, section.findings, onSeek);
  }
  const file = holder.appendChild(make("article", "file")).appendChild(make("details"));
  file.appendChild(make("summary", "", data.own_problem ? "The problem file, as written" : "The problem, as a file"));
  file.appendChild(make("pre", "", data.problem));
  const link = file.appendChild(make("a", "download", "Save it"));
  link.href = URL.createObjectURL(new Blob([data.problem], { type: "application/toml" }));
  link.download = `${data.name.replace(/[^\p{L}\p{N}.-]+/gu, "_") || "problem"}.toml`;
}

function fillFindings(part, findings, onSeek) {
  const details = part.appendChild(make("details"));
  details.appendChild(make("summary", "", `All ${findings.length} constraints`));
  const rows = fillTable(details, ["constraint", "", "bound", "limit", "at, s"], findings, onSeek);
  findings.forEach((finding, index) => rows[index].classList.add(finding[1]));
}

/* Rows of texts; a click on one goes to the instant in its last cell. */
function fillTable(part, titles, rows, onSeek) {
  const table = part.appendChild(make("div", "wide")).appendChild(make("table"));
  const head = table.appendChild(make("thead")).appendChild(make("tr"));
  for (const title of titles) head.appendChild(make("th", "", title));
  const body = table.appendChild(make("tbody"));
  return rows.map((texts) => {
    const row = body.appendChild(make("tr"));
    for (const text of texts) row.appendChild(make("td", "", text));
    const instant = Number(texts[texts.length - 1]);
    if (Number.isFinite(instant)) {
      row.classList.add("seekable");
      row.addEventListener("click", () => onSeek(instant));
    }
    return row;
  });
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
  fillBadge(data.verdict);
  fillKey(data);
  fillFacts(data, seek);
  const holder = document.getElementById("charts");
  const charts = data.charts.map((spec) => new Chart(motion, spec, holder, seek));
  const player = new Player(motion.duration, (time) => {
    stage.draw(time);
    for (const chart of charts) chart.draw(time);
  });
  offerParts(document.getElementById("key"), (part) => {
    stage.choose(part);
    for (const chart of charts) chart.choose(part);
  });
  window.floatplan = { motion, stage, player, charts };
})();
