// The scenario editor: fields with the service's own limits, and a drawing of the arrivals.
import { ask, post, Problem } from "../lib/api.js";
import { complain, field, h, set } from "../lib/dom.js";
import { fileInput } from "../lib/files.js";
import { arrivalsPicture } from "./arrivals.js";
import { Fields } from "./fields.js";

const NAME_MAX = 64;
const TOP = ["name", "about", "communication", "announcement_s", "idle_period_s", "time_limit_s"];
const KINDS = { uniform: "evenly spaced", normal: "a peak in the middle", poisson: "at a constant rate", profile: "a demand profile", trace: "a recorded day (CSV)" };
const FIRST = { uniform: { count: 12, period_s: 7200 }, normal: { count: 12, period_s: 7200, truncation: 1.75 }, poisson: { rate_per_h: 6, period_s: 7200 }, profile: { count: 20, hourly_weights: [1, 3, 4, 2] }, trace: { vehicles: [] } };

export class Editor extends EventTarget {
  room = true; // for a draft
  #whole = ""; // what the service has, as a text
  #ours = {}; // name and sentence as they came with a scenario that ships: they tell of that one alone

  constructor(root, schemas, choices, scenario) {
    super();
    Object.assign(this, { root, schemas, choices });
    this.problem = h("div", { role: "alert" });
    this.state = h("p", { role: "status" });
    this.picture = h("div", {});
    this.replication = h("input", { type: "number", min: "0", max: "1000000", value: "0" });
    this.seed = h("input", { type: "number", min: "0", value: "0" });
    this.form = h("form", { class: "stack", novalidate: true, onsubmit: (event) => event.preventDefault(), oninput: () => this.changed() });
    for (const control of [this.replication, this.seed]) control.addEventListener("input", () => this.changed());
    this.load(scenario);
  }

  load(scenario) {
    // Fill the form anew.
    this.loaded = null;
    this.scenario = structuredClone(scenario);
    this.fields = new Fields();
    const { properties } = this.schemas.Scenario;
    const run = TOP.map((name) => this.fields.leaf(name, properties[name], this.scenario[name]));
    this.arrivals = h("div", { class: "stack" });
    this.stationFields = h("div", { class: "stack" });
    const disturbed = h("input", { type: "checkbox", checked: Boolean(this.scenario.disturbance), onchange: () => this.#disturb(disturbed.checked) });
    this.disturbance = h("div", { class: "stack" });
    const preset = h("select", { id: "scenario-preset", onchange: () => this.#preset(preset.value) }, this.choices.stations.map(({ name, about }) => h("option", { value: name, title: about, selected: name === this.scenario.station.name }, name)));
    this.form.replaceChildren(
      h("section", { class: "card" }, h("h2", {}, "Scenario"), h("div", { class: "fields named" }, run.slice(0, 2))),
      h("section", { class: "card" }, h("h2", {}, "Arrivals"), this.#kinds(), this.arrivals),
      h("section", { class: "card" }, h("h2", {}, "Station"), field("Preset", preset, { hint: "a preset to begin with; every parameter may be changed below" }), h("details", {}, h("summary", {}, "Parameters"), this.stationFields)),
      h("section", { class: "card" }, h("h2", {}, "Run"), h("div", { class: "fields" }, run.slice(2)), h("div", { class: "choices" }, h("label", {}, disturbed, "Disturbed: noisy sensors, a plant that differs")), this.disturbance),
    );
    this.#showArrivals();
    this.#showStation();
    this.#disturb(disturbed.checked, this.scenario.disturbance);
    const { name, about } = this.scenario;
    this.#ours = this.choices.shipped.includes(name) ? { name, about } : {};
    this.loaded = this.#contents();
    this.settled();
    this.changed();
  }

  settled(scenario = this.entered) {
    // This is what the service has.
    this.#whole = JSON.stringify(scenario);
  }

  discard() {
    this.load(JSON.parse(this.#whole));
  }

  restore(draft) {
    // Another content that the service does not have: from before a reload, or of a file.
    const whole = this.#whole;
    this.load(draft);
    this.#whole = whole;
    this.changed();
  }

  get unsaved() {
    return JSON.stringify(this.entered) !== this.#whole;
  }

  #contents() {
    // What is run, as a text: everything but name and sentence.
    return JSON.stringify({ ...this.entered, name: "", about: "" });
  }

  #describe(words) {
    // Name and sentence of what is no longer what ships; what the user has written stays.
    for (const [name, text] of Object.entries(words)) {
      if (this.fields.text(name) !== this.#ours[name]) continue;
      this.fields.set(name, text);
      this.#ours[name] = text;
    }
  }

  #kinds() {
    const choose = (kind) => {
      this.#arrive({ kind, ...structuredClone(FIRST[kind]) });
    };
    return h("fieldset", {}, h("legend", {}, "Law"), h("div", { class: "choices" }, Object.entries(KINDS).map(([kind, about]) =>
      h("label", {}, h("input", { type: "radio", name: "kind", value: kind, checked: this.scenario.arrivals.kind === kind, onchange: () => choose(kind) }), about))));
  }

  #arrive(arrivals) {
    // Other arrivals, and a time limit that fits them: the service's own.
    this.scenario.arrivals = arrivals;
    this.fields.set("time_limit_s", "");
    this.#showArrivals();
    this.changed();
  }

  #showArrivals() {
    const { kind } = this.scenario.arrivals;
    this.fields.forget("arrivals");
    const schema = this.schemas[`${kind[0].toUpperCase()}${kind.slice(1)}`];
    this.arrivals.replaceChildren(kind === "trace" ? this.#trace() : this.fields.group("arrivals", schema, this.scenario.arrivals, ["kind"]));
  }

  #trace() {
    const count = this.scenario.arrivals.vehicles.length;
    const file = fileInput({ accept: ".csv,text/csv", id: "scenario-trace" }, async (picked) => {
      complain(file, "");
      try {
        await this.read(picked);
      } catch (error) {
        complain(file, [...(error.fields ?? [])].map(([where, what]) => `${where}: ${what}`).join("; ") || error.message);
      }
    });
    this.loadedCount = h("p", { class: "hint" }, count ? `${count} vehicles are loaded.` : "No file is loaded yet.");
    return h("div", { class: "stack" }, field("CSV file", file, { hint: "columns time_s, start_pressure_bar and, where wanted, volume_m3, finish_pressure_bar, with commas between; decimal points; one vehicle a line" }), this.loadedCount);
  }

  async read(picked) {
    // The arrivals of a CSV file; `post` raises a Problem that names the line which is wrong.
    const arrivals = await this.#vehicles(picked);
    this.#arrive(arrivals);
    const count = arrivals.vehicles.length;
    this.#describe({ name: picked.name.replace(/\.[^.]*$/, "").slice(0, NAME_MAX) || "trace", about: `${count} vehicle${count === 1 ? "" : "s"} of ${picked.name}` });
  }

  async #vehicles(picked) {
    try {
      return await post("/v1/scenarios/trace", { csv: await picked.text() });
    } catch (error) {
      if (this.scenario.arrivals.kind === "trace") this.#unread();
      throw error;
    }
  }

  #unread() {
    // The day that was to take the place of another cannot be read: neither is run.
    this.scenario.arrivals = structuredClone({ kind: "trace", ...FIRST.trace });
    set(this.loadedCount, "No file is loaded.");
    this.picture.replaceChildren();
    this.turn = (this.turn ?? 0) + 1; // what is said of the day before counts no more
    this.told(false);
    this.changed();
  }

  async #preset(name) {
    this.scenario.station = await ask(`/v1/stations/${encodeURIComponent(name)}`);
    this.#showStation();
    this.changed();
  }

