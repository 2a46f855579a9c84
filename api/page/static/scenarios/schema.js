// Fields of the API's own schema: what there is to fill in, with limits and units, stated nowhere else.
import { ask } from "../lib/api.js";

let known = null;

export async function components() {
  known ??= (await ask("/openapi.json")).components.schemas;
  return known;
}

export function resolved(schema) {
  // A schema without references and without the null of what may be left out.
  const { $ref, anyOf, ...own } = schema;
  if ($ref) return { ...resolved(known[$ref.split("/").at(-1)]), ...own };
  if (!anyOf) return schema;
  const some = anyOf.filter((each) => each.type !== "null");
  return { ...resolved(some[0]), ...own, ...(some[0].description && { description: some[0].description }), optional: some.length < anyOf.length };
}

const UNIT = /_(bar2|bar|c|k_per_s|k|m3|s|g_per_s_bar|g_per_s|per_s|per_h|kw)$/;

export const label = (name) => name.replace(UNIT, "").replaceAll("_", " ");

export function control(schema, value) {
  // The control for one field: a number with its limits, a choice, a tick or a text.
  const make = (tag, properties) => Object.assign(document.createElement(tag), properties);
  if (schema.enum) {
    const made = make("select", {});
    made.append(...schema.enum.map((each) => new Option(String(each).replaceAll("_", " "), each, false, each === value)));
    return made;
  }
  if (schema.type === "boolean") return make("input", { type: "checkbox", checked: Boolean(value) });
  if (schema.type === "number" || schema.type === "integer") {
    const made = make("input", { type: "number", step: schema.type === "integer" ? "1" : "any", value: value ?? "" });
    if ((schema.minimum ?? schema.exclusiveMinimum) !== undefined) made.min = schema.minimum ?? schema.exclusiveMinimum;
    if ((schema.maximum ?? schema.exclusiveMaximum) !== undefined) made.max = schema.maximum ?? schema.exclusiveMaximum;
    return made;
  }
  if (schema.type === "array") return make("input", { type: "text", value: (value ?? []).join(", "), autocomplete: "off" });
  return make("input", { type: "text", value: value ?? "", maxLength: schema.maxLength ?? 400, autocomplete: "off" });
}

export function entered(element, schema) {
  // What a control holds, as JSON takes it: a text that is no number goes to the service as it is, which says so.
  if (schema.type === "boolean") return element.checked;
  const text = element.value.trim();
  if (schema.type === "array") return text.split(/[\s,;]+/).filter(Boolean).map((each) => (Number.isNaN(Number(each)) ? each : Number(each)));
  if (schema.type !== "number" && schema.type !== "integer") return text;
  if (text === "") return element.validity.badInput ? "no number" : null;
  return Number(text);
}

export function limits({ minimum, exclusiveMinimum, maximum, exclusiveMaximum, unit }) {
  const plain = (value) => Number(Number(value).toPrecision(6)).toString();
  const low = minimum !== undefined ? `from ${plain(minimum)}` : exclusiveMinimum !== undefined ? `above ${plain(exclusiveMinimum)}` : "";
  const high = maximum !== undefined ? `to ${plain(maximum)}` : exclusiveMaximum !== undefined ? `below ${plain(exclusiveMaximum)}` : "";
  return [low, high].filter(Boolean).join(" ") + (unit && (low || high) ? ` ${unit === "degC" ? "°C" : unit}` : "");
}
