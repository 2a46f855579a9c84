// The view "compare": a new comparison and the earlier ones, or one of them.
import { Problem } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { form } from "./form.js";
import { jobs } from "./jobs.js";
import { result } from "./result.js";

export async function show(root, [id]) {
  const ending = new AbortController();
  if (id) follow(root, id, ending.signal);
  else {
    root.append(h("div", { class: "head" }, h("h1", {}, "Compare")),
      h("p", { class: "lead" }, "The same vehicles come to the same station, once for each controller: who waits, and what does it cost?"));
    const parts = [["new", form], ["earlier", jobs]].map(([name, part]) => filled(name, part(ending.signal), ending.signal));
    root.append(h("div", { class: "start" }, parts));
  }
  return () => ending.abort();
}

function filled(name, part, signal) {
  // A place that says so while its part is on the way, and what is wrong where it does not come.
  const place = h("div", { class: `card ${name}`, "aria-busy": "true" }, h("p", { class: "hint" }, "loading"));
  part.then((made) => place.replaceWith(made), (error) => {
    if (signal.aborted) return;
    place.removeAttribute("aria-busy");
    place.replaceChildren(h("p", { class: "problem", role: "alert" }, error.message));
  });
  return place;
}

function follow(root, id, signal) {
  // Not waited for: a view that is left while its job works must be able to end.
  result(root, id, signal).catch((error) => {
    if (signal.aborted) return;
    const missing = error instanceof Problem && error.status === 404;
    const heading = root.querySelector("h1") ? null : h("h1", {}, "Comparison");
    root.append(...[heading, h("p", { class: "problem", role: "alert" }, missing ? "There is no such comparison; it may have been deleted." : error.message),
      h("p", {}, h("a", { href: "#/compare" }, "All comparisons"))].filter(Boolean));
  });
}
