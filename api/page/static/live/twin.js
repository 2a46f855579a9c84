// One twin: its station, its series, its events, its controls; kept up by the stream.
import { STALE, age } from "../lib/age.js";
import { ask, listed } from "../lib/api.js";
import { h, set, toast } from "../lib/dom.js";
import { clock } from "../lib/format.js";
import { follow } from "../lib/stream.js";
import { Alarms } from "./alarms.js";
import { Calibrating } from "./calibrating.js";
import { Controls } from "./controls.js";
import { Days } from "./days.js";
import { Drills } from "./drills.js";
import { Events } from "./events.js";
import { Figures } from "./figures.js";
import { Followed } from "./followed.js";
import { Forecasts } from "./forecast.js";
import { History } from "./history.js";
import { HELD, Readings } from "./measured.js";
import { ALIVE, isMeasured, speedWords } from "./names.js";
import { Notes } from "./notes.js";
import { Past } from "./past.js";
import { watchTwins } from "./presence.js";
import { replayForm } from "./replaying.js";
import { recordOf } from "./records.js";
import { Schematic } from "./schematic.js";
import { Series } from "./series.js";
import { Shadow } from "./shadow.js";
import { tagsOf } from "./twins.js";

const CHANGES = new Set(["paused", "continued", "speed_changed", "controller_changed", "stopped", "finished", "station_changed"]);

class Twin {
  #due = 0;
  #newest = null;
  #told = 0; // when the newest sample or event was sent [s]
  #streaming = new AbortController();

