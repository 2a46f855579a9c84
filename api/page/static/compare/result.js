// One comparison: how far it has come, and what has come of it.
import { ask, download, finished } from "../lib/api.js";
import { h, set, toast } from "../lib/dom.js";
import { number, when } from "../lib/format.js";
import { bars } from "./bars.js";
import { cancel, path, progressText, reason, remove, stateTag, title } from "./jobs.js";
import { tables } from "./tables.js";
import { timeline } from "./timeline.js";
import { tradeoff } from "./tradeoff.js";

const RUNS_DRAWN = 4000; // a cloud of more runs is a blot, and its table takes long to load

export async function result(root, id, signal) {
  const job = await ask(path(id), { signal });
  const parts = { tag: h("span"), files: h("div", { class: "actions" }), body: h("div", { class: "view" }) };
  root.append(
    h("p", { class: "back" }, h("a", { href: "#/compare" }, "All comparisons")),
    h("div", { class: "head" }, h("h1", {}, `Comparison of ${title(job)}`), parts.tag, parts.files),
    h("p", { class: "lead" }, [
      job.controllers.join(", "), `${number(job.replications)} replication${job.replications === 1 ? "" : "s"}`, `seed ${job.seed}`, when(job.created),
    ].join(" · ")),
    parts.body);
  parts.tag.replaceWith((parts.tag = stateTag(job)));
  const done = job.finished ? job : await work(job, parts, signal);
  parts.tag.replaceWith((parts.tag = stateTag(done)));
  parts.files.append(...files(done));
  await shown(done, parts.body, signal);
}

async function work(job, parts, signal) {
  // The bar while it works; the job when it has ended.
  const bar = h("progress", { max: job.runs, value: job.runs_done, "aria-label": "Runs done" });
  const count = h("p", { role: "status" }, progressText(job));
  const stop = h("button", { type: "button", class: "danger" }, "Cancel");
  stop.addEventListener("click", () => cancel(job).then(() => (stop.disabled = true)).catch((error) => toast(error.message, "problem")));
  parts.body.replaceChildren(h("section", { class: "card working" }, h("h2", {}, "Computing"), bar, count, h("div", { class: "actions" }, stop)));
  const done = await finished(path(job.id), (now) => {
    bar.value = now.runs_done;
    set(count, now.state === "queued" ? `${progressText(now)}, waiting for a worker` : progressText(now));
    parts.tag.replaceWith((parts.tag = stateTag(now)));
  }, signal);
  parts.body.replaceChildren();
  return done;
}

function files(job) {
  const kinds = [["CSV", "results?format=csv", "csv"], ["Parquet", "results?format=parquet", "parquet"], ["Report", "report", "html"]];
  const save = (text, place, ending) => {
    const button = h("button", { type: "button", title: ending === "html" ? "One page that holds everything, as hrs compare --html writes it" : "Every run's figures" }, `${text} ↓`);
    button.addEventListener("click", () => {
      button.disabled = true;
      download(`${path(job.id)}/${place}`, `${job.id}.${ending}`).catch((error) => toast(error.message, "problem")).finally(() => (button.disabled = false));
    });
    return button;
  };
  const forget = h("button", { type: "button", class: "danger" }, "Delete");
  forget.addEventListener("click", () => remove(job).then((done) => done && (location.hash = "#/compare")).catch((error) => toast(error.message, "problem")));
  return [...(job.runs_done ? kinds.map((kind) => save(...kind)) : []), forget];
}

async function shown(job, body, signal) {
  const why = reason(job);
  if (why) body.append(h("p", { class: job.state === "failed" ? "problem" : "note" }, why, job.runs_done > 0 && " What was done until then stands below."));
  if (!job.runs_done) {
    body.append(h("p", { class: "empty" }, "No run was done. ", h("a", { href: "#/compare" }, "Start another comparison"), "."));
    return;
  }
  const [figures, found, scenarios, runs] = await Promise.all([
    ...["figures", "table", "scenarios"].map((name) => ask(`${path(job.id)}/${name}`, { signal })),
    job.runs_done <= RUNS_DRAWN ? ask(`${path(job.id)}/results`, { signal }) : null,
  ]);
  const done = job.scenarios.filter((name) => figures.items.some((item) => item.scenario === name));
  body.append(
    tradeoff(figures, job.controllers, done, runs?.results),
    bars(figures, job.controllers, done),
    tables(found),
    timeline(job, scenarios, job.controllers, runs?.results, signal));
}
