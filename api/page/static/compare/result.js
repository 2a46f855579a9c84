// One comparison: how far it has come, and what has come of it.
import { ask, download, finished } from "../lib/api.js";
import { h, set, table, toast } from "../lib/dom.js";
import { number, when } from "../lib/format.js";
import { speak } from "../lib/speak.js";
import { Board } from "./board.js";
import { cancel, path, progressText, reason, remove, stateTag, title } from "./jobs.js";

export async function result(root, id, signal) {
  const job = await ask(path(id), { signal });
  const parts = { tag: h("span"), files: h("div", { class: "actions" }), working: h("div", { class: "view", hidden: true }), body: h("div", { class: "view" }) };
  root.append(
    h("p", { class: "back" }, h("a", { href: "#/compare" }, "All comparisons")),
    h("div", { class: "head" }, h("h1", {}, `Comparison of ${title(job)}`), parts.tag, parts.files),
    h("p", { class: "lead" }, [
      job.controllers.join(", "), `${number(job.replications)} replication${job.replications === 1 ? "" : "s"}`, `seed ${job.seed}`, when(job.created),
    ].join(" · ")),
    ...job.scenario_replications.filter(({ reason }) => reason).map(({ scenario, reason: why }) => h("p", { class: "hint" }, h("b", {}, scenario), `: ${why}.`)),
    parts.working, parts.body);
  parts.tag.replaceWith((parts.tag = stateTag(job)));
  const board = new Board(job, parts.body, signal);
  const done = job.finished ? job : await work(job, parts, board, signal);
  parts.tag.replaceWith((parts.tag = stateTag(done)));
  parts.files.append(...files(done));
  await shown(done, parts, board);
}

async function work(job, parts, board, signal) {
  // The bar while it works; the job when it has ended.
  const bar = h("progress", { max: job.runs, value: job.runs_done, "aria-label": "Runs done" });
  const count = h("p", {}, progressText(job));
  const stop = h("button", { type: "button", class: "danger" }, "Cancel");
  stop.addEventListener("click", () => cancel(job).then(() => (stop.disabled = true)).catch((error) => toast(error.message, "problem")));
  parts.working.hidden = false;
  parts.working.replaceChildren(h("section", { class: "card working" }, h("h2", {}, "Computing"), bar, count, h("div", { class: "actions" }, stop)));
  const done = await finished(path(job.id), (now) => {
    if (now.runs_done !== bar.value || now.finished) speak(progressText(now));
    bar.value = now.runs_done;
    set(count, now.state === "queued" ? `${progressText(now)}, waiting for a worker` : progressText(now));
    parts.tag.replaceWith((parts.tag = stateTag(now)));
    if (now.runs_done && !now.finished) board.follow(now);
  }, signal);
  parts.working.replaceChildren();
  parts.working.hidden = true;
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

async function shown(job, { working, body }, board) {
  const why = reason(job);
  if (why) working.append(h("div", { class: job.state === "failed" ? "problem" : "note" }, h("p", {}, why), job.problem?.run && failedRun(job.problem)));
  working.hidden = !why;
  if (job.runs_done) await board.end(job);
  else body.append(h("p", { class: "empty" }, "No run was done. ", h("a", { href: "#/compare" }, "Start another comparison"), "."));
}

function failedRun({ run, title: kind, detail }) {
  // Which run it was; the first that fails ends a comparison.
  return table("The run that failed", ["scenario", "controller", "replication", "reason"], [[run.scenario, run.controller, String(run.replication), [kind, detail].filter(Boolean).join(": ")]], { numeric: (column) => column === 2, wide: 3 });
}
