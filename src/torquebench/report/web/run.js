// The page of a run: its signals over time and its arm in space, under one clock.
"use strict";
const { period, samples, joints, controllers, arm } = DATA;
const end = (samples - 1) * period, asked = new URLSearchParams(location.hash.slice(1)), only = asked.get("show")?.split(",");
const shown = new Set(controllers.filter(({ name }) => !only || only.includes(name))), signals = new Set(["error", "torque"]);
if (controllers.some(({ deflection }) => deflection)) signals.add("deflection");
let joint = DATA.joint, time = 0, speed = Number(asked.get("speed")) || 1, playing = false, stale = true, zoomed = [0, end];
const times = Array.from({ length: samples }, (_, k) => k * period);

// --- signals: charts of the chosen joint, with the limits and the reference dashed

const memo = new Map();
function signal(owner, key, j) { // of one joint, in SI units
  const name = `${owner.name} ${key} ${j}`;
  if (!memo.has(name)) memo.set(name, unpack(owner[key], j, owner.samples));
  return memo.get(name);
}
const reference = (j) => signal(DATA, "reference", j);
const each = (values, change) => values.map((value, k) => (value === null ? null : change(value, k)));
const dashed = (name, values, fixed) => ({ name, values, colour: () => ink("soft"), dash: [5, 4], fixed });
const level = (value) => [value, -value].map((x) => dashed("", Array(samples).fill(x), true));
const SIGNALS = {
  error: { unit: ({ angle }) => `m${angle}`, of: (c, j) => each(signal(c, "error", j), (e) => 1000 * e), more: () => [] },
  torque: { unit: ({ torque }) => torque, of: (c, j) => signal(c, "torque", j), more: (j) => level(joints[j].limit), stepped: true },
  position: { unit: ({ angle }) => angle, of: (c, j) => each(signal(c, "error", j), (e, k) => reference(j)[k] - e),
    more: (j) => [dashed("reference", reference(j))] },
  sliding: { unit: ({ angle }) => `${angle}/s`, of: (c, j) => c.sliding && signal(c, "sliding", j),
    more: (j) => [...new Set(controllers.map(({ band }) => band?.[j]))].filter(Boolean).flatMap(level) },
  deflection: { unit: ({ angle }) => `m${angle}`, of: (c, j) => c.deflection && each(signal(c, "deflection", j), (x) => 1000 * x), more: () => [] },
};

// One chart; what swings most from sample to sample is drawn first and widest, so that the others stay seen.
const swing = (values) => values.reduce((sum, x, k) => sum + (k && x !== null ? Math.abs(x - values[k - 1]) : 0), 0) / values.length;
const reach = (values) => values.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
function draw(parent, key, j, more = {}) {
  const { unit, of, stepped, more: beside } = SIGNALS[key];
  const lines = [...shown].map((c) => ({ name: c.name, values: of(c, j), colour: () => shade(c.colour), stepped })).filter((line) => line.values);
  lines.sort((a, b) => swing(b.values) - swing(a.values));
  lines.forEach((line, k) => { line.width = 1.25 + 0.3 * (lines.length - 1 - k); });
  if (at("fit")?.checked) [...lines].sort((a, b) => reach(b.values) - reach(a.values)).slice(0, lines.length / 2).forEach((line) => { line.fixed = true; });
  for (const line of lines) line.values = Array.from(times, (_, k) => line.values[k] ?? null); // a failed run is shorter
  return chart(parent, { x: [times, "t [s]"], label: `${key} [${unit(joints[j])}]`, lines: [...lines, ...beside(j)], ...more });
}
const marks = [];
function drawSignals() {
  charts.forEach((plot) => plot.destroy());
  charts.clear();
  marks.length = 0;
  at("signals").replaceChildren();
  for (const key of Object.keys(SIGNALS).filter((name) => signals.has(name))) {
    const { name, limit, torque } = joints[joint], unit = SIGNALS[key].unit(joints[joint]);
    let rest = `${name}: ${key}${key === "torque" ? `, limit ± ${limit} ${torque}` : { sliding: " variable", deflection: " of the joint, motor - link" }[key] ?? ""}`;
    const said = rest, bands = key === "sliding" ? controllers.map(({ band }) => band?.[joint] ?? Infinity) : [];
    const caption = made("figcaption", {}, rest), figure = made("figure", { class: "plot" }, caption), mark = made("div", { class: "now" });
    at("signals").append(figure);
    const plot = draw(figure, key, joint, { told: (text) => { caption.textContent = text ? `t = ${text} ${unit}` : rest; } });
    plot.over.append(mark);
    plot.over.addEventListener("click", (event) => plot.select.width < 2 && seek(plot.posToVal(event.offsetX, "x")));
    plot.hooks.setScale = [() => { zoomed = [plot.scales.x.min, plot.scales.x.max]; stale = true; }];
    const isIn = (x) => x > plot.scales.y.min && x < plot.scales.y.max;
    plot.hooks.draw = [() => { caption.textContent = rest = said + (bands.some((x) => isIn(x) || isIn(-x)) ? ", dashed: the bands" : ""); }];
    plot.setScale("x", { min: zoomed[0], max: zoomed[1] });
    marks.push([plot, mark]);
  }
  stale = true;
}
const inSight = () => time >= zoomed[0] && time <= zoomed[1];
function zoom(factor, centre = inSight() ? time : (zoomed[0] + zoomed[1]) / 2) {
  const width = Math.min(end, factor * (zoomed[1] - zoomed[0])), min = Math.min(Math.max(0, centre - width / 2), end - width);
  charts.forEach((plot) => plot.setScale("x", { min, max: min + width }));
}

