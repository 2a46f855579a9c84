// What has happened to a twin, the newest first, in words; further back on demand, never more than a bounded list.
import { ask } from "../lib/api.js";
import { h, toast } from "../lib/dom.js";
import { clock, number, quantity, words } from "../lib/format.js";
import { equation, limitOf, speedWords, valveWords } from "./names.js";

const SHOWN = 150; // without going back
const MOST = 1000;
const PAGE = 200;
const PAGES = 10; // read at most for one click where valve changes are left out

const vehicle = ({ vehicle: number_ }) => `vehicle ${number_}`;
const listed = (names) => names.map(valveWords).join(", ");
const kept = (parts) => parts.filter(Boolean).join(" · ");
const certified = ({ service }) => service;

const TOLD = {
  started: (d) => kept([d.scenario, d.controller, speedWords(d.speed), certified(d)]),
  resumed: (d) => kept([`from ${clock(d.from_seq)}`, d.controller, `memory ${d.memory}`, certified(d)]),
  arrival: vehicle,
  fill_start: (d) => kept([vehicle(d), quantity(d.pressure_bar, "bar", 1)]),
  fill_end: (d) => kept([vehicle(d), `waited ${clock(d.waited_s)}`, `filled in ${clock(d.duration_s)}`, quantity(d.pressure_bar, "bar", 1), quantity(d.delivered_kg, "kg", 2)]),
  valve_change: (d) => kept([d.opened.length && `opened ${listed(d.opened)}`, d.closed.length && `closed ${listed(d.closed)}`]),
  shield_refusal: (d) => Object.entries(d.refused).map(([valve, name]) => `${valveWords(valve)}: ${limitOf(name) ? `${limitOf(name).title}, ${equation(limitOf(name))}` : words(name)}`).join(" · "),
  deadline_missed: (d) => `${d.decided} decided instead`,
  controller_changed: (d) => kept([d.controller, certified(d)]),
  speed_changed: (d) => speedWords(d.speed),
  vehicle_added: (d) => kept([vehicle(d), ...Object.entries(d).filter(([name]) => name !== "vehicle").map(([name, value]) => `${words(name)} ${figure(name, value)}`)]),
  finished: (d) => quantity(d.samples, "samples"),
  stopped: (d) => quantity(d.samples, "samples"),
};

const UNITS = { pressure: ["bar", 1], temperature: ["°C", 1], volume: ["m³", 3] };

function figure(name, value) {
  const [unit, digits] = UNITS[name.split("_").at(-1)] ?? ["", 1];
  return typeof value === "number" ? quantity(value, unit, digits) : String(value);
}

function detailsOf({ kind, details }) {
  try {
    if (TOLD[kind]) return TOLD[kind](details);
  } catch {
    // An event of a newer service: its figures as they are.
  }
  return Object.entries(details).map(([name, value]) => `${words(name)} ${typeof value === "number" ? number(value, 1) : JSON.stringify(value)}`).join(" · ");
}

export class Events {
  #known = []; // the newest first
  #drawn = new Map(); // event -> item
  #due = 0;
  #most = SHOWN;
  #told = -1; // number of the newest
  #epoch = -1; // and its epoch
  #read = Infinity; // number of the oldest that was read

  constructor(twin, signal) {
    this.twin = twin;
    this.signal = signal;
    this.valves = h("input", { type: "checkbox", checked: true, onchange: () => this.#choose() });
    this.list = h("ol", { class: "events", tabindex: "0", "aria-label": "Events, the newest first" });
    this.more = h("button", { type: "button", onclick: () => this.#back() }, "Earlier events");
    this.none = h("p", { class: "hint" }, "Nothing has happened yet.");
    this.element = h("section", { class: "card", "aria-label": "Events" }, h("div", { class: "head" }, h("h2", {}, "Events"), h("label", { class: "tick" }, this.valves, " valve changes")),
      this.none, this.list, h("div", { class: "actions" }, this.more));
    signal.addEventListener("abort", () => cancelAnimationFrame(this.#due));
  }

  restart() {
    this.#known = [];
    [this.#told, this.#epoch, this.#read, this.#most] = [-1, -1, Infinity, SHOWN];
    this.#draw();
  }

  #wanted(event) {
    return this.valves.checked || event.kind !== "valve_change";
  }

  add(events) {
    // Events in order; those known already are told again after a lost connection.
    const again = events.find((event) => event.seq <= this.#told && event.epoch > this.#epoch);
    if (again) {
      // Numbers of events that were lost with a killed service are given again.
      this.#told = again.seq - 1;
      this.#known = this.#known.filter((event) => event.seq < again.seq);
    }
    const news = events.filter((event) => event.seq > this.#told);
    if (!news.length) return;
    [this.#told, this.#epoch] = [news.at(-1).seq, news.at(-1).epoch];
    this.#read = Math.min(this.#read, news[0].seq);
    this.#keep([...news.filter((event) => this.#wanted(event)).reverse(), ...this.#known]);
  }

  #keep(events) {
    this.#known = events.slice(0, this.#most);
    if (events.length > this.#most) this.#read = this.#known.at(-1).seq; // what falls off can be read again
    this.#draw();
  }

  async #choose() {
    const told = this.#told;
    this.#known = [];
    [this.#read, this.#most] = [told + 1, SHOWN];
    await this.#back();
  }

  async #back() {
    if (this.list.ariaBusy === "true") return;
    this.list.ariaBusy = "true";
    try {
      let found = 0;
      for (let page = 0; page < PAGES && this.#read > 0 && !found; page++) {
        const from = Math.max(0, this.#read - PAGE);
        const { items } = await ask(`/v1/twins/${this.twin}/events?after=${from - 1}&limit=${this.#read - from}`, { signal: this.signal });
        const before = items.filter((event) => event.seq < this.#read && this.#wanted(event)).reverse();
        this.#read = from;
        this.#most = Math.min(MOST, Math.max(this.#most, this.#known.length + before.length));
        this.#keep([...this.#known, ...before]);
        found += before.length;
      }
    } catch (error) {
      if (!this.signal.aborted) toast(error.message, "problem");
    } finally {
      this.#redraw();
      this.list.ariaBusy = "false";
    }
  }

  #draw() {
    this.#due ||= requestAnimationFrame(() => {
      this.#due = 0;
      this.#redraw();
    });
  }

  #redraw() {
    const drawn = new Map();
    const items = this.#known.map((event) => {
      const item = this.#drawn.get(event) ?? h("li", { class: event.kind, "data-seq": event.seq },
        h("time", {}, clock(event.time)), h("span", { class: "kind" }, words(event.kind)), h("span", { class: "details" }, detailsOf(event)));
      drawn.set(event, item);
      return item;
    });
    for (const [event, item] of this.#drawn) if (!drawn.has(event)) item.remove();
    // The newest come first; what stands already stays where it is.
    let before = this.list.firstChild;
    for (const item of items) {
      if (item === before) before = before.nextSibling;
      else this.list.insertBefore(item, before);
    }
    this.#drawn = drawn;
    this.none.hidden = items.length > 0;
    this.list.hidden = items.length === 0;
    this.more.hidden = this.#read === 0 || this.#told < 0 || this.#known.length >= MOST;
  }
}
