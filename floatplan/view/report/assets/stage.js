"use strict";
/* The picture of the flight: what stays, and over it what moves, as SVG in metres. The style sheet says how it looks;
   what that gives in pixels is times --px, the metres of one. */

const PALEST = 0.2; // strength of the first snapshot
const STRONGEST = 0.42; // and of the last
const HEAD = 11; // px of an arrow's head
const FAR = 1e3; // m, beyond every picture
const LIGHT = [-0.35, 0.75, 0.56]; // where it comes from, as the camera sees it
const TONES = 4; // of what light falls on

class Stage {
  /* Of several stages on a page each has a name of its own, which its parts' names end in. */
  constructor(motion, holder, name = "") {
    this.holder = holder;
    this.rule = holder.appendChild(make("span", "rule"));
    this.backdrop = add(holder, "svg", { id: `backdrop${name}`, "aria-hidden": "true" });
    this.front = add(holder, "svg", { id: `robot${name}`, role: "img", "aria-label": "The robot in flight" });
    this.compass = add(holder, "svg", { id: `compass${name}`, class: "compass", viewBox: "-1.5 -1.5 3 3", "aria-hidden": "true" });
    const named = (name) => [add(this.compass, "line", {}), add(this.compass, "text", { dy: "0.35em" }), name];
    this.axes = [..."xyz"].map(named);
    this.segment = null;
    this.camera = new Camera(holder, () => this.turn());
    this.take(motion);
    new ResizeObserver(() => this.resize()).observe(holder);
  }

  /* Another motion, from its beginning. */
  take(motion) {
    this.motion = motion;
    this.robot = null;
    const { data } = motion;
    this.camera.take(data);
    this.holder.classList.toggle("turns", "ball" in data);
    this.holder.style.setProperty("--thinnest", Math.min(...data.robot.links.map((link) => link.radius)));
    const [behind, front] = [this.backdrop, this.front].map((picture) => {
      picture.replaceChildren();
      return add(picture, "g", { transform: "scale(1 -1)" });
    });
    this.drawGrid(behind);
    this.floor = (data.floor || []).map((ends) => [ends, add(behind, "polyline", { class: "floor" })]);
    if (data.step) drawStep(behind, ...data.step);
    for (const line of data.ground) drawGround(behind, data.ground.length === 1, ...line);
    const [solids, flat] = [true, false].map((solid) => data.obstacles.filter(({ points }) => solid === Boolean(points)));
    for (const obstacle of flat) if (!moves(obstacle)) drawObstacle(behind, obstacle);
    this.solids = solids.map((obstacle) => [obstacle, drawSolid(behind)]);
    const trails = [...data.frames, { colour: data.trail }];
    const drawn = (parent, name) => trails.map(({ colour }) => dyed(add(parent, "polyline", { class: name }), colour));
    this.trails = trails.map((trail) => motion.path(trail));
    this.whole = drawn(behind, "trail");
    this.stays = [[this.drawRobot(behind, "goal", ["rim", "gap"]), motion.goal()]];
    data.ghosts.forEach((time, index) => {
      const ghost = this.drawRobot(behind, "ghosts", ["ring", "link"]);
      const strength = PALEST + ((STRONGEST - PALEST) * index) / (data.ghosts.length - 1);
      ghost.group.style.setProperty("--strength", strength);
      this.stays.push([ghost, motion.posture(time)]);
    });
    this.shadow = Number.isFinite(data.shadow) ? add(front, "path", { class: "shadow" }) : null;
    this.moving = flat.filter(moves).map((obstacle) => [obstacle, drawObstacle(front, obstacle)]);
    this.flown = drawn(front, "trail flown");
    this.drawPushes(front);
    for (const solid of this.solids) solid.push(drawSolid(front));
    this.choose(this.segment);
    this.time = 0;
    this.turn();
  }

