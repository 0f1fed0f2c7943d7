"use strict";
/* The motion: values of its sampled columns at any time, and where the robot's points are. */

class Motion {
  constructor(data) {
    this.data = data;
    this.duration = data.duration;
    this.columns = data.columns;
    this.count = this.columns.orientation.length;
    this.step = this.duration / (this.count - 1);
    this.joints = data.robot.joints.length;
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

  ofJoints(quantity, time) {
    return Array.from({ length: this.joints }, (_, index) => this.value(`${quantity}.${index}`, time));
  }

  /* The robot at a time: orientation, joints, centre of mass, and the rotations of its bodies. */
  posture(time) {
    return this.pose(this.value("orientation", time), this.ofJoints("positions", time), [
      this.value("com_x", time),
      this.value("com_y", time),
    ]);
  }

  /* The robot in any posture; a body's absolute angle is orientation + turns . positions + offset. */
  pose(orientation, positions, com) {
    const { turn, turns, offsets } = this.data.robot;
    const rotations = turns.map((row, body) => {
      const angle = turn * row.reduce((sum, share, joint) => sum + share * positions[joint], orientation + offsets[body]);
      return [Math.cos(angle), Math.sin(angle)];
    });
    return { orientation, positions, com, rotations };
  }

  /* Place of a point: its weights, one complex number per body, times the rotations, from the centre of mass. */
  place(posture, weights) {
    let [x, y] = posture.com;
    for (let body = 0; body < weights.length; body++) {
      const [re, im] = weights[body];
      const [cosine, sine] = posture.rotations[body];
      x += re * cosine - im * sine;
      y += re * sine + im * cosine;
    }
    return [x, y];
  }

  /* Path of a point, or of the centre of mass where there are no weights: its place at every sample. */
  path(weights) {
    return Array.from(this.times, (time) => {
      const posture = this.posture(time);
      return weights ? this.place(posture, weights) : posture.com;
    });
  }
}
