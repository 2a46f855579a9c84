// Figures of a twin by day: the running one, and a table of those before it.
import { ask } from "../lib/api.js";
import { h, table } from "../lib/dom.js";
import { clock, number, quantity } from "../lib/format.js";
import { limitOf } from "./names.js";

const AGAIN = 5000; // between two looks [ms]

const seconds = (value) => (value === null ? "–" : quantity(value, "s"));
const energy = (value) => (value === null ? "–" : quantity(value, "kWh", 1));
const perKilogram = ({ energy_kwh: spent, delivered_kg: given }) => (spent === null || !given ? "–" : quantity(spent / given, "kWh/kg", 2));

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
    const past = items.filter((day) => day !== running).reverse();
    this.today.replaceChildren(...(running ? [
      h("h3", {}, `Day ${running.day} so far`, h("span", { class: "unit" }, ` ${span(running)}`)),
      h("dl", {}, FIGURES.map(([name, write]) => h("div", {}, h("dt", {}, name), h("dd", {}, write(running))))),
      h("p", {}, h("b", {}, "Refused by "), limits(running)),
    ] : [h("p", { class: "hint" }, items.length ? "The next day has not begun." : "Nothing was simulated yet.")]));
    this.past.replaceChildren(...(past.length ? [table("Past days, the newest first", ["day", ...FIGURES.map(([name]) => name), "refused by"],
      past.map((day) => [h("span", { title: span(day) }, number(day.day)), ...FIGURES.map(([, write]) => write(day)), limits(day)]), { numeric: (column) => column <= FIGURES.length, wide: FIGURES.length + 1 })] : []));
  }
}