// --- the arm: groups that joints turn and slide, drawn once for each controller beside its reference

const MOST = 1; // an exaggerated error is drawn no larger than this [rad or m]
function tree(material, moving) {
  const root = new THREE.Group(), groups = [], moves = [], tip = new THREE.Group();
  for (const { parent, place, turn, joint: own, moves: goes, parts } of arm.nodes) {
    const group = new THREE.Group(), axis = own && new THREE.Vector3(...own.axis);
    group.position.set(...place);
    group.quaternion.set(...turn);
    (groups[parent] ?? root).add(group);
    groups.push(group);
    if (own) moves.push((q) => (own.slides ? group.position.set(...place).addScaledVector(axis, q[own.of_q] - own.zero)
      : group.quaternion.setFromAxisAngle(axis, q[own.of_q] - own.zero)));
    for (const part of moving && !goes ? [] : parts) {
      const shape = new THREE.BufferGeometry(), corners = new Float32Array(new Int16Array(bytes(part.corners))).map((x) => x * part.scale);
      shape.setAttribute("position", new THREE.BufferAttribute(corners, 3));
      shape.setAttribute("normal", new THREE.BufferAttribute(new Int8Array(bytes(part.normals)), 3, true));
      group.add(new THREE.Mesh(shape, material(part.colour)));
    }
  }
  tip.position.set(...arm.tool.place);
  groups[arm.tool.node].add(tip);
  return { root, tip, pose: (q) => moves.forEach((move) => move(q)) };
}

// The positions that are drawn: the last known ones where there are none, errors `factor` times as large.
function positions(c, k, factor) {
  let i = Math.min(k, c.samples - 1);
  while (i > 0 && joints.some((_, j) => signal(c, "error", j)[i] === null)) i--;
  return joints.map((_, j) => {
    const e = signal(c, "error", j)[i] ?? 0;
    return reference(j)[i] - Math.sign(e) * Math.min(factor * Math.abs(e), Math.max(MOST, Math.abs(e)));
  });
}

