// Drills: a fault is put into the simulated plant, and it is seen how a twin that follows it finds it.
import { ask, listed, post } from "../lib/api.js";
import { field, h, table, toast } from "../lib/dom.js";
import { clock, number, quantity, words } from "../lib/format.js";
import { unitWords } from "./followed_words.js";
import { decimal, submit } from "./forms.js";
import { ALIVE, BUFFERS } from "./names.js";

const AGAIN = 5000; // between two looks at what has been found [ms]

// What each kind of fault is given: the field of its size, its unit, and what is suggested.
const KINDS = [
  ...BUFFERS.map((buffer) => [`leak ${buffer}`, { kind: "leak", buffer }, "rate_g_per_s", "g/s", "1"]),
  ["compressor weak", { kind: "compressor_weak" }, "loss_percent", "%", "25"],
  ["compressor tripped", { kind: "compressor_tripped" }, null, "", ""],
  ["dispenser clogged", { kind: "dispenser_clogged" }, "loss_percent", "%", "25"],
  ["precooler weak", { kind: "precooler_weak" }, "warmer_k", "K", "5"],
];

export function bodyOf(place, size, minutes, now) {
  // The fault that begins with the twin's next second; without minutes it stays.
  const [, fault, name] = KINDS[place];
  const begin = now + 2;
  return { ...fault, ...(name ? { [name]: size } : {}), begin_s: begin, ...(minutes === undefined ? {} : { end_s: typeof minutes === "number" ? begin + 60 * minutes : minutes }) };
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
    const controls = { kind, end_s: minutes, begin_s: kind, rate_g_per_s: this.size, loss_percent: this.size, warmer_k: this.size };
    this.sizeField = field("Size", this.size, { hint: KINDS[0][3] });
    this.form = h("form", { class: "control forecast-form", name: "drill", novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      submit(this.form, controls, async () => {
        this.#draw(await post(`${path}/drills`, bodyOf(Number(kind.value), decimal(this.size.value), decimal(minutes.value), this.#now)));
      });
    } }, field("Fault", kind), this.sizeField, field("For", minutes, { unit: "min", hint: "left out: until it is ended" }), h("button", {}, "Put in"));
    this.end = h("button", { type: "button", onclick: () => ask(`${path}/drills`, { method: "DELETE" }).then((found) => this.#draw(found), (error) => toast(error.message, "problem")) }, "Mend the plant");
    this.by = h("select", { name: "followed_by", onchange: () => this.renew() }, h("option", { value: "" }, "nobody"));
    this.found = h("div", {});
    this.element = h("section", { class: "card drills", "aria-label": "Drills" }, h("h2", {}, "Drills"), this.form, h("div", { class: "actions" }, field("Scored by", this.by), this.end), this.found);
    signal.addEventListener("abort", () => clearTimeout(this.#timer));
    this.#followers();
  }

  #suggest() {
    const [, , name, unit, value] = KINDS[Number(this.kind.value)];
    this.size.value = value;
    this.size.disabled = !name;
    this.sizeField.querySelector(".hint").textContent = unit;
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
      ...(by ? [each.found ? "found" : "not found", each.delay_s === null ? "–" : quantity(each.delay_s, "s"), each.size_error === null ? "–" : size(each.size_error, each.unit)] : []),
    ]);
    const headings = ["Fault", "From", "To", "Size", ...(by ? [`By ${by}`, "After", "Size wrong by"] : [])];
    this.found.replaceChildren(table("Faults that were put in", headings, rows), ...(wrong.length ? [h("p", { class: "hint" }, `${number(wrong.length)} told that no fault explains: ${wrong.map(words).join(", ")}`)] : []));
  }
}
