// What has happened to a twin, the newest first, in words; further back on demand, never more than a bounded list.
import { remember, remembered } from "../lib/address.js";
import { ask } from "../lib/api.js";
import { h, set, toast } from "../lib/dom.js";
import { clock, number, quantity, words } from "../lib/format.js";
import { alarmWords } from "./alarms.js";
import { unitWords } from "./followed_words.js";
import { equation, limitOf, speedWords, valveWords } from "./names.js";

const SHOWN = 150; // without going back
const MOST = 1000;
const PAGE = 200;
const PAGES = 10; // read at most for one click where some kinds are left out
const ENOUGH = 8; // so many more are looked for

const GROUP = { arrival: "vehicles", fill_start: "vehicles", fill_end: "vehicles", fill_incomplete: "vehicles", vehicle_added: "vehicles", shield_refusal: "limits", deadline_missed: "limits", valve_change: "valves", detected: "detected", measurements_refused: "detected", alarm: "alarms" };
const groupOf = ({ kind }) => GROUP[kind] ?? "operation";

// What may be shown: valve changes, many a minute, bury the rest and are left out at first.
const CHOICES = [["usual", "all but valve changes"], ["all", "all"], ["vehicles", "vehicles"], ["limits", "refusals and missed deadlines"], ["detected", "what measurements say"], ["alarms", "alarms"], ["operation", "operation"], ["valves", "valve changes"]];

const vehicle = ({ vehicle: number_ }) => `vehicle ${number_}`;
const listed = (names) => names.map(valveWords).join(", ");
const kept = (parts) => parts.filter(Boolean).join(" · ");
const certified = ({ service }) => service;

