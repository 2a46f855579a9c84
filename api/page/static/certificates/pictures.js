// Ellipsoids of a proof on two axes of the state, and the tube around runs along one signal.
import { digitsOf, linear, ticks } from "../lib/axis.js";
import { h, s } from "../lib/dom.js";
import { number } from "../lib/format.js";
import { modeOf } from "./document.js";
import { colour } from "./graph.js";
import { apply, drawn, outline } from "./matrix.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [520, 320, 52, 12, 12, 40];
const STEPS = 40;
const NAMED_MAX = 10; // more ellipsoids than this are named where the pointer is

function frame(x, y, names, label, ...content) {
  // Axes with a sparse grid around content that was placed by `px` and `py`.
  const px = linear(x, [LEFT, WIDTH - RIGHT]);
  const py = linear(y, [HEIGHT - BOTTOM, TOP]);
  const across = ticks(...x, 5);
  const up = ticks(...y, 4);
  const grid = [
    ...across.map((value) => [s("line", { class: "grid", x1: px(value), x2: px(value), y1: TOP, y2: HEIGHT - BOTTOM }), s("text", { x: px(value), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, number(value, digitsOf(across)))]),
    ...up.map((value) => [s("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: py(value), y2: py(value) }), s("text", { x: LEFT - 6, y: py(value) + 4, "text-anchor": "end" }, number(value, digitsOf(up)))]),
  ];
  const titles = [s("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, names[0]), s("text", { x: 12, y: (TOP + HEIGHT - BOTTOM) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${(TOP + HEIGHT - BOTTOM) / 2})` }, names[1])];
  return s("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label }, grid, titles, content.flat().flatMap((draw) => draw(px, py)).filter(Boolean));
}

const path = (points, px, py, closed = false) => points.map(([x, y], k) => `${k ? "L" : "M"}${px(x).toFixed(2)} ${py(y).toFixed(2)}`).join("") + (closed ? "Z" : "");

function named(points, node, px, py) {
  // A node's number on its outline, each a little further along than the one before.
  const [x, y] = points[(node * 9 + 4) % points.length];
  return s("text", { class: "name", x: px(x), y: py(y) + 4 }, node);
}

export function ellipsoids(proof, i, j) {
  // One a node. For a reachable set they hold every error; otherwise they are level sets, and only their shape matters.
  const outlines = proof.shapes.map((shape) => outline(shape, i, j));
  const scale = proof.kind === "reach" ? 1 : 1 / (Math.max(...outlines.flat().map(([x, y]) => Math.hypot(x, y))) || 1);
  const scaled = outlines.map((points) => points.map(([x, y]) => [x * scale, y * scale]));
  const reach = [0, 1].map((axis) => 1.08 * Math.max(...scaled.flat().map((point) => Math.abs(point[axis]))) || 1);
  const unit = proof.kind === "reach" ? "e" : "x";
  const draw = scaled.map((points, node) => (px, py) => [s("path", { class: "ellipsoid", d: path(points, px, py, true) }, s("title", {}, `node ${node}`)), scaled.length <= NAMED_MAX && named(points, node, px, py)]);
  return frame([-reach[0], reach[0]], [-reach[1], reach[1]], [`${unit}${i + 1}`, `${unit}${j + 1}`], `Ellipsoids of ${scaled.length} nodes on components ${i + 1} and ${j + 1}`, draw);
}

export function signal(proof, seed) {
  // A path of the graph and its letters, with the node reached after each; drawn with a seed.
  const next = drawn(seed);
  const steps = [];
  let node = 0;
  for (let guard = 0; steps.length < STEPS && guard < 10 * STEPS; guard++) {
    const leaving = proof.edges.filter((edge) => edge.from === node);
    if (!leaving.length) break;
    const edge = leaving[Math.floor(((next() + 1) / 2) * leaving.length) % leaving.length];
    edge.labels.forEach((label, place) => steps.push({ label, node: place === edge.labels.length - 1 ? edge.to : null }));
    node = edge.to;
  }
  return steps;
}

export function runs(proof, steps, seed) {
  // Runs along a signal: from the border of the first ellipsoid, or from 0 under disturbances at their bound.
  const next = drawn(seed + 1);
  const disturbed = proof.kind === "reach";
  const first = proof.shapes[0];
  return Array.from({ length: 6 }, () => {
    let x = Array.from({ length: proof.size }, next);
    const lengthOf = (w) => Math.hypot(...w) || 1;
    if (disturbed) x = x.map(() => 0);
    else {
      const direction = x.map((value) => value / lengthOf(x)); // sqrt(shape) would do as well: x = S d / sqrt(d' S d) lies on the border
      const moved = apply(first, direction);
      const size = Math.sqrt(moved.reduce((total, value, k) => total + value * direction[k], 0));
      x = moved.map((value) => value / size);
    }
    const found = [x];
    for (const { label } of steps) {
      x = apply(proof.loop(label), x);
      if (disturbed) {
        const E = proof.drive(label);
        const w = Array.from({ length: E[0].length }, next);
        const push = apply(E, w.map((value) => (value / lengthOf(w)) * proof.peak));
        x = x.map((value, k) => value + push[k]);
      }
      found.push(x);
    }
    return found;
  });
}

export function tube(proof, i, steps, seed) {
  // What the proof allows component i to be along a signal, and runs inside it.
  const bound = [{ k: 0, most: Math.sqrt(proof.shapes[0][i][i]) }];
  steps.forEach(({ node }, place) => node !== null && bound.push({ k: place + 1, most: proof.decay ** (place + 1) * Math.sqrt(proof.shapes[node][i][i]) }));
  const inside = runs(proof, steps, seed).map((run) => run.map((x, k) => [k, x[i]]));
  const scale = proof.kind === "reach" ? 1 : 1 / (bound[0].most || 1);
  const most = 1.08 * Math.max(...bound.map((item) => item.most)) * scale || 1;
  const edge = (sign) => bound.map(({ k, most: value }) => [k, sign * value * scale]);
  const strip = steps.map(({ label }, k) => (px) => s("rect", { class: `strip ${colour(modeOf(label))}`, x: px(k), y: HEIGHT - BOTTOM - 6, width: px(k + 1) - px(k), height: 6 }, s("title", {}, `mode ${modeOf(label)} at sample ${k}`)));
  const name = `${proof.kind === "reach" ? "e" : "x"}${i + 1}`;
  return frame([0, steps.length], [-most, most], ["sample", name], `Tube of component ${i + 1} along a signal of ${steps.length} samples, with six runs inside`,
    (px, py) => s("path", { class: "tube", d: path([...edge(1), ...edge(-1).reverse()], px, py, true) }),
    inside.map((points) => (px, py) => s("path", { class: "inside", d: path(points.map(([k, value]) => [k, value * scale]), px, py) })), strip);
}

export function modesLegend(proof) {
  return h("p", { class: "legend" }, proof.modes.map((_, k) => h("span", {}, h("span", { class: `swatch ${colour(k + 1)}` }), ` mode ${k + 1}`)));
}