function stage(canvas) {
  THREE.ColorManagement.enabled = false;
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.outputColorSpace = "srgb-linear";
  renderer.setScissorTest(true);
  const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(50, 1, 0.02 * arm.reach, 60 * arm.reach);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas), labels = made("div");
  const home = () => { camera.position.set(...arm.eye); controls.target.set(...arm.target); controls.update(); };
  for (const kind of ["focus", "blur"]) canvas.addEventListener(kind, () => { controls.enableZoom = kind === "focus"; });
  controls.enableZoom = false; // until a click: the wheel scrolls the page
  controls.listenToKeyEvents(canvas);
  controls.addEventListener("change", () => { stale = true; });
  at("reset").addEventListener("click", home);
  home();
  const ghostly = new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.55, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8 });
  const body = tree((rgb) => new THREE.MeshLambertMaterial({ color: new THREE.Color(...rgb) }), false), ghost = tree(() => ghostly, true);
  const mark = new THREE.Mesh(new THREE.SphereGeometry(0.02 * arm.reach), new THREE.MeshBasicMaterial({ depthTest: false, transparent: true }));
  const [trail, wanted] = [1, 0].map((order) => {
    const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    line.renderOrder = order;
    return line;
  });
  const sun = new THREE.DirectionalLight(0xffffff, 1.6);
  const grid = new THREE.GridHelper(3.2 * arm.reach, 12);
  grid.rotation.x = Math.PI / 2;
  grid.position.z = arm.floor;
  grid.material.vertexColors = false;
  sun.position.set(-0.45, 0.55, 0.9);
  scene.add(new THREE.AmbientLight(0xffffff, 1.9), sun, grid, ghost.root, body.root, mark, trail, wanted);
  canvas.after(labels);
  const point = (q) => { body.pose(q); body.root.updateMatrixWorld(true); return body.tip.getWorldPosition(new THREE.Vector3()); };
  // Of a path of the tool the whole is shown, wanted and travelled; of other motions the last second.
  const drawn = DATA.path_from !== null, first = Math.round(DATA.path_from / period), stride = Math.max(1, Math.floor((samples - first) / 800));
  const walks = new Map();
  function walk(name, pose) {
    if (!walks.has(name)) walks.set(name, Array.from({ length: Math.floor((samples - 1 - first) / stride) + 1 }, (_, n) => point(pose(first + n * stride))));
    return walks.get(name);
  }
  if (drawn) wanted.geometry.setFromPoints(walk("reference", (k) => joints.map((_, j) => reference(j)[k])));
  return (factor) => { // a part of the canvas for each controller that is shown
    const all = [...shown], { clientWidth: width, clientHeight: height } = canvas.parentNode;
    if (!width || !all.length) return;
    const across = Math.min(all.length, Math.ceil(Math.sqrt((all.length * width) / height / 1.3)), Math.ceil(width / 130)); // room for a name
    const h = height / Math.ceil(all.length / across), k = Math.round(time / period), step = Math.max(1, Math.round(0.02 / period));
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    for (const [material, name] of [[ghostly, "ghost"], [wanted.material, "ghost"], [mark.material, "tool"], [trail.material, "trail"], [grid.material, "ground"]]) material.color.set(ink(name));
    ghost.pose(joints.map((_, j) => reference(j)[k]));
    labels.replaceChildren(...all.map((c, i) => {
      const row = Math.floor(i / across), w = width / Math.min(across, all.length - row * across); // the last row is filled too
      const x = (i % across) * w, y = row * h, last = Math.min(k, c.samples - 1);
      const recent = drawn ? [] : Array.from({ length: 50 }, (_, n) => last - (49 - n) * step).filter((n) => n > 0);
      const whole = drawn ? walk(`${c.name} ${factor}`, (n) => positions(c, n, factor)).slice(0, Math.max(0, Math.ceil((last - first) / stride))) : [];
      const path = [...whole, ...recent.map((n) => point(positions(c, n, factor)))];
      mark.position.copy(point(positions(c, k, factor)));
      trail.geometry.dispose();
      trail.geometry = new THREE.BufferGeometry().setFromPoints(whole.length ? [...path, mark.position] : path);
      camera.aspect = w / h;
      camera.fov = (360 / Math.PI) * Math.atan(Math.tan(arm.opening / 2) * Math.max(1, h / w));
      camera.updateProjectionMatrix();
      renderer.setViewport(x, height - y - h, w, h);
      renderer.setScissor(x, height - y - h, w, h);
      renderer.render(scene, camera);
      return made("span", { style: `left: ${x}px; top: ${y}px; max-width: ${w}px` }, c.name, made("b", {}, c.ending && k >= c.samples - 1 ? ` ${c.ending}` : ""));
    }));
  };
}

// --- the clock and hands

