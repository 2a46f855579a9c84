// The scenario editor: fields with the service's own limits, a drawing of the arrivals, and what to do with it.
import { ask, post, Problem, saveJson } from "../lib/api.js";
import { controllers } from "../lib/controllers.js";
import { complain, field, h, toast } from "../lib/dom.js";
import { arrivalsPicture } from "./arrivals.js";
import { Fields } from "./fields.js";
import { components } from "./schema.js";
import { startTwin, submitComparison } from "./uses.js";

const DRAFT = "hrs-scenario";
const TOP = ["name", "about", "communication", "announcement_s", "idle_period_s", "time_limit_s"];
const KINDS = { uniform: "evenly spaced", normal: "a peak in the middle", poisson: "at a constant rate", profile: "a demand profile", trace: "a recorded day (CSV)" };
const FIRST = { uniform: { count: 12, period_s: 7200 }, normal: { count: 12, period_s: 7200, truncation: 1.75 }, poisson: { rate_per_h: 6, period_s: 7200 }, profile: { count: 20, hourly_weights: [1, 3, 4, 2] }, trace: { vehicles: [] } };

class Editor {
  constructor(root, schemas, choices, scenario) {
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
    this.changed();
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
    this.fields.clear("time_limit_s");
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
    const file = h("input", { type: "file", accept: ".csv,text/csv", id: "scenario-trace", onchange: async () => {
      complain(file, "");
      try {
        this.#arrive(await post("/v1/scenarios/trace", { csv: await file.files[0].text() }));
      } catch (error) {
        complain(file, [...(error.fields ?? [])].map(([where, what]) => `${where}: ${what}`).join("; ") || error.message);
      }
    } });
    return h("div", { class: "stack" }, field("CSV file", file, { hint: "columns time_s, start_pressure_bar and, where wanted, volume_m3, finish_pressure_bar; one vehicle a line" }),
      h("p", { class: "hint" }, count ? `${count} vehicles are loaded.` : "No file is loaded yet."));
  }

  async #preset(name) {
    this.scenario.station = await ask(`/v1/stations/${encodeURIComponent(name)}`);
    this.#showStation();
    this.changed();
  }

  #showStation() {
    this.fields.forget("station");
    this.stationFields.replaceChildren(this.fields.group("station", this.schemas.Station, this.scenario.station, ["source"]));
  }

  #disturb(on, given) {
    this.fields.forget("disturbance");
    this.scenario.disturbance = on ? (given ?? {}) : null;
    this.disturbance.replaceChildren(...(on ? [this.fields.group("disturbance", this.schemas.Disturbance, given ?? defaults(this.schemas, "Disturbance"), ["shares"])] : []));
    this.changed();
  }

  changed() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.check(), 250);
  }

  get entered() {
    return this.fields.into(structuredClone(this.scenario));
  }

  async check() {
    // Ask the service: its rules are the rules.
    const mine = (this.turn = (this.turn ?? 0) + 1);
    const given = this.entered;
    sessionStorage.setItem(DRAFT, JSON.stringify(given));
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
    this.state.replaceChildren(h("span", { class: good ? "tag good" : "tag bad" }, good ? "can be run" : `${count} field${count === 1 ? " is" : "s are"} wrong`));
    for (const button of this.root.querySelectorAll("[data-needs-valid]")) button.disabled = !good;
  }
}

function defaults(schemas, name) {
  return Object.fromEntries(Object.entries(schemas[name].properties).map(([key, { default: value }]) => [key, value]));
}

export async function show(root, [name]) {
  const [schemas, shipped, stations, known] = await Promise.all([components(), ask("/v1/scenarios"), ask("/v1/stations"), controllers()]);
  const draft = sessionStorage.getItem(DRAFT);
  const first = name || !draft ? await ask(`/v1/scenarios/${encodeURIComponent(name ?? shipped[0].name)}`) : JSON.parse(draft);
  const from = h("select", { "aria-label": "Begin with" }, h("option", { value: "" }, "Begin with …"), shipped.map(({ name: each, about }) => h("option", { value: each }, `${each}: ${about}`)));
  const file = h("input", { type: "file", accept: ".json,application/json", hidden: true });
  const editor = new Editor(root, schemas, { stations }, first);
  from.addEventListener("change", async () => from.value && editor.load(await ask(`/v1/scenarios/${from.value}`)));
  file.addEventListener("change", async () => {
    try {
      editor.load(await post("/v1/scenarios/resolve", JSON.parse(await file.files[0].text())));
    } catch (error) {
      toast(error.message, "problem");
    }
    file.value = "";
  });
  const save = () => saveJson(editor.entered, `${editor.entered.name || "scenario"}.json`);
  root.append(
    h("div", { class: "head" }, h("h1", {}, "Scenarios"), from, h("button", { type: "button", onclick: () => file.click() }, "Open a file"), file, h("button", { type: "button", onclick: save }, "Save as a file")),
    h("p", { class: "lead" }, "A station, who arrives when, and how to run it. The service checks every change by the rules it runs by."),
    h("div", { class: "columns editor" }, editor.form, h("div", { class: "stack beside" },
      h("section", { class: "card" }, h("div", { class: "head" }, h("h2", {}, "Who arrives"), editor.state), editor.problem, editor.picture,
        h("div", { class: "fields" }, field("Replication", editor.replication, { hint: "0 is the pattern, later ones are drawn" }), field("Seed", editor.seed))),
      submitComparison(editor, known), startTwin(editor, known))));
  editor.check();
  return () => clearTimeout(editor.timer);
}
