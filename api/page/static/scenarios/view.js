// The view "scenarios": the editor, where a scenario comes from, and what to do with it.
import { ask, post, saveJson } from "../lib/api.js";
import { controllers } from "../lib/controllers.js";
import { field, h, toast } from "../lib/dom.js";
import { fileInput } from "../lib/files.js";
import { forget, keep, kept, last } from "./draft.js";
import { Editor } from "./editor.js";
import { OwnList, place, read } from "./own.js";
import { components } from "./schema.js";
import { Storing } from "./storing.js";
import { startTwin, submitComparison } from "./uses.js";

async function opened(editor, picked) {
  // A scenario, or arrivals as CSV for the one that is edited.
  if (picked.name.toLowerCase().endsWith(".csv")) return editor.read(picked);
  editor.restore(await post("/v1/scenarios/resolve", parsed(await picked.text())));
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error(`is no JSON document: ${error.message}`);
  }
}

function guarded(editor, place, ending) {
  // Changes that are not stored are kept over a reload; where there is no room for them the browser asks first.
  editor.addEventListener("edit", () => {
    if (editor.unsaved) editor.room = keep(place, editor.entered);
    else forget(place);
  });
  window.addEventListener("beforeunload", (event) => {
    if (editor.unsaved && !editor.room) event.preventDefault();
  }, { signal: ending });
}

function beginnings(scenarios) {
  const group = (label, of) => {
    const found = scenarios.filter(({ origin }) => origin === of);
    return found.length > 0 && h("optgroup", { label }, found.map(({ name, about }) => h("option", { value: name }, about ? `${name}: ${about}` : name)));
  };
  const from = h("select", { "aria-label": "Begin with" }, h("option", { value: "" }, "Begin with …"), group("Shipped", "shipped"), group("Yours", "own"));
  from.addEventListener("change", () => from.value && (location.hash = place(from.value)));
  return from;
}

export async function show(root, [name]) {
  const [schemas, scenarios, stations, known] = await Promise.all([components(), ask("/v1/scenarios"), ask("/v1/stations"), controllers()]);
  const shipped = scenarios.filter(({ origin }) => origin === "shipped").map(({ name: each }) => each);
  const chosen = name ?? last() ?? shipped[0];
  const draft = kept(chosen);
  const { scenario, tag } = await read(chosen).catch((error) => {
    if (error.status !== 404 || !draft) throw error;
    return { scenario: draft, tag: null }; // deleted since
  });
  const ending = new AbortController();
  const editor = new Editor(root, schemas, { stations, shipped }, scenario);
  const list = new OwnList((gone) => (gone === chosen ? (location.hash = place(shipped[0])) : renew()));
  const renew = async () => list.show(await ask("/v1/scenarios"));
  guarded(editor, chosen, ending.signal); // before what shows whether there was room
  const storing = new Storing(editor, {
    stored: ({ name: now }) => {
      forget(chosen);
      if (editor.unsaved) keep(now, editor.entered); // typed meanwhile
      if (now !== chosen) location.hash = place(now);
      else renew();
    },
    removed: (gone) => {
      forget(gone);
      location.hash = place(shipped[0]);
    },
  });
  const file = fileInput({ accept: ".json,.csv,application/json,text/csv", hidden: true }, (picked) => opened(editor, picked).catch((error) => toast(`${picked.name}: ${error.message}`, "problem")));
  const save = () => saveJson(editor.entered, `${editor.entered.name || "scenario"}.json`);
  root.append(
    h("div", { class: "head" }, h("h1", {}, "Scenarios"), beginnings(scenarios), h("button", { type: "button", onclick: () => file.click() }, "Open a file"), file, h("button", { type: "button", onclick: save }, "Save as a file")),
    h("p", { class: "lead" }, "A station, who arrives when, and how to run it. The service checks every change by the rules it runs by."),
    storing.element,
    h("div", { class: "columns editor" }, editor.form, h("div", { class: "stack beside" },
      h("section", { class: "card" }, h("div", { class: "head" }, h("h2", {}, "Who arrives"), editor.state), editor.problem, editor.picture,
        h("div", { class: "fields" }, field("Replication", editor.replication, { hint: "0 is the pattern, later ones are drawn" }), field("Seed", editor.seed))),
      submitComparison(editor, known), startTwin(editor, known))),
    list.element);
  storing.begin(shipped.includes(chosen) || !tag ? null : { name: chosen, tag });
  list.show(scenarios);
  if (draft) editor.restore(draft);
  editor.check();
  return () => {
    clearTimeout(editor.timer);
    ending.abort();
  };
}
