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
  const stages = pair.map(({ name, motion }, index) => {
    holders[index].append(make("span", "title", name));
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
    for (const stage of stages) stage.draw(Math.min(time, stage.motion.duration));
  });
  window.floatplan = { stages, player };
})();
