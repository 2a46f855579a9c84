// The panels of the series: what each shows, and how uPlot draws it.
import { clock, number } from "../lib/format.js";
import uPlot from "../vendor/uplot/uPlot.esm.js";
import { fitted } from "./limits.js";
import { BUFFERS, LETTER, SHOWN, TANKS, titled } from "./names.js";
import { paintStrip, rowsOf } from "./strip.js";

const lines = (prefix, names) =>
  names.map((name) => ({ column: `${prefix}_${name}`, name: titled(name), letter: LETTER[name], colour: `--${name}`, at: 1 + SHOWN.indexOf(`${prefix}_${name}`) }));

export const PANELS = [
  { id: "buffers", title: "Pressure of buffers", unit: "bar", height: 190, digits: 1, lines: lines("pressure", BUFFERS), least: 5, floor: 0 },
  { id: "vehicle", title: "Pressure of vehicle", unit: "bar", height: 120, digits: 1, lines: lines("pressure", ["vehicle"]), least: 20, floor: 0 },
  { id: "flow", title: "Flow", unit: "g/s", height: 120, digits: 1, lines: lines("flow", ["compressor", "dispenser"]), least: 10, floor: 0 },
  { id: "temperature", title: "Temperature", unit: "°C", height: 140, digits: 1, lines: lines("temperature", TANKS), least: 5 },
  { id: "valves", title: "Valves, vehicle and queue", unit: "", height: 196, digits: 0, lines: [], rows: rowsOf((name) => 1 + SHOWN.indexOf(name)) },
];

const SECONDS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800, 604800];

let colours = new Map();
const scheme = matchMedia("screen and (prefers-color-scheme: dark)");
scheme.addEventListener("change", () => (colours = new Map()));

export function colour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}

export const AT_REST = 1.6; // width of a line [px]
export const MOVING = 1; // thin lines are drawn in half the time

const BAND = "30"; // opacity of what lies within two standard deviations

const FONT = '12px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';

