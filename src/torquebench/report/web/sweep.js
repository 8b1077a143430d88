// The page of a sweep: the table of its best cases and the front follow what counts, and say how to run a case again.
"use strict";
const { laws, keys, metrics, places } = DATA, MOST_ENDS = 200, MOST_POINTS = 3000; // points up to which intervals are drawn, and points
const [ERROR, CHATTERING] = ["rmse", "chattering"].map((key) => metrics.findIndex((metric) => metric.key === key)), PAIR = [ERROR, CHATTERING].filter((m) => m >= 0);
const roles = keys.map((key) => (key.worst ? "worst" : "each")), limits = metrics.map(() => Infinity); // a role may be the number of the value that alone counts
let by = Math.max(ERROR, 0), turned = 1, most = 20, chosen = null; // metric that ranks, and how; rows shown; the chosen row's number
let hue = laws.length > 1 ? -1 : keys.findIndex((key) => !key.worst && key.words.length > 1); // key that colours, -1: the law

// --- every law with every choice, each metric from the row in which it is worst; one that is missing is worse than any

const bad = (m, r) => ((metrics[m]?.mean[r] ?? null) === null ? Infinity : (metrics[m].lower ? 1 : -1) * metrics[m].mean[r]);
const scaled = (x, m) => ((x ?? null) === null ? null : x * metrics[m].scale), value = (one, m, end = "mean") => scaled(metrics[m][end]?.[one.at[m]], m);
const missing = (one) => one.failed > 0 || PAIR.some((m) => value(one, m) === null);
const meets = (one) => PAIR.every((m) => limits[m] === Infinity || (value(one, m) ?? Infinity) <= limits[m]);

function choices() {
  const groups = new Map();
  DATA.law.forEach((law, r) => {
    if (roles.some((role, k) => Number.isInteger(role) && places[k][r] >= 0 && places[k][r] !== role)) return;
    const id = [law, ...roles.map((role, k) => (role === "worst" ? "" : places[k][r]))].join();
    if (groups.get(id)?.push(r) === undefined) groups.set(id, [r]);
  });
  const all = [...groups.values()].map((own) => {
    const sum = (column) => own.reduce((total, r) => total + column[r], 0), runs = sum(DATA.runs);
    const at = metrics.map((_, m) => own.reduce((a, b) => (bad(m, b) > bad(m, a) ? b : a)));
    return { at, row: at[by] ?? own[0], law: DATA.law[own[0]], runs, failed: runs - sum(DATA.completed), cases: own.length };
  });
  const rank = (one) => (bad(by, one.at[by]) === Infinity ? Number.MAX_VALUE : turned * bad(by, one.at[by]));
  all.sort((a, b) => missing(a) - missing(b) || rank(a) - rank(b) || a.row - b.row);
  const whole = PAIR.length < 2 ? [] : all.filter((one) => !missing(one) && meets(one)).sort((a, b) => value(a, CHATTERING) - value(b, CHATTERING) || value(a, ERROR) - value(b, ERROR));
  whole.reduce((least, one) => ((one.front = value(one, ERROR) < least) ? value(one, ERROR) : least), Infinity); // no other is better in both
  return all;
}

const ends = (values) => [values.reduce((a, b) => Math.min(a, b), Infinity), values.reduce((a, b) => Math.max(a, b), -Infinity)];
const word = (k, r) => (places[k][r] < 0 ? "-" : keys[k].words[places[k][r]]);
const mean = (one, m) => digits(value(one, m)) + (value(one, m, "low") === null ? "" : ` [${digits(value(one, m, "low"))}, ${digits(value(one, m, "high"))}]`);
const named = (one) => [laws.length > 1 || !keys.length ? laws[one.law][0] : "", ...keys.map((key, k) => places[k][one.row] >= 0 && `${key.name} ${word(k, one.row)}`)].filter(Boolean).join(", ");
const tone = (place, count) => `hsl(${250 - (215 * place) / Math.max(count - 1, 1)} 75% ${dark.matches && !onPaper ? 64 : 44}%)`;
const swatch = (own) => made("span", { class: "swatch", style: `--own: ${own}` }), colour = (one) => (hue < 0 ? shade(laws[one.law][1]) : places[hue][one.row] < 0 ? ink("soft") : tone(places[hue][one.row], keys[hue].words.length));

