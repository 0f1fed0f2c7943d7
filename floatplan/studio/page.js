// Points of the map: a click on one presses the button of that name, which itself is not shown.
const POINT = "map point ";
const isPointButton = button => button.textContent.trim().startsWith(POINT);
function hidePointButtons() {
  for (const button of document.querySelectorAll("button"))
    if (isPointButton(button)) button.parentElement.style.display = "none";
}
addEventListener("click", event => {
  const point = event.target instanceof Element && event.target.closest("[data-point]");
  if (!point) return;
  const name = POINT + point.dataset.point;
  for (const button of document.querySelectorAll("button")) if (button.textContent.trim() === name) button.click();
});
addEventListener("DOMContentLoaded", () =>
  new MutationObserver(hidePointButtons).observe(document.body, {childList: true, subtree: true}));
