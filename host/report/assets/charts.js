"use strict";
const run = JSON.parse(document.getElementById("run").textContent);
const table = run.table, summary = run.summary || {};
const one = id => document.getElementById(id);

function element(name, attributes, ...children) {
  const svg = ["svg", "path", "line", "text", "circle", "g", "title", "rect"].includes(name);
  const e = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const key in attributes) e.setAttribute(key, attributes[key]);
  e.append(...children);
  return e;
}

function short(x, digits = 4) {
  if (x === null || x === undefined) return "–";
  if (typeof x !== "number") return String(x);
  if (Number.isInteger(x) && Math.abs(x) < 1e6) return String(x);
  return Math.abs(x) >= 1e5 || (x !== 0 && Math.abs(x) < 1e-3) ? x.toExponential(digits - 2) : String(+x.toPrecision(digits));
}

// Okabe & Ito's colours, which people who see few of them tell apart.
const colors = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#5a5a5a"];

function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= raw * 0.999) || 10 * power;
  const list = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) list.push(+(k * step).toPrecision(12));
  return list;
}

// series: [{ name, values, color, dots }], null where there is no value.
function chart(title, unit, series, options = {}) {
  const times = table.time;
  series = series.filter(s => s.values && s.values.some(v => typeof v === "number"));
  if (!series.length || !times.length) return;
  const log = options.log && series.every(s => s.values.every(v => v === null || v > 0));
  const place = v => log ? Math.log10(v) : v;
  const all = series.flatMap(s => s.values.filter(v => typeof v === "number").map(place));
  let low = Math.min(...all), high = Math.max(...all);
  if (options.zero && !log) low = Math.min(low, 0), high = Math.max(high, 0);
  if (!(high > low)) { const room = Math.abs(high) * 0.1 || 1; low -= options.zero && low === 0 ? 0 : room; high += room; }
  const width = 520, height = 230, left = 62, right = 10, top = 8, bottom = 30;
  const first = times[0], last = Math.max(times[times.length - 1], first + 1e-12);
  const X = t => left + (width - left - right) * (t - first) / (last - first);
  const Y = v => height - bottom - (height - top - bottom) * (place(v) - low) / (high - low);
  const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
  const marks = log ? ticks(Math.floor(low), Math.ceil(high), 6).filter(k => Number.isInteger(k) && k >= low - 1e-9 && k <= high + 1e-9).map(k => 10 ** k)
                    : ticks(low, high, 5);
  for (const v of log && marks.length < 2 ? [10 ** low, 10 ** high] : marks) {
    svg.append(element("line", { x1: left, x2: width - right, y1: Y(v), y2: Y(v), stroke: "#e3e3e3" }),
               element("text", { x: left - 6, y: Y(v) + 4, "text-anchor": "end", fill: "#444" }, short(v, 3)));
  }
  for (const t of ticks(first, last, 6))
    svg.append(element("text", { x: X(t), y: height - bottom + 15, "text-anchor": "middle", fill: "#444" }, short(t, 3)));
  svg.append(element("line", { x1: left, x2: width - right, y1: height - bottom, y2: height - bottom, stroke: "#888" }),
             element("text", { x: width - right, y: height - 3, "text-anchor": "end", fill: "#666" }, "time (s)"));
  const keys = element("div", { class: "keys" });
  series.forEach((s, n) => {
    const color = s.color || colors[n % colors.length];
    let d = "", pen = false;
    s.values.forEach((v, i) => {
      if (typeof v !== "number") { pen = false; return; }
      if (s.dots) svg.append(element("circle", { cx: X(times[i]), cy: Y(v), r: 2.6, fill: color }));
      else d += `${pen ? "L" : "M"}${X(times[i]).toFixed(1)} ${Y(v).toFixed(1)}`;
      pen = true;
    });
    if (!s.dots) svg.append(element("path", { d: d + (times.length === 1 ? "h0" : ""), fill: "none", stroke: color, "stroke-width": 1.6, "stroke-linejoin": "round", "stroke-linecap": "round" }));
    const final = s.values.filter(v => typeof v === "number").pop();
    keys.append(element("span", {}, element("i", { style: `background:${color}` }), s.name + (s.dots ? "" : ` (${short(final)})`)));
  });
  one("charts").append(element("figure", {}, element("figcaption", {}, title + (unit ? ` (${unit})` : "")), svg, keys));
}

function bars(id, entries, unit) {
  entries = entries.filter(([, v]) => v > 0).sort((a, b) => b[1] - a[1]);
  if (!entries.length) return;
  one(id).hidden = false;
  const most = entries[0][1], sum = entries.reduce((s, [, v]) => s + v, 0);
  for (const [name, v] of entries)
    one(id).querySelector(".bars").append(element("div", {}, element("span", {}, name),
      element("em", {}, element("b", { style: `width:${(55 * v / most).toFixed(2)}%` }), `${short(v)}${unit} (${(100 * v / sum).toFixed(1)} %)`)));
}

