// The schedule: who waits, who is served and which valves are open, every controller on one time axis.
import { clockTicks, linear } from "../lib/axis.js";
import { h, s, set, table } from "../lib/dom.js";
import { clock, number, words } from "../lib/format.js";
import { touched } from "../lib/touch.js";
import { series } from "./marks.js";
import { sized } from "./scale.js";
import { VALVES } from "./schedule.js";

const LABEL = 100;
const RIGHT = 14;
const TOP = 26;
const HEAD = 26;
const ROW = 15;
const THICK = 10;
const FINE = 2; // narrowest gap that is drawn [px]
const BIN = 5; // [px]
const SHADES = [0.375, 0.625, 0.9]; // a valve that is open every other second lies within one
const LEAST = 20; // narrowest window [s]
const ROWS = ["waiting", "dispenser", ...VALVES];

export function gantt(found, scenario) {
  const end = Math.max(...found.map((each) => each.end));
  const shown = { from: 0, to: end };
  const height = TOP + found.length * (HEAD + ROWS.length * ROW) + 6;
  const chart = h("div", { class: "chart", tabindex: "0", role: "group", "aria-describedby": "gantt-keys",
    "aria-label": `Schedule of ${scenario}: arrow keys move, plus and minus zoom, 0 shows the whole run` });
  const extent = h("output", { class: "extent", role: "status" });
  let at = linear([0, end], [LABEL, LABEL + 1]);
  const redraw = sized(chart, (width) => {
    at = linear([shown.from, shown.to], [LABEL, width - RIGHT]);
    set(extent, `${clock(shown.from)} to ${clock(shown.to)}`);
    return drawing(found, shown, at, width, height);
  });
  let asked = 0;
  const look = (from, to) => {
    const wide = Math.min(Math.max(to - from, LEAST), end);
    shown.from = Math.min(Math.max(0, (from + to - wide) / 2), end - wide);
    shown.to = shown.from + wide;
    cancelAnimationFrame(asked);
    asked = requestAnimationFrame(redraw);
  };
  const move = (share) => look(shown.from + share * (shown.to - shown.from), shown.to + share * (shown.to - shown.from));
  const zoom = (factor, about = (shown.from + shown.to) / 2) => look(about - (about - shown.from) * factor, about + (shown.to - about) * factor);
  const whole = () => look(0, end);
  const doings = { ArrowLeft: () => move(-0.2), ArrowRight: () => move(0.2), "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), 0: whole,
    Home: () => look(0, shown.to - shown.from), End: () => look(end - (shown.to - shown.from), end) };
  chart.addEventListener("keydown", (event) => {
    if (!(event.key in doings) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    doings[event.key]();
  });
  pointed(chart, { zoom, look, shown, at: () => at });
  const button = (label, text, doing) => h("button", { type: "button", "aria-label": label, title: label, onclick: doing }, text);
  return h("div", { class: "gantt" },
    h("div", { class: "actions" },
      button("Earlier", "◀", () => move(-0.5)), button("Later", "▶", () => move(0.5)),
      button("Zoom in", "+", () => zoom(0.5)), button("Zoom out", "−", () => zoom(2)),
      h("button", { type: "button", onclick: whole }, "Whole run"), extent),
    h("p", { class: "hint", id: "gantt-keys" }, "Drag to move, Ctrl and wheel, double click or two fingers to zoom; in the chart the keys ← → + − 0 do the same. A triangle is an arrival, the band behind it the wait, a number the vehicle at the dispenser. Where a bar is pale, the valve switches faster than can be drawn here: zoom in."),
    chart,
    h("details", {}, h("summary", {}, "The same as a table"), summary(found, scenario)));
}

function pointed(chart, { zoom, look, shown, at }) {
  let held = null;
  const place = (event) => event.clientX - chart.getBoundingClientRect().left;
  chart.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.002), at().back(place(event)));
  }, { passive: false });
  chart.addEventListener("dblclick", (event) => zoom(event.shiftKey ? 2 : 0.5, at().back(place(event))));
  chart.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || event.pointerType === "touch") return;
    held = { x: place(event), from: shown.from, to: shown.to, second: at().back(1) - at().back(0) };
    chart.setPointerCapture(event.pointerId);
  });
  chart.addEventListener("pointermove", (event) => {
    if (held) {
      const shift = (held.x - place(event)) * held.second;
      look(held.from + shift, held.to + shift);
    } else cursor(chart, place(event), at());
  });
  for (const name of ["pointerup", "pointercancel"]) chart.addEventListener(name, () => (held = null));
  touched(chart, { shown: () => [shown.from, shown.to], edges: () => [at()(shown.from), at()(shown.to)], look });
  chart.addEventListener("pointerleave", () => cursor(chart, -1, at()));
}

