// Shared by all pages: tables that sort, the theme's colours, packed signals, and charts with labelled axes.
"use strict";
const at = (id) => document.getElementById(id);
const DATA = JSON.parse(at("data")?.textContent ?? "null");

// Make an element: its tag, its attributes (a function listens to an event), what is in it.
function made(tag, attributes = {}, ...inside) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(key, value);
    else if (value === true) element.setAttribute(key, "");
    else if (value !== false && value !== null) element.setAttribute(key, value);
  }
  element.append(...inside);
  return element;
}

// --- tables: a click on a title, or Enter, sorts by its column; again the other way round; what is no number comes last

const keyOf = (row, column) => {
  const cell = row.cells[column], text = cell.dataset.value ?? cell.textContent.trim(), number = parseFloat(text.replace(/^x/, ""));
  return Number.isNaN(number) ? [1, text] : [0, number];
};
for (const title of document.querySelectorAll("table.sortable thead th")) {
  const sort = () => {
    const body = title.closest("table").tBodies[0], column = title.cellIndex;
    const order = title.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of title.parentNode.children) other.removeAttribute("aria-sort");
    title.setAttribute("aria-sort", order === 1 ? "ascending" : "descending");
    const rows = [...body.rows].map((row) => [keyOf(row, column), row]);
    rows.sort(([[x, a]], [[y, b]]) => x - y || order * (a > b ? 1 : a < b ? -1 : 0));
    body.append(...rows.map(([, row]) => row));
  };
  title.tabIndex = 0;
  title.addEventListener("click", sort);
  title.addEventListener("keydown", (event) => event.key === "Enter" && sort());
}

// --- commands: the folder of the page, as a shell takes it, in place of RUN

const quoted = (text) => (/^[\w.,:=/+-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);
const folder = location.protocol === "file:" ? decodeURIComponent(location.pathname).replace(/\/[^/]*$/, "").replace(/^\/(?=[A-Z]:)/, "") : "RUN";
for (const command of document.querySelectorAll("dl.commands code")) {
  command.textContent = command.textContent.replace(/RUN(\/\S+)?/, (_, file) => quoted(folder + (file ?? "")));
}
if (folder !== "RUN") document.querySelectorAll(".where").forEach((told) => told.remove());
for (const button of document.querySelectorAll("button.copy")) {
  button.addEventListener("click", async () => {
    await navigator.clipboard?.writeText(button.previousElementSibling.textContent);
    button.textContent = "copied";
  });
}

// --- theme

const dark = matchMedia("(prefers-color-scheme: dark)");
let onPaper = false; // while printing all is drawn as in the light theme
const PAPER = { ink: "#1b1f24", soft: "#57606a", line: "#d0d7de" };
const ink = (name) => (onPaper && PAPER[name]) || getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// A controller's colour, lighter in the dark theme, as red, green, blue.
function shade(hex) {
  const light = dark.matches && !onPaper ? 0.3 : 0, part = (i) => parseInt(hex.slice(i, i + 2), 16);
  return `rgb(${[1, 3, 5].map((i) => Math.round(part(i) + light * (255 - part(i)))).join(", ")})`;
}

// --- packed signals: 16-bit integers times the scale of their block of samples; -32768 is no number

const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
function unpack(packed, joint, samples) {
  const { block } = packed, blocks = Math.ceil(samples / block);
  const all = (packed.all ??= new Int16Array(bytes(packed.values))), scales = (packed.scales ??= new Float32Array(bytes(packed.scale)));
  return Array.from({ length: samples }, (_, k) => {
    const value = all[joint * samples + k];
    return value === -32768 ? null : value * scales[joint * blocks + Math.floor(k / block)];
  });
}

// --- charts

const digits = (value) => (value === null || value === undefined ? "-" : String(Number(value.toPrecision(4))));
const charts = new Set(); // those on the screen; they follow its width and its theme

// Draw lines over one axis.
//   x: [values, label]; label: of the other axis; height [px]
//   lines: {name, values, colour, width, dash, stepped, fixed: whether it leaves the range alone, points}
//   more: options of uPlot; told(text): hears the values under the pointer
function chart(parent, { x, label, lines, height = 220, width, more = {}, told }) {
  const soft = () => ink("soft"), grid = { stroke: () => ink("line"), width: 1 };
  const axis = { stroke: soft, grid, ticks: grid, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", labelSize: 18 };
  const plot = new uPlot({
    width: width ?? parent.clientWidth, height, legend: { show: false },
    cursor: { sync: { key: "all" }, drag: { x: true, y: false }, points: { size: 5 } },
    scales: { x: { time: false } },
    axes: [{ ...axis, size: 34, label: x[1] }, { ...axis, size: 60, space: 24, label }],
    series: [{}, ...lines.map((line) => ({
      label: line.name, stroke: () => line.colour(), width: line.width ?? 1.25, dash: line.dash, auto: !line.fixed,
      points: { show: line.points ?? false }, paths: line.stepped ? uPlot.paths.stepped({ align: 1 }) : undefined,
    }))],
    hooks: { setCursor: [(u) => {
      const k = u.cursor.idx;
      if (told) told(k === null || k === undefined ? "" : `${digits(u.data[0][k])}: ` + lines.map((line, i) =>
        line.name && `${line.name} ${digits(u.data[i + 1][k])}`).filter(Boolean).join(", "));
    }] },
    ...more,
  }, [x[0], ...lines.map((line) => line.values)], parent);
  if (width === undefined) {
    charts.add(plot);
    new ResizeObserver(() => parent.clientWidth && plot.setSize({ width: parent.clientWidth, height })).observe(parent);
  }
  return plot;
}
dark.addEventListener("change", () => charts.forEach((plot) => plot.redraw(false)));
