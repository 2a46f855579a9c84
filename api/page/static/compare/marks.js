// Each controller's colour and shape, the same in every chart.
import { h, s } from "../lib/dom.js";

const SHAPES = [
  (r) => `M${-r} 0A${r} ${r} 0 1 1 ${r} 0A${r} ${r} 0 1 1 ${-r} 0Z`,
  (r) => `M${-0.9 * r} ${-0.9 * r}H${0.9 * r}V${0.9 * r}H${-0.9 * r}Z`,
  (r) => `M0 ${-1.2 * r}L${1.15 * r} ${0.85 * r}H${-1.15 * r}Z`,
  (r) => `M0 ${-1.3 * r}L${1.3 * r} 0L0 ${1.3 * r}L${-1.3 * r} 0Z`,
  (r) => `M0 ${1.2 * r}L${1.15 * r} ${-0.85 * r}H${-1.15 * r}Z`,
  (r) => [[1, 3], [3, 1]].reduce((d, [a, b]) => `${d}M${(-a * r) / 2.6} ${(-b * r) / 2.6}h${(a * r) / 1.3}v${(b * r) / 1.3}h${(-a * r) / 1.3}Z`, ""),
  (r) => `M${-1.2 * r} ${0.6 * r}V${-0.6 * r}L0 ${-1.25 * r}L${1.2 * r} ${-0.6 * r}V${0.6 * r}L0 ${1.25 * r}Z`,
  (r) => `M${-0.5 * r} ${-1.25 * r}H${0.5 * r}L${1.2 * r} 0L${0.5 * r} ${1.25 * r}H${-0.5 * r}L${-1.2 * r} 0Z`,
];

export const series = (place) => `series-${(place % 8) + 1}`;

const shape = (place) => SHAPES[(place + Math.floor(place / 8)) % 8];

export function mark(place, x, y, { hollow = false, size = 5.5, ...rest } = {}, ...children) {
  // The mark of the controller at `place` in the comparison; hollow for the thesis's figure.
  const d = shape(place)(size);
  return s("path", { class: `mark ${series(place)}${hollow ? " hollow" : ""}`, d, transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`, ...rest }, ...children);
}

const sample = (place, hollow) => s("svg", { width: 16, height: 16, "aria-hidden": "true" }, mark(place, 8, 8, { hollow, size: 5 }));

export function key(controllers, others = []) {
  // The legend: each controller's mark and name, and what else there is to tell apart.
  return h("ul", { class: "legend key" },
    controllers.map((name, place) => h("li", {}, sample(place, false), name)),
    others.map(([drawn, text]) => h("li", {}, drawn, text)));
}

export const thesisSample = () => sample(0, true);

export const lineSample = (kind) =>
  s("svg", { width: 24, height: 16, "aria-hidden": "true" }, s("path", { class: kind, d: kind === "whisker" ? "M2 8H22M2 5V11M22 5V11" : "M1 8H23" }));
