// What a measured twin knows of its station: health, readings against the model, what was detected, what is not known.
import { serviceClock } from "../lib/age.js";
import { ask } from "../lib/api.js";
import { h, set, table } from "../lib/dom.js";
import { clock, number, words } from "../lib/format.js";
import { agoWords, eventWords, healthWords, isUnix, readingWords } from "./followed_words.js";
import { ANALOG, HEALTH, PRECOOLER, SENSED } from "./measured.js";

const AGAIN = 2000; // between two looks [ms]
const LATE = 60; // measurements that are older are told as late [s]
const COUNTED = [["taken", "followed"], ["late", "too late"], ["empty", "empty"], ["ahead", "too far ahead"], ["duplicate", "told twice"]];
const COMMANDED = SENSED.filter((name) => name.startsWith("measured_")).map((name) => name.slice(9)).filter((name) => !ANALOG.includes(name));

const pairs = (names) => Object.fromEntries(names.map((name) => [name, h("dd", { "data-value": name }, "–")]));
const listed = (places, title) => h("dl", { class: "figures" }, Object.entries(places).map(([name, place]) => h("div", {}, h("dt", {}, title(name)), place)));

export class Followed {
  // `health.followed` is the newest estimate, for scripts.
  begun = false; // whether a second was followed: before that there is nothing to ask for

  constructor(path, readings, signal) {
    this.path = path;
    this.readings = readings; // what was read when
    this.signal = signal;
    this.#health();
    this.#sensors();
    this.#measurements();
    this.#detected();
    signal.addEventListener("abort", () => clearTimeout(this.timer));
  }

