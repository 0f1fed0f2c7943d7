"use strict";
/* What all pages are made with. Whatever comes from a file is written as text, never as markup.

   Light or dark, as the reader's system has it: what is painted with these colours is painted again when that changes. */

const DARK = window.matchMedia("(prefers-color-scheme: dark)");
const INK = "#222222"; // of data: the paper's own ink
const LEAST_LIGHT = 0.22; // of a curve on dark paper, 0 black to 1 white
const painted = [];

/* A colour of the style sheet. */
function tone(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/* A colour #rrggbb of data: on dark paper, mixed with white until it can be seen. */
function shade(colour) {
  if (!DARK.matches) return colour;
  if (colour === INK) return tone("ink");
  let parts = channels(colour);
  while (lightness(parts) < LEAST_LIGHT) parts = parts.map((part) => Math.ceil(part + 0.1 * (255 - part)));
  return `#${parts.map((part) => part.toString(16).padStart(2, "0")).join("")}`;
}

function channels(colour) {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}

function lightness(parts) {
  return [0.2126, 0.7152, 0.0722].reduce((sum, share, index) => sum + share * (parts[index] / 255) ** 2.2, 0);
}

function paint(action) {
  painted.push(action);
  action();
}

DARK.addEventListener("change", () => painted.forEach((action) => action()));

function make(tag, name = "", text = "") {
  const element = document.createElement(tag);
  if (name) element.className = name;
  if (text) element.textContent = text;
  return element;
}

/* An element of a picture, in its parent. */
function add(parent, name, attributes) {
  const element = parent.appendChild(document.createElementNS("http://www.w3.org/2000/svg", name));
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

/* Rows of a list of terms. */
function addRows(list, rows) {
  for (const [name, text] of rows) list.append(make("dt", "", name), make("dd", "", text));
}

function fillHeader({ name, question, version }) {
  document.getElementById("name").textContent = name;
  document.getElementById("question").textContent = question;
  document.getElementById("version").textContent = version ? ` ${version}` : "";
}

/* A mark in a colour of data. */
function swatch(shape, colour) {
  const mark = make("i", `swatch ${shape}`);
  paint(() => mark.style.setProperty("--colour", shade(colour)));
  return mark;
}

/* A list's next entry: its swatch, in front of words. */
function addKey(list, mark, words) {
  const entry = list.appendChild(make("li"));
  entry.append(mark, make("span", "", words));
  return entry;
}