let drawArm = () => {}, before = 0;
function seek(wanted) {
  time = Math.min(Math.max(wanted, 0), end);
  if (!inSight()) zoom(1, time);
  stale = true;
}
function setPlaying(wanted) { playing = wanted; seek(playing && time >= end ? 0 : time); }
function tick(now) {
  const passed = Math.min((now - before) / 1000, 0.25);
  before = now;
  if (playing) seek(time + passed * speed);
  if (time >= end) playing = false;
  requestAnimationFrame(tick);
  if (!stale) return;
  stale = false;
  for (const [plot, mark] of marks) {
    mark.style.left = `${plot.valToPos(time, "x")}px`;
    mark.hidden = !inSight();
  }
  drawArm(Number(at("exaggerate").value));
  at("play").textContent = playing ? "pause" : "play";
  at("now").textContent = `${time.toFixed(3)} / ${end.toFixed(2)} s`;
  at("scrub").value = String(time);
  document.body.dataset.time = time.toFixed(4);
}
for (const box of document.querySelectorAll("#choice input, #shown input")) {
  const [chosen, item] = box.name === "controller" ? [shown, controllers[box.value]] : [signals, box.value];
  box.checked = chosen.has(item);
  box.addEventListener("change", () => { chosen[box.checked ? "add" : "delete"](item); drawSignals(); });
}
const KEYS = {
  " ": () => setPlaying(!playing), Home: () => seek(0), End: () => seek(end),
  ArrowLeft: (step) => { playing = false; seek(time - step); }, ArrowRight: (step) => { playing = false; seek(time + step); },
};
addEventListener("keydown", (event) => {
  const typed = event.target.closest("select, button, summary, canvas, th, a, video, [type=checkbox]");
  if (typed || event.ctrlKey || event.metaKey || event.altKey || !(event.key in KEYS)) return;
  event.preventDefault();
  KEYS[event.key](event.shiftKey ? 0.1 : Math.max(period, (zoomed[1] - zoomed[0]) / 400));
});
const on = (id, kind, act) => at(id).addEventListener(kind, (event) => act(Number(event.target.value)));
at("fit")?.addEventListener("change", drawSignals);
on("joint", "change", (value) => { joint = value; drawSignals(); });
on("speed", "change", (value) => { speed = value; });
on("exaggerate", "change", () => { stale = true; });
on("scrub", "input", (value) => { playing = false; seek(value); });
on("play", "click", () => setPlaying(!playing));
for (const [id, factor] of [["closer", 0.5], ["farther", 2], ["all", Infinity]]) on(id, "click", () => zoom(factor));
dark.addEventListener("change", () => { stale = true; });

// A page on paper has error and torque of every joint, small.
addEventListener("beforeprint", () => {
  onPaper = true;
  at("print").hidden = false;
  const own = (c) => made("span", { class: "own" }, made("span", { class: "swatch", style: `--own: ${c.colour}` }), c.name);
  at("print").replaceChildren(made("h2", {}, "Over time"), made("p", { class: "legend" }, ...[...shown].map(own)));
  joints.forEach(({ name }, j) => ["error", "torque"].forEach((key) => {
    const figure = made("figure", {}, made("figcaption", {}, `${name}: ${key}`));
    at("print").append(figure);
    draw(figure, key, j, { width: 340, height: 140 });
  }));
});
addEventListener("afterprint", () => {
  onPaper = false;
  at("print").hidden = true;
  at("print").replaceChildren();
});

at("replay").hidden = false;
at("scrub").max = String(end);
at("joint").value = String(joint);
if (![...at("speed").options].some(({ value }) => Number(value) === speed)) at("speed").append(made("option", { value: speed }, `${speed} ×`));
at("speed").value = String(speed);
const canvas = document.querySelector("#arm canvas"), can = document.createElement("canvas").getContext("webgl2");
const why = DATA.why || (can ? "" : "this browser has no WebGL, with which the arm is drawn");
if (why) canvas.replaceWith(made("p", { class: "soft" }, `The arm is not shown: ${why}.`));
else {
  drawArm = stage(canvas);
  new ResizeObserver(() => { stale = true; }).observe(canvas.parentNode);
}
drawSignals();
setPlaying(asked.has("play") && !matchMedia("(prefers-reduced-motion: reduce)").matches);
requestAnimationFrame(tick);
