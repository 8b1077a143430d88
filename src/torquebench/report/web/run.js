// The page of a run: its signals over time and its arm in space, under one clock.
"use strict";
const { period, samples, joints, controllers, arm } = DATA;
const end = (samples - 1) * period, asked = new URLSearchParams(location.hash.slice(1));
const only = asked.get("show")?.split(",");
const shown = new Set(controllers.filter(({ name }) => !only || only.includes(name)));
const signals = new Set(["error", "torque"]);
let joint = DATA.joint, time = 0, speed = Number(asked.get("speed")) || 1, playing = false, stale = true, zoomed = [0, end];
const times = Array.from({ length: samples }, (_, k) => k * period);

// --- signals

const memo = new Map();
function signal(owner, key, j) { // of one joint, in SI units
  const name = `${owner.name} ${key} ${j}`;
  if (!memo.has(name)) memo.set(name, unpack(owner[key], j, owner.samples ?? samples));
  return memo.get(name);
}
const reference = (j) => signal(DATA, "reference", j);
const scaled = (values, factor) => values.map((value) => (value === null ? null : factor * value));
const padded = (values) => (values.length < samples ? [...values, ...Array(samples - values.length).fill(null)] : values);
const level = (name, value) => ({ name, values: Array(samples).fill(value), colour: () => ink("soft"), dash: [6, 4], fixed: true });
const SIGNALS = {
  error: { unit: (j) => `m${joints[j].angle}`, of: (c, j) => scaled(signal(c, "error", j), 1000), extra: () => [] },
  torque: {
    unit: (j) => joints[j].torque, of: (c, j) => signal(c, "torque", j), stepped: true,
    extra: (j) => [level("", joints[j].limit), level("", -joints[j].limit)],
  },
  position: {
    unit: (j) => joints[j].angle, of: (c, j) => signal(c, "error", j).map((e, k) => (e === null ? null : reference(j)[k] - e)),
    extra: (j) => [{ name: "reference", values: reference(j), colour: () => ink("ink"), dash: [3, 3] }],
  },
  sliding: {
    unit: (j) => `${joints[j].angle}/s`, of: (c, j) => c.sliding && signal(c, "sliding", j),
    extra: (j) => [...new Set(controllers.map((c) => c.band?.[j]).filter(Boolean))].flatMap((phi) => [level("", phi), level("", -phi)]),
  },
};

// One chart of a signal of a joint; those that chatter most are drawn first, so that the others stay seen.
function draw(parent, key, j, more = {}) {
  const { unit, of, stepped, extra } = SIGNALS[key];
  const order = [...shown].sort((a, b) => (b.chattering ?? Infinity) - (a.chattering ?? Infinity));
  const lines = order.map((c) => ({ name: c.name, values: of(c, j), colour: () => shade(c.colour), stepped }));
  const known = lines.filter((line) => line.values).map((line) => ({ ...line, values: padded(line.values) }));
  return chart(parent, { x: [times, "t [s]"], label: `${key} [${unit(j)}]`, lines: [...known, ...extra(j)], ...more });
}

const marks = [];
function drawSignals() {
  for (const plot of charts) plot.destroy();
  charts.clear();
  marks.length = 0;
  at("signals").replaceChildren();
  for (const key of Object.keys(SIGNALS).filter((name) => signals.has(name))) {
    const rest = `${joints[joint].name}: ${key}` + (key === "torque" ? `, dashed: limit ± ${joints[joint].limit} ${joints[joint].torque}`
      : key === "position" ? ", dashed: reference" : key === "sliding" ? " variable, dashed: the bands" : "");
    const caption = made("figcaption", {}, rest), figure = made("figure", { class: "plot" }, caption);
    at("signals").append(figure);
    const plot = draw(figure, key, joint, { told: (text) => { caption.textContent = text ? `t = ${text} ${SIGNALS[key].unit(joint)}` : rest; } });
    const mark = made("div", { class: "now" });
    plot.over.append(mark);
    plot.over.addEventListener("click", (event) => plot.select.width < 2 && seek(plot.posToVal(event.offsetX, "x")));
    plot.hooks.setScale = [() => { zoomed = [plot.scales.x.min, plot.scales.x.max]; stale = true; }];
    plot.setScale("x", { min: zoomed[0], max: zoomed[1] });
    marks.push([plot, mark]);
  }
  stale = true;
}
function zoom(factor) { // about the time that is shown, if it is in sight
  const width = Math.min(end, factor * (zoomed[1] - zoomed[0])), seen = time >= zoomed[0] && time <= zoomed[1];
  const min = Math.min(Math.max(0, (seen ? time : (zoomed[0] + zoomed[1]) / 2) - width / 2), end - width);
  charts.forEach((plot) => plot.setScale("x", { min, max: min + width }));
}

