// What has come of a comparison so far: trade-off, bars and tables fill in while it works, and say that they are not whole.
import { ask } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { bars } from "./bars.js";
import { path, progressText, replicationsOf } from "./jobs.js";
import { tables } from "./tables.js";
import { timeline } from "./timeline.js";
import { tradeoff } from "./tradeoff.js";

const RUNS_DRAWN = 4000; // a cloud of more runs is a blot, and its table takes long to load
const REST = 800; // between two looks at what has come [ms]

export class Board {
  #shown = 0; // runs
  #rested = -Infinity;
  #busy = false;
  #turn = 0;

  constructor(job, place, signal) {
    Object.assign(this, { job, place, signal });
    this.missing = h("section", { class: "card coverage", "aria-label": "What is not done yet" });
    this.parts = { tradeoff: tradeoff(job.controllers), bars: bars(job.controllers), tables: tables(job.scenarios) };
    this.elements = Object.values(this.parts).map(({ element }) => element);
    this.marks = this.elements.map((element) => element.querySelector("h2")).map((heading) => {
      const mark = h("span", { class: "tag warn partial", hidden: true });
      heading.append(" ", mark);
      return mark;
    });
  }

  async follow(job) {
    // While it works: what has come since, not too often; what cannot be got now comes with the next look.
    if (this.#busy || job.runs_done === this.#shown || performance.now() - this.#rested < REST) return;
    this.#busy = true;
    await this.#renew(job).catch(() => {});
    this.#rested = performance.now();
    this.#busy = false;
  }

  async end(job) {
    // It has ended: all there is, and the schedule.
    const { results, scenarios } = await this.#renew(job);
    this.place.append(timeline(job, scenarios, job.controllers, results, this.signal));
  }

  async #renew(job) {
    const mine = ++this.#turn;
    const get = (name) => ask(`${path(job.id)}/${name}`, { signal: this.signal });
    const [figures, table, scenarios, runs] = await Promise.all([get("figures"), get("table"), get("scenarios"), job.runs_done <= RUNS_DRAWN ? get("results") : null]);
    if (mine !== this.#turn) return null; // what was asked for later is newer
    if (!this.#shown) this.place.append(this.missing, ...this.elements);
    this.#shown = job.runs_done;
    const done = job.scenarios.filter((name) => figures.items.some((item) => item.scenario === name));
    this.parts.tradeoff.renew(figures, done, runs?.results);
    this.parts.bars.renew(figures, done);
    this.parts.tables.renew(table, figures, replicationsOf(job));
    this.#mark(job, figures.items);
    return { results: runs?.results, scenarios };
  }

  #mark(job, items) {
    const partial = job.runs_done < job.runs;
    for (const mark of this.marks) {
      mark.hidden = !partial;
      mark.textContent = progressText(job);
    }
    this.missing.hidden = !partial;
    if (partial) this.missing.replaceChildren(...coverage(job, items));
  }
}

function coverage(job, items) {
  // What is missing: whole scenarios by their name, else the controllers of each.
  const runs = (scenario, controller) => items.find((item) => item.scenario === scenario && item.controller === controller)?.runs ?? 0;
  const replications = replicationsOf(job);
  const lines = job.scenarios.map((scenario) => {
    const whole = replications.get(scenario);
    const open = job.controllers.filter((controller) => runs(scenario, controller) < whole);
    const said = open.map((controller) => (runs(scenario, controller) ? `${controller} (${runs(scenario, controller)} of ${whole})` : controller));
    return open.length && h("li", {}, h("b", {}, scenario), ` ${open.length === job.controllers.length && !open.some((each) => runs(scenario, each)) ? "every controller" : said.join(", ")}`);
  });
  return [h("p", {}, h("b", {}, progressText(job)), ` done: what stands below is of ${job.runs_done === 1 ? "that one" : "those"} alone. ${job.finished ? "Not done:" : "Still to come:"}`), h("ul", {}, lines.filter(Boolean))];
}
