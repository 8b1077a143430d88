// The page: the replay from the server, one panel for each controller, and the clock that all of them share.

import { between, Orbit, project } from "./geometry.js";
import { drawer } from "./drawing.js";

const SPEEDS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10];
const TRAIL = 1; // length of the tool's trail [s]
const at = (id) => document.getElementById(id);
const made = (name, parent, text = "", kind = "") => {
  const element = parent.appendChild(document.createElement(name));
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
};

let scene = null, panels = [], reference = null, orbit = null, draws = null;
let time = 0, speed = 1, playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
let last = null, stale = true, colours = {};

// --- the replay

async function load() {
  try {
    begin(await (await fetch("replay.json")).json());
  } catch {
    at("status").textContent = "the replay cannot be loaded: is the command still running?";
  }
}

function begin(replay) {
  scene = replay;
  orbit = new Orbit(scene);
  draws = drawer(scene);
  document.body.dataset.drawn = draws.constructor.name;
  document.title = `${scene.title} – torquebench`;
  at("title").textContent = scene.title;
  at("status").textContent = "stored run";
  at("scrub").max = String(end());
  reference = Float32Array.from(scene.reference);
  panels = scene.controllers.map((controller) => new Panel(controller));
  setSpeed(scene.speed);
  stale = true;
}

// --- time

const end = () => Math.max(scene.count - 1, 0) * scene.period;

function seek(wanted) {
  time = Math.min(Math.max(wanted, 0), end());
  stale = true;
}

function setSpeed(wanted) {
  speed = wanted;
  const list = at("speed");
  list.replaceChildren();
  for (const choice of [...new Set([...SPEEDS, speed])].sort((a, b) => a - b)) {
    const option = made("option", list, `${choice}×`);
    option.value = String(choice);
    option.selected = choice === speed;
  }
}

function setPlaying(wanted) {
  playing = wanted;
  if (playing && time >= end()) time = 0;
  stale = true;
}

function tick(now) {
  const passed = last === null ? 0 : Math.min((now - last) / 1000, 0.25);
  last = now;
  if (scene && panels.length) {
    if (playing) {
      seek(time + passed * speed);
      if (time >= end()) playing = false;
    }
    if (stale) drawAll();
    stale = false;
  }
  requestAnimationFrame(tick);
}

// --- panels

class Panel {
  constructor({ name, note, ending, ...values }) {
    this.values = {};
    for (const key of ["bodies", "tool", "torque", "error"]) this.values[key] = Float32Array.from(values[key]);
    Object.assign(this, { ending, frames: values.tool.length / 3, n: scene.joints.length });
    this.peak = this.values.error.reduce((peak, x) => Math.max(peak, Math.abs(x)), 0);
    const section = made("section", at("panels"));
    const title = made("h2", section, name);
    made("span", title, note);
    made("strong", title, ending);
    this.view = this.canvas(section, "arm", `${name}: the arm and, in blue, its reference`);
    const below = made("div", section, "", "below");
    this.bars = this.plot(below, "bars", "torque / limit", `${name}: torque of each joint over its limit`);
    this.trace = this.plot(below, "trace", "error e", `${name}: tracking error over time`);
    listenToPointer(this.view.canvas);
    this.trace.canvas.addEventListener("pointerdown", (event) => {
      setPlaying(false);
      seek((event.offsetX / this.trace.canvas.clientWidth) * end());
    });
  }

  plot(parent, kind, title, label) {
    const figure = made("figure", parent);
    const caption = made("figcaption", figure);
    made("span", caption, title);
    return { ...this.canvas(figure, kind, label), note: made("span", caption) };
  }

  canvas(parent, kind, label) {
    const canvas = made("canvas", parent, "", kind);
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", label);
    new ResizeObserver(() => { stale = true; }).observe(canvas);
    return { canvas, context: canvas.getContext("2d") };
  }

  // Poses at this time; the last ones where it is later.
  poses(values) {
    const width = scene.parts.length * 7, last = values.length / width - 1;
    const position = Math.min(time / scene.period, last), first = Math.floor(position), second = Math.min(first + 1, last);
    const poses = [];
    for (let b = 0; b < scene.parts.length; b++) {
      poses.push(between(values, first * width + 7 * b, second * width + 7 * b, position - first));
    }
    return poses;
  }

  draw(scale) {
    this.drawArm();
    this.drawBars();
    this.drawTrace(scale);
  }

