// The trade-off: mean wait against compressor time, a panel a scenario, with its Pareto front.
import { digitsOf, extent, linear, padded, ticks } from "../lib/axis.js";
import { h, s } from "../lib/dom.js";
import { number } from "../lib/format.js";
import { key, lineSample, mark, series, thesisSample } from "./marks.js";
import { meaning } from "./metrics.js";
import { sized, textWidth } from "./scale.js";

const HEIGHT = 300;
const EDGE = { left: 58, right: 14, top: 10, bottom: 40 };
const AXES = { t_comp_restored: "buffers restored", t_comp: "as counted" };

export function front(points) {
  // Those no other undercuts, from left to right: none is as low in both and lower in one.
  const kept = [];
  for (const point of points.filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y)).sort(([a, b], [c, d]) => a - c || b - d)) {
    const last = kept.at(-1);
    if (!last || point[1] < last[1] || (point[0] === last[0] && point[1] === last[1])) kept.push(point);
  }
  return kept;
}

export function tradeoff(controllers) {
  // Its section, and `renew` that shows what has come since.
  let [items, scenarios, rows] = [[], [], null];
  let axis = "t_comp_restored";
  const panels = h("div", { class: "panels" });
  const legend = h("div");
  const note = h("p", { class: "hint" });
  const draw = () => {
    const printed = items.some((item) => item.thesis.t_comp !== undefined);
    panels.replaceChildren(...scenarios.map((scenario) => panel(axis, scenario, items.filter((item) => item.scenario === scenario), controllers, rows)));
    legend.replaceChildren(key(controllers, [
      [lineSample("front"), "Pareto front"],
      printed && axis === "t_comp" && [thesisSample(), "hollow: printed in the thesis"],
      items.some((item) => item.deviation) && [lineSample("whisker"), "standard deviation over replications"],
    ].filter(Boolean)));
    note.textContent = printed && axis !== "t_comp" ? "The thesis prints compressor time as counted, not restored: choose that to see its figures beside ours." : "";
  };
  const choice = Object.entries(AXES).map(([name, text]) => h("label", {}, h("input", {
    type: "radio", name: "axis", value: name, checked: name === axis, onchange: () => { axis = name; draw(); },
  }), text));
  const element = h("section", { class: "card tradeoff", "aria-labelledby": "tradeoff-title" },
    h("h2", { id: "tradeoff-title" }, "What waiting costs"),
    h("p", { class: "lead" }, "Mean wait against compressor time: left and down is better. No controller here both waits less and compresses less than one on the Pareto front."),
    h("fieldset", { class: "choices axis-choice" }, h("legend", {}, "Compressor time"), choice),
    legend, panels, note);
  const renew = (figures, done, runs) => {
    [items, scenarios, rows] = [figures.items, done, runs];
    draw();
  };
  return { element, renew };
}

function panel(axis, scenario, items, controllers, rows) {
  const points = items.map((item) => ({
    item, place: controllers.indexOf(item.controller), x: item.mean[axis], y: item.mean.t_avg,
    dx: item.deviation?.[axis] ?? 0, dy: item.deviation?.t_avg ?? 0,
    thesis: axis === "t_comp" && item.thesis.t_comp !== undefined ? [item.thesis.t_comp, item.thesis.t_avg] : null,
    runs: item.deviation && rows ? rows.filter((row) => row.scenario === scenario && row.controller === item.controller && row[axis] !== null) : [],
  })).filter(({ x, y }) => x !== null && y !== null);
  const best = front(points.map(({ x, y }) => [x, y]));
  const named = points.filter(({ x, y }) => best.some(([a, b]) => a === x && b === y)).map(({ item }) => item.controller);
  const spoken = `${scenario}: ${points.map(({ item, x, y }) => `${item.controller} waits ${number(y)} s for ${number(x)} s of compressor`).join("; ")}. On the Pareto front: ${named.join(", ") || "nobody"}.`;
  const box = h("div", { class: "panel" });
  sized(box, (width) => plot({ axis, scenario, points, best, named, width, spoken }));
  const missing = items.length - points.length;
  return h("figure", {}, h("figcaption", {}, h("b", {}, scenario)), box,
    missing > 0 && h("p", { class: "hint" }, `${missing} not drawn: the figure is not finite.`));
}

function plot({ axis, scenario, points, best, named, width, spoken }) {
  const xs = points.flatMap(({ x, dx, thesis, runs }) => [x - dx, x + dx, ...(thesis ? [thesis[0]] : []), ...runs.map((run) => run[axis])]);
  const ys = points.flatMap(({ y, dy, thesis, runs }) => [Math.max(0, y - dy), y + dy, ...(thesis ? [thesis[1]] : []), ...runs.map((run) => run.t_avg)]);
  const [low, high] = padded(ys, 0.12);
  const floor = Math.min(0, extent(ys)?.[0] ?? 0);
  const x = linear(padded(xs, 0.12), [EDGE.left, width - EDGE.right]);
  const y = linear([Math.max(low, floor), high], [HEIGHT - EDGE.bottom, EDGE.top]);
  return s("svg", { width, height: HEIGHT, role: "img", "aria-label": spoken },
    grid(x, y, width, axis),
    points.filter(({ runs }) => runs.length).map(({ place, item, runs }) => s("path", {
      class: `cloud ${series(place)}`, "data-controller": item.controller, "data-runs": runs.length,
      d: runs.map((run) => `M${x(run[axis]).toFixed(1)} ${y(run.t_avg).toFixed(1)}h0`).join(""),
    })),
    best.length > 0 && s("path", { class: "front", d: staircase(best, x, y, width), "data-front": named.join(" ") }),
    points.map((point) => whiskers(point, x, y)),
    points.map(({ place, item, thesis }) => thesis && mark(place, x(thesis[0]), y(thesis[1]), {
      hollow: true, "data-thesis": item.controller, "data-x": thesis[0], "data-y": thesis[1],
    }, s("title", {}, `${item.controller}, thesis: waits ${number(thesis[1])} s, compressor ${number(thesis[0])} s`))),
    points.map((point) => mark(point.place, x(point.x), y(point.y), {
      "data-scenario": scenario, "data-controller": point.item.controller, "data-x": point.x, "data-y": point.y,
      "data-front": String(named.includes(point.item.controller)),
    }, s("title", {}, `${point.item.controller}: waits ${number(point.y, 1)} s, compressor ${number(point.x, 1)} s`))),
    labels(points, edges(best, x, y, width), x, y, width));
}

