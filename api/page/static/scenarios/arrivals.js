// A drawing of arrivals: a bar a span of time, a tick a vehicle.
import { clockTicks, extent, linear } from "../lib/axis.js";
import { h, s } from "../lib/dom.js";
import { clock, number, quantity } from "../lib/format.js";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [560, 250, 52, 14, 12, 58];
const BARS = 24;
const TICKS_MAX = 600;

export function arrivalsPicture({ columns }) {
  const times = columns.arrival;
  const end = Math.max(times.at(-1), 60);
  const px = linear([0, end], [LEFT, WIDTH - RIGHT]);
  const counts = new Array(BARS).fill(0);
  for (const time of times) counts[Math.min(BARS - 1, Math.floor((time / end) * BARS))]++;
  const most = Math.max(...counts);
  const py = linear([0, most], [HEIGHT - BOTTOM, TOP]);
  const bars = counts.map((count, k) => count > 0 && s("rect", { class: "bar", x: px((k * end) / BARS) + 0.75, width: px(end / BARS) - px(0) - 1.5, y: py(count), height: HEIGHT - BOTTOM - py(count) }, s("title", {}, `${count} from ${clock((k * end) / BARS)} to ${clock(((k + 1) * end) / BARS)}`)));
  const levels = [...new Set([0, Math.ceil(most / 2), most])].map((count) => [s("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: py(count), y2: py(count) }), s("text", { x: LEFT - 6, y: py(count) + 4, "text-anchor": "end" }, count)]);
  const hours = clockTicks(0, end, 6).map(([time, text]) => s("text", { x: px(time), y: HEIGHT - 24, "text-anchor": px(time) > WIDTH - 40 ? "end" : "middle" }, text));
  const ticks = times.length <= TICKS_MAX && times.map((time) => s("line", { class: "tick", x1: px(time), x2: px(time), y1: HEIGHT - BOTTOM + 4, y2: HEIGHT - BOTTOM + 14 }));
  const gap = times.length > 1 ? (times.at(-1) - times[0]) / (times.length - 1) : null;
  const [low, high] = extent(columns.start_pressure);
  const starts = high - low < 0.05 ? quantity(low, "bar", 1) : `${number(low, 1)} to ${quantity(high, "bar", 1)}`;
  return h("figure", {},
    s("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${times.length} arrivals in ${clock(times.at(-1))}` }, levels, bars, ticks, hours,
      s("text", { transform: `translate(12 ${(HEIGHT - BOTTOM + TOP) / 2}) rotate(-90)`, "text-anchor": "middle" }, "vehicles"),
      s("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, "arrival, time since start [h:mm:ss]")),
    h("figcaption", { class: "hint" }, `${number(times.length)} vehicles, the last at ${clock(times.at(-1))}`, gap === null ? "" : `, ${quantity(gap, "s")} apart on the mean`, `; they start at ${starts}. Bars count the vehicles of ${quantity(end / BARS, "s")}.`));
}