  drawArm() {
    const { canvas, context } = this.view;
    const [width, height, ratio] = fit(canvas);
    const camera = orbit.look(width, height);
    context.fillStyle = colours.css.sky;
    context.fillRect(0, 0, width, height);
    if (scene.floor !== null) drawFloor(context, camera, ratio);
    draws.draw(context, camera, this.poses(this.values.bodies), this.poses(reference), colours);
    this.drawTrail(context, camera, ratio);
  }

  drawTrail(context, camera, ratio) {
    const { tool } = this.values;
    const now = Math.min(time / scene.period, this.frames - 1), first = Math.max(0, Math.ceil(now - TRAIL / scene.period));
    const point = (k) => {
      const i = 3 * Math.floor(k), j = 3 * Math.min(Math.floor(k) + 1, this.frames - 1), part = k - Math.floor(k);
      return [0, 1, 2].map((c) => (1 - part) * tool[i + c] + part * tool[j + c]);
    };
    context.strokeStyle = colours.css.trail;
    context.lineWidth = 2 * ratio;
    context.lineCap = "butt"; // ends that overlap would show as dots
    let before = project(camera, point(first));
    for (let k = first + 1; k <= Math.ceil(now); k++) {
      const next = project(camera, point(Math.min(k, now)));
      if (before && next) {
        context.globalAlpha = 0.15 + 0.85 * Math.max(0, 1 - ((now - k) * scene.period) / TRAIL);
        context.beginPath();
        context.moveTo(before[0], before[1]);
        context.lineTo(next[0], next[1]);
        context.stroke();
      }
      before = next;
    }
    context.globalAlpha = 1;
    const tip = project(camera, point(now));
    if (!tip) return;
    context.fillStyle = colours.css.tool;
    context.beginPath();
    context.arc(tip[0], tip[1], 4.5 * ratio, 0, 2 * Math.PI);
    context.fill();
  }

  drawBars() {
    const { canvas, context } = this.bars;
    const [width, height, ratio] = fit(canvas);
    context.clearRect(0, 0, width, height);
    const row = height / this.n, names = Math.min(0.34 * width, 70 * ratio), size = Math.min(11 * ratio, 0.8 * row);
    const from = names, across = width - names, middle = from + across / 2;
    const now = Math.min(Math.floor(time / scene.period), this.frames - 1);
    context.font = `${size}px system-ui, sans-serif`;
    context.textBaseline = "middle";
    for (let j = 0; j < this.n; j++) {
      const y = j * row, h = Math.max(0.62 * row, ratio), top = y + 0.5 * (row - h);
      context.fillStyle = colours.css.soft;
      context.fillText(scene.joints[j], 0, y + row / 2, names - 6 * ratio);
      context.fillStyle = colours.css.track;
      context.fillRect(from, top, across, h);
      if (!(this.ending && time / scene.period > this.frames)) {
        const k = 3 * (now * this.n + j);
        const [low, high, mean] = this.values.torque.subarray(k, k + 3).map((x) => Math.max(-1, Math.min(1, x)));
        const x = (value) => middle + (value * across) / 2;
        context.fillStyle = scene.colours[j];
        context.globalAlpha = 0.4;
        context.fillRect(x(low), top, Math.max(x(high) - x(low), ratio), h);
        context.globalAlpha = 1;
        context.fillRect(Math.min(middle, x(mean)), top, Math.max(Math.abs(x(mean) - middle), ratio), h);
        context.fillStyle = colours.css.bad;
        if (high >= 0.9995) context.fillRect(x(1) - 4 * ratio, top, 4 * ratio, h);
        if (low <= -0.9995) context.fillRect(x(-1), top, 4 * ratio, h);
      }
    }
    context.fillStyle = colours.css.soft;
    context.fillRect(middle - ratio / 2, 0, ratio, height);
  }

  drawTrace(scale) {
    const { canvas, context, note } = this.trace;
    const [width, height, ratio] = fit(canvas);
    context.fillStyle = colours.css.page;
    context.fillRect(0, 0, width, height);
    const x = (k) => (k * scene.period * width) / Math.max(end(), 1e-9);
    const y = (value) => height / 2 - (0.46 * height * value) / scale;
    context.fillStyle = colours.css.line;
    context.fillRect(0, y(0), width, ratio);
    const every = Math.max(1, Math.floor(scene.count / (2 * width)));
    context.lineWidth = 1.3 * ratio;
    for (let j = 0; j < this.n; j++) {
      context.strokeStyle = scene.colours[j];
      context.beginPath();
      for (let k = 0; k < this.frames; k += every) {
        let low = Infinity, high = -Infinity;
        for (let i = k; i < Math.min(k + every, this.frames); i++) {
          low = Math.min(low, this.values.error[2 * (i * this.n + j)]);
          high = Math.max(high, this.values.error[2 * (i * this.n + j) + 1]);
        }
        context.lineTo(x(k), y(high));
        context.lineTo(x(k), y(low));
      }
      context.stroke();
    }
    context.fillStyle = colours.css.ink;
    context.fillRect(Math.min(x(time / scene.period), width - ratio), 0, ratio, height);
    note.textContent = `± ${Number((1000 * scale).toPrecision(3))} ${scene.unit.split("/").map((u) => `m${u}`).join("/")}`;
  }
}

