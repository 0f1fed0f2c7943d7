"use strict";
/* Two motions side by side, each in its own time. */

(function main() {
  const { pair } = JSON.parse(document.getElementById("data").textContent);
  for (const id of ["ghosts", "goal", "margins"]) {
    const box = document.getElementById(id);
    box.checked = false;
    box.parentElement.hidden = true;
  }
  const first = document.getElementById("stage");
  const second = make("div", "stage");
  first.after(second);
  const holders = [first, second];
  const titles = pair.map(({ name }) => make("span", "title", name));
  const stages = pair.map(({ motion }, index) => {
    holders[index].append(titles[index]);
    return new Stage(new Motion(motion), holders[index], index ? "2" : "");
  });
  for (const [stage, other] of [stages, [...stages].reverse()]) {
    const follow = () => {
      Object.assign(other.camera, { angles: stage.camera.angles, zoom: stage.camera.zoom });
      other.camera.turn();
    };
    stage.holder.addEventListener("pointermove", () => stage.camera.pointers.size && follow());
    stage.holder.addEventListener("wheel", follow);
    stage.holder.addEventListener("dblclick", follow);
  }
  const duration = Math.max(...stages.map((stage) => stage.motion.duration));
  const player = new Player(duration, (time) => {
    stages.forEach((stage, index) => {
      const own = Math.min(time, stage.motion.duration);
      stage.draw(own);
      titles[index].classList.toggle("flies", pair[index].flights.some(([begin, end]) => begin < own && own < end));
    });
  });
  window.floatplan = { stages, player };
})();
