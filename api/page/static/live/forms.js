// Small forms that say at their fields what is wrong with them.
import { Problem } from "../lib/api.js";
import { controllers } from "../lib/controllers.js";
import { complain, h, toast } from "../lib/dom.js";

let lists = 0;

export function suggested(options, properties) {
  // An input that takes any text and suggests some, and the list that stands beside it.
  const id = `suggestions-${++lists}`;
  const input = h("input", { type: "text", autocomplete: "off", spellcheck: "false", ...properties });
  input.setAttribute("list", id);
  return [input, h("datalist", { id }, options.map((option) => h("option", { value: option })))];
}

export function controllerInput(value) {
  // Names come when the service has them: it may have to load every controller first.
  const [input, list] = suggested([], { name: "controller", value: value ?? null });
  const installed = controllers();
  installed.then((found) => {
    list.replaceChildren(...found.map(({ name }) => h("option", { value: name })));
    const about = () => {
      const known = found.find(({ name }) => name === input.value.split(":")[0]);
      const options = Object.keys(known?.options.properties ?? {});
      input.title = known ? `${known.about}${options.length ? `; options: ${options.join(", ")}` : ""}` : "";
    };
    input.addEventListener("input", about);
    input.addEventListener("focus", about);
  }, () => {});
  return [input, list, installed];
}

export function decimal(text) {
  // What was typed as a number, or the text, for the service to refuse; undefined where nothing was typed.
  const plain = text.trim().replace(",", ".");
  if (plain === "") return undefined;
  return Number.isFinite(Number(plain)) ? Number(plain) : plain;
}

export async function submit(form, controls, send, otherwise = {}) {
  // Send, and show each error at the field it is about; what is about none of them is a toast. True if it went well.
  for (const control of Object.values(controls)) complain(control, "");
  if (form.ariaBusy === "true") return false;
  form.ariaBusy = "true";
  try {
    await send();
    return true;
  } catch (error) {
    const fields = error instanceof Problem ? [...error.fields] : [];
    const status = error.status in otherwise ? [[otherwise[error.status], error.message]] : [];
    let shown = null;
    for (const [field, message] of [...fields, ...status]) {
      const [first, last] = [field.split(".")[0], field.split(".").at(-1)]; // an alternative of a body stands before its field
      const control = controls[field] ?? controls[last] ?? controls[first];
      if (!control) toast(field ? `${field}: ${message}` : message, "problem");
      else complain(control, message);
      shown ??= control;
    }
    if (!fields.length && !status.length) toast(error.message, "problem");
    shown?.focus();
    return false;
  } finally {
    form.ariaBusy = "false";
  }
}
