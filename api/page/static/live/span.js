// The window of time that the series show: it follows the live end, or stands where somebody put it.
const SHORTEST = 20; // [s]
export const SPANS = [
  [600, "10 min"],
  [3600, "1 h"],
  [21600, "6 h"],
  [Infinity, "all"],
];

export class Span extends EventTarget {
  // Says "change" whenever it has moved.
  follow = true;
  length = 600; // wanted while it follows [s]
  end = 0; // of what there is [s]
  from = 0;
  to = 600;

  #moved() {
    this.dispatchEvent(new Event("change"));
  }

  #toEnd() {
    const length = this.length === Infinity ? Math.max(this.end, 60) : this.length;
    this.to = Math.max(this.end, length);
    this.from = this.to - length;
  }

  grow(end) {
    if (end === this.end) return;
    this.end = end;
    if (!this.follow) return;
    this.#toEnd();
    this.#moved();
  }

  choose(length) {
    // So many seconds up to the live end.
    this.length = length;
    this.live();
  }

  live() {
    this.follow = true;
    this.#toEnd();
    this.#moved();
  }

  place(from, to) {
    // Stand here, within what there is.
    const longest = Math.max(this.end, 600);
    const length = Math.min(Math.max(to - from, SHORTEST), longest);
    const middle = (from + to) / 2;
    this.from = Math.min(Math.max(middle - length / 2, 0), longest - length);
    this.to = this.from + length;
    this.follow = false;
    this.length = length;
    this.#moved();
  }

  pan(share) {
    const by = share * (this.to - this.from);
    this.place(this.from + by, this.to + by);
  }

  zoom(factor, at = (this.from + this.to) / 2) {
    // At the live end it goes on following, with another length.
    if (this.follow && at >= this.to) return this.choose(Math.max(SHORTEST, Math.min((this.to - this.from) * factor, Math.max(this.end, 600))));
    this.place(at - (at - this.from) * factor, at + (this.to - at) * factor);
  }
}
