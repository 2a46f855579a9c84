// What to do with a scenario: compare controllers on it, or start a live twin of it.
import { post, Problem } from "../lib/api.js";
import { complain, field, h, set } from "../lib/dom.js";
import { SPEEDS } from "../live/controls.js";
import { suggested } from "../live/forms.js";
import { speedOf } from "../live/names.js";

const USUAL = ["logic", "switched"]; // to begin with: the thesis's rule and ours

function drawsNothing({ arrivals, disturbance }) {
  // Why replications of a scenario would all be the same, or "".
  return arrivals.kind === "trace" && !disturbance ? "A recorded day draws nothing: each replication would be the same one." : "";
}

function refused(error, controls, problem) {
  // Show each wrong field at its control, the rest together.
  const fields = error instanceof Problem ? [...error.fields] : [];
  const rest = fields.filter(([path, message]) => {
    const control = controls[path.split(".")[0]];
    if (control) complain(control, message);
    return !control;
  });
  const text = rest.map(([path, message]) => (path ? `${path}: ${message}` : message)).join("; ") || (fields.length ? "" : error.message);
  problem.replaceChildren(...(text ? [h("p", { class: "problem" }, text)] : []));
}

export function submitComparison(editor, known) {
  const chosen = known.map(({ name, about }) => h("label", { title: about }, h("input", { type: "checkbox", name: "controllers", value: name, checked: USUAL.includes(name) }), name));
  const settings = h("input", { placeholder: "switched:patience=0.5", autocomplete: "off" });
  const replications = h("input", { type: "number", min: "1", max: "10000", value: "1" });
  const drawing = field("Replications", replications);
  editor.addEventListener("change", () => {
    const why = drawsNothing(editor.entered);
    if (why) replications.value = "1";
    replications.disabled = Boolean(why);
    set(drawing.querySelector(".hint"), why);
  });
  const problem = h("div", { role: "alert" });
  const submit = async (event) => {
    event.preventDefault();
    const controllers = [...event.target.querySelectorAll("[name=controllers]:checked")].map((box) => box.value);
    controllers.push(...settings.value.split(/[\s,]+/).filter(Boolean));
    for (const control of [settings, replications]) complain(control, "");
    try {
      const job = await post("/v1/comparisons", { scenarios: [editor.entered], controllers, replications: Number(replications.value), seed: Number(editor.seed.value) });
      location.hash = `#/compare/${job.id}`;
    } catch (error) {
      refused(error, { controllers: settings, replications }, problem);
    }
  };
  return h("form", { class: "card", novalidate: true, "aria-labelledby": "use-compare", onsubmit: submit }, h("h2", { id: "use-compare" }, "Compare controllers on it"),
    h("fieldset", {}, h("legend", {}, "Controllers"), h("div", { class: "choices" }, chosen)),
    h("div", { class: "fields" }, field("With settings", settings, { hint: "separated by commas; may be empty" }), drawing),
    problem, h("div", { class: "actions" }, h("button", { class: "primary", "data-needs-valid": true, disabled: true }, "Compare")));
}

export function startTwin(editor, known) {
  const id = h("input", { maxlength: "32", placeholder: "made if left out", autocomplete: "off" });
  const controller = h("select", {}, known.map(({ name }) => h("option", { value: name, selected: name === USUAL[0] }, name)));
  const [speed, speeds] = suggested(SPEEDS, { name: "speed", value: "10" });
  const problem = h("div", { role: "alert" });
  const submit = async (event) => {
    event.preventDefault();
    for (const control of [id, controller, speed]) complain(control, "");
    try {
      const twin = await post("/v1/twins", { ...(id.value && { id: id.value }), scenario: editor.entered, controller: controller.value, speed: speedOf(speed.value) });
      location.hash = `#/live/${twin.id}`;
    } catch (error) {
      refused(error, { id, controller, speed }, problem);
    }
  };
  return h("form", { class: "card", novalidate: true, "aria-labelledby": "use-live", onsubmit: submit }, h("h2", { id: "use-live" }, "Start a live twin of it"),
    h("div", { class: "fields" }, field("Name", id), field("Controller", controller), h("div", {}, field("Speed", speed, { unit: "s/s", hint: "1 to 1000, or max: as fast as possible" }), speeds)),
    problem, h("div", { class: "actions" }, h("button", { class: "primary", "data-needs-valid": true, disabled: true }, "Start")));
}
