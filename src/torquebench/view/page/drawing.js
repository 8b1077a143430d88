// Drawing the triangles of arms: with WebGL, or without it triangle by triangle from the farthest to the nearest.

import { cross, dot, project, sub } from "./geometry.js";

const KEY = [-0.45, 0.55, 0.9].map((x) => x / Math.hypot(0.45, 0.55, 0.9)); // direction to the light
const FLOATS = 9; // of a corner: position, normal, colour
const GROWN = 0.008; // how far the ghost stands out, as a fraction of the arm's reach
const BEHIND = 1.08; // the ghost is this many times as far away: the arm hides it where both are

const VERTEX = `
attribute vec3 position, normal, colour;
uniform mat3 turn, view;
uniform vec3 place, eye, key, flatten;
uniform vec4 lens; // across, up: one over the slopes; near; far
uniform float grown, behind;
varying vec3 shade;
uniform vec4 tint; // colour, and how much of it
void main() {
  vec3 n = turn * normal, p = turn * (position + grown * normal) + place;
  if (flatten.x > 0.0) p -= key * (p.z - flatten.y) / key.z;
  vec3 v = view * (p - eye);
  float far = lens.w, near = lens.z, z = behind * v.z;
  gl_Position = vec4(lens.x * v.x, lens.y * v.y, (-z * (far + near) - 2.0 * far * near) / (far - near) * (v.z / z), -v.z);
  vec3 towards = normalize(eye - p);
  float light = 0.58 + 0.42 * max(dot(n, key), 0.0) + 0.10 * n.z + 0.06 * dot(n, towards);
  float gloss = pow(max(dot(n, normalize(key + towards)), 0.0), 24.0);
  shade = mix(colour * light + 0.12 * gloss, tint.rgb * (flatten.x > 0.0 ? 1.0 : 0.75 + 0.3 * dot(n, towards)), tint.a);
}`;
const FRAGMENT = `
precision mediump float;
varying vec3 shade;
uniform float alpha;
void main() { gl_FragColor = vec4(shade * alpha, alpha); }`;

export function partsOf(scene) {
  return scene.parts.map((part) => {
    const bytes = Uint8Array.from(atob(part.data), (c) => c.charCodeAt(0));
    return { moves: part.moves, data: new Float32Array(bytes.buffer) };
  });
}

const all = () => true, moving = (part) => part.moves;