// --- the front; an axis is logarithmic where values differ much

function axisOf(values, from, to) {
  const [low, high] = ends(values), wide = low > 0 && high > 3 * low;
  const f = wide ? Math.log : (x) => x, pad = 0.06 * (f(high) - f(low)) || 0.1 * Math.abs(high) || 1, a = f(low) - pad, b = f(high) + pad;
  const step = [1, 2, 5, 10].map((x) => x * 10 ** Math.floor(Math.log10((b - a) / 6))).find((x) => (b - a) / x <= 8);
  const log = [[1], [1, 3], [1, 2, 5], [1, 2, 3, 4, 5, 6, 8]].map((mantissas) => [...Array(40).keys()].flatMap((d) => mantissas.map((x) => Number(`${x}e${d - 20}`))).filter((x) => f(x) >= a && f(x) <= b));
  const even = [...Array(12).keys()].map((i) => (Math.ceil(a / step) + i) * step).filter((x) => x <= b);
  return { at: (x) => (from + (to - from) * Math.min(Math.max((f(wide ? Math.max(x, low / 10) : x) - a) / (b - a), 0), 1)).toFixed(1), ticks: wide ? log.find((own) => own.length >= 4) ?? log[3] : even };
}
function drawFront(all) {
  const known = PAIR.length < 2 ? [] : all.filter((one) => PAIR.every((m) => value(one, m) !== null)), shown = known.filter((one, i) => i < MOST_POINTS || one.front).reverse();
  at("drawn").textContent = shown.length < known.length ? `the first ${MOST_POINTS} of the table and the whole front` : "";
  const legend = hue < 0 ? laws : keys[hue].words.map((own, i) => [`${keys[hue].name} ${own}`, tone(i, keys[hue].words.length)]);
  at("legend").replaceChildren(...legend.slice(0, 40).map(([name, own]) => made("span", {}, swatch(own), name)));
  if (!shown.length) return at("front").replaceChildren("No law has both figures.");
  const width = Math.max(at("front").clientWidth, 280), height = Math.round(Math.min(430, 0.8 * width)), [left, right, foot] = [58, width - 12, height - 44];
  const x = axisOf(shown.map((one) => value(one, CHATTERING)), left, right), y = axisOf(shown.map((one) => value(one, ERROR)), foot, 10);
  const lines = x.ticks.map((t) => `<line x1="${x.at(t)}" x2="${x.at(t)}" y1="10" y2="${foot}"/><text x="${x.at(t)}" y="${foot + 17}" text-anchor="middle">${digits(t)}</text>`);
  lines.push(...y.ticks.map((t) => `<line x1="${left}" x2="${right}" y1="${y.at(t)}" y2="${y.at(t)}"/><text x="${left - 6}" y="${+y.at(t) + 4}" text-anchor="end">${digits(t)}</text>`));
  lines.push(`<text x="${(left + right) / 2}" y="${height - 7}" text-anchor="middle">chattering [% of the torque limit]</text><text transform="translate(13 ${foot / 2}) rotate(-90)" text-anchor="middle">RMS error ${metrics[ERROR].title.replace(/^\S+ /, "")}</text>`);
  const live = (one) => !missing(one) && meets(one);
  for (const i of [...shown.keys()].sort((i, j) => live(shown[i]) - live(shown[j]))) {
    const one = shown[i], cx = x.at(value(one, CHATTERING)), cy = y.at(value(one, ERROR)), known = (m) => live(one) && shown.length <= MOST_ENDS && value(one, m, "low") !== null;
    if (known(CHATTERING)) lines.push(`<line class="end" x1="${x.at(value(one, CHATTERING, "low"))}" x2="${x.at(value(one, CHATTERING, "high"))}" y1="${cy}" y2="${cy}"/>`);
    if (known(ERROR)) lines.push(`<line class="end" x1="${cx}" x2="${cx}" y1="${y.at(value(one, ERROR, "low"))}" y2="${y.at(value(one, ERROR, "high"))}"/>`);
    lines.push(`<circle cx="${cx}" cy="${cy}" r="5.5" data-i="${i}" class="${live(one) ? "" : "off"}${one.row === chosen ? " chosen" : ""}" fill="${colour(one)}"/>`, one.front ? `<circle cx="${cx}" cy="${cy}" r="9" class="ring"/>` : "");
  }
  const svg = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img" aria-label="error against chattering">${lines.join("")}</svg>`;
  at("front").replaceChildren(new DOMParser().parseFromString(svg, "image/svg+xml").documentElement);
  for (const [name, heard] of [["pointerover", tell], ["click", choose]]) at("front").firstChild.addEventListener(name, ({ target }) => shown[target.dataset?.i] && heard(shown[target.dataset.i]));
}
const tell = (one) => { at("told").textContent = `${named(one)}: ${PAIR.map((m) => `${metrics[m].title} ${mean(one, m)}`).join(", ")}${one.failed ? `; ${one.failed} of ${one.runs} runs failed` : ""}`; };

