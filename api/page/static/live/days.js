// Figures of a twin by day: the running one, and a table of those before it.
import { ask } from "../lib/api.js";
import { h, table } from "../lib/dom.js";
import { clock, number, quantity } from "../lib/format.js";
import { limitOf } from "./names.js";

const AGAIN = 5000; // between two looks [ms]

const seconds = (value) => (value === null ? "–" : quantity(value, "s"));
const energy = (value) => (value === null ? "–" : quantity(value, "kWh", 1));
const perKilogram = ({ energy_kwh: spent, delivered_kg: given }) => (spent === null || !given ? "–" : quantity(spent / given, "kWh/kg", 2));

const euros = (value, unit = "EUR", digits = 2) => (value === null ? "–" : quantity(value, unit, digits));

const MONEY = [
  ["energy cost", (day) => euros(day.energy_eur)],
  ["demand charge", (day) => euros(day.demand_eur)],
  ["stock to restore", (day) => euros(day.stock_eur)],
  ["cost", (day) => euros(day.total_eur)],
  ["cost of a kilogram", (day) => euros(day.eur_per_kg, "EUR/kg", 3)],
  ["peak of a quarter", (day) => euros(day.peak_kw, "kW", 1)],
];

const FIGURES = [
  ["served", (day) => number(day.vehicles_served)],
  ["left incomplete", (day) => number(day.vehicles_incomplete)],
  ["waiting", (day) => number(day.vehicles_waiting)],
  ["mean wait", (day) => seconds(day.wait_mean_s)],
  ["wait p95", (day) => seconds(day.wait_p95_s)],
  ["longest wait", (day) => seconds(day.wait_max_s)],
  ["dispensed", (day) => quantity(day.delivered_kg, "kg", 1)],
  ["energy", (day) => energy(day.energy_kwh)],
  ["a kilogram", perKilogram],
  ["compressor starts", (day) => number(day.compressor_starts)],
  ["refusals", (day) => number(day.refused_valves)],
  ["deadlines missed", (day) => number(day.deadlines_missed)],
];

function figuresOf(items) {
  // Money stands where the station has a tariff.
  const billed = items.some((day) => day.energy_eur !== null);
  const at = FIGURES.findIndex(([name]) => name === "compressor starts");
  return billed ? [...FIGURES.slice(0, at), ...MONEY, ...FIGURES.slice(at)] : FIGURES;
}

function limits({ refused }) {
  // What the shield refused, the most frequent limit first.
  const found = Object.entries(refused).filter(([, count]) => count).sort(([, one], [, other]) => other - one);
  return found.length ? found.map(([name, count]) => `${limitOf(name)?.title ?? name} ${number(count)}`).join(", ") : "none";
}

const span = ({ from_s: from, to_s: to }) => `${clock(from)} to ${clock(to)}`;

export class Days {
  #said = "";

  constructor(path, signal) {
    this.path = path;
    this.signal = signal;
    this.today = h("div", { class: "today" });
    this.past = h("div", { class: "past" });
    this.element = h("section", { class: "card days", "aria-labelledby": "days-title" },
      h("h2", { id: "days-title" }, "By day"), this.today, this.past,
      h("p", { class: "hint" }, "A day is 86\u202f400 simulated seconds, counted from the twin's start. Waits are of the vehicles that were connected in it; refusals are valves that a limit kept closed, summed over the seconds."));
    signal.addEventListener("abort", () => clearTimeout(this.timer));
    this.#follow();
  }

  async #follow() {
    if (!document.hidden) await this.#renew().catch(() => {});
    if (!this.signal.aborted) this.timer = setTimeout(() => this.#follow(), AGAIN);
  }

  async #renew() {
    const found = await ask(`${this.path}/days`, { signal: this.signal });
    const said = JSON.stringify(found);
    if (said === this.#said) return; // a twin that rests
    this.#said = said;
    this.#show(found);
  }

  #show({ day_s: length, items }) {
    const last = items.at(-1);
    const running = last && last.to_s % length ? last : null;
    const figures = figuresOf(items);
    const past = items.filter((day) => day !== running).reverse();
    this.today.replaceChildren(...(running ? [
      h("h3", {}, `Day ${running.day} so far`, h("span", { class: "unit" }, ` ${span(running)}`)),
      h("dl", {}, figures.map(([name, write]) => h("div", {}, h("dt", {}, name), h("dd", {}, write(running))))),
      h("p", {}, h("b", {}, "Refused by "), limits(running)),
    ] : [h("p", { class: "hint" }, items.length ? "The next day has not begun." : "Nothing was simulated yet.")]));
    this.past.replaceChildren(...(past.length ? [table("Past days, the newest first", ["day", ...figures.map(([name]) => name), "refused by"],
      past.map((day) => [h("span", { title: span(day) }, number(day.day)), ...figures.map(([, write]) => write(day)), limits(day)]), { numeric: (column) => column <= figures.length, wide: figures.length + 1 })] : []));
  }
}
