// What next: futures of a simulated twin under several controllers, their ranking, and the fan of the pressures.
import { ask, post } from "../lib/api.js";
import { field, h, s, set, table, toast } from "../lib/dom.js";
import { clock, number, quantity, words } from "../lib/format.js";
import { decimal, submit, suggested } from "./forms.js";
import { unitWords } from "./followed_words.js";
import { ALIVE, BUFFERS } from "./names.js";

const AGAIN = 5000; // between two looks at what has come [ms]
const ASK = 300; // between two looks at a forecast that is not done [ms]
const CONTROLLERS = ["logic, minlp1, reserve", "logic, minlp1, switched"];
const ARRIVALS = [["law", "by the scenario's law"], ["learned", "as they came so far"], ["announced", "only those announced"]];
const FAULTS = [["last", "last"], ["mended", "are mended now"]];
const WIDTH = 640;
const HEIGHT = 170;

const band = ({ low, median, high }, unit, digits = 0) =>
  median === null ? "–" : `${unit ? quantity(median, unit, digits) : number(median, digits)} (${number(low, digits)} to ${number(high, digits)})`;

export function fanOf(times, pressures) {
  // A picture of the bands of the buffers: 5 to 95 %, and the median.
  const all = BUFFERS.flatMap((name) => [...pressures[name].low, ...pressures[name].high]);
  const [least, most] = [Math.min(...all), Math.max(...all)];
  const x = (time) => (68 + ((time - times[0]) / (times.at(-1) - times[0])) * (WIDTH - 76)).toFixed(1);
  const y = (bar) => (HEIGHT - 22 - ((bar - least) / Math.max(most - least, 1)) * (HEIGHT - 34)).toFixed(1);
  const line = (values) => values.map((bar, place) => `${x(times[place])},${y(bar)}`);
  const label = (text, place, down, anchor) => s("text", { x: String(place), y: String(down), "text-anchor": anchor, class: "label" }, text);
  return s("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", class: "fan", "aria-label": "Pressures of the buffers in the futures: 5 to 95 %, and the median" },
    BUFFERS.map((name) => [
      s("polygon", { class: name, points: [...line(pressures[name].low), ...line(pressures[name].high).reverse()].join(" ") }),
      s("polyline", { class: name, points: line(pressures[name].median).join(" ") }),
    ]),
    label(quantity(most, "bar"), 62, 16, "end"), label(quantity(least, "bar"), 62, HEIGHT - 20, "end"),
    label(clock(times[0]), 68, HEIGHT - 4, "start"), label(clock(times.at(-1)), WIDTH - 8, HEIGHT - 4, "end"));
}

export function cameWords(came) {
  // How a forecast that was made before has held.
  if (!came) return "";
  if (came.changed) return `Another controller decided meanwhile: until ${clock(came.until_s)} nothing is held against it.`;
  const within = came.covered === null ? "every future agrees" : `${number(100 * came.covered)} % of the pressures lay within the bands (90 % should)`;
  return `Until ${clock(came.until_s)}, ${within}; median distance ${quantity(came.error, "bar", 1)}.`;
}

export function faultWords({ faults, mended, doubt }) {
  // What the futures have of the station's faults.
  if (mended) return "As if the faults of the station were mended now.";
  if (doubt) return `Without the faults that were found: ${doubt}.`;
  if (!faults.length) return "";
  return `In every future: ${faults.map((each) => [words(each.event), each.size !== null && quantity(each.size, unitWords(each.unit), 1), `since ${clock(each.begin_s)}`].filter(Boolean).join(" ")).join("; ")}.`;
}

export class Forecasts {
  #shown = null; // the forecast whose answer stands there
  #alive = true;

