// Groups of fields made from a schema: each control knows its path in the scenario.
import { complain, field, h } from "../lib/dom.js";
import { control, entered, label, limits, resolved } from "./schema.js";

const PLAIN = new Set(["number", "integer", "string", "boolean", "array"]);

export class Fields {
  #controls = new Map(); // path -> [control, schema]

  leaf(path, given, value) {
    // One labelled control.
    const schema = resolved(given);
    const made = control(schema, value);
    made.dataset.path = path;
    made.id = `scenario-${path.replaceAll(".", "-")}`;
    this.#controls.set(path, [made, schema]);
    const name = path.split(".").at(-1);
    const about = schema.description && schema.description !== name ? schema.description : "";
    const hint = [about, limits(schema)].filter(Boolean).join("; ");
    const unit = schema.unit === "degC" ? "°C" : schema.unit;
    return field(label(name), made, { unit, hint });
  }

  group(path, given, value, skipped = []) {
    // All fields of an object; objects within it, and those in a list, are groups of their own, but for those left out.
    const schema = resolved(given);
    const entries = Object.entries(schema.properties).filter(([name]) => !skipped.includes(name));
    const [plain, deep] = [[], []];
    for (const [name, below] of entries) {
      const of = resolved(below);
      const row = of.type === "array" && resolved(of.items);
      if (row?.properties) deep.push(...(value?.[name] ?? []).map((each, place) => h("fieldset", {}, h("legend", {}, `${label(name)} ${place + 1}`), this.group(`${path}.${name}.${place}`, of.items, each))));
      else if (PLAIN.has(of.type)) plain.push(this.leaf(`${path}.${name}`, below, value?.[name]));
      else if (of.properties && (value?.[name] || !of.optional)) deep.push(h("fieldset", {}, h("legend", {}, label(name)), this.group(`${path}.${name}`, below, value?.[name])));
    }
    return h("div", { class: "stack" }, plain.length > 0 && h("div", { class: "fields" }, plain), deep);
  }

  forget(path) {
    for (const key of this.#controls.keys()) if (key === path || key.startsWith(`${path}.`)) this.#controls.delete(key);
  }

  control(path) {
    return this.#controls.get(path)[0];
  }

  text(path) {
    return this.#controls.get(path)[0].value;
  }

  set(path, text) {
    // An empty text leaves a field to the service.
    this.#controls.get(path)[0].value = text;
  }

  into(scenario) {
    // Write what is entered into a scenario; what is left empty is left out.
    for (const [path, [made, schema]] of this.#controls) {
      const names = path.split(".");
      const last = names.pop();
      const place = names.reduce((at, name) => (at[name] ??= {}), scenario);
      const value = entered(made, schema);
      if (value === null) delete place[last];
      else place[last] = value;
    }
    return scenario;
  }

  complain(problems) {
    // Show what is wrong at its control; what belongs to none is returned.
    for (const [made] of this.#controls.values()) complain(made, "");
    return problems.filter(([path, message]) => {
      const [first] = message.split(" ");
      const at = [path, `${path}.${first}`, first, path.replace(/\.\d+$/, "")].find((each) => this.#controls.has(each));
      if (at) complain(this.#controls.get(at)[0], message);
      return !at;
    });
  }
}
