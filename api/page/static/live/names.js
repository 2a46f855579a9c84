// What the columns, codes and kinds of a twin are called on the page.
import { LIMITS } from "./limit_words.js";

export const BUFFERS = ["high", "medium", "low"];
export const TANKS = [...BUFFERS, "vehicle"];
export const LETTER = { high: "H", medium: "M", low: "L", vehicle: "V", compressor: "C", dispenser: "D" };
export const VALVES = ["inlet", "outlet"].flatMap((side) => BUFFERS.map((buffer) => `${side}_${buffer}`));

export const valveWords = (valve) => valve.replace("_", " ");

export const titled = (text) => text[0].toUpperCase() + text.slice(1);

// Limits by their codes: what each is called, its equation, and what it says. The service makes the module of its registry.
export { LIMITS };

const BY_NAME = new Map(LIMITS.filter(Boolean).map((limit) => [limit.name, limit]));

export const limitOf = (code) => (typeof code === "string" ? BY_NAME.get(code) : LIMITS[code]) ?? null;

export const equation = (limit) => (limit.equation ? `Eq. (${limit.equation})` : "limit of the station");

export const DECISIONS = ["by rule", "by search: optimal", "by search: feasible", "by the liveness rule", "by the fallback (logic)"];

// Whether samples of a layout are of a twin that follows measurements, of whatever plant.
export const isMeasured = ({ layout }) => layout === "measured" || layout.startsWith("measured-");

export const ALIVE = new Set(["running", "paused"]);

export const STATES = { running: "good", paused: "warn", finished: "", stopped: "", failed: "bad" };

export const AT_END = { idle: "idle: go on, vehicles may be added", repeat: "repeat: the next replication's vehicles", stop: "stop" };

export const speedWords = (speed) => (speed === "max" ? "as fast as possible" : `${speed}×`);

export function speedOf(text) {
  // What was typed, as the service takes it: a number where it is one.
  const plain = text.trim().toLowerCase().replace(/(?<=\d)\s*[×x]$/, ""); // the x of "10 x", not that of "max"
  return plain !== "" && Number.isFinite(Number(plain)) ? Number(plain) : plain;
}

// Columns of a plant with real gas, where a twin has them: what they are called, their unit and digits, and its factor.
export const OWN = [
  ["state_of_charge_vehicle", "state of charge", "%", 1, 100],
  ["power_compressor", "compressor power", "kW", 1, 1],
  ["power_precooler", "precooler power", "kW", 1, 1],
  ["temperature_delivery", "gas at the nozzle", "°C", 1, 1],
  ["temperature_wall_vehicle", "vehicle's tank wall", "°C", 1, 1],
];

// Columns that the series show, in the order in which they are kept.
export const SHOWN = [
  ...TANKS.map((tank) => `pressure_${tank}`),
  "flow_compressor",
  "flow_dispenser",
  ...TANKS.map((tank) => `temperature_${tank}`),
  ...VALVES,
  ...VALVES.map((valve) => `refused_${valve}`),
  "vehicle",
  "queue_length",
];