  constructor(path, series, seated, signal) {
    this.path = path;
    this.series = series;
    this.seated = seated; // hears of the twin's state when a controller was put in the slot
    this.signal = signal;
    const [controllers, list] = suggested(CONTROLLERS, { name: "controllers", value: CONTROLLERS[0] });
    const input = (name, value) => h("input", { type: "text", inputmode: "decimal", autocomplete: "off", name, value });
    const [hours, futures] = [input("horizon_s", "1"), input("futures", "100")];
    const arrivals = h("select", { name: "arrivals" }, ARRIVALS.map(([value, text]) => h("option", { value }, text)));
    const faults = h("select", { name: "faults" }, FAULTS.map(([value, text]) => h("option", { value }, text)));
    const controls = { controllers, horizon_s: hours, futures, arrivals, faults };
    this.button = h("button", {}, "Forecast");
    this.form = h("form", { class: "control forecast-form", name: "forecast", novalidate: true, onsubmit: (event) => {
      event.preventDefault();
      submit(this.form, controls, () => this.#ask(controllers.value, decimal(hours.value), decimal(futures.value), arrivals.value, faults.value));
    } }, field("Candidates", controllers, { hint: "separated by commas; the one that acts is compared in any case" }), list,
    field("Look ahead", hours, { unit: "h" }), field("Futures", futures, { hint: "of each controller" }), field("Vehicles to come", arrivals), field("Faults of the station", faults), this.button);
    this.progress = h("p", { class: "hint", role: "status" });
    this.found = h("div", { class: "forecast-found" });
    this.came = h("p", { class: "forecast-came" });
    this.element = h("section", { class: "card forecast", "aria-label": "What next" }, h("h2", {}, "What next"), this.form, this.progress, this.found, this.came);
    const timer = setInterval(() => !document.hidden && this.#look(), AGAIN);
    signal.addEventListener("abort", () => clearInterval(timer));
  }

  show(state) {
    this.state = state;
    this.#alive = ALIVE.has(state.state);
    for (const each of this.form.elements) each.disabled = !this.#alive;
    for (const each of this.found.querySelectorAll("button")) each.hidden = !this.#seats(state, each.dataset.controller);
  }

  #seats(state, controller) {
    // A station that is measured has a controller of its own, which nobody here can change.
    return this.#alive && state.source === "simulated" && controller !== state.controller;
  }

  async #ask(controllers, hours, futures, arrivals, faults) {
    const names = controllers.split(",").map((name) => name.trim()).filter(Boolean);
    const horizon = typeof hours === "number" ? Math.round(3600 * hours) : hours;
    let job = await post(`${this.path}/forecasts`, { controllers: names, horizon_s: horizon, futures, arrivals, faults });
    while (!job.finished && !this.signal.aborted) {
      set(this.progress, `${job.done} of ${job.names.length} controllers`);
      await new Promise((done) => setTimeout(done, ASK));
      job = await ask(`/v1/forecasts/${job.id}`, { signal: this.signal });
    }
    set(this.progress, "");
    if (!job.answer) throw new Error(`the forecast ${job.state}: ${job.problem?.detail ?? ""}`);
    this.#put(job);
  }

  #put(job) {
    this.#shown = job;
    const [acting] = job.answer.controllers;
    const figures = new Map(job.answer.controllers.map((each) => [each.controller, each.figures]));
    const rows = job.answer.ranking.map(({ controller, beats }) => {
      const { wait, served, energy, cost } = figures.get(controller);
      const acts = controller === acting.controller;
      const seat = h("button", { type: "button", class: "plain", "data-controller": controller, hidden: !this.#seats(this.state, controller), onclick: () => this.#seat(controller) }, "Let it decide");
      return [controller, band(wait, "s"), band(served, ""), band(energy, "kWh"), band(cost, "EUR", 1), acts ? (this.state.source === "simulated" ? "acts" : "compared with") : `${number(100 * beats)} %`, seat];
    });
    const title = `${quantity(job.horizon_s / 3600, "h", job.horizon_s % 3600 ? 1 : 0)} from ${clock(job.begin_s)} on, ${number(job.futures)} futures: median (5 to 95 %), least cost and waiting first`;
    this.found.replaceChildren(
      h("p", { class: "advice" }, job.answer.advice),
      h("p", { class: "hint forecast-faults" }, faultWords(job)),
      table(title, ["Controller", "Wait", "Served", "Energy", "Cost", "Beats it in", ""], rows, { numeric: (column) => column < 6 }),
      h("h3", {}, `Buffers under ${acting.controller}`, h("span", { class: "unit" }, " [bar]")),
      fanOf(job.answer.time_s, acting.pressures));
    this.series.fan = { times: job.answer.time_s, pressures: acting.pressures };
    set(this.came, "");
  }

  async #seat(controller) {
    await ask(this.path, { method: "PATCH", body: { controller } }).then((state) => {
      toast(`controller: ${controller}`);
      this.seated(state);
    }, (error) => toast(error.message, "problem"));
  }

  async #look() {
    // What has come of the forecast that is shown.
    if (!this.#shown) return;
    const now = await ask(`/v1/forecasts/${this.#shown.id}`, { signal: this.signal }).catch(() => null);
    if (now && now.id === this.#shown.id) set(this.came, cameWords(now.came));
  }
}
