// Axes: where a value lies on the screen, which values deserve a line. Any range gives a bounded answer.
import { clock } from "./format.js";

const RESOLVED = 1e-9; // a range that is narrower than this share of its values is one value
const [LEAST, MOST] = [1e-280, 1e300]; // figures beyond these have no finite width, or slope
const DIGITS_MAX = 20; // decimals that are written

function bounded(value) {
  if (Math.abs(value) < LEAST) return 0;
  return Math.min(Math.max(value, -MOST), MOST);
}

const scaleOf = (low, high) => Math.max(Math.abs(low), Math.abs(high));

export const narrow = (low, high) => !(high - low > Math.max(RESOLVED * scaleOf(low, high), LEAST));

export function extent(values) {
  // The least and the greatest finite value, or null; of any number of values.
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (!Number.isFinite(value)) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [low, high] : null;
}

export function padded(values, share = 0.08) {
  // An interval around what is finite in `values`, always wide enough for an axis.
  const [low, high] = (extent(values) ?? [0, 1]).map(bounded);
  const space = narrow(low, high) ? (scaleOf(low, high) || 1) * Math.max(share, 1e-3) : (high - low) * share;
  return [bounded(low - space), bounded(high + space)];
}

export function linear([low, high], [from, to]) {
  // The place of a value; `back` is the value at a place.
  const slope = (to - from) / (high - low || 1);
  const at = (value) => from + (value - low) * slope;
  at.back = (place) => low + (place - from) / (slope || 1);
  return at;
}

function multiples(low, high, step, most) {
  // The multiples of a step from `low` to `high`, at most `most` of them.
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  const count = Math.min(Math.max(last - first + 1, 0), most);
  return Array.from({ length: Number.isFinite(count) ? count : 0 }, (_, place) => (first + place) * step || 0);
}

function interval(low, high) {
  // In order and finite; null where a bound is no number.
  if (Number.isNaN(low) || Number.isNaN(high)) return null;
  return [Math.min(low, high), Math.max(low, high)].map(bounded);
}

export function ticks(low, high, count = 4) {
  // About `count` round values from `low` to `high`, at least two; one for a range that is one value, none for no range.
  const found = interval(low, high);
  if (!found) return [];
  const [least, greatest] = found;
  if (narrow(least, greatest)) return [least];
  const rough = (greatest - least) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10);
  if (!(step > 0)) return [least];
  const places = multiples(least, greatest, step, 2 * count + 2);
  return places.length > 1 ? places : ticks(least, greatest, 2 * count); // a scale needs two
}

// Decimals that tell neighbouring ticks apart.
export function digitsOf(places) {
  if (places.length < 2) return 0;
  const digits = -Math.floor(Math.log10(Math.abs(places[1] - places[0])) + 1e-9);
  return Math.min(Math.max(0, Number.isFinite(digits) ? digits : 0), DIGITS_MAX);
}

const DAY = 86_400;
const TIMES = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10_800, 21_600, 43_200, DAY];

export function clockTicks(from, to, count) {
  // Round times of the station's clock, and how to write them.
  const found = interval(from, to);
  if (!found) return [];
  const span = found[1] - found[0];
  const step = TIMES.find((each) => span / each <= count) ?? DAY * Math.ceil(span / count / DAY);
  return multiples(...found, step, count + 2).map((time) => [time, clock(time)]);
}