  constructor(state, scenario, source, signal) {
    this.id = state.id;
    this.path = `/v1/twins/${state.id}`;
    this.signal = signal;
    this.measured = isMeasured(state); // or a replay of one that is
    this.replay = state.source === "replay";
    const record = recordOf(state);
    this.history = new History(state.id, record, signal);
    this.series = new Series(this.history, record, scenario.station, signal);
    this.schematic = new Schematic(scenario, signal, { decided: !this.measured });
    this.events = new Events(state.id, signal);
    this.past = new Past(this.path, this.measured ? HELD : 0, (time, rows) => this.#look(time, rows), signal);
    this.series.pointed = (time) => this.past.point(time);
    if (this.measured) {
      this.readings = new Readings();
      this.followed = new Followed(this.path, this.readings, signal);
    } else if (!this.replay) {
      this.days = new Days(this.path, signal);
      this.drills = new Drills(this.path, signal);
    }
    if (!this.replay) this.forecasts = new Forecasts(this.path, this.series, (changed) => this.show(changed), signal);
    if (!this.replay) this.shadow = new Shadow(this.path, signal);
    if (!this.replay) this.alarms = new Alarms(this.path, signal);
    this.controls = new Controls(state.id, scenario, (changed) => this.show(changed), { source: state.source });
    if (state.source === "measured") this.calibrating = new Calibrating(state.id, (changed) => this.show(changed), signal);
    this.figures = new Figures(this.path, this.series.span, state.from_s ?? 0, signal);
    this.notes = new Notes(this.path, this.series, signal);
    this.replaying = replayForm(state, this.series.span);
    this.tags = h("p", { class: "tags" });
    this.facts = h("p", { class: "facts" });
    signal.addEventListener("abort", () => this.#streaming.abort());
    this.source = source;
    age.addEventListener("change", () => this.#mark(), { signal });
  }

  put(root, others) {
    this.choice = h("select", { "aria-label": "Twin", onchange: (event) => (location.hash = `#/live/${event.target.value}`) });
    this.choose(others);
    root.append(
      h("div", { class: "head twin-head" }, h("div", { class: "title" }, h("h1", {}, this.id), this.tags), this.choice,
        h("a", { class: "button", href: "#/live" }, "All twins"), this.controls.pause, this.controls.end),
      this.facts,
      ...(this.measured ? this.#following() : [
        this.schematic.element,
        this.alarms?.element ?? [],
        h("div", { class: "work" }, this.series.element, h("div", { class: "beside" }, this.controls.element, this.events.element)),
        this.forecasts?.element ?? [],
        this.shadow?.element ?? [],
        this.days?.element ?? [],
        this.drills?.element ?? [],
      ]),
      this.figures.element,
      this.notes.element,
      this.replaying,
    );
  }

  #following() {
    // A measured twin has nothing to be set, and no figures by day: what its measurements say stands there.
    const { health, sensors, measurements, detected } = this.followed;
    const work = (wide, ...beside) => h("div", { class: "work" }, wide, h("div", { class: "beside" }, beside));
    const controls = this.replay ? [this.controls.element] : [];
    return [health, this.schematic.element, this.alarms?.element ?? [], work(sensors, detected, measurements), work(this.series.element, ...controls, this.events.element), this.forecasts?.element ?? [], this.shadow?.element ?? [], this.calibrating?.element ?? []].flat();
  }

  choose(others) {
    // One of these twins can be shown instead; one that took the name of this one is.
    const again = others.find(({ id }) => id === this.id);
    if (again && this.#streaming.signal.aborted && again.created !== this.created) return window.dispatchEvent(new Event("hashchange"));
    const ids = others.map(({ id }) => id);
    this.choice.hidden = ids.length < 2;
    if (this.choice.dataset.said === String(ids)) return;
    this.choice.dataset.said = String(ids);
    this.choice.replaceChildren(...ids.map((id) => h("option", { value: id, selected: id === this.id }, id)));
  }

  show(state) {
    this.state = state;
    const said = `${state.state} ${state.service}`;
    if (this.tags.dataset.said !== said) this.tags.replaceChildren(...tagsOf(state));
    this.tags.dataset.said = said;
    if (this.replay) set(this.facts, `Plays ${clock(state.from_s)} to ${clock(state.to_s)} of ${state.of} · station ${state.station} · ${speedWords(state.speed)}`);
    else if (this.measured) set(this.facts, `Follows measurements by the model of station ${state.station} · scenario ${state.scenario}`);
    else {
      const origin = state.of === null ? "" : ` · began as ${state.of} at ${clock(state.at_s)}`;
      set(this.facts, `Scenario ${state.scenario} · station ${state.station} · controller ${state.controller} · ${speedWords(state.speed)} · at the end: ${state.at_end}${origin}`);
    }
    this.controls.show(state);
    this.forecasts?.show(state);
    this.shadow?.show(state);
    this.drills?.show(state);
    this.calibrating?.show(state);
    this.schematic.rest(state.state !== "running");
    if (state.values) this.#draw(state.values);
    this.#mark();
  }

  #mark() {
    this.schematic.stale(age.stale && ALIVE.has(this.state?.state), this.#newest?.time);
  }

  #draw(values) {
    if (this.#newest && values.time < this.#newest.time && this.epoch === this.drawn) return;
    if (this.measured) {
      this.readings.take(values);
      this.followed.begun = true;
    }
    this.#newest = values;
    this.drawn = this.epoch;
    if (this.past.time !== null) return;
    this.#due ||= requestAnimationFrame(() => {
      this.#due = 0;
      if (this.past.time === null) this.schematic.show(this.readings?.picture(this.#newest) ?? this.#newest);
    });
  }

  #look(time, rows) {
    // Picture and events follow the cursor of the series.
    this.schematic.past(time !== null);
    this.events.mark(time);
    if (time === null) {
      if (this.#newest) this.schematic.show(this.readings?.picture(this.#newest) ?? this.#newest);
      return;
    }
    const readings = this.measured ? new Readings() : null;
    for (const values of rows) readings?.take(values);
    this.schematic.show(readings?.picture(rows.at(-1)) ?? rows.at(-1));
  }

  #begin(state) {
    // At the start, and behind every lost connection: what a killed service told last may not have been stored.
    const another = this.created !== state.created;
    if (another) {
      this.events.restart();
      this.readings?.restart();
    }
    if (another || this.epoch !== state.epoch) {
      this.history.restart(state.samples);
      this.past.restart();
    } else this.history.extend(state.samples);
    [this.created, this.epoch] = [state.created, state.epoch];
    this.show(state);
    this.series.grow();
    if (another) this.series.begin();
    this.alarms?.show(ALIVE.has(state.state));
    this.followed?.follow(ALIVE.has(state.state));
  }

  async #hear(kind, data) {
    if (this.signal.aborted) return;
    if (kind === "heartbeat") this.#beat(data);
    else if (kind === "event") {
      this.#told = Math.max(this.#told, data.sent);
      this.events.add([data]);
      if (data.kind === "alarm") this.alarms?.renew();
      if (data.kind === "drill") this.drills?.renew();
      if (CHANGES.has(data.kind)) await this.#renew();
    } else if (kind === "sample" && data.epoch === this.epoch) {
      this.#told = Math.max(this.#told, data.sent);
      this.#draw(data.values);
      this.drills?.took(data.values.time);
      this.history.take(data.values);
      if (data.service !== this.state.service) await this.#renew();
    }
  }