  /* The robot, marks on its frames, forces, and the angular momentum in space. */
  drawPushes(front) {
    const { frames, cone, robot, vector } = this.motion.data;
    const pushed = frames.filter(({ force }) => force);
    const drawn = (name, attributes) => pushed.map(({ colour }) => dyed(add(front, name, attributes), colour));
    const cones = drawn("path", { class: "push cone" });
    this.cone = cone;
    this.robot = this.drawRobot(front, "flying", ["ring", "link"], TONES);
    const pivots = this.motion.data.ball ? [] : robot.origins.slice(1).map((_, body) => [{ body: body + 1, at: [0, 0] }, "pivot"]);
    this.marks = [...pivots, ...frames.map((frame) => [frame, "frame"]), [{ colour: INK }, "com"]].map(([point, name]) => [
      point,
      dyed(add(front, "circle", { class: name }), point.colour || INK),
    ]);
    const rings = drawn("path", { class: "push ring" });
    const arrows = drawn("path", { class: "push" });
    this.pushes = pushed.map((point, index) => [point, cones[index], [rings[index], arrows[index]]]);
    const shafts = vector ? ["vector ring", "vector"] : [];
    this.vectors = shafts.map((name) => dyed(add(front, "path", { class: `push ${name}` }), INK));
  }

  /* The segment that the reader has chosen stands out: 0 is the base, null none. */
  choose(segment) {
    this.segment = segment;
    for (const link of this.holder.querySelectorAll(".link")) {
      link.classList.toggle("aside", segment !== null && Number(link.dataset.segment) !== segment);
    }
  }

  /* What stays is seen anew. */
  turn() {
    if (!this.robot) return;
    this.axes.forEach(([line, label, name], axis) => {
      const [x, y] = this.camera.axes.map((direction) => direction[axis]);
      for (const [key, value] of [["x2", x], ["y2", -y]]) line.setAttribute(key, value);
      for (const [key, value] of [["x", 1.3 * x], ["y", -1.3 * y]]) label.setAttribute(key, value);
      label.textContent = name;
    });
    if (this.cone) {
      const outline = path(hull(this.cone.map((corner) => this.flat(corner))));
      for (const [, element] of this.pushes) element.setAttribute("d", outline);
    }
    for (const [ends, element] of this.floor) element.setAttribute("points", ends.map((end) => this.flat(end)));
    this.seen = this.trails.map((points) => points.map((point) => this.flat(point)));
    this.seen.forEach((points, index) => this.whole[index].setAttribute("points", points));
    for (const [robot, posture] of this.stays) this.put(robot, posture);
    this.frame(this.motion.posture(this.time).com);
    this.resize();
    this.draw(this.time);
  }

  /* A point as it is seen in the picture. */
  flat(point) {
    return this.camera.see(point).slice(0, 2);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.holder;
    this.pixel = Math.max(this.box[2] / width, this.box[3] / height);
    this.holder.style.setProperty("--px", this.pixel);
    const step = roundBelow(Math.max(this.box[2], this.box[3]) / 4);
    this.rule.dataset.length = `${step} m`;
    this.rule.style.setProperty("--step", step);
  }

  /* Lines of a plane a round number of metres apart, the length of the rule. */
  drawGrid(parent) {
    if (this.motion.data.ball) return;
    const [left, low, width, height] = this.camera.box();
    const [x, y, size] = [left + width / 2, low + height / 2, Math.max(width, height)];
    const step = roundBelow(size / 4);
    const reach = 5 * size;
    const places = (middle) => {
      const first = Math.ceil((middle - reach) / step);
      return Array.from({ length: Math.floor((2 * reach) / step) }, (_, index) => (first + index) * step);
    };
    const upright = places(x).map((place) => `M${place} ${y - reach}v${2 * reach}`);
    const level = places(y).map((place) => `M${x - reach} ${place}h${2 * reach}`);
    add(parent, "path", { class: "grid", d: [...upright, ...level].join("") });
  }

  /* A robot to be put into any posture: its links in layers, one above the other, what is behind first in each. */
  drawRobot(parent, name, layers, tones = 0) {
    const { links } = this.motion.data.robot;
    const group = add(parent, "g", { class: `robot ${name}` });
    const places = layers.map((layer) =>
      links.map(() => {
        const place = add(group, "g", { class: layer });
        const count = 1 + (layer === "link" ? tones : 0);
        return [place, Array.from({ length: count }, (_, tone) => add(place, "path", { class: `tone${tone}` }))];
      }),
    );
    return { group, places, shown: [] };
  }