// --- the table

function drawTable(all) {
  const kept = all.filter(meets), whole = kept.filter((one) => !missing(one)), least = metrics.map((_, m) => whole.reduce((a, one) => Math.min(a, bad(m, one.at[m])), Infinity));
  const head = ({ title }, m) => made("th", { class: "number", tabindex: 0, "aria-sort": m === by && (turned > 0 ? "ascending" : "descending"), click: () => sortBy(m), keydown: ({ key }) => key === "Enter" && sortBy(m) }, title), cell = (text, more = "") => made("td", { class: `number ${more}` }, text);
  at("best").tHead.replaceChildren(made("tr", {}, made("th", {}, laws.length > 1 ? "law" : ""), ...keys.map((key) => made("th", { title: key.key, class: "number" }, key.unit ? `${key.name} [${key.unit}]` : key.name)),
    ...metrics.map(head), made("th", { class: "number" }, "n"), made("th", { class: "number" }, "failed")));
  at("best").tBodies[0].replaceChildren(...kept.slice(0, most).map((one) => {
    const cells = metrics.map((_, m) => made("td", { class: `number${!missing(one) && bad(m, one.at[m]) === least[m] ? " best" : ""}` }, digits(value(one, m)), made("small", {}, mean(one, m).replace(/^\S+/, ""))));
    return made("tr", { tabindex: 0, "aria-selected": String(one.row === chosen), click: () => choose(one), pointerenter: () => tell(one), keydown: (event) => event.key === "Enter" && choose(one) },
      made("td", {}, swatch(hue < 0 ? laws[one.law][1] : colour(one)), laws.length > 1 ? laws[one.law][0] : ""), ...keys.map((_, k) => cell(word(k, one.row))), ...cells, cell(one.runs), cell(one.failed, one.failed && "failed"));
  }));
  at("shown").textContent = `${Math.min(most, kept.length).toLocaleString("en")} of ${all.length.toLocaleString("en")}${kept.length < all.length ? `, ${kept.length.toLocaleString("en")} meet what counts` : ""}`;
}
function sortBy(m) { turned = m === by ? -turned : 1; by = m; draw(); [...at("best").tHead.querySelectorAll("th[tabindex]")][m].focus(); }

// --- the commands of a case

