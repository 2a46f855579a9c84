// The live series: panels with one window of time and one cursor, drawn at most once a frame.
import { remember, remembered } from "../lib/address.js";
import { download } from "../lib/api.js";
import { h, set, table as htmlTable, toast } from "../lib/dom.js";
import { clock, number } from "../lib/format.js";
import { touched } from "../lib/touch.js";
import uPlot from "../vendor/uplot/uPlot.esm.js";
import { levelsOf, marginWords } from "./limits.js";
import { AT_REST, MOVING, dataOf, extrasOf, fanBehind, keyWords, notesOn, panelOf } from "./panels.js";
import { SPANS, Span } from "./span.js";
import { stripWords } from "./strip.js";
import { levelFor, stepOf } from "./tiles.js";

const MOST_ROWS = 60; // of the table of values
const STILL = 200; // the window rests when it has not been moved for so long [ms]

export class Series {
  // What `element.series` is, for scripts: `table`, `span`, `history`, `ranges`.
  table = [[]];
  fan = null; // bands of a forecast, drawn behind the buffers: `times`, `pressures` by buffer
  pointed = () => {}; // hears of the time under the cursor [s], null where there is none
  notes = []; // of people, drawn behind the lines: `number`, `time_s`, `to_s`
  #level = -1; // of the table
  #covers = [0, 0]; // stretch of time in it, where it is known
  #cursor = null; // row under it
  #pointed = null; // and its time
  #due = 0;
  #fresh = false; // there is more to show
  #plots = [];
  #keys = [];
  #margins = []; // where each panel says how far it is to its limits

