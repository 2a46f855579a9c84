// The language as a graph: its nodes on a circle, an arrow for each word of modes.
import { h, s } from "../lib/dom.js";
import { modeOf } from "./document.js";

const NODES_MAX = 40;
const [MIDDLE, RADIUS] = [260, 195];
const NODE = 15;
const AROUND = 66; // of the outermost nodes: room for loops and their words

export const colour = (mode) => `mode-${((mode - 1) % 8) + 1}`;

function places(count) {
  if (count === 1) return [[MIDDLE, MIDDLE]];
  return Array.from({ length: count }, (_, k) => {
    const angle = (2 * Math.PI * k) / count - (count === 2 ? Math.PI : Math.PI / 2);
    const radius = count === 2 ? RADIUS * 0.6 : RADIUS;
    return [MIDDLE + radius * Math.cos(angle), MIDDLE + radius * Math.sin(angle)];
  });
}

function bundles(edges) {
  // Edges with the same ends become one arrow with all their words.
  const found = new Map();
  for (const edge of edges) {
    const key = `${edge.from},${edge.to}`;
    if (!found.has(key)) found.set(key, { ...edge, words: [] });
    const word = edge.labels.map(modeOf).join(" ") || "ε";
    const { words } = found.get(key);
    if (!words.includes(word)) words.push(word);
  }
  return [...found.values()];
}

function arrow({ from, to, labels, words }, at) {
  const [x, y] = at[from];
  const mode = labels.length ? modeOf(labels[0]) : 0;
  const look = { class: `edge ${mode ? colour(mode) : ""}`, "marker-end": "url(#arrow)" };
  if (from === to) {
    const [dx, dy] = [x - MIDDLE || 0, y - MIDDLE || (x === MIDDLE ? -1 : 0)];
    const length = Math.hypot(dx, dy);
    const [ux, uy] = [dx / length, dy / length];
    const [px, py] = [-uy, ux];
    const out = NODE + 34;
    const [ax, ay, bx, by] = [x + ux * NODE * 0.8 + px * NODE * 0.6, y + uy * NODE * 0.8 + py * NODE * 0.6, x + ux * (NODE + 4) - px * NODE * 0.7, y + uy * (NODE + 4) - py * NODE * 0.7];
    const path = `M${ax} ${ay} C${x + ux * out + px * 26} ${y + uy * out + py * 26} ${x + ux * out - px * 26} ${y + uy * out - py * 26} ${bx} ${by}`;
    return [s("path", { ...look, d: path }), s("text", { x: x + ux * (out + 6), y: y + uy * (out + 6) + 4, class: "word" }, words.join(", "))];
  }
  const [u, v] = at[to];
  const length = Math.hypot(u - x, v - y);
  const [ux, uy] = [(u - x) / length, (v - y) / length];
  const bend = Math.min(38, length * 0.16);
  const [mx, my] = [(x + u) / 2 - uy * bend, (y + v) / 2 + ux * bend];
  const [sx, sy] = [x + ux * NODE, y + uy * NODE];
  const back = Math.hypot(u - mx, v - my);
  const [ex, ey] = [u - ((u - mx) / back) * (NODE + 5), v - ((v - my) / back) * (NODE + 5)];
  const [tx, ty] = [(x + 2 * mx + u) / 4 - uy * 9, (y + 2 * my + v) / 4 + ux * 9];
  return [s("path", { ...look, d: `M${sx} ${sy} Q${mx} ${my} ${ex} ${ey}` }), s("text", { x: tx, y: ty + 4, class: "word" }, words.join(", "))];
}

export function languageGraph(proof) {
  // A picture, or the reason why there is none.
  if (proof.nodes > NODES_MAX) return h("p", { class: "lead" }, `${proof.nodes} nodes and ${proof.edges.length} edges: too many to draw; the document lists them.`);
  const at = places(proof.nodes);
  const marker = s("marker", { id: "arrow", viewBox: "0 0 10 10", refX: 8, refY: 5, markerWidth: 7, markerHeight: 7, orient: "auto-start-reverse" }, s("path", { d: "M0 0 10 5 0 10z" }));
  const nodes = at.map(([x, y], node) => s("g", { class: "node" }, s("circle", { cx: x, cy: y, r: NODE }), s("text", { x, y: y + 4 }, node)));
  const label = `Graph of the switching language: ${proof.nodes} nodes, ${proof.edges.length} edges, an edge a mode`;
  const [left, top] = [0, 1].map((axis) => Math.min(...at.map((place) => place[axis])) - AROUND);
  const [right, bottom] = [0, 1].map((axis) => Math.max(...at.map((place) => place[axis])) + AROUND);
  return s("svg", { viewBox: `${left} ${top} ${right - left} ${bottom - top}`, role: "img", "aria-label": label, class: "graph" },
    s("defs", {}, marker), bundles(proof.edges).map((edge) => arrow(edge, at)), nodes);
}
