// The calibration of a measured twin's station: begun, followed, told in words, and put to use.
import { ask, finished, post } from "../lib/api.js";
import { alarm, h, set, table, toast } from "../lib/dom.js";
import { clock, number, when, words } from "../lib/format.js";
import { parameterWords, verdictWords } from "./calibrated_words.js";

const LISTED = 50; // the newest calibrations, among which this twin's last one is looked for

const path = (id) => `/v1/calibrations/${encodeURIComponent(id)}`;

export class Calibrating {
  #following = null; // id of the one that is shown

  constructor(twin, changed, signal) {
    Object.assign(this, { twin, changed, signal });
    this.begin = h("button", { type: "button", onclick: () => this.#begin() }, "Calibrate");
    this.cancel = h("button", { type: "button", class: "plain", hidden: true, onclick: () => this.#cancel() }, "Cancel");
    this.bar = h("progress", { max: 1, hidden: true, "aria-label": "Progress of the calibration" });
    this.said = h("p", { class: "hint", role: "status" }, "Finds the station's parameters from what was measured: six hours at least, a day at most. The last quarter decides whether they count.");
    this.wrong = h("p", { role: "alert", hidden: true });
    this.use = h("button", { type: "button", class: "primary", hidden: true, onclick: () => this.#use() }, "Use it");
    this.found = h("div", { class: "calibrated" });
    this.element = h("section", { class: "card calibration", "aria-label": "Calibration" }, h("div", { class: "head" }, h("h2", {}, "Calibration"), this.begin),
      this.said, this.bar, this.wrong, this.found, h("div", { class: "actions" }, this.use, this.cancel));
    this.#last().catch(() => {});
  }

  show(state) {
    this.state = state;
    this.#offer();
  }

  async #last() {
    // What was found before is shown again.
    const { items } = await ask(`/v1/calibrations?limit=${LISTED}`, { signal: this.signal });
    const last = items.find(({ twin }) => twin === this.twin);
    if (last && this.#following === null) await this.#follow(last.id);
  }

  async #begin() {
    alarm(this.wrong, "");
    try {
      const { id } = await post("/v1/calibrations", { twin: this.twin });
      await this.#follow(id);
    } catch (error) {
      if (!this.signal.aborted) alarm(this.wrong, error.message);
    }
  }

  async #follow(id) {
    this.#following = id;
    const job = await finished(path(id), (now) => this.#following === id && this.#told(now), this.signal);
    if (this.#following !== id) return;
    const whole = job.result ? await ask(path(id), { signal: this.signal }) : job;
    this.#ended(whole);
  }

  #told(job) {
    const working = !job.finished;
    for (const each of [this.bar, this.cancel]) each.hidden = !working;
    this.begin.hidden = working;
    this.bar.value = job.progress;
    if (working) {
      this.found.replaceChildren();
      set(this.said, `${job.state === "queued" ? "Waits for a worker" : `${number(100 * job.progress)} % done`}: seconds ${clock(job.from_s)} to ${clock(job.to_s)}.`);
    }
    this.job = job;
    this.#offer();
  }

  #ended(job) {
    this.job = job;
    const span = `${clock(job.from_s)} to ${clock(job.to_s)}, ${when(job.created)}`;
    set(this.said, `${verdictWords(job)} (${span})`);
    this.found.replaceChildren(...(job.result ? this.#result(job.result) : []));
    this.#offer();
  }

  #result({ parameters, unknown, refused }) {
    const rows = Object.entries(parameters).filter(([, { known }]) => known).map(([name, each]) => {
      const said = parameterWords(name, each);
      return [said.title, said.value, said.interval];
    });
    const left = unknown.map((name) => parameterWords(name, parameters[name]).title);
    return [
      refused.length && h("ul", { class: "problem" }, refused.map((line) => h("li", {}, words(line)))),
      rows.length && table("What was found, with 95 % intervals", ["parameter", "found", "between"], rows, { wide: 2 }),
      left.length && h("p", { class: "unknown" }, `Not known: ${left.join(", ")}.`),
    ].filter(Boolean);
  }

  #offer() {
    // What was accepted can be used, once, while the twin lives.
    const alive = ["running", "paused"].includes(this.state?.state);
    const { job } = this;
    this.begin.disabled = !this.state?.samples;
    this.use.hidden = !(alive && job?.result?.verdict === "accepted" && this.state.calibration !== job.id);
  }

  async #cancel() {
    await post(`${path(this.#following)}/cancel`).catch((error) => toast(error.message, "problem"));
  }

  async #use() {
    try {
      this.changed(await post(`/v1/twins/${this.twin}/station`, { calibration: this.job.id }));
      toast("from the next second on the calibrated station is followed: estimates come again after a minute");
    } catch (error) {
      toast(error.message, "problem");
    }
  }
}
