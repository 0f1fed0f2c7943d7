"use strict";
/* Time: play, pause, scrub, step, speed. Everything that shows an instant is drawn from here. */

const STEP = 0.01; // s
const REST = 0.6; // s between landing and the next takeoff, on a loop

class Player {
  constructor(duration, draw) {
    this.drawAll = draw;
    this.speed = 0.5;
    this.playing = false;
    this.rest = 0;
    this.controls = Object.fromEntries(
      ["home", "back", "play", "step", "scrub", "clock", "speed", "loop"].map((id) => [id, document.getElementById(id)]),
    );
    this.listen();
    this.take(duration);
  }

  /* A flight, from its beginning. */
  take(duration) {
    this.duration = this.controls.scrub.max = duration;
    this.seek(0);
  }

  listen() {
    const { home, back, play, step, scrub, speed } = this.controls;
    home.addEventListener("click", () => this.seek(0));
    back.addEventListener("click", () => this.stepBy(-STEP));
    step.addEventListener("click", () => this.stepBy(STEP));
    play.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    scrub.addEventListener("input", () => this.seek(scrub.valueAsNumber));
    speed.addEventListener("change", () => (this.speed = Number(speed.value)));
    document.addEventListener("keydown", (event) => this.onKey(event));
  }

  onKey(event) {
    const target = event.target.tagName;
    if (event.ctrlKey || event.metaKey || event.altKey || target === "SELECT" || target === "INPUT") return;
    const actions = {
      " ": () => this.controls.play.click(),
      ArrowLeft: () => this.stepBy(-STEP),
      ArrowRight: () => this.stepBy(STEP),
      Home: () => this.seek(0),
      End: () => this.seek(this.duration),
    };
    const action = actions[event.key];
    if (!action || (event.key === " " && target === "BUTTON") || target === "SUMMARY") return;
    event.preventDefault();
    action();
  }

  stepBy(step) {
    this.pause();
    this.seek(this.time + step);
  }

  play() {
    if (this.time >= this.duration) this.seek(0);
    this.rest = 0;
    this.show(true);
    let before = performance.now();
    const frame = (now) => {
      if (!this.playing) return;
      this.advance(Math.min(Math.max(now - before, 0) / 1000, 0.1));
      before = now;
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  advance(seconds) {
    if (this.time < this.duration) this.seek(this.time + this.speed * seconds);
    else if (!this.controls.loop.checked) this.pause();
    else if (this.rest < REST) this.rest += seconds;
    else {
      this.rest = 0;
      this.seek(0);
    }
  }

  pause() {
    this.show(false);
  }

  show(playing) {
    this.playing = playing;
    this.controls.play.setAttribute("aria-pressed", playing);
    this.controls.play.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.controls.scrub.value = this.time;
    this.controls.clock.textContent = `${this.time.toFixed(3)} s`;
    this.drawAll(this.time);
  }
}
