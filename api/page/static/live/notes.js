// Notes of people on a twin's time: a form, a list, and marks on the panels of the series.
import { ask, post } from "../lib/api.js";
import { confirmed } from "../lib/confirm.js";
import { field, h, toast } from "../lib/dom.js";
import { clock, number } from "../lib/format.js";
import { decimal, submit } from "./forms.js";

const AGAIN = 15_000; // between two looks at what others wrote [ms]

export class Notes {
  #said = "";

  constructor(path, series, signal) {
    this.path = `${path}/notes`;
    this.series = series;
    this.signal = signal;
    const input = (name, more) => h("input", { type: "text", autocomplete: "off", name, ...more });
    const controls = { text: input("text", { maxlength: "500", required: true }), time_s: input("time_s", { inputmode: "decimal" }), to_s: input("to_s", { inputmode: "decimal" }) };
    this.controls = controls;
    this.form = h("form", { class: "note-form", name: "note", novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      submit(this.form, controls, () => this.#add());
    } },
      field("Note", controls.text, { hint: "one line" }),
      h("div", { class: "fields" }, field("At", controls.time_s, { unit: "s", hint: "left empty: the end of the window shown" }), field("To", controls.to_s, { unit: "s", hint: "left empty: a moment" })),
      h("div", { class: "actions" }, h("button", { type: "button", class: "plain", onclick: () => this.#shown() }, "On the window shown"), h("button", {}, "Note")));
    this.list = h("ol", { class: "note-list", "aria-label": "Notes" });
    this.none = h("p", { class: "hint" }, "Nobody has noted anything.");
    this.element = h("section", { class: "card notes", "aria-label": "Notes" }, h("h2", {}, "Notes"), this.none, this.list, this.form);
    this.timer = setInterval(() => !document.hidden && this.renew(), AGAIN);
    signal.addEventListener("abort", () => clearInterval(this.timer));
    this.renew();
  }

  #shown() {
    const { from, to } = this.series.span;
    this.controls.time_s.value = Math.max(0, Math.floor(from));
    this.controls.to_s.value = Math.ceil(to);
  }

  async #add() {
    const { text, time_s: at, to_s: until } = this.controls;
    const { to, end } = this.series.span;
    await post(this.path, { text: text.value.trim(), time_s: decimal(at.value) ?? Math.max(0, Math.floor(Math.min(to, end))), to_s: decimal(until.value) ?? null });
    for (const each of Object.values(this.controls)) each.value = "";
    await this.renew();
  }

  async renew() {
    const found = await ask(this.path, { signal: this.signal }).catch(() => null);
    if (!found || this.signal.aborted) return;
    const said = JSON.stringify(found.items);
    if (said === this.#said) return;
    this.#said = said;
    this.series.notes = found.items.map((each, place) => ({ ...each, number: place + 1 }));
    this.series.again();
    this.none.hidden = found.items.length > 0;
    this.list.replaceChildren(...this.series.notes.map((each) => this.#item(each)));
  }

  #item(note) {
    const when = `${clock(note.time_s)}${note.to_s === null ? "" : ` to ${clock(note.to_s)}`}`;
    const look = () => this.series.span.place(note.time_s - 300, (note.to_s ?? note.time_s) + 300);
    return h("li", { "data-note": note.id },
      h("b", { class: "note-number" }, number(note.number)),
      h("div", {}, h("p", { class: "note-text" }, note.text), h("p", { class: "hint" }, `${when} · ${note.by}`)),
      h("div", { class: "actions" },
        h("button", { type: "button", class: "plain", "aria-label": `Show: ${note.text}`, onclick: look }, "Show"),
        h("button", { type: "button", class: "plain", "aria-label": `Delete: ${note.text}`, onclick: () => this.#remove(note) }, "Delete")));
  }

  async #remove(note) {
    if (!(await confirmed("Delete this note?", note.text, "Delete it"))) return;
    await ask(`${this.path}/${note.id}`, { method: "DELETE" }).catch((error) => toast(error.message, "problem"));
    await this.renew();
  }
}
