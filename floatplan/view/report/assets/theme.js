"use strict";
/* What all pages are made with. Whatever comes from a file is written as text, never as markup.

   The style sheet has every colour, light or dark as the reader's system has it: canvases are painted again when that
   changes. */

const DARK = matchMedia("(prefers-color-scheme: dark)");
const INK = "#222222"; // of data: the paper's own ink

/* Give an element a colour #rrggbb of data; the style sheet makes --shade of it, which can be seen on any paper. */
function dyed(element, colour) {
  element.style.setProperty("--colour", colour === INK ? "var(--ink)" : colour);
  return element;
}

/* A colour of the style sheet as canvases take it; var(--shade) is that of data. */
const probe = document.body.appendChild(make("i"));
function painted(colour, shade = INK) {
  dyed(probe, shade).style.color = colour;
  return getComputedStyle(probe).color;
}

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

/* A mark in a colour of data. */
function swatch(shape, colour) {
  return dyed(make("i", `swatch ${shape}`), colour);
}

/* A list's next entry: its swatch, in front of words. */
function addKey(list, mark, words) {
  const entry = list.appendChild(make("li"));
  entry.append(mark, make("span", "", words));
  return entry;
}
