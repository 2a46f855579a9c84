// Scenarios that users store in the service: read with their tag, stored and forgotten only as they were read.
import { answerOf, ask } from "../lib/api.js";
import { confirmed } from "../lib/confirm.js";
import { h, table, toast } from "../lib/dom.js";
import { number, when } from "../lib/format.js";

const path = (name) => `/v1/scenarios/${encodeURIComponent(name)}`;

export const place = (name) => `#/scenarios/${encodeURIComponent(name)}`;

export async function read(name) {
  // A scenario and its tag.
  const answer = await answerOf(path(name));
  return { scenario: await answer.json(), tag: answer.headers.get("etag") };
}

export async function store(scenario, tag) {
  // Its new tag; without one there must be none of its name. A Problem of status 412 where somebody else was earlier.
  const headers = tag ? { "If-Match": tag } : { "If-None-Match": "*" };
  return (await answerOf(path(scenario.name), { method: "PUT", body: scenario, headers })).headers.get("etag");
}

export async function remove(name, tag) {
  // Forget one after a question; whether it was done.
  if (!(await confirmed(`Delete ${name}?`, "The scenario is lost for good; comparisons, runs and twins that were started with it keep theirs.", "Delete"))) return false;
  const known = tag ?? (await read(name)).tag;
  await ask(path(name), { method: "DELETE", headers: { "If-Match": known } });
  toast(`${name} is deleted`);
  return true;
}

export class OwnList {
  // The user's scenarios as a table.
  constructor(removed) {
    this.removed = removed; // hears the name of one that was deleted
    this.element = h("section", { class: "card own", "aria-labelledby": "own-title" });
  }

  show(scenarios) {
    const own = scenarios.filter(({ origin }) => origin === "own");
    const gone = (name) => remove(name).then((done) => done && this.removed(name)).catch((error) => toast(error.message, "problem"));
    const rows = own.map(({ name, about, station, vehicles, changed }) => [
      h("a", { href: place(name) }, name), about, station, number(vehicles), when(changed),
      h("button", { type: "button", class: "plain", "aria-label": `Delete ${name}`, onclick: () => gone(name) }, "Delete"),
    ]);
    this.element.replaceChildren(h("h2", { id: "own-title" }, "Your scenarios"),
      rows.length
        ? table("Stored in the service", ["name", "about", "station", "vehicles", "changed", "forget"], rows, { numeric: (column) => column === 3, wide: 1 })
        : h("p", { class: "hint" }, "None yet. A scenario that you store can be chosen in Live and Compare, by hrs and over REST."));
  }
}