  /* Put a robot into a posture: each link in its place in the order of depth. */
  put({ places, shown }, posture) {
    const { links, colours } = this.motion.data.robot;
    const seen = links.map(({ body, points }, index) => {
      const corners = points.map((at) => this.camera.see(this.motion.place(posture, { body, at })));
      return { index, corners, depth: corners.reduce((sum, corner) => sum + (corner[2] || 0), 0) / corners.length };
    });
    seen.sort((one, other) => one.depth - other.depth || one.index - other.index);
    seen.forEach(({ index, corners }, place) => {
      const { segment, radius, faces } = links[index];
      const outline = path(faces.length ? hull(corners) : corners);
      for (const layer of places) {
        const [holder, [whole, ...tones]] = layer[place];
        whole.setAttribute("d", outline);
        if (tones.length && faces.length) lit(faces, corners).forEach((d, tone) => tones[tone].setAttribute("d", d));
        if (shown[place] === index) continue;
        if (!faces.length) for (const tone of tones) tone.setAttribute("d", "");
        dyed(holder, colours[segment]).dataset.segment = segment;
        holder.style.setProperty("--radius", radius);
        holder.classList.toggle("solid", faces.length > 0);
        const other = this.segment !== null && segment !== this.segment;
        holder.classList.toggle("aside", holder.classList.contains("link") && other);
      }
      shown[place] = index;
    });
  }

  /* Put an obstacle in space where it is at a time: behind the robot, or before it where it is nearer than its CM. */
  putSolid(time, com, { points, faces, grown, velocity, window }, ...elements) {
    const seen = (places) => places.map((at) => this.camera.see(at.map((part, axis) => part + velocity[axis] * time)));
    const corners = seen(points);
    const depth = corners.reduce((sum, corner) => sum + corner[2], 0) / corners.length;
    const nearer = depth > this.camera.see(com)[2];
    const [from, to] = window || [-Infinity, Infinity];
    elements.forEach(([group, whole, tones, margin], place) => {
      group.classList.toggle("absent", nearer !== (place === 1));
      group.classList.toggle("away", time < from || time > to);
      whole.setAttribute("d", path(hull(corners)));
      lit(faces, corners).forEach((d, tone) => tones[tone].setAttribute("d", d));
      margin.setAttribute("d", grown.length ? path(hull(seen(grown))) : "");
    });
  }

  /* What moves, at a time. */
  draw(time) {
    this.time = time;
    for (const [{ velocity, window }, element] of this.moving) {
      const [from, to] = window || [-Infinity, Infinity];
      element.setAttribute("transform", `translate(${velocity.map((speed) => speed * time)})`);
      element.classList.toggle("away", time < from || time > to);
    }
    const count = Math.round(time / this.motion.step) + 1;
    this.flown.forEach((element, index) => element.setAttribute("points", this.seen[index].slice(0, count)));
    const posture = this.motion.posture(time);
    this.frame(posture.com);
    this.put(this.robot, posture);
    if (this.shadow) this.shadow.setAttribute("d", this.shadowOf(posture));
    for (const solid of this.solids) this.putSolid(time, posture.com, ...solid);
    for (const [point, element] of this.marks) {
      element.setAttribute("transform", `translate(${this.flat(this.motion.place(posture, point))})`);
    }
    for (const [point, cone, arrow] of this.pushes) {
      const [force, acts] = [point.force, point.acts].map((keys) => keys.map((key) => this.motion.value(key, time)));
      const stands = ![...force, ...acts].includes(null);
      for (const element of [cone, ...arrow]) {
        element.classList.toggle("absent", !stands);
        if (stands) element.setAttribute("transform", `translate(${this.flat(acts)})`);
      }
      const scaled = force.map((part) => this.motion.data.metres_per_newton * part);
      if (stands) for (const element of arrow) element.setAttribute("d", this.arrow(this.flat(scaled)));
    }
    for (const element of this.vectors) {
      element.setAttribute("transform", `translate(${this.flat(posture.com)})`);
      element.setAttribute("d", this.arrow(this.flat(this.motion.data.vector)));
    }
  }

