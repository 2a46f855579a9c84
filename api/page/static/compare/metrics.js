// The figures of merit in words, and how their numbers are written.
import { number, words } from "../lib/format.js";

const WORDS = {
  t_avg: "mean wait", t_total: "sum of the waits", t_comp: "compressor time", t_comp_restored: "compressor time, buffers restored",
  t_dis: "dispensing time", energy: "energy, compressor to precooler 2 : 1", energy_kwh: "energy", wait_p50: "median wait",
  wait_p95: "wait of 95 % or less", wait_max: "longest wait", queue_max: "longest queue", queue_mean: "mean queue",
  compressor_starts: "compressor starts", delivered: "hydrogen delivered", pressure_high: "high buffer at the end",
  pressure_medium: "medium buffer at the end", pressure_low: "low buffer at the end", vehicles: "vehicles",
  vehicles_not_finished: "vehicles not finished", vehicles_incomplete: "vehicles that left incomplete", t_liveness: "time in which the liveness rule decided", refused_valves: "valves the shield kept closed", duration: "end of the run",
  energy_eur: "price of the energy", demand_eur: "charge on the peak", stock_eur: "missing stock bought back", total_eur: "cost of the run",
  eur_per_kg: "cost by hydrogen delivered", kwh_per_kg: "energy by hydrogen delivered", peak_kw: "highest mean power of a quarter of an hour", revenue_eur: "hydrogen sold",
};

export const FIRST = ["t_avg", "t_total", "t_comp_restored", "t_comp", "t_dis", "energy", "eur_per_kg", "peak_kw"]; // shown before anybody chooses

export const meaning = (name) => WORDS[name] ?? words(name);

export const bracket = (unit) => `[${unit}]`;

export function digits(values) {
  const most = Math.max(...values.filter(Number.isFinite).map(Math.abs), 0);
  return values.every((value) => !Number.isFinite(value) || Number.isInteger(value)) || most >= 100 ? 0 : most >= 10 ? 1 : 2;
}

const SHORT = new Set(["s", "kg", "bar", "kWh"]); // others stand in the heading alone

export const written = (value, unit, places) => number(value, places) + (SHORT.has(unit) && value !== null ? `\u202f${unit}` : "");