const TOLD = {
  started: (d) => d.of ? `plays ${clock(d.from_s)} to ${clock(d.to_s)} of ${d.of}` : kept([d.scenario, ...(d.controller ? [d.controller, speedWords(d.speed), certified(d)] : [d.station])]),
  resumed: (d) => kept([`from ${clock(d.from_seq)}`, ...(d.controller ? [d.controller, `memory ${d.memory}`, certified(d)] : [d.of ? `plays ${d.of}` : quantity(d.measurements, "batches")])]),
  detected: (d) => kept([words(d.name), d.size !== null && quantity(d.size, unitWords(d.unit), 2), d.settled === false && "size not settled yet"]),
  alarm: alarmWords,
  drill: (d) => d.event ? kept([words(d.event), `from ${clock(d.begin_s)}`, d.end_s !== null && `to ${clock(d.end_s)}`]) : `ended ${clock(d.ended_s)}`,
  station_changed: (d) => kept([`station ${d.station}`, d.calibration]),
  measurements_refused: (d) => kept([`batch ${number(d.number)}`, quantity(d.samples, "samples"), d.problem]),
  arrival: vehicle,
  fill_start: (d) => kept([vehicle(d), quantity(d.pressure_bar, "bar", 1)]),
  fill_incomplete: (d) => kept([vehicle(d), "left incomplete: nothing could be given any more", `${quantity(d.pressure_bar, "bar", 0)} of ${quantity(d.finish_pressure_bar, "bar", 0)}`, `state of charge ${number(100 * d.state_of_charge)} %`, quantity(d.delivered_kg, "kg", 2)]),
  fill_end: (d) => kept([vehicle(d), `waited ${clock(d.waited_s)}`, `filled in ${clock(d.duration_s)}`, quantity(d.pressure_bar, "bar", 1), quantity(d.delivered_kg, "kg", 2)]),
  valve_change: (d) => kept([d.opened.length && `opened ${listed(d.opened)}`, d.closed.length && `closed ${listed(d.closed)}`]),
  shield_refusal: (d) => Object.entries(d.refused).map(([valve, name]) => `${valveWords(valve)}: ${limitOf(name) ? `${limitOf(name).title}, ${equation(limitOf(name))}` : words(name)}`).join(" · "),
  deadline_missed: (d) => `${d.decided} decided instead`,
  controller_changed: (d) => kept([d.controller, certified(d)]),
  speed_changed: (d) => speedWords(d.speed),
  vehicle_added: (d) => kept([vehicle(d), ...Object.entries(d).filter(([name]) => name !== "vehicle").map(([name, value]) => `${words(name)} ${figure(name, value)}`)]),
  day_end: (d) => kept([`day ${d.day}`, `${number(d.vehicles_served)} served`, quantity(d.delivered_kg, "kg", 1), d.energy_kwh !== null && quantity(d.energy_kwh, "kWh", 1)]),
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
  #left = new Map(); // kind -> how many of those read are not shown
  #begun = false;
  #refused = false; // what lies further back could not be read: it is not asked for again unless somebody does
  #marked = null; // a time: the last that had happened by then is marked [s]
  #rested = 0; // where the list stood before
  #turn = 0; // counts what makes an answer on its way one of the past: another choice, another twin

  constructor(twin, signal) {
    this.twin = twin;
    this.signal = signal;
    this.choice = h("select", { "aria-label": "Events shown", onchange: () => this.#choose() }, CHOICES.map(([value, text]) => h("option", { value, selected: value === remembered("events") }, text)));
    this.left = h("p", { class: "hint" });
    this.list = h("ol", { class: "events", tabindex: "0", "aria-label": "Events, the newest first", "aria-busy": "true" });
    this.more = h("button", { type: "button", onclick: () => this.#back() }, "Earlier events");
    this.none = h("p", { class: "hint" }, "Nothing has happened yet.");
    this.element = h("section", { class: "card", "aria-label": "Events" }, h("div", { class: "head" }, h("h2", {}, "Events"), this.choice),
      this.left, this.none, this.list, h("div", { class: "actions" }, this.more));
    signal.addEventListener("abort", () => cancelAnimationFrame(this.#due));
  }

  restart() {
    this.#known = [];
    [this.#told, this.#epoch, this.#read, this.#most, this.#begun] = [-1, -1, Infinity, SHOWN, false];
    this.#left.clear();
    this.#turn++;
    this.list.ariaBusy = "true";
    this.#draw();
  }

  #wanted(events) {
    // Those that are shown; the others are counted.
    const { value } = this.choice;
    const shown = (event) => value === "all" || (value === "usual" ? groupOf(event) !== "valves" : groupOf(event) === value);
    for (const event of events) if (!shown(event)) this.#left.set(event.kind, (this.#left.get(event.kind) ?? 0) + 1);
    return events.filter(shown);
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
    this.#keep([...this.#wanted(news).reverse(), ...this.#known]);
    if (this.#begun) return;
    this.#begun = true;
    if (this.#known.length < ENOUGH) this.#back();
    else this.list.ariaBusy = "false";
  }

  async begin() {
    // All that the stream begins with is here: where that is nothing, older events are looked for.
    if (this.#begun) return;
    this.#begun = true;
    await this.#back();
  }

  #keep(events) {
    this.#known = events.slice(0, this.#most);
    if (events.length > this.#most) this.#read = this.#known.at(-1).seq; // what falls off can be read again
    this.#draw();
  }

  async #choose() {
    remember({ events: this.choice.value === "usual" ? null : this.choice.value });
    this.#known = [];
    this.#left.clear();
    if (!this.#begun) return; // what comes first is looked through then
    [this.#read, this.#most] = [this.#told + 1, SHOWN];
    await this.#back();
  }

  async #back() {
    const turn = ++this.#turn;
    this.list.ariaBusy = "true";
    this.#refused = false;
    try {
      let found = 0;
      for (let page = 0; page < PAGES && this.#read > 0 && found < ENOUGH; page++) {
        const below = Math.min(this.#read, Number.MAX_SAFE_INTEGER);
        const { items } = await ask(`/v1/twins/${this.twin}/events?before=${below}&limit=${PAGE}`, { signal: this.signal });
        if (turn !== this.#turn) return;
        const before = this.#wanted(items.filter((event) => event.seq < this.#read)).reverse();
        if (this.#told < 0 && items.length) [this.#told, this.#epoch] = [items.at(-1).seq, items.at(-1).epoch];
        this.#read = items[0]?.seq ?? 0; // numbers of old valve changes may be missing
        this.#most = Math.min(MOST, Math.max(this.#most, this.#known.length + before.length));
        this.#keep([...this.#known, ...before]);
        found += before.length;
      }
    } catch (error) {
      this.#refused = true;
      if (!this.signal.aborted) toast(error.message, "problem");
    } finally {
      if (turn === this.#turn) {
        this.list.ariaBusy = "false";
        this.#redraw();
      }
    }
  }

  mark(time) {
    // The newest that had happened at a time [s] stands out, and the list shows it; null takes the mark off.
    if (time === null && this.#marked === null) return;
    if (this.#marked === null) this.#rested = this.list.scrollTop;
    this.#marked = time;
    const last = time === null ? undefined : this.#known.find((event) => event.time <= time);
    for (const [event, item] of this.#drawn) {
      if (event === last) {
        item.setAttribute("aria-current", "time");
        this.list.scrollTop += item.getBoundingClientRect().top - this.list.getBoundingClientRect().top - this.list.clientHeight / 3;
      } else item.removeAttribute("aria-current");
    }
    if (time === null) this.list.scrollTop = this.#rested;
    else if (!last && !this.#refused && !this.more.hidden && this.list.ariaBusy === "false") this.#back(); // it lies further back
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
    if (this.#marked !== null) this.mark(this.#marked);
    const left = [...this.#left].map(([kind, count]) => `${number(count)} ${words(kind)}${count === 1 ? "" : "s"}`);
    set(this.left, left.length ? `Left out: ${left.join(", ")}.` : "");
    set(this.none, left.length ? "Nothing else has happened in what was looked at." : "Nothing has happened yet.");
    this.none.hidden = items.length > 0;
    this.list.hidden = items.length === 0;
    this.more.hidden = this.#read === 0 || this.#told < 0 || this.#known.length >= MOST;
  }
}
