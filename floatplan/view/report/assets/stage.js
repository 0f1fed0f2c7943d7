"use strict";
/* The picture of the flight: a backdrop that stays, and over it what moves. World: metres, up is up. */

const GHOST_STRENGTH = [0.2, 0.42];

class Stage {
  constructor(motion, holder) {
    this.holder = holder;
    this.backdrop = holder.querySelector("#backdrop");
    this.front = holder.querySelector("#robot");
    this.shown = { ghosts: true, trails: true, margins: true, goal: true };
    for (const what of Object.keys(this.shown)) {
      const box = document.getElementById(what);
      box.addEventListener("change", () => this.show(what, box.checked));
    }
    this.part = null;
    this.take(motion);
    new ResizeObserver(() => this.resize()).observe(holder);
    paint(() => this.resize());
  }

  /* Another motion, from its beginning. */
  take(motion) {
    this.motion = motion;
    this.trails = motion.data.frames.map(({ colour, weights }) => ({ colour, points: motion.path(weights) }));
    this.trails.push({ colour: motion.data.trail, points: motion.path(null) });
    this.still = motion.data.obstacles.filter((one) => !moves(one));
    this.moving = motion.data.obstacles.filter(moves);
    this.colours = motion.data.robot.colours;
    this.time = 0;
  }

  /* The part that the reader has chosen stands out: 0 is the base, null none. */
  choose(part) {
    this.part = part;
    this.draw(this.time);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.holder;
    for (const canvas of [this.backdrop, this.front]) fit(canvas, width, height);
    const [left, low, right, high] = this.motion.data.box;
    this.scale = Math.min(width / (right - left), height / (high - low));
    this.origin = [width / 2 - (this.scale * (left + right)) / 2, height / 2 + (this.scale * (low + high)) / 2];
    this.size = [width, height];
    this.drawBackdrop();
    this.draw(this.time);
  }

  show(what, whether) {
    this.shown[what] = whether;
    this.drawBackdrop();
    this.draw(this.time);
  }

  at([x, y]) {
    return [this.origin[0] + this.scale * x, this.origin[1] - this.scale * y];
  }

  drawBackdrop() {
    const pen = cleared(this.backdrop);
    this.drawGrid(pen);
    for (const [level, low, high] of this.motion.data.ground) this.drawGround(pen, level, low, high);
    for (const obstacle of this.still) this.drawObstacle(pen, obstacle, 0, 1);
    if (this.shown.trails) for (const trail of this.trails) this.drawTrail(pen, trail, this.motion.duration, 0.35, 1);
    if (this.shown.goal) this.drawGoal(pen);
    if (this.shown.ghosts) this.drawGhosts(pen);
  }

  /* Lines a round number of metres apart, and a rule of that length. */
  drawGrid(pen) {
    const [width, height] = this.size;
    const metres = roundBelow(width / this.scale / 4);
    const step = metres * this.scale;
    const [left, top] = this.origin.map((place) => ((place % step) + step) % step);
    const sharp = (place) => Math.round(place) + 0.5;
    pen.lineWidth = 1;
    pen.strokeStyle = tone("grid");
    for (let x = left; x < width; x += step) stroke(pen, [[sharp(x), 0], [sharp(x), height]]);
    for (let y = top; y < height; y += step) stroke(pen, [[0, sharp(y)], [width, sharp(y)]]);
    pen.strokeStyle = pen.fillStyle = tone("soft");
    pen.lineWidth = 1.5;
    stroke(pen, [[12, 16], [12, 20], [12 + step, 20], [12 + step, 16]]);
    pen.fillText(`${metres} m`, 18 + step, 23);
  }

  drawGround(pen, level, low, high) {
    const whole = this.motion.data.ground.length === 1;
    const reach = whole ? 1e3 : 0.15 * (high - low);
    const [left, y] = this.at([low - reach, level]);
    const [right] = this.at([high + reach, level]);
    const [from, to] = [Math.max(left, 0), Math.min(right, this.size[0])];
    pen.fillStyle = tone("ground");
    pen.fillRect(from, y, to - from, Math.min(this.size[1] - y, whole ? 1e4 : 8));
    pen.strokeStyle = tone("ink");
    pen.lineWidth = 1.2;
    stroke(pen, [[from, y], [to, y]]);
  }

