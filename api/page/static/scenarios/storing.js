// Storing what the editor holds: as it was read, so that nobody's change is lost, neither ours nor another's.
import { Problem } from "../lib/api.js";
import { complain, h, toast } from "../lib/dom.js";
import { read, remove, store } from "./own.js";

const CHANGED = 412;

export class Storing {
  constructor(editor, { stored, removed }) {
    Object.assign(this, { editor, stored, removed }); // hear of a name that was stored, or deleted
    this.save = h("button", { type: "button", class: "primary", "data-needs-valid": true, disabled: true, onclick: () => this.#store() }, "Store");
    this.forget = h("button", { type: "button", class: "danger", hidden: true, onclick: () => this.#remove() }, "Delete");
    this.discard = h("button", { type: "button", hidden: true, onclick: () => editor.discard() }, "Discard changes");
    this.state = h("p", { class: "hint", role: "status" });
    this.conflict = h("div", { role: "alert" });
    this.element = h("section", { class: "card storing", "aria-label": "Store" },
      h("div", { class: "head" }, this.state, this.discard, this.forget, this.save), this.conflict);
    editor.addEventListener("edit", () => this.show());
  }

  begin(base) {
    // What is edited: { name, tag } of a stored scenario, or null.
    this.base = base;
    this.conflict.replaceChildren();
    this.show();
  }

  show() {
    const { unsaved, room } = this.editor;
    this.forget.hidden = !this.base;
    this.discard.hidden = !unsaved;
    const lost = room ? "; they outlast a reload" : ": too much to outlast a reload";
    const text = unsaved ? `Changes that are not stored${lost}.` : this.base ? `Stored as ${this.base.name}.` : "As it ships, or as opened.";
    if (this.state.textContent !== text) this.state.textContent = text;
  }

  async #store(tag = this.#tag()) {
    const scenario = this.editor.entered;
    this.save.disabled = true;
    await this.editor.check(); // now, or what is refused below would be taken back by a check that is due
    try {
      const now = await store(scenario, tag);
      this.editor.settled(scenario);
      this.begin({ name: scenario.name, tag: now });
      this.stored(scenario);
      toast(`${scenario.name} is stored`);
    } catch (error) {
      if (error.status === CHANGED) await this.#conflict(scenario.name, tag);
      else this.#refused(error);
    } finally {
      this.save.disabled = false;
    }
  }

  #tag() {
    return this.base?.name === this.editor.entered.name ? this.base.tag : null;
  }

  async #conflict(name, tag) {
    // Ours stays in the form; theirs stays in the service until the user decides.
    const theirs = await read(name).catch((error) => (error.status === 404 ? null : Promise.reject(error)));
    const again = (text, known) => h("button", { type: "button", onclick: () => this.#store(known) }, text);
    const told = !theirs ? `${name} was deleted in the meantime.` : tag ? `${name} was changed in the meantime by somebody else.` : `There is a scenario called ${name} already.`;
    this.conflict.replaceChildren(h("div", { class: "problem" },
      h("p", {}, `${told} Nothing is lost: yours is in the form, ${theirs ? "theirs in the service" : "and can be stored anew"}. ${theirs ? "Give yours another name, or choose:" : ""}`),
      h("div", { class: "actions" },
        theirs ? again("Replace theirs by mine", theirs.tag) : again("Store it anew", null),
        theirs && h("button", { type: "button", onclick: () => this.#take(theirs) }, "Take theirs, drop mine"))));
  }

  #take({ scenario, tag }) {
    this.editor.load(scenario);
    this.begin({ name: scenario.name, tag });
  }

  #refused(error) {
    const fields = error instanceof Problem ? [...error.fields] : [];
    const rest = this.editor.fields.complain(fields).map((pair) => pair.filter(Boolean).join(": "));
    if (error.status === 409) complain(this.editor.fields.control("name"), error.message); // it ships
    else if (!fields.length) rest.push(error.message);
    this.conflict.replaceChildren(...(rest.length ? [h("p", { class: "problem" }, rest.join("; "))] : []));
  }

  async #remove() {
    const { name, tag } = this.base;
    try {
      if (await remove(name, tag)) this.removed(name);
    } catch (error) {
      if (error.status === CHANGED) await this.#conflict(name, tag);
      else this.#refused(error);
    }
  }
}
