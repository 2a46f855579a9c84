// A list that may be long: search, a filter with counts, pages. What it shows is in the address.
import { remember, remembered } from "./address.js";
import { h, set } from "./dom.js";
import { number } from "./format.js";

const FEW = 6; // so many need no search

export class List {
  // `line(item)` makes { element, show(item) } of an item, `text(item)` is what is searched, `kind(item)` what is filtered
  // by. Items have an `id`. `label` names the list, "twins"; `empty` is shown where there is none at all. Lines stand in
  // `list`, itself within `frame`; `order(items)` sorts those found.
  #items = [];
  #lines = new Map(); // id -> what `line` made
  #page = 0;

  constructor({ label, line, text, kind, each = 10, empty, className = "", list, frame, order = (items) => items }) {
    Object.assign(this, { label, line, text, kind, each, order });
    this.empty = empty;
    this.find = h("input", { type: "search", placeholder: `Search ${label}`, "aria-label": `Search ${label}`, value: remembered("find") ?? "", autocomplete: "off", spellcheck: "false", oninput: () => this.#turn(0) });
    this.filter = h("select", { "aria-label": `Show ${label}`, onchange: () => this.#turn(0) }, h("option", { value: "" }, "all"));
    this.wanted = remembered("show") ?? "";
    this.#page = Math.max(0, Number(remembered("page") ?? 1) - 1) || 0;
    const step = (text, name, by) => h("button", { type: "button", "aria-label": name, title: name, onclick: () => this.#turn(this.#page + by) }, text);
    [this.before, this.after] = [step("◀", "Previous page", -1), step("▶", "Next page", 1)];
    this.count = h("span", { class: "count" });
    this.head = h("div", { class: "list-head", role: "search", "aria-label": `Find ${label}` }, this.find, this.filter, h("div", { class: "pages" }, this.before, this.count, this.after));
    this.list = list ?? h("ul", { class: className, "aria-label": label });
    this.frame = frame ?? this.list;
    this.none = h("p", { class: "hint" });
    this.element = h("div", { class: "list" }, this.head, this.empty, this.none, this.frame);
  }

  show(items) {
    this.#items = items;
    const known = new Set(items.map(({ id }) => id));
    for (const id of this.#lines.keys()) if (!known.has(id)) this.#lines.delete(id);
    for (const item of items) this.#lines.get(item.id)?.show(item);
    this.#kinds();
    this.#draw();
  }

  again() {
    // The order has changed.
    this.#turn(0);
  }

  #turn(page) {
    this.#page = page;
    this.wanted = this.filter.value;
    this.#draw();
    remember({ find: this.find.value.trim(), show: this.wanted, page: this.#page ? String(this.#page + 1) : null });
  }

  #kinds() {
    const counts = new Map();
    for (const item of this.#items) counts.set(this.kind(item), (counts.get(this.kind(item)) ?? 0) + 1);
    if (this.wanted && !counts.has(this.wanted)) counts.set(this.wanted, 0);
    const options = [["", `all (${number(this.#items.length)})`], ...[...counts].sort().map(([kind, count]) => [kind, `${kind} (${number(count)})`])];
    const said = JSON.stringify(options);
    if (this.said === said) return;
    this.said = said;
    this.filter.replaceChildren(...options.map(([value, text]) => h("option", { value, selected: value === this.wanted }, text)));
  }

  #draw() {
    const words = this.find.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = this.order(this.#items.filter((item) => (!this.wanted || this.kind(item) === this.wanted) && words.every((word) => this.text(item).toLowerCase().includes(word))));
    const pages = Math.max(1, Math.ceil(found.length / this.each));
    this.#page = Math.min(Math.max(this.#page, 0), pages - 1);
    const first = this.#page * this.each;
    this.#put(found.slice(first, first + this.each));
    this.head.hidden = this.#items.length <= Math.min(FEW, this.each) && !words.length && !this.wanted;
    set(this.count, found.length ? `${number(first + 1)} to ${number(Math.min(first + this.each, found.length))} of ${number(found.length)}` : "none");
    this.before.disabled = this.#page === 0;
    this.after.disabled = this.#page === pages - 1;
    this.empty.hidden = this.#items.length > 0;
    this.frame.hidden = !found.length;
    this.none.hidden = found.length > 0 || !this.#items.length;
    set(this.none, `No ${this.label} among ${number(this.#items.length)} match this search.`);
  }

  #put(items) {
    // What stands already stays where it is, and keeps the focus.
    const wanted = items.map((item) => {
      if (!this.#lines.has(item.id)) this.#lines.set(item.id, this.line(item));
      return this.#lines.get(item.id).element;
    });
    for (const element of [...this.list.children]) if (!wanted.includes(element)) element.remove();
    wanted.forEach((element, place) => this.list.children[place] !== element && this.list.insertBefore(element, this.list.children[place] ?? null));
  }
}
