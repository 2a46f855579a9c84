// What a twin told of the second under the cursor, for the station's picture and the events.
import { ask } from "../lib/api.js";

const KEPT = 600; // seconds that are not asked for again

export class Past {
  time = null; // of the second that is shown; null: the newest is
  #wanted = null;
  #busy = false;
  #kept = new Map(); // time -> values of the seconds up to it

  // `before`: so many seconds before it are read as well; `show(time, rows)` is called with them, or with (null, []).
  constructor(path, before, show, signal) {
    Object.assign(this, { path, before, show, signal });
  }

  restart() {
    this.#kept.clear();
  }

  point(time) {
    // The cursor stands at a time [s], or nowhere.
    this.#wanted = time;
    if (time === null) this.#leave();
    this.#read();
  }

  #leave() {
    if (this.time === null) return;
    this.time = null;
    this.show(null, []);
  }

  async #read() {
    // One question at a time: a cursor that moves on is followed where it is when the answer comes.
    if (this.#busy) return;
    this.#busy = true;
    try {
      while (this.#wanted !== null && this.#wanted !== this.time && !this.signal.aborted) {
        const time = this.#wanted;
        const rows = this.#kept.get(time) ?? (await this.#ask(time));
        if (this.#wanted === null) break;
        if (rows.length) {
          this.time = time;
          this.show(time, rows);
        } else {
          this.#leave();
          if (this.#wanted === time) break;
        }
      }
    } catch {
      // The shell says that the connection is lost; the newest stays.
    } finally {
      this.#busy = false;
    }
  }

  async #ask(time) {
    const { columns } = await ask(`${this.path}/history?from_s=${Math.max(0, time - this.before)}&to_s=${time}`, { signal: this.signal });
    const rows = columns.time.map((_, row) => Object.fromEntries(Object.entries(columns).map(([name, figures]) => [name, figures[row]])));
    if (rows.at(-1)?.time !== time) return []; // kept as minutes: nobody knows the second any more
    this.#kept.set(time, rows);
    if (this.#kept.size > KEPT) this.#kept.delete(this.#kept.keys().next().value);
    return rows;
  }
}