// --- the arm: a tree of groups that joints turn and slide, drawn once for each controller beside its reference

const MOST = 1; // an exaggerated error is drawn no larger than this [rad or m]
const vector = (values) => new THREE.Vector3(...values);
function tree(material, moving) {
  const groups = [], moves = [];
  for (const body of arm.bodies) {
    let group = new THREE.Group();
    group.position.copy(vector(body.place));
    group.quaternion.set(body.turn[1], body.turn[2], body.turn[3], body.turn[0]);
    if (groups.length) groups[body.parent].add(group);
    for (const own of body.joints) {
      const pivot = new THREE.Group(), inner = new THREE.Group(), axis = vector(own.axis);
      pivot.position.copy(vector(own.place));
      inner.position.copy(vector(own.place)).negate();
      group.add(pivot.add(inner));
      moves.push((q) => (own.slides ? pivot.position.copy(vector(own.place)).addScaledVector(axis, q[own.of_q] - own.zero)
        : pivot.quaternion.setFromAxisAngle(axis, q[own.of_q] - own.zero)));
      group = inner;
    }
    for (const part of moving && !body.moves ? [] : body.parts) {
      const shape = new THREE.BufferGeometry(), corners = new Float32Array(new Int16Array(bytes(part.corners))).map((x) => x * part.scale);
      shape.setAttribute("position", new THREE.BufferAttribute(corners, 3));
      shape.setAttribute("normal", new THREE.BufferAttribute(new Int8Array(bytes(part.normals)), 3, true));
      group.add(new THREE.Mesh(shape, material(part.colour)));
    }
    groups.push(group);
  }
  const tool = groups[arm.tool.body], deepest = (group) => (group.children.find((x) => x.isGroup && !groups.includes(x)) ? deepest(group.children.find((x) => x.isGroup && !groups.includes(x))) : group);
  const tip = new THREE.Group();
  tip.position.copy(vector(arm.tool.place));
  deepest(tool).add(tip);
  return { root: groups[0], pose: (q) => moves.forEach((move) => move(q)), tip };
}