function fit(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  return [width, height, ratio];
}

function drawFloor(context, camera, ratio) {
  const half = 1.6 * scene.reach, lines = 12, z = scene.floor;
  context.strokeStyle = colours.css.ground;
  context.lineWidth = ratio;
  for (let i = 0; i <= lines; i++) {
    const u = -half + (2 * half * i) / lines;
    for (const line of [(v) => [u, v, z], (v) => [v, u, z]]) {
      context.beginPath();
      let down = false;
      for (let k = 0; k <= 24; k++) {
        const point = project(camera, line(-half + (2 * half * k) / 24));
        if (!point) down = false;
        else if (down) context.lineTo(point[0], point[1]);
        else { context.moveTo(point[0], point[1]); down = true; }
      }
      context.stroke();
    }
  }
}

function drawAll() {
  const fair = panels.filter((panel) => !panel.ending); // a run that failed must not set the scale
  const scale = Math.max(...(fair.length ? fair : panels).map((panel) => panel.peak), 1e-9);
  for (const panel of panels) panel.draw(scale);
  at("play").textContent = playing ? "pause" : "play";
  at("clock").textContent = `${time.toFixed(2)} / ${end().toFixed(2)} s`;
  if (document.activeElement !== at("scrub") || playing) at("scrub").value = String(time);
  document.body.dataset.frame = String(Math.round(time / scene.period));
}

// --- hands

function listenToPointer(canvas) {
  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], size = canvas.clientHeight;
    const right = (now[0] - before[0]) / size, up = (now[1] - before[1]) / size;
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
      orbit.zoom(apart(before) / Math.max(apart(now), 1));
    } else if (event.shiftKey || event.buttons === 4) orbit.move(right, up);
    else orbit.turn(3 * right, 3 * up);
    fingers.set(event.pointerId, now);
    stale = true;
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    orbit.zoom(Math.exp(0.0012 * event.deltaY));
    stale = true;
  }, { passive: false });
}

function otherSpeed(step) {
  const choices = [...at("speed").options].map((option) => Number(option.value));
  setSpeed(choices[Math.min(Math.max(choices.indexOf(speed) + step, 0), choices.length - 1)]);
}

const step = (event, sign) => {
  setPlaying(false);
  const frames = event.shiftKey ? Math.max(1, Math.round(0.1 / scene.period)) : 1;
  seek((Math.round(time / scene.period) + sign * frames) * scene.period);
};
const KEYS = {
  " ": () => setPlaying(!playing),
  ArrowLeft: (event) => step(event, -1),
  ArrowRight: (event) => step(event, 1),
  ArrowUp: () => otherSpeed(1),
  ArrowDown: () => otherSpeed(-1),
  Home: () => seek(0),
  End: () => seek(Infinity),
};
addEventListener("keydown", (event) => {
  if (!scene || event.ctrlKey || event.metaKey || event.altKey || !(event.key in KEYS)) return;
  if (event.target instanceof HTMLSelectElement || (event.key === " " && event.target instanceof HTMLButtonElement)) return;
  event.preventDefault();
  KEYS[event.key](event);
});
at("play").addEventListener("click", () => scene && setPlaying(!playing));
at("reset").addEventListener("click", () => { orbit?.reset(); stale = true; });
at("speed").addEventListener("change", (event) => { setSpeed(Number(event.target.value)); event.target.blur(); });
at("scrub").addEventListener("input", (event) => { if (scene) { playing = false; seek(Number(event.target.value)); } });

function readColours() {
  const style = getComputedStyle(document.documentElement), css = {};
  for (const name of ["ink", "soft", "line", "page", "track", "bad", "sky", "ground", "shadow", "ghost", "trail", "tool"]) {
    css[name] = style.getPropertyValue(`--${name}`).trim();
  }
  const parts = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
  colours = { css, ghost: parts(css.ghost), shadow: parts(css.shadow), sky: parts(css.sky) };
  stale = true;
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColours);
readColours();
requestAnimationFrame(tick);
load();
