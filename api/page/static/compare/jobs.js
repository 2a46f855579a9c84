// The list of comparisons: how far each has come; open, cancel, delete.
import { ask, finished, post } from "../lib/api.js";
import { confirmed } from "../lib/confirm.js";
import { h, set, toast } from "../lib/dom.js";
import { number, when } from "../lib/format.js";

const PAGE = 10;
const TAGS = { succeeded: "good", failed: "bad", cancelled: "warn" };

export const path = (id) => `/v1/comparisons/${encodeURIComponent(id)}`;

export const place = (id) => `#/compare/${encodeURIComponent(id)}`;

export const title = ({ scenarios }) => scenarios.join(", ");

export const progressText = (job) => `${number(job.runs_done)} of ${number(job.runs)} run${job.runs === 1 ? "" : "s"}`;

export function stateTag(job) {
  return h("span", { class: `tag ${TAGS[job.state] ?? ""}` }, job.state);
}

export function reason({ state, problem, ...job }) {
  // Why a comparison has ended before its end; null where it has not.
  if (state === "cancelled") return `Cancelled after ${progressText(job)}.`;
  if (state !== "failed") return null;
  const fields = (problem?.errors ?? []).map(({ field, message }) => `${field}: ${message}`);
  return [`Failed after ${progressText(job)}: ${problem?.title ?? "no reason was given"}.`, problem?.detail, ...fields].filter(Boolean).join(" ");
}

export async function cancel(job) {
  return post(`${path(job.id)}/cancel`);
}

export async function remove(job) {
  // Delete after a question; whether it was done.
  if (!(await confirmed("Delete this comparison?", `${title(job)}: the figures of ${progressText(job)} are lost for good.`, "Delete"))) return false;
  await ask(path(job.id), { method: "DELETE" });
  return true;
}

export async function jobs(signal) {
  const list = h("ul", { class: "jobs" });
  const empty = h("p", { class: "empty" }, "No comparison yet. The form holds the thesis's: four controllers on four scenarios, done in seconds. Press ", h("b", {}, "Compare"), ".");
  const more = h("button", { type: "button", class: "plain", hidden: true }, "Show earlier ones");
  const tell = () => (empty.hidden = list.childElementCount > 0);
  let cursor = null;
  const next = async () => {
    const page = await ask(`/v1/comparisons?limit=${PAGE}${cursor ? `&cursor=${cursor}` : ""}`, { signal });
    list.append(...page.items.map((job) => line(job, signal, tell)));
    cursor = page.next;
    more.hidden = !cursor;
    tell();
  };
  more.addEventListener("click", () => next().catch((error) => toast(error.message, "problem")));
  await next();
  return h("section", { class: "card", "aria-labelledby": "earlier-title" }, h("h2", { id: "earlier-title" }, "Comparisons"), empty, list, more);
}

function line(first, signal, changed) {
  let job = first;
  const parts = {
    tag: h("span"), count: h("span", { class: "hint" }), why: h("p", { class: "why" }),
    bar: h("progress", { max: first.runs, "aria-label": `Progress of ${title(first)}` }),
    cancel: h("button", { type: "button", class: "plain", "aria-label": `Cancel ${title(first)}` }, "Cancel"),
    remove: h("button", { type: "button", class: "plain", "aria-label": `Delete ${title(first)}` }, "Delete"),
  };
  const show = (now) => {
    job = now;
    parts.tag.replaceChildren(stateTag(job));
    set(parts.count, progressText(job));
    parts.bar.value = job.runs_done;
    parts.bar.hidden = parts.cancel.hidden = Boolean(job.finished);
    parts.remove.hidden = !job.finished;
    set(parts.why, reason(job) ?? "");
    parts.why.hidden = !reason(job);
  };
  const made = h("li", { "data-id": first.id },
    h("div", { class: "what" }, h("a", { href: place(first.id) }, title(first)),
      h("span", { class: "hint" }, first.controllers.join(", ")),
      h("span", { class: "hint" }, `${when(first.created)} · seed ${first.seed}`)),
    h("div", { class: "how" }, parts.tag, parts.count), parts.bar, parts.why,
    h("div", { class: "actions" }, h("a", { class: "button plain", href: place(first.id), "aria-label": `Open ${title(first)}` }, "Open"), parts.cancel, parts.remove));
  const guarded = (doing) => () => doing().catch((error) => toast(error.message, "problem"));
  parts.cancel.addEventListener("click", guarded(async () => show(await cancel(job))));
  parts.remove.addEventListener("click", guarded(async () => {
    if (!(await remove(job))) return;
    made.remove();
    changed();
  }));
  show(first);
  if (!first.finished) finished(path(first.id), show, signal).catch(() => {});
  return made;
}
