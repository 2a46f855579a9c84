// Bars: each figure of merit, a panel a scenario, a bar a controller, with its spread and the thesis's figure.
import { linear } from "../lib/axis.js";
import { h, s } from "../lib/dom.js";
import { key, lineSample, mark, series, thesisSample } from "./marks.js";
import { bracket, digits, FIRST, meaning, written } from "./metrics.js";
import { sized, textWidth } from "./scale.js";

const ROW = 22;
const THICK = 14;

export function bars(controllers) {
  // Its section, and `renew` that shows what has come since.
  let [units, items, scenarios] = [{}, [], []];
  const legend = h("div");
  const picks = h("fieldset", { class: "choices" });
  const panels = h("div", { class: "figures" });
  const chosen = new Set(FIRST);
  const draw = () => panels.replaceChildren(...Object.keys(units).filter((name) => chosen.has(name)).sort((a, b) => order(a) - order(b)).map(figure));
  const figure = (name) => h("figure", { class: "metric", "data-metric": name },
    h("figcaption", {}, h("b", {}, meaning(name)), h("span", {}, h("code", {}, name), " ", h("span", { class: "unit" }, bracket(units[name])))),
    scenarios.map((scenario) => [scenario, items.filter((item) => item.scenario === scenario && name in item.mean)]).filter(([, there]) => there.length)
      .map(([scenario, there]) => panel(name, units[name], scenario, there, controllers)));
  const pick = (name) => h("label", {}, h("input", {
    type: "checkbox", name: "metric", value: name, checked: chosen.has(name),
    onchange: ({ target }) => { if (target.checked) chosen.add(name); else chosen.delete(name); draw(); },
  }), `${meaning(name)} ${bracket(units[name])}`);
  const known = () => Object.keys(units).filter((name) => items.some((item) => (item.mean[name] ?? null) !== null)).sort((a, b) => order(a) - order(b));
  const renew = (figures, done) => {
    [units, items, scenarios] = [figures.units, figures.items, done];
    legend.replaceChildren(key(controllers, [
      items.some((item) => Object.keys(item.thesis).length) && [thesisSample(), "hollow: printed in the thesis"],
      items.some((item) => item.deviation) && [lineSample("whisker"), "standard deviation over replications"],
    ].filter(Boolean)));
    if (picks.querySelectorAll("input").length !== known().length) picks.replaceChildren(h("legend", { class: "unseen" }, "Figures of merit"), ...known().map(pick));
    draw();
  };
  const element = h("section", { class: "card bars", "aria-labelledby": "bars-title" },
    h("h2", { id: "bars-title" }, "Figures of merit"),
    h("p", { class: "lead" }, "Bars begin at 0. Each scenario has a scale of its own, so compare controllers within one."),
    legend,
    panels,
    h("details", {}, h("summary", {}, "Choose figures"), picks));
  return { element, renew };
}

const order = (name) => (FIRST.indexOf(name) + 1 || 99);

function panel(name, unit, scenario, items, controllers) {
  const places = digits(items.map((item) => item.mean[name]));
  const spoken = items.map((item) => `${item.controller} ${described(item, name, unit, places)}`).join("; ");
  const box = h("div", { class: "panel" });
  sized(box, (width) => {
    const label = Math.min(Math.max(...items.map((item) => textWidth(item.controller))) + 10, width * 0.42);
    const values = items.map((item) => text(item, name, unit, places));
    const room = Math.max(...values.map((value) => textWidth(value, 600))) + 14;
    const highest = Math.max(...items.flatMap((item) => [item.mean[name] + (item.deviation?.[name] ?? 0), item.thesis[name] ?? 0]), 0);
    const at = linear([0, highest || 1], [label, width - room - 4]);
    const height = items.length * ROW + 4;
    return s("svg", { width, height, role: "img", "aria-label": `${meaning(name)}, ${scenario}: ${spoken}` },
      items.map((item, row) => bar(item, { name, unit, places, at, y: row * ROW + ROW / 2 + 2, label, place: controllers.indexOf(item.controller), value: values[row], edge: width })),
      s("path", { class: "axis", d: `M${label + 0.5} 0V${height}` }));
  });
  return h("div", {}, h("h3", {}, scenario), box);
}

function text(item, name, unit, places) {
  return item.mean[name] === null ? "not finite" : written(item.mean[name], unit, places);
}

function described(item, name, unit, places) {
  const spread = item.deviation?.[name];
  const thesis = item.thesis[name];
  return [text(item, name, unit, places), spread != null && ` ± ${written(spread, unit, places)}`, thesis !== undefined && `, thesis ${written(thesis, unit, 0)}`].filter(Boolean).join("");
}

function bar(item, { name, unit, places, at, y, label, place, value, edge }) {
  const mean = item.mean[name];
  const spread = item.deviation?.[name];
  const end = at(mean ?? 0);
  const whisker = spread ? [at(Math.max(0, mean - spread)), at(mean + spread)] : null;
  const thesis = item.thesis[name];
  return s("g", { class: `bar ${series(place)}`, "data-scenario": item.scenario, "data-controller": item.controller, "data-value": mean, "data-deviation": spread, "data-thesis": thesis },
    s("title", {}, `${item.controller}: ${described(item, name, unit, places)}`),
    s("text", { class: "name", x: label - 8, y: y + 4, "text-anchor": "end" }, clipped(item.controller, label - 8)),
    s("rect", { x: label + 1, y: y - THICK / 2, width: Math.max(end - label - 1, 0), height: THICK }),
    whisker && ["halo", "whisker"].map((kind) => s("path", { class: kind, d: `M${whisker[0]} ${y}H${whisker[1]}M${whisker[0]} ${y - 3}v6M${whisker[1]} ${y - 3}v6` })),
    thesis !== undefined && mark(place, at(thesis), y, { hollow: true, size: 4.5 }),
    s("text", { class: "value", x: edge, y: y + 4, "text-anchor": "end" }, value));
}

function clipped(words, room) {
  if (textWidth(words) <= room) return words;
  let kept = words;
  while (kept.length > 3 && textWidth(`${kept}…`) > room) kept = kept.slice(0, -1);
  return `${kept}…`;
}
