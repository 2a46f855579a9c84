// What can be done to a twin: speed, controller, a vehicle more; pause and stop stand at the top of the page.
import { ask, post } from "../lib/api.js";
import { confirmed } from "../lib/confirm.js";
import { field, h, set, toast } from "../lib/dom.js";
import { controllerInput, decimal, submit, suggested } from "./forms.js";
import { ALIVE, speedOf, speedWords } from "./names.js";

export const SPEEDS = ["1", "5", "10", "60", "100", "1000", "max"];

export class Controls {
  constructor(twin, scenario, changed, { source }) {
    // Of a twin that measures nothing can be set, of a replay its speed; it can be stopped.
    this.path = `/v1/twins/${twin}`;
    this.twin = twin;
    this.changed = changed; // hears of every new state
    this.pause = h("button", { type: "button", class: "pause", onclick: () => this.#pause() }, "Pause");
    this.end = h("button", { type: "button", class: "danger", onclick: () => this.#stop() }, "Stop");
    this.forms = {
      simulated: () => [this.#speed(), this.#controller(), this.#vehicle(scenario.station.vehicle)],
      replay: () => [this.#speed()],
      measured: () => [],
    }[source]();
    this.over = h("p", { class: "hint", hidden: true }, "This twin has ended: what it told can be read, nothing can be changed.");
    this.element = h("section", { class: "card controls", "aria-label": "Controls" }, h("h2", {}, "Controls"), this.over, this.forms);
  }

  show(state) {
    this.state = state;
    const alive = ALIVE.has(state.state);
    set(this.pause, state.state === "paused" ? "Continue" : "Pause");
    this.end.hidden = !alive;
    this.pause.hidden = !alive || !this.forms.length;
    this.over.hidden = alive;
    if (!this.forms.length) return;
    for (const form of this.forms) for (const each of form.elements) each.disabled = !alive;
    for (const [control, value] of [[this.speed, String(state.speed)], [this.controller, state.controller]]) {
      if (!control) continue;
      if (document.activeElement === control || control.dataset.said === value) continue;
      control.dataset.said = control.value = value; // what somebody is typing stays
    }
  }

  async #change(change) {
    this.changed(await ask(this.path, { method: "PATCH", body: change }));
  }

  async #pause() {
    await this.#change({ paused: this.state.state !== "paused" }).catch((error) => toast(error.message, "problem"));
  }

  async #stop() {
    if (!(await confirmed(`Stop ${this.twin}?`, "It ends for good; what it told stays.", "Stop it"))) return;
    await post(`${this.path}/stop`).then(this.changed, (error) => toast(error.message, "problem"));
  }

  #form(name, button, controls, parts, send) {
    const form = h("form", { class: "control", name, novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      submit(form, controls, send);
    } }, parts, h("button", {}, button));
    return form;
  }

  #speed() {
    const [input, list] = suggested(SPEEDS, { name: "speed", inputmode: "text" });
    this.speed = input;
    return this.#form("speed", "Set", { speed: input }, [field("Speed", input, { unit: "s/s", hint: "1 to 1000, or max" }), list], async () => {
      await this.#change({ speed: speedOf(input.value) });
      toast(`speed: ${speedWords(speedOf(input.value))}`);
    });
  }

  #controller() {
    const [input, list] = controllerInput();
    this.controller = input;
    return this.#form("controller", "Seat", { controller: input }, [field("Controller", input, { hint: "options behind colons: minlp1:horizon=2; another one makes a certified twin uncertified" }), list], async () => {
      await this.#change({ controller: input.value.trim() });
      toast(`controller: ${input.value.trim()}`);
    });
  }

  #vehicle(usual) {
    const input = (name, placeholder, value) => h("input", { type: "text", inputmode: "decimal", autocomplete: "off", name, placeholder: placeholder === undefined ? null : String(placeholder), value: value ?? null });
    const controls = {
      start_pressure_bar: input("start_pressure_bar", undefined, String(Math.round(usual.start_pressure_bar))),
      start_temperature_c: input("start_temperature_c", usual.start_temperature_c === undefined ? "usual" : String(usual.start_temperature_c)),
      volume_m3: input("volume_m3", usual.volume_m3.toFixed(3)),
      finish_pressure_bar: input("finish_pressure_bar", usual.finish_pressure_bar.toFixed(1)),
    };
    const more = h("details", {}, h("summary", {}, "Another tank than the usual"), h("div", { class: "fields" },
      field("Start temperature", controls.start_temperature_c, { unit: "°C" }), field("Volume", controls.volume_m3, { unit: "m³" }), field("Finish pressure", controls.finish_pressure_bar, { unit: "bar" })));
    return this.#form("vehicle", "Add vehicle", controls, [field("Start pressure", controls.start_pressure_bar, { unit: "bar", hint: "of one more vehicle" }), more], async () => {
      const body = Object.fromEntries(Object.entries(controls).map(([name, control]) => [name, decimal(control.value)]).filter(([, value]) => value !== undefined));
      this.changed(await post(`${this.path}/vehicles`, body));
      toast("a vehicle arrives with the next second");
    });
  }
}
