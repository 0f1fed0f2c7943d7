"use strict";
/* The picture of the flight: what stays, and over it what moves, as SVG in metres. The style sheet says how it looks;
   what that gives in pixels is times --px, the metres of one. */

const PALEST = 0.2; // strength of the first snapshot
const STRONGEST = 0.42; // and of the last
const HEAD = 11; // px of an arrow's head
const FAR = 1e3; // m, beyond every picture

class Stage {
  constructor(motion, holder) {
    this.holder = holder;
    this.rule = holder.appendChild(make("span", "rule"));
    this.backdrop = add(holder, "svg", { id: "backdrop" });
    this.front = add(holder, "svg", { id: "robot", role: "img", "aria-label": "The robot in its plane" });
    this.part = null;
    this.take(motion);
    new ResizeObserver(() => this.resize()).observe(holder);
  }

  /* Another motion, from its beginning. */
  take(motion) {
    this.motion = motion;
    const { data } = motion;
    const [left, low, right, high] = data.box;
    this.size = [right - left, high - low];
    const [behind, front] = [this.backdrop, this.front].map((picture) => {
      picture.setAttribute("viewBox", [left, -high, ...this.size].join(" "));
      picture.replaceChildren();
      return add(picture, "g", { transform: "scale(1 -1)" });
    });
    this.drawGrid(behind, (left + right) / 2, (low + high) / 2);
    for (const line of data.ground) drawGround(behind, data.ground.length === 1, ...line);
    for (const obstacle of data.obstacles) if (!moves(obstacle)) drawObstacle(behind, obstacle);
    const trails = [...data.frames, { colour: data.trail }].map((trail) => [trail, this.motion.path(trail)]);
    for (const [{ colour }, points] of trails) dyed(add(behind, "polyline", { class: "trail", points }), colour);
    const { orientation, positions, com } = data.goal;
    put(this.drawRobot(behind, "goal", ["rim", "gap"]), this.motion.pose(orientation, positions, com));
    data.ghosts.forEach((time, index) => {
      const ghost = this.drawRobot(behind, "ghosts", ["ring", "link"]);
      const strength = PALEST + ((STRONGEST - PALEST) * index) / (data.ghosts.length - 1);
      ghost.style.setProperty("--strength", strength);
      put(ghost, this.motion.posture(time));
    });
    this.moving = data.obstacles.filter(moves).map((obstacle) => [obstacle, drawObstacle(front, obstacle)]);
    this.flown = trails.map(([{ colour }, points]) => [
      points,
      dyed(add(front, "polyline", { class: "trail flown" }), colour),
    ]);
    const pushed = data.frames.filter(({ force }) => force);
    const drawn = (name, attributes) => pushed.map(({ colour }) => dyed(add(front, name, attributes), colour));
    const cones = drawn("polygon", { class: "push cone", points: data.cone });
    this.robot = this.drawRobot(front, "flying", ["ring", "link"]);
    data.robot.origins.slice(1).forEach((_, body) => add(this.robot, "circle", { class: "pivot", "data-body": body + 1 }));
    for (const { body, at: [cx, cy], colour } of data.frames) {
      dyed(add(this.robot, "circle", { class: "frame", "data-body": body, cx, cy }), colour);
    }
    const rings = drawn("path", { class: "push ring" });
    const arrows = drawn("path", { class: "push" });
    this.pushes = pushed.map((point, index) => [point, cones[index], [rings[index], arrows[index]]]);
    this.com = add(front, "circle", { class: "com" });
    this.choose(this.part);
    this.resize();
    this.draw(0);
  }

  /* The part that the reader has chosen stands out: 0 is the base, null none. */
  choose(part) {
    this.part = part;
    for (const link of this.holder.querySelectorAll(".link")) {
      link.classList.toggle("aside", part !== null && Number(link.dataset.part) !== part);
    }
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.holder;
    this.pixel = Math.max(this.size[0] / width, this.size[1] / height);
    this.holder.style.setProperty("--px", this.pixel);
  }

  /* Lines a round number of metres apart, and a rule of that length. */
  drawGrid(parent, x, y) {
    const size = Math.max(...this.size);
    const step = roundBelow(size / 4);
    const reach = 5 * size;
    const places = (middle) => {
      const first = Math.ceil((middle - reach) / step);
      return Array.from({ length: Math.floor((2 * reach) / step) }, (_, index) => (first + index) * step);
    };
    const upright = places(x).map((place) => `M${place} ${y - reach}v${2 * reach}`);
    const level = places(y).map((place) => `M${x - reach} ${place}h${2 * reach}`);
    add(parent, "path", { class: "grid", d: [...upright, ...level].join("") });
    this.rule.dataset.length = `${step} m`;
    this.rule.style.setProperty("--step", step);
  }

