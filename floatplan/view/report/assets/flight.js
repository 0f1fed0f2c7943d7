"use strict";
/* A row's plan, flown from its coefficients: joints by sine polynomials, the base by conservation of momentum. */

const INTERVALS = 180;
const SNAPSHOTS = 6;

class Flight {
  constructor(data) {
    this.data = data;
  }

  /* The problem of a row: the base problem with the values of its keys, by their paths, in SI units. */
  problem(values) {
    const problem = structuredClone(this.data.problem);
    const { joints } = this.data.robot;
    const entry = (place, part) => (Array.isArray(place) && joints.includes(part) ? joints.indexOf(part) : part);
    for (const [path, value] of values) {
      const parts = path.split(".");
      const last = parts.pop();
      const place = parts.reduce((within, part) => within && within[entry(within, part)], problem);
      if (!place) continue;
      const key = entry(place, last);
      place[key] = Array.isArray(place[key]) ? place[key].map(() => value) : value;
    }
    return problem;
  }

  /* What the stage shows of a row: coefficients are those of powers of s = t / T, joint by joint. */
  motion(problem, h, coefficients) {
    const duration = problem.flight.duration;
    const ranges = problem.limits.position || this.data.ranges;
    const size = coefficients.length / ranges.length;
    const joints = ranges.map((range, index) => [range, coefficients.slice(index * size, (index + 1) * size)]);
    const halves = Array.from({ length: 2 * INTERVALS + 1 }, (_, index) => index / (2 * INTERVALS));
    const states = halves.map((s) => this.state(joints, duration, h, s));
    const sampled = states.filter((_, index) => index % 2 === 0);
    const zeros = sampled.map(() => 0); // the centre of mass, until its path is known
    const columns = { orientation: [problem.start.orientation], com_x: zeros, com_y: zeros };
    joints.forEach((_, joint) => (columns[`positions.${joint}`] = sampled.map((state) => state.positions[joint])));
    for (let index = 0; index < INTERVALS; index++) {
      const [a, b, c] = states.slice(2 * index, 2 * index + 3).map((state) => state.rate);
      columns.orientation.push(columns.orientation[index] + (duration / INTERVALS) * (a + 4 * b + c) / 6);
    }
    const shown = {
      ...this.data,
      duration,
      columns,
      obstacles: (problem.obstacles || []).map((one, index) => {
        const base = this.data.obstacles[index]; // of a kind that is not known here, its shape stays
        return { ...base, ...one, capsules: CAPSULES[one.kind]?.(one) ?? base.capsules };
      }),
      ghosts: Array.from({ length: SNAPSHOTS }, (_, index) => (duration * index) / (SNAPSHOTS - 1)),
      ground: [],
    };
    const motion = new Motion(shown);
    this.addPath(motion, problem);
    const end = [columns.com_x[INTERVALS], columns.com_y[INTERVALS]];
    shown.goal = { orientation: problem.goal.orientation, positions: problem.goal.positions, com: end };
    shown.box = this.box(motion, problem);
    return motion;
  }

  /* Joint positions and the rate of the base at a fraction of the flight. */
  state(joints, duration, h, s) {
    const positions = [];
    const velocities = [];
    for (const [[low, high], factors] of joints) {
      let p = 0;
      let rate = 0;
      for (let k = factors.length - 1; k >= 0; k--) {
        rate = rate * s + p;
        p = p * s + factors[k];
      }
      positions.push((low + high) / 2 + ((high - low) / 2) * Math.sin(p));
      velocities.push((((high - low) / 2) * Math.cos(p) * rate) / duration);
    }
    return { positions, rate: this.baseRate(positions, velocities, h) };
  }

  baseRate(positions, velocities, h) {
    const { turn, turns, offsets, coupling, inertia } = this.data.robot;
    const angles = turns.map((row, body) => turn * (offsets[body] + dot(row, positions)));
    let locked = 0;
    let moved = 0;
    for (let j = 0; j < angles.length; j++) {
      let share = inertia[j];
      for (let i = 0; i < angles.length; i++) {
        const [re, im] = coupling[i][j];
        const between = angles[j] - angles[i];
        share += re * Math.cos(between) - im * Math.sin(between);
      }
      locked += share;
      moved += share * dot(turns[j], velocities);
    }
    return (h - moved) / locked;
  }

  /* The centre of mass: from where the takeoff frame leaves to the height at which the landing frame arrives. */
  addPath(motion, problem) {
    const { columns, duration, times } = motion;
    const { takeoff, landing, gravity, horizontal_velocity: speed } = problem.flight;
    const [leaves, arrives = leaves] = this.data.frames;
    const [left, low] = motion.place(motion.posture(0), leaves);
    const [x, y] = [takeoff.position[0] - left, takeoff.position[1] - low];
    const end = (landing.height || 0) - motion.place(motion.posture(duration), arrives)[1];
    const climb = (end - y) / duration + (gravity * duration) / 2;
    columns.com_x = Array.from(times, (t) => x + speed * t);
    columns.com_y = Array.from(times, (t) => y + climb * t - (gravity * t * t) / 2);
  }

  /* Left, low, right, high of all that is drawn; the ground is found on the way. */
  box(motion, problem) {
    const shown = motion.data;
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    const add = (x, y, radius) => {
      [x, y].forEach((value, axis) => (box[axis] = Math.min(box[axis], value - radius)));
      [x, y].forEach((value, axis) => (box[axis + 2] = Math.max(box[axis + 2], value + radius)));
    };
    for (let index = 0; index <= INTERVALS; index += 3) {
      const posture = motion.posture(motion.times[index]);
      for (const { body, points, radius } of shown.robot.links) {
        for (const at of points) add(...motion.place(posture, { body, at }), radius);
      }
      if (index === 0) {
        const [left, low, right, high] = box;
        const foot = problem.flight.takeoff.position[1];
        if (Math.abs(low - foot) < 0.05 * (high - low)) shown.ground.push([low, left, right]);
      }
    }
    if (shown.ground.length && box[1] < shown.ground[0][0] - 0.15 * (box[3] - box[1])) shown.ground.pop();
    for (const obstacle of shown.obstacles) {
      if (!obstacle.bounded) continue;
      for (const [start, end, radius] of obstacle.capsules) for (const at of [start, end]) add(...at, radius + obstacle.margin);
    }
    const room = 0.04 * Math.max(box[2] - box[0], box[3] - box[1]);
    return [box[0] - room, box[1] - room, box[2] + room, box[3] + room];
  }
}

function dot(row, values) {
  return row.reduce((sum, share, index) => sum + share * values[index], 0);
}

/* The capsules, two ends and a radius each, that an obstacle is; a half-plane's is so large that its side is the edge. */
const CAPSULES = {
  circle: ({ center, radius }) => [[center, center, radius]],
  capsule: ({ start, end, radius }) => [[start, end, radius]],
  "half-plane": ({ point, normal }) => {
    const [nx, ny] = normal.map((part) => (FAR * part) / Math.hypot(...normal));
    return [[[point[0] - nx + ny, point[1] - ny - nx], [point[0] - nx - ny, point[1] - ny + nx], FAR]];
  },
};