function cursor(chart, x, at) {
  // The time under the pointer.
  const line = chart.querySelector(".cursor");
  const width = chart.querySelector("svg").width.baseVal.value;
  line.toggleAttribute("hidden", x < LABEL || x > width - RIGHT);
  line.setAttribute("transform", `translate(${x} 0)`);
  line.lastChild.textContent = clock(at.back(x));
  line.lastChild.setAttribute("text-anchor", x > width - 70 ? "end" : "start");
  line.lastChild.setAttribute("x", x > width - 70 ? -5 : 5);
}

function drawing(found, shown, at, width, height) {
  const times = clockTicks(shown.from, shown.to, Math.max(2, Math.floor((width - LABEL) / 110)));
  return s("svg", { width, height, role: "img", "data-from": shown.from, "data-to": shown.to, "aria-label": `Schedule from ${clock(shown.from)} to ${clock(shown.to)}; the table below says the same` },
    s("g", { class: "grid" }, times.map(([time, text]) => [
      s("path", { d: `M${Math.round(at(time)) + 0.5} ${TOP - 6}V${height}` }),
      s("text", { x: at(time), y: 14, "text-anchor": at(time) > width - 40 ? "end" : at(time) < LABEL + 20 ? "start" : "middle" }, text)])),
    found.map((each, place) => group(each, place, shown, at, TOP + place * (HEAD + ROWS.length * ROW), width)),
    s("g", { class: "cursor", hidden: true }, s("path", { d: `M0.5 ${TOP - 6}V${height}` }), s("text", { y: TOP + 1 }, "")));
}

function group(each, place, shown, at, top, width) {
  const middle = (row) => top + HEAD + row * ROW + ROW / 2;
  return s("g", { "data-controller": each.controller, "data-run": each.run },
    s("path", { class: "rule", d: `M0 ${top + 0.5}H${width}` }),
    s("path", { class: `swatch ${series(place)}`, d: `M1 ${top + 7}v14` }),
    s("text", { class: "name", x: 8, y: top + 18 }, each.controller),
    ROWS.map((name, row) => s("text", { x: LABEL - 8, y: middle(row) + 4, "text-anchor": "end" }, words(name))),
    s("path", { class: "rows", d: ROWS.map((_, row) => `M${LABEL} ${Math.round(middle(row) + ROW / 2) - 0.5}H${width - RIGHT}`).join("") }),
    waits(each, shown, at, middle(0)),
    services(each, shown, at, middle(1)),
    VALVES.map((valve, row) => s("g", { class: `open ${valve.split("_")[1]}`, "data-valve": valve, "data-spans": each.valves[valve].length },
      drawn(pieces(each.valves[valve], shown, at), middle(row + 2)))));
}

const inside = (from, to, shown) => to >= shown.from && from <= shown.to;

