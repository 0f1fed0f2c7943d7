// Names for screen readers, which viser gives to few of its elements; and how wide the scene is.
const named = (element, name) => name && element.getAttribute("aria-label") !== name
  && element.setAttribute("aria-label", name);
const words = element => element.textContent.trim();
function nameAll() {
  const [canvas, ...others] = document.querySelectorAll("canvas");
  for (const each of others) each.setAttribute("aria-hidden", "true");
  if (canvas) {
    canvas.setAttribute("role", "img");
    named(canvas, "The robot in motion. What dragging it changes, the panel's sliders change too.");
    document.documentElement.style.setProperty("--fp-scene", canvas.clientWidth + "px");
    if (!canvas.dataset.watched) new ResizeObserver(soon).observe(canvas);
    canvas.dataset.watched = "yes";
  }
  for (const label of document.querySelectorAll("label[for]")) {
    const input = document.getElementById(label.htmlFor) || label.closest(".mantine-Flex-root")?.querySelector("input");
    if (!input) continue;
    for (const each of input.matches("input") ? [input] : input.querySelectorAll("[role=slider]"))
      named(each, words(label));
    for (const each of (input.closest("div:has(> .mantine-NumberInput-root)") || input).querySelectorAll("input"))
      named(each, words(label));
    if (input.matches(".multi-slider")) { input.setAttribute("role", "group"); named(input, words(label)); }
  }
  for (const [kind, name] of [["Number", "time, s"], ["Select", "speed"]])  // of what plays a scene
    for (const each of document.querySelectorAll(`.mantine-${kind}Input-input, .mantine-${kind}-input`))
      if (!each.labels?.length && !each.hasAttribute("aria-label")) named(each, name);
  for (const icon of document.querySelectorAll("svg:not([role], [aria-hidden])")) icon.setAttribute("aria-hidden", "true");
  for (const button of document.querySelectorAll("button, [role=button]")) {
    const icon = button.querySelector("svg[class*=tabler-icon-]")?.getAttribute("class");
    if (!words(button)) named(button, icon ? icon.match(/tabler-icon-([a-z-]*[a-z])/)[1].replaceAll("-", " ") : "close");
  }
}
let asked = false;
const soon = () => {
  if (!asked) { asked = true; setTimeout(() => { asked = false; nameAll(); }, 200); }
};
addEventListener("DOMContentLoaded", () =>
  new MutationObserver(soon).observe(document.body, {childList: true, subtree: true}));
