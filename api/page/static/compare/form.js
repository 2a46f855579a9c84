// The form of a new comparison: scenarios, controllers, station, replications, seed.
import { ask, post, Problem } from "../lib/api.js";
import { controllers } from "../lib/controllers.js";
import { alarm, complain, field, h, set } from "../lib/dom.js";
import { number } from "../lib/format.js";

const USUAL = ["logic", "minlp1", "minlp2", "minlp3"]; // what the thesis compares

export async function form(signal) {
  const [scenarios, known, stations] = await Promise.all([ask("/v1/scenarios", { signal }), controllers({ signal }), ask("/v1/stations", { signal })]);
  const parts = {
    scenarios: choices("Scenarios", "scenario", scenarios, ({ origin }) => origin === "shipped"),
    controllers: choices("Controllers", "controller", known, ({ name }) => USUAL.includes(name)),
    typed: h("input", { name: "typed", autocomplete: "off", spellcheck: "false", placeholder: "switched:patience=0.5, minlp1:horizon=2" }),
    station: h("select", { name: "station" }, h("option", { value: "" }, "as the scenario says"), stations.map(({ name }) => h("option", { value: name }, name))),
    replications: h("input", { name: "replications", type: "number", value: "1", inputmode: "numeric" }),
    seed: h("input", { name: "seed", type: "number", value: "0", inputmode: "numeric" }),
    problem: h("p", { role: "alert", hidden: true }),
    runs: h("output", { class: "runs" }),
    submit: h("button", { class: "primary" }, "Compare"),
  };
  const made = h("form", { class: "card new", novalidate: true, "aria-labelledby": "new-title" },
    h("h2", { id: "new-title" }, "New comparison"),
    parts.scenarios, parts.controllers,
    h("div", { class: "fields" },
      field("Controllers with settings", parts.typed, { hint: "settings behind colons; several with commas between" }),
      field("Station", parts.station),
      field("Replications", parts.replications, { hint: "one: the pattern; later ones are drawn" }),
      field("Seed", parts.seed, { hint: "of the drawn ones" })),
    parts.problem,
    h("div", { class: "actions" }, parts.submit, parts.runs));
  const count = () => set(parts.runs, product(asked(parts)));
  made.addEventListener("input", count);
  made.addEventListener("submit", async (event) => {
    event.preventDefault();
    parts.submit.disabled = true;
    await submit(parts).catch((error) => show(parts, error));
    parts.submit.disabled = false;
  });
  count();
  return made;
}

function choices(title, name, items, checked) {
  // A group of check boxes, each with a line on what it stands for.
  const wrong = h("span", { class: "wrong", id: `${name}-wrong` });
  return h("fieldset", { class: "picks" }, h("legend", {}, title),
    items.map((each) => h("label", {}, h("input", { type: "checkbox", name, value: each.name, checked: checked(each), "aria-describedby": wrong.id }),
      h("b", {}, each.name), h("span", { class: "hint" }, each.about))), wrong);
}

const picked = (group) => [...group.querySelectorAll("input:checked")].map((box) => box.value);

const entries = (text) => text.split(",").map((entry) => entry.trim()).filter(Boolean);

function asked(parts) {
  const whole = (control) => (control.value.trim() === "" ? null : Number(control.value));
  return {
    scenarios: picked(parts.scenarios), controllers: [...picked(parts.controllers), ...entries(parts.typed.value)],
    replications: whole(parts.replications), seed: whole(parts.seed),
  };
}

const plural = (count, name) => `${number(count)} ${name}${count === 1 ? "" : "s"}`;

function product({ scenarios, controllers, replications }) {
  const runs = scenarios.length * controllers.length * (replications ?? 0);
  return `${plural(scenarios.length, "scenario")} × ${plural(controllers.length, "controller")} × ${plural(replications ?? 0, "replication")} = ${plural(runs, "run")}`;
}

async function submit(parts) {
  for (const control of [parts.typed, parts.station, parts.replications, parts.seed]) complain(control, "");
  for (const group of [parts.scenarios, parts.controllers]) set(group.querySelector(".wrong"), "");
  alarm(parts.problem, "");
  const request = asked(parts);
  if (parts.station.value) {
    const whole = await Promise.all(request.scenarios.map((name) => ask(`/v1/scenarios/${encodeURIComponent(name)}`)));
    request.scenarios = whole.map((scenario) => ({ ...scenario, station: parts.station.value }));
  }
  const { id } = await post("/v1/comparisons", request);
  location.hash = `#/compare/${encodeURIComponent(id)}`;
}

function show(parts, error) {
  // What the service says, at the field it says it of; the rest above the button.
  const rest = [];
  const wrong = [];
  for (const [name, message] of error instanceof Problem ? error.fields : []) {
    const control = controlOf(parts, name);
    if (!control) rest.push(`${name}: ${message}`);
    else {
      if (control.classList.contains("picks")) set(control.querySelector(".wrong"), message);
      else complain(control, named(parts, name, message));
      wrong.push(control);
    }
  }
  const text = wrong.length ? rest.join("; ") : error.message;
  alarm(parts.problem, text);
  const first = wrong[0]?.classList.contains("picks") ? wrong[0].querySelector("input") : wrong[0];
  first?.focus();
}

function controlOf(parts, name) {
  const [group, place] = name.split(".");
  if (group === "controllers") {
    if (place === undefined) return entries(parts.typed.value).length ? parts.typed : parts.controllers;
    return Number(place) < picked(parts.controllers).length ? parts.controllers : parts.typed;
  }
  return { scenarios: parts.station.value && place !== undefined ? parts.station : parts.scenarios, replications: parts.replications, seed: parts.seed }[group];
}

function named(parts, name, message) {
  // Which of several typed controllers is meant.
  const place = Number(/^controllers\.(\d+)$/.exec(name)?.[1]) - picked(parts.controllers).length;
  const entry = entries(parts.typed.value)[place];
  return entry ? `${entry}: ${message}` : message;
}
