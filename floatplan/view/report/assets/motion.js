"use strict";
/* The motion: values of its sampled columns at any time, and where the robot's points are. */

class Motion {
  constructor(data) {
    this.data = data;
    this.duration = data.duration;
    this.columns = data.columns;
    this.count = this.columns.orientation.length;
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

  /* The robot at a time: orientation, joints, centre of mass, and its bodies. */
  posture(time) {
    const positions = this.data.robot.joints.map((_, index) => this.value(`positions.${index}`, time));
    const [orientation, ...com] = ["orientation", "com_x", "com_y"].map((key) => this.value(key, time));
    return this.pose(orientation, positions, com);
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

  /* Place of a point of a body; without a body, of the centre of mass. */
  place(posture, { body, at }) {
    if (body === undefined) return posture.com;
    const [cosine, sine, x, y] = posture.bodies[body];
    return [x + at[0] * cosine - at[1] * sine, y + at[0] * sine + at[1] * cosine];
  }

  /* Path of a point: its place at every sample. */
  path(point) {
    return Array.from(this.times, (time) => this.place(this.posture(time), point));
  }
}