  /* A robot to be put into any posture: its links in layers, one above the other. */
  drawRobot(parent, name, layers) {
    const { links, colours } = this.motion.data.robot;
    const group = add(parent, "g", { class: `robot ${name}` });
    group.style.setProperty("--thinnest", Math.min(...links.map((link) => link.radius)));
    for (const layer of layers) {
      for (const { body, part, radius, start, end } of links) {
        const ends = { x1: start[0], y1: start[1], x2: end[0], y2: end[1] };
        const looks = { class: layer, "data-body": body, "data-part": part };
        dyed(add(group, "line", { ...ends, ...looks }), colours[part]).style.setProperty("--radius", radius);
      }
    }
    return group;
  }

  /* What moves, at a time. */
  draw(time) {
    for (const [{ velocity, window }, element] of this.moving) {
      const [from, to] = window || [-Infinity, Infinity];
      element.setAttribute("transform", `translate(${velocity.map((speed) => speed * time)})`);
      element.classList.toggle("away", time < from || time > to);
    }
    const count = Math.round(time / this.motion.step) + 1;
    for (const [points, element] of this.flown) element.setAttribute("points", points.slice(0, count));
    const posture = this.motion.posture(time);
    put(this.robot, posture);
    this.com.setAttribute("transform", `translate(${posture.com})`);
    for (const [point, cone, arrow] of this.pushes) {
      const [force, acts] = [point.force, point.acts].map((keys) => keys.map((key) => this.motion.value(key, time)));
      const stands = ![...force, ...acts].includes(null);
      for (const element of [cone, ...arrow]) {
        element.classList.toggle("absent", !stands);
        if (stands) element.setAttribute("transform", `translate(${acts})`);
      }
      if (stands) for (const element of arrow) element.setAttribute("d", this.arrow(force));
    }
  }

  /* A force, N, as a line with a head, m. */
  arrow(force) {
    const [x, y] = force.map((part) => this.motion.data.metres_per_newton * part);
    const head = Math.min(HEAD * this.pixel, 0.4 * Math.hypot(x, y)) / (Math.hypot(x, y) || 1);
    const barb = (side) => `${x - head * (x - side * 0.5 * y)} ${y - head * (y + side * 0.5 * x)}`;
    return `M0 0L${x} ${y}M${barb(1)}L${x} ${y}L${barb(-1)}`;
  }
}

function moves(obstacle) {
  return obstacle.window !== null || obstacle.velocity.some((speed) => speed !== 0);
}

/* Put what belongs to a robot's bodies where these are. */
function put(robot, posture) {
  for (const element of robot.children) {
    const [cosine, sine, x, y] = posture.bodies[element.dataset.body];
    element.setAttribute("transform", `matrix(${cosine} ${sine} ${-sine} ${cosine} ${x} ${y})`);
  }
}

function drawGround(parent, whole, level, low, high) {
  const reach = whole ? FAR : 0.15 * (high - low);
  const group = add(parent, "g", { transform: `translate(${low - reach} ${level}) scale(1 -1)` });
  const width = high - low + 2 * reach;
  add(group, "rect", { class: whole ? "soil whole" : "soil", width });
  add(group, "line", { class: "level", x2: width });
}

function drawObstacle(parent, { bounded, colour, capsules, margin }) {
  const group = dyed(add(parent, "g", { class: bounded ? "obstacle" : "obstacle wall" }), colour);
  for (const capsule of capsules) drawCapsule(group, "body", capsule, 0);
  if (margin > 0) for (const capsule of capsules) drawCapsule(group, "margin", capsule, margin);
  return group;
}

/* All points within a distance of a capsule: two ends and a radius. */
function drawCapsule(parent, name, [[x, y], [to, up], radius], distance) {
  const size = radius + distance;
  const box = { x: -size, y: -size, width: Math.hypot(to - x, up - y) + 2 * size, height: 2 * size, rx: size };
  const transform = `translate(${x} ${y}) rotate(${(180 / Math.PI) * Math.atan2(up - y, to - x)})`;
  add(parent, "rect", { class: name, ...box, transform });
}

/* The largest of ..., 0.5, 1, 2, 5, 10, ... that is not above a positive value. */
function roundBelow(value) {
  const power = Math.floor(Math.log10(value));
  const factor = [5, 2, 1].find((one) => one * 10 ** power <= value) || 1;
  return Number(`${factor}e${power}`);
}
