// What the others would have done: controllers beside the one that acts, over stretches that are past.
import { ask } from "../lib/api.js";
import { field, h, set, table, toast } from "../lib/dom.js";
import { clock, number, quantity } from "../lib/format.js";
import { decimal, submit, suggested } from "./forms.js";
import { ALIVE } from "./names.js";

const AGAIN = 5000; // between two looks [ms]
const CONTROLLERS = ["minlp1, reserve", "logic, minlp1, switched"];
const FEW = 8; // stretches that are shown

const signed = (value, unit, digits = 0) => (value === null ? "–" : `${value > 0 ? "+" : ""}${quantity(value, unit, digits)}`);

const minutes = (control) => {
  const given = decimal(control.value);
  return typeof given === "number" ? Math.round(60 * given) : given;
};

export class Shadow {
  #said = "";

  constructor(path, signal) {
    this.path = `${path}/shadow`;
    this.signal = signal;
    const [controllers, list] = suggested(CONTROLLERS, { name: "controllers", value: CONTROLLERS[0] });
    const input = (name, value) => h("input", { type: "text", inputmode: "decimal", autocomplete: "off", name, value });
    const [every, length] = [input("every_s", "15"), input("horizon_s", "60")];
    const controls = { controllers, every_s: every, horizon_s: length };
    this.form = h("form", { class: "control forecast-form", name: "shadow", novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      submit(this.form, controls, async () => {
        const names = controllers.value.split(",").map((name) => name.trim()).filter(Boolean);
        this.#draw(await ask(this.path, { method: "PUT", body: { controllers: names, every_s: minutes(every), horizon_s: minutes(length) } }));
        toast(`held against the one that acts: ${names.join(", ")}`);
      });
    } }, field("Controllers", controllers, { hint: "separated by commas, at most five" }), list,
    field("A stretch every", every, { unit: "min" }), field("Its length", length, { unit: "min" }), h("button", {}, "Compare"));
    this.end = h("button", { type: "button", class: "plain", hidden: true, onclick: () => ask(this.path, { method: "DELETE" }).then((found) => this.#draw(found), (error) => toast(error.message, "problem")) }, "Compare no more");
    this.state = h("p", { class: "hint", role: "status" });
    this.found = h("div", {});
    this.element = h("section", { class: "card shadows", "aria-label": "What the others would have done" }, h("h2", {}, "What the others would have done"), this.form, this.state, this.end, this.found);
    signal.addEventListener("abort", () => clearTimeout(this.timer));
    this.#follow();
  }

  show(state) {
    const alive = ALIVE.has(state.state);
    for (const each of this.form.elements) each.disabled = !alive;
    this.end.disabled = !alive;
  }

  async #follow() {
    if (!document.hidden) {
      const found = await ask(`${this.path}?limit=${FEW}`, { signal: this.signal }).catch(() => null);
      if (found && !this.signal.aborted) this.#draw(found);
    }
    if (!this.signal.aborted) this.timer = setTimeout(() => this.#follow(), AGAIN);
  }

  #draw(found) {
    const { settings, lasting, left_out: left, days, stretches } = found;
    const compared = settings && `${settings.controllers.join(", ")}: a stretch of ${number(settings.horizon_s / 60)} min every ${number(settings.every_s / 60)} min; ${number(lasting)} not compared yet`;
    set(this.state, settings ? `${compared}${left ? `, ${number(left)} left out` : ""}.` : "Nobody is held against the controller that acts.");
    this.end.hidden = !settings;
    const said = JSON.stringify([days, stretches.slice(0, FEW)]);
    if (said === this.#said) return;
    this.#said = said;
    this.found.replaceChildren(...(days.length ? [...this.#days(days), this.#stretches(stretches.slice(0, FEW))] : []));
  }

  #days(days) {
    const rows = days.flatMap(({ day, sums }) => sums.map((each) => [
      `${number(day)}: ${each.controller}`, each.against.join(", "), `${number(each.better)} of ${number(each.stretches)}`,
      signed(each.saves_eur === null ? null : -each.saves_eur, "EUR", 2), signed(each.waits_s, "s"), signed(-each.saves_score_eur, "EUR", 2)]));
    return [
      ...days[0].sums.map(({ words }) => h("p", { class: "advice" }, words)),
      table("By day, the newest first: what each would have changed", ["Day and controller", "Against", "Better in", "Cost", "Wait of a vehicle", "Score"], rows, { numeric: (column) => column > 1 }),
    ];
  }

  #stretches(stretches) {
    const rows = stretches.flatMap((stretch) => {
      const span = `${clock(stretch.from_s)} to ${clock(stretch.to_s)}`;
      if (!stretch.runs.length) return [[span, stretch.problem?.detail || stretch.state, null, null, null, null]];
      return stretch.runs.map((run, place) => [
        span, `${run.controller}${place || !stretch.acted ? "" : " (acted)"}`, quantity(run.wait_s, "s"), number(run.served),
        run.cost_eur === null ? null : quantity(run.cost_eur, "EUR", 2), quantity(run.score_eur, "EUR", 2)]);
    });
    return h("details", {}, h("summary", {}, "The last stretches"), table("The last stretches, the newest first", ["Stretch", "Controller", "Wait", "Served", "Cost", "Score"], rows, { numeric: (column) => column > 1 }));
  }
}