function letters(panel) {
  // Each line has its letter at its end, so that it is told apart without its colour.
  return (u) => {
    const { ctx, bbox } = u;
    const ratio = devicePixelRatio;
    const [, last] = u.series[0].idxs ?? [0, -1];
    const ends = panel.lines
      .map((line, place) => ({ line, series: u.series[place + 1], value: newest(u.data[place + 1], last) }))
      .filter(({ series, value }) => series.show && value !== null)
      .map(({ line, value }) => ({ line, y: u.valToPos(value, "y", true) }))
      .sort((one, other) => one.y - other.y);
    ctx.save();
    ctx.font = `bold ${11 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    let free = bbox.top;
    for (const { line, y } of ends) {
      const place = Math.max(y, free + 5 * ratio);
      ctx.fillStyle = colour(line.colour);
      ctx.fillText(line.letter, bbox.left + bbox.width + 5 * ratio, place);
      free = place + 7 * ratio;
    }
    ctx.restore();
  };
}

function newest(values, last) {
  for (let row = Math.min(last, values.length - 1), tried = 0; row >= 0 && tried < 3; row--, tried++) if (values[row] !== null) return values[row];
  return null;
}

function axes(panel, withClock) {
  const grid = { stroke: () => colour("--line"), width: 1 };
  const common = { stroke: () => colour("--soft"), font: FONT, grid, ticks: { ...grid, size: 4 } };
  const x = { ...common, incrs: SECONDS, space: 90, size: withClock ? 26 : 6, values: (u, splits) => splits.map((time) => (withClock && time !== null ? clock(time) : "")) };
  const y = { ...common, size: 58, gap: 6, space: 26 };
  if (panel.rows) {
    return [x, { ...y, grid: { show: false }, ticks: { show: false }, splits: () => panel.rows.map((row, place) => panel.rows.length - place - 0.5), values: () => panel.rows.map((row) => row.label) }];
  }
  return [x, { ...y, values: (u, splits, axis, space, step) => splits.map((value) => number(value, step < 0.1 ? 2 : step < 1 ? 1 : 0)) }];
}

function written(ctx, text, x, y) {
  // A text with a rim of the card's colour, which is read also above lines.
  ctx.save();
  ctx.setLineDash([]);
  ctx.lineWidth = 3 * devicePixelRatio;
  ctx.strokeStyle = colour("--card");
  ctx.strokeText(text, x, y);
  ctx.restore();
  ctx.fillText(text, x, y);
}

function limitLines(levels) {
  // The limits that lie within what is shown, each with its name.
  return (u) => {
    const { ctx, bbox } = u;
    const ratio = devicePixelRatio;
    const { min, max } = u.scales.y;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = colour("--bad");
    ctx.setLineDash([6 * ratio, 4 * ratio]);
    ctx.lineWidth = ratio;
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    for (const { name, value } of levels.filter((level) => level.value >= min && level.value <= max)) {
      const y = Math.round(u.valToPos(value, "y", true));
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.textBaseline = y - bbox.top < 16 * ratio ? "top" : "bottom";
      written(ctx, `${name} ${number(value, 1)}`, bbox.left + 6 * ratio, y + (ctx.textBaseline === "top" ? 2 : -2) * ratio);
    }
    ctx.restore();
  };
}

export function fanBehind(u, fan) {
  // The bands of a forecast behind the lines of the buffers, where the window shows their time.
  if (!fan) return;
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  const points = (values) => values.map((bar, place) => [u.valToPos(fan.times[place], "x", true), u.valToPos(bar, "y", true)]);
  for (const name of BUFFERS) {
    const { low, high } = fan.pressures[name];
    ctx.fillStyle = `${colour(`--${name}`)}${BAND}`;
    ctx.beginPath();
    for (const [x, y] of [...points(low), ...points(high).reverse()]) ctx.lineTo(x, y);
    ctx.fill();
  }
  ctx.restore();
}

export function notesOn(u, notes, withNumbers) {
  // What people noted, behind the lines: a mark at a moment, a band over a stretch; the numbers of the list above the first panel.
  const { ctx, bbox } = u;
  const ratio = devicePixelRatio;
  const { min, max } = u.scales.x;
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = colour("--accent");
  ctx.font = `bold ${11 * ratio}px system-ui, sans-serif`;
  ctx.textBaseline = "top";
  for (const { number: place, time_s: from, to_s: to } of notes) {
    if (from > max || (to ?? from) < min) continue;
    const [left, right] = [from, to ?? from].map((time) => Math.round(u.valToPos(Math.min(Math.max(time, min), max), "x", true)));
    ctx.fillStyle = `${colour("--accent")}${BAND}`;
    ctx.fillRect(left, bbox.top, right - left, bbox.height);
    ctx.fillStyle = colour("--accent");
    ctx.fillRect(left, bbox.top, ratio, bbox.height);
    if (withNumbers) ctx.fillText(String(place), left + 3 * ratio, bbox.top + 2 * ratio);
  }
  ctx.restore();
}

function rangeOf(panel, levels) {
  if (!panel.lines.length) return () => [0, panel.rows.length];
  return (u, low, high) => fitted(low, high, { ...panel, levels: levels.map(({ value }) => value) });
}

export function panelOf(panel, place, { group, hooks, levels, press, last }) {
  // A panel in its place; `hooks` hear of the cursor and of stretches that were marked.
  const series = panel.lines.map((line) => ({ label: line.name, stroke: () => colour(line.colour), width: AT_REST, points: { show: false } }));
  const extras = extrasOf(panel);
  const beside = extras.map(({ kind, line }) => kind === "model"
    ? { label: `${line.name}, model`, stroke: () => colour(line.colour), width: 1, dash: [5, 4], points: { show: false } }
    : { label: `${line.name}, ${kind}`, width: 0, auto: false, points: { show: false } });
  const bands = extras.flatMap(({ kind, line }, place) => kind === "high" ? [{ series: [1 + series.length + place, series.length + place], fill: () => `${colour(line.colour)}${BAND}` }] : []);
  const shown = panel.lines.length ? [...series, ...beside] : [{ paths: () => null, points: { show: false } }];
  return new uPlot(
    {
      width: 300,
      height: panel.height,
      padding: [8, 22, 0, 0],
      legend: { show: false },
      focus: { alpha: 1 },
      cursor: {
        sync: { key: group.key, scales: ["x", null] },
        drag: { x: true, y: false, setScale: false, dist: 6 },
        bind: { mousedown: press, dblclick: () => null },
        points: { show: panel.lines.length > 0, size: 7 },
      },
      scales: { x: { time: false, auto: false, min: 0, max: 600 }, y: { range: rangeOf(panel, levels) } },
      axes: axes(panel, last),
      series: [{}, ...shown],
      bands,
      hooks: { ...hooks, draw: panel.lines.length ? [limitLines(levels), letters(panel)] : [(u) => paintStrip(u, colour, panel.rows)] },
    },
    [[], ...shown.map(() => [])],
    place,
  );
}

export function extrasOf(panel) {
  // What is drawn besides the lines: what a model expects, and between what it, or the line itself, lies.
  return panel.lines.flatMap((line, of) => ["model", "low", "high"].filter((kind) => line[kind]).map((kind) => ({ kind, line, of, at: line[kind] })));
}

export function dataOf(panel, table) {
  if (!panel.lines.length) return [table[0], table[table.length - 1]];
  return [table[0], ...[...panel.lines, ...extrasOf(panel)].map(({ at }) => table[at])];
}

export function keyWords(line, panel, table, row) {
  // A figure at the cursor; with what the model expects and within what that lies, where it is known.
  const figure = number(table[line.at][row], panel.digits);
  if (!line.low) return `${figure} ${panel.unit}`;
  const [low, high] = [table[line.low][row], table[line.high][row]];
  const width = Number.isFinite(low) && Number.isFinite(high) ? ` ± ${number((high - low) / 2, panel.digits)}` : "";
  return Number.isFinite(table[line.model]?.[row]) ? `${figure}, model ${number(table[line.model][row], panel.digits)}${width} ${panel.unit}` : `${figure}${width} ${panel.unit}`;
}