  #health() {
    const names = [...HEALTH, PRECOOLER];
    this.verdicts = Object.fromEntries(names.map((name) => [name, { figure: h("b", {}, "–"), word: h("span", { class: "tag" }, "not known") }]));
    const places = names.map((name) => h("div", { "data-health": name }, h("dt", {}, healthWords(name).title), h("dd", {}, this.verdicts[name].word, this.verdicts[name].figure)));
    this.precooler = places.pop(); // stands there once the model is known to have one
    this.parts = h("dl", { class: "verdicts" }, places);
    this.unknown = h("p", { class: "unknown" });
    this.refused = h("p", { class: "problem", hidden: true, "data-value": "refused" });
    this.health = h("section", { class: "card health", "aria-label": "Health" }, h("div", { class: "head" }, h("h2", {}, "Health"), h("p", { class: "hint" }, "estimates ± 2 standard deviations")),
      this.refused, this.parts, this.unknown);
  }

  #sensors() {
    this.cells = Object.fromEntries(ANALOG.map((name) => [name, ["reading", "model", "residual", "word"].map((kind) => h("span", { "data-value": `${kind}_${name}` }, "–"))]));
    const shown = table("Newest readings; what the model expected, ± 2 standard deviations; the residuals", ["sensor", "measured", "model", "residual", "says"],
      ANALOG.map((name) => [words(name), ...this.cells[name]]), { numeric: (column) => column < 4, wide: 4 });
    this.silent = h("p", { class: "silent" });
    this.sensors = h("section", { class: "card sensors", "aria-label": "Measured against model" }, h("h2", {}, "Measured against model"), shown, this.silent);
  }

  #measurements() {
    this.counts = pairs(["newest", "measured", "number", ...COUNTED.map(([name]) => name)]);
    const titles = { newest: "newest second", measured: "measured", number: "last batch", ...Object.fromEntries(COUNTED.map(([name, title]) => [name, `samples ${title}`])) };
    this.waiting = h("p", { class: "hint", role: "status" }, "No second is followed yet: the first minute is followed at once when it is there.");
    this.about = listed(this.counts, (name) => titles[name]);
    this.about.hidden = true;
    this.measurements = h("section", { class: "card measurements", "aria-label": "Measurements" }, h("h2", {}, "Measurements"), this.waiting, this.about);
  }

  #detected() {
    this.none = h("p", { class: "hint" }, "No second is followed yet.");
    this.list = h("ol", { class: "detections", tabindex: "0", "aria-label": "What was detected, the newest first" });
    this.list.hidden = true;
    this.detected = h("section", { class: "card detected", "aria-label": "Detected" }, h("h2", {}, "Detected"), this.none, this.list);
  }

  async follow(alive) {
    // Again and again while the twin lives and somebody looks; of one that has ended once.
    this.alive = alive;
    clearTimeout(this.timer);
    if (this.begun && (!document.hidden || !alive)) await this.#renew().catch(() => {}); // the view says how old it is
    if (this.alive && !this.signal.aborted) this.timer = setTimeout(() => this.follow(this.alive), AGAIN);
  }

  async #renew() {
    const found = await ask(`${this.path}/estimate`, { signal: this.signal });
    this.health.followed = found;
    this.waiting.hidden = true;
    this.about.hidden = false;
    this.#judge(found);
    this.#compare(found);
    this.#count(found);
    this.#list(found);
  }

  #judge({ quantities, health, unknown, refused }) {
    this.refused.hidden = !refused.length;
    set(this.refused, `The model does not fit the last hour: another station, a clock that is off, or parameters that are. No leak or weakness that it tells counts. ${refused.join(" · ")}`);
    if (PRECOOLER in quantities) this.parts.append(this.precooler);
    const judgedHere = Object.keys(this.verdicts);
    for (const name of judgedHere) {
      const { figure, word } = this.verdicts[name];
      const said = healthWords(name, quantities[name], health[name]);
      set(figure, said.figure);
      set(word, said.word);
      word.className = `tag ${said.tone}`;
    }
    const names = unknown.filter((name) => !judgedHere.includes(name)).map(words);
    const judged = unknown.filter((name) => judgedHere.includes(name)).map((name) => healthWords(name).title.toLowerCase());
    const all = [...judged, ...names];
    set(this.unknown, all.length ? `Not known: ${all.join(", ")}.` : "Everything that is estimated is known.");
  }

  #compare({ sensors, seq, lasting }) {
    for (const name of ANALOG) {
      const [reading, model, residual, word] = this.cells[name];
      const said = readingWords(name, sensors[name], { silent: this.readings.silent(name, seq), told: this.readings.told(name), lasting });
      for (const [place, text] of [[reading, said.reading], [model, said.model], [residual, said.residual], [word, said.word]]) set(place, text);
      word.className = said.tone ? `tag ${said.tone}` : "";
    }
    const away = COMMANDED.map((name) => [name, this.readings.silent(name, seq)]).filter(([, silent]) => silent !== null);
    set(this.silent, away.length ? `Not read: ${away.map(([name, silent]) => `${words(name)} for ${number(silent)} s`).join(", ")}.` : "Every valve and the vehicle are read.");
  }

  #count({ seq, source_time: time, number: batch, samples }) {
    const ago = (Date.now() - serviceClock.here(1000 * time)) / 1000;
    set(this.counts.newest, clock(seq));
    set(this.counts.measured, agoWords(time, ago));
    this.counts.measured.classList.toggle("late", isUnix(time) && ago > LATE);
    set(this.counts.number, number(batch));
    for (const [name] of COUNTED) set(this.counts[name], number(samples?.[name]));
  }

  #list({ events, seq, source_time: time, lasting }) {
    const first = time - seq; // of the first second, where the twin's clock begins
    const said = JSON.stringify([events, lasting]);
    if (this.said === said) return;
    this.said = said;
    set(this.none, "Nothing was detected.");
    this.none.hidden = events.length > 0;
    const sorted = events.toSorted((one, other) => other.found_s - one.found_s);
    const lasts = new Set(lasting?.map((name) => sorted.find((event) => event.name === name)));
    this.list.hidden = !events.length;
    this.list.replaceChildren(...sorted.map((event) => h("li", { "data-event": event.name },
      h("b", {}, words(event.name)), lasts.has(event) && h("span", { class: "tag bad" }, "lasts"),
      h("span", { class: "details" }, eventWords(event, first)))));
  }
}