  /* The shadow of a posture, straight below it on the ground. */
  shadowOf(posture) {
    const { robot, shadow, higher } = this.motion.data;
    const below = ({ body, points }) => {
      const places = points.map((at) => this.motion.place(posture, { body, at }));
      let ground = shadow;
      if (higher) {
        const middle = places.reduce((sum, place) => sum + place[higher.axis], 0) / places.length;
        if (higher.inwards * (middle - higher.edge) > 0) ground += higher.height;
      }
      return places.map((place) => this.flat([...place.slice(0, 2), ground]));
    };
    return robot.links.map((link) => path(hull(below(link)))).join("");
  }

  /* What the picture holds while the centre of mass is somewhere. */
  frame(com) {
    const box = this.camera.box(com);
    if (String(box) === String(this.box)) return;
    this.box = box;
    const [left, low, width, height] = box;
    for (const picture of [this.backdrop, this.front]) {
      picture.setAttribute("viewBox", [left, -low - height, width, height].join(" "));
    }
  }

  /* A vector, m, as a line with a head. */
  arrow([x, y]) {
    const head = Math.min(HEAD * this.pixel, 0.4 * Math.hypot(x, y)) / (Math.hypot(x, y) || 1);
    const barb = (side) => `${x - head * (x - side * 0.5 * y)} ${y - head * (y + side * 0.5 * x)}`;
    return `M0 0L${x} ${y}M${barb(1)}L${x} ${y}L${barb(-1)}`;
  }
}

function moves(obstacle) {
  return obstacle.window !== null || obstacle.velocity.some((speed) => speed !== 0);
}

/* A polygon, or a line. */
function path(corners) {
  return `M${corners.map(([x, y]) => `${x} ${y}`).join("L")}${corners.length > 2 ? "Z" : corners.length < 2 ? "h0" : ""}`;
}

/* The convex hull of places, around against the clock. */
function hull(places) {
  const sorted = [...places].sort((one, other) => one[0] - other[0] || one[1] - other[1]);
  const side = (chain, place) => {
    while (chain.length > 1 && turned(chain.at(-2), chain.at(-1), place) <= 0) chain.pop();
    return [...chain, place];
  };
  return [...sorted.reduce(side, []).slice(0, -1), ...sorted.reverse().reduce(side, []).slice(0, -1)];
}

function turned([x, y], [right, up], [to, high]) {
  return (right - x) * (high - y) - (up - y) * (to - x);
}

/* The faces that are seen of a solid, as a path for each tone of the light that falls on them. */
function lit(faces, corners) {
  const tones = Array.from({ length: TONES }, () => "");
  for (const face of faces) {
    const [a, b, c] = face.map((corner) => corners[corner]);
    const [u, v] = [b, c].map((to) => to.map((part, axis) => part - a[axis]));
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    if (normal[2] <= 0) continue;
    const light = normal.reduce((sum, part, axis) => sum + part * LIGHT[axis], 0) / Math.hypot(...normal);
    tones[Math.min(Math.floor(TONES * Math.max(light, 0)), TONES - 1)] += path(face.map((corner) => corners[corner]));
  }
  return tones;
}

function drawGround(parent, whole, level, low, high) {
  const reach = whole ? FAR : 0.15 * (high - low);
  const group = add(parent, "g", { transform: `translate(${low - reach} ${level}) scale(1 -1)` });
  const width = high - low + 2 * reach;
  add(group, "rect", { class: whole ? "soil whole" : "soil", width });
  add(group, "line", { class: "level", x2: width });
}

/* Higher ground between corners left and low, right and high. */
function drawStep(parent, left, low, right, high) {
  add(parent, "path", { class: "step", d: `M${left} ${low}H${right}V${high}H${left}Z` });
}

function drawObstacle(parent, { bounded, colour, capsules, margin }) {
  const group = dyed(add(parent, "g", { class: bounded ? "obstacle" : "obstacle wall" }), colour);
  for (const capsule of capsules) drawCapsule(group, "body", capsule, 0);
  if (margin > 0) for (const capsule of capsules) drawCapsule(group, "margin", capsule, margin);
  return group;
}

/* An obstacle in space, to be put where it is seen: its outline, what light falls on, and its margin. */
function drawSolid(parent) {
  const group = add(parent, "g", { class: "obstacle solid" });
  const drawn = (name) => add(group, "path", { class: name });
  return [group, drawn("tone0"), Array.from({ length: TONES }, (_, tone) => drawn(`tone${tone + 1}`)), drawn("margin")];
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