function stage(canvas) {
  THREE.ColorManagement.enabled = false;
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.outputColorSpace = "srgb-linear";
  renderer.setScissorTest(true);
  const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(50, 1, 0.02 * arm.reach, 60 * arm.reach);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);
  const home = () => { camera.position.set(...arm.eye); controls.target.set(...arm.target); controls.update(); };
  controls.enableZoom = false; // until a click: the wheel scrolls the page
  canvas.addEventListener("focus", () => { controls.enableZoom = true; });
  canvas.addEventListener("blur", () => { controls.enableZoom = false; });
  controls.listenToKeyEvents(canvas);
  controls.addEventListener("change", () => { stale = true; });
  at("reset").addEventListener("click", home);
  const sun = new THREE.DirectionalLight(0xffffff, 1.6), ghostly = new THREE.MeshLambertMaterial({
    transparent: true, opacity: 0.55, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8,
  });
  sun.position.set(-0.45, 0.55, 0.9);
  const body = tree((rgb) => new THREE.MeshLambertMaterial({ color: new THREE.Color(...rgb) }), false), ghost = tree(() => ghostly, true);
  const mark = new THREE.Mesh(new THREE.SphereGeometry(0.02 * arm.reach), new THREE.MeshBasicMaterial({ depthTest: false, transparent: true }));
  const trail = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
  const grid = new THREE.GridHelper(3.2 * arm.reach, 12);
  grid.rotation.x = Math.PI / 2;
  grid.position.z = arm.floor;
  grid.material.vertexColors = false;
  mark.renderOrder = 1;
  scene.add(new THREE.AmbientLight(0xffffff, 1.9), sun, grid, ghost.root, body.root, mark, trail);
  const labels = made("div");
  canvas.after(labels);
  home();

  const positions = (c, k, factor) => joints.map((_, j) => {
    let i = Math.min(k, c.samples - 1);
    while (i > 0 && signal(c, "error", j)[i] === null) i--;
    const e = signal(c, "error", j)[i] ?? 0;
    return (reference(j)[i] ?? 0) - Math.sign(e) * Math.min(factor * Math.abs(e), Math.max(MOST, Math.abs(e)));
  });
  const point = (q) => { body.pose(q); body.root.updateMatrixWorld(true); return body.tip.getWorldPosition(new THREE.Vector3()); };
  return (factor) => {
    const all = [...shown], width = canvas.parentNode.clientWidth, height = canvas.parentNode.clientHeight;
    if (!width || !all.length) return;
    const ratio = Math.min(devicePixelRatio, 2), columns = Math.ceil(Math.sqrt((all.length * width) / height / 1.3)) || 1;
    const across = Math.min(columns, all.length), rows = Math.ceil(all.length / across), w = width / across, h = height / rows;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height, false);
    }
    ghostly.color.set(ink("ghost"));
    mark.material.color.set(ink("tool"));
    trail.material.color.set(ink("trail"));
    grid.material.color.set(ink("ground"));
    camera.aspect = w / h;
    camera.zoom = 1.25;
    camera.fov = (360 / Math.PI) * Math.atan(Math.tan(arm.opening / 2) * Math.max(1, h / w));
    camera.updateProjectionMatrix();
    const k = Math.round(time / period), step = Math.max(1, Math.round(0.02 / period));
    ghost.pose(joints.map((_, j) => reference(j)[k]));
    labels.replaceChildren(...all.map((c, i) => {
      const x = (i % across) * w, y = Math.floor(i / across) * h, last = Math.min(k, c.samples - 1);
      const path = Array.from({ length: 50 }, (_, n) => last - (49 - n) * step).filter((i) => i > 0);
      trail.geometry.setFromPoints([...path.map((i) => point(positions(c, i, factor)))]);
      mark.position.copy(point(positions(c, k, factor)));
      renderer.setViewport(x, height - y - h, w, h);
      renderer.setScissor(x, height - y - h, w, h);
      renderer.render(scene, camera);
      trail.geometry.dispose();
      trail.geometry = new THREE.BufferGeometry();
      return made("span", { style: `left: ${x}px; top: ${y}px` }, c.name, made("b", {}, c.ending && k >= c.samples - 1 ? ` ${c.ending}` : ""));
    }));
  };
}

// --- the clock, hands, and paper