(function head() {
  one("title").textContent = run.title;
  const words = { done: "done", failed: "failed", interrupted: "interrupted", running: "still going on, or killed" };
  one("state").append(element("span", { class: "badge " + run.state }, words[run.state] || run.state), " " + run.directory);
  if (run.failure) { one("failure").hidden = false; one("failure").querySelector("pre").textContent = run.failure; }
  const rows = table.time.length, last = name => rows && table[name] ? table[name][rows - 1] : null;
  const mb = summary.peak_memory_bytes ? short(summary.peak_memory_bytes / 1e6) + " MB" : null;
  const facts = [
    ["particles", summary.particles ?? (run.points && run.points.total)], ["frames", rows], ["steps", summary.steps ?? table.steps.reduce((a, b) => a + b, 0)],
    ["simulated time", short(summary.simulated_seconds ?? last("time")) + " s"], ["wall time", short(summary.wall_seconds ?? last("wall_seconds")) + " s"],
    ["particle-steps per second", summary.particle_steps_per_second], ["largest memory", mb],
    ["precision", summary.precision], ["threads", summary.threads], ["instruction set", summary.isa], ["Cleave", summary.version],
    ["mass", last("mass") === null ? null : short(last("mass")) + " kg"], ["largest damage", last("maximum_damage")],
    ["damaged part of the volume", last("damaged_fraction")], ["pieces", last("pieces")],
    ...Object.entries(summary.integrators || {}).map(([name, n]) => [name + " steps", n])];
  for (const [name, value] of facts)
    if (value !== null && value !== undefined && value !== "– s")
      one("key").querySelector("tbody").append(element("tr", {}, element("th", {}, name), element("td", {}, short(value))));
  for (const plugin of summary.plugins || []) {
    one("plugins").hidden = false;
    one("plugins").querySelector("tbody").append(element("tr", {}, element("td", {}, plugin.id), element("td", {}, plugin.version), element("td", {}, plugin.path)));
  }
  if (run.scene) { one("scene").hidden = false; one("scene").querySelector("pre").textContent = run.scene; }
  for (const picture of run.pictures) {
    one("pictures").hidden = false;
    one("pictures").querySelector("div").append(element("figure", {}, element("img", { src: "data:image/png;base64," + picture.data, alt: picture.name, loading: "lazy" }), element("figcaption", {}, picture.name)));
  }
})();

(function overTime() {
  const some = name => table[name] && table[name].some(v => v !== 0 && v !== null) ? table[name] : null;
  const total = table.time.map((_, i) => {
    const parts = ["kinetic_energy", "elastic_energy", "gravity_energy"].map(n => table[n][i]);
    return parts.includes(null) ? null : parts.reduce((a, b) => a + b, 0);
  });
  chart("Energy", "J", [{ name: "kinetic", values: table.kinetic_energy }, { name: "elastic", values: table.elastic_energy },
                        { name: "gravity", values: some("gravity_energy") }, { name: "sum", values: total, color: "#222" }], { zero: true });
  const vector = name => ["x", "y", "z"].map(a => ({ name: a, values: table[name + "_" + a] }));
  chart("Momentum", "kg m/s", vector("momentum"), { zero: true });
  chart("Angular momentum about the origin", "kg m²/s", vector("angular_momentum"), { zero: true });
  chart("Centre of mass", "m", vector("center_of_mass"));
  const bounds = [...new Set(table.limited_by)].filter(b => b);
  const step = table.time_step.map(v => v > 0 ? v : null);
  chart("Time step, by what bounded it", "s", bounds.map((bound, n) => ({ name: bound, dots: true, color: colors[n % colors.length],
    values: step.map((v, i) => table.limited_by[i] === bound ? v : null) })), { log: true });
  chart("Steps per frame", "", [{ name: "steps", values: table.steps }], { zero: true });
  chart("Damage", "", [{ name: "largest", values: some("maximum_damage") }, { name: "part of the volume with d > 1/2", values: some("damaged_fraction") },
                       { name: "active part", values: some("damage_active") }], { zero: true });
  chart("Pieces", "", [{ name: "pieces", values: table.pieces }], { zero: true });
  chart("Debris", "part of the rest volume", [{ name: "debris", values: some("debris") }], { zero: true });
  chart("Ratio of volume to that at rest", "", [{ name: "smallest", values: table.minimum_J }, { name: "largest", values: table.maximum_J }]);
  chart("Largest speed", "m/s", [{ name: "speed", values: table.maximum_speed }], { zero: true });
  chart("Iterations", "", [["damage_iterations", "damage"], ["newton_iterations", "Newton"], ["linear_iterations", "conjugate gradients"],
                           ["constraint_iterations", "constraints"]].map(([column, name]) => ({ name, values: some(column) })), { zero: true });
  chart("Wall time", "s", [{ name: "since the start", values: table.wall_seconds }], { zero: true });
  bars("stages", Object.entries(summary.stage_seconds || {}), " s");
  bars("limits", Object.entries(summary.limits || {}), "");
})();