  #beat({ sent, state }) {
    // All that was told until then is here.
    this.events.begin();
    // A twin that should run and tells nothing is as old as what it told last; a measured one tells when it is told.
    const silent = state === "running" && (!this.measured || this.replay) && this.#told && 1000 * (sent - this.#told) > STALE;
    this.source.told(1000 * (silent ? this.#told : sent));
    if (state !== this.state.state) this.#renew();
  }

  async #renew() {
    // A burst of changes is asked about once.
    clearTimeout(this.timer);
    this.timer = setTimeout(async () => {
      const state = await ask(this.path, { signal: this.signal }).catch(() => null);
      if (!state || state.epoch !== this.epoch) return;
      this.history.extend(state.samples);
      this.series.grow();
      this.show(state);
      if (!ALIVE.has(state.state)) this.#end(state).catch((error) => this.signal.aborted || toast(error.message, "problem"));
    }, 50);
  }

  async #end(state) {
    this.alarms?.show(false);
    this.followed?.follow(false);
    // One that has ended has no stream, or one that was left before its end: its last events are read once.
    const { items } = await ask(`${this.path}/events?before=${state.events}&limit=100`, { signal: this.signal });
    this.events.add(items);
    await this.events.begin();
    this.#streaming.abort();
    age.drop(this.source); // nothing more comes: what counts is whether the service answers
  }

  async run(state) {
    this.#begin(state);
    if (!ALIVE.has(state.state)) return this.#end(state);
    const opened = async () => {
      const answered = this.source.asked();
      const now = await ask(this.path, { signal: this.signal });
      answered();
      this.#begin(now);
      if (!ALIVE.has(now.state)) await this.#end(now);
    };
    await follow(`${this.path}/stream`, { signal: this.#streaming.signal, opened, told: (kind, data) => this.#hear(kind, data) });
  }
}

const missing = (title, words) => [h("h1", {}, title), h("p", { class: "lead", role: "alert" }, words), h("p", {}, h("a", { href: "#/live" }, "All twins"))];

export async function showTwin(root, id, left) {
  const path = `/v1/twins/${encodeURIComponent(id)}`;
  const ending = new AbortController(); // the view is left, or the twin is gone
  const { signal } = ending;
  left.addEventListener("abort", () => ending.abort());
  const source = age.source(signal);
  const answered = source.asked();
  let found;
  try {
    found = await Promise.all([ask(path, { signal }), ask(`${path}/scenario`, { signal }), listed("/v1/twins", { signal })]);
  } catch (error) {
    age.drop(source);
    if (error.status !== 404) throw error;
    root.append(...missing("No such twin", `There is no twin called ${id} here.`));
    return;
  }
  const [state, scenario, items] = found;
  const twin = new Twin(state, scenario, source, signal);
  const gone = () => {
    ending.abort();
    root.replaceChildren(...missing(`${id} was deleted`, "This twin was deleted with all it told while it was shown here."));
  };
  answered();
  twin.put(root, items);
  watchTwins(path, id, { shown: (others) => twin.choose(others), gone }, signal);
  twin.run(state).catch((error) => {
    age.drop(source);
    if (signal.aborted) return;
    if (error.status === 404) gone();
    else root.prepend(h("p", { class: "problem", role: "alert" }, error.message));
  });
}
