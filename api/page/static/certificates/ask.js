// Two questions: does a controller serve everybody at a station, and what holds for every signal of a switched system?
import { ask, post, Problem } from "../lib/api.js";
import { controllers } from "../lib/controllers.js";
import { complain, field, h } from "../lib/dom.js";

// What is proved at the station that ships first: something to see at once.
const [CONTROLLER, STATION] = ["reserve", "thesis-fit"];

const option = (value, text = value, chosen = false) => h("option", { value, selected: chosen }, text);

export async function askAboutController() {
  const [known, stations] = await Promise.all([controllers(), ask("/v1/stations")]);
  const controller = h("select", { name: "controller" }, known.map(({ name, about }) => h("option", { value: name, title: about, selected: name === CONTROLLER }, name)));
  const station = h("select", { name: "station" }, stations.map(({ name }) => option(name, name, name === STATION)));
  const options = h("input", { name: "options", maxlength: "200", placeholder: "gap_bar=200", autocomplete: "off" });
  return h("form", { class: "card", "aria-labelledby": "ask-service", onsubmit: (event) => {
    event.preventDefault();
    location.hash = ["#/certificates/service", controller.value, station.value, options.value.trim()].filter(Boolean).map((part, place) => (place ? encodeURIComponent(part) : part)).join("/");
  } },
    h("h2", { id: "ask-service" }, "A controller's service"),
    h("p", { class: "lead" }, "Is every vehicle finished in time, from every state that was seen and some more?"),
    h("div", { class: "fields" }, field("Controller", controller), field("Station", station), field("Options", options, { hint: "as behind a controller's name; may be empty" })),
    h("div", { class: "actions" }, h("button", { class: "primary" }, "Show what is proved")));
}

export async function askAboutSystem() {
  const known = await ask(new URL("./questions.json", import.meta.url).pathname);
  const text = h("textarea", { name: "question", rows: 20, spellcheck: false, required: true });
  const example = h("select", { name: "example", onchange: () => fill() }, Object.entries(known).map(([name, { about }]) => option(name, about.length > 70 ? `${about.slice(0, 68)}…` : about)));
  const fill = () => {
    text.value = JSON.stringify(known[example.value].question, null, 1).replace(/\[\s+([^[\]{}]*?)\s+\]/g, (_, inside) => `[${inside.replace(/\s+/g, " ")}]`);
    complain(text, "");
  };
  fill();
  return h("form", { class: "card", novalidate: true, "aria-labelledby": "ask-system", onsubmit: async (event) => {
    event.preventDefault();
    complain(text, "");
    try {
      const job = await post("/v1/certificates", JSON.parse(text.value));
      location.hash = `#/certificates/${job.id}`;
    } catch (error) {
      const fields = error instanceof Problem ? [...error.fields].map((each) => each.join(": ")) : [];
      complain(text, error instanceof SyntaxError ? `is no JSON document: ${error.message}` : fields.join("; ") || error.message);
    }
  } },
    h("h2", { id: "ask-system" }, "A switched system"),
    h("p", { class: "lead" }, "Stability, decay, gain or reach under a switching constraint, or gains that make it so."),
    field("Begin with", example), field("Question", text, { hint: "numbers are taken exactly: 0.39 is 39/100" }),
    h("div", { class: "actions" }, h("button", { class: "primary" }, "Ask")));
}
