"use strict";
/* The motion: values of its sampled columns at any time, and where the robot's points are. */

class Motion {
  constructor(data) {
    this.data = data;
    this.duration = data.duration;
    this.columns = data.columns;
    this.count = this.columns.com_x.length;
    this.step = this.duration / (this.count - 1);
    this.times = Float64Array.from({ length: this.count }, (_, index) => index * this.step);
  }

  /* A column's value at a time: the cubic through the four samples around it, or null where it does not exist. */
  value(key, time) {
    const samples = this.columns[key];
    const place = Math.min(Math.max(time / this.step, 0), this.count - 1);
    const first = Math.min(Math.max(Math.floor(place) - 1, 0), this.count - 4);
    const around = samples.slice(first, first + 4);
    if (around.includes(null)) return samples[Math.round(place)];
    const [a, b, c, d] = around;
    const x = place - first;
    return (
      (-a * (x - 1) * (x - 2) * (x - 3)) / 6 +
      (b * x * (x - 2) * (x - 3)) / 2 -
      (c * x * (x - 1) * (x - 3)) / 2 +
      (d * x * (x - 1) * (x - 2)) / 6
    );
  }

  /* The robot at a time: how its base is, joints, centre of mass, and its bodies. */
  posture(time) {
    const values = (keys) => keys.map((key) => this.value(key, time));
    const positions = values(this.data.robot.joints.map((_, index) => `positions.${index}`));
    const com = values(this.data.ball ? ["com_x", "com_y", "com_z"] : ["com_x", "com_y"]);
    if (!this.data.ball) return this.pose(this.value("orientation", time), positions, com);
    return this.poseInSpace(values(BASE), positions, com);
  }

  /* The robot where it should arrive. */
  goal() {
    const { orientation, base, positions, com } = this.data.goal;
    return base ? this.poseInSpace(base, positions, com) : this.pose(orientation, positions, com);
  }

  /* The robot in any posture; a body's absolute angle is orientation + turns . positions + offset.

     Its bodies: cosine and sine of that angle, and the place of the body's origin. This has a weight, a complex number,
     for each body: weights times rotations are added to the centre of mass. */
  pose(orientation, positions, com) {
    const { turn, turns, offsets, origins } = this.data.robot;
    const rotations = turns.map((row, body) => {
      const angle = turn * row.reduce((sum, share, joint) => sum + share * positions[joint], orientation + offsets[body]);
      return [Math.cos(angle), Math.sin(angle)];
    });
    const bodies = origins.map((weights, body) => {
      let [x, y] = com;
      weights.forEach(([re, im], other) => {
        const [cosine, sine] = rotations[other];
        x += re * cosine - im * sine;
        y += re * sine + im * cosine;
      });
      return [...rotations[body], x, y];
    });
    return { orientation, positions, com, bodies };
  }

  /* The same in space, from the base's place and quaternion x, y, z, w: rows of a rotation and a place for each body,
     which turns about an axis from where it rests in its parent. */
  poseInSpace(base, positions, com) {
    const bodies = [];
    for (const { parent, rests, at, axis, turns } of this.data.robot.bodies) {
      const angle = turns.reduce((sum, share, joint) => sum + share * positions[joint], 0) / 2;
      const own = axis ? matrix([...axis.map((part) => part * Math.sin(angle)), Math.cos(angle)]) : matrix(base.slice(3));
      const place = axis ? moved(bodies[parent], at) : base.slice(0, 3);
      bodies.push([axis ? product(product(bodies[parent][0], rests), own) : own, place]);
    }
    return { positions, com, bodies };
  }

  /* Place of a point of a body; without a body, of the centre of mass. */
  place(posture, { body, at }) {
    if (body === undefined) return posture.com;
    if (at.length > 2) return moved(posture.bodies[body], at);
    const [cosine, sine, x, y] = posture.bodies[body];
    return [x + at[0] * cosine - at[1] * sine, y + at[0] * sine + at[1] * cosine];
  }

  /* Path of a point: its place at every sample. */
  path(point) {
    return Array.from(this.times, (time) => this.place(this.posture(time), point));
  }
}

const BASE = ["base_x", "base_y", "base_z", "quaternion.0", "quaternion.1", "quaternion.2", "quaternion.3"];

/* The rotation of a quaternion of any length. */
function matrix(quaternion) {
  const length = Math.hypot(...quaternion);
  const [x, y, z, w] = quaternion.map((part) => part / length);
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
}

function product(first, second) {
  return first.map((row) => [0, 1, 2].map((k) => row[0] * second[0][k] + row[1] * second[1][k] + row[2] * second[2][k]));
}

/* A body's point, in the world. */
function moved([rotation, place], at) {
  return rotation.map((row, axis) => place[axis] + row[0] * at[0] + row[1] * at[1] + row[2] * at[2]);
}
