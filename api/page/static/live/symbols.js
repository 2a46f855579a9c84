// The symbols of the schematic: tanks, valves, machines; each is drawn once and then only told its figures.
import { s, set } from "../lib/dom.js";

const text = (x, y, content, properties = {}) => s("text", { x, y, ...properties }, content);

export function tankOf(name, { x, y, w, h }, id, marks) {
  // A tank whose level is its pressure's share of the highest there can be; `marks` are limits, as such shares.
  const level = s("rect", { class: "level", x, y: y + h, width: w, height: 0 });
  const clip = `clip-${id}`;
  const rows = h > 100 ? [24, 54, 82, 106] : [23, 53, 80, 80]; // a narrow tank has its figures one below the other
  const right = { class: "figure", x: x + w - 14, "text-anchor": "end" };
  const parts = {
    name: text(x + 14, y + rows[0], name, { class: "name" }),
    share: text(x + w - 14, y + (h > 100 ? rows[2] : rows[0]), "", right),
    pressure: text(x + 14, y + rows[1], "–", { class: "main" }),
    temperature: text(x + 14, y + rows[2], "–", { class: "figure" }),
    mass: h > 100 ? text(x + 14, y + rows[3], "–", { class: "figure" }) : text(0, y + rows[3], "–", right),
  };
  const element = s("g", { class: `tank ${id}` }, s("clipPath", { id: clip }, s("rect", { x, y, width: w, height: h, rx: 22 })),
    s("rect", { class: "shell", x, y, width: w, height: h, rx: 22 }), s("g", { "clip-path": `url(#${clip})` }, level, marks.map(({ share, name: said }) => s("path", { class: "mark", d: `M${x} ${y + h * (1 - share)} h12 m${w - 24} 0 h12` }, s("title", {}, said)))),
    s("rect", { class: "rim", x, y, width: w, height: h, rx: 22 }), Object.values(parts));
  const fill = (share) => {
    const height = Math.round(Math.min(Math.max(share, 0), 1) * h);
    level.setAttribute("y", y + h - height);
    level.setAttribute("height", height);
  };
  return { element, parts, fill };
}

export function valveOf(valve, { x, y, words }) {
  // Two triangles: filled while open; what is said of it stands beside.
  const said = text(words.x, words.y, "", { class: "valve-state", "text-anchor": words.anchor });
  const limit = text(words.x, words.y + 15, "", { class: "limit", "text-anchor": words.anchor });
  const name = `${valve.replace("_", " ")} valve`;
  const title = s("title", {}, name);
  const element = s("g", { class: `valve ${valve.split("_")[1]}`, "data-valve": valve, role: "img" }, title,
    s("rect", { class: "under", x: x - 15, y: y - 10, width: 30, height: 20 }),
    s("path", { class: "body", d: `M${x - 14} ${y - 9} L${x + 14} ${y + 9} V${y - 9} L${x - 14} ${y + 9} Z` }),
    s("path", { class: "stem", d: `M${x} ${y} V${y - 14} M${x - 6} ${y - 14} H${x + 6}` }),
    s("path", { class: "cross", d: `M${x - 7} ${y - 29} l14 10 m0 -10 l-14 10` }), said, limit);
  const show = (open, state, reason) => {
    element.classList.toggle("open", open);
    element.classList.toggle("refused", Boolean(reason));
    set(said, state);
    set(limit, reason);
    set(title, `${name}: ${[open ? "open" : reason ? "refused" : "closed", reason].filter(Boolean).join(", ")}`);
  };
  return { element, show };
}

export function cubeOf({ x, y, w, h }) {
  const corner = 12;
  return s("g", { class: "machine" },
    s("path", { class: "shell", d: `M${x} ${y + corner} h${w - corner} v${h - corner} h${-(w - corner)} Z M${x} ${y + corner} l${corner} ${-corner} h${w - corner} l${-corner} ${corner} M${x + w} ${y} v${h - corner} l${-corner} ${corner}` }),
    text(x + (w - corner) / 2, y + h / 2 + 4, "Power cube", { class: "name", "text-anchor": "middle" }),
    text(x + (w - corner) / 2, y + h / 2 + 21, "hydrogen", { "text-anchor": "middle" }));
}