function waits({ vehicles, end }, shown, at, y) {
  return s("g", { class: "waits" }, vehicles.map(({ arrival, connected }) => {
    const until = connected ?? end;
    if (!inside(arrival, until, shown)) return null;
    const [left, right] = [at(Math.max(arrival, shown.from)), at(Math.min(until, shown.to))];
    return [s("rect", { x: left, y: y - 3, width: Math.max(right - left, 0), height: 7 }),
      arrival >= shown.from && s("path", { class: "arrival", "data-arrival": arrival, d: `M${at(arrival)} ${y + 5}l-3.5 -9h7Z` })];
  }));
}

function services({ vehicles, end }, shown, at, y) {
  return s("g", { class: "services" }, vehicles.map(({ connected, finished }, number_) => {
    const until = finished ?? end;
    if (connected === null || !inside(connected, until, shown)) return null;
    const [left, right] = [at(Math.max(connected, shown.from)), at(Math.min(until, shown.to))];
    const wide = Math.max(right - left - 1, 0.6);
    return s("g", { "data-vehicle": number_, "data-connected": connected, "data-finished": finished },
      s("title", {}, `vehicle ${number_}: ${clock(connected)} to ${finished === null ? "the end, not finished" : clock(finished)}`),
      s("rect", { class: finished === null ? "unfinished" : null, x: left, y: y - 6, width: wide, height: 12 }),
      wide > 18 && s("text", { x: (left + right) / 2, y: y + 4, "text-anchor": "middle" }, number_));
  }));
}

function drawn(found, y) {
  // One path for each shade.
  return [1, 2, 3, 4].map((level) => {
    const d = found.filter((piece) => piece.level === level).map(({ left, right }) => `M${left.toFixed(2)} ${y - THICK / 2}H${Math.max(right, left + 0.6).toFixed(2)}v${THICK}H${left.toFixed(2)}Z`).join("");
    return d && s("path", { class: `level-${level}`, d });
  });
}

export function pieces(spans, shown, at) {
  // What to draw of a row: spans as they are; where they come faster than can be drawn, the share of time they take.
  const seen = spans.filter(([from, to]) => inside(from, to, shown)).map(([from, to]) => [at(Math.max(from, shown.from)), at(Math.min(to, shown.to))]);
  const clusters = [];
  for (const span of seen) {
    if (clusters.length && span[0] - clusters.at(-1).at(-1)[1] < FINE) clusters.at(-1).push(span);
    else clusters.push([span]);
  }
  return clusters.flatMap((cluster) => (cluster.length === 1 ? [{ left: cluster[0][0], right: cluster[0][1], level: 4 }] : shaded(cluster)));
}

function shaded(cluster) {
  const [start, stop] = [cluster[0][0], cluster.at(-1)[1]];
  const count = Math.max(1, Math.round((stop - start) / BIN));
  const wide = (stop - start) / count;
  const open = new Float64Array(count);
  for (const [left, right] of cluster) {
    for (let bin = Math.floor((left - start) / wide); bin < count && start + bin * wide < right; bin += 1) {
      open[bin] += Math.max(0, Math.min(right, start + (bin + 1) * wide) - Math.max(left, start + bin * wide));
    }
  }
  const found = [];
  open.forEach((sum, bin) => {
    if (sum < 0.02 * wide) return;
    const level = 1 + SHADES.filter((share) => sum >= share * wide).length;
    const [left, right] = [start + bin * wide, start + (bin + 1) * wide];
    const last = found.at(-1);
    if (last?.level === level && left - last.right < 0.01) last.right = right;
    else found.push({ left, right, level });
  });
  return found;
}

function summary(found, scenario) {
  const open = (spans) => `${number(spans.reduce((sum, [from, to]) => sum + to - from, 0))}\u202fs in ${number(spans.length)}`;
  return table(`Schedule of ${scenario}: time open, and how often opened`,
    ["controller", "vehicles finished", "end [h:min:s]", ...VALVES.map(words)],
    found.map((each) => [each.controller, `${each.vehicles.filter(({ finished }) => finished !== null).length} of ${each.vehicles.length}`, clock(each.end),
      ...VALVES.map((valve) => open(each.valves[valve]))]));
}
