// What a twin has told, as the window needs it: stored samples by GET /history, the live end from the stream.
import { ask } from "../lib/api.js";
import { Tail } from "./tail.js";
import { BINS, Tiles, rowsPerBin, stepOf } from "./tiles.js";

const ABSORB = 900; // so many samples of the live end are fetched as history: their tile is then whole [s]
const PAUSE = 1000; // between two fetches of a live end that is faster than the stream [ms]

export class History extends EventTarget {
  // Says "change" when there is more to show.
  end = 0; // samples told
  fetches = 0;
  #fetched = 0; // up to here it was fetched [s]
  #tiles;
  #tail;
  #wanted = null;
  #busy = false;
  #version = 0; // what was asked for before a restart is not taken up
  #rested = -PAUSE;
  #wake = () => {};
  #asking = new AbortController();

  constructor(twin, { columns, fold }, signal) {
    super();
    this.twin = twin;
    this.columns = columns;
    this.fold = fold;
    this.#tiles = new Tiles(columns.length);
    this.#tail = new Tail(columns.length);
    this.signal = signal;
  }

  get kept() {
    return { tiles: this.#tiles.size, samples: this.#tail.length };
  }

  get known() {
    // Up to where every second is at hand: behind the end, where the twin is faster than its stream [s].
    return this.#tail.whole <= this.#fetched ? this.end : Math.min(this.#fetched, this.end);
  }

  restart(end) {
    // The twin may have gone on from before what is known: nothing of it counts any more.
    this.#version++;
    this.#tiles.clear();
    this.#tail.clear();
    this.end = end;
    this.#fetched = 0;
    this.#pump();
  }

  extend(end) {
    this.end = Math.max(this.end, end);
    this.#pump();
  }

  take(values) {
    // A sample of the stream.
    if (!this.#tail.add(values.time, this.columns.map((name) => values[name]))) return;
    this.extend(values.time + 1);
    this.dispatchEvent(new Event("change"));
  }

  want(level, from, to) {
    // The window shows this: first what is seen, then as much on either side.
    if (level !== this.#wanted?.level) this.#asking.abort(); // what is on its way is not wanted any more
    this.#wanted = { level, from, to };
    this.#wake();
    this.#pump();
  }

  #bins(level, from, to) {
    const step = stepOf(level);
    return [Math.max(0, Math.floor(from / step)), Math.min(Math.floor(this.end / step), Math.floor(to / step) + 1)];
  }

  whole(level, from, to) {
    // Whether nothing that is seen has still to be fetched.
    return this.#needed(level, ...this.#bins(level, from, to)) === null;
  }

  #needed(level, first, last) {
    const step = stepOf(level);
    if (last <= first) return null;
    const found = this.#tiles.missing(level, first, last);
    if (!found) return null;
    const live = found[0] * step >= this.#tail.whole && last * step >= this.end - step;
    return live && this.end - found[0] * step < ABSORB ? null : found;
  }

  #next() {
    if (!this.#wanted) return null;
    const { level, from, to } = this.#wanted;
    const [first, last] = this.#bins(level, from, to);
    const seen = this.#needed(level, first, last);
    if (seen) return { level, stretch: seen };
    const beside = this.#needed(level, ...this.#bins(level, from - (to - from), to + (to - from)));
    return beside && { level, stretch: beside };
  }

  async #pump() {
    if (this.#busy) return;
    this.#busy = true;
    try {
      for (let next = this.#next(); next && !this.signal.aborted; next = this.#next()) {
        const live = this.#fetched > 0 && (next.stretch[0] + 2) * stepOf(next.level) > this.#fetched; // what has come since
        const wait = live ? this.#rested + PAUSE - performance.now() : 0;
        if (wait > 0) {
          await new Promise((wake) => {
            this.#wake = wake;
            setTimeout(wake, wait);
          });
          continue; // the window, or the end, may be elsewhere by now
        }
        if (live) this.#rested = performance.now();
        await this.#fetch(next.level, ...next.stretch);
      }
    } catch {
      // The shell says that the connection is lost; `restart` or the next sample goes on from here.
    } finally {
      this.#busy = false;
    }
  }

  async #fetch(level, from, to) {
    const [step, version] = [stepOf(level), this.#version];
    const query = new URLSearchParams({ columns: this.columns.join(","), from_s: from * step, to_s: to * step - 1 });
    if (level) {
      query.set("step_s", this.fold === "hold" ? step / rowsPerBin(level) : step);
      query.set("fold", this.fold);
    }
    this.fetches++;
    this.#asking = new AbortController();
    const signal = AbortSignal.any([this.signal, this.#asking.signal]);
    const answer = await ask(`/v1/twins/${this.twin}/history?${query}`, { signal }).catch((error) => {
      if (!this.#asking.signal.aborted) throw error;
    });
    if (!answer) return;
    const { columns } = answer;
    if (version !== this.#version) return;
    this.#tiles.put(level, from, to, columns.time, this.columns.map((name) => columns[name]));
    this.#fetched = Math.max(this.#fetched, to * step);
    this.dispatchEvent(new Event("change"));
  }

  rows(level, from, to) {
    // [times, a column each] of every tile that the stretch touches, and of the live end; null where nothing is known.
    const [step, per] = [stepOf(level), rowsPerBin(level)];
    const table = [[], ...this.columns.map(() => [])];
    let known = 0; // seconds before this one are drawn, or known to be missing
    const last = Math.min(Math.floor(this.end / step), Math.floor(to / step) + 1);
    for (let index = Math.max(0, Math.floor(from / step / BINS)); index * BINS < last; index++) {
      const tile = this.#tiles.get(level, index);
      const begin = index * BINS * step;
      const rows = (tile?.filled ?? 0) * per;
      if (!rows) continue;
      if (table[0].length && begin > known) push(table, known);
      for (let row = 0; row < rows; row++) table[0].push(begin + (row * step) / per);
      for (let column = 0; column < this.columns.length; column++) {
        const [base, into] = [column * BINS * per, table[column + 1]];
        for (let row = 0; row < rows; row++) {
          const figure = tile.data[base + row];
          into.push(figure === figure ? figure : null); // NaN is nothing
        }
      }
      known = begin + tile.filled * step;
    }
    if (to < known) return table;
    const tail = this.#tail;
    for (let row = tail.from(Math.max(known, from - step)); row < tail.length; row++) {
      const at = tail.place(row);
      table[0].push(tail.time[at]);
      for (let column = 0; column < this.columns.length; column++) {
        const figure = tail.data[column * tail.capacity + at];
        table[column + 1].push(figure === figure ? figure : null);
      }
    }
    return table;
  }
}

function push(table, time) {
  table[0].push(time);
  for (let column = 1; column < table.length; column++) table[column].push(null);
}