  constructor(history, record, station, signal) {
    this.history = history;
    this.panels = record.panels;
    this.whole = record.whole;
    this.table = record.whole([[], ...record.columns.map(() => [])]);
    this.levels = levelsOf(station);
    this.span = new Span();
    this.#build();
    this.element.series = this;
    const more = () => {
      this.#fresh = true;
      this.#draw();
    };
    history.addEventListener("change", () => {
      this.grow();
      more();
    });
    this.span.addEventListener("change", () => {
      if (!this.span.follow) this.#move();
      this.#draw();
      this.#note();
    });
    const resized = new ResizeObserver(() => this.#resize());
    resized.observe(this.body);
    matchMedia("screen and (prefers-color-scheme: dark)").addEventListener("change", () => this.#plots.forEach((plot) => plot.redraw(false)), { signal });
    signal.addEventListener("abort", () => {
      resized.disconnect();
      cancelAnimationFrame(this.#due);
      clearTimeout(this.rest);
      clearTimeout(this.noting);
      this.#plots.forEach((plot) => plot.destroy());
    });
  }

  #build() {
    const group = uPlot.sync(`series-${Math.random()}`);
    this.body = h("div", { class: "panels", tabindex: "0", role: "group", "aria-label": "Charts over time", "aria-describedby": "series-keys", onkeydown: (event) => this.#key(event) });
    this.panels.forEach((panel, order) => {
      const keys = panel.lines.map((line, place) => this.#keyOf(line, panel, order, place));
      const words = panel.lines.length ? null : h("p", { class: "strip-words" });
      if (words) this.words = words;
      const place = h("div", { class: "plot" });
      const title = h("h3", {}, panel.title, panel.unit && h("span", { class: "unit" }, ` [${panel.unit}]`));
      const levels = panel.levels ?? this.levels[panel.id] ?? [];
      const margins = !panel.levels && levels.length > 0 && h("p", { class: "margin-words" });
      if (margins) this.#margins.push({ panel, levels, place: margins });
      this.body.append(h("div", { class: "panel" }, h("div", { class: "panel-head" }, title, h("div", { class: "keys" }, keys), words), place, margins));
      const hooks = { setCursor: [(u) => this.#point(u)], setSelect: [(u) => this.#marked(u)] };
      hooks.drawClear = [(u) => notesOn(u, this.notes, order === 0)];
      if (panel.id === "buffers") hooks.drawClear.push((u) => fanBehind(u, this.fan));
      const plot = panelOf(panel, place, { group, hooks, levels, press: (u, target, pass) => this.#press(u, pass), last: order === this.panels.length - 1 });
      this.#plots.push(plot);
      plot.over.addEventListener("wheel", (event) => this.#wheel(event, plot), { passive: false });
      plot.over.addEventListener("dblclick", () => this.span.live());
      touched(plot.over, { shown: () => [this.span.from, this.span.to], edges: () => [0, plot.over.clientWidth], look: (from, to) => this.span.place(from, to) });
    });
    this.about = h("p", { class: "shown" });
    this.element = h("section", { class: "card series", "aria-label": "Series" }, this.#toolbar(), this.body, this.#below());
  }

  #keyOf(line, panel, order, place) {
    const value = h("span", { class: "value", "data-column": line.column }, "–");
    const toggle = h("button", { class: `key ${line.name.toLowerCase()}`, type: "button", "aria-pressed": "true" }, h("b", { "aria-hidden": "true" }, line.letter), ` ${line.name} `, value);
    toggle.addEventListener("click", () => {
      const shown = toggle.getAttribute("aria-pressed") !== "true";
      toggle.setAttribute("aria-pressed", String(shown));
      this.#plots[order].setSeries(place + 1, { show: shown });
      extrasOf(panel).forEach(({ of }, extra) => of === place && this.#plots[order].setSeries(1 + panel.lines.length + extra, { show: shown }));
    });
    this.#keys.push({ line, panel, value });
    return toggle;
  }

  #toolbar() {
    const button = (text, label, act) => h("button", { type: "button", "aria-label": label, title: label, onclick: act }, text);
    this.follow = h("button", { type: "button", class: "follow", "aria-pressed": "true", onclick: () => this.span.live() }, "Follow");
    this.spans = SPANS.map(([length, text]) => h("button", { type: "button", "aria-pressed": "false", onclick: () => this.span.choose(length) }, text));
    return h("div", { class: "head" }, h("h2", {}, "Series"),
      h("div", { class: "group", role: "group", "aria-label": "Span of time" }, this.spans),
      h("div", { class: "group", role: "group", "aria-label": "Move and zoom" },
        button("◀", "Earlier", () => this.span.pan(-0.5)), button("▶", "Later", () => this.span.pan(0.5)),
        button("+", "Zoom in", () => this.#zoom(0.5)), button("−", "Zoom out", () => this.#zoom(2))),
      this.follow);
  }

  #below() {
    const list = h("div", {});
    const details = h("details", { class: "values-table" }, h("summary", {}, "These values as a table"), list);
    details.addEventListener("toggle", () => list.replaceChildren(...(details.open ? [this.#values()] : [])));
    const save = h("button", { type: "button", class: "plain", onclick: () => this.#save() }, "Save as CSV");
    return h("div", { class: "series-foot" }, this.about, save, h("p", { class: "hint", id: "series-keys" },
      "Drag to zoom, Shift and drag to pan, Ctrl and wheel to zoom, double click for the live end. By touch: one finger pans, two zoom. Keys: ← → pan, + − zoom, Home End to the begin and the live end, , . cursor, Escape takes it away. The station's picture and the events follow it."), details);
  }

  async #save() {
    const [from, to] = [Math.floor(this.span.from), Math.ceil(this.span.to)];
    await download(`/v1/twins/${this.history.twin}/history?format=csv&from_s=${from}&to_s=${to}`, `${this.history.twin}-${from}-${to}.csv`).catch((error) => toast(error.message, "problem"));
  }

  #values() {
    const lines = this.panels.flatMap((panel) => panel.lines.map((line) => ({ ...line, panel })));
    const [times] = this.table;
    const rows = times.map((time, row) => row).filter((row) => times[row] >= this.span.from && times[row] <= this.span.to);
    const every = Math.max(1, Math.ceil(rows.length / MOST_ROWS));
    return htmlTable(`Series, ${every === 1 ? "every row" : `every ${every}th row`} of the window`,
      ["Time", ...lines.map(({ name, panel }) => `${panel.title} ${name.toLowerCase()} [${panel.unit}]`)],
      rows.filter((row, place) => place % every === 0).map((row) => [clock(times[row]), ...lines.map(({ at, panel }) => number(this.table[at][row], panel.digits))]));
  }

  get ranges() {
    // What each panel's y axis shows, by the panel.
    return Object.fromEntries(this.#plots.map(({ scales: { y } }, order) => [this.panels[order].id, [y.min, y.max]]));
  }

  // Moving.

  begin() {
    // Stand where the address says; the history knows its end by now.
    const [from, to, length] = ["from", "to", "span"].map((name) => Number(remembered(name) ?? NaN));
    if (to > from && from >= 0) this.span.place(from, to);
    else if (length > 0 || remembered("span") === "all") this.span.choose(length || Infinity);
  }

  #note() {
    // The window into the address, once it rests: browsers refuse many writes a second.
    const { follow, from, to, length } = this.span;
    const said = follow ? { from: null, to: null, span: length === SPANS[0][0] ? null : length === Infinity ? "all" : String(Math.round(length)) } : { from: String(Math.round(from)), to: String(Math.round(to)), span: null };
    if (JSON.stringify(said) === this.noted) return;
    this.noted = JSON.stringify(said);
    clearTimeout(this.noting);
    this.noting = setTimeout(() => this.element.isConnected && remember(said), STILL);
  }

  #zoom(factor) {
    this.span.zoom(factor, this.span.follow ? this.span.to : undefined);
  }

  #press(u, pass) {
    return (event) => {
      if (event.button === 0 && event.shiftKey) this.#panBy(event, u);
      else pass(event);
      return null;
    };
  }

  #panBy(event, u) {
    // Until the button is let go.
    const { from, to } = this.span;
    const start = event.clientX;
    const width = u.over.clientWidth;
    const ending = new AbortController();
    const moved = ({ clientX }) => {
      const by = ((start - clientX) / width) * (to - from);
      if (by) this.span.place(from + by, to + by);
    };
    window.addEventListener("mousemove", moved, { signal: ending.signal });
    window.addEventListener("mouseup", () => ending.abort(), { signal: ending.signal });
  }

  #wheel(event, u) {
    if (!event.ctrlKey && !event.metaKey) return; // the page is scrolled
    event.preventDefault();
    const at = u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x");
    this.span.zoom(Math.exp(Math.min(Math.max(event.deltaY, -200), 200) / 400), at);
  }

  #marked(u) {
    const { left, width } = u.select;
    if (width < 6) return;
    const [from, to] = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.span.place(from, to);
  }

  #key(event) {
    if (event.target !== this.body || event.ctrlKey || event.metaKey || event.altKey) return;
    const acts = {
      ArrowLeft: () => this.span.pan(-0.1), ArrowRight: () => this.span.pan(0.1), PageUp: () => this.span.pan(-0.9), PageDown: () => this.span.pan(0.9),
      "+": () => this.#zoom(0.5), "=": () => this.#zoom(0.5), "-": () => this.#zoom(2),
      Home: () => this.span.place(0, this.span.to - this.span.from), End: () => this.#live(), ",": () => this.#step(-1), ".": () => this.#step(1), Escape: () => this.#leave(),
    };
    if (!acts[event.key]) return;
    event.preventDefault();
    acts[event.key]();
  }

  #step(by) {
    const [times] = this.table;
    const last = lastWithin(times, this.span.to);
    const first = Math.max(0, times.findIndex((time) => time >= this.span.from));
    const row = Math.min(Math.max((this.#cursor ?? last) + by, first), last); // no second that is not shown
    for (const plot of this.#plots) plot.setCursor({ left: Math.max(0, plot.valToPos(times[row], "x")), top: 10 });
  }

  #leave() {
    for (const plot of this.#plots) plot.setCursor({ left: -10, top: -10 });
  }

  #live() {
    this.#leave();
    this.span.live();
  }

  #point(u) {
    const row = u.cursor.idx ?? null;
    if (row === this.#cursor) return;
    this.#cursor = row;
    this.#draw();
  }

  // Drawing.

  #move() {
    // While somebody moves the window, its lines are thin; then they are drawn once more.
    this.#width(MOVING);
    clearTimeout(this.rest);
    this.rest = setTimeout(() => {
      this.#width(AT_REST);
      this.#plots.forEach((plot) => plot.redraw(false));
    }, STILL);
  }

  #width(width) {
    this.#plots.forEach((plot, order) => plot.series.slice(1, 1 + this.panels[order].lines.length).forEach((series) => (series.width = width)));
  }

  again() {
    // What is drawn besides the table has changed.
    this.#plots.forEach((plot) => plot.redraw(false));
  }

  #resize() {
    const width = Math.floor(this.body.clientWidth);
    if (width < 80 || width === this.width) return;
    this.width = width;
    this.#plots.forEach((plot, order) => plot.setSize({ width, height: this.panels[order].height }));
    this.#draw();
  }

  #draw() {
    this.#due ||= requestAnimationFrame(() => {
      this.#due = 0;
      this.#redraw();
    });
  }

  grow() {
    // Of a twin that would run through the window before its samples are here, what is at hand is followed.
    const { end, known } = this.history;
    this.span.grow(known && end - known > (this.span.to - this.span.from) / 2 ? known : end);
  }

  #redraw() {
    if (!this.width) this.#resize();
    const { from, to, follow } = this.span;
    const { end, known } = this.history;
    const level = levelFor(to - from, (this.width ?? 600) - 80);
    if (follow) this.history.want(level, Math.max(0, end - (to - from)), Math.max(end, to));
    else this.history.want(level, from, to);
    const ready = this.history.whole(level, from, follow ? Math.min(to, known) : to);
    if (this.#fresh || level !== this.#level || from < this.#covers[0] || to > this.#covers[1]) {
      // Until the finer, or coarser, rows are there the ones before are shown.
      if (ready || level === this.#level || this.#level < 0) {
        this.#covers = [from - (to - from), to + (to - from)];
        this.table = this.whole(this.history.rows(level, ...this.#covers));
        this.#level = level;
        this.#fresh = false;
        this.#fill();
      }
    }
    for (const plot of this.#plots) if (plot.scales.x.min !== from || plot.scales.x.max !== to) plot.setScale("x", { min: from, max: to });
    this.#tell(ready);
  }

  #fill() {
    this.#plots.forEach((plot, order) => {
      plot.table = this.table;
      plot.batch(() => {
        plot.setData(dataOf(this.panels[order], this.table), false);
        plot.setScale("x", { min: this.span.from, max: this.span.to });
      });
    });
  }

  #tell(ready) {
    const { span } = this;
    const [times] = this.table;
    const under = this.#cursor !== null && this.#cursor < times.length ? times[this.#cursor] : null;
    const row = under !== null ? this.#cursor : lastWithin(times, span.to);
    if (under !== this.#pointed) this.pointed((this.#pointed = under));
    for (const { line, panel, value } of this.#keys) set(value, keyWords(line, panel, this.table, row));
    for (const { panel, levels, place } of this.#margins) {
      const figures = panel.lines.map((line) => [line.name, row < 0 ? null : this.table[line.at][row]]);
      set(place, levels.map((level) => marginWords(level, figures, panel.unit)).join(" · "));
    }
    const words = row >= 0 ? stripWords(this.table, row, this.panels.at(-1).rows) : [];
    if (this.words.dataset.said !== String(words)) this.words.replaceChildren(...words.flatMap(([name, text]) => [h("span", {}, `${name} `), h("b", {}, text), " "]));
    this.words.dataset.said = String(words);
    const at = row >= 0 ? `${this.#cursor === null ? "newest" : "cursor"} ${clock(times[row])}` : "nothing told yet";
    const kind = this.#level <= 0 ? "every second" : this.history.fold === "hold" ? `one second of every ${stepOf(this.#level) / 2} s` : `least and greatest of every ${stepOf(this.#level)} s`;
    set(this.about, `${clock(Math.max(0, span.from))} to ${clock(span.to)} · ${kind}${ready || (span.follow && this.table[0].length) ? "" : ", loading"} · ${at}`);
    this.follow.setAttribute("aria-pressed", String(span.follow));
    SPANS.forEach(([length], place) => this.spans[place].setAttribute("aria-pressed", String(span.follow && span.length === length)));
  }
}

function lastWithin(times, to) {
  let row = times.length - 1;
  while (row > 0 && times[row] > to) row--;
  return row;
}
