// The form that starts a twin.
import { ask, long, post } from "../lib/api.js";
import { field, h, set, toast } from "../lib/dom.js";
import { CertificateChoice } from "./certificate.js";
import { SPEEDS } from "./controls.js";
import { controllerInput, submit, suggested } from "./forms.js";
import { AT_END, speedOf } from "./names.js";

export async function startForm(twins, signal) {
  const [scenarios, stations] = await Promise.all(["/v1/scenarios", "/v1/stations"].map((path) => ask(path)));
  const select = (name, options) => h("select", { name }, options.map(([value, text]) => h("option", { value }, text)));
  const [speed, speeds] = suggested(SPEEDS, { name: "speed", value: "10" });
  const [controller, suggestions, installed] = controllerInput("logic");
  const controls = {
    id: h("input", { type: "text", name: "id", value: freeName(twins), autocomplete: "off", spellcheck: "false" }),
    scenario: select("scenario", scenarios.map(({ name }) => [name, name])),
    station: select("station", [["", "the scenario's own"], ...stations.map(({ name }) => [name, name])]),
    controller,
    speed,
    at_end: select("at_end", Object.entries(AT_END)),
  };
  const subjectOf = async () => {
    // What a certificate would be about, or why there is none.
    const [name, ...options] = controller.value.trim().split(":");
    const station = controls.station.value || scenarios.find((each) => each.name === controls.scenario.value).station;
    if (!(await installed).some((each) => each.name === name)) return `Nothing is proved of ${name ? `"${name}"` : "nobody"}: certificates are about the controllers that are installed here.`;
    if (!stations.some((each) => each.name === station)) return `The scenario has a station of its own, ${station}: have its certificate made by hrs certify --station, and start with the file.`;
    return { controller: name, station, options: options.join(":") };
  };
  const certificate = new CertificateChoice(subjectOf, signal);
  Object.assign(controls, { certificate: certificate.choice, certificate_file: certificate.file });
  for (const control of [controller, controls.scenario, controls.station]) control.addEventListener("input", () => certificate.changed());
  certificate.changed();
  const scenarioField = field("Scenario", controls.scenario, { hint: scenarios[0]?.about });
  controls.scenario.addEventListener("change", () => {
    scenarioField.querySelector(".hint").textContent = scenarios.find(({ name }) => name === controls.scenario.value).about;
  });
  const start = h("button", { class: "primary", "aria-live": "polite" }, "Start the twin");
  const send = async () => {
    const chosen = controls.scenario.value;
    const station = controls.station.value;
    const scenario = station ? { ...(await ask(`/v1/scenarios/${chosen}`)), station } : chosen;
    set(start, certificate.chosen ? "Checking the certificate …" : "Starting …");
    start.disabled = true;
    const document_ = await certificate.asked();
    const asked = JSON.stringify({
      id: controls.id.value.trim() || null, scenario, controller: controller.value.trim(), speed: speedOf(speed.value), at_end: controls.at_end.value,
      allow_uncertified: certificate.allow.checked,
    });
    const state = await post("/v1/twins", document_ ? `${asked.slice(0, -1)},"certificate":${document_}}` : asked, long);
    toast(`${state.id} has started: ${state.service}`);
    location.hash = `#/live/${state.id}`;
  };
  const form = h("form", { class: "start", name: "start", novalidate: true, onsubmit: (event) => {
    event.preventDefault();
    submit(form, controls, send, { 409: "id" }).finally(() => {
      set(start, "Start the twin");
      start.disabled = false;
    });
  } },
    h("div", { class: "fields" },
      field("Name", controls.id, { hint: "small letters, digits, hyphens; one is made if left empty" }),
      scenarioField,
      field("Station", controls.station),
      h("div", {}, field("Controller", controller, { hint: "options behind colons: minlp1:horizon=2" }), suggestions),
      h("div", {}, field("Speed", speed, { unit: "s/s", hint: "1 to 1000, or max" }), speeds),
      field("When its vehicles are served", controls.at_end)),
    certificate.element,
    h("div", { class: "actions" }, start));
  return form;
}

function freeName(twins) {
  const taken = new Set(twins.map(({ id }) => id));
  if (!taken.has("station")) return "station";
  for (let number = 2; ; number++) if (!taken.has(`station-${number}`)) return `station-${number}`;
}