function grid(x, y, width, axis) {
  const [left, right] = [x.back(EDGE.left), x.back(width - EDGE.right)];
  const [low, high] = [y.back(HEIGHT - EDGE.bottom), y.back(EDGE.top)];
  const across = ticks(left, right, width < 380 ? 4 : 5);
  const up = ticks(low, high, 4);
  return s("g", { class: "grid" },
    up.map((value) => [s("path", { d: `M${EDGE.left} ${Math.round(y(value)) + 0.5}H${width - EDGE.right}` }),
      s("text", { x: EDGE.left - 8, y: y(value) + 4, "text-anchor": "end" }, number(value, digitsOf(up)))]),
    across.map((value) => [s("path", { d: `M${Math.round(x(value)) + 0.5} ${EDGE.top}V${HEIGHT - EDGE.bottom}` }),
      s("text", { x: x(value), y: HEIGHT - EDGE.bottom + 16, "text-anchor": "middle" }, number(value, digitsOf(across)))]),
    s("text", { class: "title", x: (EDGE.left + width - EDGE.right) / 2, y: HEIGHT - 5, "text-anchor": "middle" }, `${meaning(axis)} [s]`),
    s("text", { class: "title", transform: `translate(12 ${(HEIGHT - EDGE.bottom + EDGE.top) / 2}) rotate(-90)`, "text-anchor": "middle" }, "mean wait [s]"));
}

function staircase(best, x, y, width) {
  // The edge of what the front leaves open: right of a point one waits no less, until the next compresses more.
  const [first, ...rest] = best;
  const steps = rest.map(([px, py]) => `H${x(px).toFixed(1)}V${y(py).toFixed(1)}`).join("");
  return `M${x(first[0]).toFixed(1)} ${EDGE.top}V${y(first[1]).toFixed(1)}${steps}H${width - EDGE.right}`;
}

function whiskers({ x: mx, y: my, dx, dy, item, place }, x, y) {
  if (!dx && !dy) return null;
  const [left, right, bottom, top] = [x(mx - dx), x(mx + dx), y(Math.max(0, my - dy)), y(my + dy)].map((place) => place.toFixed(1));
  return s("path", { class: `whisker ${series(place)}`, "data-controller": item.controller, "data-dx": dx, "data-dy": dy,
    d: `M${left} ${y(my)}H${right}M${x(mx)} ${bottom}V${top}` });
}

function edges(best, x, y, width) {
  // The boxes of the staircase's pieces.
  return best.flatMap(([px, py], place) => {
    const [left, level] = [x(px), y(py)];
    const [right, above] = [place + 1 < best.length ? x(best[place + 1][0]) : width, place ? y(best[place - 1][1]) : EDGE.top];
    return [[left, level - 1, right, level + 1], [left - 1, above, left + 1, level]];
  });
}

function labels(points, lines, x, y, width) {
  // Each name beside its mark: the first of eight places where it covers no mark, no other name and, if that can be, no line.
  const taken = points.flatMap((point) => [[point.x, point.y], point.thesis].filter(Boolean)).map(([px, py]) => [x(px) - 7, y(py) - 7, x(px) + 7, y(py) + 7]);
  return points.map(({ item, x: px, y: py, dx, dy }) => {
    const [cx, cy, wide] = [x(px), y(py), textWidth(item.controller, 600)];
    const beside = [[10, 4], [-wide - 10, 4], [-wide / 2, -12], [-wide / 2, 21]];
    const askew = [[9, -9], [9, 18], [-wide - 9, -9], [-wide - 9, 18]];
    const places = dx || dy ? [...askew, ...beside] : [...beside, ...askew]; // not on the whiskers
    const boxes = places.map(([ox, oy]) => [cx + ox - 2, cy + oy - 11, cx + ox + wide + 2, cy + oy + 3]);
    const free = boxes.map((box) => box[0] >= EDGE.left && box[2] <= width && box[1] >= 0 && box[3] <= HEIGHT - EDGE.bottom && !taken.some((other) => overlap(box, other)));
    const clear = free.findIndex((fits, place) => fits && !lines.some((line) => overlap(boxes[place], line)));
    const chosen = clear >= 0 ? clear : free.indexOf(true);
    if (chosen < 0) return null; // no room: its mark stands in the legend
    taken.push(boxes[chosen]);
    return s("text", { class: "label", x: cx + places[chosen][0], y: cy + places[chosen][1] }, item.controller);
  });
}

const overlap = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
