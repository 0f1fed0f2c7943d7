"use strict";
/* From where a motion is looked at. In a plane there is one view. In space the pointer turns it, the wheel or two
   fingers bring it nearer, and a second click puts it back; what is near follows the centre of mass. */

const TURN = 0.009; // rad per px
const NEAREST = 10; // times as large as all of the flight

class Camera {
  constructor(holder, moved) {
    this.moved = moved;
    this.pointers = new Map();
    this.choice = document.getElementById("view");
    holder.addEventListener("pointerdown", (event) => {
      holder.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    holder.addEventListener("pointermove", (event) => this.drag(event));
    holder.addEventListener("lostpointercapture", (event) => this.pointers.delete(event.pointerId));
    holder.addEventListener("wheel", (event) => this.nearer(Math.exp(-0.0015 * event.deltaY), event), { passive: false });
    holder.addEventListener("dblclick", () => this.look());
    this.choice.addEventListener("change", () => this.look(this.choice.value));
  }

  take(data) {
    this.data = data;
    this.choice.parentElement.hidden = !data.ball;
    this.look();
  }

  /* Look from a direction, as azimuth and elevation in degrees; the first of the choices where none is said. */
  look(view = this.choice.options[0].value) {
    this.zoom = 1;
    this.angles = view.split(" ").map((angle) => (Math.PI / 180) * Number(angle));
    this.choice.value = view;
    this.turn();
  }

  turn() {
    const [[c, s], [low, high]] = this.angles.map((angle) => [Math.cos(angle), Math.sin(angle)]);
    this.axes = [[-s, c, 0], [-c * high, -s * high, low], [c * low, s * low, high]];
    this.moved();
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before || !this.data.ball) return;
    const now = [event.clientX, event.clientY];
    this.pointers.set(event.pointerId, now);
    const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    const apart = ([x, y]) => Math.hypot(x - other[0], y - other[1]);
    if (other) return this.nearer(apart(now) / apart(before), event);
    const [azimuth, elevation] = this.angles;
    const steep = elevation + TURN * (now[1] - before[1]);
    this.angles = [azimuth - TURN * (now[0] - before[0]), Math.min(Math.max(steep, -Math.PI / 2), Math.PI / 2)];
    this.choice.selectedIndex = -1;
    this.turn();
  }

  nearer(factor, event) {
    if (!this.data.ball) return;
    event.preventDefault();
    this.zoom = Math.min(Math.max(this.zoom * factor, 1), NEAREST);
    this.turn();
  }

  /* A point as it is seen: to the right, upwards, and in space towards who looks, m. */
  see(point) {
    return point.length < 3 ? point : this.axes.map((axis) => axis[0] * point[0] + axis[1] * point[1] + axis[2] * point[2]);
  }

  /* Left, low, width and height of what is seen while the centre of mass is somewhere, m. */
  box(com) {
    const { box, ball } = this.data;
    if (!ball) return [box[0], box[1], box[2] - box[0], box[3] - box[1]];
    const near = 1 - 1 / this.zoom;
    const [middle, followed] = [ball.centre, com].map((point) => this.see(point));
    const radius = ball.radius / this.zoom;
    return [0, 1].map((axis) => middle[axis] + near * (followed[axis] - middle[axis]) - radius).concat(2 * radius, 2 * radius);
  }
}
