// Vectors, poses and the camera; z is up, lengths are in metres.

export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

// Rotation matrix (row by row) and position of a body, from position and quaternion (w, x, y, z) at `at` in `values`.
export function pose(values, at) {
  const [px, py, pz, w, x, y, z] = values.subarray(at, at + 7);
  return {
    turn: [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ],
    place: [px, py, pz],
  };
}

// Pose between two stored ones; `part` is 0 at the first. Frames are so near that a straight line between quaternions does.
export function between(values, first, second, part) {
  const mixed = new Float64Array(7);
  let along = 0;
  for (let i = 3; i < 7; i++) along += values[first + i] * values[second + i];
  const sign = along < 0 ? -1 : 1;
  for (let i = 0; i < 7; i++) {
    mixed[i] = (1 - part) * values[first + i] + part * (i < 3 ? 1 : sign) * values[second + i];
  }
  const size = Math.hypot(mixed[3], mixed[4], mixed[5], mixed[6]);
  for (let i = 3; i < 7; i++) mixed[i] /= size;
  return pose(mixed, 0);
}

// A camera that circles a target.
export class Orbit {
  constructor(scene) {
    this.scene = scene;
    this.reset();
  }

  reset() {
    const away = sub(this.scene.eye, this.scene.target);
    this.target = [...this.scene.target];
    this.distance = Math.hypot(...away);
    this.azimuth = Math.atan2(away[1], away[0]);
    this.height = Math.asin(away[2] / this.distance);
  }

  turn(right, up) {
    this.azimuth -= right;
    this.height = Math.min(1.55, Math.max(-1.55, this.height + up));
  }

  zoom(factor) {
    const reach = this.scene.reach;
    this.distance = Math.min(20 * reach, Math.max(0.3 * reach, this.distance * factor));
  }

  // Move the target by a fraction of the picture's height.
  move(right, up) {
    const { axes } = this.look(1, 1);
    const size = 2 * this.distance * Math.tan(this.scene.opening / 2);
    for (let i = 0; i < 3; i++) this.target[i] += size * (up * axes[1][i] - right * axes[0][i]);
  }

  // The camera for a picture of this size: a picture higher than wide opens as wide as a square one.
  look(width, height) {
    const { azimuth: a, height: h } = this;
    const back = [Math.cos(h) * Math.cos(a), Math.cos(h) * Math.sin(a), Math.sin(h)];
    const right = [-Math.sin(a), Math.cos(a), 0];
    const eye = this.target.map((x, i) => x + this.distance * back[i]);
    const slope = Math.tan(this.scene.opening / 2) * Math.max(1, height / width);
    return { eye, axes: [right, cross(back, right), back], slope, width, height, distance: this.distance };
  }
}

// Where a point is in a camera's picture: right, down, and distance along the camera's axis; null behind it.
export function project(camera, point) {
  const from = sub(point, camera.eye);
  const depth = -dot(from, camera.axes[2]);
  if (depth < 1e-3) return null;
  const scale = (0.5 * camera.height) / camera.slope / depth;
  return [
    0.5 * camera.width + scale * dot(from, camera.axes[0]), 0.5 * camera.height - scale * dot(from, camera.axes[1]), depth,
  ];
}
