// Figures of the window that the series show, whole or by hour, shift or day; as files, and as a report to be printed.
import { ask, download } from "../lib/api.js";
import { h, set, table, toast } from "../lib/dom.js";
import { clock, number, quantity } from "../lib/format.js";

const RESTS = 600; // the window is asked about when it has not moved for so long [ms]
const AGAIN = 10_000; // and again while it follows the live end [ms]
const CUTS = [["window", "the whole window"], ["hour", "hour"], ["shift", "shift"], ["day", "day"]];

const some = (value, unit, digits = 0, by = 1) => (value === null ? "–" : unit ? quantity(by * value, unit, digits) : number(by * value, digits));

// Name, figure, unit, decimals, and by what the figure is multiplied.
const ALWAYS = [
  ["served", "vehicles_served"], ["connected", "vehicles_connected"], ["left incomplete", "vehicles_incomplete"], ["mean wait", "wait_mean_s", "s"], ["wait p95", "wait_p95_s", "s"],
  ["state of charge", "state_of_charge_mean", "%", 1, 100], ["dispensed", "delivered_kg", "kg", 1], ["energy", "energy_kwh", "kWh", 1],
  ["compressor", "compressor_kwh", "kWh", 1], ["precooler", "precooler_kwh", "kWh", 1], ["a kilogram", "kwh_per_kg", "kWh/kg", 2],
  ["compressor starts", "compressor_starts"], ["compressor hours", "compressor_s", "h", 2, 1 / 3600], ["use of the dispenser", "utilisation", "%", 1, 100], ["availability", "availability", "%", 2, 100],
];
const MONEY = [
  ["cost", "total_eur", "EUR", 2], ["cost of a kilogram", "eur_per_kg", "EUR/kg", 3], ["revenue", "revenue_eur", "EUR", 2], ["margin", "margin_eur", "EUR", 2], ["peak of a quarter", "peak_kw", "kW", 1],
];

export function shownOf(items) {
  // Money stands where the station has a tariff, and what nothing tells of any window is left out.
  return [...ALWAYS, ...MONEY].filter(([, name]) => items.some((each) => each[name] !== null));
}

export function gapWords(items) {
  // What is said where not every second is kept.
  const missing = items.reduce((sum, each) => sum + each.to_s - each.from_s - each.whole_s, 0);
  const unread = items.reduce((sum, each) => sum + each.unread_s, 0);
  return [missing && `${quantity(missing, "s")} of it are kept as minutes, or no more: what these do not tell is left out.`, unread && `In ${quantity(unread, "s")} a reading was missing, and the one before was taken.`].filter(Boolean).join(" ");
}

export class Figures {
  #asked = "";
  #busy = false;
  kept = 0; // seconds before it were found to be gone

