// Drills: a fault is put into the simulated station, and it is seen how a twin that follows it finds it.
import { ask, listed, post } from "../lib/api.js";
import { field, h, table, toast } from "../lib/dom.js";
import { clock, number, quantity, words } from "../lib/format.js";
import { unitWords } from "./followed_words.js";
import { decimal, submit } from "./forms.js";
import { ALIVE, BUFFERS, TANKS, VALVES, valveWords } from "./names.js";

const AGAIN = 5000; // between two looks at what has been found [ms]

// What each kind of fault is given: the field of its size, its unit, and what is suggested, by the kind of the sensor
// where that differs.
const KINDS = [
  ...BUFFERS.map((buffer) => [`leak ${buffer}`, { kind: "leak", buffer }, "rate_g_per_s", "g/s", "1"]),
  ["compressor weak", { kind: "compressor_weak" }, "loss_percent", "%", "25"],
  ["compressor tripped", { kind: "compressor_tripped" }, null, "", ""],
  ["dispenser clogged", { kind: "dispenser_clogged" }, "loss_percent", "%", "25"],
  ["precooler weak", { kind: "precooler_weak" }, "warmer_k", "K", "5"],
  ["leak of the line", { kind: "line_leak" }, "rate_g_per_s", "g/s", "1"],
  ...BUFFERS.map((bank) => [`${valveWords(`outlet_${bank}`)} leaks while closed`, { kind: "outlet_leak", valve: `outlet_${bank}` }, "rate_g_per_s", "g/s", "2"]),
  ...VALVES.flatMap((valve) => ["closed", "open"].map((position) => [`${valveWords(valve)} stuck ${position}`, { kind: "valve_stuck", valve, position }, null, "", ""])),
  ["sensor offset", { kind: "sensor_offset" }, "offset_*", "*", { pressure: "10", temperature: "5", flow: "5" }],
  ["sensor drift", { kind: "sensor_drift" }, "drift_*_per_h", "*/h", "3"],
  ["sensor noisy", { kind: "sensor_noisy" }, "noise_*", "*", "4"],
  ["sensor frozen", { kind: "sensor_frozen" }, null, "", ""],
  ["sensor absent", { kind: "sensor_absent" }, null, "", ""],
  ["clock skew", { kind: "clock_skew" }, "skew_s", "s", "3"],
];

const SENSORS = [...["pressure", "temperature"].flatMap((kind) => TANKS.map((tank) => `${kind}_${tank}`)), "flow_compressor", "flow_dispenser"];

const ofSensor = ({ kind }) => kind.startsWith("sensor_");

// What stands for * in the field of a size, and in its unit, by the kind of the sensor.
const PARTS = { pressure: ["bar", "bar"], temperature: ["k", "K"], flow: ["g_per_s", "g/s"] };

const sized = (pattern, sensor, part) => pattern?.replace("*", PARTS[sensor.split("_")[0]][part]);

const suggested = (value, sensor) => (typeof value === "string" ? value : value[sensor.split("_")[0]]);

export function bodyOf(place, size, minutes, now, sensor = SENSORS[0]) {
  // The fault that begins with the twin's next second; without minutes it stays.
  const [, fault, pattern] = KINDS[place];
  const name = sized(pattern, sensor, 0);
  const begin = now + 2;
  return { ...fault, ...(ofSensor(fault) ? { sensor } : {}), ...(name ? { [name]: size } : {}), begin_s: begin, ...(minutes === undefined ? {} : { end_s: typeof minutes === "number" ? begin + 60 * minutes : minutes }) };
}

export class Drills {
  #timer = 0;
  #now = 0;
  #alive = true;

