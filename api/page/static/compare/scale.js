// Axes: where a value lies on the screen, which values deserve a line, and a chart that follows its box.
import { clock } from "../lib/format.js";

export function linear([low, high], [from, to]) {
  // The place of a value; `back` is the value at a place.
  const slope = (to - from) / (high - low || 1);
  const at = (value) => from + (value - low) * slope;
  at.back = (place) => low + (place - from) / slope;
  return at;
}

function stepped(low, high, step) {
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + step * 1e-9; n += 1) found.push(n * step);
  return found;
}

export function ticks(low, high, count = 4) {
  // About `count` round values from `low` to `high`.
  const rough = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  return stepped(low, high, power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10));
}

export const digitsOf = (places) => (places.length > 1 ? Math.max(0, -Math.floor(Math.log10(places[1] - places[0]) + 1e-9)) : 0);

const TIMES = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];

export function clockTicks(from, to, count) {
  // Round times of the station's clock, and how to write them.
  const step = TIMES.find((each) => (to - from) / each <= count) ?? 86400 * Math.ceil((to - from) / count / 86400);
  return stepped(from, to, step).map((time) => [time, clock(time)]);
}

export function padded(values, share = 0.08) {
  // The interval of what is finite in `values` with some space around.
  const finite = values.filter(Number.isFinite);
  if (!finite.length) return [0, 1];
  const [low, high] = [Math.min(...finite), Math.max(...finite)];
  const space = (high - low || Math.abs(high) || 1) * share;
  return [low - space, high + space];
}

export function sized(host, draw) {
  // Draw a chart as wide as its box, again whenever the box changes; returns a function that draws it anew.
  let width = 0;
  const again = () => width && host.replaceChildren(draw(width));
  new ResizeObserver(([entry]) => {
    const wide = Math.floor(entry.contentRect.width);
    if (wide === width) return;
    width = wide;
    again();
  }).observe(host);
  return again;
}

const ruler = document.createElement("canvas").getContext("2d");

export function textWidth(text, weight = 400) {
  ruler.font = `${weight} 12px ${getComputedStyle(document.body).fontFamily}`;
  return ruler.measureText(text).width;
}