// The values that a key keeps in a sweep of one choice alone: the chosen one, or all of which the worst counts.
const keptValues = ({ words, sets }, own) => own.map((i) => (words[i] === sets[i] || !Number.isNaN(Number(sets[i])) ? null : JSON.stringify(words[i]))).every((name) => name === null)
  ? `[${own.map((i) => sets[i]).join(", ")}]` : `{${own.map((i) => `${JSON.stringify(words[i])}: ${sets[i]}`).join(", ")}}`;
function choose(one) {
  const index = DATA.case[one.row] * DATA.runs[one.row] * laws.length + one.law, inside = at("best").contains(document.activeElement);
  at("which").textContent = `${named(one)}, draw 0${one.cases > 1 ? `: of ${one.cases} cases that in which ${metrics[by]?.title.replace(/ \[.*/, "")} is worst` : ""}`;
  at("rerun").textContent = `torquebench run --from-sweep ${quoted(folder)} --index ${index}${DATA.plugins} -o again`;
  const grid = keys.map((key, k) => places[k][one.row] >= 0 && `${JSON.stringify(key.key)}: ${keptValues(key, roles[k] === "worst" ? [...key.sets.keys()] : [places[k][one.row]])}`).filter(Boolean);
  at("narrow").textContent = `torquebench sweep ${quoted(`${folder}/sweep.yaml`)}${DATA.plugins}${DATA.settings}${grid.length ? ` --set ${quoted(`sweep.grid={${grid.join(", ")}}`)}` : ""} -o alone`;
  document.querySelectorAll("button.copy").forEach((button) => { button.textContent = "copy"; });
  [chosen] = [one.row, tell(one)];
  draw();
  if (inside) at("best").querySelector("[aria-selected=true]")?.focus({ preventScroll: true }); // the row was made anew
}

// --- what counts

function limitOf(m) {
  const [low, high] = ends(metrics[m].mean.filter((x) => x > 0).map((x) => Math.log(x * metrics[m].scale))), [title, unit] = metrics[m].title.split(" [");
  const set = (x) => { limits[m] = x > 0 ? x : Infinity; draw(); };
  const box = made("input", { type: "number", min: 0, step: "any", placeholder: "any", input: () => { slide.value = box.value > 0 ? Math.log(box.value) : high; set(Number(box.value)); } });
  const slide = made("input", { type: "range", min: low, max: high, step: (high - low) / 200 || 1, value: high, "aria-label": `${title} at most`,
    input: () => { box.value = Number(slide.value) >= high ? "" : Number(Math.exp(slide.value).toPrecision(3)); set(Number(box.value)); } });
  return made("label", {}, `${title} [${unit ?? "1]"} ≤`, box, slide);
}
const select = (title, options, now, set) => made("label", {}, title, made("select", { change: ({ target }) => { set(options[target.selectedIndex][1]); draw(); } }, ...options.map(([text, own]) => made("option", { selected: own === now }, text))));
function draw() { const all = choices(); drawTable(all); drawFront(all); return all; }

const varied = keys.map((key, k) => [key, k]).filter(([key]) => key.words.length > 1);
at("controls").replaceChildren(...(PAIR.length === 2 ? [CHATTERING, ERROR].map(limitOf) : []),
  ...varied.map(([key, k]) => select(key.name.replaceAll("_", "_\u200b"), [[`worst of ${key.words.length}`, "worst"], ["each by itself", "each"], ...key.words.map((own, i) => [own, i])], roles[k], (role) => { roles[k] = role; })),
  select("colour", [["law", -1], ...varied.map(([key, k]) => [key.name, k])], hue, (own) => { hue = own; }), select("rows", [20, 100, 1000, Infinity].map((own) => [own === Infinity ? "all" : String(own), own]), most, (own) => { most = own; }));
draw().slice(0, 1).forEach(choose);
new ResizeObserver(() => requestAnimationFrame(draw)).observe(at("front").parentNode);
for (const [where, name, paper] of [[dark, "change", false], [window, "beforeprint", true], [window, "afterprint", false]]) where.addEventListener(name, () => { onPaper = paper; draw(); });