  constructor(path, signal) {
    this.path = path;
    this.signal = signal;
    const input = (name, value) => h("input", { type: "text", inputmode: "decimal", autocomplete: "off", name, value });
    const kind = h("select", { name: "kind", onchange: () => this.#suggest() }, KINDS.map(([text], place) => h("option", { value: place }, text)));
    this.kind = kind;
    this.size = input("size", KINDS[0][4]);
    const minutes = input("end_s", "30");
    this.sensor = h("select", { name: "sensor", onchange: () => (typeof KINDS[Number(this.kind.value)][4] === "string" ? this.#measure() : this.#suggest()) }, SENSORS.map((name) => h("option", { value: name }, words(name))));
    this.sensorField = field("Sensor", this.sensor);
    this.sensorField.hidden = true;
    const sizes = KINDS.filter(([, , pattern]) => pattern).flatMap(([, , pattern]) => SENSORS.map((sensor) => [sized(pattern, sensor, 0), this.size]));
    const controls = { kind, sensor: this.sensor, end_s: minutes, begin_s: kind, ...Object.fromEntries(sizes) };
    this.sizeField = field("Size", this.size, { hint: KINDS[0][3] });
    this.form = h("form", { class: "control forecast-form", name: "drill", novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      submit(this.form, controls, async () => {
        this.#draw(await post(`${path}/drills`, bodyOf(Number(kind.value), decimal(this.size.value), decimal(minutes.value), this.#now, this.sensor.value)));
      });
    } }, field("Fault", kind), this.sensorField, this.sizeField, field("For", minutes, { unit: "min", hint: "left out: until it is ended" }), h("button", {}, "Put in"));
    this.end = h("button", { type: "button", onclick: () => ask(`${path}/drills`, { method: "DELETE" }).then((found) => this.#draw(found), (error) => toast(error.message, "problem")) }, "Mend the station");
    this.by = h("select", { name: "followed_by", onchange: () => this.renew() }, h("option", { value: "" }, "nobody"));
    this.found = h("div", {});
    this.element = h("section", { class: "card drills", "aria-label": "Drills" }, h("h2", {}, "Drills"), this.form, h("div", { class: "actions" }, field("Scored by", this.by), this.end), this.found);
    signal.addEventListener("abort", () => clearTimeout(this.#timer));
    this.#followers();
  }

  #suggest() {
    const [, fault, name, , value] = KINDS[Number(this.kind.value)];
    this.size.value = suggested(value, this.sensor.value);
    this.size.disabled = !name;
    this.sensorField.hidden = !ofSensor(fault);
    this.#measure();
  }

  #measure() {
    const [, , , unit] = KINDS[Number(this.kind.value)];
    this.sizeField.querySelector(".hint").textContent = sized(unit, this.sensor.value, 1);
  }

  async #followers() {
    const twins = await listed("/v1/twins", { signal: this.signal }).catch(() => []);
    this.by.append(...twins.filter(({ source }) => source === "measured").map(({ id }) => h("option", { value: id }, id)));
    this.renew();
  }

  show(state) {
    this.#alive = ALIVE.has(state.state);
    this.#now = state.samples;
    for (const each of this.form.elements) each.disabled = !this.#alive;
    this.end.disabled = !this.#alive;
    if (this.#alive && !KINDS[Number(this.kind.value)][2]) this.size.disabled = true;
  }

  took(time) {
    this.#now = Math.max(this.#now, time + 1);
  }

  async renew() {
    clearTimeout(this.#timer);
    const found = await ask(`${this.path}/drills${this.by.value ? `?followed_by=${encodeURIComponent(this.by.value)}` : ""}`, { signal: this.signal }).catch(() => null);
    if (this.signal.aborted) return;
    if (found) this.#draw(found);
    if (this.#alive && this.by.value) this.#timer = setTimeout(() => this.renew(), AGAIN);
  }

  #draw({ items, followed_by: by, false_events: wrong }) {
    if (!items.length) return this.found.replaceChildren(h("p", { class: "hint" }, "Nothing is wrong with this plant: put a fault in and see who notices."));
    const size = (value, unit) => (value === null ? "–" : quantity(value, unitWords(unit), 2));
    const rows = items.map((each) => [
      words(each.event), clock(each.begin_s), each.end_s === null ? "for ever" : clock(each.end_s), size(each.size, each.unit),
      ...(by ? [each.found ? "found" : each.untold ? "cannot be told" : "not found", each.delay_s === null ? "–" : quantity(each.delay_s, "s"), each.size_error === null ? "–" : size(each.size_error, each.unit)] : []),
    ]);
    const headings = ["Fault", "From", "To", "Size", ...(by ? [`By ${by}`, "After", "Size wrong by"] : [])];
    const reasons = items.filter((each) => each.untold).map((each) => `${words(each.event)} cannot be told: ${each.untold}`);
    const untold = [...new Set(reasons)].map((reason) => h("p", { class: "hint" }, reason));
    this.found.replaceChildren(table("Faults that were put in", headings, rows), ...untold, ...(wrong.length ? [h("p", { class: "hint" }, `${number(wrong.length)} told that no fault explains: ${wrong.map(words).join(", ")}`)] : []));
  }
}
