// What a calibration found, in words.
import { quantity, words } from "../lib/format.js";
import { titled } from "./names.js";

// How a field of a station ends: what it is called, its unit and digits.
const FIELDS = {
  volume_m3: ["volume", "m³", 4],
  inlet_heating_k_per_s: ["heating while filled", "K/s", 4],
  outlet_cooling_k_per_s: ["cooling while drawn from", "K/s", 4],
  heating_k_per_s: ["heating while filled", "K/s", 4],
  pressure_bar: ["pressure", "bar", 1],
  inlet_coefficient_g_per_s_bar: ["inlet coefficient", "g/(s bar)", 4],
  outlet_coefficient_g_per_s_bar: ["outlet coefficient", "g/(s bar)", 4],
  heat_exchange_per_s: ["heat exchange", "1/s", 6],
  ambient_temperature_c: ["ambient temperature", "°C", 2],
};

export function parameterWords(name, { value, low, high }) {
  // A parameter by its place in a station: what it is called, and its figures with their unit.
  const parts = name.split(".");
  const [field, unit, digits] = FIELDS[parts.at(-1)] ?? [words(parts.at(-1)), "", 4];
  const part = parts.length > 1 && parts.at(-2) !== "thermal" ? `${words(parts.at(-2))}: ` : "";
  const figure = (given) => (unit ? quantity(given, unit, digits) : given.toPrecision(6));
  return { title: titled(`${part}${field}`), value: figure(value), interval: `${figure(low)} to ${figure(high)}` };
}

export function verdictWords({ state, result, problem }) {
  // What became of a calibration.
  if (result?.verdict === "accepted") return "Accepted: the model fits the part that was held out.";
  if (result) return "Refused: the model does not fit, and nothing of it can be used. Another station, a clock that is off, or a sensor that fails.";
  if (state === "failed") return `Failed: ${[problem?.title, problem?.detail].filter(Boolean).join(", ")}.`;
  return "Cancelled.";
}