  constructor(path, span, first, signal) {
    this.path = path;
    this.first = first; // second of the record: a replay's begins later than its twin's
    this.span = span;
    this.signal = signal;
    this.by = h("select", { name: "by", "aria-label": "Figures by", onchange: () => this.#renew() }, CUTS.map(([value, text]) => h("option", { value }, text)));
    this.about = h("p", { class: "hint" });
    this.found = h("div", { class: "window-found" });
    const save = (text, format) => h("button", { type: "button", class: "plain", onclick: () => this.#save(`figures?${this.#query(this.by.value, this.kept)}&format=${format}`, format) }, text);
    this.element = h("section", { class: "card window-figures", "aria-label": "Figures of the window shown" },
      h("div", { class: "head" }, h("h2", {}, "Figures of the window shown"), this.by), this.found, this.about,
      h("div", { class: "actions" }, save("CSV", "csv"), save("Parquet", "parquet"),
        h("button", { type: "button", class: "plain", onclick: () => this.#save(`report?${this.#query(this.by.value === "window" ? "shift" : this.by.value, this.kept)}`, "html") }, "Report of the window shown")));
    span.addEventListener("change", () => this.#rest());
    signal.addEventListener("abort", () => clearTimeout(this.timer));
  }

  #window() {
    // Whole seconds of what there is, the end left out at the live end: the service knows the newest. Null where there is none.
    const [from, to, end] = [Math.max(this.first, Math.floor(this.span.from)), Math.ceil(this.span.to), Math.floor(this.span.end)];
    if (from >= Math.min(to, end)) return null;
    return { from, to: Math.min(to, end), until: this.span.follow || to >= end ? "" : `&to_s=${to}` };
  }

  #query(cut = this.by.value, kept = 0) {
    const { from, until } = this.#window() ?? { from: this.first, until: "" };
    return `from_s=${Math.max(from, kept)}${until}&by=${cut}`;
  }

  #rest() {
    // Once the window rests; what follows the live end is asked about again and again.
    if (this.timer && this.span.follow && this.#asked) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.#renew(), this.span.follow && this.#asked ? AGAIN : RESTS);
  }

  async #renew() {
    clearTimeout(this.timer);
    this.timer = 0;
    if (this.#busy || this.signal.aborted) return;
    const [query, shown] = [this.#query(), this.#window()];
    const asked = `${query} ${shown?.to}`;
    if (!shown || asked === this.#asked || document.hidden) return;
    this.#busy = true;
    try {
      await this.#answer(query, shown);
    } catch (error) {
      if (this.signal.aborted) return;
      this.found.replaceChildren();
      set(this.about, error.message);
    } finally {
      this.#busy = false;
    }
    this.#asked = asked;
    if (query !== this.#query()) this.#rest();
  }

  async #answer(query, shown) {
    // The figures of the window; of one that begins before what is kept, those of what is kept, and since when.
    const look = async (asked) => this.#told(await ask(`${this.path}/figures?${asked}`, { signal: this.signal }));
    try {
      this.#draw(await look(query));
    } catch (error) {
      if (!error.fields?.has("from_s")) throw error;
      const begin = await this.#keptFrom(look, query);
      const kept = begin === null ? "Seconds this old are no longer kept" : `Nothing before ${clock(begin)} is kept`;
      if (begin !== null && begin < shown.to) {
        this.kept = begin;
        this.#draw(await look(query.replace(/from_s=\d+/, `from_s=${begin}`)), `${kept}: of the window shown these are the figures from then on.`);
      } else {
        this.found.replaceChildren();
        set(this.about, `${kept}: there are no figures of the window shown.`);
      }
    }
  }

  #told(answer) {
    // The windows of an answer, which says how long the station's shifts are, too.
    set(this.by.querySelector("[value=shift]"), `shift of ${answer.shift_h} h`);
    return answer.items;
  }

  async #keptFrom(look, query) {
    // The first second that figures can be had of, or null: bounds that are left out are those of the record.
    const whole = "by=window";
    for (const asked of [`${/to_s=\d+/.exec(query)?.[0] ?? ""}&${whole}`, whole]) {
      try {
        return (await look(asked))[0].from_s;
      } catch (error) {
        if (!error.fields) throw error;
      }
    }
    return null;
  }

  #draw(items, before = "") {
    const shown = shownOf(items);
    const write = (each, [, name, unit, digits, by]) => some(each[name], unit, digits, by);
    set(this.about, [`${clock(items[0].from_s)} to ${clock(items.at(-1).to_s)}.`, gapWords(items), before].filter(Boolean).join(" "));
    if (this.by.value === "window") {
      const [only] = items;
      this.found.replaceChildren(h("dl", {}, shown.map((each) => h("div", {}, h("dt", {}, each[0]), h("dd", { "data-figure": each[1] }, write(only, each))))));
    } else {
      this.found.replaceChildren(table(`Figures by ${this.by.value}`, ["from", ...shown.map(([name]) => name)], items.map((each) => [clock(each.from_s), ...shown.map((figure) => write(each, figure))])));
    }
  }

  async #save(what, ending) {
    const { from: begin, to } = this.#window() ?? { from: this.first, to: this.first };
    const from = Math.max(begin, this.kept);
    const twin = this.path.split("/").at(-1);
    await download(`${this.path}/${what}`, `${twin}-${from}-${to}.${ending}`).catch((error) => toast(error.message, "problem"));
  }
}
