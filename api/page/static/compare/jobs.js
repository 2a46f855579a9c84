// The list of comparisons: how far each has come; open, cancel, delete.
import { repeated } from "../lib/age.js";
import { ask, post } from "../lib/api.js";
import { confirmed } from "../lib/confirm.js";
import { h, set, toast } from "../lib/dom.js";
import { number, when } from "../lib/format.js";
import { List } from "../lib/list.js";

const NEWEST = 20; // asked for again and again
const LOADED = 200; // at first, and for each click
const EVERY = 1500; // [ms]
const TAGS = { succeeded: "good", failed: "bad", cancelled: "warn" };

export const path = (id) => `/v1/comparisons/${encodeURIComponent(id)}`;

export const place = (id) => `#/compare/${encodeURIComponent(id)}`;

export const title = ({ scenarios }) => scenarios.join(", ");

// How often each scenario is run: once where nothing in it is drawn. By name.
export const replicationsOf = (job) => new Map(job.scenario_replications.map(({ scenario, replications }) => [scenario, replications]));

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

const order = ({ created, id }) => `${created} ${id}`;

export async function jobs(signal) {
  const known = new Map(); // the newest first
  const list = new List({
    label: "comparisons", className: "jobs", line: (job) => new Line(job, renew), kind: ({ state }) => state,
    text: ({ id, scenarios, controllers, created }) => [id, ...scenarios, ...controllers, when(created)].join(" "),
    empty: h("p", { class: "empty" }, "No comparison yet. The form holds the thesis's: four controllers on four scenarios, done in seconds. Press ", h("b", {}, "Compare"), "."),
  });
  const more = h("button", { type: "button", class: "plain", hidden: true, onclick: () => earlier().catch((error) => toast(error.message, "problem")) }, "Load earlier ones");
  const got = (limit, cursor) => ask(`/v1/comparisons?limit=${limit}${cursor ? `&cursor=${cursor}` : ""}`, { signal });
  let cursor = null;

  const put = (items) => {
    for (const job of items) known.set(job.id, job);
    list.show([...known.values()].sort((one, other) => (order(one) < order(other) ? 1 : -1)));
    more.hidden = !cursor;
  };

  async function earlier() {
    const page = await got(LOADED, cursor);
    cursor = page.next;
    put(page.items);
  }

  async function renew() {
    // The newest ones, and what is at work behind them; what is gone from among the newest was deleted.
    const { items, next } = await got(NEWEST);
    const ids = new Set(items.map(({ id }) => id));
    for (const { id, created } of [...known.values()]) if (!ids.has(id) && (!next || created > items.at(-1).created)) known.delete(id);
    const others = [...known.values()].filter((job) => !job.finished && !ids.has(job.id));
    put([...items, ...(await Promise.all(others.map(({ id }) => ask(path(id), { signal }))))]);
  }

  await earlier();
  repeated(EVERY, renew, signal).catch(() => {});
  return h("section", { class: "card", "aria-labelledby": "earlier-title" }, h("h2", { id: "earlier-title" }, "Comparisons"), list.element, more);
}

class Line {
  constructor(job, renew) {
    this.tag = h("span");
    this.count = h("span", { class: "hint" });
    this.why = h("p", { class: "why" });
    this.bar = h("progress", { max: job.runs, "aria-label": `Progress of ${title(job)}` });
    const guarded = (doing) => () => doing().then(renew).catch((error) => toast(error.message, "problem"));
    this.cancel = h("button", { type: "button", class: "plain", "aria-label": `Cancel ${title(job)}`, onclick: guarded(() => cancel(this.job)) }, "Cancel");
    this.remove = h("button", { type: "button", class: "plain", "aria-label": `Delete ${title(job)}`, onclick: guarded(() => remove(this.job)) }, "Delete");
    this.element = h("li", { "data-id": job.id },
      h("div", { class: "what" }, h("a", { href: place(job.id) }, title(job)),
        h("span", { class: "hint" }, job.controllers.join(", ")),
        h("span", { class: "hint" }, `${when(job.created)} · seed ${job.seed}`)),
      h("div", { class: "how" }, this.tag, this.count), this.bar, this.why,
      h("div", { class: "actions" }, h("a", { class: "button plain", href: place(job.id), "aria-label": `Open ${title(job)}` }, "Open"), this.cancel, this.remove));
    this.show(job);
  }

  show(job) {
    this.job = job;
    if (this.tag.textContent !== job.state) this.tag.replaceChildren(stateTag(job));
    set(this.count, progressText(job));
    this.bar.value = job.runs_done;
    this.bar.hidden = this.cancel.hidden = Boolean(job.finished);
    this.remove.hidden = !job.finished;
    set(this.why, reason(job) ?? "");
    this.why.hidden = !reason(job);
  }
}
