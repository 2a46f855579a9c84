// The alarms of a twin: what is wrong, since when, what follows from it and what to do; acknowledged and put aside here.
import { ask, post } from "../lib/api.js";
import { field, h, set, toast } from "../lib/dom.js";
import { clock, number, quantity, words } from "../lib/format.js";
import { speak } from "../lib/speak.js";
import { unitWords } from "./followed_words.js";

const SOON = 150; // events that come together are asked about once [ms]
const SHELVES = [["3600", "1 h"], ["28800", "8 h"], ["86400", "24 h"], ["604800", "7 days"], ["", "until it is put back (out of service)"]];
const SHOWN = new Set(["unacknowledged", "acknowledged", "returned_unacknowledged"]);

export const stateWords = (state) => ({ returned_unacknowledged: "over, not acknowledged", suppressed_by_design: "follows from another" })[state] ?? words(state);

const figure = (value, unit) => (value === null ? "–" : unit === "1" ? number(value, 0) : quantity(value, unitWords(unit), unit === "s" ? 0 : 1));

export function alarmWords({ title, priority, state, by, reason }) {
  // A change of an alarm as an event tells it.
  return [`${title} (${priority})`, stateWords(state), by && `by ${by}`, reason].filter(Boolean).join(" · ");
}

export const countWords = (counts) => (counts?.announced ? `${counts.announced} alarm${counts.announced === 1 ? "" : "s"}` : "");

export function inTitle(unacknowledged) {
  // The count stands in the title of the page, which a browser shows while another page is looked at.
  document.title = `${unacknowledged ? `(${unacknowledged}) ` : ""}${document.title.replace(/^\(\d+\) /, "")}`;
}

async function askAside(alarm) {
  // For how long an alarm is put aside, and why; null where it is not.
  const select = h("select", { name: "for" }, SHELVES.map(([value, text]) => h("option", { value }, text)));
  const why = h("input", { name: "reason", required: true, maxlength: "200", autocomplete: "off" });
  const heading = h("h2", { id: "aside-title" }, `Put aside: ${alarm.title}`);
  const dialog = h("dialog", { "aria-labelledby": heading.id },
    h("form", { method: "dialog" }, heading, field("For", select), field("Reason", why, { hint: "stands in the events" }),
      h("div", { class: "actions" }, h("button", { value: "", formnovalidate: true }, "Cancel"), h("button", { value: "yes", class: "primary" }, "Put aside"))));
  document.body.append(dialog);
  dialog.showModal();
  await new Promise((done) => dialog.addEventListener("close", done, { once: true }));
  dialog.remove();
  if (dialog.returnValue !== "yes") return null;
  const reason = why.value.trim();
  return select.value ? { action: "shelve", for_s: Number(select.value), reason } : { action: "out_of_service", reason };
}

export class Alarms {
  #timer = 0;
  #said = "";

  constructor(path, signal) {
    this.path = `${path}/alarms`;
    this.signal = signal;
    this.list = h("ol", { class: "alarm-list", "aria-label": "Alarms, the most urgent first" });
    this.none = h("p", { class: "hint" }, "Nothing to act on.");
    this.figures = h("p", { class: "hint" });
    this.element = h("section", { class: "card alarms", "aria-label": "Alarms" }, h("h2", {}, "Alarms"), this.none, this.list, this.figures);
    signal.addEventListener("abort", () => clearTimeout(this.#timer));
  }

  show(alive) {
    // Those of a twin that has ended stand in its events alone.
    this.element.hidden = !alive;
    if (alive) this.renew();
    else inTitle(0);
  }

  renew() {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(async () => {
      const found = await ask(this.path, { signal: this.signal }).catch(() => null);
      if (found?.figures && !this.signal.aborted) this.#draw(found);
    }, SOON);
  }

  #draw({ items, figures }) {
    inTitle(figures.unacknowledged);
    this.none.hidden = items.some(({ state }) => SHOWN.has(state));
    const often = figures.frequent.slice(0, 3).map(({ name, begun }) => `${words(name)} ${begun}`).join(", ");
    const trouble = [figures.flooded && `a flood: ${figures.most_in_ten_minutes} within ten minutes`, figures.standing.length && `standing for a day: ${figures.standing.map(words).join(", ")}`, figures.chattering.length && `chattering: ${figures.chattering.map(words).join(", ")}`];
    set(this.figures, [`${number(figures.begun)} announced in ${clock(figures.duration_s)}, ${number(figures.per_hour, 2)} an hour`, often && `most often ${often}`, ...trouble].filter(Boolean).join(" · "));
    const said = JSON.stringify(items);
    if (said === this.#said) return;
    this.#said = said;
    const focused = document.activeElement?.dataset.of;
    this.list.replaceChildren(...items.map((alarm) => this.#item(alarm)));
    if (focused) this.list.querySelector(`[data-of="${CSS.escape(focused)}"]`)?.focus();
    const first = items.find(({ state }) => state === "unacknowledged");
    if (first) speak(`Alarm: ${first.title}`);
  }

  #item(alarm) {
    const shown = SHOWN.has(alarm.state);
    const button = (text, action, verb) => h("button", { type: "button", "data-of": `${alarm.name} ${verb}`, "aria-label": `${text}: ${alarm.title}`, onclick: () => this.#act(alarm, action) }, text);
    const buttons = [
      (alarm.state === "unacknowledged" || alarm.state === "returned_unacknowledged") && button("Acknowledge", async () => ({ action: "acknowledge", raised_s: alarm.raised_s }), "ack"),
      shown && button("Put aside …", () => askAside(alarm), "aside"),
      alarm.state === "shelved" && button("Take back", async () => ({ action: "unshelve" }), "back"),
      alarm.state === "out_of_service" && button("Put back", async () => ({ action: "in_service" }), "back"),
    ];
    const since = alarm.raised_s !== null && `since ${clock(alarm.raised_s)}${alarm.ended_s !== null ? ` to ${clock(alarm.ended_s)}` : ""}`;
    const measured = alarm.raised_s !== null && `${words(alarm.signal)} ${figure(alarm.value, alarm.unit)}, limit ${alarm.side} ${figure(alarm.limit, alarm.unit)}`;
    const who = alarm.by && [`by ${alarm.by}`, alarm.reason, alarm.shelved_until_s !== null && `until ${clock(alarm.shelved_until_s)}`].filter(Boolean).join(", ");
    return h("li", { class: `alarm ${shown ? alarm.priority : "apart"}`, "data-name": alarm.name },
      h("div", { class: "head" }, h("h3", {}, alarm.title), h("span", { class: `tag priority ${alarm.priority}` }, alarm.priority), h("span", { class: "tag" }, stateWords(alarm.state))),
      h("p", { class: "alarm-facts" }, [since, measured, who].filter(Boolean).join(" · ")),
      shown && h("p", {}, `${alarm.consequence} ${alarm.action}`),
      h("div", { class: "actions" }, buttons));
  }

  async #act(alarm, action) {
    const body = await action();
    if (!body) return;
    try {
      await post(`${this.path}/${alarm.name}`, body);
    } catch (error) {
      toast(error.message, "problem");
    }
    this.renew();
  }
}