  drawObstacle(pen, obstacle, time, strength) {
    const [dx, dy] = obstacle.velocity.map((speed) => speed * time);
    const placed = (outline) => outline.concat([outline[0]]).map(([x, y]) => this.at([x + dx, y + dy]));
    pen.globalAlpha = strength;
    pen.fillStyle = tone(obstacle.bounded ? "stone" : "wall");
    pen.strokeStyle = shade(obstacle.colour);
    pen.lineWidth = 1.5;
    for (const outline of obstacle.outlines) {
      trace(pen, placed(outline));
      pen.fill();
      pen.stroke();
    }
    if (this.shown.margins) {
      pen.strokeStyle = tone("bad");
      pen.lineWidth = 1;
      pen.setLineDash([4, 3]);
      for (const outline of obstacle.margins) stroke(pen, placed(outline));
      pen.setLineDash([]);
    }
    pen.globalAlpha = 1;
  }

  drawTrail(pen, { points, colour }, until, strength, width) {
    pen.globalAlpha = strength;
    pen.strokeStyle = shade(colour);
    pen.lineWidth = width;
    stroke(pen, points.slice(0, Math.round(until / this.motion.step) + 1).map((point) => this.at(point)));
    pen.globalAlpha = 1;
  }

  drawGhosts(pen) {
    const times = this.motion.data.ghosts;
    times.forEach((time, index) => {
      const [low, high] = GHOST_STRENGTH;
      const strength = low + ((high - low) * index) / (times.length - 1);
      this.drawRobot(pen, this.motion.posture(time), { strength, ring: tone("paper"), width: 2 });
    });
  }

  drawGoal(pen) {
    const { orientation, positions, com } = this.motion.data.goal;
    const links = this.linkLines(this.motion.pose(orientation, positions, com));
    drawRings(pen, links, tone("ink"), 6.5);
    drawRings(pen, links, tone("paper"), 4);
  }

  linkLines(posture) {
    return this.motion.data.robot.links.map(({ start, end, radius, part }) => ({
      ends: [start, end].map((weights) => this.at(this.motion.place(posture, weights))),
      radius: Math.max(radius * this.scale, 1.2),
      part,
    }));
  }

  drawRobot(pen, posture, { strength, ring, width }) {
    const links = this.linkLines(posture);
    drawRings(pen, links, ring, 2 * width);
    for (const { ends, radius, part } of links) {
      const stands = this.part === null || this.part === part;
      pen.strokeStyle = faded(this.colours[part], stands ? strength : 0.35 * strength);
      pen.lineWidth = 2 * radius;
      stroke(pen, ends);
    }
    return links;
  }

  /* What moves, at a time. */
  draw(time) {
    this.time = time;
    const pen = cleared(this.front);
    for (const obstacle of this.moving) {
      const [from, to] = obstacle.window || [-Infinity, Infinity];
      this.drawObstacle(pen, obstacle, time, time >= from && time <= to ? 1 : 0.15);
    }
    if (this.shown.trails) for (const trail of this.trails) this.drawTrail(pen, trail, time, 0.9, 2);
    const posture = this.motion.posture(time);
    const links = this.drawRobot(pen, posture, { strength: 1, ring: tone("paper"), width: 2.5 });
    const thinnest = Math.min(...links.map((link) => link.radius));
    for (const pivot of this.motion.data.robot.pivots) {
      this.dot(pen, this.motion.place(posture, pivot), Math.max(0.35 * thinnest, 1.5), tone("paper"), null);
    }
    for (const { weights, colour } of this.motion.data.frames) {
      this.dot(pen, this.motion.place(posture, weights), Math.max(0.8 * thinnest, 3.5), tone("paper"), shade(colour));
    }
    this.dot(pen, posture.com, 4, tone("ink"), tone("paper"));
  }

  dot(pen, point, radius, fill, rim) {
    pen.beginPath();
    pen.arc(...this.at(point), radius, 0, 2 * Math.PI);
    pen.fillStyle = fill;
    pen.fill();
    if (!rim) return;
    pen.lineWidth = 2;
    pen.strokeStyle = rim;
    pen.stroke();
  }
}

function moves(obstacle) {
  return obstacle.window !== null || obstacle.velocity.some((speed) => speed !== 0);
}

/* A line through points of the screen; from a point to itself it is a dot. */
function trace(pen, points) {
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(x, y);
  const [x, y] = points.at(-1);
  pen.lineTo(x + 1e-3, y);
}

function stroke(pen, points) {
  trace(pen, points);
  pen.stroke();
}

/* Round the whole robot, so much wider than its links. */
function drawRings(pen, links, colour, extra) {
  pen.strokeStyle = colour;
  for (const { ends, radius } of links) {
    pen.lineWidth = 2 * radius + extra;
    stroke(pen, ends);
  }
}

/* The largest of ..., 0.5, 1, 2, 5, 10, ... that is not above a positive value. */
function roundBelow(value) {
  const power = Math.floor(Math.log10(value));
  const factor = [5, 2, 1].find((one) => one * 10 ** power <= value) || 1;
  return Number(`${factor}e${power}`);
}
