// What a measured twin's figures say, in words.
import { clock, number, quantity, when } from "../lib/format.js";
import { GATE, PRECOOLER, WIDTH, expected } from "./measured.js";
import { titled } from "./names.js";

const UNITS = { degC: "°C" };

export const unitWords = (unit) => UNITS[unit] ?? unit;

function within(value, deviation, unit, digits) {
  // "0.50 ± 0.10 g/s"
  if (value === null || value === undefined) return "–";
  const width = Number.isFinite(deviation) ? ` ± ${number(WIDTH * deviation, digits)}` : "";
  return `${number(value, digits)}${width}${unit && ` ${unitWords(unit)}`}`;
}

const TONES = { sound: "good", failing: "bad", unknown: "warn" };

export function healthWords(name, { value, deviation, unit } = {}, verdict = "unknown") {
  // What stands for a part of the station: its name, the estimate, a word, and its tone.
  const leak = name.startsWith("leak_");
  if (name === PRECOOLER) return { title: "Precooler", figure: `${within(value, deviation, unit ?? "", 1)} warmer than it should be`, word: { sound: "as it should be", failing: "weak", unknown: "not known" }[verdict], tone: TONES[verdict] };
  const part = name.replace(/^leak_|_factor$/g, "");
  const title = leak ? `Leak of ${part}` : titled(part);
  const figure = leak ? within(value, deviation, unit ?? "", 2) : `${within(value && 100 * value, deviation && 100 * deviation, "%", 0)} of what it should give`;
  const failing = leak ? "leak" : part === "dispenser" ? "clogged" : "weak";
  const word = { sound: leak ? "no leak" : "as it should be", failing, unknown: "not known" }[verdict];
  return { title, figure, word, tone: TONES[verdict] };
}

const DIGITS = { bar: 1, degC: 1, "g/s": 1 };
const [{ value: LARGEST }] = GATE;

export function readingWords(name, { value, innovation, error, unit }, { silent, told, lasting = [] }) {
  // A reading, what was expected of it, the residual, and what they say.
  const digits = DIGITS[unit] ?? 1;
  const [model, deviation] = expected(value ?? NaN, error ?? NaN, innovation);
  const wrong = (lasting ?? []).find((event) => event.endsWith(`_${name}`));
  const said = { reading: within(value, NaN, unit, digits), model: within(model, deviation, unit, digits), residual: Number.isFinite(innovation) ? `${number(innovation, 1)} σ` : "–" };
  if (wrong) return { ...said, word: wrong.slice(0, -name.length - 1), tone: "bad" };
  if (silent !== null) return { ...said, word: told ? `no reading for ${number(silent)} s` : "no reading", tone: "warn" };
  if (Math.abs(innovation) > LARGEST) return { ...said, word: `beyond ${LARGEST} σ`, tone: "bad" };
  return { ...said, word: Math.abs(innovation) > WIDTH ? `beyond ${WIDTH} σ` : model === null ? "" : "fits", tone: "" };
}

export function eventWords({ name, begin_s: begin, begin_low_s: low = null, begin_high_s: high = null, found_s: found, size, unit, settled, size_deviation: deviation = null }, first) {
  // When something began, between which times, and was found, by the twin's clock, and how large it is, to WIDTH deviations; of a valve how it sticks.
  const at = (time) => clock(Math.max(0, time - first));
  const stuck = name?.startsWith("stuck_") ? `${size ? "open" : "closed"} · ` : null;
  const digits = unit === "g/s" ? 2 : unit === "s" || unit === "%" ? 0 : 1;
  const unsure = deviation === null ? "" : `${number(size, digits)} ± ${quantity(WIDTH * deviation, unitWords(unit), digits)}`;
  const large = stuck ?? (size === null ? "" : `${unsure || quantity(size, unitWords(unit), digits)}${settled === false ? " so far" : ""} · `);
  const between = low === null || high === null ? "" : ` (${at(low)} to ${at(high)})`;
  return `${large}since about ${at(begin)}${between} · found at ${at(found)}`;
}

export const isUnix = (time) => time >= 1e8; // what is smaller is no Unix time of a station [s]

export function agoWords(time, ago) {
  // When the newest second was measured, and how long ago.
  if (!isUnix(time)) return `${number(time)} s`;
  const old = Math.max(0, ago);
  const words = old < 120 ? `${number(old)} s` : old < 7200 ? `${number(old / 60)} min` : old < 172_800 ? `${number(old / 3600)} h` : `${number(old / 86_400)} d`;
  return `${when(new Date(1000 * time).toISOString())}, ${words} ago`;
}
