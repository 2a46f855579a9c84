// A twin that follows measurements: its columns, what the model expects of its sensors, its panels, the station's picture.
import { BUFFERS, LETTER, TANKS, VALVES, titled } from "./names.js";
import { rowsOf } from "./strip.js";

const PRESSURES = TANKS.map((tank) => `pressure_${tank}`);
const TEMPERATURES = TANKS.map((tank) => `temperature_${tank}`);
const FLOWS = ["flow_compressor", "flow_dispenser"];
const LEAKS = BUFFERS.map((buffer) => `leak_${buffer}`);
const FACTORS = ["compressor_factor", "dispenser_factor"];

export const ANALOG = [...PRESSURES, ...TEMPERATURES, ...FLOWS];
export const HEALTH = [...LEAKS, ...FACTORS];
export const PRECOOLER = "precooler_deviation"; // where the model has one
const COMMANDED = [...VALVES, "vehicle"];

export const WIDTH = 2; // standard deviations that are shown on either side

// Columns that are fetched, in the order in which they are kept.
export const SENSED = [
  ...[...ANALOG, ...COMMANDED].map((name) => `measured_${name}`),
  ...ANALOG.flatMap((name) => [`error_${name}`, `innovation_${name}`]),
  ...HEALTH.flatMap((name) => [`estimate_${name}`, `deviation_${name}`]),
];

// And what follows from them: what the model expects of a sensor, and between what a figure lies.
const EXPECTED = ANALOG.flatMap((name) => [`model_${name}`, `least_${name}`, `most_${name}`]);
const BETWEEN = HEALTH.flatMap((name) => [`least_${name}`, `most_${name}`]);

const PLACE = new Map([...SENSED, ...EXPECTED, ...BETWEEN].map((name, place) => [name, 1 + place]));
const at = (name) => PLACE.get(name);

export function expected(measured, error, innovation) {
  // What the model expected of a reading, and the standard deviation of that: the error is so many times as large.
  if (!Number.isFinite(measured) || !Number.isFinite(error)) return [null, null];
  return [measured - error, innovation ? Math.abs(error / innovation) : null];
}

const between = (value, deviation) => (value === null || deviation === null ? [null, null] : [value - WIDTH * deviation, value + WIDTH * deviation]);

export function whole(table) {
  // The table with the columns that follow from those fetched.
  const column = (name) => table[at(name)];
  const added = ANALOG.map((name) => {
    const [measured, error, innovation] = ["measured", "error", "innovation"].map((kind) => column(`${kind}_${name}`));
    const rows = measured.map((value, row) => expected(value ?? NaN, error[row] ?? NaN, innovation[row]));
    const sides = rows.map(([model, deviation]) => between(model, deviation));
    return [rows.map(([model]) => model), sides.map(([least]) => least), sides.map(([, most]) => most)];
  });
  const health = HEALTH.map((name) => {
    const deviation = column(`deviation_${name}`);
    const sides = column(`estimate_${name}`).map((value, row) => between(value, deviation[row]));
    return [sides.map(([least]) => least), sides.map(([, most]) => most)];
  });
  return [...table, ...added.flat(), ...health.flat()];
}

const part = (name) => name.replace(/^(pressure|temperature|flow|leak)_|_factor$/g, "");

function linesOf(kind, names) {
  return names.map((name) => ({
    column: `${kind}_${name}`, name: titled(part(name)), letter: LETTER[part(name)], colour: `--${part(name)}`, at: at(`${kind}_${name}`),
    ...(kind === "innovation" ? {} : { model: at(`model_${name}`), low: at(`least_${name}`), high: at(`most_${name}`) }),
  }));
}

const gate = (value) => ({ name: "not used beyond", equation: null, value, of: [] });

export const GATE = [gate(6), gate(-6)];

export const measuredPanels = () => [
  { id: "buffers", title: "Pressure of buffers", unit: "bar", height: 190, digits: 1, lines: linesOf("measured", PRESSURES.slice(0, 3)), least: 5, floor: 0 },
  { id: "vehicle", title: "Pressure of vehicle", unit: "bar", height: 120, digits: 1, lines: linesOf("measured", PRESSURES.slice(3)), least: 20, floor: 0 },
  { id: "flow", title: "Flow", unit: "g/s", height: 120, digits: 1, lines: linesOf("measured", FLOWS), least: 10, floor: 0 },
  { id: "temperature", title: "Temperature", unit: "°C", height: 140, digits: 1, lines: linesOf("measured", TEMPERATURES), least: 5 },
  { id: "residuals", title: "Residuals of pressure and flow", unit: "σ", height: 130, digits: 1, lines: linesOf("innovation", [...PRESSURES, ...FLOWS]), least: 8, levels: GATE },
  { id: "warmth", title: "Residuals of temperature", unit: "σ", height: 110, digits: 1, lines: linesOf("innovation", TEMPERATURES), least: 8, levels: GATE },
  { id: "leaks", title: "Leak of buffers", unit: "g/s", height: 110, digits: 2, lines: linesOf("estimate", LEAKS), least: 0.5 },
  { id: "factors", title: "Compressor and dispenser, part of what they should give", unit: "", height: 110, digits: 2, lines: linesOf("estimate", FACTORS), least: 0.3 },
  { id: "valves", title: "Valves and vehicle", unit: "", height: 160, digits: 0, lines: [], rows: rowsOf((name) => at(`measured_${name}`)) },
];

export const HELD = 10; // a reading that is missed stands for so long [s]

export class Readings {
  // The last reading of each sensor, and the picture's figures from them.
  #read = new Map(); // sensor -> [time, value]
  #heard = null; // time of the first second that was looked at

  take(values) {
    this.#heard ??= values.time;
    for (const name of [...ANALOG, ...COMMANDED]) if (Number.isFinite(values[`measured_${name}`])) this.#read.set(name, [values.time, values[`measured_${name}`]]);
  }

  restart() {
    this.#read.clear();
    this.#heard = null;
  }

  silent(name, now) {
    // For how long a sensor has told nothing [s]; null where it told something just now.
    const [time] = this.#read.get(name) ?? [this.#heard ?? now];
    return now - time > HELD ? now - time : null;
  }

  told(name) {
    return this.#read.has(name);
  }

  picture(values) {
    // As the picture of a simulated twin takes them.
    const held = (name) => {
      const [time, value] = this.#read.get(name) ?? [];
      return values.time - time <= HELD ? value : null;
    };
    const vehicle = held("vehicle");
    const gone = (name) => name.endsWith("_vehicle") && !(vehicle >= 0);
    const figures = ANALOG.map((name) => [name, gone(name) ? null : held(name)]);
    const masses = TANKS.map((tank) => [`mass_${tank}`, values[`estimate_mass_${tank}`]]);
    const valves = VALVES.map((valve) => [valve, held(valve) > 0.5 ? 1 : 0]);
    return { time: values.time, vehicle, ...Object.fromEntries([...figures, ...masses, ...valves]) };
  }
}