class WithWebGl {
  constructor(gl, scene, parts) {
    this.gl = gl;
    this.scene = scene;
    this.parts = parts.map((part) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, part.data, gl.STATIC_DRAW);
      return { moves: part.moves, buffer, corners: part.data.length / FLOATS };
    });
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    this.at = {};
    for (const name of ["turn", "view", "place", "eye", "key", "flatten", "lens", "grown", "behind", "tint", "alpha"]) {
      this.at[name] = gl.getUniformLocation(program, name);
    }
    this.inputs = ["position", "normal", "colour"].map((name) => gl.getAttribLocation(program, name));
    this.inputs.forEach((input) => gl.enableVertexAttribArray(input));
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  draw(context, camera, arm, ghost, colours) {
    const { gl, at } = this;
    const canvas = gl.canvas;
    if (canvas.width !== camera.width || canvas.height !== camera.height) {
      canvas.width = camera.width;
      canvas.height = camera.height;
    }
    gl.viewport(0, 0, camera.width, camera.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    const [r, u, b] = camera.axes;
    gl.uniformMatrix3fv(at.view, false, [r[0], u[0], b[0], r[1], u[1], b[1], r[2], u[2], b[2]]);
    gl.uniform3fv(at.eye, camera.eye);
    gl.uniform3fv(at.key, KEY);
    const up = 1 / camera.slope;
    const reach = this.scene.reach;
    gl.uniform4f(at.lens, (up * camera.height) / camera.width, up, 0.02 * reach, BEHIND * (camera.distance + 20 * reach));
    const { floor } = this.scene;
    if (floor !== null && camera.eye[2] > floor) {
      gl.enable(gl.STENCIL_TEST); // each point of the floor is darkened once
      gl.stencilFunc(gl.EQUAL, 0, 255);
      gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
      gl.depthMask(false);
      this.pass(arm, all, { flatten: [1, floor, 0], tint: [...colours.shadow, 1], alpha: 0.55 });
      gl.depthMask(true);
      gl.disable(gl.STENCIL_TEST);
    }
    this.pass(arm, all, {});
    const look = { tint: [...colours.ghost, 1], grown: GROWN * reach, behind: BEHIND, alpha: 0.5 };
    gl.colorMask(false, false, false, false); // depth first: it must not show its own inside
    this.pass(ghost, moving, look);
    gl.colorMask(true, true, true, true);
    gl.depthFunc(gl.LEQUAL);
    this.pass(ghost, moving, look);
    gl.depthFunc(gl.LESS);
    context.drawImage(canvas, 0, 0);
  }

  pass(poses, wanted, { flatten = [0, 0, 0], tint = [0, 0, 0, 0], grown = 0, behind = 1, alpha = 1 }) {
    const { gl, at } = this;
    gl.uniform3fv(at.flatten, flatten);
    gl.uniform4fv(at.tint, tint);
    gl.uniform1f(at.grown, grown);
    gl.uniform1f(at.behind, behind);
    gl.uniform1f(at.alpha, alpha);
    this.parts.forEach((part, i) => {
      if (!wanted(part)) return;
      const t = poses[i].turn;
      gl.uniformMatrix3fv(at.turn, false, [t[0], t[3], t[6], t[1], t[4], t[7], t[2], t[5], t[8]]);
      gl.uniform3fv(at.place, poses[i].place);
      gl.bindBuffer(gl.ARRAY_BUFFER, part.buffer);
      this.inputs.forEach((input, k) => gl.vertexAttribPointer(input, 3, gl.FLOAT, false, 4 * FLOATS, 12 * k));
      gl.drawArrays(gl.TRIANGLES, 0, part.corners);
    });
  }
}

class Painter {
  constructor(scene, parts) {
    this.parts = parts;
  }

  draw(context, camera, arm, ghost, colours) {
    this.paint(context, camera, ghost, moving, colours.ghost.map((x, i) => 0.5 * (x + colours.sky[i])));
    this.paint(context, camera, arm, all, null);
  }

  paint(context, camera, poses, wanted, tint) {
    const seen = [];
    this.parts.forEach((part, i) => {
      if (!wanted(part)) return;
      const { turn: t, place } = poses[i];
      const { data } = part;
      for (let k = 0; k < data.length; k += 3 * FLOATS) {
        const world = [0, 1, 2].map((corner) => {
          const [x, y, z] = data.subarray(k + corner * FLOATS, k + corner * FLOATS + 3);
          return [0, 3, 6].map((row, axis) => t[row] * x + t[row + 1] * y + t[row + 2] * z + place[axis]);
        });
        const n = cross(sub(world[1], world[0]), sub(world[2], world[0]));
        if (dot(n, sub(camera.eye, world[0])) <= 0) continue;
        const points = world.map((p) => project(camera, p));
        if (points.includes(null)) continue;
        const size = Math.hypot(...n);
        const light = 0.62 + 0.42 * Math.max(dot(n, KEY) / size, 0) + (0.1 * n[2]) / size;
        const own = tint ?? data.subarray(k + 6, k + 9);
        seen.push({
          points, depth: Math.max(...points.map((p) => p[2])), // by the farthest corner: what lies on a large face stays on it
          colour: `rgb(${[0, 1, 2].map((c) => Math.round(255 * Math.min(1, own[c] * (tint ? 1 : light)))).join(",")})`,
        });
      }
    });
    seen.sort((a, b) => b.depth - a.depth);
    for (const { points, colour } of seen) {
      context.beginPath();
      points.forEach(([x, y]) => context.lineTo(x, y));
      context.closePath();
      context.fillStyle = context.strokeStyle = colour;
      context.fill();
      context.stroke(); // closes the seams
    }
  }
}

// What draws here: WebGL where the browser has it.
export function drawer(scene) {
  const parts = partsOf(scene);
  const gl = document.createElement("canvas").getContext("webgl", { antialias: true, stencil: true });
  return gl ? new WithWebGl(gl, scene, parts) : new Painter(scene, parts);
}