export function compressorOf({ x, y, r, words }) {
  const turning = s("path", { class: "rotor", d: `M${x - r * 0.62} ${y - r * 0.72} L${x + r * 0.9} ${y - r * 0.3} M${x - r * 0.62} ${y + r * 0.72} L${x + r * 0.9} ${y + r * 0.3}` });
  const parts = {
    name: text(words.x, words.y, "Compressor", { class: "name", "text-anchor": words.anchor }),
    flow: text(words.x, words.y + 21, "–", { class: "flow", "text-anchor": words.anchor, "data-value": "flow_compressor" }),
    work: text(words.x, words.y + 39, "", { "text-anchor": words.anchor }),
  };
  return { element: s("g", { class: "machine compressor" }, s("circle", { class: "shell", cx: x, cy: y, r }), turning, Object.values(parts)), parts };
}

export function precoolerOf({ x, y, w, h }) {
  const [cx, cy] = [x + w / 2, y + h / 2];
  const arms = [0, 60, 120].map((turn) => {
    const [dx, dy] = [Math.cos((turn * Math.PI) / 180) * 17, Math.sin((turn * Math.PI) / 180) * 17];
    return `M${(cx - dx).toFixed(1)} ${(cy - dy).toFixed(1)} L${(cx + dx).toFixed(1)} ${(cy + dy).toFixed(1)}`;
  });
  const said = text(cx, y + h + 34, "", { "text-anchor": "middle" });
  return {
    element: s("g", { class: "machine precooler" }, s("rect", { class: "shell", x, y, width: w, height: h, rx: 12 }), s("path", { class: "snow", d: arms.join(" ") }),
      text(cx, y + h + 18, "Precooler", { class: "name", "text-anchor": "middle" }), said),
    said,
  };
}

export function dispenserOf({ x, y, w, h }) {
  const flow = text(x + w / 2, y + h - 24, "–", { class: "flow", "text-anchor": "middle", "data-value": "flow_dispenser" });
  return {
    element: s("g", { class: "machine dispenser" }, s("rect", { class: "shell", x, y, width: w, height: h, rx: 10 }),
      s("rect", { class: "display", x: x + 7, y: y + h - 46, width: w - 14, height: 34, rx: 5 }), flow,
      text(x + w / 2, y + 24, "Dispenser", { class: "name", "text-anchor": "middle" })),
    flow,
  };
}

const DASH = 20; // a dash and its gap, and how far the stream moves in one turn
const HALF = 3; // of a pipe's width

function pieces(d) {
  // The straight pieces [x, y, x', y'] of a path of M, H and V.
  const found = [];
  let [x, y] = [0, 0];
  for (const [, letter, first, second] of d.matchAll(/([MHV])([\d.]+)(?: ([\d.]+))?/g)) {
    const to = letter === "M" ? [Number(first), Number(second)] : letter === "H" ? [Number(first), y] : [x, Number(first)];
    if (letter !== "M") found.push([x, y, ...to]);
    [x, y] = to;
  }
  return found;
}

export function streamOf(d, kind) {
  // What runs in a pipe. Each straight piece is a window on dashes that are moved beneath it, in some steps a second:
  // the compositor does that without a new picture, and not sixty times.
  return s("g", { class: `stream ${kind}`, "aria-hidden": "true" }, pieces(d).map(([x, y, toX, toY]) => {
    const way = toX > x ? "right" : toX < x ? "left" : toY > y ? "down" : "up";
    const [w, h] = [Math.abs(toX - x) + 2 * HALF, Math.abs(toY - y) + 2 * HALF];
    const line = y === toY ? `M${-DASH} ${HALF} H${w + DASH}` : `M${HALF} ${-DASH} V${h + DASH}`;
    return s("svg", { x: Math.min(x, toX) - HALF, y: Math.min(y, toY) - HALF, width: w, height: h }, s("path", { class: `dash ${way}`, d: line }));
  }));
}

export function carAt(x, y) {
  return s("path", { class: "car", d: `M${x} ${y} v-8 l4 -1 l5 -8 h13 l7 8 l5 2 v7 h-4 a4 4 0 0 0 -8 0 h-10 a4 4 0 0 0 -8 0 Z` });
}
