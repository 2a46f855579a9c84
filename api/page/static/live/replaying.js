// A stretch of what a twin has told, played again by a twin of its own; or another twin that goes on from there.
import { long, post } from "../lib/api.js";
import { field, h, toast } from "../lib/dom.js";
import { clock } from "../lib/format.js";
import { SPEEDS } from "./controls.js";
import { controllerInput, decimal, submit, suggested } from "./forms.js";
import { isMeasured, speedOf } from "./names.js";

export function replayForm({ id: twin, layout }, span) {
  // The forms; `span` says which seconds the series show.
  const input = (name) => h("input", { type: "text", inputmode: "numeric", autocomplete: "off", name });
  const [speed, speeds] = suggested(SPEEDS, { name: "speed", value: "60" });
  const controls = { from_s: input("from_s"), to_s: input("to_s"), speed };
  const shown = () => {
    controls.from_s.value = Math.max(0, Math.floor(span.from));
    controls.to_s.value = Math.max(0, Math.min(Math.ceil(span.to), span.end - 1));
  };
  const form = h("form", { class: "replaying", name: "replay", novalidate: true, onsubmit: (event) => {
    event.preventDefault();
    submit(form, controls, async () => {
      const body = { source: "replay", of: twin, from_s: decimal(controls.from_s.value), to_s: decimal(controls.to_s.value), speed: speedOf(speed.value) };
      const state = await post("/v1/twins", body);
      toast(`${state.id} plays ${clock(state.from_s)} to ${clock(state.to_s)} of ${twin}`);
      location.hash = `#/live/${state.id}`;
    });
  } },
    h("div", { class: "fields" },
      field("From", controls.from_s, { unit: "s", hint: "left empty: the first second that is kept" }),
      field("To", controls.to_s, { unit: "s", hint: "left empty: the newest" }),
      h("div", {}, field("Played at", speed, { unit: "s/s", hint: "1 to 1000, or max" }), speeds)),
    h("div", { class: "actions" }, h("button", { type: "button", class: "plain", onclick: shown }, "The window shown"), h("button", {}, "Replay")));
  const branch = isMeasured({ layout }) ? null : branchForm(twin, controls.from_s);
  return h("details", { class: "card replay" }, h("summary", {}, "Replay"), h("p", { class: "hint" }, "The same seconds and events again, at any speed, by a twin with a name and keys of its own."), form, branch);
}

function branchForm(twin, from) {
  // What if another controller had been in the slot: a twin that begins with the state of the first second of the stretch.
  const [controller, list] = controllerInput("minlp1");
  const form = h("form", { class: "control", name: "what-if", novalidate: true, onsubmit: (event) => {
    event.preventDefault();
    submit(form, { controller, at_s: from, of: from }, async () => {
      const state = await post("/v1/twins", { of: twin, at_s: decimal(from.value), controller: controller.value.trim(), speed: 60 }, long);
      toast(`${state.id} goes on from ${clock(state.at_s)} of ${twin} with ${state.controller}`);
      location.hash = `#/live/${state.id}`;
    });
  } }, field("Controller of another twin", controller, { hint: "it begins with the state at From, and the same vehicles come; left empty there: now" }), list,
  h("button", {}, "What if another controller had been in the slot from here"));
  return form;
}
