// The form that starts a twin.
import { ask, post } from "../lib/api.js";
import { field, h, toast } from "../lib/dom.js";
import { SPEEDS } from "./controls.js";
import { controllerInput, submit, suggested } from "./forms.js";
import { AT_END, speedOf } from "./names.js";

export async function startForm(twins) {
  const [scenarios, stations] = await Promise.all(["/v1/scenarios", "/v1/stations"].map((path) => ask(path)));
  const select = (name, options) => h("select", { name }, options.map(([value, text]) => h("option", { value }, text)));
  const [speed, speeds] = suggested(SPEEDS, { name: "speed", value: "10" });
  const [controller, known] = controllerInput("logic");
  const controls = {
    id: h("input", { type: "text", name: "id", value: freeName(twins), autocomplete: "off", spellcheck: "false" }),
    scenario: select("scenario", scenarios.map(({ name }) => [name, name])),
    station: select("station", [["", "the scenario's own"], ...stations.map(({ name }) => [name, name])]),
    controller,
    speed,
    at_end: select("at_end", Object.entries(AT_END)),
  };
  const scenarioField = field("Scenario", controls.scenario, { hint: scenarios[0]?.about });
  controls.scenario.addEventListener("change", () => {
    scenarioField.querySelector(".hint").textContent = scenarios.find(({ name }) => name === controls.scenario.value).about;
  });
  const send = async () => {
    const chosen = controls.scenario.value;
    const station = controls.station.value;
    const scenario = station ? { ...(await ask(`/v1/scenarios/${chosen}`)), station } : chosen;
    const state = await post("/v1/twins", {
      id: controls.id.value.trim() || null, scenario, controller: controller.value.trim(), speed: speedOf(speed.value), at_end: controls.at_end.value,
    });
    toast(`${state.id} has started`);
    location.hash = `#/live/${state.id}`;
  };
  const form = h("form", { class: "start", name: "start", novalidate: true, onsubmit: (event) => {
    event.preventDefault();
    submit(form, controls, send, { 409: "id" });
  } },
    h("div", { class: "fields" },
      field("Name", controls.id, { hint: "small letters, digits, hyphens; one is made if left empty" }),
      scenarioField,
      field("Station", controls.station),
      h("div", {}, field("Controller", controller, { hint: "options behind colons: minlp1:horizon=2" }), known),
      h("div", {}, field("Speed", speed, { unit: "s/s", hint: "1 to 1000, or max" }), speeds),
      field("When its vehicles are served", controls.at_end)),
    h("div", { class: "actions" }, h("button", { class: "primary" }, "Start the twin")));
  return form;
}

function freeName(twins) {
  const taken = new Set(twins.map(({ id }) => id));
  if (!taken.has("station")) return "station";
  for (let number = 2; ; number++) if (!taken.has(`station-${number}`)) return `station-${number}`;
}
