// The limits of a station against the figures of a sample: where they lie, and how far it is to them, in words.
import { number, quantity } from "../lib/format.js";
import { BUFFERS, limitOf, titled } from "./names.js";

export const fullAt = (station, tank) =>
  // The pressure at which a tank is full [bar].
  tank === "vehicle" ? station.vehicle.finish_pressure_bar : (station.real_gas?.bank_pressure_max_bar[tank] ?? station.compressor.pressure_bar);

const level = (limit, value, of) => ({ name: limitOf(limit).title, equation: limitOf(limit).equation, value, of });

export function levelsOf(station) {
  // Limits that are a level of a figure, by the panel that shows it; `of` says whose figures they are about.
  const { compressor, dispenser, thermal, vehicle, real_gas: gas } = station;
  const buffers = BUFFERS.map(titled);
  return {
    buffers: gas // there is no hold pressure, and the compressor's is a figure of the controllers' model alone
      ? BUFFERS.map((buffer) => ({ name: "greatest pressure", equation: null, value: fullAt(station, buffer), of: [titled(buffer)] }))
      : [
          level("hold", compressor.hold_pressure_bar, buffers),
          level("compressor_pressure", compressor.pressure_bar, buffers),
        ],
    vehicle: [{ name: gas ? "nominal working pressure" : "finish pressure", equation: null, value: vehicle.finish_pressure_bar, of: ["Vehicle"] }],
    flow: gas
      ? [{ name: "nozzle's flow", equation: null, value: gas.dispensing.flow_max_g_per_s, of: ["Dispenser"] }]
      : [level("flow", dispenser.flow_max_g_per_s, ["Dispenser"])],
    temperature: [
      level("buffer_temperature", thermal.buffer_temperature_max_c, buffers),
      level("vehicle_temperature", vehicle.temperature_max_c, ["Vehicle"]),
    ],
  };
}

export const cited = ({ name, equation }) => (equation ? `${name} (${equation})` : name);

export function margin(level, value, unit) {
  // "38.4 K below"; null where there is no figure.
  if (value === null || value === undefined || Number.isNaN(value)) return null;
  const by = level.value - value;
  return `${quantity(Math.abs(by), unit === "°C" ? "K" : unit, 1)} ${by < 0 ? "above" : "below"}`;
}

export function marginWords(level, figures, unit) {
  // What a chart says of one limit: its value, and how far each of its figures [[name, value]] lies from it.
  const found = figures.filter(([name]) => level.of.includes(name)).map(([name, value]) => [name, margin(level, value, unit)]).filter(([, words]) => words);
  return `${cited(level)} ${quantity(level.value, unit, 1)}${found.length ? `: ${found.map((each) => each.join(" ")).join(", ")}` : ""}`;
}

export function fitted(low, high, { least, floor = -Infinity, levels = [] }) {
  // The range of an axis that shows [low, high], at least so wide, and the limits that lie near; it ends at round figures.
  if (!(low <= high)) [low, high] = [Math.max(floor, 0), Math.max(floor, 0)];
  const lack = Math.max(0, least - (high - low)) / 2;
  [low, high] = [low - lack, high + lack];
  const near = (high - low) / 2;
  const shown = levels.filter((level) => level > low - near && level < high + near);
  [low, high] = [Math.min(low, ...shown), Math.max(high, ...shown)];
  const step = 10 ** Math.floor(Math.log10(high - low)) / 5;
  return [Math.max(floor, Math.floor(low / step - 0.25) * step), Math.ceil(high / step + 0.25) * step];
}

export function nearest(levels, values, station) {
  // The schematic's list: of each part of the station, how far it is to its limits.
  const words = (name, pairs) => [name, pairs.map(([level, value, unit]) => [margin(level, value, unit), level]).filter(([said]) => said).map(([said, level]) => `${said} ${cited(level)}`).join(", ")];
  const [heat, vehicleHeat] = levels.temperature;
  const lines = BUFFERS.map((buffer) => {
    const pressures = levels.buffers.filter((level) => level.of.includes(titled(buffer))).map((level) => [level, values[`pressure_${buffer}`], "bar"]);
    return words(titled(buffer), [...pressures, [heat, values[`temperature_${buffer}`], "°C"]]);
  });
  lines.push(words("Vehicle", [[levels.vehicle[0], values.pressure_vehicle, "bar"], [vehicleHeat, values.temperature_vehicle, "°C"]]));
  lines.push(words("Dispenser", [[levels.flow[0], values.flow_dispenser, "g/s"]]));
  const read = BUFFERS.filter((buffer) => Number.isFinite(values[`pressure_${buffer}`]));
  const gap = level("gap", station.dispenser.outlet_gap_min_bar, BUFFERS.map(titled));
  const gaps = read.map((buffer) => values[`pressure_${buffer}`] - values.pressure_vehicle - gap.value);
  if (values.pressure_vehicle !== null && values.pressure_vehicle !== undefined) {
    lines.push([titled(cited(gap)), read.map((buffer, place) => `${titled(buffer)} ${number(Math.abs(gaps[place]), 1)}\u202fbar ${gaps[place] < 0 ? "too small" : "to spare"}`).join(", ")]);
  }
  return lines.filter(([, said]) => said);
}