let drawArm = () => {};
function seek(wanted) {
  time = Math.min(Math.max(wanted, 0), end);
  stale = true;
}
function setPlaying(wanted) {
  playing = wanted;
  if (playing && time >= end) time = 0;
  stale = true;
}
function show() {
  for (const [plot, mark] of marks) {
    const left = plot.valToPos(time, "x");
    mark.style.left = `${left}px`;
    mark.hidden = left < 0 || left > plot.over.clientWidth;
  }
  drawArm(Number(at("exaggerate").value));
  at("play").textContent = playing ? "pause" : "play";
  at("now").textContent = `${time.toFixed(3)} / ${end.toFixed(2)} s`;
  at("scrub").value = String(time);
  document.body.dataset.time = time.toFixed(4);
}
let before = null;
function tick(now) {
  const passed = before === null ? 0 : Math.min((now - before) / 1000, 0.25);
  before = now;
  if (playing) {
    seek(time + passed * speed);
    if (time >= end) playing = false;
  }
  if (stale) {
    stale = false;
    show();
  }
  requestAnimationFrame(tick);
}
function toggles(parent, items, chosen, label) {
  for (const item of items) {
    const box = made("input", { type: "checkbox", checked: chosen.has(item), change: () => {
      if (box.checked) chosen.add(item); else chosen.delete(item);
      drawSignals();
    } });
    parent.append(made("label", {}, box, ...label(item)));
  }
}
function begin() {
  at("replay").hidden = false;
  at("joint").append(...joints.map(({ name }, j) => made("option", { value: j, selected: j === joint }, name)));
  at("joint").addEventListener("change", (event) => { joint = Number(event.target.value); drawSignals(); });
  toggles(at("choice"), controllers, shown, (c) => [made("span", { class: "swatch", style: `--own: ${c.colour}` }), c.name]);
  toggles(at("shown"), Object.keys(SIGNALS).filter((key) => key !== "sliding" || controllers.some((c) => c.sliding)), signals, (key) => [key]);
  for (const [id, factor] of [["closer", 0.5], ["farther", 2], ["all", Infinity]]) at(id).addEventListener("click", () => zoom(factor));
  const speeds = [...new Set([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, speed])].sort((a, b) => a - b);
  at("speed").append(...speeds.map((x) => made("option", { value: x, selected: x === speed }, `${x} ×`)));
  at("speed").addEventListener("change", (event) => { speed = Number(event.target.value); });
  at("exaggerate").addEventListener("change", () => { stale = true; });
  at("scrub").max = String(end);
  at("scrub").addEventListener("input", (event) => { playing = false; seek(Number(event.target.value)); });
  at("play").addEventListener("click", () => setPlaying(!playing));
  const keys = {
    " ": () => setPlaying(!playing), Home: () => seek(0), End: () => seek(end),
    ArrowLeft: (step) => { playing = false; seek(time - step); }, ArrowRight: (step) => { playing = false; seek(time + step); },
  };
  addEventListener("keydown", (event) => {
    const typed = event.target.closest("select, button, summary, canvas, th, a, video") || event.target.type === "checkbox";
    if (typed || event.ctrlKey || event.metaKey || event.altKey || !(event.key in keys)) return;
    event.preventDefault();
    keys[event.key](event.shiftKey ? 0.1 : Math.max(period, (zoomed[1] - zoomed[0]) / 400));
  });
  const canvas = document.querySelector("#arm canvas"), can = document.createElement("canvas").getContext("webgl2");
  const why = arm ? (can ? "" : "this browser has no WebGL, with which the arm is drawn") : DATA.why;
  if (why) canvas.replaceWith(made("p", { class: "soft" }, `The arm is not shown: ${why}.`));
  else {
    drawArm = stage(canvas);
    new ResizeObserver(() => { stale = true; }).observe(canvas.parentNode);
  }
  dark.addEventListener("change", () => { stale = true; });
  drawSignals();
  setPlaying(asked.has("play") && !matchMedia("(prefers-reduced-motion: reduce)").matches);
  requestAnimationFrame(tick);
}

// A page on paper has error and torque of every joint, small.
addEventListener("beforeprint", () => {
  onPaper = true;
  at("print").hidden = false;
  at("print").replaceChildren(made("h2", {}, "Over time"));
  joints.forEach(({ name }, j) => ["error", "torque"].forEach((key) => {
    const figure = made("figure", {}, made("figcaption", {}, `${name}: ${key}`));
    at("print").append(figure);
    draw(figure, key, j, { width: 340, height: 165 });
  }));
});
addEventListener("afterprint", () => {
  onPaper = false;
  at("print").hidden = true;
  at("print").replaceChildren();
});
begin();