  #showStation() {
    this.fields.forget("station");
    this.stationFields.replaceChildren(this.fields.group("station", this.schemas.Station, this.scenario.station, ["source", "plant"]));
  }

  #disturb(on, given) {
    this.fields.forget("disturbance");
    this.scenario.disturbance = on ? (given ?? {}) : null;
    this.disturbance.replaceChildren(...(on ? [this.fields.group("disturbance", this.schemas.Disturbance, given ?? defaults(this.schemas, "Disturbance"), ["shares"])] : []));
    this.changed();
  }

  changed() {
    if (this.loaded && this.#ours.about && this.#contents() !== this.loaded) this.#describe({ name: `${this.#ours.name}-changed`, about: "" });
    if (this.loaded) this.dispatchEvent(new Event("edit"));
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.check(), 250);
  }

  get entered() {
    return this.fields.into(structuredClone(this.scenario));
  }

  async check() {
    // Ask the service: its rules are the rules.
    clearTimeout(this.timer);
    const mine = (this.turn = (this.turn ?? 0) + 1);
    const given = this.entered;
    try {
      const query = new URLSearchParams({ replication: this.replication.value || "0", seed: this.seed.value || "0" });
      const found = await post(`/v1/scenarios/vehicles?${query}`, given);
      if (mine !== this.turn) return;
      this.fields.complain([]);
      this.problem.replaceChildren();
      this.picture.replaceChildren(arrivalsPicture(found));
      this.told(true);
    } catch (error) {
      if (mine !== this.turn) return;
      const problems = error instanceof Problem ? [...error.fields] : [];
      const kinds = Object.keys(KINDS).join("|");
      const plain = problems.map(([path, message]) => [path.replace(new RegExp(`^arrivals\\.(${kinds})\\b`), "arrivals"), message]);
      const rest = this.fields.complain(plain).map(([path, message]) => (path ? `${path}: ${message}` : message));
      if (!problems.length) rest.push(error.message);
      this.problem.replaceChildren(...(rest.length ? [h("p", { class: "problem" }, rest.join("; "))] : []));
      this.told(false, problems.length);
    }
  }

  told(good, count = 1) {
    this.dispatchEvent(new Event("change"));
    this.state.replaceChildren(h("span", { class: good ? "tag good" : "tag bad" }, good ? "can be run" : `${count} field${count === 1 ? " is" : "s are"} wrong`));
    for (const button of this.root.querySelectorAll("[data-needs-valid]")) button.disabled = !good;
  }
}

function defaults(schemas, name) {
  return Object.fromEntries(Object.entries(schemas[name].properties).map(([key, { default: value }]) => [key, value]));
}
